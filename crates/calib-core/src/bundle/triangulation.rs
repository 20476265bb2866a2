//! Where cameras put a landmark that they show, and how far they disagree about it.

use std::collections::{BTreeMap, BTreeSet};

use crate::bundle::landmark::{LANDMARK_PARAMS, Landmark, LandmarkModel, Observation};
use crate::camera::{Camera, Distortion, FloorPoint, ObservedPixel, PosedCamera};

/// A point of a mark, relative to its foot, and where it was seen on the floor.
type Seen = ([f64; 2], FloorPoint);

/// A landmark whose place is given.
pub(crate) fn is_known(landmark: &Landmark) -> bool {
    landmark.free == [false; LANDMARK_PARAMS] || landmark.model == LandmarkModel::Measured
}

/// Where cameras put a landmark: the nearest of them that shows enough of it.
pub(crate) fn triangulate(
    landmark: &Landmark,
    cameras: &[Camera],
    by: &dyn Fn(usize) -> bool,
) -> Option<(LandmarkModel, [f64; LANDMARK_PARAMS])> {
    if is_known(landmark) {
        return Some((landmark.model.clone(), landmark.place));
    }
    let seen: Vec<Observation> = landmark.observations.iter().filter(|seen| by(seen.view)).copied().collect();
    let third = landmark.place[2];
    let (model, found) = match &landmark.model {
        LandmarkModel::Measured => (LandmarkModel::Measured, landmark.place),
        LandmarkModel::Point { height } => {
            let at = nearest(&seen, cameras, 0, *height)?;
            (landmark.model.clone(), [at.x, at.y, third])
        }
        LandmarkModel::Post => {
            let foot = nearest(&seen, cameras, 0, 0.0)?;
            let length = post_length(&seen, cameras, &foot).unwrap_or(if third > 0.0 { third } else { 1.0 });
            (LandmarkModel::Post, [foot.x, foot.y, length])
        }
        LandmarkModel::Mark { z, points } => {
            let told = seen_points(&seen, cameras, *z, points)?;
            (landmark.model.clone(), rigid(&told, (!landmark.free[2]).then_some(third), third))
        }
        LandmarkModel::Line { .. } => {
            let (a, b) = longest_segment(&seen, cameras)?;
            let origin = [0.5 * (a.x + b.x), 0.5 * (a.y + b.y)];
            (LandmarkModel::Line { origin }, [0.0, (b.y - a.y).atan2(b.x - a.x), 0.0])
        }
    };
    let place = std::array::from_fn(|k| if landmark.free[k] { found[k] } else { landmark.place[k] });
    place.iter().all(|value| value.is_finite()).then_some((model, place))
}

fn away(camera: &Camera, at: &FloorPoint) -> f64 {
    at.distance(camera.position.on_floor())
}

/// Where the nearest camera that shows a point puts it.
fn nearest(seen: &[Observation], cameras: &[Camera], point: usize, height: f64) -> Option<FloorPoint> {
    let on_floor = |seen: &Observation| {
        let camera = &cameras[seen.view];
        let at = camera.pixel_to_floor(seen.pixel, height)?;
        Some((away(camera, &at), at))
    };
    let reprojected = seen.iter().filter(|seen| seen.point == point).filter_map(on_floor);
    reprojected.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
}

/// The height at which the ray of a head passes over the foot.
fn post_length(seen: &[Observation], cameras: &[Camera], foot: &FloorPoint) -> Option<f64> {
    seen.iter().filter(|seen| seen.point == 1).find_map(|head| {
        let camera = &cameras[head.view];
        let ray = camera.pixel_to_ray(head.pixel)?;
        let level = ray.direction[0].hypot(ray.direction[1]);
        let length = ray.origin.z + ray.direction[2] / level * away(camera, foot);
        (length > 0.01).then_some(length)
    })
}

/// Points of a mark as one camera puts them: the one that shows most, and of those the nearest.
fn seen_points(seen: &[Observation], cameras: &[Camera], z: f64, points: &[[f64; 3]]) -> Option<Vec<Seen>> {
    let mut d_view: BTreeMap<usize, Vec<Seen>> = BTreeMap::new();
    for seen in seen {
        let Some(&[x, y, up]) = points.get(seen.point) else { continue };
        if let Some(at) = cameras[seen.view].pixel_to_floor(seen.pixel, z + up) {
            d_view.entry(seen.view).or_default().push(([x, y], at));
        }
    }
    let found = d_view.into_iter().map(|(view, told)| (told.len(), away(&cameras[view], &told[0].1), told));
    found.max_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1))).map(|(_, _, told)| told)
}

/// Ends of a floor line as the camera puts them that shows most of it.
fn longest_segment(seen: &[Observation], cameras: &[Camera]) -> Option<(FloorPoint, FloorPoint)> {
    let mut d_view: BTreeMap<usize, Vec<FloorPoint>> = BTreeMap::new();
    for seen in seen {
        if let Some(at) = cameras[seen.view].pixel_to_floor(seen.pixel, 0.0) {
            d_view.entry(seen.view).or_default().push(at);
        }
    }
    let ends = d_view.into_values().filter_map(|points| Some((*points.first()?, *points.last()?)));
    ends.filter(|(a, b)| a != b).max_by(|(a, b), (c, d)| a.distance(*b).total_cmp(&c.distance(*d)))
}

/// Move and turn that take points of a mark to where they were seen; the turn as it was where they do
/// not tell it.
fn rigid(pairs: &[Seen], held: Option<f64>, usual: f64) -> [f64; 3] {
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&Seen) -> f64| pairs.iter().map(value).sum::<f64>() / count;
    let (px, py) = (mean(&|p| p.0[0]), mean(&|p| p.0[1]));
    let (qx, qy) = (mean(&|p| p.1.x), mean(&|p| p.1.y));
    let (mut along, mut cross_covariance) = (0.0, 0.0);
    for ([x, y], at) in pairs {
        let (x, y, u, v) = (x - px, y - py, at.x - qx, at.y - qy);
        along += x * u + y * v;
        cross_covariance += x * v - y * u;
    }
    let told = along.hypot(cross_covariance) > 1e-9;
    let turn = held.unwrap_or(if told { cross_covariance.atan2(along) } else { usual });
    let (sin, cos) = turn.sin_cos();
    [qx - cos * px + sin * py, qy - sin * px - cos * py, turn]
}

/// Whether every camera that saw it shows it at all.
pub(crate) fn is_shown(landmark: &Landmark, cameras: &[Camera]) -> bool {
    let is_line = matches!(landmark.model, LandmarkModel::Line { .. });
    landmark.observations.iter().all(|seen| {
        let camera = cameras[seen.view];
        let at = landmark.model.point(&landmark.place, seen.point).0;
        let is_in_lens = ObservedPixel::new(seen.pixel, &camera.lens, [false; Distortion::MOST]).is_some();
        is_in_lens && (is_line || PosedCamera::new(camera).reproject(at).is_some())
    })
}

/// Squared distances on the floor between where two cameras put the same point of a landmark, for every
/// two cameras that show it, the lower index first.
pub(crate) fn floor_disagreements(landmark: &Landmark, cameras: &[Camera]) -> Vec<([usize; 2], f64)> {
    if matches!(landmark.model, LandmarkModel::Line { .. }) {
        return Vec::new();
    }
    let seen = |point: usize| {
        let height = landmark.model.point(&landmark.place, point).0.z;
        let at = landmark.observations.iter().filter(move |seen| seen.point == point);
        at.filter_map(move |seen| Some((seen.view, cameras[seen.view].pixel_to_floor(seen.pixel, height)?)))
            .collect::<Vec<_>>()
    };
    let points: BTreeSet<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
    let mut measurements = Vec::new();
    for point in points {
        // A head's height is an unknown of its own: only what stands on the floor or at a known height.
        if landmark.model == LandmarkModel::Post && point > 0 {
            continue;
        }
        let seen = seen(point);
        for (i, (a, at)) in seen.iter().enumerate() {
            for (b, other) in seen[i + 1..].iter().filter(|(b, _)| b != a) {
                measurements.push(([*a.min(b), *a.max(b)], at.distance(*other).powi(2)));
            }
        }
    }
    measurements
}
