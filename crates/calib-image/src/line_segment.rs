//! A segment of the image.
//!
//! A straight edge with its noise.

use calib_core::Pixel;

/// Distance of `at` from the segment from `a` to `b`.
#[must_use]
pub fn to_segment(a: Pixel, b: Pixel, at: Pixel) -> f64 {
    let (dx, dy) = (b.u - a.u, b.v - a.v);
    let length = dx * dx + dy * dy;
    // A segment without length is a point; a clamp with NaN would not be one.
    let t =
        if length > 0.0 { (((at.u - a.u) * dx + (at.v - a.v) * dy) / length).clamp(0.0, 1.0) } else { 0.0 };
    at.distance(Pixel::new(a.u + t * dx, a.v + t * dy))
}

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
