//! Frames of a group of packets that starts with a key frame.

use image::{ImageFormat, RgbImage};
use rust_h264::decoder::OrderedDecoder;
use rust_h265::PixelData;

use crate::error::VideoError;
use crate::stream::Codec;

/// Largest number of pixels of a frame.
const MAX_PIXELS: u64 = 64_000_000;

/// Receiver of frames: gets the number of a frame in display order, and a function that converts it to an image.
pub(crate) type Show<'a> =
    dyn FnMut(usize, &dyn Fn() -> Result<RgbImage, VideoError>) -> Result<(), VideoError> + 'a;

/// Decodes a group of packets, and passes every frame to `show`. Damaged units of H.264 and H.265 are skipped.
pub(crate) fn decode(codec: &Codec, packets: &[Vec<u8>], show: &mut Show<'_>) -> Result<(), VideoError> {
    match codec {
        Codec::MotionJpeg => {
            for (index, packet) in packets.iter().enumerate() {
                show(index, &|| jpeg(packet))?;
            }
            Ok(())
        }
        Codec::H264(record) => h264(record.as_deref(), packets, show),
        Codec::H265(record) => h265(record.as_deref(), packets, show),
    }
}

fn jpeg(packet: &[u8]) -> Result<RgbImage, VideoError> {
    let mut reader = image::ImageReader::with_format(std::io::Cursor::new(packet), ImageFormat::Jpeg);
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(8 * MAX_PIXELS);
    reader.limits(limits);
    let image = reader.decode().map_err(|error| VideoError::Broken(error.to_string()))?;
    Ok(image.into_rgb8())
}

fn h264(record: Option<&[u8]>, packets: &[Vec<u8>], show: &mut Show<'_>) -> Result<(), VideoError> {
    use rust_h264::nal::{NalUnit, parse_annex_b, parse_avcc, parse_avcc_config};
    let config = record.map(parse_avcc_config).transpose();
    let config = config.map_err(|error| VideoError::Broken(error.into()))?;
    let mut decoder: OrderedDecoder = OrderedDecoder::new();
    let mut shown = 0;
    let mut show_all = |frames: Vec<rust_h264::decoder::Frame>| {
        for frame in frames {
            show(shown, &|| planes_of_h264(&frame).to_image())?;
            shown += 1;
        }
        Ok::<(), VideoError>(())
    };
    let units = |packet| match &config {
        Some(config) => parse_avcc(packet, config.length_size),
        None => parse_annex_b(packet),
    };
    let parameters = config.iter().flat_map(|config| config.sps_nals.iter().chain(&config.pps_nals));
    for unit in parameters {
        check_size(unit)?;
        show_all(decoder.decode_nal(unit).unwrap_or_default())?;
    }
    for packet in packets {
        let units: Vec<NalUnit<'_>> = units(packet);
        for unit in &units {
            check_size(unit)?;
            show_all(decoder.decode_nal(unit).unwrap_or_default())?;
        }
    }
    show_all(decoder.flush())
}

/// Checks the size of the frames in a parameter set, before the decoder allocates them.
fn check_size(unit: &rust_h264::nal::NalUnit<'_>) -> Result<(), VideoError> {
    let Ok(info) = rust_h264::nal::parse_sps_info(unit) else { return Ok(()) };
    let [w, h] = [info.coded_width, info.coded_height];
    if u64::from(w) * u64::from(h) > MAX_PIXELS { Err(VideoError::TooLarge([w, h])) } else { Ok(()) }
}

fn h265(record: Option<&[u8]>, packets: &[Vec<u8>], show: &mut Show<'_>) -> Result<(), VideoError> {
    use rust_h265::{DecodeLimits, Decoder, parse_annex_b, parse_hvcc, parse_nal};
    let mut decoder = Decoder::with_limits(DecodeLimits::default()).with_display_order();
    let mut shown = 0;
    let mut show_next = |frame: Option<rust_h265::Frame>| {
        let Some(frame) = frame else { return Ok::<bool, VideoError>(false) };
        show(shown, &|| planes_of_h265(&frame).to_image())?;
        shown += 1;
        Ok(true)
    };
    for unit in record.map(parameter_sets).unwrap_or_default() {
        if let Some(unit) = parse_nal(unit) {
            // A damaged parameter set makes the frames fail, which is reported then.
            let _ = decoder.decode_nal(&unit);
        }
    }
    // Byte 21 of the record contains the number of bytes of a length, minus 1, in its last two bits.
    let length_size = record.and_then(|record| record.get(21)).map(|byte| (byte & 3) + 1);
    for packet in packets {
        let units = match length_size {
            Some(size) => parse_hvcc(packet, size),
            None => parse_annex_b(packet),
        };
        for unit in units {
            let _ = decoder.decode_nal(&unit);
            while show_next(decoder.next_output())? {}
        }
    }
    while show_next(decoder.flush())? {}
    Ok(())
}

/// Returns the parameter sets of the record `hvcC` (ISO/IEC 14496-15): arrays of units with their lengths.
fn parameter_sets(record: &[u8]) -> Vec<&[u8]> {
    let mut found = Vec::new();
    let (mut at, arrays) = (23, record.get(22).copied().unwrap_or(0));
    let number = |at: usize| Some(usize::from(u16::from_be_bytes([*record.get(at)?, *record.get(at + 1)?])));
    for _ in 0..arrays {
        let Some(count) = number(at + 1) else { return found };
        at += 3;
        for _ in 0..count {
            let Some(unit) = number(at).and_then(|length| record.get(at + 2..at + 2 + length)) else {
                return found;
            };
            found.push(unit);
            at += 2 + unit.len();
        }
    }
    found
}

/// Luma and chroma planes of a frame, with samples of 8 bits.
struct Planes {
    size: [u32; 2],
    /// Luma (Y), then chroma (Cb and Cr).
    planes: [Vec<u8>; 3],
    /// Width and height of the chroma planes.
    colour_size: [u32; 2],
}

fn planes_of_h264(frame: &rust_h264::decoder::Frame) -> Planes {
    let to_bytes = |plane: &Vec<u8>| match frame.bytes_per_sample() {
        1 => plane.clone(),
        _ => plane
            .chunks_exact(2)
            .map(|two| (u16::from_le_bytes([two[0], two[1]]) >> frame.bit_depth.saturating_sub(8)) as u8)
            .collect(),
    };
    Planes {
        size: [frame.width, frame.height],
        planes: [&frame.y, &frame.u, &frame.v].map(to_bytes),
        colour_size: [frame.chroma_width(), frame.chroma_height()],
    }
}

fn planes_of_h265(frame: &rust_h265::Frame) -> Planes {
    let to_bytes = |plane: &PixelData| match plane {
        PixelData::U8(samples) => samples.clone(),
        PixelData::U16(samples) => {
            samples.iter().map(|sample| (sample >> frame.bit_depth.saturating_sub(8)) as u8).collect()
        }
    };
    let [w, h] = [frame.width, frame.height];
    let colour_size = if frame.chroma_format_idc == 3 { [w, h] } else { [w.div_ceil(2), h.div_ceil(2)] };
    Planes { size: [w, h], planes: [&frame.y, &frame.u, &frame.v].map(to_bytes), colour_size }
}

impl Planes {
    /// Converts the planes to RGB with BT.601, or with BT.709 for images of at least 720 rows. The samples have the
    /// usual limited range.
    fn to_image(&self) -> Result<RgbImage, VideoError> {
        /// Smallest height of images with the colours of BT.709, in pixels.
        const HIGH_DEFINITION: u32 = 720;
        let ([w, h], [cw, ch]) = (self.size, self.colour_size);
        if u64::from(w) * u64::from(h) > MAX_PIXELS {
            return Err(VideoError::TooLarge(self.size));
        }
        let [y, u, v] = &self.planes;
        let is_whole = y.len() >= w as usize * h as usize
            && [u, v].iter().all(|plane| plane.len() >= cw as usize * ch as usize);
        if !is_whole || w == 0 || h == 0 || cw == 0 || ch == 0 {
            return Err(VideoError::Broken("a frame is not complete".into()));
        }
        // Weights of red and blue in the luma.
        let [kr, kb] = if h >= HIGH_DEFINITION { [0.2126, 0.0722] } else { [0.299, 0.114_f32] };
        let by_red = [2.0 * (1.0 - kr), 2.0 * (1.0 - kr) * kr / (1.0 - kr - kb)];
        let by_blue = [2.0 * (1.0 - kb), 2.0 * (1.0 - kb) * kb / (1.0 - kr - kb)];
        Ok(RgbImage::from_fn(w, h, |column, row| {
            let colour = ((row * ch / h) * cw + column * cw / w) as usize;
            let bright = (f32::from(y[(row * w + column) as usize]) - 16.0) * (255.0 / 219.0);
            let [blue, red] =
                [u[colour], v[colour]].map(|value| (f32::from(value) - 128.0) * (255.0 / 224.0));
            let rgb = [
                bright + by_red[0] * red,
                bright - by_red[1] * red - by_blue[1] * blue,
                bright + by_blue[0] * blue,
            ];
            image::Rgb(rgb.map(|value| value.round().clamp(0.0, 255.0) as u8))
        }))
    }
}
