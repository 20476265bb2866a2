//! Views of one walker from several cameras, interpolated to common moments.

use nalgebra::{Matrix2, SMatrix, Vector2};

use crate::stature::Sighting;
use calib_core::camera::{Camera, Covariance, Pixel};

/// Number of error parameters of a camera: x, y, z, yaw, pitch, roll and focal length.
pub(crate) const ERROR_PARAMS: usize = Covariance::LENS;
/// Longest time between two sightings of one camera for linear interpolation, in seconds.
const MAX_INTERPOLATION_GAP_S: f64 = 1.2;
/// Standard deviation of the floor position of a walker in one view, in metres, in addition to the noise of
/// the box.
const BODY_SIGMA_M: f64 = 0.08;
/// Distance between the floor positions of two views above which they show different people, in metres. A margin for
/// the noise of the positions is added to it.
const MAX_SAME_PERSON_DISTANCE_M: f64 = 1.5;

/// Derivatives of a floor point with respect to the errors of its camera.
pub(crate) type ErrorJacobian = SMatrix<f64, 2, ERROR_PARAMS>;

/// View of the walker from one camera at one moment.
pub(crate) struct View {
    /// Index of the camera.
    pub(crate) camera: usize,
    /// Floor position, in metres.
    pub(crate) point: Vector2<f64>,
    /// Covariance of `point` from the noise of the foot and [`BODY_SIGMA_M`], in square metres.
    pub(crate) covariance: Matrix2<f64>,
    /// Derivatives of `point` with respect to the errors of the camera.
    pub(crate) slopes: ErrorJacobian,
}

/// Interpolates two sightings of one camera to the moments between them, at multiples of `step` nanoseconds.
/// The result is empty if the sightings are too far apart in time.
pub(crate) fn interpolated(from: Sighting, to: Sighting, step: i64) -> Vec<(i64, Sighting)> {
    let length = to.at - from.at;
    if length <= 0 || length as f64 > MAX_INTERPOLATION_GAP_S * 1e9 {
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

/// Returns the view of the walker from the camera with this index; `None` if the foot is not on the floor.
pub(crate) fn view(index: usize, camera: &Camera, sighting: &Sighting) -> Option<View> {
    let point = camera.pixel_to_floor(sighting.foot, 0.0)?;
    let slopes = camera.floor_derivatives(sighting.foot)?;
    let by_pixel = Matrix2::from(slopes.by_pixel);
    let sigma = sighting.foot_sigma();
    let covariance = by_pixel * by_pixel.transpose() * (sigma * sigma)
        + Matrix2::identity() * (BODY_SIGMA_M * BODY_SIGMA_M);
    let by: [[f64; 2]; ERROR_PARAMS] = std::array::from_fn(|i| slopes.by_camera[i]);
    Some(View {
        camera: index,
        point: Vector2::new(point.x, point.y),
        covariance,
        slopes: ErrorJacobian::from(by),
    })
}

/// Selects the views of the walker: all views close to the view with the most neighbours. The result is empty
/// if no two of several views agree.
pub(crate) fn consistent_views(views: Vec<View>) -> Vec<View> {
    let reach = |a: &View, b: &View| {
        let spread = (a.covariance + b.covariance).symmetric_eigenvalues().max().max(0.0).sqrt();
        (a.point - b.point).norm() < MAX_SAME_PERSON_DISTANCE_M + 3.0 * spread
    };
    let near = |a: &View| views.iter().filter(|b| reach(a, b)).count();
    let Some(middle) = (0..views.len()).max_by_key(|&i| near(&views[i])) else { return views };
    if views.len() > 2 && near(&views[middle]) < 2 || views.len() == 2 && near(&views[0]) < 2 {
        return Vec::new();
    }
    let keep: Vec<bool> = views.iter().map(|view| reach(view, &views[middle])).collect();
    views.into_iter().zip(keep).filter(|(_, keep)| *keep).map(|(view, _)| view).collect()
}

/// Returns the weighted mean of the floor positions of the views, in metres, and the weights (inverse
/// covariances).
pub(crate) fn fused_position(views: &[View]) -> Option<(Vector2<f64>, Vec<Matrix2<f64>>)> {
    let weights: Option<Vec<Matrix2<f64>>> = views.iter().map(|view| view.covariance.try_inverse()).collect();
    let weights = weights?;
    let sum: Vector2<f64> = views.iter().zip(&weights).map(|(view, weight)| weight * view.point).sum();
    Some((weights.iter().sum::<Matrix2<f64>>().try_inverse()? * sum, weights))
}
