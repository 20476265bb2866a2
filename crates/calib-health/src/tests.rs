//! Shared helpers of the tests of this crate.

use proptest::prelude::*;

use calib_core::camera::{BrownConrady, Camera, Covariance, Distortion, Lens, Pixel, WorldPoint};

/// Returns a camera that looks down into a room.
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

/// Generates cameras with a downward pitch of 0 to 86 degrees at a height of 2 to 8 m, with and without
/// distortion.
pub(crate) fn any_camera() -> impl Strategy<Value = Camera> {
    let pose = (-3.1..3.1_f64, 0.0..1.5_f64, -0.6..0.6_f64, 2.0..8.0_f64);
    (pose, 600.0..2500.0_f64, -0.2..0.0_f64).prop_map(|((yaw, pitch, roll, z), focal, k1)| {
        let distortion = Distortion::BrownConrady(BrownConrady { k1, ..BrownConrady::default() });
        let lens = Lens { focal, distortion, ..Lens::pinhole(Pixel::new(955.0, 545.0)) };
        Camera {
            position: WorldPoint::new(0.0, 0.0, z),
            yaw,
            pitch,
            roll,
            focal,
            lens,
            covariance: Covariance::EXACT,
        }
    })
}

/// Generator of reproducible normal random numbers.
pub(crate) struct Noise(rand_chacha::ChaCha8Rng);

impl Noise {
    pub(crate) fn new(seed: u64) -> Self {
        Self(rand::SeedableRng::seed_from_u64(seed))
    }

    /// Returns a standard normal number (Box and Muller 1958).
    pub(crate) fn normal(&mut self) -> f64 {
        let mut uniform = || rand::Rng::random_range(&mut self.0, f64::EPSILON..1.0);
        let (a, b): (f64, f64) = (uniform(), uniform());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}
