//! Map from an undistorted image to the raw image, for NumPy and OpenCV.

use calib_core::{Distortion, Pixel, UndistortedPixel};

use crate::export::Export;
use crate::file::File;
use crate::view::View;

/// Largest number of pixels of an image for which a map is written.
const MAX_PIXELS: u64 = 64 << 20;

/// Writes the undistortion map `<camera>.remap.npy`, for
/// `cv2.remap(raw, numpy.load(file), None, cv2.INTER_LINEAR)`.
///
/// Float32, height x width x 2 (x, y), counted from the centre of the first pixel as in OpenCV; -1 outside
/// the lens. Focal length and principal point stay the same.
pub(crate) fn write(view: &View, export: &mut Export) {
    if view.raw_lens.distortion == Distortion::None {
        export.notes.push(format!("camera {:?} has no distortion, so it needs no remap file", view.id));
        return;
    }
    let [width, height] = view.size;
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        export.add_loss(
            view,
            format!("its remap file: {width} x {height} pixels exceed the limit of {MAX_PIXELS}"),
        );
        return;
    }
    let [sx, sy] = view.scale;
    let bytes = remap_npy(view.size, |pixel| {
        let straight = UndistortedPixel { u: pixel.u / sx, v: pixel.v / sy };
        view.raw_lens.distort(straight).map(|pixel| view.in_stream(pixel))
    });
    export.files.push(File { name: format!("{}.remap.npy", view.file), bytes });
}

/// Returns the map of a new image of this width and height, in pixels, as an NPY file for
/// `cv2.remap(raw, numpy.load(file), None, cv2.INTER_LINEAR)`. `raw_of` returns the raw pixel for a pixel of
/// the new image; both count from the corner of their image.
///
/// Float32, height x width x 2 (x, y), counted from the centre of the first pixel as in OpenCV; -1 if
/// `raw_of` returns `None`.
pub fn remap_npy([width, height]: [u32; 2], raw_of: impl Fn(Pixel) -> Option<Pixel>) -> Vec<u8> {
    let mut bytes = header(width, height);
    bytes.reserve(width as usize * height as usize * 8);
    for row in 0..height {
        for column in 0..width {
            let raw = raw_of(Pixel::new(f64::from(column) + 0.5, f64::from(row) + 0.5));
            let [x, y] = raw.map_or([-1.0, -1.0], |pixel| [pixel.u - 0.5, pixel.v - 0.5]);
            bytes.extend((x as f32).to_le_bytes());
            bytes.extend((y as f32).to_le_bytes());
        }
    }
    bytes
}

/// Returns the header of NPY version 1.0, padded so that the data begin at a multiple of 64 bytes.
fn header(width: u32, height: u32) -> Vec<u8> {
    let mut text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}, 2), }}");
    while (10 + text.len() + 1) % 64 != 0 {
        text.push(' ');
    }
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes
}
