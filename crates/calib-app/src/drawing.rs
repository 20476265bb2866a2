//! SVG plans: rasterised once when they are loaded and stored as PNG, so that every program shows the same
//! pixels.

/// Longer side of the rasterised plan, in pixels. For a corridor of 60 m, one pixel is 2 cm.
pub(crate) const SIDE: u32 = 3072;

/// Whether the bytes of a file are an SVG drawing.
#[must_use]
pub(crate) fn is_svg(bytes: &[u8]) -> bool {
    /// Number of bytes at the start of the file that must contain the `<svg` tag.
    const SEARCHED_BYTES: usize = 4096;
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(SEARCHED_BYTES)]);
    head.trim_start_matches('\u{feff}').trim_start().starts_with('<') && head.contains("<svg")
}
