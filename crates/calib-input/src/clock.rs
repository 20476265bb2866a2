//! Capture time of an image, from its EXIF data (CIPA DC-008, 4.6) or its file name.

use exif::{DateTime, Exif, In, Reader, Tag, Value};
use jiff::Timestamp;

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

/// Returns the time (RFC 3339) in the name of an image, such as `2026-05-01T080000Z` or `20260501_0800`. It
/// is taken as UTC, because file names have no zone.
#[must_use]
pub fn time_in_name(name: &str) -> Option<String> {
    times(name).next().map(|(time, _)| time.to_string())
}

/// Returns the time in the name of an image, as [`time_in_name`], if the name states the second.
#[must_use]
pub fn second_in_name(name: &str) -> Option<String> {
    times(name).next().filter(|(_, has_second)| *has_second).map(|(time, _)| time.to_string())
}

/// Returns the times in a name, and whether each states the second.
fn times(name: &str) -> impl Iterator<Item = (Timestamp, bool)> {
    let starts = (0..name.len()).filter(|&start| is_number_start(name, start));
    starts.filter_map(|start| time_at(&name[start..]))
}

fn is_number_start(name: &str, start: usize) -> bool {
    let is_digit = |at: usize| name.as_bytes().get(at).is_some_and(u8::is_ascii_digit);
    is_digit(start) && !(start > 0 && is_digit(start - 1))
}

/// Parses a time at the start of a text: year, month and day, then hour and minute, then optional seconds. Also returns
/// whether there are seconds.
fn time_at(text: &str) -> Option<(Timestamp, bool)> {
    let mut rest = text;
    let mut number = |digits: usize| {
        let skipped = rest.trim_start_matches(['-', '_', ':', '.', 'T', ' ']);
        // At most one separator is allowed.
        if rest.len() - skipped.len() > 1 {
            return None;
        }
        let found = skipped.get(..digits).filter(|part| part.bytes().all(|byte| byte.is_ascii_digit()))?;
        rest = &skipped[digits..];
        found.parse::<u32>().ok()
    };
    let (year, month, day) = (number(4)?, number(2)?, number(2)?);
    let (hour, minute) = (number(2)?, number(2)?);
    let second = number(2);
    // Digits that are followed by a letter, as in 1080p, are not seconds.
    let ends = !rest.starts_with(|next: char| next.is_alphanumeric() && next != 'Z');
    let stated = second.filter(|&second| ends && second < 60);
    let second = stated.unwrap_or(0);
    let is_of_now = (1990..2200).contains(&year);
    let text = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z");
    text.parse().ok().filter(|_| is_of_now).map(|time| (time, stated.is_some()))
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
        for name in ["door", "shop-1", "20261301_083000", "12345678901234567", "2026-05-01", "tür-2026"] {
            assert_eq!(time_in_name(name), None, "{name}");
        }
    }
}
