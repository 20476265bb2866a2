//! How high a camera is by each upright alone: where they contradict each other, the wrong one is at an end.
//!
//! Under an orientation, the ray of the foot meets the floor at the distance `z |f|` from the point below the camera,
//! `z` being the camera's height and `f` what the ray moves along the floor while it falls one metre. The ray of the
//! head, with the part `a` along `f` and the rise `c`, passes above that point at the height `z + z |f| c / a`, which is
//! that of the upright, `h`: so `z = h a / (a + |f| c)`.

use crate::camera::{Camera, Pixel};
use crate::single::annotation::Annotation;
use crate::single::constraints::Source;

/// The uprights by which a camera is lowest and highest, each with that height in metres, where these contradict each
/// other.
pub fn heights_apart(camera: &Camera, annotations: &[Annotation]) -> Option<[(Source, f64); 2]> {
    /// Ratio of heights that a foot and a head drawn with the usual noise do not reach.
    const APART: f64 = 1.04;
    let on = annotations.iter().enumerate().filter(|(_, annotation)| !annotation.off);
    let mut heights: Vec<(Source, f64)> = on
        .filter_map(|(index, annotation)| {
            let height = height_by(camera, annotation)?;
            Some((Source { annotation: index, segment: 0 }, height))
        })
        .collect();
    heights.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (lowest, highest) = (*heights.first()?, *heights.last()?);
    (highest.1 > APART * lowest.1).then_some([lowest, highest])
}

/// How high a camera of this orientation is by an upright of known height on the floor.
fn height_by(camera: &Camera, annotation: &Annotation) -> Option<f64> {
    let on_floor = annotation.plane.is_none();
    let (foot, head) = annotation.foot.zip(annotation.head).filter(|_| on_floor)?;
    let upright = annotation.height()?.value;
    let ray = |pixel: Pixel| camera.pixel_to_ray(pixel).map(|ray| ray.direction);
    let ([x, y, fall], [u, v, rise]) = (ray(foot)?, ray(head)?);
    let along = [-x / fall, -y / fall];
    let reach = along[0].hypot(along[1]);
    let forward = (along[0] * u + along[1] * v) / reach;
    let height = upright * forward / (forward + reach * rise);
    (fall < 0.0 && forward > 0.0 && height.is_finite() && height > 0.0).then_some(height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::WorldPoint;
    use crate::camera::any_camera;
    use crate::single::annotation::{Kind, Known};
    use proptest::prelude::*;

    /// Somebody who stands there, as the camera shows them, said to be of another height.
    fn upright(camera: &Camera, [x, y]: [f64; 2], height: f64, said: f64) -> Option<Annotation> {
        let shown = |z: f64| camera.world_to_pixel(WorldPoint::new(x, y, z));
        let mut annotation = Annotation::new(Kind::Upright);
        annotation.foot = Some(shown(0.0)?);
        annotation.head = Some(shown(height)?);
        annotation.height_m = Some(Known::fixed(said));
        Some(annotation)
    }

    proptest! {
        #[test]
        fn an_upright_tells_the_height_in_proportion_to_its_own(
            camera in any_camera(), x in -4.0..4.0_f64, y in 3.0..9.0_f64, said in 0.5..3.0_f64,
        ) {
            let Some(annotation) = upright(&camera, [x, y], 1.7, said) else { return Ok(()) };
            let Some(height) = height_by(&camera, &annotation) else { return Ok(()) };
            let expected = camera.position.z * said / 1.7;
            prop_assert!((height / expected - 1.0).abs() < 1e-5, "{height} for {expected}");
        }
    }

    #[test]
    fn uprights_that_contradict_each_other_are_the_lowest_and_the_highest() {
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 0.5,
            roll: 0.02,
            focal: 1400.0,
            lens: crate::camera::Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: crate::camera::Covariance::EXACT,
        };
        let at = |place, said| upright(&camera, place, 1.75, said);
        let mut all: Vec<Annotation> = [at([-1.0, 5.0], 1.75), at([1.0, 6.0], 1.4), at([0.5, 4.5], 1.76)]
            .into_iter()
            .flatten()
            .collect();
        assert_eq!(all.len(), 3, "the camera shows them");
        let [(wrong, low), (right, high)] = heights_apart(&camera, &all).unwrap();
        assert_eq!([wrong.annotation, right.annotation], [1, 2]);
        assert!((low - 2.4).abs() < 1e-6 && (high - 3.0 * 1.76 / 1.75).abs() < 1e-6, "{low} {high}");
        all[1].off = true;
        assert_eq!(heights_apart(&camera, &all), None, "what is left agrees");
        assert_eq!(heights_apart(&camera, &all[..1]), None, "nothing to compare it with");
    }
}
