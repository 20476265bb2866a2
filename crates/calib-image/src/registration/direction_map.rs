//! Share of each colour class by direction, on a stereographic grid about the optical axis.
//!
//! The stereographic point of a vector `(x, y, z)` in camera axes is `(x, y) / (|v| + z)`. It is finite for
//! all directions except straight backwards. Only the computation of the grid uses the lens. The score of a pair
//! needs no distortion model, so fisheye lenses cost no more than others.

use calib_core::Pixel;

use crate::registration::class_volume::{MIN_VISIBLE_SHARE, to_unit};
use crate::registration::colour_classes::ClassShares;
use crate::registration::local_view::LocalView;

/// Number of grid nodes per pixel of the class shares.
const NODES_PER_PIXEL: f64 = 1.2;
/// Largest number of nodes along one axis.
const MAX_NODES: f64 = 2048.0;
/// Number of image positions along each axis that determine the extent of the grid.
const EXTENT_STEPS: usize = 96;
/// Largest absolute value of a stereographic coordinate: 120 degrees from the optical axis.
const MAX_RADIUS: f64 = 1.73;

/// Class shares by direction. Hidden directions contain the background shares, which are no evidence.
#[derive(Clone, Debug)]
pub(crate) struct DirectionMap {
    /// Number of nodes along x and y.
    size: [usize; 2],
    /// Stereographic coordinates of the first node.
    start: [f32; 2],
    /// Nodes per stereographic unit.
    density: f32,
    /// Shares in units of 1 / `UNIT`, by class, row and column.
    shares: Vec<u16>,
    /// Mean share of each colour class in the visible surroundings, used for hidden directions; in
    /// units of 1 / `UNIT`.
    background: Vec<u16>,
}

impl DirectionMap {
    /// Resamples the class shares of an image. `image` is the calibrated width and height, in pixels. `scale` is
    /// the number of pixels of `shares` per pixel of the image.
    pub(crate) fn new(
        shares: &ClassShares,
        view: &LocalView,
        image: [f64; 2],
        background: &[u16],
        scale: f64,
    ) -> Self {
        let [low, high] = extent(view, image);
        let area = (high[0] - low[0]) * (high[1] - low[1]);
        let pixels = (shares.size[0] * shares.size[1]) as f64;
        let density = (NODES_PER_PIXEL * pixels / area.max(1e-6)).sqrt();
        let nodes = |i: usize| ((high[i] - low[i]) * density).ceil().clamp(0.0, MAX_NODES) as usize + 3;
        let size = [nodes(0), nodes(1)];
        let start = low.map(|low| low - 1.0 / density);
        let plane = size[0] * size[1];
        let mut result = vec![0; plane * background.len()];
        let planes = result.chunks_exact_mut(plane).zip(background);
        planes.for_each(|(plane, &background)| plane.fill(background));
        let mut node = vec![0.0; background.len()];
        for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
            let [a, b] = [start[0] + x as f64 / density, start[1] + y as f64 / density];
            let Some(pixel) = view.vector_to_pixel([2.0 * a, 2.0 * b, 1.0 - a * a - b * b]) else { continue };
            if interpolate(&mut node, shares, [pixel.u, pixel.v].map(|at| at * scale - 0.5)) {
                let classes = result[y * size[0] + x..].iter_mut().step_by(plane).zip(&node);
                classes.for_each(|(into, share)| *into = to_unit(*share));
            }
        }
        let start = start.map(|c| c as f32);
        Self { size, start, density: density as f32, shares: result, background: background.to_vec() }
    }

    /// Returns the background share of a class, in units of 1 / `UNIT`.
    pub(crate) fn background(&self, class: usize) -> f32 {
        f32::from(self.background[class])
    }

    /// Returns the mean share of a class at `N` points of a ray, in units of 1 / `UNIT`. The first point is
    /// `from`, and `step` leads from each point to the next, in camera axes.
    #[inline]
    pub(crate) fn mean_on_ray<const N: usize>(&self, class: usize, from: [f32; 3], step: [f32; 3]) -> f32 {
        let (mut columns, mut rows) = ([0.0_f32; N], [0.0_f32; N]);
        for (i, (column, row)) in columns.iter_mut().zip(&mut rows).enumerate() {
            let t = i as f32;
            let [x, y, z] = [from[0] + t * step[0], from[1] + t * step[1], from[2] + t * step[2]];
            let factor = self.density / ((x * x + y * y + z * z).sqrt() + z);
            *column = x * factor - self.start[0] * self.density;
            *row = y * factor - self.start[1] * self.density;
        }
        let plane = self.size[0] * self.size[1];
        let map = &self.shares[class * plane..(class + 1) * plane];
        let background = self.background(class);
        let mut sum = 0.0;
        for (&x, &y) in columns.iter().zip(&rows) {
            sum += self.at(map, x, y).unwrap_or(background);
        }
        sum / N as f32
    }

    /// Interpolates the map of one class at the column x and the row y. Returns `None` outside the map.
    #[inline(always)]
    fn at(&self, map: &[u16], x: f32, y: f32) -> Option<f32> {
        let is_in = x >= 0.0 && y >= 0.0 && x < (self.size[0] - 1) as f32 && y < (self.size[1] - 1) as f32;
        if !is_in {
            return None;
        }
        // Conversions by way of i32 are single instructions on all processors.
        let (column, row) = (x as i32 as usize, y as i32 as usize);
        let (p, q) = (x - column as i32 as f32, y - row as i32 as f32);
        let start = row * self.size[0] + column;
        let upper = map.get(start..start + 2)?;
        let lower = map.get(start + self.size[0]..start + self.size[0] + 2)?;
        let mix = |pair: &[u16]| f32::from(pair[0]) + p * (f32::from(pair[1]) - f32::from(pair[0]));
        let (upper, lower) = (mix(upper), mix(lower));
        Some(upper + q * (lower - upper))
    }
}

/// Returns the smallest and the largest stereographic coordinates of an image.
fn extent(view: &LocalView, image: [f64; 2]) -> [[f64; 2]; 2] {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (i, j) in (0..=EXTENT_STEPS).flat_map(|i| (0..=EXTENT_STEPS).map(move |j| (i, j))) {
        let at = |i: usize, length: f64| (i as f64 / EXTENT_STEPS as f64 * length).min(length - 1e-3);
        let Some([x, y, z]) = view.vector(Pixel::new(at(i, image[0]), at(j, image[1]))) else { continue };
        for (axis, c) in [x, y].into_iter().enumerate() {
            let c = (c / (1.0 + z).max(1e-9)).clamp(-MAX_RADIUS, MAX_RADIUS);
            low[axis] = low[axis].min(c);
            high[axis] = high[axis].max(c);
        }
    }
    if low[0] <= high[0] { [low, high] } else { [[0.0; 2]; 2] }
}

/// Interpolates the shares of all classes at the pixel `at` of `shares`. Writes them to `node`, normalised to
/// the sum 1. Returns whether the pixel is visible.
fn interpolate(node: &mut [f32], shares: &ClassShares, at: [f64; 2]) -> bool {
    let [(x, p), (y, q)] = [0, 1].map(|i| {
        let last = shares.size[i].saturating_sub(2);
        let at = at[i].clamp(0.0, last as f64 + 1.0);
        let index = (at as usize).min(last);
        (index, (at - index as f64) as f32)
    });
    node.fill(0.0);
    let corners =
        [(0, 0, (1.0 - p) * (1.0 - q)), (1, 0, p * (1.0 - q)), (0, 1, (1.0 - p) * q), (1, 1, p * q)];
    for (dx, dy, weight) in corners {
        node.iter_mut().zip(shares.pixel(x + dx, y + dy)).for_each(|(sum, share)| *sum += weight * share);
    }
    let sum: f32 = node.iter().sum();
    node.iter_mut().for_each(|share| *share /= sum);
    sum >= MIN_VISIBLE_SHARE
}
