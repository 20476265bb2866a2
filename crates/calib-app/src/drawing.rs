//! SVG plans as pictures: drawn once, when they are loaded, and kept as PNG, so that every program that
//! opens the site shows the same pixels.

/// Longer side of what is drawn, in pixels: a corridor of 60 m shows 2 cm.
pub(crate) const SIDE: u32 = 3072;

/// Whether bytes are an SVG drawing, not a picture.
#[must_use]
pub(crate) fn is_svg(bytes: &[u8]) -> bool {
    const HEAD: usize = 4096;
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(HEAD)]);
    head.trim_start_matches('\u{feff}').trim_start().starts_with('<') && head.contains("<svg")
}
