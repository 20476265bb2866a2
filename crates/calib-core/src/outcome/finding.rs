//! What an operator should know about a result that exists: a subject and numbers, no words.

use crate::outcome::code::{Code, Severity};
use crate::outcome::subject::{Parameter, Source, Subject};
use crate::outcome::suggestion::Suggestion;

/// Another camera that the lines fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rival {
    /// In pixels.
    pub focal: f64,
    /// In radians.
    pub pitch: f64,
}

/// Who does not use something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// The fit in pixels.
    MaximumLikelihood,
    /// The paper's criterion.
    Paper,
}

/// Why cameras are not tied to the rest of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Apart {
    /// They share too little with the others to be placed by it.
    TooLittle,
    /// They share nothing and stand where the operator placed them.
    Placed,
    /// They share nothing.
    Alone,
}

/// Why something that cameras share is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhyUnused {
    /// A camera that shows it cannot see anything where the others put it.
    OutOfSight,
    /// One camera alone shows it.
    SeenOnce,
    /// A distance: an end of it has no place, or its length is not told.
    Unmeasured,
    /// Cameras: no place was found from which all that is shared can be seen.
    Unfitted,
}

/// What ties cameras together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tie {
    /// Links.
    Links,
    /// Marks tied to pixels.
    Marks,
    /// Distances.
    Distances,
}

/// What an operator should know about a result that exists.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// The lines do not tell the focal.
    FocalUnobservable {
        /// Standard deviation of the log focal, before the weak prior.
        sigma: f64,
        /// The camera looks down: the floor may be good all the same.
        looks_down: bool,
        /// The predicted relative error of floor lengths where it is small.
        good_floor: Option<f64>,
        /// What would tell more.
        next: Option<Suggestion>,
    },
    /// What cameras usually have tells more of the focal than the lines.
    PriorDominates {
        /// In pixels.
        focal: f64,
        /// Relative standard deviation of it.
        sigma: f64,
    },
    /// The lines fit other cameras as well.
    TwoSolutions {
        /// Those others.
        others: Vec<Rival>,
        /// What would decide.
        next: Option<Suggestion>,
    },
    /// Lengths on the floor are known somewhat.
    Weak {
        /// Their predicted relative error.
        floor_length_rel: f64,
        /// What would tell more.
        next: Option<Suggestion>,
    },
    /// Lengths on the floor are hardly known.
    Unusable {
        /// Their predicted relative error.
        floor_length_rel: f64,
        /// What would tell more.
        next: Option<Suggestion>,
    },
    /// The camera sees no floor.
    NoFloor,
    /// A line contradicts the others and was set aside.
    LineOutlier {
        /// The line.
        line: Source,
        /// By how many pixels; `None` above the horizon.
        px: Option<f64>,
    },
    /// Residuals are larger than drawing noise.
    Misfit {
        /// Sum of the squared residuals over their variances.
        chi2: f64,
        /// Residuals minus unknowns.
        dof: i64,
        /// The line with the largest residual, and the residual in pixels.
        worst: Option<(Source, f64)>,
    },
    /// Cameras that are fitted together contradict each other.
    JointMisfit {
        /// Sum of the squared residuals over their variances.
        chi2: f64,
        /// Residuals minus unknowns.
        dof: i64,
    },
    /// Edges drawn as straight are not, under the lens that fits best.
    BentEdges {
        /// Root mean square distance from straight, in pixels.
        px: f64,
        /// The same without a lens.
        px_without_lens: f64,
    },
    /// Straight edges say next to nothing about the lens.
    UninformativeEdges {
        /// Which.
        edges: Vec<Source>,
        /// How many were drawn.
        drawn: usize,
        /// How far they would bend at most, in pixels.
        bend_px: f64,
    },
    /// The straight edges leave the corners of the image uncertain.
    UncertainCorners {
        /// By so many pixels.
        px: f64,
    },
    /// Straight edges check a lens that is held, and change nothing.
    UnusedEdges {
        /// The annotation of the first.
        first: usize,
        /// How many there are.
        count: usize,
        /// The lens that is held has no distortion.
        is_undistorted: bool,
        /// How far off straight they are under it, in pixels.
        px: f64,
    },
    /// The estimator has no use for annotations of this kind.
    UnusedKind {
        /// Index of the annotation.
        annotation: usize,
        /// Who does not use it.
        by: Estimator,
    },
    /// An annotation has fewer segments than its kind needs.
    TooFewSegments {
        /// Index of the annotation.
        annotation: usize,
        /// Who does not use it.
        by: Estimator,
        /// How many it has.
        drawn: usize,
        /// How many it needs.
        least: usize,
    },
    /// The paper's method knows no prior.
    UnusedPrior {
        /// Of what.
        parameter: Parameter,
    },
    /// A line has a point where the lens shows nothing.
    OutsideLens {
        /// The line.
        line: Source,
    },
    /// A line has no length.
    NoLength {
        /// The line.
        line: Source,
    },
    /// Too few control points to place the camera.
    TooFewControlPoints {
        /// How many there are.
        count: usize,
    },
    /// The camera does not show control points where it stands.
    HiddenControlPoints {
        /// Their indices.
        points: Vec<usize>,
    },
    /// Control points are farther from their pixels than drawing explains.
    FarControlPoints {
        /// Root mean square distance, in pixels.
        rms_px: f64,
        /// Index of the worst.
        worst: usize,
        /// Its distance, in pixels.
        worst_px: f64,
    },
    /// What was told of the height and what the placement says disagree.
    ScaleConflict {
        /// By what was entered and drawn, in metres.
        estimated: f64,
        /// As placed, in metres.
        placed: f64,
    },
    /// The EFOV does not lie on the floor.
    EfovAboveHorizon {
        /// Nothing of it does.
        is_whole: bool,
    },
    /// The distortion folds back on itself inside the image.
    DistortionNotInvertible,
    /// A control point contradicts the others and was set aside.
    ControlPointOutlier {
        /// Index of the camera.
        camera: usize,
        /// Index of the point in its camera.
        point: usize,
    },
    /// A link or a mark contradicts the others and was set aside.
    ElementOutlier {
        /// The link or the mark.
        element: Subject,
        /// The camera where it is farthest off, and by how many pixels.
        worst: Option<(usize, f64)>,
    },
    /// A distance contradicts the rest and was set aside.
    DistanceOutlier {
        /// Index of the distance.
        distance: usize,
    },
    /// Nothing ties cameras to the rest of the site.
    NotConnected {
        /// Their indices.
        cameras: Vec<usize>,
        /// How that is.
        apart: Apart,
    },
    /// The links of a camera leave open where it stands.
    Sliding {
        /// Index of the camera.
        camera: usize,
    },
    /// Nothing gives the scale of cameras that hang together.
    ScaleUnknown {
        /// Their indices.
        cameras: Vec<usize>,
        /// The one whose height stands.
        root: usize,
    },
    /// Cameras share more than can be fitted together.
    TooManyCameras {
        /// How many they are.
        count: usize,
        /// The index of one.
        first: usize,
    },
    /// What cameras share and the joint fit does not use.
    Unused {
        /// What.
        what: Vec<Subject>,
        /// For this reason.
        why: WhyUnused,
    },
    /// What ties cameras together, while every camera is solved by itself.
    UnusedTies {
        /// What.
        ties: Tie,
        /// How many there are.
        count: usize,
    },
}

impl Finding {
    /// The code as files and programs know it.
    #[must_use]
    pub const fn code(&self) -> Code {
        match self {
            Self::FocalUnobservable { .. } => Code::FocalUnobservable,
            Self::PriorDominates { .. } => Code::PriorDominates,
            Self::TwoSolutions { .. } => Code::TwoSolutions,
            Self::Weak { .. } => Code::Weak,
            Self::Unusable { .. } | Self::NoFloor => Code::Unusable,
            Self::LineOutlier { .. }
            | Self::ControlPointOutlier { .. }
            | Self::ElementOutlier { .. }
            | Self::DistanceOutlier { .. } => Code::Outlier,
            Self::Misfit { .. }
            | Self::JointMisfit { .. }
            | Self::BentEdges { .. }
            | Self::HiddenControlPoints { .. }
            | Self::FarControlPoints { .. } => Code::Misfit,
            Self::UninformativeEdges { .. } | Self::UncertainCorners { .. } => Code::UninformativePolyline,
            Self::UnusedEdges { .. }
            | Self::UnusedKind { .. }
            | Self::TooFewSegments { .. }
            | Self::UnusedPrior { .. }
            | Self::OutsideLens { .. }
            | Self::NoLength { .. }
            | Self::TooFewControlPoints { .. }
            | Self::TooManyCameras { .. }
            | Self::Unused { .. }
            | Self::UnusedTies { .. } => Code::UnusedAnnotation,
            Self::ScaleConflict { .. } => Code::ScaleConflict,
            Self::EfovAboveHorizon { .. } => Code::EfovAboveHorizon,
            Self::DistortionNotInvertible => Code::DistortionNotInvertible,
            Self::NotConnected { .. } | Self::Sliding { .. } => Code::NotConnected,
            Self::ScaleUnknown { .. } => Code::ScaleUnknown,
        }
    }

    /// How much it matters.
    #[must_use]
    pub const fn severity(&self) -> Severity {
        self.code().severity()
    }

    /// What it is about; of several things the first.
    #[must_use]
    pub fn subject(&self) -> Subject {
        match self {
            Self::FocalUnobservable { .. } | Self::PriorDominates { .. } => {
                Subject::Parameter(Parameter::Focal)
            }
            Self::TwoSolutions { .. } | Self::Misfit { worst: None, .. } => Subject::Orientation,
            Self::Weak { .. } | Self::Unusable { .. } | Self::NoFloor => Subject::Floor,
            Self::LineOutlier { line, .. }
            | Self::Misfit { worst: Some((line, _)), .. }
            | Self::OutsideLens { line }
            | Self::NoLength { line } => Subject::Line(*line),
            Self::UninformativeEdges { edges, .. } => {
                edges.first().map_or(Subject::Lens, |line| Subject::Line(*line))
            }
            Self::BentEdges { .. } | Self::UncertainCorners { .. } | Self::DistortionNotInvertible => {
                Subject::Lens
            }
            Self::UnusedEdges { first: annotation, .. }
            | Self::UnusedKind { annotation, .. }
            | Self::TooFewSegments { annotation, .. } => Subject::Annotation(*annotation),
            Self::UnusedPrior { parameter } => Subject::Parameter(*parameter),
            Self::TooFewControlPoints { .. } => Subject::Placement,
            Self::HiddenControlPoints { points } => {
                points.first().map_or(Subject::Placement, |&point| Subject::OwnControlPoint(point))
            }
            Self::FarControlPoints { worst, .. } => Subject::OwnControlPoint(*worst),
            Self::ScaleConflict { .. } => Subject::Parameter(Parameter::Height),
            Self::EfovAboveHorizon { .. } => Subject::Efov,
            Self::ControlPointOutlier { camera, point } => {
                Subject::ControlPoint { camera: *camera, point: *point }
            }
            Self::ElementOutlier { element, .. } => *element,
            Self::DistanceOutlier { distance } => Subject::Distance(*distance),
            Self::NotConnected { cameras, .. } => {
                cameras.first().map_or(Subject::Site, |&camera| Subject::Camera(camera))
            }
            Self::Sliding { camera }
            | Self::ScaleUnknown { root: camera, .. }
            | Self::TooManyCameras { first: camera, .. } => Subject::Camera(*camera),
            Self::Unused { what, .. } => what.first().copied().unwrap_or(Subject::Site),
            Self::JointMisfit { .. } | Self::UnusedTies { .. } => Subject::Site,
        }
    }

    /// The drawing that it advises.
    #[must_use]
    pub const fn suggestion(&self) -> Option<Suggestion> {
        match self {
            Self::FocalUnobservable { next, .. }
            | Self::TwoSolutions { next, .. }
            | Self::Weak { next, .. }
            | Self::Unusable { next, .. } => *next,
            _ => None,
        }
    }
}
