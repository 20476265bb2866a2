//! Heading of a camera that looks straight down. Roll and yaw are not separable there, but the heading of the
//! image is determined.
//!
//! Let `p` be the pitch, `r` the roll and `y` the yaw. Let `forward` and `right` be the horizontal unit
//! vectors at the yaw `y`. The top of the image has the floor direction
//! `sin r * right + cos r * sin p * forward`. The heading of this direction is
//! `y - atan2(sin r, cos r * sin p)`. At `p` = 90° the heading is `y - r`, which can be well determined even
//! if neither `y` nor `r` is.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::camera::covariance::Covariance;
use crate::camera::numerics::sin_cos;
use crate::camera::pinhole::Camera;

/// Orientation of a camera that looks straight down, or nearly so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StraightDown {
    /// Angle between the optical axis and the vertical, in radians.
    pub tilt: f64,
    /// Standard deviation of the tilt, in radians; `None` if it was not estimated or is unknown.
    pub tilt_sigma: Option<f64>,
    /// Heading of the top of the image on the floor. Like the yaw, it is counter-clockwise from world +y, in
    /// radians above -pi and up to pi.
    pub heading: f64,
    /// Standard deviation of the heading, in radians. It is `None` if none of x, y and yaw was estimated, if all
    /// angles are fixed, or if an uncertainty is unknown.
    pub heading_sigma: Option<f64>,
}

impl Camera {
    /// Returns the heading and tilt of a camera that looks straight down. Returns `None` if its pitch differs
    /// from 90° by more than 10°.
    #[must_use]
    pub fn straight_down(&self) -> Option<StraightDown> {
        /// Largest angle between the optical axis and the vertical, in radians. Up to this angle, roll and
        /// yaw are hardly separable.
        const MAX_TILT: f64 = 10.0 * PI / 180.0;
        let tilt = (FRAC_PI_2 - self.pitch).abs();
        if tilt > MAX_TILT {
            return None;
        }
        let ((sin_pitch, cos_pitch), (sin, cos)) = (sin_cos(self.pitch), sin_cos(self.roll));
        let heading = self.yaw - sin.atan2(cos * sin_pitch);
        let square = sin * sin + (cos * sin_pitch).powi(2);
        let slopes = [
            (Covariance::YAW, 1.0),
            (Covariance::PITCH, sin * cos * cos_pitch / square),
            (Covariance::ROLL, -sin_pitch / square),
        ];
        let covariance = &self.covariance.0;
        let terms = slopes.iter().flat_map(|a| slopes.iter().map(move |b| (a, b)));
        let variance: f64 = terms.map(|(a, b)| a.1 * b.1 * covariance[a.0][b.0]).sum();
        // If x, y and yaw were not estimated, the camera is not placed, and the heading is unknown. A fixed yaw
        // of a placed camera has no error.
        let of_place = [Covariance::X, Covariance::Y, Covariance::YAW];
        let is_placed = of_place.into_iter().any(|index| self.covariance.sigma(index).is_some());
        let is_known = is_placed && variance > 0.0 && variance.is_finite();
        Some(StraightDown {
            tilt,
            tilt_sigma: self.covariance.sigma(Covariance::PITCH),
            heading: PI - (PI - heading).rem_euclid(2.0 * PI),
            heading_sigma: is_known.then(|| variance.sqrt()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Lens, Pixel, WorldPoint};
    use proptest::prelude::*;

    fn camera(roll: f64, pitch: f64, yaw: f64) -> Camera {
        Camera {
            position: WorldPoint { x: 1.0, y: 2.0, z: 3.0 },
            yaw,
            pitch,
            roll,
            focal: 500.0,
            lens: Lens::pinhole(Pixel::new(500.0, 400.0)),
            covariance: Covariance::EXACT,
        }
    }

    fn angle(between: f64) -> f64 {
        (between + PI).rem_euclid(2.0 * PI) - PI
    }

    proptest! {
        #[test]
        fn heading_is_the_floor_direction_of_the_image_top(
            roll in -PI..PI, tilt in -0.17..0.17, yaw in -PI..PI, step in prop::array::uniform3(-1e-3..1e-3),
        ) {
            let own = camera(roll, FRAC_PI_2 - tilt, yaw);
            let said = own.straight_down().unwrap();
            let [_, down, forward] = own.rotation();
            prop_assert!(angle(said.heading - down[0].atan2(-down[1])).abs() < 1e-9);
            prop_assert!((said.tilt - (-forward[2]).clamp(-1.0, 1.0).acos()).abs() < 1e-7);
            // The errors of the three angles are fully correlated.
            let [by_roll, by_pitch, by_yaw] = step;
            let mut uncertain = own;
            let by = [(Covariance::ROLL, by_roll), (Covariance::PITCH, by_pitch), (Covariance::YAW, by_yaw)];
            for (i, a) in by {
                for (j, b) in by {
                    uncertain.covariance.0[i][j] = a * b;
                }
            }
            let other = camera(roll + by_roll, own.pitch + by_pitch, yaw + by_yaw);
            if let Some(moved) = other.straight_down() {
                let sigma = uncertain.straight_down().unwrap().heading_sigma.unwrap_or(0.0);
                prop_assert!((angle(moved.heading - said.heading).abs() - sigma).abs() < 5e-6);
            }
        }
    }

    #[test]
    fn heading_is_determined_where_roll_and_yaw_are_not() {
        let mut own = camera(0.3, FRAC_PI_2 - 0.01, 1.1);
        let (wide, narrow) = (0.07_f64.powi(2), 0.001_f64.powi(2));
        own.covariance.0[Covariance::YAW][Covariance::YAW] = wide + narrow;
        own.covariance.0[Covariance::ROLL][Covariance::ROLL] = wide;
        own.covariance.0[Covariance::YAW][Covariance::ROLL] = wide;
        own.covariance.0[Covariance::ROLL][Covariance::YAW] = wide;
        let said = own.straight_down().unwrap();
        assert!((said.heading - 0.8).abs() < 1e-4 && said.heading_sigma.unwrap() < 0.0012, "{said:?}");
        let unknown = Camera { covariance: Covariance::UNKNOWN, ..own }.straight_down().unwrap();
        assert_eq!((unknown.heading_sigma, unknown.tilt_sigma), (None, None));
        assert!(camera(0.3, 1.3, 1.1).straight_down().is_none());
    }
}
