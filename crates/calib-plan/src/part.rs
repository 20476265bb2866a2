//! Part of the picture of a drawing.

/// Part of the picture of a drawing, rasterised with its own number of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Width and height of the whole picture, in pixels.
    pub whole: [u32; 2],
    /// Upper left corner of the part, in pixels of the whole picture.
    pub low: [f64; 2],
    /// Width and height of the part, in pixels of the whole picture.
    pub size: [f64; 2],
    /// Width and height of the rasterised part, in pixels.
    pub pixels: [u32; 2],
}
