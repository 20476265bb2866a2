//! Capture time of an image, from its EXIF data (CIPA DC-008, 4.6) or its file name.

use std::ops::Range;

use exif::{DateTime, Exif, In, Reader, Tag, Value};
use jiff::{SignedDuration, Timestamp, Unit};

/// Returns the capture time in EXIF data, as RFC 3339; a time without a zone is taken as UTC.
pub(crate) fn capture_time(data: Vec<u8>) -> Option<String> {
    let exif = Reader::new().read_raw(data).ok()?;
    let clocks = [(Tag::DateTimeOriginal, Tag::OffsetTimeOriginal), (Tag::DateTime, Tag::OffsetTime)];
    clocks.into_iter().find_map(|(clock, zone)| read(text(&exif, clock)?, text(&exif, zone)))
}

fn read(clock: &[u8], zone: Option<&[u8]>) -> Option<String> {
    let mut at = DateTime::from_ascii(clock).ok()?;
    // A blank zone is ignored.
    zone.map(|zone| at.parse_offset(zone));
    let DateTime { year, month, day, hour, minute, second, offset, .. } = at;
    let time =
        format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}{}", format_offset(offset));
    time.parse::<Timestamp>().is_ok().then_some(time)
}

fn text(exif: &Exif, tag: Tag) -> Option<&[u8]> {
    match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Ascii(parts) => parts.first().map(Vec::as_slice),
        _ => None,
    }
}

/// Formats the UTC offset of a zone, given in minutes ahead of UTC.
fn format_offset(offset: Option<i16>) -> String {
    offset.map_or_else(
        || "Z".to_owned(),
        |minutes| {
            let sign = if minutes < 0 { '-' } else { '+' };
            format!("{sign}{:02}:{:02}", minutes.abs() / 60, minutes.abs() % 60)
        },
    )
}

/// Time in the name of a file.
struct NamedTime {
    time: Timestamp,
    has_second: bool,
    /// Position of the time in the name, in bytes.
    range: Range<usize>,
}

/// Returns the time (RFC 3339) in the name of an image, such as `2026-05-01T080000Z`, `20260501_0800` or
/// `20260501_080000.250`. It is taken as UTC, because file names have no zone.
#[must_use]
pub fn time_in_name(name: &str) -> Option<String> {
    first_time(name).map(|found| found.time.to_string())
}

/// Returns the time in the name of an image, as [`time_in_name`], if the name contains the second.
#[must_use]
pub fn second_in_name(name: &str) -> Option<String> {
    first_time(name).filter(|found| found.has_second).map(|found| found.time.to_string())
}

/// Returns the name of a frame of a video. `video` is the name of the video; both names are without endings. If the
/// name of the video contains its start time with the second, the name of the frame contains the time of the frame,
/// to milliseconds. Otherwise the seconds from the start of the video follow the name.
#[must_use]
pub fn frame_name(video: &str, seconds: f64) -> String {
    let named =
        first_time(video).filter(|found| found.has_second).and_then(|NamedTime { time, range, .. }| {
            let shifted = time.checked_add(SignedDuration::try_from_secs_f64(seconds).ok()?).ok()?;
            let rounded = shifted.round(Unit::Millisecond).ok()?;
            let [before, after] = [&video[..range.start], &video[range.end..]];
            Some(format!("{before}{}{after}", rounded.strftime("%Y%m%d_%H%M%S%.3f")))
        });
    // The words between the numbers keep them from being read as parts of a time.
    named.unwrap_or_else(|| format!("{video} at {seconds:.2} s"))
}

/// Returns the first time in a name.
fn first_time(name: &str) -> Option<NamedTime> {
    let mut starts = (0..name.len()).filter(|&start| is_number_start(name, start));
    starts.find_map(|start| time_at(name, start))
}

fn is_number_start(name: &str, start: usize) -> bool {
    let is_digit = |at: usize| name.as_bytes().get(at).is_some_and(u8::is_ascii_digit);
    is_digit(start) && !(start > 0 && is_digit(start - 1))
}

/// Removes a number of `digits` digits, and at most one separator before it, from the start of a text. Returns the
/// number.
fn number(text: &mut &str, digits: usize) -> Option<u32> {
    let skipped = text.trim_start_matches(['-', '_', ':', '.', 'T', ' ']);
    if text.len() - skipped.len() > 1 {
        return None;
    }
    let found = skipped.get(..digits).filter(|part| part.bytes().all(|byte| byte.is_ascii_digit()))?;
    *text = &skipped[digits..];
    found.parse().ok()
}

/// Parses a time that starts at this byte of a name: year, month and day, then hour and minute, then optional seconds,
/// with optional milliseconds after a point.
fn time_at(name: &str, start: usize) -> Option<NamedTime> {
    let mut rest = &name[start..];
    let (year, month, day) = (number(&mut rest, 4)?, number(&mut rest, 2)?, number(&mut rest, 2)?);
    let (hour, minute) = (number(&mut rest, 2)?, number(&mut rest, 2)?);
    let minute_end = name.len() - rest.len();
    let second = number(&mut rest, 2);
    // Digits that are followed by a letter, as in 1080p, are not seconds.
    let ends = !rest.starts_with(|next: char| next.is_alphanumeric() && next != 'Z');
    let stated = second.filter(|&second| ends && second < 60);
    let second = stated.unwrap_or(0);
    let second_end = name.len() - rest.len();
    let is_digit = |at: usize| rest.as_bytes().get(at).is_some_and(u8::is_ascii_digit);
    let has_millisecond = stated.is_some() && rest.starts_with('.') && (1..4).all(is_digit) && !is_digit(4);
    let millisecond = if has_millisecond { &rest[..4] } else { "" };
    let is_of_now = (1990..2200).contains(&year);
    let text = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}{millisecond}Z");
    let end = if stated.is_some() { second_end + millisecond.len() } else { minute_end };
    let time = text.parse().ok().filter(|_| is_of_now)?;
    Some(NamedTime { time, has_second: stated.is_some(), range: start..end })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// TIFF tag that points to the EXIF directory.
    const CAMERA: u16 = 0x8769;

    /// Builds EXIF data with a time and an offset.
    fn exif(clock: &[u8; 20], zone: &[u8; 7]) -> Vec<u8> {
        let entry = |tag: u16, kind: u16, count: u32, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        let [taken, ahead] = [Tag::DateTimeOriginal, Tag::OffsetTimeOriginal].map(|tag| tag.number());
        let first = [&[1, 0][..], &entry(CAMERA, 4, 1, 26), &[0; 4]].concat();
        let camera = [&[2, 0][..], &entry(taken, 2, 20, 56), &entry(ahead, 2, 7, 76), &[0; 4]].concat();
        [&b"II*\0\x08\0\0\0"[..], &first, &camera, clock, zone].concat()
    }

    #[test]
    fn exif_time_is_read_with_its_offset() {
        for (zone, offset) in [(b"+02:00\0", "+02:00"), (b"-09:30\0", "-09:30"), (b"      \0", "Z")] {
            let data = exif(b"2026:05:01 08:30:05\0", zone);
            assert_eq!(capture_time(data), Some(format!("2026-05-01T08:30:05{offset}")));
        }
    }

    #[test]
    fn truncated_or_blank_exif_has_no_time() {
        let data = exif(b"2026:05:01 08:30:05\0", b"+02:00\0");
        for length in 0..data.len() - 8 {
            assert_eq!(capture_time(data[..length].to_vec()), None, "{length}");
        }
        for clock in [b"                   \0", b"2026:13:01 08:30:05\0", b"    :  :     :  :  \0"] {
            assert_eq!(capture_time(exif(clock, b"+02:00\0")), None);
        }
    }

    #[test]
    fn capture_time_is_parsed_from_file_names() {
        for name in
            ["door-2026-05-01T083005Z", "door_20260501_083005", "20260501083005", "cam12 2026-05-01 08.30.05"]
        {
            assert_eq!(time_in_name(name).as_deref(), Some("2026-05-01T08:30:05Z"), "{name}");
        }
        assert_eq!(time_in_name("door_20260501-0830").as_deref(), Some("2026-05-01T08:30:00Z"));
        for name in [
            "door_20260501_0830_1080p",
            "door_20260501_0830_720p",
            "door_20260501_0830_99",
            "door_20260501_0830-é",
        ] {
            assert_eq!(time_in_name(name).as_deref(), Some("2026-05-01T08:30:00Z"), "{name}");
        }
        for (name, time) in [
            ("door_20260501_083005.250", "2026-05-01T08:30:05.25Z"),
            ("door_20260501_083005.25", "2026-05-01T08:30:05Z"),
            ("door_20260501_083005.2500", "2026-05-01T08:30:05Z"),
            ("door_20260501_0830.250", "2026-05-01T08:30:00Z"),
        ] {
            assert_eq!(time_in_name(name).as_deref(), Some(time), "{name}");
        }
        for name in ["door", "shop-1", "20261301_083000", "12345678901234567", "2026-05-01", "tür-2026"] {
            assert_eq!(time_in_name(name), None, "{name}");
        }
    }

    #[test]
    fn the_name_of_a_frame_states_its_time() {
        let named = frame_name("door_2026-05-01T083005Z_main", 12.4804);
        assert_eq!(named, "door_20260501_083017.480Z_main");
        assert_eq!(time_in_name(&named).as_deref(), Some("2026-05-01T08:30:17.48Z"));
        assert_eq!(frame_name("20260501235959", 1.0), "20260502_000000.000");
        assert_eq!(frame_name("yard", 12.4804), "yard at 12.48 s");
        // Without the second, the time of the frame is unknown.
        for video in ["door_20260501", "door_2026050108", "door_20260501_08", "door_20260501_0830"] {
            for seconds in [3.0, 12.48, 30.0, 75.2, 1234.0] {
                let frame = frame_name(video, seconds);
                assert_eq!(time_in_name(&frame), time_in_name(video), "{frame}");
                assert_eq!(second_in_name(&frame), None, "{frame}");
            }
        }
    }
}
