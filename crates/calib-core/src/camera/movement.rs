//! How a camera moved in its place: turned, and zoomed.

use crate::camera::{Camera, Covariance, FloorSlopes};

/// How a camera moved in its place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Movement {
    /// Change of the yaw, in radians: positive turns to the left.
    pub pan: f64,
    /// Change of the pitch, in radians: positive turns down.
    pub tilt: f64,
    /// Change of the roll, in radians: positive turns clockwise as seen from behind.
    pub roll: f64,
    /// Logarithm of the ratio of the focals, new over old.
    pub zoom: f64,
}

impl Movement {
    /// Number of parameters.
    pub const SIZE: usize = 4;
    /// Index of the pan.
    pub const PAN: usize = 0;
    /// Index of the tilt.
    pub const TILT: usize = 1;
    /// Index of the roll.
    pub const ROLL: usize = 2;
    /// Index of the zoom.
    pub const ZOOM: usize = 3;

    /// The movement of these parameters, in the order of the fields.
    #[must_use]
    pub const fn of([pan, tilt, roll, zoom]: [f64; Self::SIZE]) -> Self {
        Self { pan, tilt, roll, zoom }
    }

    /// The angle of the whole turn, in radians; of small ones.
    #[must_use]
    pub fn turn(&self, pitch: f64) -> f64 {
        // The axes of pan and roll are at right angles only for a level camera.
        let along = self.pan * pitch.sin();
        ((self.pan * pitch.cos()).powi(2) + self.tilt.powi(2) + (self.roll - along).powi(2)).sqrt()
    }

    /// The camera after it.
    #[must_use]
    pub fn applied(&self, camera: &Camera) -> Camera {
        Camera {
            yaw: camera.yaw + self.pan,
            pitch: camera.pitch + self.tilt,
            roll: camera.roll + self.roll,
            focal: camera.focal * self.zoom.exp(),
            ..*camera
        }
    }

    /// Derivatives of a floor point by the parameters.
    pub fn slopes(camera: &Camera, of: &FloorSlopes) -> [[f64; 2]; Self::SIZE] {
        let by = &of.by_camera;
        let zoom = by[Covariance::FOCAL].map(|change| camera.focal * change);
        [by[Covariance::YAW], by[Covariance::PITCH], by[Covariance::ROLL], zoom]
    }
}
