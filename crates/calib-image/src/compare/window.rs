//! Window of the old image that a new image shows: a digital zoom, a crop, or the whole view in another
//! resolution.
//!
//! A window maps an old pixel `x` to `s (x - c)`, with one scale `s` and the corner `c`. Unlike a rotation, it does
//! not change the shape of distorted lines. Matched corners determine it to about a pixel (RANSAC, Fischler and
//! Bolles 1981). Brightness then determines it to some hundredths of a pixel (Lucas and Kanade 1981), by least
//! squares of the differences of log brightness. A common offset represents exposure. Tukey's weights reject moving
//! objects.

use calib_core::Pixel;
use calib_site::WindowMap;
use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};

use crate::compare::coarse::best_of_pairs;
use crate::compare::feature::{Feature, Luma, Match, SMOOTHING_PX, features, features_from, matches};
use crate::compare::turn_fit::{MAD_TO_SIGMA, median};

/// Smallest and largest scale of a window. Digital zooms have factors up to 4. Streams of lower resolution have
/// scales below 1.
const SCALES: [f64; 2] = [0.2, 4.6];
/// Columns and rows of the blocks of the new image, for counting matched corners and agreeing blocks.
const BLOCKS: [usize; 2] = [12, 8];
/// Number of samples at which brightness is compared.
const SAMPLE_COUNT: f64 = 40_000.0;
/// Largest difference of log brightness that counts in full; larger differences are due to moving objects.
const MAX_DIFFERENCE: f64 = 0.15;

/// Part of the old image that the new image shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShownWindow {
    /// Map from pixels of the old image to pixels of the new image.
    pub map: WindowMap,
    /// Width and height of the new image, in pixels.
    pub size: [u32; 2],
}

impl ShownWindow {
    /// Returns left, top, width and height of the part, in pixels of the old image.
    #[must_use]
    pub fn px(&self) -> [f64; 4] {
        self.map.window(self.size)
    }
}

/// Window that a new image shows, with its accuracy and its agreement with the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FoundWindow {
    pub(crate) map: WindowMap,
    /// Standard deviation of the log of the scale.
    pub(crate) sigma: f64,
    /// Fraction of the blocks with texture whose brightness agrees.
    pub(crate) share: f64,
}

/// Matched corner: its positions in both images.
struct Pair {
    old: Pixel,
    new: Pixel,
    /// Largest distance of an inlier from its predicted position, in pixels of the new image.
    max_distance: f64,
    block: usize,
}

/// Finds the window of the old image that the new image shows; `None` if the new image shows no such window.
/// `upright` are the corners of the old image.
pub(crate) fn find_window(old: &Luma, upright: &[Feature], new: &Luma) -> Option<FoundWindow> {
    /// Smallest fraction of the textured blocks whose brightness must agree for a window to be accepted.
    const MIN_SHARE: f64 = 0.6;
    /// Smallest error of the width of the window, in pixels: resampling shifts edges by this much.
    const MIN_SIGMA_PX: f64 = 0.1;
    let coarse = coarse_window(&pairs(upright, new))?;
    let wide = BrightnessPair::new(old, new, coarse, 3.0).refine(coarse)?.0;
    let pair = BrightnessPair::new(old, new, wide, 1.0);
    let (fine, sigma) = pair.refine(wide)?;
    let map = pair.whole_pixels(fine);
    let share = pair.agreeing_share(&map)?;
    let sigma = sigma.max(MIN_SIGMA_PX / new.width.max(1) as f64);
    (share > MIN_SHARE).then_some(FoundWindow { map, sigma, share })
}

/// Returns the mean squared difference of log brightness between the old image and the new image. `by` maps old pixels
/// to new pixels. Large differences count as [`MAX_DIFFERENCE`]. `map` is the window whose pixels are compared.
pub(crate) fn disagreement(
    [old, new]: [&Luma; 2],
    map: WindowMap,
    by: impl Fn(Pixel) -> Option<Pixel>,
) -> Option<f64> {
    BrightnessPair::new(old, new, map, 1.0).cost(by)
}

/// Matches the corners of both images, the least ambiguous first.
fn pairs(upright: &[Feature], new: &Luma) -> Vec<Pair> {
    // A zoom shows the corners of the old image at a coarser scale.
    let later = features(new, &[0.0]).into_iter().chain(features_from(new, &[0.0], 2.0)).collect::<Vec<_>>();
    let block = |at: Pixel| {
        let index = |axis: usize, at: f64, side: usize| {
            ((at / side as f64 * BLOCKS[axis] as f64) as usize).min(BLOCKS[axis] - 1)
        };
        index(1, at.v, new.height) * BLOCKS[0] + index(0, at.u, new.width)
    };
    let found = matches(upright, &later);
    let pair = |found: &Match| Pair {
        old: found.old,
        new: found.new,
        max_distance: 2.0 * found.size,
        block: block(found.new),
    };
    found.iter().map(pair).collect()
}

/// Returns the window with inliers in the most blocks of the new image; `None` if these are too few.
fn coarse_window(pairs: &[Pair]) -> Option<WindowMap> {
    /// Smallest number of blocks with an inlier.
    const MIN_BLOCKS: usize = 8;
    let (mut map, count) = best_of_pairs(pairs, window_of_pair, |map| covered_blocks(map, pairs))?;
    if count < MIN_BLOCKS {
        return None;
    }
    for _ in 0..4 {
        map = least_squares_window(pairs.iter().filter(|pair| is_inlier(&map, pair)))?;
    }
    Some(map)
}

/// Returns the window that maps two old corners to their new positions; `None` if they are too close together, or if
/// no window without rotation and with a scale in [`SCALES`] exists.
fn window_of_pair([a, b]: [&Pair; 2]) -> Option<WindowMap> {
    /// Smallest distance of the old corners, in pixels.
    const MIN_DISTANCE_PX: f64 = 30.0;
    /// Largest sine of the rotation between both images.
    const MAX_SINE: f64 = 0.02;
    let (x, y) = ([b.old.u - a.old.u, b.old.v - a.old.v], [b.new.u - a.new.u, b.new.v - a.new.v]);
    let (old, new) = (x[0].hypot(x[1]), y[0].hypot(y[1]));
    let (along, across) = (x[0] * y[0] + x[1] * y[1], x[0] * y[1] - x[1] * y[0]);
    let scale = new / old;
    let is_window = old > MIN_DISTANCE_PX
        && (SCALES[0]..SCALES[1]).contains(&scale)
        && along > 0.0
        && across.abs() < MAX_SINE * along;
    is_window.then(|| WindowMap {
        corner: Pixel::new(a.old.u - a.new.u / scale, a.old.v - a.new.v / scale),
        scale: [scale; 2],
    })
}

fn is_inlier(map: &WindowMap, pair: &Pair) -> bool {
    map.pixel(pair.old).distance(pair.new) < pair.max_distance
}

/// Counts the blocks of the new image with an inlier.
fn covered_blocks(map: &WindowMap, pairs: &[Pair]) -> usize {
    let mut blocks = [false; BLOCKS[0] * BLOCKS[1]];
    pairs.iter().filter(|pair| is_inlier(map, pair)).for_each(|pair| blocks[pair.block] = true);
    blocks.iter().filter(|&&is_covered| is_covered).count()
}

/// Returns the window with the smallest sum of squared distances of the matches, in pixels of the new image.
fn least_squares_window<'a>(pairs: impl Iterator<Item = &'a Pair>) -> Option<WindowMap> {
    let pairs: Vec<&Pair> = pairs.collect();
    let count = pairs.len() as f64;
    let mean = |of: &dyn Fn(&Pair) -> f64| pairs.iter().map(|pair| of(pair)).sum::<f64>() / count;
    let (u, v) = (mean(&|pair| pair.old.u), mean(&|pair| pair.old.v));
    let (x, y) = (mean(&|pair| pair.new.u), mean(&|pair| pair.new.v));
    let product = mean(&|pair| (pair.old.u - u) * (pair.new.u - x) + (pair.old.v - v) * (pair.new.v - y));
    let square = mean(&|pair| (pair.old.u - u).powi(2) + (pair.old.v - v).powi(2));
    let scale = product / square;
    (pairs.len() > 2 && scale > 0.0)
        .then(|| WindowMap { corner: Pixel::new(u - x / scale, v - y / scale), scale: [scale; 2] })
}

/// Both images, smoothed to the same detail, and the old pixels at which they are compared.
struct BrightnessPair {
    old: Luma,
    new: Luma,
    samples: Vec<Pixel>,
    /// Centre of the samples.
    middle: Pixel,
    /// Distance between neighbouring samples, in pixels of the old image.
    step: f64,
    /// Standard deviation of the smoothing of the old image, in its pixels.
    smoothing: f64,
}

impl BrightnessPair {
    /// Prepares the comparison under a window. `blur` multiplies the usual smoothing.
    fn new(old: &Luma, new: &Luma, map: WindowMap, blur: f64) -> Self {
        let size = [new.width, new.height].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        let [left, top, width, height] = map.window(size);
        let [right, bottom] = [(left + width).min(old.width as f64), (top + height).min(old.height as f64)];
        let (left, top) = (left.max(0.0), top.max(0.0));
        let area = ((right - left) * (bottom - top)).max(1.0);
        let step = (area / SAMPLE_COUNT).sqrt().max(0.5);
        let count = |from: f64, to: f64| ((to - from) / step).max(0.0) as usize;
        let samples = (0..count(top, bottom)).flat_map(|row| {
            (0..count(left, right)).map(move |column| {
                Pixel::new(left + (column as f64 + 0.5) * step, top + (row as f64 + 0.5) * step)
            })
        });
        // Both images show the detail of the coarser one.
        let scale = map.scale[0];
        let smoothing = blur * SMOOTHING_PX * scale.recip().max(1.0);
        Self {
            old: old.smoothed(smoothing),
            new: new.smoothed(smoothing * scale),
            samples: samples.collect(),
            middle: Pixel::new(0.5 * (left + right), 0.5 * (top + bottom)),
            step,
            smoothing,
        }
    }

    /// Returns the difference of log brightness, new minus old, at an old pixel under a map.
    fn difference(&self, at: Pixel, by: impl Fn(Pixel) -> Option<Pixel>) -> Option<f64> {
        let Pixel { u, v } = by(at)?;
        Some(self.new.at(u, v)? - self.old.at(at.u, at.v)?)
    }

    /// Returns the mean squared difference without the common offset; see [`disagreement`].
    fn cost(&self, by: impl Fn(Pixel) -> Option<Pixel>) -> Option<f64> {
        let all: Vec<f64> = self.samples.iter().filter_map(|&at| self.difference(at, &by)).collect();
        if 4 * all.len() < self.samples.len() || all.is_empty() {
            return None;
        }
        let offset = median(all.clone());
        let capped = |off: &f64| (off - offset).powi(2).min(MAX_DIFFERENCE * MAX_DIFFERENCE);
        Some(all.iter().map(capped).sum::<f64>() / all.len() as f64)
    }

    /// Refines a window. Returns it with the standard deviation of the log of its scale.
    fn refine(&self, mut map: WindowMap) -> Option<(WindowMap, f64)> {
        /// Maximum number of steps.
        const MAX_STEPS: usize = 20;
        /// Displacement of the image corners by a step, in pixels, below which the iteration ends.
        const MIN_STEP_PX: f64 = 1e-3;
        let mut sigma = f64::INFINITY;
        for _ in 0..MAX_STEPS {
            let (square, gradient, variance) = self.normal_equations(&map)?;
            let inverse = square.try_inverse()?;
            let step = -inverse * gradient;
            let [by_scale, du, dv, _] = <[f64; 4]>::from(step);
            let [scale, _] = map.scale;
            let middle = map.pixel(self.middle);
            let larger = scale * by_scale.clamp(-0.1, 0.1).exp();
            let corner = Pixel::new(
                self.middle.u - (middle.u + du) / larger,
                self.middle.v - (middle.v + dv) / larger,
            );
            map = WindowMap { corner, scale: [larger; 2] };
            // Smoothing correlates the noise of neighbouring samples.
            let repeated = (2.0 * self.smoothing / self.step).max(1.0).powi(2);
            sigma = (inverse[(0, 0)] * variance * repeated).sqrt();
            let reach = self.new.width.max(self.new.height) as f64;
            if du.hypot(dv) + by_scale.abs() * reach < MIN_STEP_PX {
                break;
            }
        }
        Some((map, sigma))
    }

    /// Returns the normal equations of the log scale, the shift along u and v, and the offset of brightness; also
    /// the variance of the differences.
    fn normal_equations(&self, map: &WindowMap) -> Option<(Matrix4<f64>, Vector4<f64>, f64)> {
        let middle = map.pixel(self.middle);
        let rows: Vec<(f64, [f64; 3])> = self
            .samples
            .iter()
            .filter_map(|&at| {
                let Pixel { u, v } = map.pixel(at);
                let off = self.new.at(u, v)? - self.old.at(at.u, at.v)?;
                let du = 0.5 * (self.new.at(u + 1.0, v)? - self.new.at(u - 1.0, v)?);
                let dv = 0.5 * (self.new.at(u, v + 1.0)? - self.new.at(u, v - 1.0)?);
                Some((off, [du * (u - middle.u) + dv * (v - middle.v), du, dv]))
            })
            .collect();
        if 4 * rows.len() < self.samples.len() || rows.len() < 100 {
            return None;
        }
        let offset = median(rows.iter().map(|row| row.0).collect());
        let spread = median(rows.iter().map(|row| (row.0 - offset).abs()).collect());
        let spread = (MAD_TO_SIGMA * spread).max(1e-4);
        // Weights of Tukey, which end at 4.7 standard deviations.
        let limit = 4.685 * spread;
        let (mut square, mut gradient) = (Matrix4::zeros(), Vector4::zeros());
        for (off, [by_scale, du, dv]) in rows {
            let relative = (off - offset) / limit;
            if relative.abs() < 1.0 {
                let weight = (1.0 - relative * relative).powi(2);
                let by = Vector4::new(by_scale, du, dv, 1.0);
                square += weight * by * by.transpose();
                gradient += weight * (off - offset) * by;
            }
        }
        Some((square, gradient, spread * spread))
    }

    /// Rounds a window to whole pixels of the old image, if the brightness then agrees equally well. Most programs
    /// zoom and crop to whole pixels.
    fn whole_pixels(&self, map: WindowMap) -> WindowMap {
        /// Largest change of a value of the window by the rounding, in pixels.
        const MAX_DISTANCE_PX: f64 = 0.3;
        /// Largest ratio of the cost of the rounded window to the cost of `map`.
        const MAX_RATIO: f64 = 1.01;
        let size = [self.new.width, self.new.height].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        let window = map.window(size);
        let whole = window.map(f64::round);
        let is_near = window.iter().zip(&whole).all(|(a, b)| (a - b).abs() < MAX_DISTANCE_PX);
        let [w, h] = [whole[2], whole[3]];
        if !is_near || w < 1.0 || h < 1.0 {
            return map;
        }
        let rounded = WindowMap::new(whole, size);
        let costs = [map, rounded].map(|map| self.cost(|at| Some(map.pixel(at))));
        match costs {
            [Some(own), Some(other)] if other < MAX_RATIO * own => rounded,
            _ => map,
        }
    }

    /// Returns the fraction of the blocks with texture whose brightness agrees; `None` if few have texture.
    fn agreeing_share(&self, map: &WindowMap) -> Option<f64> {
        /// Smallest standard deviation of the log brightness of a block with texture.
        const MIN_TEXTURE: f64 = 0.03;
        /// Smallest correlation of a block that agrees.
        const MIN_CORRELATION: f64 = 0.8;
        /// Smallest number of blocks with texture.
        const MIN_BLOCKS: usize = 8;
        let mut sums = [[0.0; 6]; BLOCKS[0] * BLOCKS[1]];
        for &at in &self.samples {
            let Pixel { u, v } = map.pixel(at);
            let (Some(new), Some(old)) = (self.new.at(u, v), self.old.at(at.u, at.v)) else { continue };
            let column = (u / self.new.width as f64 * BLOCKS[0] as f64) as usize;
            let row = (v / self.new.height as f64 * BLOCKS[1] as f64) as usize;
            let of = &mut sums[row.min(BLOCKS[1] - 1) * BLOCKS[0] + column.min(BLOCKS[0] - 1)];
            for (sum, value) in of.iter_mut().zip([1.0, new, old, new * new, old * old, new * old]) {
                *sum += value;
            }
        }
        let correlation = |[n, x, y, xx, yy, xy]: &[f64; 6]| {
            let [xx, yy, xy] = [xx / n - (x / n).powi(2), yy / n - (y / n).powi(2), xy / n - x * y / (n * n)];
            (*n > 20.0 && xx.max(yy) > MIN_TEXTURE * MIN_TEXTURE).then(|| xy / (xx * yy).max(1e-12).sqrt())
        };
        let found: Vec<f64> = sums.iter().filter_map(correlation).collect();
        let agreeing = found.iter().filter(|&&value| value > MIN_CORRELATION).count();
        (found.len() >= MIN_BLOCKS).then(|| agreeing as f64 / found.len() as f64)
    }
}
