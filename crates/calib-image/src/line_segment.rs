//! A straight edge with its noise.

use calib_core::Pixel;

/// A straight edge with its noise.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LineSegment {
    /// Its ends, raw pixels.
    pub ends: [Pixel; 2],
    /// Standard deviation of either end across it, in pixels.
    pub sigma: f64,
}

impl LineSegment {
    /// What the ends of a detected edge are off it, in pixels: of edges of 14 to 130 px in photographs of rooms, by
    /// how far they pass from the vanishing points of those rooms.
    pub const DETECTED: f64 = 0.45;

    /// From end to end, in pixels.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }
}
