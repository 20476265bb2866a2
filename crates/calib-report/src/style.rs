//! Sizes of overlays in screen pixels; [`scale`] converts them to pixels of an image.

/// Radius of the dot at an annotated point, in screen pixels.
pub(crate) const HANDLE: f64 = 3.5;
/// Height of letters, in screen pixels.
pub(crate) const TEXT: f64 = 12.0;

/// Returns the length of a screen pixel on an image of this width and height, in image pixels. It is 1 for a
/// diagonal of 1700 pixels, and at least 0.5.
pub(crate) fn scale(size: [f64; 2]) -> f64 {
    (size[0].hypot(size[1]) / 1700.0).max(0.5)
}
