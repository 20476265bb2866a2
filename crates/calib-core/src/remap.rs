//! An image without distortion: a map from every pixel to where the lens shows it, built once and
//! applied to any number of images of that camera.

use pulp::Arch;

use crate::lens::{Distortion, Lens};
use crate::space::{Pixel, UndistortedPixel};

/// Which part of the undistorted plane the new image shows. The size of the image stays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Crop {
    /// The same focal: the centre keeps its scale.
    #[default]
    SameFocal,
    /// The largest view without a blank pixel.
    AllValid,
    /// Every pixel of the raw image, blank beyond.
    AllPixels,
}

/// Bilinear weights are counted in 1/32 of a pixel, as finely as 8-bit colours can show.
const STEPS: f64 = 32.0;
const STEP_BITS: u32 = 5;
const BLANK: u32 = u32::MAX;

/// A map from the pixels of an undistorted image to raw pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Remap {
    width: usize,
    height: usize,
    /// Focal factor and offset of the new image: undistorted pixel = centre + scale * (new - centre).
    scale: f64,
    offset: [f64; 2],
    /// For every pixel of the new image the raw pixel up and left of the point it shows, and the
    /// weights in x and y; packed as index and fractions.
    index: Vec<u32>,
    fraction: Vec<[u8; 2]>,
}

impl Remap {
    /// The map of a lens for images of `width` x `height` pixels.
    ///
    /// `None` for images of fewer than 2 x 2 pixels, and of 1.4 gigapixels and more.
    #[must_use]
    pub fn new(lens: &Lens, width: usize, height: usize, crop: Crop) -> Option<Self> {
        let bytes = width.checked_mul(height)?.checked_mul(3)?;
        if width < 2 || height < 2 || bytes >= BLANK as usize {
            return None;
        }
        let (scale, offset) = view(lens, [width as f64, height as f64], crop);
        let mut remap = Self {
            width,
            height,
            scale,
            offset,
            index: vec![BLANK; width * height],
            fraction: vec![[0; 2]; width * height],
        };
        let most = lens.distortion.max_radius().powi(2);
        let (mut u, mut v) = (vec![0.0_f64; width], vec![0.0_f64; width]);
        for row in 0..height {
            remap.raw_row(lens, most, row, &mut u, &mut v);
            let start = row * width;
            let index = &mut remap.index[start..start + width];
            let fraction = &mut remap.fraction[start..start + width];
            pack(width, height, &u, &v, index, fraction);
        }
        Some(remap)
    }

    /// Focal of the new image when that of the raw one is `focal`, in pixels.
    #[must_use]
    pub fn focal(&self, focal: f64) -> f64 {
        focal / self.scale
    }

    /// Principal point of the new image when the lens has this one.
    #[must_use]
    pub fn principal_point(&self, point: Pixel) -> Pixel {
        Pixel { u: (point.u - self.offset[0]) / self.scale, v: (point.v - self.offset[1]) / self.scale }
    }

    /// Where the raw image shows the pixels of a row of the new one (pixel centres at halves).
    fn raw_row(&self, lens: &Lens, most: f64, row: usize, u: &mut [f64], v: &mut [f64]) {
        let Pixel { u: cu, v: cv } = lens.principal_point;
        let straight_v = self.offset[1] + self.scale * (row as f64 + 0.5);
        match lens.distortion {
            Distortion::BrownConrady(brown) => Arch::new().dispatch(
                #[inline(always)]
                || {
                    let inverse = lens.focal.recip();
                    let y = (straight_v - cv) * inverse;
                    for (column, (u, v)) in u.iter_mut().zip(v).enumerate() {
                        let x = (self.offset[0] + self.scale * (column as f64 + 0.5) - cu) * inverse;
                        let bent = brown.distort([x, y]);
                        let inside = x * x + y * y <= most;
                        *u = if inside { cu + lens.focal * bent[0] } else { f64::NAN };
                        *v = cv + lens.focal * bent[1];
                    }
                },
            ),
            _ => {
                for (column, (u, v)) in u.iter_mut().zip(v).enumerate() {
                    let straight_u = self.offset[0] + self.scale * (column as f64 + 0.5);
                    let raw = lens.distort(UndistortedPixel { u: straight_u, v: straight_v });
                    (*u, *v) = raw.map_or((f64::NAN, f64::NAN), |raw| (raw.u, raw.v));
                }
            }
        }
    }

    /// Maps an image of 8-bit RGB, row by row. Pixels that the raw image does not show become black.
    ///
    /// `None` when a slice is not of `width * height * 3` bytes.
    #[must_use]
    pub fn apply(&self, raw: &[u8]) -> Option<Vec<u8>> {
        let mut out = vec![0; self.width * self.height * 3];
        self.apply_into(raw, &mut out).then_some(out)
    }

    /// As [`Self::apply`], into a buffer of the same size; `false` when a slice has another one.
    #[must_use]
    pub fn apply_into(&self, raw: &[u8], out: &mut [u8]) -> bool {
        let bytes = self.width * self.height * 3;
        if raw.len() != bytes || out.len() != bytes {
            return false;
        }
        let stride = self.width * 3;
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for ((&index, &fraction), pixel) in
                    self.index.iter().zip(&self.fraction).zip(out.as_chunks_mut::<3>().0)
                {
                    *pixel =
                        if index == BLANK { [0; 3] } else { bilinear(raw, index as usize, stride, fraction) };
                }
            },
        );
        true
    }
}

/// Weighted mean of the four pixels at `at` (in bytes), to its right and below.
#[inline(always)]
fn bilinear(raw: &[u8], at: usize, stride: usize, [fx, fy]: [u8; 2]) -> [u8; 3] {
    let (top, bottom) = (&raw[at..at + 6], &raw[at + stride..at + stride + 6]);
    let (fx, fy) = (u32::from(fx), u32::from(fy));
    let (gx, gy) = (STEPS as u32 - fx, STEPS as u32 - fy);
    std::array::from_fn(|c| {
        let above = u32::from(top[c]) * gx + u32::from(top[c + 3]) * fx;
        let below = u32::from(bottom[c]) * gx + u32::from(bottom[c + 3]) * fx;
        let half = 1 << (2 * STEP_BITS - 1);
        ((above * gy + below * fy + half) >> (2 * STEP_BITS)) as u8
    })
}

/// Packs raw positions as byte index of the pixel up and left, and fractions.
fn pack(width: usize, height: usize, u: &[f64], v: &[f64], index: &mut [u32], fraction: &mut [[u8; 2]]) {
    // Centres are at halves: the pixel whose centre is up and left of u has index floor(u - 0.5).
    let (most_x, most_y) = (((width - 1) * 32) as f64, ((height - 1) * 32) as f64);
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for (((index, fraction), &u), &v) in index.iter_mut().zip(fraction).zip(u).zip(v) {
                // Half a pixel beyond the outer centres still shows the edge's colour.
                let (x, y) = ((u - 0.5) * STEPS, (v - 0.5) * STEPS);
                let inside = x >= -16.0 && x <= most_x + 16.0 && y >= -16.0 && y <= most_y + 16.0;
                let (x, y) = (x.max(0.0).min(most_x) + 0.5, y.max(0.0).min(most_y) + 0.5);
                let (x, y) = (x as u32, y as u32);
                // The last column and row are shown from the pixel before with full weight.
                let (column, line) =
                    ((x >> STEP_BITS).min(width as u32 - 2), (y >> STEP_BITS).min(height as u32 - 2));
                let packed = (line * width as u32 + column) * 3;
                *index = if inside { packed } else { BLANK };
                *fraction = [(x - (column << STEP_BITS)) as u8, (y - (line << STEP_BITS)) as u8];
            }
        },
    );
}

/// Scale and offset of the new image: undistorted = offset + scale * new.
fn view(lens: &Lens, [width, height]: [f64; 2], crop: Crop) -> (f64, [f64; 2]) {
    if crop == Crop::SameFocal {
        return (1.0, [0.0, 0.0]);
    }
    const EDGE: usize = 64;
    let edge = |from: [f64; 2], to: [f64; 2]| {
        let point = move |i: usize| {
            let t = i as f64 / EDGE as f64;
            Pixel { u: from[0] + t * (to[0] - from[0]), v: from[1] + t * (to[1] - from[1]) }
        };
        (0..=EDGE).filter_map(|i| lens.undistort(point(i))).collect::<Vec<_>>()
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
    if !(scale.is_finite() && scale > 0.0) {
        return (1.0, [0.0, 0.0]);
    }
    (scale, [0.5 * (x0 + x1) - 0.5 * scale * width, 0.5 * (y0 + y1) - 0.5 * scale * height])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::BrownConrady;

    fn barrel() -> Lens {
        let brown = BrownConrady { k1: -0.25, k2: 0.05, p1: 0.001, ..BrownConrady::default() };
        Lens {
            principal_point: Pixel::new(160.0, 90.0),
            focal: 220.0,
            distortion: Distortion::BrownConrady(brown),
        }
    }

    /// An image whose colours say where they are: red 0.5 u, green v, blue a mix of both.
    fn ramp(width: usize, height: usize) -> Vec<u8> {
        (0..height)
            .flat_map(|y| (0..width).flat_map(move |x| [(x / 2) as u8, y as u8, ((x + y) / 4) as u8]))
            .collect()
    }

    #[test]
    fn every_pixel_shows_what_the_lens_shows_there() {
        let (width, height, lens) = (320, 180, barrel());
        for crop in [Crop::SameFocal, Crop::AllValid, Crop::AllPixels] {
            let remap = Remap::new(&lens, width, height, crop).unwrap();
            let out = remap.apply(&ramp(width, height)).unwrap();
            let mut blank = 0;
            for y in 0..height {
                for x in 0..width {
                    let straight = UndistortedPixel {
                        u: remap.offset[0] + remap.scale * (x as f64 + 0.5),
                        v: remap.offset[1] + remap.scale * (y as f64 + 0.5),
                    };
                    let colour = &out[(y * width + x) * 3..][..3];
                    let raw = lens.distort(straight);
                    let seen = raw.filter(|p| p.u > 1.0 && p.v > 1.0 && p.u < 319.0 && p.v < 179.0);
                    match seen {
                        Some(raw) => {
                            assert!((f64::from(colour[1]) - (raw.v - 0.5)).abs() < 0.6, "{raw:?} {colour:?}")
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
    fn a_slice_of_the_wrong_size_is_refused() {
        assert_eq!(Remap::new(&barrel(), 32, 18, Crop::SameFocal).unwrap().apply(&[0; 5]), None);
        assert_eq!(Remap::new(&barrel(), 32, 1, Crop::SameFocal), None);
    }
}
