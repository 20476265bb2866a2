//! Items of an overlay: geometry and meaning. The meaning determines the appearance; painters need no other
//! data.

use calib_core::Kind;

use crate::kind::Sign;

/// Annotated line on an image, with its residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnnotatedLine {
    /// Kind of the annotation.
    pub kind: Kind,
    /// Index of the annotation in its camera.
    pub annotation: usize,
    /// Index of the line in its annotation.
    pub segment: usize,
    /// Whether the operator switched the annotation off.
    pub is_off: bool,
    /// Whether the line is rejected as an outlier.
    pub is_outlier: bool,
    /// Residual of the line, in pixels; `None` if the line is not part of a solution.
    pub residual_px: Option<f64>,
    /// Absolute residual divided by the standard deviation of the annotations.
    pub over_sigma: Option<f64>,
}

/// Solved link or mark, in the view of one camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ElementStatus {
    /// Index of the camera; `None` for the solved position, which is common to all cameras.
    pub camera: Option<usize>,
    /// Whether the link or mark contradicts other observations and is not used.
    pub is_rejected: bool,
    /// Whether the operator switched the link or mark off.
    pub is_off: bool,
}

/// Meaning of an item. Indices of cameras, planes, links and marks refer to the site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meaning {
    /// Line that is straight in the scene and curved by the distortion.
    LensGrid,
    /// Line of the grid on the floor.
    Grid,
    /// Horizon of a camera.
    Horizon,
    /// Effective field of view (EFOV) of a camera, by its index.
    Efov(usize),
    /// EFOV of another camera than the camera of the image, by its index.
    OtherEfov(usize),
    /// Prism over the EFOV of a camera, by its index.
    Prism(usize),
    /// Person on the floor at the pointer, for checking the height and tilt of the camera.
    Guide,
    /// Region of a plane other than the floor, by the index of the plane.
    Plane(usize),
    /// Virtual element (mark), by its index.
    Mark(usize),
    /// Line that the operator annotated.
    Annotation(AnnotatedLine),
    /// Extension of an annotated line of this kind beyond its ends, towards its vanishing point.
    Extension(Kind),
    /// Suggested next line of this kind.
    Suggestion(Kind),
    /// Control point as annotated or entered by the operator.
    ControlPoint {
        /// Index of the camera of the control point.
        camera: usize,
        /// Index of the control point in the list of the camera.
        index: usize,
        /// Whether the operator switched the control point off.
        is_off: bool,
    },
    /// Corner of a mark that is pinned to a pixel, by the index of the mark.
    MarkObservation(usize),
    /// Line from an annotated point to its reprojection.
    Residual {
        /// Whether the point is not used.
        is_off: bool,
    },
    /// Observation of a link as annotated.
    Link {
        /// Index of the link.
        index: usize,
        /// Whether the link needs an observation in another view.
        is_incomplete: bool,
    },
    /// Floor position of a link according to one view.
    LinkPosition {
        /// Index of the link.
        index: usize,
        /// Index of the camera; `None` for the line that connects the positions of different cameras.
        camera: Option<usize>,
    },
    /// Epipolar line: the possible positions in this image of a point that another view shows.
    Epipolar,
    /// Observation of a link or mark in a view.
    Observed(ElementStatus),
    /// Solved position of a link or mark.
    Solved(ElementStatus),
    /// Uncertainty ellipse of a camera's position, by the index of the camera.
    PositionEllipse(usize),
    /// Camera on the plan, by its index.
    Camera(usize),
}

/// Geometry of an item. Points are raw pixels on an image, or floor metres on the plan.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry<P> {
    /// Open line.
    Polyline(Vec<P>),
    /// Closed outline.
    Polygon(Vec<P>),
    /// Point; the painter chooses a symbol for its meaning.
    Point(P),
    /// Sign of constant screen size, on the line between two points.
    Sign(Sign, [P; 2]),
    /// Text at a point.
    Label(P, String),
    /// Camera seen from above: the cone of its horizontal field of view, with constant screen size.
    Cone {
        /// Position of the camera.
        foot: P,
        /// Floor point in the viewing direction of the camera.
        ahead: P,
        /// Half the horizontal field of view, in radians.
        half_angle: f64,
    },
}

/// Item of an overlay.
#[derive(Clone, Debug, PartialEq)]
pub struct Item<P> {
    /// Meaning, which determines the appearance.
    pub meaning: Meaning,
    /// Geometry in raw pixels or floor metres.
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
