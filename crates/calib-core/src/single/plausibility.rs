//! Prior on the pose of a camera: roughly upright, with the floor in view.
//!
//! A camera and the same camera rotated by 180 degrees about the normal of the horizon plane fit lines
//! equally well. Their rolls are `r` and `r + 180 degrees`, their pitches `p` and `-p`. Floor and ceiling,
//! feet and heads distinguish them; parallel lines do not. So among minima with equal fit the more plausible
//! one is chosen. A minimum that is much less plausible is not a solution.

use crate::camera::{Camera, Pixel};
use crate::floor::{default_efov, efov_on_floor};

/// Standard deviation of the roll of installed cameras, 30 degrees: no camera is mounted sideways or upside
/// down.
const ROLL_SIGMA_RAD: f64 = std::f64::consts::FRAC_PI_6;
/// Cost of a camera whose field of view contains no floor: six sigmas.
const NO_FLOOR_COST: f64 = 36.0;
/// Cosine of 60 degrees of pitch, beyond which the cost of roll decreases.
const STEEP_PITCH_COS: f64 = 0.5;
/// Difference in cost that rules out the less plausible of two cameras: four sigmas, because both priors are
/// weak.
///
/// Up to 50 degrees of roll and 60 degrees of pitch, the camera rotated by 180 degrees is ruled out.
pub(crate) const MIN_COST_DIFFERENCE: f64 = 16.0;

/// Returns minus twice the log prior probability of a camera, from its roll and visible floor only.
///
/// If a camera looks along the vertical, roll and yaw are interchangeable, so roll has no cost.
pub(crate) fn implausibility(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> f64 {
    let half = std::f64::consts::PI;
    let roll = (camera.roll + half).rem_euclid(2.0 * half) - half;
    let meaning = (camera.pitch.cos() / STEEP_PITCH_COS).clamp(0.0, 1.0);
    (roll * meaning / ROLL_SIGMA_RAD).powi(2) + NO_FLOOR_COST * fraction_without_floor(camera, efov, size)
}

/// Returns the fraction of the corners of the drawn field of view that are not on the floor.
///
/// Without a drawn field of view it is 1 if no floor is near, and else 0. A wide lens sees some floor in any
/// pose, so the fraction of the image is used for it.
fn fraction_without_floor(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> f64 {
    if efov.is_empty() && camera.lens.distortion.is_wide() {
        return image_fraction_without_floor(camera, size);
    }
    if efov.is_empty() {
        return f64::from(u8::from(default_efov(camera, size).polygon.is_empty()));
    }
    if !efov_on_floor(camera, efov).clipped {
        return 0.0;
    }
    let above = efov.iter().filter(|&&corner| camera.pixel_to_floor(corner, 0.0).is_none()).count();
    above as f64 / efov.len() as f64
}

/// Returns the fraction of the visible part of the image that is not on the floor.
fn image_fraction_without_floor(camera: &Camera, [w, h]: [f64; 2]) -> f64 {
    /// Number of rows and columns of cells whose centres are sampled.
    const CELLS: u32 = 8;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(CELLS);
    let pixels = (0..CELLS).flat_map(|i| (0..CELLS).map(move |j| Pixel::new(w * at(i), h * at(j))));
    let seen: Vec<Pixel> = pixels.filter(|&pixel| camera.pixel_to_ray(pixel).is_some()).collect();
    let above = seen.iter().filter(|&&pixel| camera.pixel_to_floor(pixel, 0.0).is_none()).count();
    above as f64 / seen.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn camera_that_looks_down_is_plausible_and_its_opposite_is_not(camera in any_camera()) {
            let camera = Camera { pitch: camera.pitch.abs().clamp(0.4, 1.2), ..camera };
            let twin = Camera { roll: camera.roll + std::f64::consts::PI, pitch: -camera.pitch, ..camera };
            let of = |camera: &Camera| implausibility(camera, &[], [1920.0, 1080.0]);
            prop_assert!(of(&twin) - of(&camera) > MIN_COST_DIFFERENCE, "{} {}", of(&twin), of(&camera));
        }
    }
}
