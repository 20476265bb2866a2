//! One thing to be painted: where it lies, and what it means.
//!
//! What a drawn thing means. Its look follows from that; a painter never asks for more.

use calib_core::Kind;

use crate::kind::Sign;

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

/// What there is to paint, in raw pixels of an image or in metres of the floor.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry<P> {
    /// From point to point.
    Polyline(Vec<P>),
    /// An outline that comes back to its start.
    Polygon(Vec<P>),
    /// A point, shown by a figure of the painter's.
    Point(P),
    /// A sign of the size of the screen, laid on the line between two points.
    Sign(Sign, [P; 2]),
    /// Words about a point.
    Label(P, String),
    /// A camera from above, a cone of the size of the screen.
    Cone {
        /// Where it stands.
        foot: P,
        /// A point ahead of it.
        ahead: P,
        /// Half its horizontal field of view, in radians.
        half_angle: f64,
    },
}

/// One thing to be painted.
#[derive(Clone, Debug, PartialEq)]
pub struct Item<P> {
    /// What it means.
    pub meaning: Meaning,
    /// Where it lies.
    pub geometry: Geometry<P>,
}

impl<P> Item<P> {
    pub(crate) const fn new(meaning: Meaning, geometry: Geometry<P>) -> Self {
        Self { meaning, geometry }
    }

    pub(crate) const fn polyline(meaning: Meaning, points: Vec<P>) -> Self {
        Self::new(meaning, Geometry::Polyline(points))
    }

    pub(crate) const fn polygon(meaning: Meaning, points: Vec<P>) -> Self {
        Self::new(meaning, Geometry::Polygon(points))
    }

    pub(crate) const fn point(meaning: Meaning, at: P) -> Self {
        Self::new(meaning, Geometry::Point(at))
    }

    pub(crate) const fn label(meaning: Meaning, at: P, text: String) -> Self {
        Self::new(meaning, Geometry::Label(at, text))
    }
}
