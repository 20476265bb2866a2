//! Sizes of overlays on an image of 1440 pixels; larger images scale them.

/// Radius of the dot at an annotated point.
pub(crate) const HANDLE: f64 = 3.5;
/// Height of letters.
pub(crate) const TEXT: f64 = 12.0;

/// Returns the scale of overlays on an image of this size, relative to the screen.
pub(crate) fn scale(size: [f64; 2]) -> f64 {
    (size[0].hypot(size[1]) / 1700.0).max(0.5)
}
