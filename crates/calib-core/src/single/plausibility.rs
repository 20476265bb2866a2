//! Prior on the pose of a camera: roughly upright, and looking somewhat down.
//!
//! A camera and its twin, rotated by 180 degrees about the normal of the horizon plane, fit lines equally
//! well. Their rolls are `r` and `r + 180 degrees`, their pitches `p` and `-p`. Floor and ceiling, feet and
//! heads distinguish them; parallel lines do not. So among minima with equal fit the more plausible one is
//! chosen. A minimum that is much less plausible is not a solution.
//!
//! The prior uses the floor only if a field of view is annotated. A camera at eye level that looks up slightly
//! shows almost no floor, but its twin shows much floor.

use std::f64::consts::{FRAC_PI_6, FRAC_PI_8, PI, TAU};

use crate::camera::{Camera, Pixel};
use crate::floor::efov_on_floor;

/// Standard deviation of the roll of installed cameras, 30 degrees: few cameras are mounted sideways or
/// upside down.
const ROLL_SIGMA_RAD: f64 = FRAC_PI_6;
/// Mean of the pitch of installed cameras, 22.5 degrees.
const PITCH_MEAN_RAD: f64 = FRAC_PI_8;
/// Standard deviation of the pitch of installed cameras, 22.5 degrees.
const PITCH_SIGMA_RAD: f64 = FRAC_PI_8;
/// Cost of a camera that sees no floor in the annotated field of view: ten standard deviations, squared. The field of
/// view is annotated where the floor is visible.
const NO_FLOOR_COST: f64 = 100.0;
/// Cosine of 60 degrees of pitch, beyond which the cost of roll decreases.
const STEEP_PITCH_COS: f64 = 0.5;
/// Difference in cost that rules out the less plausible of two cameras: almost four sigmas, because both
/// priors are weak.
///
/// Up to 45 degrees of roll, the camera rotated by 180 degrees is ruled out.
pub(crate) const MIN_COST_DIFFERENCE: f64 = 14.0;

/// Returns minus twice the log prior probability of a camera, up to a constant. It depends on roll, pitch and the
/// annotated field of view on the floor, `efov`, which may be empty.
///
/// If a camera looks along the vertical, roll and yaw are interchangeable, so roll has no cost.
pub(crate) fn implausibility(camera: &Camera, efov: &[Pixel]) -> f64 {
    let roll = (camera.roll + PI).rem_euclid(TAU) - PI;
    let meaning = (camera.pitch.cos() / STEEP_PITCH_COS).clamp(0.0, 1.0);
    let of_roll = (roll * meaning / ROLL_SIGMA_RAD).powi(2);
    let of_pitch = ((camera.pitch - PITCH_MEAN_RAD) / PITCH_SIGMA_RAD).powi(2);
    of_roll + of_pitch + NO_FLOOR_COST * fraction_without_floor(camera, efov)
}

/// Returns the fraction of the corners of the annotated field of view that are not on the floor; 0 if no field
/// of view is annotated.
fn fraction_without_floor(camera: &Camera, efov: &[Pixel]) -> f64 {
    if efov.is_empty() || !efov_on_floor(camera, efov).clipped {
        return 0.0;
    }
    let above = efov.iter().filter(|&&corner| camera.pixel_to_floor(corner, 0.0).is_none()).count();
    above as f64 / efov.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{WorldPoint, any_camera};
    use proptest::prelude::*;

    /// Returns the twin of a camera, rotated by 180 degrees about the normal of the horizon plane. Both fit lines
    /// equally well.
    fn twin(camera: &Camera) -> Camera {
        Camera { roll: camera.roll + PI, pitch: -camera.pitch, ..*camera }
    }

    proptest! {
        #[test]
        fn upright_camera_is_plausible_and_its_twin_is_not(
            camera in any_camera(), roll_deg in -45.0..45.0_f64, pitch_deg in -15.0..90.0_f64,
        ) {
            let camera = Camera { roll: roll_deg.to_radians(), pitch: pitch_deg.to_radians(), ..camera };
            let [one, other] = [camera, twin(&camera)].map(|camera| implausibility(&camera, &[]));
            prop_assert!(other - one > MIN_COST_DIFFERENCE, "{other} {one}");
        }

        #[test]
        fn a_drawn_field_of_view_on_the_floor_outweighs_the_roll(
            camera in any_camera(), roll_deg in 130.0..230.0_f64, pitch_deg in 20.0..50.0_f64,
        ) {
            let camera = Camera { roll: roll_deg.to_radians(), pitch: pitch_deg.to_radians(), ..camera };
            let (sin, cos) = camera.yaw.sin_cos();
            let pixel = |[x, y]: [f64; 2]| {
                let [east, north] = [x * cos - y * sin, x * sin + y * cos];
                let WorldPoint { x, y, .. } = camera.position;
                camera.world_to_pixel(WorldPoint { x: x + east, y: y + north, z: 0.0 })
            };
            let ahead = [[-1.0, 8.0], [1.0, 8.0], [1.0, 5.0], [-1.0, 5.0]];
            let efov: Vec<Pixel> = ahead.into_iter().filter_map(pixel).collect();
            prop_assume!(efov.len() == 4);
            let [one, other] = [camera, twin(&camera)].map(|camera| implausibility(&camera, &efov));
            prop_assert!(other - one > MIN_COST_DIFFERENCE, "{other} {one}");
        }
    }
}
