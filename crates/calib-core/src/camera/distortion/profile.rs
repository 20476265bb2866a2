//! Common part of wide lenses that are symmetric about their axis. Each model adds only its profile: the
//! image radius of a ray as a function of its angle from the axis.
//!
//! A ray at the angle theta from the optical axis has the image radius P(theta), divided by the focal length.
//! In a pinhole, its image radius is `tan theta`. The direction of the image point from the centre is the
//! same for both, so every derivative follows from the derivative of a radius. Primes are derivatives with
//! respect to theta. The derivative of the pinhole radius is `d tan theta = (1 + tan^2 theta) d theta`. At a
//! fixed image radius, a change dk of a coefficient k changes the angle by `d theta = -(dP/dk) / P' dk`.
//!
//! Rays are unit vectors `(sin theta n, cos theta)`, where the unit vector n is the direction of the image
//! point from the centre. They are defined at theta = 90° and beyond, where a pinhole has no image.

use crate::camera::distortion::Distortion;
use crate::camera::distortion::model::{
    ByCoefficient, ByCoefficients, Matrix2, Model, RayByCoefficient, RayCurvature, RayMatrix, radial,
};
use crate::camera::numerics::{angle_from_axis, atan, hypot, sin_cos, tan};

/// Minimum image radius, divided by the focal length, at which the direction of the image point is defined.
const MIN_RADIUS: f64 = 1e-9;

/// Largest angle between a ray and the optical axis, in radians: 144°. No lens on the market has a field of
/// view above 288°.
const MAX_ANGLE: f64 = 0.8 * std::f64::consts::PI;

/// Profile of a lens: the image radius P, divided by the focal length, of a ray at the angle theta from the
/// optical axis, in radians. `P(0) = 0` and `P'(0) = 1`, so the focal length is the one at the image centre.
pub(super) trait Profile {
    /// Number of coefficients that can be fitted.
    const COEFFICIENTS: usize = 0;

    /// Returns the image radius P at the angle `theta`.
    fn radius(&self, theta: f64) -> f64;

    /// Returns the first derivative P' at the angle `theta`.
    fn slope(&self, theta: f64) -> f64;

    /// Returns the second derivative P'' at the angle `theta`.
    fn curvature(&self, theta: f64) -> f64;

    /// Returns the derivatives of P and P' with respect to every coefficient that can be fitted, at the angle
    /// `theta`.
    fn by_coefficients(&self, _theta: f64) -> [[f64; 2]; Distortion::MAX_FITTED] {
        Default::default()
    }

    /// Returns the angle below [`Self::max_angle`], in radians, at which P is `radius`: the inverse of P.
    /// Returns `None` if there is no such angle.
    fn inverse(&self, radius: f64) -> Option<f64>;

    /// Returns the angle at which P stops increasing, in radians. It is infinite if P always increases, and
    /// negative if the coefficients do not describe a lens.
    fn max_angle(&self) -> f64;
}

/// Returns the angle of a ray from the optical axis, in radians, at an image radius that is divided by the
/// focal length. Returns `None` if no ray reaches the radius.
fn angle_at_radius(profile: &impl Profile, radius: f64) -> Option<f64> {
    profile.inverse(radius).filter(|&theta| theta <= MAX_ANGLE)
}

impl<P: Profile> Model for P {
    fn max_radius(&self) -> f64 {
        let theta = self.max_angle();
        if theta < std::f64::consts::FRAC_PI_2 { tan(theta).max(0.0) } else { f64::INFINITY }
    }

    fn distort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let radius = hypot(x, y);
        let theta = atan(radius);
        if theta > self.max_angle() {
            return None;
        }
        let scale = if radius < MIN_RADIUS { 1.0 } else { self.radius(theta) / radius };
        Some([scale * x, scale * y])
    }

    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let radius = hypot(x, y);
        let theta = self.inverse(radius)?;
        if theta >= std::f64::consts::FRAC_PI_2 {
            return None;
        }
        let scale = if radius < MIN_RADIUS { 1.0 } else { tan(theta) / radius };
        Some([scale * x, scale * y])
    }

    /// Whether a ray reaches this distorted point, including rays 90° or more from the optical axis.
    fn has_ray(&self, [x, y]: [f64; 2]) -> bool {
        angle_at_radius(self, hypot(x, y)).is_some()
    }

    fn ray(&self, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
        let radius = hypot(x, y);
        let (sin, cos) = sin_cos(angle_at_radius(self, radius)?);
        let scale = if radius < MIN_RADIUS { 1.0 } else { sin / radius };
        Some([scale * x, scale * y, cos])
    }

    fn ray_to_distorted(&self, [x, y, w]: [f64; 3]) -> Option<[f64; 2]> {
        let across = hypot(x, y);
        let theta = angle_from_axis(across, w);
        if theta > MAX_ANGLE || theta > self.max_angle() {
            return None;
        }
        let scale = if across < MIN_RADIUS * w { w.recip() } else { self.radius(theta) / across };
        Some([scale * x, scale * y])
    }

    fn ray_jacobian(&self, distorted: [f64; 2], [x, y, w]: [f64; 3]) -> RayMatrix {
        let (radius, sin) = (hypot(distorted[0], distorted[1]), hypot(x, y));
        if radius < MIN_RADIUS {
            return [[1.0, 0.0], [0.0, 1.0], [0.0; 2]];
        }
        let turn = self.slope(angle_from_axis(sin, w)).recip();
        let [u, v] = radial(distorted, sin / radius, w * turn);
        [u, v, distorted.map(|c| -sin * turn * c / radius)]
    }

    /// Returns the derivatives of the Jacobian of the ray `(s q, cos theta)` with respect to the distorted point q,
    /// where `s = sin theta / r` and r is the radius of q. The unit vector n is the direction of q from the centre,
    /// and I the identity. Here, primes are derivatives with respect to r. The derivatives of the first two
    /// components are `s' (n_i I_jk + n_j I_ik + n_k I_ij) + (r s'' - s') n_i n_j n_k`. The derivatives of the third
    /// component are `cos' (I_jk - n_j n_k) / r + cos'' n_j n_k`. Their terms are `r s' = cos theta theta' - s` and
    /// `r s'' = cos theta theta'' - sin theta theta'^2 - 2 s'`.
    fn ray_curvature(&self, distorted: [f64; 2], [x, y, w]: [f64; 3]) -> RayCurvature {
        let (radius, sin) = (hypot(distorted[0], distorted[1]), hypot(x, y));
        if radius < MIN_RADIUS {
            return [[[0.0; 2], [0.0; 2], [-1.0, 0.0]], [[0.0; 2], [0.0; 2], [0.0, -1.0]]];
        }
        let theta = angle_from_axis(sin, w);
        // First and second derivative of theta with respect to r.
        let turn = self.slope(theta).recip();
        let bend = -self.curvature(theta) * turn * turn * turn;
        // s' and r s'' - s'.
        let slope = (w * turn - sin / radius) / radius;
        let cubic = w * bend - sin * turn * turn - 3.0 * slope;
        let of_cos = radial(distorted, -sin * turn / radius, -w * turn * turn - sin * bend);
        let n = distorted.map(|c| c / radius);
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
        distorted: [f64; 2],
        [x, y, w]: [f64; 3],
    ) -> [RayByCoefficient; Distortion::MAX_FITTED] {
        let (radius, sin) = (hypot(distorted[0], distorted[1]), hypot(x, y));
        let mut by = [RayByCoefficient::default(); Distortion::MAX_FITTED];
        if radius < MIN_RADIUS {
            return by;
        }
        let theta = angle_from_axis(sin, w);
        let (derivative, second) = (self.slope(theta), self.curvature(theta));
        let turn = derivative.recip();
        for (by, [d_radius, d_slope]) in by.iter_mut().zip(self.by_coefficients(theta)).take(P::COEFFICIENTS)
        {
            let d_theta = -d_radius * turn;
            // Derivative of 1 / P' with respect to the coefficient.
            let d_turn = -(second * d_theta + d_slope) * turn * turn;
            let [u, v] = radial(distorted, w * d_theta / radius, w * d_turn - sin * turn * d_theta);
            let ahead = -(w * turn * d_theta + sin * d_turn) / radius;
            let [x, y] = distorted.map(|c| w * d_theta * c / radius);
            *by = RayByCoefficient {
                at: [x, y, -sin * d_theta],
                jacobian: [u, v, distorted.map(|c| ahead * c)],
            };
        }
        by
    }

    fn distort_jacobian(&self, [x, y]: [f64; 2]) -> Matrix2 {
        let radius = hypot(x, y);
        let theta = atan(radius);
        let across = if radius < MIN_RADIUS { 1.0 } else { self.radius(theta) / radius };
        radial([x, y], across, self.slope(theta) / (1.0 + radius * radius))
    }

    fn distort_by_coefficients(&self, [x, y]: [f64; 2]) -> [[f64; 2]; Distortion::MAX_FITTED] {
        let radius = hypot(x, y);
        let mut by = [[0.0; 2]; Distortion::MAX_FITTED];
        if radius >= MIN_RADIUS {
            let terms = self.by_coefficients(atan(radius));
            for (by, [d_radius, _]) in by.iter_mut().zip(terms).take(P::COEFFICIENTS) {
                let along = d_radius / radius;
                *by = [along * x, along * y];
            }
        }
        by
    }

    fn undistort_jacobian(&self, distorted: [f64; 2], undistorted: [f64; 2]) -> Matrix2 {
        let (radius, tangent) = (hypot(distorted[0], distorted[1]), hypot(undistorted[0], undistorted[1]));
        let across = if radius < MIN_RADIUS { 1.0 } else { tangent / radius };
        radial(distorted, across, (1.0 + tangent * tangent) / self.slope(atan(tangent)))
    }

    fn undistort_by_coefficients(&self, distorted: [f64; 2], undistorted: [f64; 2]) -> ByCoefficients {
        let (radius, tangent) = (hypot(distorted[0], distorted[1]), hypot(undistorted[0], undistorted[1]));
        let mut by = ByCoefficients::default();
        if radius < MIN_RADIUS {
            return by;
        }
        let (theta, gain) = (atan(tangent), 1.0 + tangent * tangent);
        let (derivative, second) = (self.slope(theta), self.curvature(theta));
        for (by, [d_radius, d_slope]) in by.iter_mut().zip(self.by_coefficients(theta)).take(P::COEFFICIENTS)
        {
            let d_theta = -d_radius / derivative;
            let d_derivative = second * d_theta + d_slope;
            let across = gain * d_theta / radius;
            // Derivative of (1 + tan^2 theta) / P' with respect to the coefficient.
            let along = gain * (2.0 * tangent * d_theta - d_derivative / derivative) / derivative;
            *by = ByCoefficient {
                at: distorted.map(|c| across * c),
                jacobian: radial(distorted, across, along),
            };
        }
        by
    }
}
