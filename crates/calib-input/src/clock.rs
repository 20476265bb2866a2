//! When a still was taken, by its EXIF data (CIPA DC-008, 4.6).

use exif::{DateTime, Exif, In, Reader, Tag, Value};
use jiff::Timestamp;

/// The time in EXIF data, as RFC 3339 has it; a clock of which no zone is said is taken for one of UTC.
pub(crate) fn time(data: Vec<u8>) -> Option<String> {
    let exif = Reader::new().read_raw(data).ok()?;
    let clocks = [(Tag::DateTimeOriginal, Tag::OffsetTimeOriginal), (Tag::DateTime, Tag::OffsetTime)];
    clocks.into_iter().find_map(|(clock, zone)| read(text(&exif, clock)?, text(&exif, zone)))
}

fn read(clock: &[u8], zone: Option<&[u8]>) -> Option<String> {
    let mut at = DateTime::from_ascii(clock).ok()?;
    // A zone that is blank leaves the clock without one.
    zone.map(|zone| at.parse_offset(zone));
    let DateTime { year, month, day, hour, minute, second, offset, .. } = at;
    let time = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}{}", written(offset));
    time.parse::<Timestamp>().is_ok().then_some(time)
}

fn text(exif: &Exif, tag: Tag) -> Option<&[u8]> {
    match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Ascii(parts) => parts.first().map(Vec::as_slice),
        _ => None,
    }
}

/// A zone by its minutes ahead of UTC.
fn written(offset: Option<i16>) -> String {
    offset.map_or_else(
        || "Z".to_owned(),
        |minutes| {
            let sign = if minutes < 0 { '-' } else { '+' };
            format!("{sign}{:02}:{:02}", minutes.abs() / 60, minutes.abs() % 60)
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the directory of the camera is, in that of the file.
    const CAMERA: u16 = 0x8769;

    /// EXIF data that says a time, and an offset.
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
    fn the_clock_of_the_camera_is_read() {
        for (zone, told) in [(b"+02:00\0", "+02:00"), (b"-09:30\0", "-09:30"), (b"      \0", "Z")] {
            let data = exif(b"2026:05:01 08:30:05\0", zone);
            assert_eq!(time(data), Some(format!("2026-05-01T08:30:05{told}")));
        }
    }

    #[test]
    fn what_is_cut_or_says_nothing_has_no_time() {
        let told = exif(b"2026:05:01 08:30:05\0", b"+02:00\0");
        for length in 0..told.len() - 8 {
            assert_eq!(time(told[..length].to_vec()), None, "{length}");
        }
        for clock in [b"                   \0", b"2026:13:01 08:30:05\0", b"    :  :     :  :  \0"] {
            assert_eq!(time(exif(clock, b"+02:00\0")), None);
        }
    }
}
