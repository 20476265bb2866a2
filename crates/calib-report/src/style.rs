//! Sizes of everything drawn, on an image of 1440 pixels; larger images scale them.

/// Radius of the dot at a drawn point.
pub(crate) const HANDLE: f64 = 3.5;
/// Height of letters.
pub(crate) const TEXT: f64 = 12.0;

/// How much larger than on screen things are drawn on an image of this size.
pub(crate) fn scale(size: [f64; 2]) -> f64 {
    (size[0].hypot(size[1]) / 1700.0).max(0.5)
}
