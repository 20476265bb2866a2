//! Items of an overlay: geometry and meaning. The meaning determines the appearance; painters need nothing
//! else.

use calib_core::Kind;

use crate::kind::Sign;

/// Annotated line on an image, with its residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnnotatedLine {
    /// Kind of annotation.
    pub kind: Kind,
    /// Index of the annotation in its camera.
    pub annotation: usize,
    /// Index of the line in its annotation.
    pub segment: usize,
    /// Whether the operator switched it off.
    pub is_off: bool,
    /// Whether it is rejected as an outlier.
    pub is_outlier: bool,
    /// Residual, in pixels.
    pub residual_px: Option<f64>,
    /// Absolute residual, in standard deviations of the annotations.
    pub over_sigma: Option<f64>,
}

/// Solved link or mark, in the view of one camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ElementStatus {
    /// Index of the camera; `None` for the element itself, common to all cameras.
    pub camera: Option<usize>,
    /// Whether it contradicts other observations and is not used.
    pub is_rejected: bool,
    /// Whether the operator switched it off.
    pub is_off: bool,
}

/// Meaning of an item; indices refer to the site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meaning {
    /// Line that is straight in the scene and curved by the distortion.
    LensGrid,
    /// Line of the metre grid on the floor.
    Grid,
    /// Horizon.
    Horizon,
    /// Effective field of view (EFOV) of a camera.
    Efov(usize),
    /// EFOV of a camera other than the camera of the image.
    OtherEfov(usize),
    /// Prism over the EFOV of a camera.
    Prism(usize),
    /// Figure on the floor, for checking height and verticality.
    Guide,
    /// Region of a plane other than the floor.
    Plane(usize),
    /// Virtual element.
    Mark(usize),
    /// Annotated line.
    Annotation(AnnotatedLine),
    /// Extension of an annotated line beyond its ends, towards its vanishing point.
    Extension(Kind),
    /// Suggested next line.
    Suggestion(Kind),
    /// Control point as annotated or entered by the operator.
    ControlPoint {
        /// Index of its camera.
        camera: usize,
        /// Index of the point in its camera.
        index: usize,
        /// Whether it is not used.
        is_off: bool,
    },
    /// Observed corner of a mark.
    MarkObservation(usize),
    /// Residual: from the annotated point to its reprojection.
    Residual {
        /// Whether the point is not used.
        is_off: bool,
    },
    /// Link as annotated.
    Link {
        /// Index of the link.
        index: usize,
        /// Whether it needs an observation in another view.
        is_incomplete: bool,
    },
    /// Position of a link according to one view.
    LinkPosition {
        /// Index of the link.
        index: usize,
        /// Index of the camera; `None` for the line between two positions.
        camera: Option<usize>,
    },
    /// Epipolar line: possible positions of a point of another view.
    Epipolar,
    /// Observation of a link or mark in a view.
    Observed(ElementStatus),
    /// Solved position of a link or mark.
    Solved(ElementStatus),
    /// Uncertainty ellipse of a camera's position.
    PositionEllipse(usize),
    /// Camera on the plan.
    Camera(usize),
}

/// Geometry of an item, in raw pixels of an image or in metres of the floor.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry<P> {
    /// Open line.
    Polyline(Vec<P>),
    /// Closed outline.
    Polygon(Vec<P>),
    /// Point; its symbol is chosen by the painter.
    Point(P),
    /// Sign of constant screen size, on the line between two points.
    Sign(Sign, [P; 2]),
    /// Text at a point.
    Label(P, String),
    /// Camera seen from above, a cone of constant screen size.
    Cone {
        /// Position of the camera.
        foot: P,
        /// Point ahead of the camera.
        ahead: P,
        /// Half the horizontal field of view, in radians.
        half_angle: f64,
    },
}

/// Item of an overlay.
#[derive(Clone, Debug, PartialEq)]
pub struct Item<P> {
    /// Meaning.
    pub meaning: Meaning,
    /// Geometry.
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
