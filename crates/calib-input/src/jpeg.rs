//! What the markers of a JPEG say of it, without decoding it.

/// Starts a JPEG.
const START: [u8; 2] = [0xFF, 0xD8];
const END: u8 = 0xD9;
const START_OF_SCAN: u8 = 0xDA;
/// A frame whose coefficients are in memory until the last scan.
const PROGRESSIVE: u8 = 0xC2;

/// What the markers say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Jpeg {
    /// Whether its end is there: decoders fill what is missing with grey.
    pub(crate) is_whole: bool,
    /// Whether it is refined scan by scan.
    pub(crate) is_progressive: bool,
}

impl Jpeg {
    /// `None` for what is no JPEG.
    pub(crate) fn of(bytes: &[u8]) -> Option<Self> {
        bytes.starts_with(&START).then(|| Self::default().walk(bytes))
    }

    /// From marker to marker, over the lengths of segments and the data of scans (ITU T.81, annex B).
    fn walk(mut self, bytes: &[u8]) -> Self {
        let mut at = START.len();
        while let Some((marker, after)) = next_marker(bytes, at) {
            match marker {
                END => return Self { is_whole: true, ..self },
                // Stand alone: restarts, and one for private use.
                0x01 | 0xD0..=0xD8 => at = after,
                _ => {
                    let Some(length) = bytes.get(after..after + 2) else { return self };
                    at = after + usize::from(u16::from_be_bytes([length[0], length[1]]));
                    self.is_progressive |= marker == PROGRESSIVE;
                    if marker == START_OF_SCAN {
                        at = end_of_scan(bytes, at);
                    }
                }
            }
        }
        self
    }
}

/// The marker at or after a place, and the place after it.
fn next_marker(bytes: &[u8], from: usize) -> Option<(u8, usize)> {
    let start = from + bytes.get(from..)?.iter().position(|&byte| byte == 0xFF)?;
    let fill = bytes[start..].iter().take_while(|&&byte| byte == 0xFF).count();
    Some((*bytes.get(start + fill)?, start + fill + 1))
}

/// In the data of a scan, 0xFF 0x00 stands for 0xFF, and restarts belong to it.
fn end_of_scan(bytes: &[u8], from: usize) -> usize {
    let rest = bytes.get(from..).unwrap_or_default();
    let ends = |pair: &[u8]| pair[0] == 0xFF && !matches!(pair[1], 0x00 | 0xD0..=0xD7 | 0xFF);
    from + rest.windows(2).position(ends).unwrap_or(rest.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jpeg() -> Vec<u8> {
        let mut bytes = Vec::new();
        let image = image::RgbImage::from_fn(64, 48, |x, y| image::Rgb([x as u8, y as u8, (x * y) as u8]));
        let encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
        assert!(image.write_with_encoder(encoder).is_ok());
        bytes
    }

    #[test]
    fn a_jpeg_that_was_cut_anywhere_is_not_whole() {
        let whole = jpeg();
        assert_eq!(Jpeg::of(&whole), Some(Jpeg { is_whole: true, is_progressive: false }));
        for length in 2..whole.len() {
            assert_eq!(Jpeg::of(&whole[..length]).map(|jpeg| jpeg.is_whole), Some(false), "{length} bytes");
        }
    }

    #[test]
    fn a_thumbnail_in_a_segment_does_not_end_the_jpeg() {
        let mut bytes = jpeg();
        let thumbnail = jpeg();
        let length = u16::try_from(thumbnail.len() + 2).unwrap_or_default().to_be_bytes();
        bytes.splice(2..2, [0xFF, 0xE1, length[0], length[1]].into_iter().chain(thumbnail));
        assert!(Jpeg::of(&bytes).is_some_and(|jpeg| jpeg.is_whole));
        bytes.truncate(bytes.len() - 2);
        assert!(Jpeg::of(&bytes).is_some_and(|jpeg| !jpeg.is_whole));
    }
}
