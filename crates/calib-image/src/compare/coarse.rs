//! Coarse rotation and zoom between two images, from matched corners, to a few pixels.
//!
//! Two matches determine a rotation and a zoom. The angle between their old rays is known, with the cosine
//! `cos`. Let `p` and `q` be the new corners relative to the principal point. The angle gives a quadratic
//! equation in the square of the new focal length `f`:
//!
//! ```text
//! (p q + f^2)^2 = cos^2 (p p + f^2)(q q + f^2)
//! ```
//!
//! (Brown, Hartley, Nister 2007). The products are scalar products. The pair with the most inliers is used
//! (RANSAC, Fischler and Bolles 1981). Inliers are counted with a limit for each part of the image, so that
//! one pallet full of corners does not dominate.

use calib_core::{Camera, Pixel, UndistortedPixel};

use calib_core::camera::{RotatedCamera, RotationZoom};

use crate::{EdgeOffset, FitParameters, RotationFit, STEP_SIZE, TONE_SIZE};

use crate::compare::feature::Luma;
use crate::compare::feature::{DESCRIPTOR_ROTATION, Feature, Match, features, matches};
use crate::compare::motion::Sight;
use crate::xor_shift::XorShift;

/// Unit vectors along the axes of the image.
pub(crate) const AXES: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];
/// Largest ratio, in either direction, of the new to the old focal length.
const MAX_ZOOM_RATIO: f64 = 2.2;
/// Largest distance of an inlier corner from its predicted position, in pixels of the scale at which the corner was
/// detected.
const MAX_INLIER_DISTANCE_PX: f64 = 3.5;
/// Number of pairs of matches whose motions are tested.
const PAIR_COUNT: usize = 4000;
/// Columns and rows of the parts of the image, for counting inliers.
const PARTS: [usize; 2] = [12, 8];
/// Largest number of inliers counted in one part.
const MAX_INLIERS_PER_PART: usize = 3;

/// Matched corner: a ray of the old camera and a pixel of the new image.
pub(crate) struct CornerMatch {
    /// Ray in the axes of the old camera.
    pub(crate) sight: Sight,
    /// Position in the new image, in raw pixels.
    pub(crate) at: Pixel,
    /// Position in the new image without distortion.
    new: UndistortedPixel,
    /// Largest distance of an inlier from its predicted position, in pixels.
    pub(crate) max_distance: f64,
    /// Index of the part of the old image, for counting inliers.
    pub(crate) part: usize,
}

/// Matches the corners of two images, the least ambiguous first. `upright` are the corners of the old image.
pub(crate) fn corners(camera: &Camera, old: &Luma, upright: &[Feature], new: &Luma) -> Vec<CornerMatch> {
    let found = matches(upright, &features(new, &[-DESCRIPTOR_ROTATION, 0.0, DESCRIPTOR_ROTATION]));
    let seen = |found: &Match| -> Option<CornerMatch> {
        let [c, r] = [found.old.u / old.width as f64, found.old.v / old.height as f64];
        let [columns, rows] = PARTS;
        let part = (r * rows as f64) as usize * columns + (c * columns as f64) as usize;
        let (sight, new) = (Sight::new(camera, found.old)?, camera.undistort(found.new)?);
        Some(CornerMatch {
            sight,
            at: found.new,
            new,
            max_distance: MAX_INLIER_DISTANCE_PX * found.size,
            part,
        })
    };
    found.iter().filter_map(seen).collect()
}

/// Estimates rotation and zoom from matched corners; `None` if too few agree.
pub(crate) fn coarse_rotation(camera: &Camera, seen: &[CornerMatch]) -> Option<RotationZoom> {
    /// Smallest inlier count of a rotation; fewer inliers occur by chance.
    const MIN_COVERAGE: usize = 8;
    let (turn, count) = best_pair(camera, seen)?;
    (count >= MIN_COVERAGE).then(|| refine_rotation(camera, seen, turn))
}

/// Returns the rotation and zoom of the pair of matches with the highest inlier count, and this count.
/// Returns `None` if no pair determines a rotation.
fn best_pair(camera: &Camera, seen: &[CornerMatch]) -> Option<(RotationZoom, usize)> {
    let candidates = |[a, b]: [&CornerMatch; 2]| rotations_from_pair(camera, a, b);
    best_of_pairs(seen, candidates, |turn| inlier_coverage(&turn.for_camera(camera), seen))
}

/// Tests the motions that random pairs of matches determine (RANSAC). Returns the motion with the highest inlier
/// count, and this count; `None` if no pair determines a motion. `matches` are sorted, the least ambiguous first.
pub(crate) fn best_of_pairs<M, T: Copy, I: IntoIterator<Item = T>>(
    matches: &[M],
    candidates: impl Fn([&M; 2]) -> I,
    inliers: impl Fn(&T) -> usize,
) -> Option<(T, usize)> {
    /// Number of the least ambiguous matches that yield the first pairs.
    const FIRST_MATCH_COUNT: usize = 20;
    let mut chance = XorShift(0x9e37_79b9_7f4a_7c15);
    let mut best: Option<(T, usize)> = None;
    for round in 0..PAIR_COUNT {
        let among = (FIRST_MATCH_COUNT + round * matches.len() / (PAIR_COUNT / 2)).min(matches.len());
        if among < 2 {
            return None;
        }
        let pair = [0, 1].map(|_| &matches[chance.below(among)]);
        for motion in candidates(pair) {
            let count = inliers(&motion);
            if best.is_none_or(|(_, most)| count > most) {
                best = Some((motion, count));
            }
        }
    }
    best
}

/// Counts the inliers of a rotated camera, limited to a few for each part of the image.
fn inlier_coverage(camera: &RotatedCamera, seen: &[CornerMatch]) -> usize {
    coverage(seen.iter().filter(|seen| is_inlier(camera, seen)))
}

/// Counts corners, limited to a few for each part of the image.
pub(crate) fn coverage<'a>(seen: impl Iterator<Item = &'a CornerMatch>) -> usize {
    let mut parts = [0; PARTS[0] * PARTS[1] + PARTS[0]];
    for seen in seen {
        parts[seen.part] += 1;
    }
    parts.iter().map(|&count: &usize| count.min(MAX_INLIERS_PER_PART)).sum()
}

/// Whether a match is at the position that the rotation predicts.
fn is_inlier(turned: &RotatedCamera, seen: &CornerMatch) -> bool {
    turned
        .ray_to_undistorted(seen.sight.ray)
        .is_some_and(|shown| shown.distance(seen.new) < seen.max_distance)
}

/// Computes the rotations and zooms that map the rays of two matches to their new pixels.
fn rotations_from_pair(camera: &Camera, a: &CornerMatch, b: &CornerMatch) -> Vec<RotationZoom> {
    let centre = camera.lens.principal_point;
    let [p, q] = [a.new, b.new].map(|pixel| [pixel.u - centre.u, pixel.v - centre.v]);
    let flat = |p: [f64; 2], q: [f64; 2]| p[0] * q[0] + p[1] * q[1];
    let (pq, pp, qq) = (flat(p, q), flat(p, p), flat(q, q));
    let [r, s] = [a.sight.ray, b.sight.ray].map(unit);
    let square = dot(r, s).powi(2);
    let (two, one, none) = (1.0 - square, 2.0 * pq - square * (pp + qq), pq * pq - square * pp * qq);
    let inner = one * one - 4.0 * two * none;
    // Rays less than one degree apart do not determine the focal length.
    if two < 3e-4 || inner < 0.0 {
        return Vec::new();
    }
    let focals = [-1.0, 1.0].map(|sign| (sign * inner.sqrt() - one) / (2.0 * two));
    let focals = focals.into_iter().filter(|&square| square > 0.0).map(f64::sqrt);
    let is_near = |focal: &f64| (MAX_ZOOM_RATIO.recip()..MAX_ZOOM_RATIO).contains(&(focal / camera.focal));
    let turn = |focal: f64| {
        let [x, y] = [p, q].map(|p| unit([p[0], p[1], focal]));
        Some(RotationZoom::from_rotation(&rotation_between([r, s], [x, y])?, (focal / camera.focal).ln()))
    };
    focals.filter(is_near).filter_map(turn).collect()
}

/// Computes the rotation matrix that maps the two unit vectors `from` to the two unit vectors `to`. If the
/// angles of the pairs differ, the result is the least-squares rotation. Returns `None` for parallel vectors.
fn rotation_between(from: [[f64; 3]; 2], to: [[f64; 3]; 2]) -> Option<[[f64; 3]; 3]> {
    let frame = |[a, b]: [[f64; 3]; 2]| {
        let (sum, difference) = (sum(a, b), sum(a, b.map(|c| -c)));
        let frame = [unit(sum), unit(difference), unit(cross(sum, difference))];
        frame.iter().flatten().all(|c| c.is_finite()).then_some(frame)
    };
    let (from, to) = (frame(from)?, frame(to)?);
    Some(std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| to[k][i] * from[k][j]).sum())))
}

/// Refines rotation and zoom with all inliers.
fn refine_rotation(camera: &Camera, seen: &[CornerMatch], mut turn: RotationZoom) -> RotationZoom {
    for _ in 0..4 {
        let turned = turn.for_camera(camera);
        let rows = seen
            .iter()
            .filter(|seen| is_inlier(&turned, seen))
            .flat_map(|seen| match_offsets(camera, &turn, seen));
        let rows: Vec<EdgeOffset> = rows.flatten().collect();
        let Some(fit) = RotationFit::new(&rows, FitParameters::Rotation) else { return turn };
        turn = turn.followed_by(&fit.rotation());
    }
    turn
}

/// Converts the deviations of a match from its predicted position, along u and v, to two edge offsets.
fn match_offsets(camera: &Camera, turn: &RotationZoom, seen: &CornerMatch) -> [Option<EdgeOffset>; 2] {
    /// Step of the finite differences, in radians or as the log of the focal ratio.
    const DIFFERENCE_STEP: f64 = 1e-5;
    let shown = |turn: &RotationZoom| turn.for_camera(camera).ray_to_undistorted(seen.sight.ray);
    let Some(here) = shown(turn) else { return [None; 2] };
    let mut by = [[0.0; RotationZoom::SIZE]; 2];
    for k in 0..RotationZoom::SIZE {
        let mut step = [0.0; RotationZoom::SIZE];
        step[k] = DIFFERENCE_STEP;
        let Some(there) = shown(&turn.followed_by(&RotationZoom::from_parameters(step))) else {
            return [None; 2];
        };
        by[0][k] = (there.u - here.u) / DIFFERENCE_STEP;
        by[1][k] = (there.v - here.v) / DIFFERENCE_STEP;
    }
    let off = [seen.new.u - here.u, seen.new.v - here.v];
    let row = |axis: usize| EdgeOffset {
        offset: off[axis],
        across: AXES[axis],
        sigma: 0.2 * seen.max_distance,
        by_rotation: by[axis],
        by_tone: [0.0; TONE_SIZE],
        by_step: [0.0; STEP_SIZE],
        block: seen.part,
        edge: None,
    };
    [0, 1].map(|axis| Some(row(axis)))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|c| c / length)
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
