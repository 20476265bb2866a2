//! A segment of the image.

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
