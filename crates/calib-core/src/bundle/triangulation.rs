//! Triangulation: the position of a landmark from the cameras that observe it.
//!
//! A point at a known height needs only the ray of one camera: its position is the intersection of the ray
//! with the horizontal plane at this height. The same applies to feet of posts, points of marks and floor
//! lines. The nearest observing camera is used, because a pixel covers the least floor there. The adjustment
//! refines the position.
//!
//! Only the length of a post needs a second ray: it is the height at which the ray of its head passes over
//! the foot. The pose of a mark is the least-squares rigid motion from its points to their observed floor
//! positions (Horn 1987, in the plane).

use std::collections::{BTreeMap, BTreeSet};

use crate::bundle::landmark::{LANDMARK_PARAMS, Landmark, LandmarkModel, Observation};
use crate::camera::{Camera, FloorPoint, ObservedPixel, Plane, PosedCamera};

/// Point of a mark, relative to its origin, and its observed floor position.
type PointPair = ([f64; 2], FloorPoint);

/// Whether the position of a landmark is known in the base system, exactly or with a prior. Such a landmark
/// fixes the gauge.
pub(crate) fn is_known(landmark: &Landmark) -> bool {
    landmark.free == [false; LANDMARK_PARAMS]
        || landmark.model == LandmarkModel::Measured
        || is_measured_mark(landmark)
}

/// Whether a landmark is a mark with a measured position. Its rotation may be unknown.
fn is_measured_mark(landmark: &Landmark) -> bool {
    matches!(landmark.model, LandmarkModel::Mark { .. }) && landmark.is_measured()
}

/// Whether the position of a point of a known landmark is known before the adjustment.
///
/// All points are known if the landmark is not a mark, or its rotation is fixed. Otherwise the points on the
/// vertical axis are known. If no such point is observed, the initial rotation is used for all points.
pub(crate) fn is_known_point(landmark: &Landmark, point: usize) -> bool {
    let LandmarkModel::Mark { points, .. } = &landmark.model else { return true };
    let is_on_axis = |point: usize| points.get(point).is_some_and(|[x, y, _]| x.hypot(*y) < 1e-9);
    !landmark.free[2] || is_on_axis(point) || !landmark.observations.iter().any(|seen| is_on_axis(seen.point))
}

/// Triangulates a landmark from the cameras selected by `by`. Returns its model (for a line with its origin)
/// and parameters; fixed parameters keep their values. Returns `None` if the observations are not sufficient.
pub fn triangulate(
    landmark: &Landmark,
    cameras: &[Camera],
    by: &dyn Fn(usize) -> bool,
) -> Option<(LandmarkModel, [f64; LANDMARK_PARAMS])> {
    let seen = || -> Vec<Observation> {
        landmark.observations.iter().filter(|seen| by(seen.view)).copied().collect()
    };
    if is_known(landmark) {
        let [x, y, mut third] = landmark.params;
        if landmark.free[2] && is_measured_mark(landmark) {
            third = from_observations(landmark, &seen(), cameras).map_or(third, |(_, [_, _, turn])| turn);
        }
        return Some((landmark.model.clone(), [x, y, third]));
    }
    let (model, found) = from_observations(landmark, &seen(), cameras)?;
    let params = std::array::from_fn(|k| if landmark.free[k] { found[k] } else { landmark.params[k] });
    params.iter().all(|value| value.is_finite()).then_some((model, params))
}

/// Triangulates a landmark from the observations `seen`, with all parameters free. Returns its model and
/// parameters.
fn from_observations(
    landmark: &Landmark,
    seen: &[Observation],
    cameras: &[Camera],
) -> Option<(LandmarkModel, [f64; LANDMARK_PARAMS])> {
    let third = landmark.params[2];
    Some(match &landmark.model {
        LandmarkModel::Measured => (LandmarkModel::Measured, landmark.params),
        LandmarkModel::Point { height } => {
            let at = nearest_floor_position(seen, cameras, 0, &landmark.ground.raised(*height))?;
            (landmark.model.clone(), [at.x, at.y, third])
        }
        LandmarkModel::Post => {
            let foot = nearest_floor_position(seen, cameras, 0, &landmark.ground)?;
            let initial = if third > 0.0 { third } else { 1.0 };
            let length = post_length(seen, cameras, &foot);
            let length = length.map_or(initial, |length| length - landmark.ground.height_at(foot));
            (LandmarkModel::Post, [foot.x, foot.y, length])
        }
        LandmarkModel::Mark { z, points } => {
            let pairs = points_on_floor(seen, cameras, &landmark.ground.raised(*z), points)?;
            let fixed_turn = (!landmark.free[2]).then_some(third);
            (landmark.model.clone(), rigid_motion(&pairs, fixed_turn, third))
        }
        LandmarkModel::Line { .. } => {
            let (a, b) = longest_segment(seen, cameras, &landmark.ground)?;
            let origin = [0.5 * (a.x + b.x), 0.5 * (a.y + b.y)];
            (LandmarkModel::Line { origin }, [0.0, (b.y - a.y).atan2(b.x - a.x), 0.0])
        }
    })
}

/// Returns the distance on the floor from the foot of a camera to a floor point, in metres.
fn floor_distance(camera: &Camera, at: &FloorPoint) -> f64 {
    at.distance(camera.position.on_floor())
}

/// Returns the floor position at which the ray of a landmark point meets `plane`, from the nearest camera
/// that observes the point.
fn nearest_floor_position(
    seen: &[Observation],
    cameras: &[Camera],
    point: usize,
    plane: &Plane,
) -> Option<FloorPoint> {
    let on_floor = |seen: &Observation| {
        let camera = &cameras[seen.view];
        let at = camera.pixel_to_plane(seen.pixel, plane)?.on_floor();
        Some((floor_distance(camera, &at), at))
    };
    let candidates = seen.iter().filter(|seen| seen.point == point).filter_map(on_floor);
    candidates.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
}

/// Returns the height at which the ray of a head passes over the foot, in metres.
fn post_length(seen: &[Observation], cameras: &[Camera], foot: &FloorPoint) -> Option<f64> {
    seen.iter().filter(|seen| seen.point == 1).find_map(|head| {
        let camera = &cameras[head.view];
        let ray = camera.pixel_to_ray(head.pixel)?;
        let level = ray.direction[0].hypot(ray.direction[1]);
        let length = ray.origin.z + ray.direction[2] / level * floor_distance(camera, foot);
        (length > 0.01).then_some(length)
    })
}

/// Returns the points of a mark and their floor positions from one camera. It is the camera that observes the most
/// points, or the nearest of several such cameras.
fn points_on_floor(
    seen: &[Observation],
    cameras: &[Camera],
    ground: &Plane,
    points: &[[f64; 3]],
) -> Option<Vec<PointPair>> {
    let mut by_view: BTreeMap<usize, Vec<PointPair>> = BTreeMap::new();
    for seen in seen {
        let Some(&[x, y, up]) = points.get(seen.point) else { continue };
        if let Some(at) = cameras[seen.view].pixel_to_plane(seen.pixel, &ground.raised(up)) {
            by_view.entry(seen.view).or_default().push(([x, y], at.on_floor()));
        }
    }
    let candidates = by_view
        .into_iter()
        .map(|(view, pairs)| (pairs.len(), floor_distance(&cameras[view], &pairs[0].1), pairs));
    candidates.max_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1))).map(|(_, _, pairs)| pairs)
}

/// Returns the ends of a floor line from the camera that observes its longest segment.
fn longest_segment(
    seen: &[Observation],
    cameras: &[Camera],
    ground: &Plane,
) -> Option<(FloorPoint, FloorPoint)> {
    let mut by_view: BTreeMap<usize, Vec<FloorPoint>> = BTreeMap::new();
    for seen in seen {
        if let Some(at) = cameras[seen.view].pixel_to_plane(seen.pixel, ground) {
            by_view.entry(seen.view).or_default().push(at.on_floor());
        }
    }
    let ends = by_view.into_values().filter_map(|points| Some((*points.first()?, *points.last()?)));
    ends.filter(|(a, b)| a != b).max_by(|(a, b), (c, d)| a.distance(*b).total_cmp(&c.distance(*d)))
}

/// Estimates the translation and rotation from the points of a mark to their observed positions. Returns x
/// and y of the origin of the mark, in metres, and the rotation, in radians.
///
/// Let p be a point of the mark and q its observed position, both relative to their centroids. With
/// `c = sum p . q` and `s = sum p x q`, the rotation `atan2(s, c)` minimises the sum of squares. `fixed_turn`
/// overrides it, and `default_turn` is used if the points do not determine it.
fn rigid_motion(pairs: &[PointPair], fixed_turn: Option<f64>, default_turn: f64) -> [f64; 3] {
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&PointPair) -> f64| pairs.iter().map(value).sum::<f64>() / count;
    let (px, py) = (mean(&|p| p.0[0]), mean(&|p| p.0[1]));
    let (qx, qy) = (mean(&|p| p.1.x), mean(&|p| p.1.y));
    let (mut dot, mut cross) = (0.0, 0.0);
    for ([x, y], at) in pairs {
        let (x, y, u, v) = (x - px, y - py, at.x - qx, at.y - qy);
        dot += x * u + y * v;
        cross += x * v - y * u;
    }
    let is_determined = dot.hypot(cross) > 1e-9;
    let turn = fixed_turn.unwrap_or(if is_determined { cross.atan2(dot) } else { default_turn });
    let (sin, cos) = turn.sin_cos();
    [qx - cos * px + sin * py, qy - sin * px - cos * py, turn]
}

/// Whether a landmark is visible in every camera that observes it. The observed pixels must be inside the lens.
/// Except for a line, the points must be in front of the camera.
pub(crate) fn is_visible(landmark: &Landmark, cameras: &[Camera]) -> bool {
    let is_line = matches!(landmark.model, LandmarkModel::Line { .. });
    landmark.observations.iter().all(|seen| {
        let camera = cameras[seen.view];
        let at = landmark.point(seen.point);
        let observed = ObservedPixel::new(seen.pixel, &camera.lens);
        observed.is_some_and(|observed| {
            is_line || PosedCamera::new(camera).reproject(at, observed.chart.as_ref()).is_some()
        })
    })
}

/// Returns the squared floor distances, in square metres, between the positions of one landmark point computed from
/// two cameras. There is one entry for each point and each pair of observing cameras, the lower index first. A line
/// has no entries.
pub fn floor_disagreements(landmark: &Landmark, cameras: &[Camera]) -> Vec<([usize; 2], f64)> {
    if matches!(landmark.model, LandmarkModel::Line { .. }) {
        return Vec::new();
    }
    let points: BTreeSet<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
    // The height of a head is a free parameter. Only points of known height can be compared.
    let is_head = |point: usize| landmark.model == LandmarkModel::Post && point > 0;
    let mut disagreements = Vec::new();
    for point in points.into_iter().filter(|&point| !is_head(point)) {
        let seen = floor_positions(landmark, point, cameras);
        for (i, (a, at)) in seen.iter().enumerate() {
            for (b, other) in seen[i + 1..].iter().filter(|(b, _)| b != a) {
                disagreements.push(([*a.min(b), *a.max(b)], at.distance(*other).powi(2)));
            }
        }
    }
    disagreements
}

/// Returns the floor position of a landmark point from every camera that observes it, at its height in the
/// model.
pub(crate) fn floor_positions(
    landmark: &Landmark,
    point: usize,
    cameras: &[Camera],
) -> Vec<(usize, FloorPoint)> {
    let plane = landmark.plane_at_point(point);
    let seen = landmark.observations.iter().filter(|seen| seen.point == point);
    seen.filter_map(|seen| {
        Some((seen.view, cameras[seen.view].pixel_to_plane(seen.pixel, &plane)?.on_floor()))
    })
    .collect()
}
