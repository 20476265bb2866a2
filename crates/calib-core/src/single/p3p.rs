//! Perspective-three-point problem: the poses of a camera of known focal length that shows three known
//! points.
//!
//! Let `s1, s2, s3` be the distances of the points from the centre of projection, `a, b, c` the sides of
//! their triangle (opposite to point 1, 2, 3), and `alpha, beta, gamma` the angles between the rays (2, 3),
//! (1, 3), (1, 2). The law of cosines gives three equations. With `s2 = u s1` and `s3 = v s1` they reduce to
//! a quartic in `v` with up to four positive roots (Grunert 1841; Haralick, Lee, Ottenberg and Nolle 1994,
//! "Review and Analysis of Solutions of the Three Point Perspective Pose Estimation Problem", equation 9).
//! The distances give the points in camera axes, and the frames of the two triangles give the pose.

use nalgebra::{Matrix3, Vector3};

/// Pose of a camera: it maps a point from world axes to camera axes by `in_camera = rotation (world - centre)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// Rows right, down, forward in world axes.
    pub(super) rotation: [[f64; 3]; 3],
    /// Centre of projection, in metres.
    pub(super) centre: [f64; 3],
}

/// Returns the camera poses in which the three `world` points, in metres, are on the `rays`. The rays are in
/// camera axes, with any length. Empty for collinear points.
///
/// If noise makes a double root complex, its real part is used, because the poses are only starts of a
/// refinement.
pub(super) fn p3p(rays: &[[f64; 3]; 3], world: &[[f64; 3]; 3]) -> Vec<Pose> {
    let rays = rays.map(|ray| Vector3::from(ray).normalize());
    let world = world.map(Vector3::from);
    let [a, b, c] = [
        (world[1] - world[2]).norm_squared(),
        (world[0] - world[2]).norm_squared(),
        (world[0] - world[1]).norm_squared(),
    ];
    let [cos_alpha, cos_beta, cos_gamma] =
        [rays[1].dot(&rays[2]), rays[0].dot(&rays[2]), rays[0].dot(&rays[1])];
    let Some(world_frame) = frame(&world).filter(|_| b > 0.0) else { return Vec::new() };
    let (difference, sum) = ((a - c) / b, (a + c) / b);
    let (a, c) = (a / b, c / b);
    let quartic = [
        (1.0 + difference).powi(2) - 4.0 * a * cos_gamma.powi(2),
        4.0 * (-difference * (1.0 + difference) * cos_beta + 2.0 * a * cos_gamma.powi(2) * cos_beta
            - (1.0 - sum) * cos_alpha * cos_gamma),
        2.0 * (difference.powi(2) - 1.0
            + 2.0 * (difference * cos_beta).powi(2)
            + 2.0 * (1.0 - c) * cos_alpha.powi(2)
            - 4.0 * sum * cos_alpha * cos_beta * cos_gamma
            + 2.0 * (1.0 - a) * cos_gamma.powi(2)),
        4.0 * (difference * (1.0 - difference) * cos_beta - (1.0 - sum) * cos_alpha * cos_gamma
            + 2.0 * c * cos_alpha.powi(2) * cos_beta),
        (difference - 1.0).powi(2) - 4.0 * c * cos_alpha.powi(2),
    ];
    let pose = |v: f64| {
        let u = ((difference - 1.0) * v * v - 2.0 * difference * cos_beta * v + 1.0 + difference)
            / (2.0 * (cos_gamma - v * cos_alpha));
        let first = (b / (1.0 + v * v - 2.0 * v * cos_beta)).sqrt();
        let distances = [first, u * first, v * first];
        if !distances.iter().all(|distance| distance.is_finite() && *distance > 0.0) {
            return None;
        }
        let in_camera: [Vector3<f64>; 3] = std::array::from_fn(|i| rays[i] * distances[i]);
        let rotation = frame(&in_camera)? * world_frame.transpose();
        let centre = world[0] - rotation.transpose() * in_camera[0];
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| rotation[(i, j)]));
        Some(Pose { rotation: rows, centre: centre.into() })
    };
    real_roots(quartic).into_iter().filter_map(pose).collect()
}

/// Returns the axes of a triangle as columns: along its first side, across in its plane, and normal to it.
/// `None` for a triangle without area.
fn frame([a, b, c]: &[Vector3<f64>; 3]) -> Option<Matrix3<f64>> {
    /// Smallest sine of the angle between the two sides from the first corner.
    const MIN_SINE: f64 = 1e-9;
    let (along, other) = (b - a, c - a);
    let normal = along.cross(&other);
    if normal.norm().is_nan() || normal.norm() <= MIN_SINE * along.norm() * other.norm() {
        return None;
    }
    let (x, z) = (along.normalize(), normal.normalize());
    Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
}

/// Returns the positive real roots of a quartic with these coefficients, the constant term first.
///
/// With `v = y - b / 4` the quartic `v^4 + b v^3 + ...` becomes `y^4 + p y^2 + q y + r`. For a root `m > 0` of the
/// resolvent cubic `m^3 + p m^2 + (p^2 / 4 - r) m - q^2 / 8` it is the product of two quadratic polynomials
/// `y^2 -+ t y + p / 2 + m +- q / (2 t)` with `t = sqrt(2 m)` (Ferrari). Two Newton steps remove the rounding
/// errors.
fn real_roots([c0, c1, c2, c3, c4]: [f64; 5]) -> Vec<f64> {
    /// Largest imaginary part of a double root with noise, relative to the root.
    const MAX_IMAGINARY: f64 = 0.05;
    let [d, c, b, a] = [c0, c1, c2, c3].map(|value| value / c4);
    let shift = 0.25 * a;
    let p = b - 6.0 * shift * shift;
    let q = c - 2.0 * b * shift + 8.0 * shift.powi(3);
    let r = d - c * shift + b * shift * shift - 3.0 * shift.powi(4);
    let m = positive_root([-0.125 * q * q, 0.25 * p * p - r, p]);
    if !(m.is_finite() && m >= 0.0) {
        return Vec::new();
    }
    let t = (2.0 * m).sqrt();
    // Without a linear term, the quartic is a quadratic polynomial in y^2.
    let offset = if t > 0.0 { 0.5 * q / t } else { (0.25 * p * p - r).max(0.0).sqrt() };
    let mut roots = Vec::new();
    for sign in [1.0, -1.0] {
        let (half, constant) = (0.5 * sign * t, 0.5 * p + m + sign * offset);
        let discriminant = half * half - constant;
        let imaginary = (-discriminant).max(0.0).sqrt();
        let root = discriminant.max(0.0).sqrt();
        for value in [half + root, half - root].map(|y| y - shift) {
            if value > 0.0 && imaginary <= MAX_IMAGINARY * value {
                roots.push(polished(value, [d, c, b, a]));
            }
        }
    }
    roots
}

/// Returns a positive root of the cubic `x^3 + c2 x^2 + c1 x + c0` with `c0 <= 0`. A Newton step that leaves the
/// bracket is replaced by a bisection.
fn positive_root([c0, c1, c2]: [f64; 3]) -> f64 {
    const MAX_STEPS: usize = 100;
    // Fujiwara's upper bound on the roots.
    let (mut low, mut high) = (0.0, 2.0 * c0.abs().cbrt().max(c1.abs().sqrt()).max(c2.abs()));
    let mut x = high;
    for _ in 0..MAX_STEPS {
        let value = ((x + c2) * x + c1) * x + c0;
        if value > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let newton = x - value / ((3.0 * x + 2.0 * c2) * x + c1);
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() <= f64::EPSILON * x.abs() {
            break;
        }
        x = next;
    }
    x
}

/// Refines a root of `v^4 + a v^3 + b v^2 + c v + d` by Newton steps. Steps that do not reduce the absolute value of
/// the polynomial are omitted.
fn polished(mut v: f64, [d, c, b, a]: [f64; 4]) -> f64 {
    let value = |v: f64| (((v + a) * v + b) * v + c) * v + d;
    for _ in 0..2 {
        let slope = ((4.0 * v + 3.0 * a) * v + 2.0 * b) * v + c;
        let next = v - value(v) / slope;
        if value(next).abs() < value(v).abs() {
            v = next;
        }
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn one_pose_is_that_of_the_camera_that_shows_the_points(
            camera in any_camera(),
            at in proptest::array::uniform3(proptest::array::uniform3(-1.0..1.0_f64)),
        ) {
            let depth = 8.0;
            let rotation = Matrix3::from_fn(|i, j| camera.rotation()[i][j]);
            let centre = Vector3::new(camera.position.x, camera.position.y, camera.position.z);
            let rays = at.map(|[x, y, z]| [3.0 * x, 2.0 * y, depth + 3.0 * z]);
            let world = rays.map(|ray| <[f64; 3]>::from(centre + rotation.transpose() * Vector3::from(ray)));
            let sides = [Vector3::from(world[1]) - Vector3::from(world[0]), Vector3::from(world[2]) - Vector3::from(world[0])];
            prop_assume!(sides[0].cross(&sides[1]).norm() > 0.3);
            let off = |pose: &Pose| (Vector3::from(pose.centre) - centre).norm();
            let nearest = p3p(&rays, &world).iter().map(off).fold(f64::INFINITY, f64::min);
            // Near the danger cylinder two roots coincide, and rounding grows to its square root.
            prop_assert!(nearest < 1e-3, "{nearest}");
        }
    }

    #[test]
    fn collinear_points_have_no_pose() {
        let rays = [[0.0, 0.1, 1.0], [0.0, 0.0, 1.0], [0.0, -0.1, 1.0]];
        let world = [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [0.0, 3.0, 0.0]];
        assert_eq!(p3p(&rays, &world), []);
    }
}
