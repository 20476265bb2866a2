//! Undistortion of images: a map from every pixel of the undistorted image to the raw image. It is computed
//! once and applied to any number of images of a camera or a stream.

use std::fmt;

use wide::{i16x8, u8x16, u16x8};

use crate::camera::{BrownConrady, Distortion, Lens, Pixel, UndistortedPixel, dispatch};
use crate::floor::camera_view::CameraView;
use crate::floor::stream::named;

/// Part of the undistorted plane that the new image shows. The new image has the size of the raw image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Crop {
    /// Same focal length: the centre keeps its scale.
    #[default]
    SameFocal,
    /// Largest view without blank pixels.
    AllValid,
    /// Every pixel of the raw image; the rest is blank.
    AllPixels,
}

named! { Crop { SameFocal = "same-focal", AllValid = "all-valid", AllPixels = "all-pixels" } }

/// Number of steps of a bilinear weight for each pixel: 1/32 of a pixel is sufficient for 8-bit colours.
const WEIGHT_STEPS: f32 = 32.0;
/// Number of bits of a bilinear weight: the binary logarithm of [`WEIGHT_STEPS`].
const WEIGHT_BITS: u32 = 5;
/// Index value of the pixels of the new image that the raw image does not show.
const BLANK_INDEX: u32 = u32::MAX;

/// Undistortion of the images of a lens, for one part of the undistorted plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undistortion {
    lens: Lens,
    width: usize,
    height: usize,
    /// Scale and offset of the new image: undistorted pixel = offset + scale * pixel of the new image.
    scale: f64,
    offset: [f64; 2],
    /// Largest squared radius of undistorted, normalised coordinates that the lens shows.
    most: f64,
}

/// Stored map from a new image to the raw image, for many images of one camera. An [`Undistortion`] or a
/// window of a lens creates the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Remap {
    /// Width of the raw image, in pixels.
    width: usize,
    /// Number of pixels of the raw image.
    pixels: usize,
    rows: MapRows,
}

/// Map of the pixels of the new image, row by row. It contains the index of the raw pixel up and left of the
/// raw position, and the weights in x and y.
#[derive(Clone, Debug, PartialEq)]
struct MapRows {
    /// Index of the raw pixel up and left of the raw position, or [`BLANK_INDEX`].
    index: Vec<u32>,
    /// Weight in x in the low byte, weight in y in the high byte.
    fraction: Vec<u16>,
}

impl MapRows {
    fn new(pixels: usize) -> Self {
        Self { index: vec![0; pixels], fraction: vec![0; pixels] }
    }
}

/// Colour channels of an image; the value is the number of bytes for each pixel.
#[derive(Clone, Copy, Debug)]
enum Channels {
    Grey = 1,
    Rgb = 3,
    Rgba = 4,
}

impl Channels {
    /// Returns the channels of an image with the given number of pixels; `None` if the length of `raw` does
    /// not match.
    fn of(raw: &[u8], pixels: usize) -> Option<Self> {
        [Self::Grey, Self::Rgb, Self::Rgba].into_iter().find(|own| raw.len() == pixels * *own as usize)
    }

    /// Computes the pixels of the new image `out` that are in the map, from the raw image.
    fn apply(self, raw: &[u8], width: usize, map: &MapRows, out: &mut [u8]) {
        let stride = width * self as usize;
        match self {
            Self::Grey => apply_rows::<1>(raw, stride, map, out),
            Self::Rgb => apply_rows::<3>(raw, stride, map, out),
            Self::Rgba => apply_rows::<4>(raw, stride, map, out),
        }
    }
}

impl Undistortion {
    /// Prepares the undistortion of raw images of `width` x `height` pixels. The new image has the same size.
    ///
    /// Returns `None` for images of fewer than 2 x 2 pixels, and of 1.4 gigapixels and more. Crops other than
    /// [`Crop::SameFocal`] need the sides of the raw image. For them, also returns `None` if the sides cannot
    /// be undistorted, as around an image circle.
    #[must_use]
    pub fn new(lens: &Lens, width: usize, height: usize, crop: Crop) -> Option<Self> {
        let bytes = width.checked_mul(height)?.checked_mul(3)?;
        if width < 2 || height < 2 || bytes >= BLANK_INDEX as usize {
            return None;
        }
        let (scale, offset) = view(lens, [width as f64, height as f64], crop)?;
        let most = lens.distortion.max_radius().powi(2);
        Some(Self { lens: *lens, width, height, scale, offset, most })
    }

    /// Returns the focal length of the new image, in pixels. `focal` is the focal length of the raw image.
    #[must_use]
    pub fn focal(&self, focal: f64) -> f64 {
        focal / self.scale
    }

    /// Returns the principal point of the new image, in pixels from its corner.
    #[must_use]
    pub fn principal_point(&self) -> Pixel {
        let Pixel { u, v } = self.lens.principal_point;
        Pixel { u: (u - self.offset[0]) / self.scale, v: (v - self.offset[1]) / self.scale }
    }

    /// Undistorts an image with 8 bits per channel, stored row by row: grey, RGB or RGBA, in any order of
    /// colours. Pixels that the raw image does not show become black, or transparent.
    ///
    /// Returns `None` if the slice does not have `width * height` bytes, or three or four times as many.
    #[must_use]
    pub fn apply(&self, raw: &[u8]) -> Option<Vec<u8>> {
        let mut out = vec![0; raw.len()];
        self.apply_into(raw, &mut out).then_some(out)
    }

    /// Undistorts as [`Self::apply`] does, into a buffer of the same size. Returns `false` if a slice has another
    /// size.
    #[must_use]
    pub fn apply_into(&self, raw: &[u8], out: &mut [u8]) -> bool {
        raw.len() == out.len() && self.apply_rows_into(raw, 0, out)
    }

    /// Undistorts as [`Self::apply_into`] does, for the rows of the new image from `first` on that fit into `out`.
    /// Several threads can share the rows. Returns `false` if `raw` has another size, or if `out` does not
    /// consist of whole rows or has too many rows.
    #[must_use]
    pub fn apply_rows_into(&self, raw: &[u8], first: usize, out: &mut [u8]) -> bool {
        let Some(channels) = Channels::of(raw, self.width * self.height) else { return false };
        let row_bytes = self.width * channels as usize;
        let rows = out.len() / row_bytes;
        if !out.len().is_multiple_of(row_bytes) || rows > self.height.saturating_sub(first) {
            return false;
        }
        // The map is computed row by row, so it stays in the fast cache.
        let mut row = MapRows::new(self.width);
        let (mut u, mut v) = (vec![0.0; self.width], vec![0.0; self.width]);
        for (y, out) in (first..).zip(out.chunks_exact_mut(row_bytes)) {
            self.map_row(y, [&mut u, &mut v], &mut row.index, &mut row.fraction);
            channels.apply(raw, self.width, &row, out);
        }
        true
    }

    /// Computes the whole map, to be stored.
    #[must_use]
    pub fn remap(&self) -> Remap {
        let mut rows = MapRows::new(self.width * self.height);
        let (mut u, mut v) = (vec![0.0; self.width], vec![0.0; self.width]);
        let index = rows.index.chunks_exact_mut(self.width);
        for (y, (index, fraction)) in index.zip(rows.fraction.chunks_exact_mut(self.width)).enumerate() {
            self.map_row(y, [&mut u, &mut v], index, fraction);
        }
        Remap { width: self.width, pixels: self.width * self.height, rows }
    }

    /// Computes the map of row `y` of the new image. The raw positions are stored in `u` and `v`.
    fn map_row(&self, y: usize, [u, v]: [&mut [f32]; 2], index: &mut [u32], fraction: &mut [u16]) {
        self.raw_row(y, u, v);
        pack(self.width, self.height, u, v, index, fraction);
    }

    /// Computes the raw positions of the pixels of a row of the new image, accurate to a thousandth of a
    /// pixel. Pixel centres are at halves.
    fn raw_row(&self, row: usize, u: &mut [f32], v: &mut [f32]) {
        let lens = &self.lens;
        let Pixel { u: cu, v: cv } = lens.principal_point;
        let straight_v = self.offset[1] + self.scale * (row as f64 + 0.5);
        match lens.distortion {
            Distortion::BrownConrady(brown) => {
                let inverse = lens.focal.recip();
                let first = (self.offset[0] + 0.5 * self.scale - cu) * inverse;
                let (y, step) = ((straight_v - cv) * inverse, self.scale * inverse);
                let focals = [lens.focal, lens.pixel_aspect * lens.focal];
                brown_row(&brown, self.most, [first, step, y], (focals, [cu, cv]), u, v);
            }
            _ => {
                for (column, (u, v)) in u.iter_mut().zip(v).enumerate() {
                    let straight_u = self.offset[0] + self.scale * (column as f64 + 0.5);
                    let raw = lens.distort(UndistortedPixel { u: straight_u, v: straight_v });
                    (*u, *v) = raw.map_or((f32::NAN, f32::NAN), |raw| (raw.u as f32, raw.v as f32));
                }
            }
        }
    }
}

impl Remap {
    /// Creates the map from a new image of this `size` to a raw image of the size `raw`. `raw_of` maps pixels of
    /// the new image to the raw image. Returns `None` if an image is too small or too large.
    pub(crate) fn new(
        raw: [usize; 2],
        size: [usize; 2],
        raw_of: impl Fn(Pixel) -> Option<Pixel>,
    ) -> Option<Self> {
        let is_small = |[w, h]: [usize; 2]| {
            w.checked_mul(h)
                .and_then(|pixels| pixels.checked_mul(3))
                .is_some_and(|bytes| bytes < BLANK_INDEX as usize)
        };
        if raw[0] < 2 || raw[1] < 2 || size[0] == 0 || !is_small(raw) || !is_small(size) {
            return None;
        }
        let mut rows = MapRows::new(size[0] * size[1]);
        let (mut u, mut v) = (vec![0.0; size[0]], vec![0.0; size[0]]);
        let index = rows.index.chunks_exact_mut(size[0]);
        for (y, (index, fraction)) in index.zip(rows.fraction.chunks_exact_mut(size[0])).enumerate() {
            for (x, (u, v)) in u.iter_mut().zip(&mut v).enumerate() {
                let at = raw_of(Pixel::new(x as f64 + 0.5, y as f64 + 0.5));
                (*u, *v) = at.map_or((f32::NAN, f32::NAN), |at| (at.u as f32, at.v as f32));
            }
            pack(raw[0], raw[1], &u, &v, index, fraction);
        }
        Some(Self { width: raw[0], pixels: raw[0] * raw[1], rows })
    }

    /// Applies the map as [`Undistortion::apply_into`] does. The new image has the size of the map.
    #[must_use]
    pub fn apply_into(&self, raw: &[u8], out: &mut [u8]) -> bool {
        let is_whole = |own: &Channels| out.len() == self.rows.index.len() * *own as usize;
        let Some(channels) = Channels::of(raw, self.pixels).filter(is_whole) else { return false };
        channels.apply(raw, self.width, &self.rows, out);
        true
    }
}

/// Computes the pixels of the new image `out` that are in the map, with `C` bytes each.
fn apply_rows<const C: usize>(raw: &[u8], stride: usize, map: &MapRows, out: &mut [u8]) {
    dispatch(
        #[inline(always)]
        || {
            let map = map.index.iter().zip(&map.fraction);
            for ((&index, &fraction), pixel) in map.zip(out.as_chunks_mut::<C>().0) {
                *pixel = if index == BLANK_INDEX {
                    [0; C]
                } else {
                    let at = index as usize * C;
                    bilinear(pair(raw, at), pair(raw, at + stride), fraction)
                };
            }
        },
    );
}

/// Returns the weighted mean of four pixels: two neighbours, and the two below them. It interpolates between
/// the two rows first, to 11 bits, then between the two columns.
#[inline(always)]
fn bilinear<const C: usize>(top: u16x8, bottom: u16x8, fraction: u16) -> [u8; C] {
    let (fx, fy) = (u16x8::splat(fraction & 0xFF), u16x8::splat(fraction >> 8));
    // 32 a + (b - a) f: if the difference is negative, the sum wraps around to the correct value.
    let mix = |a: u16x8, b: u16x8, f: u16x8| -> u16x8 { (a << WEIGHT_BITS) + (b - a) * f };
    let rows: u16x8 = (mix(top, bottom, fy) + u16x8::splat(2)) >> 2;
    let lanes = rows.to_array();
    let right = std::array::from_fn(|i| lanes.get(i + C).copied().unwrap_or_default());
    let mixed: u16x8 = (mix(rows, u16x8::new(right), fx) + u16x8::splat(0x80)) >> 8;
    let mixed = i16x8::new(mixed.to_array().map(|colour| colour as i16));
    let bytes = u8x16::narrow_i16x8(mixed, mixed).to_array();
    std::array::from_fn(|i| bytes[i])
}

/// Reads eight bytes from the index `at`: two neighbouring pixels and the bytes after them.
#[inline(always)]
fn pair(raw: &[u8], at: usize) -> u16x8 {
    let bytes: [u8; 8] = match raw.get(at..at + 8) {
        Some(bytes) => std::array::from_fn(|i| bytes[i]),
        None => last_pair(raw, at),
    };
    let word = u128::from(u64::from_le_bytes(bytes));
    u16x8::from_u8x16_low(u8x16::new(word.to_le_bytes()))
}

/// Reads as [`pair`] at the end of the image; missing bytes are 0.
#[cold]
#[inline(never)]
fn last_pair(raw: &[u8], at: usize) -> [u8; 8] {
    std::array::from_fn(|i| raw.get(at + i).copied().unwrap_or_default())
}

/// Computes the raw pixels of a row of normalised points `(first + i step, y)`. Points that the lens
/// does not show have NaN in `u`.
fn brown_row(
    brown: &BrownConrady,
    most: f64,
    [first, step, y]: [f64; 3],
    (focals, centre): ([f64; 2], [f64; 2]),
    u: &mut [f32],
    v: &mut [f32],
) {
    let [k1, k2, k3, p1, p2] = [brown.k1, brown.k2, brown.k3, brown.p1, brown.p2].map(|k| k as f32);
    let (first, step, y, most) = (first as f32, step as f32, y as f32, most as f32);
    let [focal_u, focal_v] = focals.map(|focal| focal as f32);
    let [cu, cv] = centre.map(|centre| centre as f32);
    dispatch(
        #[inline(always)]
        move || {
            for (column, (u, v)) in u.iter_mut().zip(v).enumerate() {
                let x = first + step * column as i32 as f32;
                let square = x * x + y * y;
                let radial = 1.0 + square * (k1 + square * (k2 + square * k3));
                let bent_x = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x);
                let bent_y = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y;
                *u = if square <= most { cu + focal_u * bent_x } else { f32::NAN };
                *v = cv + focal_v * bent_y;
            }
        },
    );
}

/// Packs each raw position as the index of the pixel up and left of it, and the weights in x and y.
fn pack(width: usize, height: usize, u: &[f32], v: &[f32], index: &mut [u32], fraction: &mut [u16]) {
    // Centres are at halves: the pixel with its centre up and left of u has the index floor(u - 0.5).
    let (last_x, last_y) = (width as i32 - 1, height as i32 - 1);
    let (most_x, most_y) = ((last_x * 32) as f32, (last_y * 32) as f32);
    let width = width as u32;
    dispatch(
        #[inline(always)]
        move || {
            for (((index, fraction), &u), &v) in index.iter_mut().zip(fraction).zip(u).zip(v) {
                // Positions up to half a pixel beyond the outer centres have the colour of the edge.
                let (x, y) = ((u - 0.5) * WEIGHT_STEPS, (v - 0.5) * WEIGHT_STEPS);
                let inside = (x >= -16.0) & (x <= most_x + 16.0) & (y >= -16.0) & (y <= most_y + 16.0);
                let (x, y) = (rounded(x, most_x), rounded(y, most_y));
                // In the last column and row, the index is one pixel less, and the next pixel has full weight.
                let (column, line) = ((x >> WEIGHT_BITS).min(last_x - 1), (y >> WEIGHT_BITS).min(last_y - 1));
                let packed = line as u32 * width + column as u32;
                *index = if inside { packed } else { BLANK_INDEX };
                *fraction = ((x - (column << WEIGHT_BITS)) | (y - (line << WEIGHT_BITS)) << 8) as u16;
            }
        },
    );
}

/// Returns the nearest integer between 0 and `most`, which is below 2^22. Returns 0 for NaN.
#[inline(always)]
fn rounded(x: f32, most: f32) -> i32 {
    /// Number `1.5 * 2^23`. If it is added, the last bit of the mantissa has the value 1, so the sum is rounded to an
    /// integer.
    const SHIFT: f32 = 12_582_912.0;
    let x = if x > 0.0 { x } else { 0.0 };
    let x = if x < most { x } else { most };
    (x + SHIFT).to_bits() as i32 - SHIFT.to_bits() as i32
}

/// Returns the scale and offset of the new image: undistorted = offset + scale * new.
fn view(lens: &Lens, [width, height]: [f64; 2], crop: Crop) -> Option<(f64, [f64; 2])> {
    if crop == Crop::SameFocal {
        return Some((1.0, [0.0, 0.0]));
    }
    /// Number of steps along each side of the raw image.
    const STEPS_PER_SIDE: usize = 64;
    let edge = |from: [f64; 2], to: [f64; 2]| {
        let point = move |i: usize| {
            let t = i as f64 / STEPS_PER_SIDE as f64;
            Pixel { u: from[0] + t * (to[0] - from[0]), v: from[1] + t * (to[1] - from[1]) }
        };
        (0..=STEPS_PER_SIDE).filter_map(|i| lens.undistort(point(i))).collect::<Vec<_>>()
    };
    let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
    let [top, right, bottom, left] = [0, 1, 2, 3].map(|i| edge(corners[i], corners[(i + 1) % 4]));
    let least = |side: &[UndistortedPixel], value: fn(&UndistortedPixel) -> f64| {
        side.iter().map(value).fold(f64::INFINITY, f64::min)
    };
    let most = |side: &[UndistortedPixel], value: fn(&UndistortedPixel) -> f64| {
        side.iter().map(value).fold(f64::NEG_INFINITY, f64::max)
    };
    let [x0, x1, y0, y1] = if crop == Crop::AllValid {
        [most(&left, |p| p.u), least(&right, |p| p.u), most(&top, |p| p.v), least(&bottom, |p| p.v)]
    } else {
        let all = [top, right, bottom, left].concat();
        [least(&all, |p| p.u), most(&all, |p| p.u), least(&all, |p| p.v), most(&all, |p| p.v)]
    };
    let ratios = [(x1 - x0) / width, (y1 - y0) / height];
    let scale = if crop == Crop::AllValid { ratios[0].min(ratios[1]) } else { ratios[0].max(ratios[1]) };
    let offset = [0.5 * (x0 + x1) - 0.5 * scale * width, 0.5 * (y0 + y1) - 0.5 * scale * height];
    (scale.is_finite() && scale > 0.0).then_some((scale, offset))
}

/// Undistortion of the images of a stream, prepared for many images, with the equivalent pinhole camera.
#[derive(Clone, Debug)]
pub struct StraightView {
    /// Map from the raw image to the new image.
    pub remap: Remap,
    /// Width and height of both images, in pixels.
    pub size: [usize; 2],
    /// Focal length of the new image, in pixels.
    pub focal: f64,
    /// Principal point of the new image, from its corner, in pixels.
    pub principal_point: Pixel,
}

/// Reason why the images of a stream cannot be undistorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StraightViewError {
    /// The stream is stretched.
    Stretched,
    /// No undistorted image contains the whole view of the lens, as for a wide fisheye lens. The crop
    /// [`Crop::SameFocal`] is possible.
    Round,
    /// The images are too small or too large.
    Size,
}

impl fmt::Display for StraightViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stretched => {
                "a stretched stream has two focal lengths: undistort images with the aspect ratio of the calibrated image"
            }
            Self::Round => {
                "no flat image contains the whole view of this lens; use the crop \"same-focal\" or a window"
            }
            Self::Size => "expected images from 2 x 2 pixels to 1.4 gigapixels",
        })
    }
}

impl std::error::Error for StraightViewError {}

impl CameraView {
    /// Prepares the undistortion of the images of the stream.
    ///
    /// # Errors
    /// If the stream is stretched, if no flat image contains the crop, and for images of fewer than 2 x 2
    /// pixels, or of 1.4 gigapixels and more.
    pub fn straight_view(&self, crop: Crop) -> Result<StraightView, StraightViewError> {
        let (lens, size) = self.lens_in_stream().ok_or(StraightViewError::Stretched)?;
        let size @ [width, height] = size.map(|side| side as usize);
        let made = |crop| Undistortion::new(&lens, width, height, crop);
        let why = || made(Crop::SameFocal).map_or(StraightViewError::Size, |_| StraightViewError::Round);
        let made = made(crop).ok_or_else(why)?;
        let focal = made.focal(self.camera().focal / self.camera().lens.focal * lens.focal);
        Ok(StraightView { remap: made.remap(), size, focal, principal_point: made.principal_point() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn barrel() -> Lens {
        let brown = BrownConrady { k1: -0.25, k2: 0.05, p1: 0.001, ..BrownConrady::default() };
        Lens {
            principal_point: Pixel::new(160.0, 90.0),
            focal: 220.0,
            distortion: Distortion::BrownConrady(brown),
            image_circle: None,
            pixel_aspect: 1.0,
        }
    }

    /// Creates an image whose colours encode the position: red 0.5 u, green v, blue a mix of both.
    fn ramp(width: usize, height: usize) -> Vec<u8> {
        (0..height)
            .flat_map(|y| (0..width).flat_map(move |x| [(x / 2) as u8, y as u8, ((x + y) / 4) as u8]))
            .collect()
    }

    #[test]
    fn bands_of_rows_equal_the_whole_image() {
        let brown = BrownConrady { k1: -0.2, k2: 0.05, ..BrownConrady::default() };
        let centre = Pixel::new(31.0, 17.5);
        let lens = Lens { focal: 50.0, distortion: Distortion::BrownConrady(brown), ..Lens::pinhole(centre) };
        let map = Undistortion::new(&lens, 64, 36, Crop::SameFocal).unwrap();
        let raw: Vec<u8> = (0..64 * 36 * 3).map(|i| (i * 7 % 251) as u8).collect();
        let mut out = vec![0; raw.len()];
        for (band, out) in out.chunks_mut(10 * 64 * 3).enumerate() {
            assert!(map.apply_rows_into(&raw, 10 * band, out));
        }
        assert_eq!(out, map.apply(&raw).unwrap());
        assert!(!map.apply_rows_into(&raw, 30, &mut out[..7 * 64 * 3]), "there are no seven rows more");
        assert!(!map.apply_rows_into(&raw, 0, &mut out[..100]), "no whole row");
        assert!(map.apply_rows_into(&raw, 36, &mut []));
    }

    #[test]
    fn undistorted_pixels_have_colour_of_raw_position() {
        let (width, height, lens) = (320, 180, barrel());
        for crop in [Crop::SameFocal, Crop::AllValid, Crop::AllPixels] {
            let view = Undistortion::new(&lens, width, height, crop).unwrap();
            let out = view.apply(&ramp(width, height)).unwrap();
            let mut again = vec![7; out.len()];
            assert!(view.remap().apply_into(&ramp(width, height), &mut again));
            assert_eq!(out, again, "a map that is kept does the same");
            let mut blank = 0;
            for y in 0..height {
                for x in 0..width {
                    let straight = UndistortedPixel {
                        u: view.offset[0] + view.scale * (x as f64 + 0.5),
                        v: view.offset[1] + view.scale * (y as f64 + 0.5),
                    };
                    let colour = &out[(y * width + x) * 3..][..3];
                    let raw = lens.distort(straight);
                    let seen = raw.filter(|p| p.u > 1.0 && p.v > 1.0 && p.u < 319.0 && p.v < 179.0);
                    match seen {
                        Some(raw) => {
                            assert!((f64::from(colour[1]) - (raw.v - 0.5)).abs() < 0.6, "{raw:?} {colour:?}");
                        }
                        None => blank += usize::from(colour == [0; 3]),
                    }
                }
            }
            assert_eq!(blank > 0, crop == Crop::AllPixels || crop == Crop::SameFocal && blank > 0);
            assert!(crop != Crop::AllValid || blank == 0);
        }
    }

    #[test]
    fn grey_and_rgba_images_map_like_rgb_channels() {
        let (width, height) = (320, 180);
        let view = Undistortion::new(&barrel(), width, height, Crop::SameFocal).unwrap();
        let raw = ramp(width, height);
        let coloured = view.apply(&raw).unwrap();
        let pixels = || raw.as_chunks::<3>().0.iter();
        let grey = view.apply(&pixels().map(|pixel| pixel[1]).collect::<Vec<u8>>()).unwrap();
        let clear = view.apply(&pixels().flat_map(|&[r, g, b]| [r, g, b, 255]).collect::<Vec<u8>>()).unwrap();
        for (i, pixel) in coloured.as_chunks::<3>().0.iter().enumerate() {
            assert_eq!(grey[i], pixel[1]);
            assert_eq!(&clear[4 * i..4 * i + 3], pixel);
        }
        assert!(clear.iter().skip(3).step_by(4).all(|&alpha| alpha == 0 || alpha == 255));
    }

    #[test]
    fn slice_of_wrong_size_is_rejected() {
        let view = Undistortion::new(&barrel(), 32, 18, Crop::SameFocal).unwrap();
        assert_eq!(view.apply(&[0; 5]), None);
        assert!(!view.remap().apply_into(&[0; 5], &mut [0; 5]));
        assert_eq!(Undistortion::new(&barrel(), 32, 1, Crop::SameFocal), None);
    }
}
