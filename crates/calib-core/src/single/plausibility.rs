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
/// The cosine of 60 degrees of pitch, beyond which a roll means less and less.
const STEEP: f64 = 0.5;
/// By how much one camera must be less plausible than another to be ruled out: four sigmas, for both are
/// weak beliefs. Up to 50 degrees of roll and 60 of pitch the camera turned by 180 degrees is ruled out.
pub(crate) const BEYOND_BELIEF: f64 = 16.0;

/// Minus twice the log of how plausible a camera is, of roll and floor alone. Where a camera looks along the vertical,
/// roll and yaw trade places, and nothing hangs on its side.
pub(crate) fn implausibility(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> f64 {
    let half = std::f64::consts::PI;
    let roll = (camera.roll + half).rem_euclid(2.0 * half) - half;
    let meaning = (camera.pitch.cos() / STEEP).clamp(0.0, 1.0);
    (roll * meaning / ROLL).powi(2) + NO_FLOOR * share_without_floor(camera, efov, size)
}

/// The share of the corners of the drawn field of view that lie on no floor; without one, 1 if no floor is near, or, of a
/// wide lens, which sees some floor wherever it looks, the share of the image.
fn share_without_floor(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> f64 {
    if efov.is_empty() && camera.lens.distortion.is_wide() {
        return share_of_image_without_floor(camera, size);
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

fn share_of_image_without_floor(camera: &Camera, [w, h]: [f64; 2]) -> f64 {
    /// Rows and columns at whose middles the image is looked at.
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
        fn a_camera_that_looks_down_is_believed_and_its_twin_is_not(camera in any_camera()) {
            let camera = Camera { pitch: camera.pitch.abs().clamp(0.4, 1.2), ..camera };
            let twin = Camera { roll: camera.roll + std::f64::consts::PI, pitch: -camera.pitch, ..camera };
            let of = |camera: &Camera| implausibility(camera, &[], [1920.0, 1080.0]);
            prop_assert!(of(&twin) - of(&camera) > BEYOND_BELIEF, "{} {}", of(&twin), of(&camera));
        }
    }
}
