//! One walker as cameras see them at moments that are a step apart.

use nalgebra::{Matrix2, SMatrix, Vector2};

use crate::stature::Sighting;
use calib_core::camera::{Camera, Covariance, Pixel};

/// Errors of a camera: place, angles and focal.
pub(crate) const ERRORS: usize = Covariance::LENS;
/// Seconds between two sightings of one camera within which the walker is where a straight line puts them.
const GAP: f64 = 1.2;
/// Two views of one person differ so far, in metres.
const BODY: f64 = 0.08;
/// A sighting farther than this from where the others put the walker, in metres, is of somebody else.
const ANOTHER: f64 = 1.5;

/// Derivatives of a floor point by the errors of its camera.
pub(crate) type Errors = SMatrix<f64, 2, ERRORS>;

/// One camera's view of a moment.
pub(crate) struct View {
    pub(crate) camera: usize,
    pub(crate) point: Vector2<f64>,
    pub(crate) covariance: Matrix2<f64>,
    pub(crate) slopes: Errors,
}

/// Sightings at the moments between two, if they are near enough to each other.
pub(crate) fn interpolated(from: Sighting, to: Sighting, step: i64) -> Vec<(i64, Sighting)> {
    let length = to.at - from.at;
    if length <= 0 || length as f64 > GAP * 1e9 {
        return Vec::new();
    }
    let first = from.at.div_euclid(step) + 1;
    (first..=to.at.div_euclid(step))
        .map(|moment| {
            let at = moment * step;
            let share = (at - from.at) as f64 / length as f64;
            let mix = |a: f64, b: f64| a + share * (b - a);
            let between = |a: Pixel, b: Pixel| Pixel::new(mix(a.u, b.u), mix(a.v, b.v));
            let head = from.head.zip(to.head).map(|(a, b)| between(a, b));
            (at, Sighting { at, foot: between(from.foot, to.foot), head, ..from })
        })
        .collect()
}

/// The walker as a camera shows them; `None` where that is no place of the floor.
pub(crate) fn view(index: usize, camera: &Camera, sighting: &Sighting) -> Option<View> {
    let point = camera.pixel_to_floor(sighting.foot, 0.0)?;
    let slopes = camera.floor_slopes(sighting.foot)?;
    let by_pixel = Matrix2::from(slopes.by_pixel);
    let sigma = sighting.foot_sigma();
    let covariance = by_pixel * by_pixel.transpose() * (sigma * sigma) + Matrix2::identity() * (BODY * BODY);
    let by: [[f64; 2]; ERRORS] = std::array::from_fn(|i| slopes.by_camera[i]);
    Some(View { camera: index, point: Vector2::new(point.x, point.y), covariance, slopes: Errors::from(by) })
}

/// The views that are of the walker: those that are near the one that most others are near to.
pub(crate) fn of_one(views: Vec<View>) -> Vec<View> {
    let reach = |a: &View, b: &View| {
        let spread = (a.covariance + b.covariance).symmetric_eigenvalues().max().max(0.0).sqrt();
        (a.point - b.point).norm() < ANOTHER + 3.0 * spread
    };
    let near = |a: &View| views.iter().filter(|b| reach(a, b)).count();
    let Some(middle) = (0..views.len()).max_by_key(|&i| near(&views[i])) else { return views };
    if views.len() > 2 && near(&views[middle]) < 2 || views.len() == 2 && near(&views[0]) < 2 {
        return Vec::new();
    }
    let keep: Vec<bool> = views.iter().map(|view| reach(view, &views[middle])).collect();
    views.into_iter().zip(keep).filter(|(_, keep)| *keep).map(|(view, _)| view).collect()
}

/// Where views together put the walker, and their weights.
pub(crate) fn place_of(views: &[View]) -> Option<(Vector2<f64>, Vec<Matrix2<f64>>)> {
    let weights: Option<Vec<Matrix2<f64>>> = views.iter().map(|view| view.covariance.try_inverse()).collect();
    let weights = weights?;
    let sum: Vector2<f64> = views.iter().zip(&weights).map(|(view, weight)| weight * view.point).sum();
    Some((weights.iter().sum::<Matrix2<f64>>().try_inverse()? * sum, weights))
}
