//! What tests of this folder share.

use crate::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};

/// A camera that looks down into a room.
pub(crate) fn camera() -> Camera {
    Camera {
        position: WorldPoint::new(0.0, 0.0, 3.5),
        yaw: 0.0,
        pitch: 0.45,
        roll: 0.0,
        focal: 1200.0,
        lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
        covariance: Covariance::EXACT,
    }
}

/// Normal numbers that are the same every time.
pub(crate) struct Noise(rand_chacha::ChaCha8Rng);

impl Noise {
    pub(crate) fn new(seed: u64) -> Self {
        Self(rand::SeedableRng::seed_from_u64(seed))
    }

    /// Box and Muller 1958.
    pub(crate) fn normal(&mut self) -> f64 {
        let mut uniform = || rand::Rng::random_range(&mut self.0, f64::EPSILON..1.0);
        let (a, b): (f64, f64) = (uniform(), uniform());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}
