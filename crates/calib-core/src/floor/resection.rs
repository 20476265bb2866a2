//! Camera resection: position and yaw from control points, for a camera with known roll, pitch, focal length
//! and lens.
//!
//! The camera is at (x0, y0, z0). Let `d = (dx, dy, dz)` be the ray of a pixel at yaw 0, in world axes. Let
//! (X, Y) be the control point of the pixel, at height h. The closed form uses:
//!
//! `dz X = dz x0 + (h - z0) (dx cos yaw - dy sin yaw)` and
//! `dz Y = dz y0 + (h - z0) (dx sin yaw + dy cos yaw)`.
//!
//! These equations are linear in x0, y0, `z0 cos yaw`, `z0 sin yaw`, `cos yaw`, `sin yaw`. If all points have
//! one height h, they determine only `(z0 - h) cos yaw` and `(z0 - h) sin yaw`. The equations are therefore
//! solved in both forms, with and without a common height. The solution with the smallest error in pixels is
//! refined by Levenberg-Marquardt.

use nalgebra::{DMatrix, DVector, Matrix4, SVD, Vector4};

use crate::camera::{
    Camera, Covariance, Lens, ObservedPixel, Pixel, PosedCamera, Reprojection, UndistortedPixel, WorldPoint,
    camera_from_world, multiply,
};
use crate::optimize::{LeastSquares, least_squares};

/// Control point: a pixel, and the known world position of the point that it shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlPoint {
    /// Raw pixel of the point.
    pub pixel: Pixel,
    /// World position of the point, in metres.
    pub world: WorldPoint,
}

/// Standard deviations of the errors of a control point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlPointNoise {
    /// Standard deviation of u and of v of the pixel, in pixels.
    pub pixel: f64,
    /// Standard deviations of x, y and z of the world position, in metres.
    pub world: [f64; 3],
}

/// Computes the position and yaw of a camera from control points. Roll, pitch, focal length and lens equal
/// those of `camera`. If `height` is given, in metres, the height of the camera is fixed to it.
///
/// The result minimises the sum of the squared reprojection errors, in undistorted pixels; for a wide lens in
/// raw pixels. The start is a closed form. Returns `None` for fewer than two visible points, and for points
/// that do not determine the position.
#[must_use]
pub fn from_control_points(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    let shown: Vec<ControlPoint> =
        points.iter().copied().filter(|point| camera.lens.bearing(point.pixel).is_some()).collect();
    if shown.len() < 2 {
        return None;
    }
    let start = closed_form(camera, &shown, height)?;
    let mut found = refined(start, &shown, height.is_some());
    let half = std::f64::consts::PI;
    found.yaw = (found.yaw + half).rem_euclid(2.0 * half) - half;
    // Points at one pixel, or behind the camera, do not determine the position.
    let is_placed = square_error(&found, &shown).is_finite() && found.position.is_finite();
    let unknowns = if height.is_some() { 3 } else { 4 };
    (is_placed && pose_jacobian(&found, &shown).rank(1e-9) >= unknowns).then_some(found)
}

/// Returns the derivatives of the pixels of the points with respect to position and yaw, divided by the focal
/// length.
fn pose_jacobian(camera: &Camera, points: &[ControlPoint]) -> DMatrix<f64> {
    let unknowns = [Covariance::X, Covariance::Y, Covariance::Z, Covariance::YAW];
    let columns = unknowns.map(|index| pixel_derivatives(camera, points, index));
    // At distances of some metres, a metre and a radian have comparable effects.
    DMatrix::from_fn(2 * points.len(), unknowns.len(), |i, j| columns[j][i] / camera.focal)
}

/// Returns the rays of the pixels of the control points at yaw 0, in world axes.
fn rays(camera: &Camera, points: &[ControlPoint]) -> Vec<[f64; 3]> {
    let unturned = Camera { yaw: 0.0, ..*camera };
    points.iter().filter_map(|point| Some(unturned.pixel_to_ray(point.pixel)?.direction)).collect()
}

/// Returns the solution of the linear equations with the smallest error in pixels.
fn closed_form(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    let rays = rays(camera, points);
    let count = points.len() as f64;
    // World coordinates may be large, as in a national grid. The equations therefore use coordinates relative
    // to their mean.
    let middle = |value: fn(&WorldPoint) -> f64| points.iter().map(|p| value(&p.world)).sum::<f64>() / count;
    let centre = WorldPoint::new(middle(|p| p.x), middle(|p| p.y), middle(|p| p.z));
    let candidates = [one_height(&rays, points, centre), all_heights(&rays, points, centre)];
    candidates
        .into_iter()
        .flatten()
        .flatten()
        .map(|(x, y, z, yaw)| {
            let z = height.unwrap_or(z);
            Camera { position: WorldPoint { x, y, z }, yaw, ..*camera }
        })
        .min_by(|a, b| square_error(a, points).total_cmp(&square_error(b, points)))
}

/// Returns x, y, z (metres) and yaw (radians) of the solutions above and below the points, if all points are
/// at the mean height `h`. The unknowns are x0, y0, `(z0 - h) cos yaw`, `(z0 - h) sin yaw`.
fn one_height(
    rays: &[[f64; 3]],
    points: &[ControlPoint],
    centre: WorldPoint,
) -> Option<[(f64, f64, f64, f64); 2]> {
    let mut matrix = DMatrix::zeros(2 * rays.len(), 4);
    let mut right = DVector::zeros(2 * rays.len());
    for (i, ([dx, dy, dz], point)) in rays.iter().zip(points).enumerate() {
        matrix.row_mut(2 * i).copy_from_slice(&[*dz, 0.0, -dx, *dy]);
        matrix.row_mut(2 * i + 1).copy_from_slice(&[0.0, *dz, -dy, -dx]);
        right[2 * i] = dz * (point.world.x - centre.x);
        right[2 * i + 1] = dz * (point.world.y - centre.y);
    }
    let x = SVD::new(matrix, true, true).solve(&right, 1e-12).ok()?;
    let drop = x[2].hypot(x[3]);
    let (x0, y0) = (centre.x + x[0], centre.y + x[1]);
    (drop > 0.0).then(|| {
        [(x0, y0, centre.z + drop, x[3].atan2(x[2])), (x0, y0, centre.z - drop, (-x[3]).atan2(-x[2]))]
    })
}

/// Returns x, y, z (metres) and yaw (radians) of the solutions above and below the mean height of points of different
/// heights. The unknowns are x0, y0, `z0 cos yaw`, `z0 sin yaw`, `cos yaw`, `sin yaw`, with heights relative to
/// their mean.
fn all_heights(
    rays: &[[f64; 3]],
    points: &[ControlPoint],
    centre: WorldPoint,
) -> Option<[(f64, f64, f64, f64); 2]> {
    let mut matrix = DMatrix::zeros(2 * rays.len(), 6);
    let mut right = DVector::zeros(2 * rays.len());
    for (i, ([dx, dy, dz], point)) in rays.iter().zip(points).enumerate() {
        let h = point.world.z - centre.z;
        matrix.row_mut(2 * i).copy_from_slice(&[*dz, 0.0, -dx, *dy, h * dx, -h * dy]);
        matrix.row_mut(2 * i + 1).copy_from_slice(&[0.0, *dz, -dy, -dx, h * dy, h * dx]);
        right[2 * i] = dz * (point.world.x - centre.x);
        right[2 * i + 1] = dz * (point.world.y - centre.y);
    }
    let x = SVD::new(matrix, true, true).solve(&right, 1e-12).ok()?;
    // The first pair has the direction of the yaw if z0 > 0, and the opposite direction if z0 < 0. The sum or
    // difference of the pairs weights each pair by its length.
    Some([1.0, -1.0].map(|sign| {
        let yaw = (sign * x[3] + x[5]).atan2(sign * x[2] + x[4]);
        let z0 = x[2] * yaw.cos() + x[3] * yaw.sin();
        (centre.x + x[0], centre.y + x[1], centre.z + z0, yaw)
    }))
}

/// Returns the sum of the squared distances of the points from their pixels, in undistorted pixels; for a
/// wide lens in raw pixels.
fn square_error(camera: &Camera, points: &[ControlPoint]) -> f64 {
    let off = |point: &ControlPoint| camera.world_to_pixel(point.world).map(|at| at.distance(point.pixel));
    if camera.lens.distortion.is_wide() {
        return points.iter().map(|point| off(point).map_or(f64::INFINITY, |off| off * off)).sum();
    }
    points
        .iter()
        .map(|point| match (camera.world_to_undistorted(point.world), camera.undistort(point.pixel)) {
            (Some(shown), Some(drawn)) => shown.distance(drawn).powi(2),
            _ => f64::INFINITY,
        })
        .sum()
}

/// Returns the camera with the covariance of its placement by control points. The covariance is propagated
/// from the errors of the points, and from the covariance of all other parameters: roll, pitch, focal length
/// and the parameters of the lens. If `is_height_fixed`, the height has no error. The camera is unchanged if its
/// uncertainty is unknown, or if the points do not determine the placement.
///
/// Let `A` be the derivatives of the pixels with respect to position and yaw `q`. Let `B` be the derivatives
/// with respect to the other estimated parameters `p`. Then `dq = -(A'A)^-1 A' (B dp + noise)`. A world
/// error of a point moves its pixel as the opposite movement of the camera does.
#[must_use]
pub fn with_placement_covariance(
    camera: &Camera,
    points: &[(ControlPoint, ControlPointNoise)],
    is_height_fixed: bool,
) -> Camera {
    if !camera.covariance.is_known() {
        return *camera;
    }
    let placed = [Covariance::X, Covariance::Y, Covariance::Z, Covariance::YAW];
    let is_free = |&index: &usize| !(is_height_fixed && index == Covariance::Z);
    let q: Vec<usize> = placed.into_iter().filter(is_free).collect();
    let is_estimated = |index: &usize| camera.covariance.sigma(*index).is_some();
    let p: Vec<usize> = (Covariance::PITCH..Covariance::SIZE).filter(is_estimated).collect();
    let (shown, noises): (Vec<ControlPoint>, Vec<ControlPointNoise>) =
        points.iter().copied().filter(|(point, _)| camera.world_to_pixel(point.world).is_some()).unzip();
    let jacobian = |unknowns: &[usize]| {
        let columns: Vec<Vec<f64>> =
            unknowns.iter().map(|&index| pixel_derivatives(camera, &shown, index)).collect();
        DMatrix::from_fn(2 * shown.len(), unknowns.len(), |i, j| columns[j][i])
    };
    let by_place = jacobian(&q);
    let Some(inverse) = (by_place.transpose() * &by_place).try_inverse() else { return *camera };
    let by_noise = inverse * by_place.transpose();
    let gain = -(&by_noise * jacobian(&p));
    let by_world = jacobian(&placed[..3]);
    let known = DMatrix::from_fn(p.len(), p.len(), |i, j| camera.covariance.0[p[i]][p[j]]);
    let across = &gain * &known;
    let mut place = &across * gain.transpose();
    for (point, ControlPointNoise { pixel, world }) in noises.iter().enumerate() {
        let of_world = |a: usize, b: usize, axis: usize| {
            world[axis].powi(2) * by_world[(2 * point + a, axis)] * by_world[(2 * point + b, axis)]
        };
        let noise = DMatrix::from_fn(2, 2, |a, b| {
            let own = if a == b { pixel * pixel } else { 0.0 };
            own + (0..3).map(|axis| of_world(a, b, axis)).sum::<f64>()
        });
        let by_point = by_noise.columns(2 * point, 2);
        place += by_point * noise * by_point.transpose();
    }
    let mut covariance = camera.covariance;
    for index in placed {
        covariance.0[index] = [0.0; Covariance::SIZE];
        covariance.0.iter_mut().for_each(|row| row[index] = 0.0);
    }
    for i in 0..q.len() {
        for j in 0..q.len() {
            covariance.0[q[i]][q[j]] = place[(i, j)];
        }
        for j in 0..p.len() {
            covariance.0[q[i]][p[j]] = across[(i, j)];
            covariance.0[p[j]][q[i]] = across[(i, j)];
        }
    }
    Camera { covariance, ..*camera }
}

/// Returns the derivatives of the raw pixels of the points (u, v, u, v, ...) with respect to one camera
/// parameter. The derivatives are 0 for a point that is not visible.
fn pixel_derivatives(camera: &Camera, points: &[ControlPoint], index: usize) -> Vec<f64> {
    let pose = PosedCamera::new(*camera);
    points.iter().flat_map(|point| pixel_derivative(&pose, point.world, index).unwrap_or_default()).collect()
}

/// Returns the derivative of the raw pixel (u, v) of a point with respect to the camera parameter `index` of
/// [`Covariance`]. By the chain rule, `d raw = (d raw / d undistorted) d undistorted`. A distortion coefficient and
/// the principal point change only the raw pixel. Returns `None` if the point is not visible.
fn pixel_derivative(pose: &PosedCamera, world: WorldPoint, index: usize) -> Option<[f64; 2]> {
    let lens = &pose.camera.lens;
    if lens.distortion.is_wide() {
        return wide_derivative(pose, world, index);
    }
    let Reprojection { at: [u, v], d_camera, .. } = pose.reproject(world, None)?;
    let Pixel { u: cu, v: cv } = lens.principal_point;
    let straight = UndistortedPixel { u: cu + u, v: cv + v };
    lens.distort(straight)?;
    let (jacobian, by_lens) = lens.distort_derivatives(straight);
    if let Some(coefficient) = index.checked_sub(Covariance::LENS) {
        return by_lens.get(coefficient).copied().or_else(|| match coefficient {
            // The principal point moves the whole image.
            Lens::CENTRE => Some([1.0, 0.0]),
            Lens::ASPECT => {
                let raw = lens.distort(straight)?;
                Some([0.0, (raw.v - lens.principal_point.v) / lens.pixel_aspect])
            }
            _ => Some([0.0, 1.0]),
        });
    }
    // `d_camera` contains the derivative with respect to the logarithm of the focal length.
    let scale = if index == Covariance::FOCAL { pose.camera.focal.recip() } else { 1.0 };
    Some(multiply(jacobian, d_camera.map(|row| scale * row[index])))
}

/// Returns the derivative of the raw pixel (u, v) of a point with respect to one parameter of a camera with a
/// wide lens. The derivative is computed in the chart centred on that pixel.
fn wide_derivative(pose: &PosedCamera, world: WorldPoint, index: usize) -> Option<[f64; 2]> {
    let camera = &pose.camera;
    let shown = camera.world_to_pixel(world)?;
    let observed =
        ObservedPixel::with_derivatives(&camera.lens, shown, &camera.lens, [true; Lens::PARAMETERS])?;
    if let Some(coefficient) = index.checked_sub(Covariance::LENS) {
        let moved = observed.d_lens.map(|row| row.get(coefficient).copied());
        return Some(observed.raw_offset([-moved[0]?, -moved[1]?]));
    }
    let Reprojection { d_camera, .. } = pose.reproject(world, observed.chart.as_ref())?;
    let mut by = d_camera.map(|row| row[index]);
    if index == Covariance::FOCAL {
        let with_lens = if camera.shares_lens_focal() { 1.0 } else { 0.0 };
        let [u, v] = observed.d_lens.map(|row| with_lens * row[Lens::LENS_FOCAL]);
        by = [by[0] - u, by[1] - v].map(|by| by / camera.focal);
    }
    Some(observed.raw_offset(by))
}

/// Least-squares problem in x, y, z and yaw. The residuals are the reprojection errors in u and v, in
/// undistorted pixels; for a wide lens in raw pixels.
struct Resection<'a> {
    camera: Camera,
    points: &'a [ControlPoint],
    is_height_fixed: bool,
}

/// Normal equations of four parameters: `J'J` and `J'r`, with the Jacobian J and the residuals r.
type Normal4 = (Matrix4<f64>, Vector4<f64>);

impl Resection<'_> {
    fn camera(&self, [x, y, z, yaw]: [f64; 4]) -> Camera {
        Camera { position: WorldPoint { x, y, z }, yaw, ..self.camera }
    }

    /// Returns the reprojection error (u, v) of a point, and the derivatives of u and v with respect to x, y, z
    /// and yaw. The unit is an undistorted pixel; for a wide lens a raw pixel.
    ///
    /// The derivatives of the point in camera axes with respect to the position are minus the columns of the
    /// rotation R. The derivative with respect to the yaw is `R (q_y, -q_x, 0)`, where q is the world vector
    /// from the camera to the point.
    fn error(
        &self,
        camera: &Camera,
        rotation: &[[f64; 3]; 3],
        point: &ControlPoint,
    ) -> Option<([f64; 2], [Vector4<f64>; 2])> {
        if camera.lens.distortion.is_wide() {
            return self.wide_error(camera, point);
        }
        let [x, y, z] = camera.in_camera(point.world);
        let drawn = camera.undistort(point.pixel)?;
        let shown = camera.world_to_undistorted(point.world)?;
        let q = [point.world.x - camera.position.x, point.world.y - camera.position.y];
        let mut by = [Vector4::zeros(); 2];
        for k in (0..4).filter(|&k| !(self.is_height_fixed && k == 2)) {
            let change: [f64; 3] = match k {
                3 => rotation.map(|row| row[0] * q[1] - row[1] * q[0]),
                axis => rotation.map(|row| -row[axis]),
            };
            by[0][k] = camera.focal * (change[0] - x / z * change[2]) / z;
            by[1][k] = camera.focal * (change[1] - y / z * change[2]) / z;
        }
        Some(([shown.u - drawn.u, shown.v - drawn.v], by))
    }

    /// Returns the reprojection error and its derivatives as [`Self::error`] does, for a wide lens: in raw pixels.
    fn wide_error(&self, camera: &Camera, point: &ControlPoint) -> Option<([f64; 2], [Vector4<f64>; 2])> {
        let observed = ObservedPixel::new(point.pixel, &camera.lens)?;
        let shown = PosedCamera::new(*camera).reproject(point.world, observed.chart.as_ref())?;
        let unknowns = [Covariance::X, Covariance::Y, Covariance::Z, Covariance::YAW];
        let mut by = [Vector4::zeros(); 2];
        for k in (0..4).filter(|&k| !(self.is_height_fixed && k == 2)) {
            [by[0][k], by[1][k]] = observed.raw_offset(shown.d_camera.map(|row| row[unknowns[k]]));
        }
        Some((observed.raw_offset([shown.at[0] - observed.at[0], shown.at[1] - observed.at[1]]), by))
    }
}

impl LeastSquares for Resection<'_> {
    type State = [f64; 4];
    type Normal = Normal4;

    fn linearize(&self, state: &[f64; 4]) -> Option<(f64, Normal4)> {
        let camera = self.camera(*state);
        let rotation = camera_from_world(camera.roll, camera.pitch, camera.yaw);
        let (mut square, mut gradient) = (Matrix4::zeros(), Vector4::zeros());
        let mut cost = 0.0;
        for point in self.points {
            let (error, by) = self.error(&camera, &rotation, point)?;
            for (error, by) in error.into_iter().zip(by) {
                cost += error * error;
                square += by * by.transpose();
                gradient += by * error;
            }
        }
        cost.is_finite().then_some((cost, (square, gradient)))
    }

    fn step(
        &self,
        state: &[f64; 4],
        (square, gradient): &Normal4,
        damping: f64,
    ) -> Option<([f64; 4], f64, f64)> {
        let mut damped = *square;
        (0..4).for_each(|i| damped[(i, i)] *= 1.0 + damping);
        if self.is_height_fixed {
            damped[(2, 2)] = 1.0;
        }
        let step = -damped.cholesky()?.solve(gradient);
        let predicted = (0..4).map(|i| step[i] * (damping * square[(i, i)] * step[i] - gradient[i])).sum();
        Some((std::array::from_fn(|i| state[i] + step[i]), predicted, step.amax()))
    }
}

/// Returns the camera with the smallest sum of squared distances near `start`. It is never worse than
/// `start`.
fn refined(start: Camera, points: &[ControlPoint], is_height_fixed: bool) -> Camera {
    /// Maximum number of steps of the minimisation.
    const MAX_STEPS: usize = 50;
    let WorldPoint { x, y, z } = start.position;
    let resection = Resection { camera: start, points, is_height_fixed };
    least_squares(&resection, [x, y, z, start.yaw], MAX_STEPS)
        .map_or(start, |summary| resection.camera(summary.state))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{BrownConrady, Distortion, any_camera};
    use proptest::prelude::*;

    /// Standard deviations of pitch (radians), principal point (pixels), k1 and pixel aspect in the noisy placements.
    const SIGMAS: [(usize, f64); 5] = [
        (Covariance::PITCH, 0.003),
        (Covariance::CENTRE, 12.0),
        (Covariance::CENTRE + 1, 12.0),
        (Covariance::LENS, 0.01),
        (Covariance::ASPECT, 0.01),
    ];

    /// Returns the true camera of the test with errors. `by(0)` to `by(4)` are the errors of pitch (radians),
    /// principal point u and v (pixels), k1 and pixel aspect. The covariance contains [`SIGMAS`].
    fn changed(by: impl Fn(usize) -> f64) -> Camera {
        let [pitch, du, dv, dk, aspect] = [0, 1, 2, 3, 4].map(by);
        let distortion = Distortion::BrownConrady(BrownConrady { k1: -0.1 + dk, ..BrownConrady::default() });
        let pinhole = Lens::pinhole(Pixel::new(960.0 + du, 540.0 + dv));
        let mut covariance = Covariance::EXACT;
        for (index, sigma) in SIGMAS {
            covariance.0[index][index] = sigma * sigma;
        }
        Camera {
            position: WorldPoint::new(5.0, -3.0, 4.0),
            yaw: 0.6,
            pitch: 0.5 + pitch,
            roll: 0.03,
            focal: 1300.0,
            lens: Lens { focal: 1300.0, distortion, pixel_aspect: 1.0 + aspect, ..pinhole },
            covariance,
        }
    }

    /// Returns the floor distance between two pixels, and its standard deviation.
    fn floor_length(camera: &Camera) -> [f64; 2] {
        let ends = [Pixel::new(500.0, 600.0), Pixel::new(1400.0, 900.0)];
        let [a, b] = ends.map(|pixel| camera.pixel_to_floor(pixel, 0.0).unwrap());
        let along = [(b.x - a.x) / a.distance(b), (b.y - a.y) / a.distance(b)];
        let [by_a, by_b] = ends.map(|pixel| camera.floor_jacobian(pixel).unwrap());
        let by = |k: usize| (0..2).map(|i| along[i] * (by_b[k][i] - by_a[k][i])).sum::<f64>();
        let row = |k: usize| (0..Covariance::SIZE).map(|l| camera.covariance.0[k][l] * by(l)).sum::<f64>();
        [a.distance(b), (0..Covariance::SIZE).map(|k| by(k) * row(k)).sum::<f64>().sqrt()]
    }

    /// Places one camera many times with noise. Pitch, principal point and distortion are sampled with their
    /// standard deviations. The position must have the right correlation with them: floor lengths depend on all.
    ///
    /// The seed is fixed: a failure that happens by chance for one seed in 100,000 would otherwise soon occur.
    #[test]
    fn placement_covariance_matches_its_errors() {
        use rand::{Rng as _, SeedableRng as _};
        const DRAWS: usize = 20_000;
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let truth = changed(|_| 0.0);
        let [true_length, _] = floor_length(&truth);
        let pixels = [(400.0, 500.0), (1500.0, 450.0), (960.0, 900.0), (300.0, 950.0), (1700.0, 800.0)];
        let heights = [0.0, 0.5, 0.0, 1.0, 0.2];
        let world: Vec<WorldPoint> = pixels
            .iter()
            .zip(heights)
            .map(|(&(u, v), h)| truth.pixel_to_floor(Pixel { u, v }, h).unwrap().at_height(h))
            .collect();
        for fixed_height in [None, Some(4.0)] {
            let mut squares = [0.0; 2];
            for _ in 0..DRAWS {
                let errors = SIGMAS.map(|(_, sigma)| sigma * normal());
                let noise = ControlPointNoise { pixel: 1.0, world: [0.02, 0.02, 0.0] };
                let points: Vec<(ControlPoint, ControlPointNoise)> = world
                    .iter()
                    .map(|&world| {
                        let p = truth.world_to_pixel(world).unwrap();
                        let pixel = Pixel { u: p.u + normal(), v: p.v + normal() };
                        let (x, y) = (world.x + 0.02 * normal(), world.y + 0.02 * normal());
                        (ControlPoint { pixel, world: WorldPoint { x, y, ..world } }, noise)
                    })
                    .collect();
                let bare: Vec<ControlPoint> = points.iter().map(|(point, _)| *point).collect();
                let placed = from_control_points(&changed(|k| errors[k]), &bare, fixed_height).unwrap();
                let found = with_placement_covariance(&placed, &points, fixed_height.is_some());
                let z = found.covariance.sigma(Covariance::Z);
                assert_eq!(z.is_some(), fixed_height.is_none());
                let [length, length_sigma] = floor_length(&found);
                squares[0] += z.map_or(1.0, |sigma| ((found.position.z - truth.position.z) / sigma).powi(2));
                squares[1] += ((length - true_length) / length_sigma).powi(2);
            }
            // The mean of 20,000 squared standard normal numbers is one, with a standard deviation of 0.01.
            for ratio in squares.map(|sum| sum / DRAWS as f64) {
                assert!((ratio - 1.0).abs() < 0.05, "{ratio} with the height {fixed_height:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn points_above_the_camera_give_position_below_them(
            camera in any_camera(),
            rise in 2.0..6.0_f64,
            steps in prop_oneof![Just([0.0; 4]), proptest::array::uniform4(0.0..3.0_f64)],
        ) {
            // A camera that looks up at a ceiling with steps.
            let camera = Camera { pitch: -camera.pitch.abs() - 0.3, ..camera };
            let pixels = [(300.0, 300.0), (1600.0, 350.0), (900.0, 700.0), (400.0, 800.0)];
            let points: Vec<ControlPoint> = pixels.iter().zip(steps).filter_map(|(&(u, v), step)| {
                let (pixel, height) = (Pixel { u, v }, camera.position.z + rise + step);
                let above = camera.pixel_to_floor(pixel, height)?;
                (above.distance(camera.position.on_floor()) < 40.0).then(|| ControlPoint { pixel, world: above.at_height(height) })
            }).collect();
            prop_assume!(points.len() == 4);
            let unplaced = Camera { position: WorldPoint::new(0.0, 0.0, 3.0), yaw: 0.0, ..camera };
            let found = from_control_points(&unplaced, &points, None).unwrap();
            prop_assert!(found.position.distance(camera.position) < 1e-4, "{:?} not {:?}", found.position, camera.position);
        }

        #[test]
        fn two_points_at_one_pixel_do_not_determine_pose(camera in any_camera(), u in 300.0..1500.0_f64) {
            let pixel = Pixel { u, v: 900.0 };
            let point = |x: f64| ControlPoint { pixel, world: WorldPoint::new(x, 5.0, 0.0) };
            prop_assert_eq!(from_control_points(&camera, &[point(0.0), point(4.0)], None), None);
        }

        #[test]
        fn exact_control_points_reproduce_the_camera(
            camera in any_camera(),
            at in proptest::collection::vec((0.05..0.95_f64, 0.3..0.95_f64, 0.0..1.5_f64), 3..9),
        ) {
            let points: Vec<ControlPoint> = at.iter().filter_map(|&(s, t, height)| {
                let pixel = Pixel { u: 1920.0 * s, v: 1080.0 * t };
                let floor = camera.pixel_to_floor(pixel, height)?;
                let near = floor.distance(camera.position.on_floor()) < 40.0;
                near.then(|| ControlPoint { pixel, world: floor.at_height(height) })
            }).collect();
            prop_assume!(points.len() >= 3);
            let apart = points.iter().flat_map(|a| points.iter().map(move |b| a.pixel.distance(b.pixel))).fold(0.0, f64::max);
            prop_assume!(apart > 300.0);
            let unplaced = Camera { position: WorldPoint::new(0.0, 0.0, 3.0), yaw: 0.0, ..camera };
            let found = from_control_points(&unplaced, &points, None).unwrap();
            prop_assert!(found.position.distance(camera.position) < 1e-5, "{:?} not {:?}", found.position, camera.position);
        }
    }
}
