//! Score of a relative pose: the volumetric colour consistency of two images.
//!
//! An item of image A is a ray with a colour class k. The surface that it shows is on the ray, between the
//! floor and a height limit. If the pose is correct, image B shows the class at the projection of one point
//! of the ray, unless the surface is hidden. Let `f(v)` be the share of the class in B at the projection of a
//! point `v`, and `b` its background share in B. With an unknown point, the likelihood ratio of the item is
//! the mean over the points, mixed with a share `e` of hidden surfaces:
//!
//! ```text
//! r(v) = (f(v) + d) / (b + d)
//! F = sum over items of w log2(e + (1 - e) mean of r(v))
//! ```
//!
//! The ratio is 1 if B does not show the point. The items of B are scored in A with the inverse pose, and
//! both sums are added.

use crate::registration::class_volume::{ADDED_SHARE, MAX_RAY};
use crate::registration::colour_items::{Item, normalise_weights};
use crate::registration::direction_map::DirectionMap;
use crate::registration::pattern_search::PatternSearch;
use crate::registration::relative_pose::RelativePose;
use crate::registration::site_colours::{CameraColours, Level};

/// Assumed share `e` of outliers: items whose surface is hidden in the other image, or has another colour there.
pub(crate) const OUTLIER_SHARE: f32 = 0.15;
/// Largest height of a surface, in units of the geometric mean of the heights of both cameras.
const MAX_SURFACE_HEIGHT: f64 = 0.45;
/// Smallest horizontal distance between a point on a ray and the camera of the ray, in heights of the other camera.
pub(crate) const MIN_RAY: f64 = 0.075;
/// Factor of the prior of the height ratio, in score units: a deviation of one sigma costs this much.
pub(crate) const PRIOR_WEIGHT: f64 = 5.0;

/// Items of a camera that are scored in another camera.
struct Side<'a> {
    items: Vec<Item>,
    map: &'a DirectionMap,
    rotation: [[f32; 3]; 3],
    max_height: f64,
    level: Level,
}

/// Score of the relative poses of two cameras.
pub(crate) struct PairScore<'a> {
    /// Ratio of the given heights of the first and the second camera.
    pub(crate) ratio: f64,
    /// Scale of the prior of the log height ratio, from [`ratio_sigma`].
    sigma: f64,
    /// Distance between the first camera and the floor point about which it is rotated, in heights of the second
    /// camera.
    pub(crate) pivot_distance: f64,
    sides: [Side<'a>; 2],
}

/// Returns the largest height of a surface, in heights of the second camera. `ratio` is the ratio of the
/// heights of the first and the second camera.
pub(crate) fn max_surface_height(ratio: f64) -> f64 {
    MAX_SURFACE_HEIGHT * ratio.sqrt()
}

/// Returns the RMS of the standard deviations of the log heights of two cameras, for the prior of their ratio.
pub(crate) fn ratio_sigma([a, b]: [&CameraColours; 2]) -> f64 {
    (0.5 * (a.height_sigma.powi(2) + b.height_sigma.powi(2))).sqrt()
}

/// Returns the distance of the floor point on the optical axis, in heights of the camera. It is limited,
/// because the axis of a level camera meets no floor.
fn pivot_distance(camera: &CameraColours) -> f64 {
    /// Largest distance, in heights.
    const MAX_DISTANCE: f64 = 3.0;
    let [x, y, z] = camera.rotation[2];
    let level = x.hypot(y);
    if level < -z * MAX_DISTANCE { level / -z } else { MAX_DISTANCE }
}

/// Selects at most `count` items of each camera, and scales the weights of all items to a common sum.
pub(crate) fn select_items([a, b]: [&CameraColours; 2], level: Level, count: usize) -> [Vec<Item>; 2] {
    let mut first = a.items(level).select(&b.background, count);
    let mut second = b.items(level).select(&a.background, count);
    normalise_weights([&mut first, &mut second]);
    [first, second]
}

impl<'a> PairScore<'a> {
    /// Creates the score of a pair of cameras.
    pub(crate) fn new(pair: [&'a CameraColours; 2], level: Level) -> Self {
        Self::with_share(pair, level, 1.0)
    }

    /// Creates the score of a pair of cameras, with the fraction `share` of the usual number of items.
    pub(crate) fn with_share(pair: [&'a CameraColours; 2], level: Level, share: f64) -> Self {
        let count = match level {
            Level::Medium => 500.0,
            Level::Fine => 1200.0,
        };
        let count = (share * count) as usize;
        let [a, b] = pair;
        let ratio = a.height / b.height;
        let [first, second] = select_items(pair, level, count);
        let side = |items: Vec<Item>, target: &'a CameraColours, ratio: f64| Side {
            items,
            map: target.map(level),
            rotation: target.rotation.map(|row| row.map(|c| c as f32)),
            max_height: max_surface_height(ratio),
            level,
        };
        let sides = [side(first, b, ratio), side(second, a, 1.0 / ratio)];
        Self { ratio, sigma: ratio_sigma(pair), pivot_distance: ratio * pivot_distance(a), sides }
    }

    /// Whether neither image has an item.
    pub(crate) fn is_empty(&self) -> bool {
        self.sides.iter().all(|side| side.items.is_empty())
    }

    /// Returns the score of a pose, without the prior of the height ratio.
    pub(crate) fn colour(&self, pose: &RelativePose) -> f64 {
        let [first, second] = &self.sides;
        first.score(pose, self.ratio) + second.score(&pose.inverse(self.ratio), 1.0 / self.ratio)
    }

    /// Returns the score of a pose with the prior of the height ratio.
    pub(crate) fn score(&self, pose: &RelativePose) -> f64 {
        self.colour(pose) - PRIOR_WEIGHT * (pose.log_ratio / self.sigma).powi(2)
    }

    /// Maximises the score by a pattern search from `start`: varies one parameter at a time, and
    /// halves the steps after each of `rounds` rounds. `steps` are the first steps of yaw
    /// (radians), log height ratio, and position (in heights of camera B). Returns the score and
    /// the pose.
    pub(crate) fn climb(&self, start: &RelativePose, steps: [f64; 3], rounds: usize) -> (f64, RelativePose) {
        let search = PatternSearch { rounds, sweeps: 6, repeats_moves: false };
        let score = |parameters| self.score(&RelativePose::from_parameters(parameters));
        let (score, best) =
            search.maximise(score, start.to_parameters(), [steps[0], steps[1], steps[2], steps[2]]);
        (score, RelativePose::from_parameters(best))
    }
}

impl Side<'_> {
    /// Returns the score of the items in the target camera, for a pose of their camera. `ratio` is the given height
    /// of their camera divided by the given height of the target camera.
    fn score(&self, pose: &RelativePose, ratio: f64) -> f64 {
        match self.level {
            Level::Medium => self.score_points::<12>(pose, ratio),
            Level::Fine => self.score_points::<16>(pose, ratio),
        }
    }

    /// Returns the score with `N` points on each ray.
    fn score_points<const N: usize>(&self, pose: &RelativePose, ratio: f64) -> f64 {
        let height = (ratio * pose.log_ratio.exp()) as f32;
        let above = height - self.max_height as f32;
        let (sin, cos) = (pose.yaw.sin() as f32, pose.yaw.cos() as f32);
        let turn = |v: [f32; 3]| self.rotation.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
        let origin = turn([pose.at[0] as f32, pose.at[1] as f32, height - 1.0]);
        let mut total = 0.0;
        for item in &self.items {
            let near = (above / item.slope).max(MIN_RAY as f32);
            let far = (height / item.slope).min(MAX_RAY as f32);
            if near >= far {
                continue;
            }
            let [dx, dy] = item.heading;
            let along = turn([cos * dx - sin * dy, sin * dx + cos * dy, -item.slope]);
            let step = (far - near) / (N - 1) as f32;
            let from = std::array::from_fn(|i| origin[i] + near * along[i]);
            let mean = self.map.mean_on_ray::<N>(item.class, from, along.map(|c| step * c));
            let ratio = (mean + ADDED_SHARE) / (self.map.background(item.class) + ADDED_SHARE);
            total += f64::from(item.weight * (OUTLIER_SHARE + (1.0 - OUTLIER_SHARE) * ratio).log2());
        }
        total
    }
}
