//! Reading of large TIFF images, such as orthophotos, with less memory than their pixels need.
//!
//! The strips or tiles are decoded one after the other. Each pixel of the picture is the mean of a square of pixels
//! of the file. The side of the square follows from the number of pixels of the file, so that pixel positions in a
//! site file mean the same place in every program.

use std::io::Cursor;

use image::RgbImage;
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use crate::drawing::{Drawing, DrawingFacts, DrawingKind, Picture};
use crate::error::PlanError;

/// Number of pixels above which a TIFF is read in parts.
const LARGE_PIXELS: u64 = 60_000_000;
/// Largest number of pixels of the picture.
const MAX_PICTURE_PIXELS: u64 = 40_000_000;
/// Largest number of pixels of the file.
const MAX_FILE_PIXELS: u64 = 4_000_000_000;
/// Largest size of a decoded strip or tile, in bytes.
const MAX_CHUNK_BYTES: usize = 256 << 20;

/// Reads a large TIFF; `None` for other files, and for TIFF images of usual size.
pub(crate) fn read(bytes: &[u8]) -> Option<Result<Drawing, PlanError>> {
    if !bytes.starts_with(b"II") && !bytes.starts_with(b"MM") {
        return None;
    }
    let limits = {
        let mut limits = Limits::default();
        limits.decoding_buffer_size = MAX_CHUNK_BYTES;
        limits.intermediate_buffer_size = MAX_CHUNK_BYTES;
        limits
    };
    let mut decoder = Decoder::new(Cursor::new(bytes)).ok()?.with_limits(limits);
    let (width, height) = decoder.dimensions().ok()?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels < LARGE_PIXELS {
        return None;
    }
    if pixels > MAX_FILE_PIXELS {
        let reason = format!("it has {width} x {height} pixels; save a smaller part");
        return Some(Err(PlanError::Limit { kind: "TIFF", reason }));
    }
    let reduction = (1..).find(|by| pixels.div_ceil(u64::from(by * by)) <= MAX_PICTURE_PIXELS)?;
    Some(reduced(&mut decoder, [width, height], reduction).map(|image| Drawing {
        facts: DrawingFacts {
            reduction,
            notes: vec![format!(
                "The image has {width} \u{d7} {height} pixels. Each shown pixel is the mean of {reduction} \u{d7} {reduction} pixels."
            )],
            ..DrawingFacts::new(DrawingKind::LargeTiff, image.dimensions().into())
        },
        picture: Picture::Pixels(image),
    }))
}

/// Decodes the image with every side divided by `by`.
fn reduced(
    decoder: &mut Decoder<Cursor<&[u8]>>,
    [width, height]: [u32; 2],
    by: u32,
) -> Result<RgbImage, PlanError> {
    let damaged = |error: tiff::TiffError| PlanError::Damaged { kind: "TIFF", reason: error.to_string() };
    let unsupported = |what: &str| {
        PlanError::Unsupported(format!("this large TIFF has {what}; save it as 8-bit RGB or grey, in tiles"))
    };
    let samples = match decoder.colortype().map_err(damaged)? {
        ColorType::Gray(8) => 1,
        ColorType::RGB(8) | ColorType::YCbCr(8) => 3,
        ColorType::RGBA(8) => 4,
        _ => return Err(unsupported("an unsupported colour format")),
    };
    let is_separate = decoder
        .find_tag_unsigned::<u16>(Tag::PlanarConfiguration)
        .map_err(damaged)?
        .is_some_and(|planes| planes == 2);
    if is_separate {
        return Err(unsupported("separate colour planes"));
    }
    let (chunk_width, chunk_height) = decoder.chunk_dimensions();
    if chunk_width == 0 || chunk_height == 0 {
        return Err(unsupported("empty tiles"));
    }
    let across = width.div_ceil(chunk_width);
    let (columns, rows) = (width.div_ceil(by), height.div_ceil(by));
    let mut sums = vec![[0_u32; 4]; columns as usize * rows as usize];
    for chunk in 0..across * height.div_ceil(chunk_height) {
        let DecodingResult::U8(pixels) = decoder.read_chunk(chunk).map_err(damaged)? else {
            return Err(unsupported("an unsupported colour format"));
        };
        let (data_width, _) = decoder.chunk_data_dimensions(chunk);
        let (left, top) = (chunk % across * chunk_width, chunk / across * chunk_height);
        for (index, pixel) in pixels.chunks_exact(samples).enumerate() {
            let index = index as u32;
            let (x, y) = (left + index % data_width.max(1), top + index / data_width.max(1));
            if x >= width || y >= height {
                continue;
            }
            let sum = &mut sums[(y / by) as usize * columns as usize + (x / by) as usize];
            let rgb = if samples == 1 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
            (0..3).for_each(|k| sum[k] += u32::from(rgb[k]));
            sum[3] += 1;
        }
    }
    let mean = |[r, g, b, count]: [u32; 4]| [r, g, b].map(|sum| (sum / count.max(1)) as u8);
    Ok(RgbImage::from_fn(columns, rows, |x, y| {
        image::Rgb(mean(sums[y as usize * columns as usize + x as usize]))
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test that fails may panic")]
mod tests {
    use tiff::encoder::{TiffEncoder, colortype::RGB8};

    use super::*;

    /// Returns a TIFF with a colour that changes with the position.
    fn tiff(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        let data: Vec<u8> = (0..height)
            .flat_map(|y| (0..width).flat_map(move |x| [(x / 64) as u8, (y / 64) as u8, 200]))
            .collect();
        encoder.write_image::<RGB8>(width, height, &data).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn large_images_are_reduced_and_small_ones_are_left() {
        assert!(read(&tiff(600, 400)).is_none());
        assert!(read(b"II*\0").is_none());
        let drawing = read(&tiff(10_000, 7_001)).unwrap().unwrap();
        assert_eq!((drawing.facts.size, drawing.facts.reduction), ([5_000, 3_501], 2));
        let image = drawing.into_image().unwrap();
        // The mean of a square of pixels within one colour.
        assert_eq!(image.get_pixel(4_000, 1_000).0, [(8_000 / 64) as u8, (2_000 / 64) as u8, 200]);
        let cut = &tiff(10_000, 7_001)[..1_000_000];
        assert!(read(cut).is_none_or(|read| read.is_err()));
    }
}
