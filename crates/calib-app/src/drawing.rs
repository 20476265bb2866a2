//! SVG plans: rasterised once when they are loaded and stored as PNG, so that every program shows the same
//! pixels.

/// Longer side of the rasterised plan, in pixels; a corridor of 60 m then shows 2 cm.
pub(crate) const SIDE: u32 = 3072;

/// Whether a file is an SVG drawing.
#[must_use]
pub(crate) fn is_svg(bytes: &[u8]) -> bool {
    const HEAD: usize = 4096;
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(HEAD)]);
    head.trim_start_matches('\u{feff}').trim_start().starts_with('<') && head.contains("<svg")
}
