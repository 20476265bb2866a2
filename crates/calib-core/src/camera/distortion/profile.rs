//! What all lenses share that are symmetric about their axis and look beside and behind themselves: each adds its
//! profile, the radius at which a ray at an angle from the axis is shown.
//!
//! A ray at the angle theta is shown at the radius P(theta), and by a pinhole at `tan theta`. The direction of the
//! radius stays, so that every derivative is that of a radius; with `d tan theta = (1 + tan^2 theta) d theta`, and at
//! a radius that stays `d theta = -dP/dk / P' d k` for a coefficient k. Rays, unit vectors
//! `(sin theta n, cos theta)` with the direction n of the radius, are regular across theta = 90 degrees and beyond,
//! where a pinhole has no image.

use crate::camera::distortion::Distortion;
use crate::camera::distortion::model::{
    ByCoefficient, ByCoefficients, Matrix2, Model, RayByCoefficient, RayCurvature, RayMatrix, radial,
};
use crate::camera::numerics::{angle_from_axis, atan, hypot, sin_cos, tan};

/// Radii nearer to the axis than this have no direction.
const AXIS: f64 = 1e-9;

/// Largest angle from the axis, in radians: no lens that is built looks farther round than 288 degrees.
const WIDEST: f64 = 0.8 * std::f64::consts::PI;

/// The radius P, over the focal, at which a lens shows a ray at the angle theta from its axis, in radians: with
/// `P(0) = 0` and `P'(0) = 1`, so that the focal is that of the middle of the image.
pub(super) trait Profile {
    /// Number of coefficients.
    const COEFFICIENTS: usize;

    /// P.
    fn radius(&self, theta: f64) -> f64;

    /// P'.
    fn slope(&self, theta: f64) -> f64;

    /// P''.
    fn curvature(&self, theta: f64) -> f64;

    /// How P and P' change with every coefficient.
    fn by_coefficients(&self, theta: f64) -> [[f64; 2]; Distortion::MOST];

    /// The angle below [`Self::turn`] that is shown at a radius: the inverse of P.
    fn inverse(&self, radius: f64) -> Option<f64>;

    /// The angle at which P stops growing, infinite if it never does; negative of what is no lens at all.
    fn turn(&self) -> f64;
}

/// The angle from the axis that is shown at a radius.
fn angle(profile: &impl Profile, radius: f64) -> Option<f64> {
    profile.inverse(radius).filter(|&theta| theta <= WIDEST)
}

impl<P: Profile> Model for P {
    fn max_radius(&self) -> f64 {
        let theta = self.turn();
        if theta < std::f64::consts::FRAC_PI_2 { tan(theta).max(0.0) } else { f64::INFINITY }
    }

    fn distort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let radius = hypot(x, y);
        let theta = atan(radius);
        if theta > self.turn() {
            return None;
        }
        let scale = if radius < AXIS { 1.0 } else { self.radius(theta) / radius };
        Some([scale * x, scale * y])
    }

    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let radius = hypot(x, y);
        let theta = self.inverse(radius)?;
        if theta >= std::f64::consts::FRAC_PI_2 {
            return None;
        }
        let scale = if radius < AXIS { 1.0 } else { tan(theta) / radius };
        Some([scale * x, scale * y])
    }

    /// Also one from beside or behind the camera, which no pinhole sees.
    fn reaches(&self, [x, y]: [f64; 2]) -> bool {
        angle(self, hypot(x, y)).is_some()
    }

    fn ray(&self, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
        let radius = hypot(x, y);
        let (sin, cos) = sin_cos(angle(self, radius)?);
        let scale = if radius < AXIS { 1.0 } else { sin / radius };
        Some([scale * x, scale * y, cos])
    }

    fn shown(&self, [x, y, w]: [f64; 3]) -> Option<[f64; 2]> {
        let across = hypot(x, y);
        let theta = angle_from_axis(across, w);
        if theta > WIDEST || theta > self.turn() {
            return None;
        }
        let scale = if across < AXIS * w { w.recip() } else { self.radius(theta) / across };
        Some([scale * x, scale * y])
    }

    fn ray_jacobian(&self, bent: [f64; 2], [x, y, w]: [f64; 3]) -> RayMatrix {
        let (radius, sin) = (hypot(bent[0], bent[1]), hypot(x, y));
        if radius < AXIS {
            return [[1.0, 0.0], [0.0, 1.0], [0.0; 2]];
        }
        let turn = self.slope(angle_from_axis(sin, w)).recip();
        let [u, v] = radial(bent, sin / radius, w * turn);
        [u, v, bent.map(|c| -sin * turn * c / radius)]
    }

    /// Of `(s q, cos theta)` with `s = sin theta / r` at the radius r of the point q, whose direction is n: with slashes
    /// for derivatives by r, `s' (n_i I_jk + n_j I_ik + n_k I_ij) + (r s'' - s') n_i n_j n_k` and
    /// `cos' (I_jk - n_j n_k) / r + cos'' n_j n_k`, where `r s' = cos theta theta' - s` and
    /// `r s'' = cos theta theta'' - sin theta theta'^2 - 2 s'`.
    fn ray_curvature(&self, bent: [f64; 2], [x, y, w]: [f64; 3]) -> RayCurvature {
        let (radius, sin) = (hypot(bent[0], bent[1]), hypot(x, y));
        if radius < AXIS {
            return [[[0.0; 2], [0.0; 2], [-1.0, 0.0]], [[0.0; 2], [0.0; 2], [0.0, -1.0]]];
        }
        let theta = angle_from_axis(sin, w);
        // Of theta by r, once and twice.
        let turn = self.slope(theta).recip();
        let bend = -self.curvature(theta) * turn * turn * turn;
        // s', and r s'' - s'.
        let slope = (w * turn - sin / radius) / radius;
        let cubic = w * bend - sin * turn * turn - 3.0 * slope;
        let of_cos = radial(bent, -sin * turn / radius, -w * turn * turn - sin * bend);
        let n = bent.map(|c| c / radius);
        let one = |i: usize, k: usize| f64::from(u8::from(i == k));
        let of_point = |i: usize, j: usize, k: usize| {
            let linear = n[i] * one(j, k) + n[j] * one(i, k) + n[k] * one(i, j);
            slope * linear + cubic * n[i] * n[j] * n[k]
        };
        [0, 1].map(|j| {
            let [x, y] = [0, 1].map(|i| [of_point(i, j, 0), of_point(i, j, 1)]);
            [x, y, of_cos[j]]
        })
    }

    fn ray_by_coefficients(
        &self,
        bent: [f64; 2],
        [x, y, w]: [f64; 3],
    ) -> [RayByCoefficient; Distortion::MOST] {
        let (radius, sin) = (hypot(bent[0], bent[1]), hypot(x, y));
        let mut by = [RayByCoefficient::default(); Distortion::MOST];
        if radius < AXIS {
            return by;
        }
        let theta = angle_from_axis(sin, w);
        let (derivative, second) = (self.slope(theta), self.curvature(theta));
        let turn = derivative.recip();
        for (by, [d_radius, d_slope]) in by.iter_mut().zip(self.by_coefficients(theta)).take(P::COEFFICIENTS)
        {
            let d_theta = -d_radius * turn;
            // Of 1 / P'.
            let d_turn = -(second * d_theta + d_slope) * turn * turn;
            let [u, v] = radial(bent, w * d_theta / radius, w * d_turn - sin * turn * d_theta);
            let ahead = -(w * turn * d_theta + sin * d_turn) / radius;
            let [x, y] = bent.map(|c| w * d_theta * c / radius);
            *by = RayByCoefficient { at: [x, y, -sin * d_theta], jacobian: [u, v, bent.map(|c| ahead * c)] };
        }
        by
    }

    fn distort_jacobian(&self, [x, y]: [f64; 2]) -> Matrix2 {
        let radius = hypot(x, y);
        let theta = atan(radius);
        let across = if radius < AXIS { 1.0 } else { self.radius(theta) / radius };
        radial([x, y], across, self.slope(theta) / (1.0 + radius * radius))
    }

    fn distort_by_coefficients(&self, [x, y]: [f64; 2]) -> [[f64; 2]; Distortion::MOST] {
        let radius = hypot(x, y);
        let mut by = [[0.0; 2]; Distortion::MOST];
        if radius >= AXIS {
            let terms = self.by_coefficients(atan(radius));
            for (by, [d_radius, _]) in by.iter_mut().zip(terms).take(P::COEFFICIENTS) {
                let along = d_radius / radius;
                *by = [along * x, along * y];
            }
        }
        by
    }

    fn undistort_jacobian(&self, bent: [f64; 2], straight: [f64; 2]) -> Matrix2 {
        let (radius, tangent) = (hypot(bent[0], bent[1]), hypot(straight[0], straight[1]));
        let across = if radius < AXIS { 1.0 } else { tangent / radius };
        radial(bent, across, (1.0 + tangent * tangent) / self.slope(atan(tangent)))
    }

    fn undistort_by_coefficients(&self, bent: [f64; 2], straight: [f64; 2]) -> ByCoefficients {
        let (radius, tangent) = (hypot(bent[0], bent[1]), hypot(straight[0], straight[1]));
        let mut by = ByCoefficients::default();
        if radius < AXIS {
            return by;
        }
        let (theta, gain) = (atan(tangent), 1.0 + tangent * tangent);
        let (derivative, second) = (self.slope(theta), self.curvature(theta));
        for (by, [d_radius, d_slope]) in by.iter_mut().zip(self.by_coefficients(theta)).take(P::COEFFICIENTS)
        {
            let d_theta = -d_radius / derivative;
            let d_derivative = second * d_theta + d_slope;
            let across = gain * d_theta / radius;
            // Of (1 + tan^2 theta) / P'.
            let along = gain * (2.0 * tangent * d_theta - d_derivative / derivative) / derivative;
            *by = ByCoefficient { at: bent.map(|c| across * c), jacobian: radial(bent, across, along) };
        }
        by
    }
}
