//! What lies on images, each layer with its switch.

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch above the image")]
pub struct Layers {
    /// The metre grid of the floor.
    pub grid: bool,
    /// The horizon.
    pub horizon: bool,
    /// The polygon of the field of view.
    pub field: bool,
    /// Its prism.
    pub prism: bool,
    /// A person of 1.75 m at the cursor.
    pub guide: bool,
    /// Lines extended to their vanishing point.
    pub extensions: bool,
    /// Colour lines by residual, not by kind.
    pub by_residual: bool,
    /// The likely next lines.
    pub suggestion: bool,
    /// Edges that were found are offered.
    pub edges: bool,
    /// The bend of the lens is taken out of the image.
    pub straight: bool,
    /// Everything is hidden.
    pub hidden: bool,
}

impl Default for Layers {
    fn default() -> Self {
        Self {
            grid: true,
            horizon: true,
            field: true,
            prism: true,
            guide: true,
            extensions: true,
            by_residual: false,
            suggestion: true,
            edges: true,
            straight: false,
            hidden: false,
        }
    }
}
