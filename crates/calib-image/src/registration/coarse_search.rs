//! Exhaustive search of the relative pose: all yaws, three height ratios, and all positions on a grid.
//!
//! For a yaw and a height ratio, the points of a ray are fixed offsets from the camera. The score of an item
//! for all positions is therefore a sum of shifted planes of the class volume.

use crate::registration::class_volume::{
    ADDED_SHARE, CELL, CELLS, ClassVolume, LEVEL, LEVELS, MAX_RAY, PADDING, STRIDE, UNIT, cell_centre,
};
use crate::registration::colour_items::Item;
use crate::registration::pair_score::{
    MIN_RAY, OUTLIER_SHARE, max_surface_height, ratio_sigma, select_items,
};
use crate::registration::relative_pose::{RelativePose, wrapped};
use crate::registration::site_colours::{CameraColours, Level};

/// Number of tested yaws.
const YAWS: usize = 48;
/// First yaw, in radians. It is not a multiple of the step, so that right angles are not preferred.
const FIRST_YAW: f64 = 0.03;
/// Logs of the tested height ratios, relative to the ratio of the heights that the cameras have before the search. If
/// both heights are measured, only this ratio is tested.
const LOG_RATIOS: [f64; 3] = [0.0, -0.1625, 0.1655];
/// Value of [`ratio_sigma`] below which only the first of [`LOG_RATIOS`] is tested.
const MAX_KNOWN_SIGMA: f64 = 0.05;
/// Largest number of colour items of each camera.
const ITEM_COUNT: usize = 300;
/// Number of points on the ray of an item.
const POINTS: usize = 5;
/// Largest number of poses that the search returns.
const PEAK_COUNT: usize = 40;
/// Largest number of these poses on one ridge of the score.
const MAX_PEAKS_PER_RIDGE: usize = 3;
/// Largest difference of yaw and of baseline direction between two poses on one ridge of the score, in radians.
pub(crate) const RIDGE_TOLERANCE: f64 = 8.0 * std::f64::consts::PI / 180.0;

/// Scores of all positions of a camera, row by row, for one yaw and height ratio.
type Grid = Vec<f32>;

/// Returns the poses with the largest coarse scores, the best first.
pub(crate) fn coarse_peaks(pair: [&CameraColours; 2]) -> Vec<RelativePose> {
    let [a, b] = pair;
    let ratio = a.height / b.height;
    let [first, second] = select_items(pair, Level::Medium, ITEM_COUNT);
    let count = if ratio_sigma(pair) < MAX_KNOWN_SIGMA { 1 } else { LOG_RATIOS.len() };
    let mut scores = vec![f32::NEG_INFINITY; YAWS * CELLS * CELLS];
    let mut ratios = vec![0.0; YAWS * CELLS * CELLS];
    for (index, scores) in scores.chunks_exact_mut(CELLS * CELLS).enumerate() {
        let yaw = yaw(index);
        for &log_ratio in &LOG_RATIOS[..count] {
            let height = ratio * f64::exp(log_ratio);
            let forward = grid(&first, &b.volume, yaw, height, max_surface_height(ratio));
            let back = grid(&second, &a.volume, -yaw, 1.0 / height, max_surface_height(1.0 / ratio));
            for (cell, score) in scores.iter_mut().enumerate() {
                let at = [cell_centre(cell % CELLS), cell_centre(cell / CELLS)];
                let inverse = RelativePose { yaw, log_ratio, at }.inverse(ratio);
                let sum = forward[cell] + interpolate(&back, inverse.at);
                if sum > *score {
                    *score = sum;
                    ratios[index * CELLS * CELLS + cell] = log_ratio;
                }
            }
        }
    }
    peaks(&scores, &ratios)
}

/// Returns the yaw of an index, in radians.
fn yaw(index: usize) -> f64 {
    wrapped(FIRST_YAW + index as f64 * 2.0 * std::f64::consts::PI / YAWS as f64)
}

/// Computes the scores of the items of a camera at all its positions in the volume of another camera. `height` is
/// the height of the camera, `max_height` the largest height of a surface, both in heights of the other camera.
fn grid(items: &[Item], volume: &ClassVolume, yaw: f64, height: f64, max_height: f64) -> Grid {
    let mut scores = vec![0.0; CELLS * CELLS];
    let (sin, cos) = yaw.sin_cos();
    for item in items {
        let slope = f64::from(item.slope);
        let (near, far) = (((height - max_height) / slope).max(MIN_RAY), (height / slope).min(MAX_RAY));
        if near >= far {
            continue;
        }
        let [dx, dy] = item.heading.map(f64::from);
        let heading = [cos * dx - sin * dy, sin * dx + cos * dy];
        let points: [&[u16]; POINTS] = std::array::from_fn(|i| {
            let distance = near + (far - near) * i as f64 / (POINTS - 1) as f64;
            let level = ((height - distance * slope) / LEVEL).round().clamp(0.0, (LEVELS - 1) as f64);
            let shift = heading.map(|c| {
                let limit = PADDING as f64;
                ((c * distance / CELL).round().clamp(-limit, limit) + limit) as usize
            });
            &volume.plane(item.class, level as usize)[shift[1] * STRIDE + shift[0]..]
        });
        add_item(&mut scores, points, f32::from(volume.background[item.class]), item.weight);
    }
    scores
}

/// Adds the score of one item at all positions. `points` contains the plane of each point of its ray, from
/// the first position on.
///
/// The logarithm to base 2 of the likelihood ratio is approximated by the bits of a floating-point number. It is
/// exact at powers of 2, therefore also for the ratio 1 (no evidence).
fn add_item(scores: &mut [f32], points: [&[u16]; POINTS], background: f32, weight: f32) {
    /// Difference of the bits of two floating-point numbers, read as integers, if the ratio of the numbers is 2.
    const OCTAVE: f32 = 8_388_608.0;
    let factor = (1.0 - OUTLIER_SHARE) / (background + ADDED_SHARE);
    let constant = OUTLIER_SHARE + factor * ADDED_SHARE;
    let (factor, scale) = (factor / POINTS as f32, weight / OCTAVE);
    for (row, scores) in scores.chunks_exact_mut(CELLS).enumerate() {
        let mut sums = [0_u16; CELLS];
        for point in points {
            let line = &point[row * STRIDE..][..CELLS];
            sums.iter_mut().zip(line).for_each(|(sum, share)| *sum = sum.wrapping_add(*share));
        }
        for (score, sum) in scores.iter_mut().zip(sums) {
            let bits = (constant + factor * f32::from(sum)).to_bits().cast_signed() - 0x3f80_0000;
            *score += scale * bits as f32;
        }
    }
}

/// Interpolates a grid at a position; 0 outside the grid.
fn interpolate(grid: &Grid, at: [f64; 2]) -> f32 {
    let [x, y] = at.map(|c| (c / CELL + 0.5 * CELLS as f64 - 0.5) as f32);
    let last = (CELLS - 1) as f32;
    if !(x >= 0.0 && y >= 0.0 && x < last && y < last) {
        return 0.0;
    }
    let (column, row) = (x as usize, y as usize);
    let (p, q) = (x - column as f32, y - row as f32);
    let at = |row: usize| {
        let [left, right] = [grid[row * CELLS + column], grid[row * CELLS + column + 1]];
        left + p * (right - left)
    };
    at(row) + q * (at(row + 1) - at(row))
}

/// Returns the largest local maxima, with a limited number on each ridge.
fn peaks(scores: &[f32], ratios: &[f64]) -> Vec<RelativePose> {
    /// Number of cells with the largest scores, among which the peaks are searched.
    const CANDIDATE_COUNT: usize = 60_000;
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_unstable_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
    let mut is_used = vec![false; scores.len()];
    let mut found: Vec<RelativePose> = Vec::new();
    for &index in order.iter().take(CANDIDATE_COUNT) {
        if found.len() >= PEAK_COUNT {
            break;
        }
        if is_used[index] {
            continue;
        }
        let (turn, y, x) = (index / (CELLS * CELLS), index / CELLS % CELLS, index % CELLS);
        for turn in [turn + YAWS - 1, turn, turn + 1].map(|turn| turn % YAWS) {
            for row in y.saturating_sub(1)..(y + 2).min(CELLS) {
                let start = (turn * CELLS + row) * CELLS;
                is_used[start + x.saturating_sub(1)..start + (x + 2).min(CELLS)].fill(true);
            }
        }
        let pose =
            RelativePose { yaw: yaw(turn), log_ratio: ratios[index], at: [cell_centre(x), cell_centre(y)] };
        let is_near = |other: &&RelativePose| pose.is_on_ridge(other, RIDGE_TOLERANCE);
        if found.iter().filter(is_near).count() < MAX_PEAKS_PER_RIDGE {
            found.push(pose);
        }
    }
    found
}

/// Check that the sum of the shares of all points of a ray fits in 16 bits.
const _: () = assert!(UNIT * POINTS as f32 <= 65535.0);
