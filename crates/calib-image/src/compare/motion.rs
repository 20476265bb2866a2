//! Motion of a camera between two images: rotation, zoom and a step (translation). The effect of the step is
//! predicted for edges on the floor; edges above the horizon count as infinitely far.

use calib_core::{Camera, Pixel};

use calib_core::camera::{RotatedCamera, RotationZoom, inverse_floor_depth, pixel_to_camera_ray};

use crate::{RotationFit, STEP_SIZE};

/// Step of the finite differences. The unit is radians for a rotation, and the log of the focal ratio for a zoom.
/// For a step of the camera, the unit is metres at a depth of one metre.
const DIFFERENCE_STEP: f64 = 1e-5;

/// Ray and inverse floor depth of a pixel, in the axes of the old camera.
#[derive(Clone, Copy)]
pub(crate) struct Sight {
    /// Ray (right, down, forward), with the forward component 1.
    pub(crate) ray: [f64; 3],
    /// Inverse of the depth of the floor along the ray, per metre; 0 above the horizon.
    pub(crate) nearness: f64,
}

/// Motion of a camera: rotation with zoom, and a step (translation).
#[derive(Clone, Copy, Default)]
pub(crate) struct Motion {
    /// Rotation and zoom.
    pub(crate) turn: RotationZoom,
    /// Step in the axes of the old camera, in metres.
    pub(crate) step: [f64; STEP_SIZE],
}

/// Camera after a motion, with slightly rotated cameras for finite differences.
pub(crate) struct MovedCamera {
    /// Camera after the rotation and zoom.
    here: RotatedCamera,
    /// Camera after the rotation and zoom, with a small change of each parameter.
    perturbed: [RotatedCamera; RotationZoom::SIZE],
    /// Step in the axes of the old camera, in metres.
    step: [f64; STEP_SIZE],
}

/// Derivatives of a pixel of the new image, along u and v.
#[derive(Default)]
pub(crate) struct PixelDerivatives {
    /// Derivatives with respect to rotation and zoom.
    pub(crate) turn: [[f64; 2]; RotationZoom::SIZE],
    /// Derivatives with respect to the step, in pixels per metre.
    pub(crate) step: [[f64; 2]; STEP_SIZE],
}

impl Sight {
    pub(crate) fn new(camera: &Camera, at: Pixel) -> Option<Self> {
        let ray = pixel_to_camera_ray(camera, at)?;
        Some(Self { ray, nearness: inverse_floor_depth(camera, ray) })
    }
}

impl From<RotationZoom> for Motion {
    fn from(turn: RotationZoom) -> Self {
        Self { turn, ..Self::default() }
    }
}

impl Motion {
    /// Returns this motion followed by the motion of a fit.
    pub(crate) fn then(&self, fit: &RotationFit) -> Self {
        let step = fit.step();
        Self {
            turn: self.turn.followed_by(&fit.rotation()),
            step: std::array::from_fn(|k| self.step[k] + step[k]),
        }
    }

    /// Returns a camera after this motion.
    pub(crate) fn at(&self, camera: &Camera) -> MovedCamera {
        let perturbed = std::array::from_fn(|k| {
            let mut step = [0.0; RotationZoom::SIZE];
            step[k] = DIFFERENCE_STEP;
            self.turn.followed_by(&RotationZoom::from_parameters(step)).for_camera(camera)
        });
        MovedCamera { here: self.turn.for_camera(camera), perturbed, step: self.step }
    }
}

impl MovedCamera {
    /// Projects a sight into the new image: its floor point, or above the horizon a point at infinity. Returns `None`
    /// outside the lens.
    pub(crate) fn project(&self, sight: &Sight) -> Option<Pixel> {
        self.here.ray_to_pixel(self.ray(sight))
    }

    /// Computes the derivatives of the projection of a sight with respect to rotation, zoom and step.
    pub(crate) fn derivatives(&self, sight: &Sight) -> Option<PixelDerivatives> {
        let (ray, at) = (self.ray(sight), self.project(sight)?);
        let slope = |to: Pixel| [(to.u - at.u) / DIFFERENCE_STEP, (to.v - at.v) / DIFFERENCE_STEP];
        let mut slopes = PixelDerivatives::default();
        for (by, camera) in slopes.turn.iter_mut().zip(&self.perturbed) {
            *by = slope(camera.ray_to_pixel(ray)?);
        }
        for (k, by) in slopes.step.iter_mut().enumerate() {
            let mut perturbed = ray;
            perturbed[k] -= DIFFERENCE_STEP;
            *by = slope(self.here.ray_to_pixel(perturbed)?).map(|c| sight.nearness * c);
        }
        Some(slopes)
    }

    /// Returns the ray of a sight from the camera after the step, in the axes of the old camera.
    fn ray(&self, sight: &Sight) -> [f64; 3] {
        std::array::from_fn(|k| sight.ray[k] - sight.nearness * self.step[k])
    }
}
