//! What is believed of a camera before anything is drawn: it stands upright, more or less, and shows the floor.
//!
//! A view and the same view turned by 180 degrees about the horizon's normal fit lines alike: roll and
//! `roll + 180 degrees`, pitch and `-pitch`. Floor and ceiling, feet and heads tell them apart, parallel lines
//! do not. So of minima that fit alike the more plausible one is chosen, and one that is beyond belief beside it
//! is no solution.

use crate::camera::{Camera, Pixel};
use crate::floor::{default_efov, efov_on_floor};

/// Standard deviation of the roll of installed cameras, 30 degrees: none hangs on its side or upside down.
const ROLL: f64 = std::f64::consts::FRAC_PI_6;
/// What a camera costs that shows no floor where its field of view is: six sigmas.
const NO_FLOOR: f64 = 36.0;
/// By how much one camera must be less plausible than another to be ruled out: four sigmas, for both are
/// weak beliefs. Up to 50 degrees of roll the camera turned by 180 degrees is ruled out.
pub(crate) const BEYOND_BELIEF: f64 = 16.0;

/// Minus twice the log of how plausible a camera is, of roll and floor alone.
pub(crate) fn implausibility(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> f64 {
    let half = std::f64::consts::PI;
    let roll = (camera.roll + half).rem_euclid(2.0 * half) - half;
    (roll / ROLL).powi(2) + NO_FLOOR * share_without_floor(camera, efov, size)
}

/// The share of the corners of the drawn field of view that lie on no floor; without one, 1 if no floor is near.
fn share_without_floor(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> f64 {
    if efov.is_empty() {
        return f64::from(u8::from(default_efov(camera, size).polygon.is_empty()));
    }
    if !efov_on_floor(camera, efov).clipped {
        return 0.0;
    }
    let above = efov.iter().filter(|&&corner| camera.pixel_to_floor(corner, 0.0).is_none()).count();
    above as f64 / efov.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_camera_that_looks_down_is_believed_and_its_twin_is_not(camera in any_camera()) {
            let camera = Camera { pitch: camera.pitch.abs().clamp(0.4, 1.2), ..camera };
            let twin = Camera { roll: camera.roll + std::f64::consts::PI, pitch: -camera.pitch, ..camera };
            let of = |camera: &Camera| implausibility(camera, &[], [1920.0, 1080.0]);
            prop_assert!(of(&twin) - of(&camera) > BEYOND_BELIEF, "{} {}", of(&twin), of(&camera));
        }
    }
}
