//! What a drawn thing means. Its look follows from that; a painter never asks for more.

use calib_core::Kind;

/// A line that was drawn on an image, and what the solution says of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// What it says of the scene.
    pub kind: Kind,
    /// Index of its annotation in its camera.
    pub annotation: usize,
    /// Its index in the annotation.
    pub segment: usize,
    /// Not used, because the operator says so.
    pub is_off: bool,
    /// Set aside as an outlier.
    pub is_outlier: bool,
    /// Its residual, in pixels.
    pub residual_px: Option<f64>,
    /// The same, in standard deviations of the drawing.
    pub over_sigma: Option<f64>,
}

/// A link or a mark that was solved, as one camera shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sighted {
    /// Index of the camera; `None` for the thing itself, which is the same for all.
    pub camera: Option<usize>,
    /// Contradicts the others, and took no part.
    pub is_aside: bool,
    /// Took no part because the operator says so.
    pub is_off: bool,
}

/// What a drawn thing means; indices are those of the site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meaning {
    /// Straight in the scene, bent by the lens.
    LensGrid,
    /// A line of the metre grid of the floor.
    Grid,
    /// The horizon.
    Horizon,
    /// The effective field of view of a camera.
    Efov(usize),
    /// That of another camera than the one whose image it is.
    OtherEfov(usize),
    /// The prism over the EFOV of a camera.
    Prism(usize),
    /// A figure on the floor to judge height and plumb by.
    Guide,
    /// Where a plane besides the floor holds.
    Plane(usize),
    /// A virtual element.
    Mark(usize),
    /// A line that was drawn.
    Annotation(Line),
    /// A drawn line beyond its ends, towards its vanishing point.
    Extension(Kind),
    /// The line to be drawn next.
    Suggestion(Kind),
    /// A control point where the operator drew or entered it.
    ControlPoint {
        /// Its camera.
        camera: usize,
        /// Its index there.
        index: usize,
        /// Whether it is not used.
        is_off: bool,
    },
    /// The corner of a mark where the operator saw it.
    MarkSeen(usize),
    /// From where a point was drawn to where the solution shows it.
    Residual {
        /// Whether the point is not used.
        is_off: bool,
    },
    /// A link as it was drawn.
    Link {
        /// Which link.
        index: usize,
        /// Whether it waits to be shown in another view.
        waits: bool,
    },
    /// Where a link put by one view lies by another.
    LinkPut {
        /// Which link.
        index: usize,
        /// Whose view puts it there; `None` for the line between what two views say.
        camera: Option<usize>,
    },
    /// The line of one view on which another view's point must lie.
    Epipolar,
    /// A link or mark where a view shows it.
    Seen(Sighted),
    /// A link or mark where the solution has it.
    Solved(Sighted),
    /// Where a camera may stand.
    PositionEllipse(usize),
    /// A camera on the plan.
    Camera(usize),
}
