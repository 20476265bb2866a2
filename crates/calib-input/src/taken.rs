//! When a still was taken, by its EXIF data (CIPA DC-008, 4.6): tags of a TIFF file inside of it.

/// Of the first directory: where that of the camera is.
const CAMERA: u16 = 0x8769;
/// Of the first directory: when the file was last changed.
const CHANGED: u16 = 0x0132;
/// Of the camera's directory: when the picture was taken, and how far its clock was ahead of UTC.
const TAKEN: u16 = 0x9003;
const AHEAD: u16 = 0x9011;

/// A TIFF file, its numbers in either order.
struct Tiff<'a> {
    bytes: &'a [u8],
    is_big: bool,
}

/// The time in EXIF data, as RFC 3339 has it; a clock of which no zone is said is taken for one of UTC.
pub(crate) fn time(exif: &[u8]) -> Option<String> {
    let tiff = Tiff { bytes: exif, is_big: exif.starts_with(b"MM") };
    let first = tiff.number(4, 4)?;
    let camera = tiff.entry(first, CAMERA).and_then(|entry| tiff.number(entry + 8, 4));
    let of_camera = |tag: u16| tiff.text(tiff.entry(camera?, tag)?);
    let clock = of_camera(TAKEN).or_else(|| tiff.text(tiff.entry(first, CHANGED)?))?;
    let (day, hour) = clock.split_once(' ')?;
    let zone = of_camera(AHEAD).filter(|zone| zone.len() == 6 && zone.starts_with(['+', '-']));
    let is_number =
        |part: &str| part.split(':').count() == 3 && part.bytes().all(|b| b == b':' || b.is_ascii_digit());
    let zone = zone.unwrap_or("Z");
    (is_number(day) && is_number(hour)).then(|| format!("{}T{hour}{zone}", day.replace(':', "-")))
}

impl<'a> Tiff<'a> {
    /// A number of so many bytes.
    fn number(&self, at: usize, bytes: usize) -> Option<usize> {
        let bytes = self.bytes.get(at..at.checked_add(bytes)?)?.iter().map(|byte| usize::from(*byte));
        let join = |sum: usize, byte: usize| sum << 8 | byte;
        Some(if self.is_big { bytes.fold(0, join) } else { bytes.rev().fold(0, join) })
    }

    /// Where a tag's entry of a directory is.
    fn entry(&self, directory: usize, tag: u16) -> Option<usize> {
        const LENGTH: usize = 12;
        let count = self.number(directory, 2)?;
        let mut entries = (0..count).map(|index| directory + 2 + LENGTH * index);
        entries.find(|&at| self.number(at, 2) == Some(usize::from(tag)))
    }

    /// The text of an entry: longer than four bytes it stands elsewhere.
    fn text(&self, entry: usize) -> Option<&'a str> {
        let length = self.number(entry + 4, 4)?;
        let start = if length > 4 { self.number(entry + 8, 4)? } else { entry + 8 };
        let text = self.bytes.get(start..start.checked_add(length)?)?;
        std::str::from_utf8(text).ok().map(|text| text.trim_matches(['\0', ' ']))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// EXIF data that says a time, and an offset.
    fn exif(clock: &[u8; 20], zone: &[u8; 7]) -> Vec<u8> {
        let entry = |tag: u16, kind: u16, count: u32, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        let first = [&[1, 0][..], &entry(CAMERA, 4, 1, 26), &[0; 4]].concat();
        let camera = [&[2, 0][..], &entry(TAKEN, 2, 20, 56), &entry(AHEAD, 2, 7, 76), &[0; 4]].concat();
        [&b"II*\0\x08\0\0\0"[..], &first, &camera, clock, zone].concat()
    }

    #[test]
    fn the_clock_of_the_camera_is_read() {
        let told = exif(b"2026:05:01 08:30:05\0", b"+02:00\0");
        assert_eq!(time(&told).as_deref(), Some("2026-05-01T08:30:05+02:00"));
        let told = exif(b"2026:05:01 08:30:05\0", b"      \0");
        assert_eq!(time(&told).as_deref(), Some("2026-05-01T08:30:05Z"));
    }

    #[test]
    fn what_is_cut_or_says_nothing_has_no_time() {
        let told = exif(b"2026:05:01 08:30:05\0", b"+02:00\0");
        for length in 0..told.len() - 8 {
            assert_eq!(time(&told[..length]), None, "{length}");
        }
        assert_eq!(time(&exif(b"                   \0", b"+02:00\0")), None);
    }
}
