//! Resection of one more camera from landmarks that are triangulated already: the step by which the
//! initialisation proceeds along the view graph.
//!
//! Roll, pitch, focal and lens are known from stage 1; position and yaw are unknown. Observed points serve
//! as control points; where they are too few, points and floor lines together give a similarity of the
//! floor.

use nalgebra::{DMatrix, DVector, SVD};

use crate::bundle::landmark::{LANDMARK_PARAMS, Landmark, LandmarkModel};
use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::floor::{ControlPoint, from_control_points};

/// A landmark with its triangulated parameters.
pub(crate) type PlacedLandmark = (Landmark, [f64; LANDMARK_PARAMS]);

/// The camera number `view` placed so that it shows these landmarks where they are; at `height`, if given.
pub(crate) fn attach(
    camera: &Camera,
    view: usize,
    height: Option<f64>,
    landmarks: &[PlacedLandmark],
) -> Option<Camera> {
    let points = control_points(view, landmarks.iter().map(|(landmark, place)| (landmark, *place)));
    by_points(camera, &points, height).or_else(|| by_points_and_lines(camera, view, landmarks))
}

/// Points of the base system with the pixels of a camera that show them.
pub(crate) fn control_points<'a>(
    view: usize,
    landmarks: impl Iterator<Item = (&'a Landmark, [f64; LANDMARK_PARAMS])>,
) -> Vec<ControlPoint> {
    let points = landmarks.filter(|(landmark, _)| !matches!(landmark.model, LandmarkModel::Line { .. }));
    let seen = points.flat_map(|(landmark, place)| {
        let own = landmark.observations.iter().filter(move |seen| seen.view == view);
        own.map(move |seen| (seen.pixel, landmark.model.point(&place, seen.point, &landmark.ground).0))
    });
    seen.map(|(pixel, world)| ControlPoint { pixel, world }).collect()
}

/// Resection robust to outliers: of the placements by pairs of points and by all, the one of least median
/// error (least median of squares, Rousseeuw 1984), fitted again to its inliers.
fn by_points(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    /// A point is an inlier up to this multiple of the median error.
    const INLIER_RATIO: f64 = 5.0;
    /// A point is an inlier up to this error, in pixels.
    const INLIER_PIXELS: f64 = 4.0;
    if points.len() < 4 {
        return from_control_points(camera, points, height);
    }
    let few = spread(points);
    let tried = pairs(few.len()).filter_map(|(i, j)| from_control_points(camera, &[few[i], few[j]], height));
    let all = from_control_points(camera, points, height);
    let scored = tried.chain(all).map(|camera| (median(errors(&camera, &few)), camera));
    let (_, best) = scored.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let errors = errors(&best, points);
    let limit = (INLIER_RATIO * median(errors.clone())).max(INLIER_PIXELS);
    let inliers: Vec<ControlPoint> =
        points.iter().zip(&errors).filter(|(_, error)| **error <= limit).map(|(point, _)| *point).collect();
    from_control_points(camera, &inliers, height).or(Some(best))
}

/// As many points as tell a median well, spread over all of them.
fn spread(points: &[ControlPoint]) -> Vec<ControlPoint> {
    const ENOUGH: usize = 400;
    points.iter().step_by(points.len().div_ceil(ENOUGH).max(1)).copied().collect()
}

/// The pairs of so many that are tried, spread over all of them.
fn pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    const MOST: usize = 60;
    let step = (count * (count - 1) / 2).div_ceil(MOST);
    (0..count).flat_map(move |i| (i + 1..count).map(move |j| (i, j))).step_by(step)
}

/// Reprojection errors of the points, in raw pixels.
fn errors(camera: &Camera, points: &[ControlPoint]) -> Vec<f64> {
    let error = |point: &ControlPoint| {
        camera
            .world_to_pixel(point.world)
            .map_or(f64::INFINITY, |reprojected| reprojected.distance(point.pixel))
    };
    points.iter().map(error).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The similarity of the floor that takes points to points and segments into lines.
///
/// With `a = s cos t`, `b = s sin t` for scale `s` and turn `t`, a point (x, y) of the camera's own floor
/// goes to `(a x - b y + x0, b x + a y + y0)`: two equations linear in a, b, x0, y0 for a point, and one,
/// their projection on the line's normal, for each end of a segment of a line.
fn by_points_and_lines(camera: &Camera, view: usize, landmarks: &[PlacedLandmark]) -> Option<Camera> {
    let rows = similarity_equations(camera, view, landmarks);
    if rows.len() < 4 {
        return None;
    }
    let matrix = DMatrix::from_fn(rows.len(), 4, |i, j| rows[i].0[j]);
    let right = DVector::from_fn(rows.len(), |i, _| rows[i].1);
    let svd = SVD::new(matrix, true, true);
    let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
    let solution = (least > 1e-6 * most).then(|| svd.solve(&right, 0.0).ok()).flatten()?;
    let [a, b, x, y] = [solution[0], solution[1], solution[2], solution[3]];
    let scale = a.hypot(b);
    let position = WorldPoint::new(x, y, scale * camera.position.z);
    (scale > 1e-3).then_some(Camera { position, yaw: b.atan2(a), ..*camera })
}

/// Coefficients of a, b, x0, y0 and right-hand side of every equation.
fn similarity_equations(camera: &Camera, view: usize, landmarks: &[PlacedLandmark]) -> Vec<([f64; 4], f64)> {
    let mut rows = Vec::new();
    for (landmark, place) in landmarks {
        for seen in landmark.observations.iter().filter(|seen| seen.view == view) {
            let world = landmark.model.point(place, seen.point, &landmark.ground).0;
            let Some(FloorPoint { x, y }) = camera.pixel_to_floor(seen.pixel, world.z) else { continue };
            let normals: &[[f64; 2]] = match landmark.model {
                LandmarkModel::Line { .. } => &[[-place[1].sin(), place[1].cos()]],
                _ => &[[1.0, 0.0], [0.0, 1.0]],
            };
            rows.extend(
                normals
                    .iter()
                    .map(|[m, n]| ([m * x + n * y, n * x - m * y, *m, *n], m * world.x + n * world.y)),
            );
        }
    }
    rows
}
