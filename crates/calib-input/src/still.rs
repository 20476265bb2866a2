//! Stills as plain pixels: the header is believed only as far as the bytes bear it out.
//!
//! What the markers of a JPEG say of it, without decoding it.

use std::fmt;
use std::io::Cursor;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, RgbImage};

use crate::clock;
use crate::file::{OutOfMemory, reserved, room_for};

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

/// In a browser there are 4 GB at most, and a phone has less.
const IS_SMALL: bool = cfg!(target_pointer_width = "32");
/// Most memory that decoding one still may take, in bytes.
const MAX_MEMORY: u64 = if IS_SMALL { 1 << 28 } else { 1 << 30 };
/// Most memory that what accompanies the pixels may take, in bytes: a colour profile, words, a row.
const MAX_METADATA: u64 = 32 << 20;
/// Most pixels that a byte of a JPEG can stand for: a block of 64 takes a bit in a progressive one.
const JPEG_PIXELS: u64 = 512;
/// Most bytes that a byte of a PNG can stand for, by the way deflate packs.
const PNG_BYTES: u64 = 1032;
/// Of a coefficient of a progressive JPEG.
const COEFFICIENT_BYTES: u64 = 2;

/// Why a still is not decoded.
#[derive(Debug)]
pub enum StillError {
    /// Neither PNG nor JPEG, or broken.
    Broken(ImageError),
    /// The end is missing.
    CutShort {
        /// Width and height that its header says.
        size: [u32; 2],
        /// How many bytes there are.
        bytes: usize,
    },
    /// Larger than what is decoded.
    TooLarge {
        /// Width and height.
        size: [u32; 2],
        /// What it would take, in bytes.
        bytes: u64,
    },
    /// There is no memory for it.
    Memory(OutOfMemory),
}

impl fmt::Display for StillError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Broken(ImageError::Limits(_)) => write!(
                f,
                "what accompanies the pixels of the image, as its colour profile does, takes more than {} MiB; save \
                 it without that",
                MAX_METADATA >> 20
            ),
            Self::Broken(error) => write!(f, "not a whole PNG or JPEG image: {error}"),
            Self::CutShort { size: [w, h], bytes } => write!(
                f,
                "the image is truncated: its header says {w} x {h} pixels, and its {bytes} bytes end before \
                 the image does; copy it again from where it was made"
            ),
            Self::TooLarge { size: [w, h], bytes } => write!(
                f,
                "an image of {w} x {h} pixels takes {} MiB to decode, and at most {} MiB are taken; scale it \
                 down",
                bytes >> 20,
                MAX_MEMORY >> 20
            ),
            Self::Memory(error) => write!(f, "the image {error}"),
        }
    }
}

impl std::error::Error for StillError {}

impl From<ImageError> for StillError {
    fn from(error: ImageError) -> Self {
        Self::Broken(error)
    }
}

/// Width and height of a still after EXIF turning, from its header; that its end is there is seen, too.
///
/// # Errors
/// When it is no still, or not a whole one.
pub fn size_of(bytes: &[u8]) -> Result<[u32; 2], StillError> {
    let (decoder, orientation) = opened(bytes)?;
    let (width, height) = decoder.dimensions();
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    let is_on_its_side = matches!(orientation, Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH);
    Ok(if is_on_its_side { [height, width] } else { [width, height] })
}

/// When a still was taken by the clock of its camera (RFC 3339), if it says so; a clock without a zone is taken for UTC.
#[must_use]
pub fn taken(bytes: &[u8]) -> Option<String> {
    let (mut decoder, _) = opened(bytes).ok()?;
    clock::time(decoder.exif_metadata().ok()??)
}

/// Whether a still that another decoder takes, at so many bytes a pixel more than ours, is within the limits of
/// [`decode`]; nothing is decoded.
///
/// # Errors
/// When it is no still, not a whole one, or one too large.
pub fn room_to_decode(bytes: &[u8], more_per_pixel: u64) -> Result<(), StillError> {
    has_room(&opened(bytes)?.0, bytes, more_per_pixel)
}

fn has_room(decoder: &impl ImageDecoder, bytes: &[u8], more_per_pixel: u64) -> Result<(), StillError> {
    let (width, height) = decoder.dimensions();
    let more = (u64::from(width) * u64::from(height)).saturating_mul(more_per_pixel);
    let needed = memory(decoder, bytes).saturating_add(more);
    if needed > MAX_MEMORY {
        return Err(StillError::TooLarge { size: [width, height], bytes: needed });
    }
    room_for(needed).map_err(StillError::Memory)
}

/// Turns bytes into an image, upright as its EXIF data says.
///
/// # Errors
/// When the bytes are no still, not a whole one, or one too large.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, StillError> {
    let (decoder, orientation) = opened(bytes)?;
    has_room(&decoder, bytes, 0)?;
    let mut image = pixels(decoder)?;
    image.apply_orientation(orientation);
    Ok(image.into_rgb8())
}

fn pixels(decoder: impl ImageDecoder) -> Result<DynamicImage, StillError> {
    let (width, height) = decoder.dimensions();
    if decoder.color_type() != image::ColorType::Rgb8 {
        return Ok(DynamicImage::from_decoder(decoder)?);
    }
    let bytes = decoder.total_bytes();
    let mut buffer = reserved(bytes).map_err(StillError::Memory)?;
    // As long as it was reserved: both come of one number.
    buffer.resize(bytes as usize, 0);
    decoder.read_image(&mut buffer)?;
    let image = RgbImage::from_raw(width, height, buffer);
    image.map(DynamicImage::ImageRgb8).ok_or(StillError::TooLarge { size: [width, height], bytes })
}

/// What decoding takes, in bytes: the image as it is stored, as it is handed out, and what a decoder keeps.
fn memory(decoder: &impl ImageDecoder, bytes: &[u8]) -> u64 {
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    let rgb = if decoder.color_type() == image::ColorType::Rgb8 { 0 } else { 3 * pixels };
    let is_progressive = Jpeg::of(bytes).is_some_and(|jpeg| jpeg.is_progressive);
    let kept = if is_progressive { 3 * COEFFICIENT_BYTES * pixels } else { 0 };
    decoder.total_bytes().saturating_add(rgb).saturating_add(kept)
}

fn opened(bytes: &[u8]) -> Result<(impl ImageDecoder + '_, Orientation), StillError> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(ImageError::from)?;
    // The memory for the pixels is counted before they are decoded; this is for what is read with the header.
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_METADATA);
    reader.limits(limits);
    let format = reader.format();
    let mut decoder = reader.into_decoder()?;
    if is_cut(&decoder, format, bytes) {
        return Err(StillError::CutShort { size: decoder.dimensions().into(), bytes: bytes.len() });
    }
    let orientation = decoder.orientation()?;
    Ok((decoder, orientation))
}

/// Whether the bytes end too early, or are fewer than any image of this size has.
fn is_cut(decoder: &impl ImageDecoder, format: Option<ImageFormat>, bytes: &[u8]) -> bool {
    let (width, height) = decoder.dimensions();
    let (pixels, length) = (u64::from(width) * u64::from(height), bytes.len() as u64);
    match format {
        Some(ImageFormat::Jpeg) => {
            pixels > JPEG_PIXELS * length || Jpeg::of(bytes).is_some_and(|jpeg| !jpeg.is_whole)
        }
        Some(ImageFormat::Png) => {
            let bits = u64::from(decoder.original_color_type().bits_per_pixel());
            (pixels / 8).saturating_mul(bits) > PNG_BYTES * length
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jpeg() -> Vec<u8> {
        let mut bytes = Vec::new();
        let image = RgbImage::from_fn(64, 48, |x, y| image::Rgb([x as u8, y as u8, (x * y) as u8]));
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

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let image = RgbImage::from_fn(320, 200, |x, y| image::Rgb([x as u8, y as u8, 9]));
        assert!(image.write_to(&mut bytes, format).is_ok());
        bytes.into_inner()
    }

    /// A JPEG whose header says another size.
    fn promising(width: u16, height: u16) -> Vec<u8> {
        let mut bytes = encoded(ImageFormat::Jpeg);
        let frame = bytes.windows(2).position(|pair| pair == [0xFF, 0xC0]).unwrap_or_default();
        bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
        bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
        bytes
    }

    #[test]
    fn what_is_no_image_is_an_error() {
        assert!(matches!(decode(b"not an image"), Err(StillError::Broken(_))));
        assert!(matches!(decode(b""), Err(StillError::Broken(_))));
    }

    #[test]
    fn stills_are_decoded() {
        for format in [ImageFormat::Jpeg, ImageFormat::Png] {
            let bytes = encoded(format);
            assert!(size_of(&bytes).is_ok_and(|size| size == [320, 200]));
            assert!(decode(&bytes).is_ok_and(|image| image.dimensions() == (320, 200)));
        }
    }

    #[test]
    fn a_still_that_was_cut_is_said_to_be() {
        let bytes = encoded(ImageFormat::Jpeg);
        let cut = decode(&bytes[..bytes.len() / 2]);
        assert!(cut.is_err_and(|error| error.to_string().contains("truncated")));
        let bytes = encoded(ImageFormat::Png);
        assert!(decode(&bytes[..bytes.len() / 2]).is_err());
    }

    /// A PNG with a chunk before its pixels.
    fn with_chunk(kind: [u8; 4], data: &[u8]) -> Vec<u8> {
        let png = encoded(ImageFormat::Png);
        let (head, rest) = png.split_at(33);
        let mut chunk = kind.to_vec();
        chunk.extend(data);
        let mut sum = flate2::Crc::new();
        sum.update(&chunk);
        [head, &(data.len() as u32).to_be_bytes(), &chunk, &sum.sum().to_be_bytes(), rest].concat()
    }

    #[test]
    fn a_colour_profile_does_not_unpack_without_bound() {
        let profile = |bytes: usize| {
            let mut packed =
                flate2::write::ZlibEncoder::new(b"profile\0\0".to_vec(), flate2::Compression::fast());
            std::io::Write::write_all(&mut packed, &vec![0; bytes]).unwrap();
            with_chunk(*b"iCCP", &packed.finish().unwrap())
        };
        for (bytes, is_read) in [(1 << 20, true), (64 << 20, false)] {
            let png = profile(bytes);
            assert!(decode(&png).is_ok_and(|image| image.dimensions() == (320, 200)));
            let (mut decoder, _) = opened(&png).unwrap();
            assert_eq!(decoder.icc_profile().unwrap().is_some(), is_read);
        }
    }

    #[test]
    fn a_header_that_promises_more_than_the_bytes_hold_takes_no_memory() {
        let promise = decode(&promising(65_500, 65_500));
        assert!(matches!(promise, Err(StillError::CutShort { size: [65_500, 65_500], .. })), "{promise:?}");
        let mut png = encoded(ImageFormat::Png);
        png[16..24].copy_from_slice(&[0, 0, 0xFF, 0xFF, 0, 0, 0xFF, 0xFF]);
        // Its checksum no longer holds, or else its length.
        assert!(decode(&png).is_err());
    }
}
