//! Corner features, and their matches between two images: a coarse alignment before edges are compared to a
//! fraction of a pixel.
//!
//! Brightness is on a logarithmic scale ([`Luma`]): lighting, exposure and gamma only scale and shift it.
//! Corners are detected after Shi and Tomasi (1994), one in every cell of an image, at several scales. Each
//! corner is described by histograms of its gradient directions (Lowe 2004), upright and rotated. Lighting
//! changes the magnitude of gradients, but not their direction.

use calib_core::Pixel;
use image::RgbImage;

/// Value added to a brightness of 0 to 255 before the logarithm, so that the noise of dark areas does not
/// count as contrast.
const BRIGHTNESS_OFFSET: f32 = 12.0;

/// Standard deviation of the Gaussian that smooths both images before their brightness is compared, in pixels.
pub(crate) const SMOOTHING_PX: f64 = 0.9;

/// Image of the natural logarithm of brightness, one value a pixel, row by row.
#[derive(Clone, Debug)]
pub(crate) struct Luma {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl Luma {
    pub(crate) fn new(image: &RgbImage) -> Self {
        let (width, height) = image.dimensions();
        let log = |pixel: &image::Rgb<u8>| {
            let [r, g, b] = pixel.0.map(f32::from);
            (0.299 * r + 0.587 * g + 0.114 * b + BRIGHTNESS_OFFSET).ln()
        };
        Self { width: width as usize, height: height as usize, values: image.pixels().map(log).collect() }
    }

    /// Returns the image smoothed with a Gaussian of this standard deviation, in pixels.
    pub(crate) fn smoothed(&self, sigma: f64) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let weights: Vec<f32> =
            (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32).collect();
        let sum: f32 = weights.iter().sum();
        let weights: Vec<f32> = weights.iter().map(|weight| weight / sum).collect();
        self.filtered(&weights, reach, 1).filtered(&weights, reach, self.width)
    }

    /// Returns the image filtered along rows (`stride` 1) or columns (`stride` = width). `weights` covers
    /// `reach` pixels on either side; border pixels are repeated.
    fn filtered(&self, weights: &[f32], reach: isize, stride: usize) -> Self {
        let (width, height) = (self.width, self.height);
        let mut values = vec![0.0; self.values.len()];
        let length = if stride == 1 { width } else { height } as isize;
        for y in 0..height {
            for x in 0..width {
                let (index, here) = (y * width + x, if stride == 1 { x } else { y } as isize);
                let start = index as isize - here * stride as isize;
                let value = |(k, weight): (usize, &f32)| {
                    let at = (here + k as isize - reach).clamp(0, length - 1);
                    weight * self.values[(start + at * stride as isize) as usize]
                };
                values[index] = weights.iter().enumerate().map(value).sum();
            }
        }
        Self { values, ..*self }
    }

    /// Returns the downscaled image: one new pixel covers `factor` old pixels along either axis.
    pub(crate) fn reduced(&self, factor: f64) -> Self {
        let smooth = if factor > 1.0 { self.smoothed(0.45 * factor) } else { self.clone() };
        let [width, height] = [self.width, self.height].map(|side| ((side as f64 / factor) as usize).max(1));
        let value = |i: usize| {
            let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            smooth.interpolate_linearly(u * factor, v * factor)
        };
        Self { width, height, values: (0..width * height).map(value).collect() }
    }

    /// Interpolates the log brightness linearly at a pixel; border pixels are repeated.
    fn interpolate_linearly(&self, u: f64, v: f64) -> f32 {
        let within = |at: f64, side: usize| (at - 0.5).clamp(0.0, side as f64 - 1.0);
        let (x, y) = (within(u, self.width), within(v, self.height));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (s, t) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        (1.0 - t) * ((1.0 - s) * at(x0, y0) + s * at(x1, y0)) + t * ((1.0 - s) * at(x0, y1) + s * at(x1, y1))
    }

    /// Interpolates the log brightness at a pixel by cubic convolution (Keys 1981); `None` at the border and
    /// outside.
    pub(crate) fn at(&self, u: f64, v: f64) -> Option<f64> {
        let (x, y) = (u - 0.5, v - 0.5);
        let inside = x >= 1.0 && y >= 1.0 && x < self.width as f64 - 2.0 && y < self.height as f64 - 2.0;
        if !inside {
            return None;
        }
        let (x0, y0) = (x as usize, y as usize);
        let (across, down) = (cubic(x - x0 as f64), cubic(y - y0 as f64));
        let row = |j: usize| {
            let start = (y0 + j - 1) * self.width + x0 - 1;
            let four = &self.values[start..start + 4];
            four.iter().zip(across).map(|(value, weight)| f64::from(*value) * weight).sum::<f64>()
        };
        Some((0..4).map(|j| down[j] * row(j)).sum())
    }
}

/// Returns the weights of cubic convolution of four neighbouring pixels, for a position `t` pixels after the
/// second pixel.
pub(crate) fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}

/// Largest width of an image for corner detection, in pixels.
const MAX_WIDTH_PX: f64 = 640.0;
/// Number of scales at which corners are detected. Neighbouring scales differ by a factor of sqrt(2).
const SCALE_COUNT: u32 = 4;
/// Side of a cell, in pixels of its scale; only the strongest corner of each cell is used.
const CELL_PX: usize = 16;
/// Half the side of the patch that a descriptor covers, in pixels of its scale.
const PATCH_HALF_PX: i32 = 10;
/// Rotation of the additional descriptors in either direction, in radians.
pub(crate) const DESCRIPTOR_ROTATION: f64 = 0.3;
/// Number of values of a descriptor: eight directions in sixteen cells.
const DESCRIPTOR_LENGTH: usize = 128;

/// Corner with the descriptor of its surroundings.
pub(crate) struct Feature {
    /// Position in the full image.
    pub(crate) at: Pixel,
    /// Size of a pixel of the scale of this corner, in pixels of the full image.
    pub(crate) size: f64,
    descriptor: [f32; DESCRIPTOR_LENGTH],
}

/// Corner of the old image and its match in the new image.
pub(crate) struct Match {
    /// Position in the old image.
    pub(crate) old: Pixel,
    /// Position in the new image.
    pub(crate) new: Pixel,
    /// Size of a pixel of the coarser of the two scales, in pixels of the full image.
    pub(crate) size: f64,
    /// Squared descriptor distance of the match, divided by the squared descriptor distance of the second best
    /// candidate. A small ratio means a clear match.
    pub(crate) ambiguity: f32,
}

/// Image of one scale, with its gradients.
struct Level {
    width: usize,
    height: usize,
    /// Size of a pixel of this scale, in pixels of the full image.
    size: f64,
    /// Brightness gradient at every pixel, row by row.
    slopes: Vec<[f32; 2]>,
}

/// Detects the corners of an image. Each corner is described once for every rotation in `leans`, in radians.
pub(crate) fn features(luma: &Luma, leans: &[f64]) -> Vec<Feature> {
    features_from(luma, leans, 1.0)
}

/// Detects the corners of an image like [`features`], at scales that are coarser by the factor `coarser`.
pub(crate) fn features_from(luma: &Luma, leans: &[f64], coarser: f64) -> Vec<Feature> {
    let first = coarser * (luma.width as f64 / MAX_WIDTH_PX).max(1.0);
    let levels = (0..SCALE_COUNT).map(|i| Level::new(luma, first * 0.5_f64.powf(-0.5 * f64::from(i))));
    let mut found = Vec::new();
    for level in levels {
        for [x, y] in level.corners() {
            let at = Pixel::new((x as f64 + 0.5) * level.size, (y as f64 + 0.5) * level.size);
            let look =
                |&lean: &f64| Feature { at, size: level.size, descriptor: level.descriptor([x, y], lean) };
            found.extend(leans.iter().map(look));
        }
    }
    found
}

impl Level {
    fn new(luma: &Luma, size: f64) -> Self {
        let image = luma.reduced(size).smoothed(0.8);
        let Luma { width, height, .. } = image;
        let at = |x: usize, y: usize| image.values[y.min(height - 1) * width + x.min(width - 1)];
        let slope = |i: usize| {
            let (x, y) = (i % width, i / width);
            [at(x + 1, y) - at(x.saturating_sub(1), y), at(x, y + 1) - at(x, y.saturating_sub(1))]
        };
        Self { width, height, size, slopes: (0..width * height).map(slope).collect() }
    }

    /// Returns the pixels of the strongest corner of every cell.
    fn corners(&self) -> Vec<[usize; 2]> {
        /// Smallest strength of a corner, in squares of log brightness; weaker corners are noise.
        const MIN_STRENGTH: f32 = 0.01;
        /// Smallest distance of a corner from the image border, in pixels.
        const MARGIN_PX: usize = PATCH_HALF_PX as usize + 5;
        let mut best = std::collections::BTreeMap::new();
        for y in MARGIN_PX..self.height.saturating_sub(MARGIN_PX) {
            for x in MARGIN_PX..self.width.saturating_sub(MARGIN_PX) {
                let strength = self.strength(x, y);
                let place = best.entry([y / CELL_PX, x / CELL_PX]).or_insert((MIN_STRENGTH, [0, 0]));
                if strength > place.0 {
                    *place = (strength, [x, y]);
                }
            }
        }
        best.into_values().filter(|(strength, _)| *strength > MIN_STRENGTH).map(|(_, at)| at).collect()
    }

    /// Computes the corner strength: the smaller eigenvalue of the gradient matrix about a pixel.
    fn strength(&self, x: usize, y: usize) -> f32 {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for row in y - 2..=y + 2 {
            for [dx, dy] in &self.slopes[row * self.width + x - 2..=row * self.width + x + 2] {
                xx += dx * dx;
                xy += dx * dy;
                yy += dy * dy;
            }
        }
        0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt()
    }

    /// Computes the descriptor: histograms of eight directions in sixteen cells about a pixel, in a frame
    /// rotated by `lean` radians.
    fn descriptor(&self, [x, y]: [usize; 2], lean: f64) -> [f32; DESCRIPTOR_LENGTH] {
        let (sin, cos) = (lean.sin() as f32, lean.cos() as f32);
        let mut look = [0.0; DESCRIPTOR_LENGTH];
        for j in -PATCH_HALF_PX..PATCH_HALF_PX {
            for i in -PATCH_HALF_PX..PATCH_HALF_PX {
                let (s, t) = (i as f32 + 0.5, j as f32 + 0.5);
                let column = (x as f32 + cos * s - sin * t + 0.5) as usize;
                let row = (y as f32 + sin * s + cos * t + 0.5) as usize;
                let [dx, dy] = self.slopes[row * self.width + column];
                let slope = [cos * dx + sin * dy, cos * dy - sin * dx];
                add_gradient(&mut look, [s, t], slope);
            }
        }
        normalise_descriptor(look)
    }
}

/// Adds a gradient to the neighbouring cells and directions of the descriptor `look`. `[s, t]` is the
/// position of the gradient relative to the corner, in pixels.
fn add_gradient(look: &mut [f32; DESCRIPTOR_LENGTH], [s, t]: [f32; 2], [dx, dy]: [f32; 2]) {
    let size = dx.hypot(dy);
    if size == 0.0 {
        return;
    }
    let half = PATCH_HALF_PX as f32;
    let weight = size * (-(s * s + t * t) / (1.3 * half * half)).exp();
    let turn = (dy.atan2(dx) / std::f32::consts::TAU).rem_euclid(1.0) * 8.0;
    let cell = |at: f32| (at + half) / (0.5 * half) - 0.5;
    let (column, row) = (cell(s), cell(t));
    for (r, by_row) in between(row) {
        for (c, by_column) in between(column) {
            for (d, by_turn) in between(turn) {
                if (0..4).contains(&r) && (0..4).contains(&c) {
                    let index = (r as usize * 4 + c as usize) * 8 + (d as usize) % 8;
                    look[index] += weight * by_row * by_column * by_turn;
                }
            }
        }
    }
}

/// Returns the two neighbouring integers with their interpolation weights.
fn between(at: f32) -> [(i32, f32); 2] {
    let low = at.floor();
    [(low as i32, 1.0 - (at - low)), (low as i32 + 1, at - low)]
}

/// Normalises a descriptor to length 1 after limiting every value to a fifth of the length, so that a single
/// strong edge does not dominate.
fn normalise_descriptor(mut look: [f32; DESCRIPTOR_LENGTH]) -> [f32; DESCRIPTOR_LENGTH] {
    for most in [0.2, 1.0] {
        let length = look.iter().map(|value| value * value).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        look.iter_mut().for_each(|value| *value = (*value / length).min(most));
    }
    look
}

/// Returns the scalar product of two descriptors: 1 for equal descriptors.
fn similarity(a: &[f32; DESCRIPTOR_LENGTH], b: &[f32; DESCRIPTOR_LENGTH]) -> f32 {
    let mut sums = [0.0_f32; 16];
    for (a, b) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for k in 0..16 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum()
}

/// Returns the pairs of corners that are each other's unambiguous nearest neighbours, the least ambiguous
/// first.
pub(crate) fn matches(old: &[Feature], new: &[Feature]) -> Vec<Match> {
    /// Largest accepted ratio of the squared distances to the best and the second-best candidate.
    const MAX_AMBIGUITY: f32 = 0.8;
    let mut of_new = vec![(f32::MIN, 0); new.len()];
    let nearest: Vec<(usize, f32)> = old
        .iter()
        .enumerate()
        .map(|(index, feature)| {
            let likeness: Vec<f32> =
                new.iter().map(|other| similarity(&feature.descriptor, &other.descriptor)).collect();
            for (best, &value) in of_new.iter_mut().zip(&likeness) {
                if value > best.0 {
                    *best = (value, index);
                }
            }
            nearest(new, &likeness)
        })
        .collect();
    let mut found: Vec<Match> = nearest
        .iter()
        .enumerate()
        .filter(|(index, (best, doubt))| {
            *doubt < MAX_AMBIGUITY && of_new.get(*best).is_some_and(|to| to.1 == *index)
        })
        .map(|(index, &(best, doubt))| {
            let (old, new) = (&old[index], &new[best]);
            Match { old: old.at, new: new.at, size: old.size.max(new.size), ambiguity: doubt }
        })
        .collect();
    found.sort_by(|a, b| a.ambiguity.total_cmp(&b.ambiguity));
    found
}

/// Returns the index of the most similar corner, and its ambiguity. The ambiguity is the squared descriptor
/// distance of the corner divided by the squared distance of the best corner at another position. `likeness`
/// contains the similarity of every corner.
fn nearest(new: &[Feature], likeness: &[f32]) -> (usize, f32) {
    let most = |is_candidate: &dyn Fn(usize) -> bool| {
        let candidates = (0..new.len()).filter(|&index| is_candidate(index));
        candidates.max_by(|&a, &b| likeness[a].total_cmp(&likeness[b]))
    };
    let Some(best) = most(&|_| true) else { return (0, f32::MAX) };
    let is_elsewhere = |index: usize| new[index].at.distance(new[best].at) > 8.0 * new[best].size;
    let distance = |index: usize| (2.0 - 2.0 * likeness[index]).max(0.0);
    match most(&is_elsewhere) {
        Some(next) => (best, distance(best) / distance(next).max(f32::MIN_POSITIVE)),
        None => (best, f32::MAX),
    }
}
