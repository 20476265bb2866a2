//! What is believed of a camera before an edge is seen: it stands upright and its lens is a usual one.

use calib_core::Orientation;

/// Standard deviation of the roll of cameras that somebody set up, in radians.
const ROLL: f64 = 0.08;
/// Widths of the image that the focal is, and the standard deviation of its log: the weak prior of the core.
const FOCAL: [f64; 2] = [0.8, 0.35];

/// Normal densities of roll and log focal, and a pitch by which every direction of sight is as likely.
#[derive(Clone, Copy, Debug)]
pub(super) struct Belief {
    log_focal: f64,
}

impl Belief {
    /// Of a camera with images of this width, in pixels.
    pub(super) fn of_width(width: f64) -> Self {
        Self { log_focal: (FOCAL[0] * width).ln() }
    }

    /// Log density of a camera by roll, pitch and log focal, up to a constant.
    pub(super) fn log_density(&self, camera: &Orientation) -> f64 {
        let square: f64 = self.residuals(camera).iter().map(|(residual, _)| residual * residual).sum();
        camera.pitch.cos().max(1e-3).ln() - 0.5 * square
    }

    /// How unusual a camera is: its larger residual, in sigmas.
    pub(super) fn sigmas(&self, camera: &Orientation) -> f64 {
        self.residuals(camera).iter().map(|(residual, _)| residual.abs()).fold(0.0, f64::max)
    }

    /// The residuals of roll and log focal in sigmas, each with its derivative.
    pub(super) fn residuals(&self, camera: &Orientation) -> [(f64, f64); 2] {
        [
            (camera.roll / ROLL, ROLL.recip()),
            ((camera.focal.ln() - self.log_focal) / FOCAL[1], FOCAL[1].recip()),
        ]
    }
}
