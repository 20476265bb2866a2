//! Predicted relative error of lengths on the floor: one number for the accuracy of a calibration.
//!
//! A 5 x 5 grid of pixels in the EFOV is projected to the floor. [`FloorJacobian`] is a point in camera
//! heights with its derivatives with respect to roll, pitch and log focal length. The log length between two
//! points has the gradient `g` with respect to the parameters. With their covariance C its variance is `g' C g`.
//! The result is the root of the mean variance of all pairs ([`floor_length_rel`]). After stage 2 the covariance of the
//! placed camera is used, including height and lens ([`placed_floor_length_rel`]).

use crate::camera::{Camera, Covariance, FloorPoint, Lens, Pixel};
use crate::single::residual::{LOG_FOCAL, PITCH, Parameters, ROLL};
use nalgebra::Matrix4;

/// Number of points per side of the grid.
const POINTS_PER_SIDE: usize = 5;

/// Grid of points in the EFOV, between which lengths are predicted; bilinear between four corners.
///
/// The points are bearings: undistorted pixels relative to the principal point, homogeneous.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid(Vec<[f64; 3]>);

impl Grid {
    /// Creates the grid inside an image polygon, for example the annotated EFOV. If the polygon does not have four
    /// corners, the grid spans the corners that are farthest along the diagonals.
    pub(crate) fn from_polygon(camera: &Camera, corners: &[Pixel]) -> Self {
        let [a, b, c, d] = four_corners(corners);
        let points = (0..POINTS_PER_SIDE * POINTS_PER_SIDE).filter_map(|k| {
            let (s, t) = (
                (k % POINTS_PER_SIDE) as f64 / (POINTS_PER_SIDE - 1) as f64,
                (k / POINTS_PER_SIDE) as f64 / (POINTS_PER_SIDE - 1) as f64,
            );
            let mix = |value: fn(&Pixel) -> f64| {
                (1.0 - t) * ((1.0 - s) * value(&a) + s * value(&b))
                    + t * ((1.0 - s) * value(&d) + s * value(&c))
            };
            camera.lens.bearing(Pixel { u: mix(|p| p.u), v: mix(|p| p.v) })
        });
        Self(points.collect())
    }

    /// Creates the grid between the corners of a floor polygon, for example the default EFOV, as seen by the
    /// camera.
    pub(crate) fn from_floor(camera: &Camera, polygon: &[FloorPoint]) -> Self {
        let pixels: Vec<Pixel> =
            polygon.iter().filter_map(|p| camera.world_to_pixel(p.at_height(0.0))).collect();
        if pixels.len() < 3 { Self(Vec::new()) } else { Self::from_polygon(camera, &pixels) }
    }
}

/// Returns the corners of a quadrilateral in order, or the corners of a polygon that are farthest along the
/// diagonals.
fn four_corners(corners: &[Pixel]) -> [Pixel; 4] {
    if let [a, b, c, d] = *corners {
        return [a, b, c, d];
    }
    let farthest = |su: f64, sv: f64| {
        let along = |p: &&Pixel| su * p.u + sv * p.v;
        corners.iter().max_by(|a, b| along(a).total_cmp(&along(b))).copied().unwrap_or_default()
    };
    [farthest(-1.0, 1.0), farthest(1.0, 1.0), farthest(1.0, -1.0), farthest(-1.0, -1.0)]
}

/// Returns the root mean square of the predicted relative standard deviations of lengths between all pairs of
/// grid points on the floor.
///
/// A log length with the gradient `g` has the variance `g' C g`. If the height is unknown, the common scale
/// is not an error, and the mean of `g` is subtracted. Returns `None` if fewer than three grid points are on
/// the floor.
pub(crate) fn floor_length_rel(
    parameters: &Parameters,
    grid: &Grid,
    covariance: &Matrix4<f64>,
    height_known: bool,
) -> Option<f64> {
    let points = grid.0.iter().filter_map(|&bearing| {
        let FloorJacobian { at, by: [roll, pitch, focal], .. } = FloorJacobian::new(parameters, bearing)?;
        Some((at, [roll, pitch, focal, [0.0; 2]]))
    });
    let points: Vec<([f64; 2], [[f64; 2]; 4])> = points.collect();
    length_rel(&points, |k, l| covariance[(k, l)], height_known)
}

/// Computes [`floor_length_rel`] from floor points in camera heights with their derivatives with respect to `N`
/// unknowns; the fourth unknown is the log height.
fn length_rel<const N: usize>(
    points: &[([f64; 2], [[f64; 2]; N])],
    covariance: impl Fn(usize, usize) -> f64,
    height_known: bool,
) -> Option<f64> {
    if points.len() < 3 {
        return None;
    }
    let mut mean = [0.0; N];
    let mut square = [[0.0; N]; N];
    let mut count = 0.0;
    for (i, a) in points.iter().enumerate() {
        for b in &points[..i] {
            let (dx, dy) = (a.0[0] - b.0[0], a.0[1] - b.0[1]);
            let inverse = (dx * dx + dy * dy).max(f64::MIN_POSITIVE).recip();
            let gradient: [f64; N] = std::array::from_fn(|k| match k {
                3 => 1.0,
                _ => (dx * (a.1[k][0] - b.1[k][0]) + dy * (a.1[k][1] - b.1[k][1])) * inverse,
            });
            count += 1.0;
            for k in 0..N {
                mean[k] += gradient[k];
                for l in 0..=k {
                    square[k][l] += gradient[k] * gradient[l];
                }
            }
        }
    }
    let mut variance = 0.0;
    for k in 0..N {
        for l in 0..N {
            let product = square[k.max(l)][k.min(l)] / count;
            let common = if height_known { 0.0 } else { mean[k] * mean[l] / (count * count) };
            variance += covariance(k, l) * (product - common);
        }
    }
    variance.is_finite().then(|| variance.max(0.0).sqrt())
}

/// Computes the error of floor lengths of a placed camera as `floor_length_rel` does, but with the whole
/// covariance of the camera, including the lens.
///
/// Also returns `None` if the uncertainty of the camera is unknown.
pub fn placed_floor_length_rel(camera: &Camera, grid: &Grid) -> Option<f64> {
    placed_length_rel(camera, grid, camera.covariance.sigma(Covariance::Z).is_some())
}

/// Computes [`placed_floor_length_rel`] for ratios of lengths: without the error of the common scale.
pub fn placed_floor_shape_rel(camera: &Camera, grid: &Grid) -> Option<f64> {
    placed_length_rel(camera, grid, false)
}

/// Computes the error of floor lengths of a placed camera; without the error of the common scale unless
/// `height_known`.
fn placed_length_rel(camera: &Camera, grid: &Grid, height_known: bool) -> Option<f64> {
    if !camera.covariance.is_known() {
        return None;
    }
    /// Number of unknowns: roll, pitch, log focal length, log height, and the parameters of the lens.
    const N: usize = 4 + Lens::PARAMETERS;
    let parameters =
        [camera.roll, camera.pitch, camera.focal.ln(), camera.position.z.abs().max(f64::MIN_POSITIVE).ln()];
    let fitted: [bool; Lens::PARAMETERS] =
        std::array::from_fn(|k| camera.covariance.sigma(Covariance::LENS + k).is_some());
    let has_one_focal = camera.shares_lens_focal();
    let point = |&bearing: &[f64; 3]| {
        let floor = FloorJacobian::new(&parameters, bearing)?;
        let mut jacobian = [[0.0; 2]; N];
        jacobian[..3].copy_from_slice(&floor.by);
        if fitted.contains(&true) || has_one_focal {
            let by_lens = camera.lens.bearing_by_parameters(camera.lens.bearing_to_pixel(bearing)?, bearing);
            let [by_x, by_y, by_w] = floor.by_bearing;
            let moved = |k: usize| {
                let [dx, dy, dw] = by_lens[k].at;
                [0, 1].map(|axis| dx * by_x[axis] + dy * by_y[axis] + dw * by_w[axis])
            };
            (0..Lens::PARAMETERS).filter(|&k| fitted[k]).for_each(|k| jacobian[4 + k] = moved(k));
            if has_one_focal {
                let [x, y] = moved(Lens::LENS_FOCAL);
                jacobian[2] = [jacobian[2][0] + x, jacobian[2][1] + y];
            }
        }
        Some((floor.at, jacobian))
    };
    let points: Vec<([f64; 2], [[f64; 2]; N])> = grid.0.iter().filter_map(point).collect();
    let index = |k: usize| match k {
        0 => Covariance::ROLL,
        1 => Covariance::PITCH,
        2 => Covariance::FOCAL,
        3 => Covariance::Z,
        _ => Covariance::LENS + k - 4,
    };
    // Conversion from focal length and height to their logs.
    let scale = |k: usize| match k {
        2 => camera.focal.recip(),
        3 => camera.position.z.recip(),
        _ => 1.0,
    };
    let covariance = |k: usize, l: usize| camera.covariance.0[index(k)][index(l)] * scale(k) * scale(l);
    length_rel(&points, covariance, height_known)
}

/// Floor point in camera heights, with its derivatives with respect to roll, pitch, log focal length and bearing.
struct FloorJacobian {
    /// Floor point, in camera heights.
    at: [f64; 2],
    /// Derivatives of the floor point with respect to roll, pitch and log focal length.
    by: [[f64; 2]; 3],
    /// Derivatives of the floor point with respect to the components x, y and w of the bearing.
    by_bearing: [[f64; 2]; 3],
}

impl FloorJacobian {
    /// Projects a bearing to the floor; `None` on or above the horizon.
    ///
    /// With the unrolled bearing (u, v, w): `D = v cos p + f w sin p`, `X = u / D`,
    /// `Y = (f w cos p - v sin p) / D`.
    fn new(parameters: &Parameters, [x, y, w]: [f64; 3]) -> Option<Self> {
        let ((sr, cr), (sp, cp), f) =
            (parameters[ROLL].sin_cos(), parameters[PITCH].sin_cos(), parameters[LOG_FOCAL].exp());
        let forward = f * w;
        let (u, v) = (cr * x - sr * y, sr * x + cr * y);
        let (depth, ahead) = (cp * v + sp * forward, cp * forward - sp * v);
        if depth <= 1e-6 * f {
            return None;
        }
        let at = [u / depth, ahead / depth];
        // Derivative of a quotient N / D: (dN - at dD) / D. dN and dD are the derivatives with respect to roll
        // (du = -v, dv = u), pitch and log focal length.
        let quotient = |du: f64, d_ahead: f64, d_depth: f64| {
            [(du - at[0] * d_depth) / depth, (d_ahead - at[1] * d_depth) / depth]
        };
        let by = [
            quotient(-v, -sp * u, cp * u),
            quotient(0.0, -depth, ahead),
            quotient(0.0, cp * forward, sp * forward),
        ];
        // The unrolled bearing rotates with the bearing. With the roll r, (du, dv) is (cos r, sin r) with respect
        // to x, and (-sin r, cos r) with respect to y.
        let by_bearing = [
            quotient(cr, -sp * sr, cp * sr),
            quotient(-sr, -sp * cr, cp * cr),
            quotient(0.0, cp * f, sp * f),
        ];
        Some(Self { at, by, by_bearing })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn floor_jacobian_matches_finite_differences(camera in any_camera(), x in -900.0..900.0_f64, y in -100.0..500.0_f64) {
            const STEP: f64 = 1e-6;
            let parameters = [camera.roll, camera.pitch, camera.focal.ln(), 0.0];
            let Some(here) = FloorJacobian::new(&parameters, [x, y, 1.0]) else { return Ok(()) };
            prop_assume!(here.at[1].abs() < 50.0);
            for k in 0..3 {
                let at = |sign: f64| {
                    let mut nudged = parameters;
                    nudged[k] += sign * STEP;
                    FloorJacobian::new(&nudged, [x, y, 1.0]).map(|p| p.at)
                };
                let (Some(a), Some(b)) = (at(1.0), at(-1.0)) else { continue };
                for axis in 0..2 {
                    let numeric = (a[axis] - b[axis]) / (2.0 * STEP);
                    prop_assert!((numeric - here.by[k][axis]).abs() < 1e-3 * (1.0 + numeric.abs()), "{k} {axis}: {numeric} {:?}", here.by[k]);
                }
            }
            for (k, [dx, dy, dw]) in [[1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0], [0.0, 0.0, 1e-6]].into_iter().enumerate() {
                let at = |sign: f64| FloorJacobian::new(&parameters, [x + sign * dx, y + sign * dy, 1.0 + sign * dw]).map(|p| p.at);
                let (Some(a), Some(b)) = (at(1.0), at(-1.0)) else { continue };
                for axis in 0..2 {
                    let numeric = (a[axis] - b[axis]) / (2.0 * (dx + dy + dw));
                    prop_assert!((numeric - here.by_bearing[k][axis]).abs() < 1e-3 * (1e-3 + numeric.abs()), "{k} {axis}: {numeric} {:?}", here.by_bearing[k]);
                }
            }
        }

        #[test]
        fn relative_height_error_equals_the_error_of_every_length(camera in any_camera()) {
            let parameters = [camera.roll, camera.pitch.max(0.4), camera.focal.ln(), 0.0];
            let grid = Grid((0..25).map(|k| [f64::from(k % 5) * 300.0 - 600.0, f64::from(k / 5) * 90.0 + 20.0, 1.0]).collect());
            let mut covariance = Matrix4::zeros();
            covariance[(3, 3)] = 0.02_f64.powi(2);
            if let Some(known) = floor_length_rel(&parameters, &grid, &covariance, true) {
                prop_assert!((known - 0.02).abs() < 1e-12);
                prop_assert!(floor_length_rel(&parameters, &grid, &covariance, false).is_some_and(|rel| rel < 1e-9), "the common scale is not an error");
            }
        }
    }
}
