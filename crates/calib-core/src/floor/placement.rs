//! Stage 2: move, turn and scale of an EFOV polygon to x0, y0, yaw, z0, and back; and from control points.

use nalgebra::{DMatrix, DVector, SVD};

use crate::camera::{
    Camera, Covariance, FloorPoint, Pixel, PosedCamera, Reprojection, UndistortedPixel, WorldPoint,
    camera_from_world, times,
};

/// Height of the camera in stage 1, in metres, by the paper's convention.
pub const STAGE_1_HEIGHT: f64 = 3.0;

/// What the operator did to a polygon that was projected with (0, 0, z0, roll, pitch, 0, focal):
/// first scaled and turned about the camera's foot (0, 0), then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// In metres: becomes x0, y0.
    pub by: FloorPoint,
    /// Counter-clockwise, in radians: becomes yaw.
    pub turn: f64,
    /// Multiplies [`STAGE_1_HEIGHT`] to become z0.
    pub scale: f64,
}

impl Placement {
    /// The polygon as stage 1 left it.
    pub const NONE: Self = Self { by: FloorPoint { x: 0.0, y: 0.0 }, turn: 0.0, scale: 1.0 };

    /// The camera of stage 1, placed (the paper's stage 2).
    #[must_use]
    pub fn apply(&self, camera: &Camera) -> Camera {
        Camera { position: self.by.at_height(STAGE_1_HEIGHT * self.scale), yaw: self.turn, ..*camera }
    }

    /// The placement that a camera has.
    #[must_use]
    pub fn of(camera: &Camera) -> Self {
        Self { by: camera.position.on_floor(), turn: camera.yaw, scale: camera.position.z / STAGE_1_HEIGHT }
    }

    /// Where a point of the stage 1 floor (camera at height [`STAGE_1_HEIGHT`] over (0, 0), yaw 0) comes to lie.
    #[must_use]
    pub fn carry(&self, point: FloorPoint) -> FloorPoint {
        let (sin, cos) = self.turn.sin_cos();
        FloorPoint {
            x: self.by.x + self.scale * (cos * point.x - sin * point.y),
            y: self.by.y + self.scale * (sin * point.x + cos * point.y),
        }
    }
}

/// A pixel that shows a point with known coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlPoint {
    /// Raw pixel.
    pub pixel: Pixel,
    /// Where it is, in metres.
    pub world: WorldPoint,
}

/// The camera with roll, pitch, focal and lens of `camera`, standing where control points say.
///
/// Closed form: with the ray `d` of a pixel at yaw 0, drop `z0 - h` to the point at height `h`,
///
/// `dz X = dz x0 + (h - z0) (dx cos yaw - dy sin yaw)` and
/// `dz Y = dz y0 + (h - z0) (dx sin yaw + dy cos yaw)`
///
/// are linear in x0, y0, `z0 cos yaw`, `z0 sin yaw`, `cos yaw`, `sin yaw` up to a common factor.
/// Points of one height only know the drop to it. The floor's first answer is then improved to least
/// squares of the distances in pixels. `None` for fewer than two points that the lens shows.
#[must_use]
pub fn from_control_points(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    let shown: Vec<ControlPoint> =
        points.iter().copied().filter(|point| camera.undistort(point.pixel).is_some()).collect();
    if shown.len() < 2 {
        return None;
    }
    let start = linear(camera, &shown, height)?;
    let mut found = closest_in_pixels(start, &shown, height.is_some());
    let half = std::f64::consts::PI;
    found.yaw = (found.yaw + half).rem_euclid(2.0 * half) - half;
    // Points at one pixel, or behind the camera, place nothing.
    let is_placed = square_error(&found, &shown).is_finite() && found.position.is_finite();
    (is_placed && by_place(&found, &shown).rank(1e-9) >= if height.is_some() { 3 } else { 4 })
        .then_some(found)
}

/// Derivatives of the points' pixels by position and yaw.
fn by_place(camera: &Camera, points: &[ControlPoint]) -> DMatrix<f64> {
    let unknowns = [Covariance::X, Covariance::Y, Covariance::Z, Covariance::YAW];
    let columns = unknowns.map(|index| pixel_slopes(camera, points, index));
    // A metre and a radian of a camera some metres off are of one size.
    DMatrix::from_fn(2 * points.len(), unknowns.len(), |i, j| columns[j][i] / camera.focal)
}

/// Rays at yaw 0, in world axes.
fn rays(camera: &Camera, points: &[ControlPoint]) -> Vec<[f64; 3]> {
    let unturned = Camera { yaw: 0.0, ..*camera };
    points.iter().filter_map(|point| Some(unturned.pixel_to_ray(point.pixel)?.direction)).collect()
}

fn linear(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    let rays = rays(camera, points);
    let count = points.len() as f64;
    // World coordinates may be of the size of a country: work about their middle.
    let middle = |value: fn(&WorldPoint) -> f64| points.iter().map(|p| value(&p.world)).sum::<f64>() / count;
    let centre = WorldPoint::new(middle(|p| p.x), middle(|p| p.y), middle(|p| p.z));
    let candidates =
        one_height(&rays, points, centre).into_iter().flatten().chain(all_heights(&rays, points, centre));
    candidates
        .map(|(x, y, z, yaw)| {
            let z = height.unwrap_or(z);
            Camera { position: WorldPoint { x, y, z }, yaw, ..*camera }
        })
        .min_by(|a, b| square_error(a, points).total_cmp(&square_error(b, points)))
}

/// Unknowns x0, y0, a = (z0 - h) cos, b = (z0 - h) sin, as if all points had the mean height `h`.
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

/// Unknowns x0, y0, z0 cos, z0 sin, cos, sin relative to the mean height; the last pair is of length 1.
fn all_heights(
    rays: &[[f64; 3]],
    points: &[ControlPoint],
    centre: WorldPoint,
) -> Option<(f64, f64, f64, f64)> {
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
    // Both pairs point along the same yaw: the longer one knows it better.
    let yaw = (x[3] + x[5]).atan2(x[2] + x[4]);
    let z0 = x[2] * yaw.cos() + x[3] * yaw.sin();
    Some((centre.x + x[0], centre.y + x[1], centre.z + z0, yaw))
}

/// Sum of the squared distances of the points from their pixels, in undistorted pixels.
fn square_error(camera: &Camera, points: &[ControlPoint]) -> f64 {
    points
        .iter()
        .map(|point| match (camera.world_to_undistorted(point.world), camera.undistort(point.pixel)) {
            (Some(shown), Some(drawn)) => shown.distance(drawn).powi(2),
            _ => f64::INFINITY,
        })
        .sum()
}

/// The camera with the covariance of where control points put it: noise of `sigma` pixels in the
/// points, and what was uncertain about roll, pitch and focal carried along.
///
/// With the derivatives `A` of the pixels by position and yaw `q`, and `B` by roll, pitch and focal `p`,
/// `dq = -(A'A)^-1 A' (B dp + noise)`.
#[must_use]
pub fn with_placement_covariance(camera: &Camera, points: &[ControlPoint], sigma: f64) -> Camera {
    let (q, p) = (
        [Covariance::X, Covariance::Y, Covariance::Z, Covariance::YAW],
        [Covariance::PITCH, Covariance::ROLL, Covariance::FOCAL],
    );
    let shown: Vec<ControlPoint> =
        points.iter().copied().filter(|point| camera.world_to_pixel(point.world).is_some()).collect();
    let jacobian = |unknowns: &[usize]| {
        let columns: Vec<Vec<f64>> =
            unknowns.iter().map(|&index| pixel_slopes(camera, &shown, index)).collect();
        DMatrix::from_fn(2 * shown.len(), unknowns.len(), |i, j| columns[j][i])
    };
    let by_place = jacobian(&q);
    let Some(inverse) = (by_place.transpose() * &by_place).try_inverse() else { return *camera };
    let gain = -(&inverse * by_place.transpose() * jacobian(&p));
    let known = DMatrix::from_fn(3, 3, |i, j| camera.covariance.0[p[i]][p[j]]);
    let across = &gain * &known;
    let place = &across * gain.transpose() + inverse * (sigma * sigma);
    let mut covariance = camera.covariance;
    for i in 0..4 {
        for j in 0..4 {
            covariance.0[q[i]][q[j]] = place[(i, j)];
        }
        for j in 0..3 {
            covariance.0[q[i]][p[j]] = across[(i, j)];
            covariance.0[p[j]][q[i]] = across[(i, j)];
        }
    }
    Camera { covariance, ..*camera }
}

/// Derivatives of the points' raw pixels (u, v, u, v, ...) by one unknown of the camera; 0 of a point that it
/// does not show.
fn pixel_slopes(camera: &Camera, points: &[ControlPoint], index: usize) -> Vec<f64> {
    let pose = PosedCamera::new(*camera);
    points.iter().flat_map(|point| pixel_slope(&pose, point.world, index).unwrap_or_default()).collect()
}

/// Through the lens `d raw = (d raw / d undistorted) d undistorted`; a coefficient moves the raw pixel alone.
fn pixel_slope(pose: &PosedCamera, world: WorldPoint, index: usize) -> Option<[f64; 2]> {
    let Reprojection { at: [u, v], d_camera, .. } = pose.reproject(world)?;
    let lens = &pose.camera.lens;
    let Pixel { u: cu, v: cv } = lens.principal_point;
    let straight = UndistortedPixel { u: cu + u, v: cv + v };
    lens.distort(straight)?;
    let (jacobian, by_lens) = lens.distort_derivatives(straight);
    if let Some(coefficient) = index.checked_sub(Covariance::LENS) {
        return by_lens.get(coefficient).copied();
    }
    // The derivative is by the log of the focal.
    let scale = if index == Covariance::FOCAL { pose.camera.focal.recip() } else { 1.0 };
    Some(times(jacobian, d_camera.map(|row| scale * row[index])))
}

/// Gauss-Newton on position and yaw with the step halved until it helps: never worse than its start.
fn closest_in_pixels(start: Camera, points: &[ControlPoint], hold_height: bool) -> Camera {
    const ROUNDS: usize = 50;
    let mut best = (start, square_error(&start, points));
    for _ in 0..ROUNDS {
        let Some(mut step) = newton_step(&best.0, points, hold_height) else { break };
        if hold_height {
            step[2] = 0.0;
        }
        let improved = (0..20).map(|halving| 0.5_f64.powi(halving)).find_map(|share| {
            let moved = moved(&best.0, step, share);
            let error = square_error(&moved, points);
            (error < best.1).then_some((moved, error))
        });
        let Some(next) = improved else { break };
        let gain = best.1 - next.1;
        best = next;
        if gain <= 1e-15 * best.1 {
            break;
        }
    }
    best.0
}

fn moved(camera: &Camera, step: [f64; 4], share: f64) -> Camera {
    let WorldPoint { x, y, z } = camera.position;
    let position = WorldPoint { x: x + share * step[0], y: y + share * step[1], z: z + share * step[2] };
    Camera { position, yaw: camera.yaw + share * step[3], ..*camera }
}

/// The least-squares step in x, y, z and yaw. With `(X, Y, Z)` the point in camera axes, its change
/// with the position is minus the camera's axes, and with the yaw `R (q_y, -q_x, 0)` for `q` the
/// point relative to the camera in the base system.
fn newton_step(camera: &Camera, points: &[ControlPoint], hold_height: bool) -> Option<[f64; 4]> {
    let rotation = camera_from_world(camera.roll, camera.pitch, camera.yaw);
    let mut matrix = DMatrix::zeros(2 * points.len(), 4);
    let mut right = DVector::zeros(2 * points.len());
    for (i, point) in points.iter().enumerate() {
        let [x, y, z] = camera.in_camera(point.world);
        let drawn = camera.undistort(point.pixel)?;
        let shown = camera.world_to_undistorted(point.world)?;
        right[2 * i] = drawn.u - shown.u;
        right[2 * i + 1] = drawn.v - shown.v;
        let q = [point.world.x - camera.position.x, point.world.y - camera.position.y];
        for k in (0..4).filter(|&k| !(hold_height && k == 2)) {
            let change: [f64; 3] = match k {
                3 => rotation.map(|row| row[0] * q[1] - row[1] * q[0]),
                axis => rotation.map(|row| -row[axis]),
            };
            matrix[(2 * i, k)] = camera.focal * (change[0] - x / z * change[2]) / z;
            matrix[(2 * i + 1, k)] = camera.focal * (change[1] - y / z * change[2]) / z;
        }
    }
    let step = SVD::new(matrix, true, true).solve(&right, 1e-12).ok()?;
    Some([step[0], step[1], step[2], step[3]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn placing_the_camera_carries_its_polygon(
            camera in any_camera(), x in -9.0..9.0_f64, y in -9.0..9.0_f64,
            turn in -3.0..3.0_f64, scale in 0.5..2.0_f64, u in 0.0..1920.0_f64, v in 0.0..1080.0_f64,
        ) {
            let placement = Placement { by: FloorPoint { x, y }, turn, scale };
            let stage_1 = Camera { position: WorldPoint::new(0.0, 0.0, STAGE_1_HEIGHT), yaw: 0.0, ..camera };
            let placed = placement.apply(&stage_1);
            prop_assert!((placed.position.z - 3.0 * scale).abs() < 1e-12);
            let back = Placement::of(&placed);
            prop_assert!((back.scale - scale).abs() < 1e-12 && back.turn == turn && back.by == placement.by);
            if let (Some(a), Some(b)) = (stage_1.pixel_to_floor(Pixel { u, v }, 0.0), placed.pixel_to_floor(Pixel { u, v }, 0.0)) {
                prop_assert!(placement.carry(a).distance(b) < 1e-9 * (1.0 + a.distance(FloorPoint::default())));
            }
        }

        #[test]
        fn the_covariance_of_a_placement_is_that_of_its_errors(seed in 0_u64..1_000_000) {
            // A hundred noisy placements of one camera, pitch drawn from its own sigma each time.
            use rand::{Rng as _, SeedableRng as _};
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let truth = Camera {
                position: WorldPoint::new(5.0, -3.0, 4.0), yaw: 0.6, pitch: 0.5, roll: 0.03, focal: 1300.0,
                lens: crate::camera::Lens::pinhole(Pixel::new(960.0, 540.0)), covariance: Covariance::EXACT,
            };
            let world: Vec<WorldPoint> = [(400.0, 500.0, 0.0), (1500.0, 450.0, 0.5), (960.0, 900.0, 0.0), (300.0, 950.0, 1.0), (1700.0, 800.0, 0.2)]
                .iter().map(|&(u, v, h)| truth.pixel_to_floor(Pixel { u, v }, h).unwrap().at_height(h)).collect();
            let sigma_pitch = 0.003;
            let mut covariance = Covariance::EXACT;
            covariance.0[Covariance::PITCH][Covariance::PITCH] = sigma_pitch * sigma_pitch;
            let mut sum = 0.0;
            const DRAWS: usize = 100;
            for _ in 0..DRAWS {
                let believed = Camera { pitch: truth.pitch + sigma_pitch * normal(), covariance, ..truth };
                let points: Vec<ControlPoint> = world.iter().map(|&world| {
                    let p = truth.world_to_pixel(world).unwrap();
                    ControlPoint { pixel: Pixel { u: p.u + normal(), v: p.v + normal() }, world }
                }).collect();
                let found = with_placement_covariance(&from_control_points(&believed, &points, None).unwrap(), &points, 1.0);
                sum += ((found.position.z - truth.position.z) / found.covariance.sigma(Covariance::Z).unwrap()).powi(2);
            }
            // Chi-square of 100: between 0.55 and 1.6 of its mean but once in a hundred thousand.
            let ratio = sum / DRAWS as f64;
            prop_assert!(ratio > 0.5 && ratio < 1.7, "{ratio}");
        }

        #[test]
        fn points_above_the_camera_leave_it_below_them(camera in any_camera(), rise in 2.0..6.0_f64) {
            // Seen from below: a camera that looks up at a ceiling.
            let camera = Camera { pitch: -camera.pitch.abs() - 0.3, ..camera };
            let height = camera.position.z + rise;
            let points: Vec<ControlPoint> = [(300.0, 300.0), (1600.0, 350.0), (900.0, 700.0), (400.0, 800.0)].iter().filter_map(|&(u, v)| {
                let pixel = Pixel { u, v };
                let above = camera.pixel_to_floor(pixel, height)?;
                (above.distance(camera.position.on_floor()) < 40.0).then(|| ControlPoint { pixel, world: above.at_height(height) })
            }).collect();
            prop_assume!(points.len() == 4);
            let unplaced = Camera { position: WorldPoint::new(0.0, 0.0, 3.0), yaw: 0.0, ..camera };
            let found = from_control_points(&unplaced, &points, None).unwrap();
            prop_assert!(found.position.distance(camera.position) < 1e-4, "{:?} not {:?}", found.position, camera.position);
        }

        #[test]
        fn two_points_at_one_pixel_place_nothing(camera in any_camera(), u in 300.0..1500.0_f64) {
            let pixel = Pixel { u, v: 900.0 };
            let point = |x: f64| ControlPoint { pixel, world: WorldPoint::new(x, 5.0, 0.0) };
            prop_assert_eq!(from_control_points(&camera, &[point(0.0), point(4.0)], None), None);
        }

        #[test]
        fn exact_control_points_give_the_camera_back(
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
