//! Image decoding to RGB pixels within memory limits, and a check of JPEG markers without decoding. A size in
//! the header is accepted only if the number of bytes is plausible for it.
//!
//! Images with 16 bits per channel, for example from thermal cameras, often use a small part of the possible
//! values. They are stretched to 8 bits: the darkest thousandth of the values becomes black, and the brightest
//! thousandth becomes white.

use std::fmt;
use std::io::Cursor;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Rgb, RgbImage};

use crate::clock;
use crate::file::{OutOfMemory, allocate, check_memory};

/// First bytes of a JPEG: the marker of the start of the image.
const START: [u8; 2] = [0xFF, 0xD8];
/// Marker of the end of a JPEG.
const END: u8 = 0xD9;
/// Marker before the data of a scan.
const START_OF_SCAN: u8 = 0xDA;
/// Marker of a progressive frame, whose coefficients stay in memory until the last scan.
const PROGRESSIVE: u8 = 0xC2;

/// Properties of a JPEG from its markers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct JpegInfo {
    /// Whether the end marker exists; decoders fill missing data with grey.
    pub(crate) is_whole: bool,
    /// Whether the JPEG is progressive.
    pub(crate) is_progressive: bool,
}

impl JpegInfo {
    /// Reads the markers; `None` if the data is not a JPEG.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        bytes.starts_with(&START).then(|| Self::default().read_markers(bytes))
    }

    /// Reads all markers, skipping the segments and the data of scans (ITU T.81, annex B).
    fn read_markers(mut self, bytes: &[u8]) -> Self {
        let mut at = START.len();
        while let Some((marker, after)) = next_marker(bytes, at) {
            match marker {
                END => return Self { is_whole: true, ..self },
                // Markers without a segment: restarts, and one for private use.
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

/// Returns the first marker at or after an offset, and the offset after it.
fn next_marker(bytes: &[u8], from: usize) -> Option<(u8, usize)> {
    let start = from + bytes.get(from..)?.iter().position(|&byte| byte == 0xFF)?;
    let fill = bytes[start..].iter().take_while(|&&byte| byte == 0xFF).count();
    Some((*bytes.get(start + fill)?, start + fill + 1))
}

/// Returns the end of a scan's data. Inside the data, 0xFF 0x00 encodes 0xFF, and restart markers may occur.
fn end_of_scan(bytes: &[u8], from: usize) -> usize {
    let rest = bytes.get(from..).unwrap_or_default();
    let ends = |pair: &[u8]| pair[0] == 0xFF && !matches!(pair[1], 0x00 | 0xD0..=0xD7 | 0xFF);
    from + rest.windows(2).position(ends).unwrap_or(rest.len())
}

/// Whether memory is small: a browser has at most 4 GB, and a phone less.
const IS_MEMORY_SMALL: bool = cfg!(target_pointer_width = "32");
/// Maximum memory for decoding one image, in bytes.
const MAX_DECODE_BYTES: u64 = if IS_MEMORY_SMALL { 1 << 28 } else { 1 << 30 };
/// Maximum memory for metadata, such as a colour profile or texts, and for one row, in bytes.
const MAX_METADATA_BYTES: u64 = 32 << 20;
/// Maximum number of pixels per byte of a JPEG: a block of 64 pixels needs at least one bit in a progressive
/// JPEG.
const MAX_PIXELS_PER_JPEG_BYTE: u64 = 512;
/// Maximum number of decoded bytes per byte of a PNG, limited by deflate.
const MAX_BYTES_PER_PNG_BYTE: u64 = 1032;
/// Maximum number of pixels per byte of an image in another format.
const MAX_PIXELS_PER_BYTE: u64 = 1 << 16;
/// Memory of a coefficient of a progressive JPEG, in bytes.
const COEFFICIENT_BYTES: u64 = 2;
/// Memory for decoding an HEIC image, in bytes per pixel: planes of 16 bits, and the image before and after its
/// rotation.
const HEIC_BYTES_PER_PIXEL: u64 = 12;

/// Reason why an image is not decoded.
#[derive(Debug)]
pub enum ImageFileError {
    /// Data that is not an image, or is damaged.
    Broken(ImageError),
    /// File of a known format that cannot be read.
    Unsupported {
        /// Name of the format.
        format: &'static str,
        /// Advice for the operator.
        advice: &'static str,
    },
    /// Truncated image.
    Truncated {
        /// Width and height in the header, in pixels.
        size: [u32; 2],
        /// Number of bytes of the data.
        bytes: usize,
    },
    /// Image that exceeds the memory limit.
    TooLarge {
        /// Width and height, in pixels.
        size: [u32; 2],
        /// Memory needed for decoding, in bytes.
        bytes: u64,
    },
    /// Image that does not fit in memory.
    Memory(OutOfMemory),
}

impl fmt::Display for ImageFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Broken(ImageError::Limits(_)) => write!(
                f,
                "the metadata of the image, such as its colour profile, exceeds {} MiB; save the image \
                 without metadata",
                MAX_METADATA_BYTES >> 20
            ),
            Self::Broken(error) => write!(f, "not a complete image: {error}"),
            Self::Unsupported { format, advice } => {
                write!(f, "this is {format}, which cannot be read here; {advice}")
            }
            Self::Truncated { size: [w, h], bytes } => write!(
                f,
                "the image is truncated: its header states {w} x {h} pixels, but the file has only {bytes} \
                 bytes; copy it again from its source"
            ),
            Self::TooLarge { size: [w, h], bytes } => write!(
                f,
                "decoding an image of {w} x {h} pixels needs {} MiB, more than the limit of {} MiB; scale it \
                 down",
                bytes >> 20,
                MAX_DECODE_BYTES >> 20
            ),
            Self::Memory(error) => write!(f, "the image {error}"),
        }
    }
}

impl std::error::Error for ImageFileError {}

impl From<ImageError> for ImageFileError {
    fn from(error: ImageError) -> Self {
        Self::Broken(error)
    }
}

/// Returns the width and height of an image after EXIF rotation, from its header. Also checks that the image
/// is complete.
///
/// # Errors
///
/// Fails if the data is not an image, or is truncated.
pub fn image_size(bytes: &[u8]) -> Result<[u32; 2], ImageFileError> {
    let (decoder, orientation) = open_decoder(bytes)?;
    let (width, height) = decoder.dimensions();
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    let is_on_its_side = matches!(orientation, Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH);
    Ok(if is_on_its_side { [height, width] } else { [width, height] })
}

/// Returns the capture time of an image from its EXIF data (RFC 3339), if available; a time without a zone is
/// taken as UTC.
#[must_use]
pub fn capture_time(bytes: &[u8]) -> Option<String> {
    let (mut decoder, _) = open_decoder(bytes).ok()?;
    clock::capture_time(decoder.exif_metadata().ok()??)
}

/// Checks the limits of [`decode`] for an image that another decoder decodes, which needs `more_per_pixel`
/// additional bytes per pixel. Nothing is decoded.
///
/// # Errors
///
/// Fails if the data is not an image, is truncated, or is too large.
pub fn check_decode_memory(bytes: &[u8], more_per_pixel: u64) -> Result<(), ImageFileError> {
    check_decoder_memory(&open_decoder(bytes)?.0, bytes, more_per_pixel)
}

/// Refuses an image whose decoding needs more memory than the limit, or more than is available.
/// `more_per_pixel` is additional memory, in bytes per pixel.
fn check_decoder_memory(
    decoder: &impl ImageDecoder,
    bytes: &[u8],
    more_per_pixel: u64,
) -> Result<(), ImageFileError> {
    let (width, height) = decoder.dimensions();
    let more = (u64::from(width) * u64::from(height)).saturating_mul(more_per_pixel);
    let needed = decode_memory(decoder, bytes).saturating_add(more);
    if needed > MAX_DECODE_BYTES {
        return Err(ImageFileError::TooLarge { size: [width, height], bytes: needed });
    }
    check_memory(needed).map_err(ImageFileError::Memory)
}

/// Decodes an image to RGB pixels, rotated according to its EXIF data.
///
/// # Errors
///
/// Fails if the data is not an image, is truncated, or is too large.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, ImageFileError> {
    let (decoder, orientation) = open_decoder(bytes)?;
    check_decoder_memory(&decoder, bytes, 0)?;
    let mut image = pixels(decoder)?;
    image.apply_orientation(orientation);
    Ok(match image {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => stretch(&image.into_rgb16()),
        image => image.into_rgb8(),
    })
}

/// Converts an image of 16 bits per channel to 8 bits. All channels are stretched alike.
fn stretch(image: &image::ImageBuffer<Rgb<u16>, Vec<u16>>) -> RgbImage {
    /// Share of the values that become black, and that become white.
    const CLIPPED: f64 = 0.001;
    let mut counts = vec![0_u64; 1 << 16];
    image.as_raw().iter().for_each(|&value| counts[usize::from(value)] += 1);
    let clipped = (CLIPPED * image.as_raw().len() as f64) as u64;
    let bound = |mut values: Box<dyn Iterator<Item = usize>>| {
        let mut below = 0;
        values.find(|&value| {
            below += counts[value];
            below > clipped
        })
    };
    let low = bound(Box::new(0..counts.len())).unwrap_or(0);
    let high = bound(Box::new((0..counts.len()).rev())).unwrap_or(counts.len() - 1);
    let range = high.saturating_sub(low).max(1) as f64;
    let to_8_bits: Vec<u8> = (0..counts.len())
        .map(|value| (255.0 * (value as f64 - low as f64) / range).round().clamp(0.0, 255.0) as u8)
        .collect();
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        Rgb(image.get_pixel(x, y).0.map(|value| to_8_bits[usize::from(value)]))
    })
}

/// Name of all video formats in messages.
const VIDEO: &str = "a video";

/// Returns the brand of an ISO media file, such as an HEIC image or an MP4 video.
fn brand(bytes: &[u8]) -> Option<&[u8]> {
    bytes.get(4..12).and_then(|head| head.strip_prefix(b"ftyp"))
}

/// Whether a file is an HEIC image, by its first bytes.
fn is_heic(bytes: &[u8]) -> bool {
    matches!(brand(bytes), Some(b"heic" | b"heix" | b"hevc" | b"heim" | b"heis" | b"mif1" | b"msf1"))
}

/// Returns the name of a format that is not read, and advice, from the first bytes.
fn unsupported(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    const SAVE: &str = "save it as JPEG or PNG";
    const FRAME: &str = "save one frame of it, for example with `calib still VIDEO -o still.png`";
    match (bytes, brand(bytes)) {
        _ if is_heic(bytes) && cfg!(feature = "heic") => None,
        _ if is_heic(bytes) => Some((
            "an HEIC image",
            "save it as JPEG (on an iPhone: Settings, Camera, Formats, Most Compatible)",
        )),
        (_, Some(b"avif" | b"avis")) => Some(("an AVIF image", SAVE)),
        (_, Some(_)) => Some((VIDEO, FRAME)),
        // QuickTime files without a brand. The first byte of a text is above 0x1F.
        (
            [0..=0x1F, _, _, _, b'm', b'o', b'o', b'v', ..]
            | [0..=0x1F, _, _, _, b'm', b'd', b'a', b't', ..]
            | [0..=0x1F, _, _, _, b'w', b'i', b'd', b'e', ..],
            _,
        ) => Some((VIDEO, FRAME)),
        ([0x1A, 0x45, 0xDF, 0xA3, ..], _) => Some((VIDEO, FRAME)),
        ([b'R', b'I', b'F', b'F', _, _, _, _, b'A', b'V', b'I', ..], _) => Some((VIDEO, FRAME)),
        ([0xFF, 0x0A, ..] | [0, 0, 0, 0x0C, b'J', b'X', b'L', ..], _) => Some(("a JPEG XL image", SAVE)),
        ([0, 0, 0, 0x0C, b'j', b'P', ..], _) => Some(("a JPEG 2000 image", SAVE)),
        ([b'8', b'B', b'P', b'S', ..], _) => Some(("a Photoshop image", SAVE)),
        ([b'%', b'P', b'D', b'F', ..], _) => Some(("a PDF document", SAVE)),
        _ => match image::guess_format(bytes).ok()? {
            format if format.reading_enabled() => None,
            ImageFormat::WebP => Some(("a WebP image", SAVE)),
            ImageFormat::Tiff => Some(("a TIFF image", SAVE)),
            ImageFormat::Bmp => Some(("a BMP image", SAVE)),
            ImageFormat::Gif => Some(("a GIF image", SAVE)),
            _ => Some(("an image in another format", SAVE)),
        },
    }
}

/// File name endings of videos, in lower case.
pub const VIDEO_ENDINGS: [&str; 6] = ["mp4", "m4v", "mov", "mkv", "webm", "avi"];

/// Whether a file is a video, by its first bytes.
#[must_use]
pub fn is_video(head: &[u8]) -> bool {
    unsupported(head).is_some_and(|(format, _)| format == VIDEO)
}

/// Whether a file is an image or a video, by its first bytes. Formats that cannot be read are included; [`refusal`]
/// returns the reason.
#[must_use]
pub fn is_image_or_video(head: &[u8]) -> bool {
    // Some formats begin with two letters, and so do many tables.
    let is_text = head.iter().take(512).all(|byte| *byte >= b' ' || byte.is_ascii_whitespace());
    let is_unsupported = unsupported(head).is_some_and(|_| !head.starts_with(b"%PDF"));
    !is_text && (image::guess_format(head).is_ok() || is_heic(head) || is_unsupported)
}

/// Returns the reason why an image or video cannot be read, from its first bytes: the name of its format, and
/// advice.
#[must_use]
pub fn refusal(head: &[u8]) -> Option<ImageFileError> {
    unsupported(head).map(|(format, advice)| ImageFileError::Unsupported { format, advice })
}

/// Returns the file name endings of the images that can be read, in lower case.
pub fn image_endings() -> impl Iterator<Item = &'static str> {
    const ENDINGS: [(&str, ImageFormat); 8] = [
        ("png", ImageFormat::Png),
        ("jpg", ImageFormat::Jpeg),
        ("jpeg", ImageFormat::Jpeg),
        ("webp", ImageFormat::WebP),
        ("tif", ImageFormat::Tiff),
        ("tiff", ImageFormat::Tiff),
        ("bmp", ImageFormat::Bmp),
        ("gif", ImageFormat::Gif),
    ];
    let heic = if cfg!(feature = "heic") { &["heic", "heif"][..] } else { &[] };
    let read = ENDINGS.into_iter().filter(|(_, format)| format.reading_enabled()).map(|(ending, _)| ending);
    read.chain(heic.iter().copied())
}

fn pixels(decoder: impl ImageDecoder) -> Result<DynamicImage, ImageFileError> {
    let (width, height) = decoder.dimensions();
    if decoder.color_type() != image::ColorType::Rgb8 {
        return Ok(DynamicImage::from_decoder(decoder)?);
    }
    let bytes = decoder.total_bytes();
    let mut buffer = allocate(bytes).map_err(ImageFileError::Memory)?;
    // The buffer has exactly this capacity.
    buffer.resize(bytes as usize, 0);
    decoder.read_image(&mut buffer)?;
    let image = RgbImage::from_raw(width, height, buffer);
    image.map(DynamicImage::ImageRgb8).ok_or(ImageFileError::TooLarge { size: [width, height], bytes })
}

/// Returns the memory for decoding, in bytes: the stored pixels, the RGB pixels, the coefficients of a
/// progressive JPEG, and the planes of an HEIC image.
fn decode_memory(decoder: &impl ImageDecoder, bytes: &[u8]) -> u64 {
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    let rgb = match decoder.color_type() {
        image::ColorType::Rgb8 => 0,
        image::ColorType::L8 | image::ColorType::La8 | image::ColorType::Rgba8 => 3 * pixels,
        // The three channels of 16 bits, and of 8 bits.
        _ => 9 * pixels,
    };
    let is_progressive = JpegInfo::from_bytes(bytes).is_some_and(|jpeg| jpeg.is_progressive);
    let kept = match () {
        () if is_progressive => 3 * COEFFICIENT_BYTES * pixels,
        () if is_heic(bytes) => HEIC_BYTES_PER_PIXEL * pixels,
        () => 0,
    };
    decoder.total_bytes().saturating_add(rgb).saturating_add(kept)
}

fn open_decoder(bytes: &[u8]) -> Result<(Box<dyn ImageDecoder + '_>, Orientation), ImageFileError> {
    if let Some(error) = refusal(bytes) {
        return Err(error);
    }
    #[cfg(feature = "heic")]
    if is_heic(bytes) {
        let decoder = crate::heic::HeicDecoder::new(bytes)?;
        if is_truncated(&decoder, None, bytes) {
            return Err(ImageFileError::Truncated { size: decoder.dimensions().into(), bytes: bytes.len() });
        }
        return Ok((Box::new(decoder), Orientation::NoTransforms));
    }
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(ImageError::from)?;
    // This limit applies to metadata, which the library reads with the header. The memory for pixels is
    // checked before they are decoded.
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_METADATA_BYTES);
    reader.limits(limits);
    let format = reader.format();
    let mut decoder = reader.into_decoder()?;
    if is_truncated(&decoder, format, bytes) {
        return Err(ImageFileError::Truncated { size: decoder.dimensions().into(), bytes: bytes.len() });
    }
    let orientation = decoder.orientation()?;
    Ok((Box::new(decoder), orientation))
}

/// Whether the data ends too early, or is too short for any image of this size.
fn is_truncated(decoder: &impl ImageDecoder, format: Option<ImageFormat>, bytes: &[u8]) -> bool {
    let (width, height) = decoder.dimensions();
    let (pixels, length) = (u64::from(width) * u64::from(height), bytes.len() as u64);
    match format {
        Some(ImageFormat::Jpeg) => {
            pixels > MAX_PIXELS_PER_JPEG_BYTE * length
                || JpegInfo::from_bytes(bytes).is_some_and(|jpeg| !jpeg.is_whole)
        }
        Some(ImageFormat::Png) => {
            let bits = u64::from(decoder.original_color_type().bits_per_pixel());
            (pixels / 8).saturating_mul(bits) > MAX_BYTES_PER_PNG_BYTE * length
        }
        _ => pixels > MAX_PIXELS_PER_BYTE * length,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jpeg() -> Vec<u8> {
        let mut bytes = Vec::new();
        let image = RgbImage::from_fn(64, 48, |x, y| Rgb([x as u8, y as u8, (x * y) as u8]));
        let encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
        assert!(image.write_with_encoder(encoder).is_ok());
        bytes
    }

    #[test]
    fn truncated_jpeg_is_not_whole() {
        let whole = jpeg();
        assert_eq!(JpegInfo::from_bytes(&whole), Some(JpegInfo { is_whole: true, is_progressive: false }));
        for length in 2..whole.len() {
            assert_eq!(
                JpegInfo::from_bytes(&whole[..length]).map(|jpeg| jpeg.is_whole),
                Some(false),
                "{length} bytes"
            );
        }
    }

    #[test]
    fn a_thumbnail_in_a_segment_does_not_end_the_jpeg() {
        let mut bytes = jpeg();
        let thumbnail = jpeg();
        let length = u16::try_from(thumbnail.len() + 2).unwrap_or_default().to_be_bytes();
        bytes.splice(2..2, [0xFF, 0xE1, length[0], length[1]].into_iter().chain(thumbnail));
        assert!(JpegInfo::from_bytes(&bytes).is_some_and(|jpeg| jpeg.is_whole));
        bytes.truncate(bytes.len() - 2);
        assert!(JpegInfo::from_bytes(&bytes).is_some_and(|jpeg| !jpeg.is_whole));
    }

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let image = RgbImage::from_fn(320, 200, |x, y| Rgb([x as u8, y as u8, 9]));
        assert!(image.write_to(&mut bytes, format).is_ok());
        bytes.into_inner()
    }

    /// Builds a JPEG with a wrong size in its header.
    fn with_size_in_header(width: u16, height: u16) -> Vec<u8> {
        let mut bytes = encoded(ImageFormat::Jpeg);
        let frame = bytes.windows(2).position(|pair| pair == [0xFF, 0xC0]).unwrap_or_default();
        bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
        bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
        bytes
    }

    #[test]
    fn invalid_image_is_an_error() {
        assert!(matches!(decode(b"not an image"), Err(ImageFileError::Broken(_))));
        assert!(matches!(decode(b""), Err(ImageFileError::Broken(_))));
    }

    #[test]
    fn narrow_range_of_16_bits_is_stretched() {
        // A thermal image: values from 29,000 to 30,024, and one hot pixel.
        let thermal = image::ImageBuffer::from_fn(64, 64, |x, y| {
            image::Luma([if (x, y) == (0, 0) { u16::MAX } else { 29_000 + 16 * x as u16 }])
        });
        let mut bytes = Cursor::new(Vec::new());
        DynamicImage::ImageLuma16(thermal).write_to(&mut bytes, ImageFormat::Png).unwrap();
        let found = decode(&bytes.into_inner()).unwrap();
        let row: Vec<u8> = (0..64).map(|x| found.get_pixel(x, 9).0[0]).collect();
        assert_eq!((row[0], row[63]), (0, 255));
        assert!(row.windows(2).all(|pair| (3..=5).contains(&(pair[1] - pair[0]))), "{row:?}");
    }

    #[test]
    fn files_of_other_formats_are_named_with_a_way_out() {
        let named = |bytes: &[u8], name: &str| {
            let text = decode(bytes).unwrap_err().to_string();
            assert!(text.contains(name) && text.contains("save"), "{text}");
        };
        if cfg!(not(feature = "heic")) {
            named(b"\0\0\0\x18ftypheic\0\0\0\0", "HEIC");
        }
        named(b"\0\0\0\x1cftypavif\0\0\0\0", "AVIF");
        named(b"\0\0\0\x20ftypisom\0\0\0\0", "video");
        named(b"%PDF-1.7\n", "PDF");
        named(b"\0\0\0\x0cJXL \r\n", "JPEG XL");
    }

    #[test]
    fn images_are_decoded() {
        for format in [
            ImageFormat::Jpeg,
            ImageFormat::Png,
            ImageFormat::WebP,
            ImageFormat::Tiff,
            ImageFormat::Bmp,
            ImageFormat::Gif,
        ] {
            let bytes = encoded(format);
            assert!(image_size(&bytes).is_ok_and(|size| size == [320, 200]));
            assert!(decode(&bytes).is_ok_and(|image| image.dimensions() == (320, 200)));
        }
    }

    #[test]
    fn truncated_image_is_reported() {
        let bytes = encoded(ImageFormat::Jpeg);
        let cut = decode(&bytes[..bytes.len() / 2]);
        assert!(cut.is_err_and(|error| error.to_string().contains("truncated")));
        let bytes = encoded(ImageFormat::Png);
        assert!(decode(&bytes[..bytes.len() / 2]).is_err());
    }

    /// Builds a PNG with an additional chunk before its pixels.
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
    fn colour_profile_decompression_is_limited() {
        let profile = |bytes: usize| {
            let mut packed =
                flate2::write::ZlibEncoder::new(b"profile\0\0".to_vec(), flate2::Compression::fast());
            std::io::Write::write_all(&mut packed, &vec![0; bytes]).unwrap();
            with_chunk(*b"iCCP", &packed.finish().unwrap())
        };
        for (bytes, is_read) in [(1 << 20, true), (64 << 20, false)] {
            let png = profile(bytes);
            assert!(decode(&png).is_ok_and(|image| image.dimensions() == (320, 200)));
            let (mut decoder, _) = open_decoder(&png).unwrap();
            assert_eq!(decoder.icc_profile().unwrap().is_some(), is_read);
        }
    }

    #[test]
    fn implausible_header_allocates_no_memory() {
        let promise = decode(&with_size_in_header(65_500, 65_500));
        assert!(
            matches!(promise, Err(ImageFileError::Truncated { size: [65_500, 65_500], .. })),
            "{promise:?}"
        );
        let mut png = encoded(ImageFormat::Png);
        png[16..24].copy_from_slice(&[0, 0, 0xFF, 0xFF, 0, 0, 0xFF, 0xFF]);
        // The checksum and the length of the chunk are now wrong.
        assert!(decode(&png).is_err());
    }
}
