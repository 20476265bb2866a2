//! Findings: what an operator should know about a result, as values with a subject and numbers.
//!
//! What findings name beside subjects and numbers: reasons, estimators, kinds of evidence.
//!
//! What a finding is about.
//!
//! The drawing that would improve a result most.

use crate::outcome::code::{Code, Severity};
use crate::outcome::subject::{Parameter, Source, Subject};

/// A kind of drawing that can be suggested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Drawing {
    /// A vertical near the left edge of the image.
    VerticalOnTheLeft,
    /// A vertical near the right edge of the image.
    VerticalOnTheRight,
    /// Two parallel floor lines that run away from the camera.
    ParallelsAway,
    /// Two parallel floor lines across the view.
    ParallelsAcross,
    /// A right angle near the middle of the floor, at about 45 degrees to the view.
    RightAngle,
    /// Three floor segments of equal length, near, far and across.
    EqualLengths,
    /// Four points of the floor that another camera sees as well.
    SharedPoints,
    /// One length of the floor that is known in metres.
    KnownSize,
}

/// The drawing that would improve a result most, and by how much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suggestion {
    /// What to draw.
    pub drawing: Drawing,
    /// The predicted relative error of floor lengths with it, over that without.
    pub ratio: f64,
    /// The predicted relative error of floor lengths with it.
    pub floor_length_rel: f64,
}

/// Another local minimum: a camera that the lines fit as well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherMinimum {
    /// In pixels.
    pub focal: f64,
    /// In radians.
    pub pitch: f64,
}

/// The estimator that does not use something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// The maximum-likelihood fit.
    MaximumLikelihood,
    /// The paper's criterion.
    Paper,
}

/// Why cameras are not connected to the rest of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhyNotConnected {
    /// They share too few landmarks with the others to be placed by them.
    TooLittle,
    /// They share nothing and keep the placement of the operator.
    Placed,
    /// They share nothing.
    Alone,
}

/// Why something that cameras share is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhyUnused {
    /// A camera that observes it cannot show the place that the others give it.
    OutOfSight,
    /// One camera alone shows it.
    SeenOnce,
    /// A distance: an end of it has no place, or its length is not given.
    Unmeasured,
    /// Cameras: no poses were found from which everything shared is visible.
    Unfitted,
}

/// Evidence that cameras share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SharedEvidence {
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
    /// The lines do not determine the focal.
    FocalUnobservable {
        /// Standard deviation of the log focal, before the weak prior.
        sigma: f64,
        /// The camera looks down: the floor may be well determined nevertheless.
        looks_down: bool,
        /// The predicted relative error of floor lengths where it is small.
        good_floor: Option<f64>,
        /// The drawing that would improve it most.
        next: Option<Suggestion>,
    },
    /// The weak prior determines the focal more than the lines do.
    PriorDominates {
        /// In pixels.
        focal: f64,
        /// Relative standard deviation of it.
        sigma: f64,
    },
    /// The lines fit other cameras as well.
    TwoSolutions {
        /// The other cameras.
        others: Vec<OtherMinimum>,
        /// The drawing that would decide between them.
        next: Option<Suggestion>,
    },
    /// The predicted relative error of lengths on the floor is large.
    Weak {
        /// Their predicted relative error.
        floor_length_rel: f64,
        /// The part of it that all have in common, where their ratios are good: of the known size that the
        /// scale is from.
        scale_rel: Option<f64>,
        /// The drawing that would improve it most.
        next: Option<Suggestion>,
    },
    /// The predicted relative error of lengths on the floor is too large for use.
    Unusable {
        /// Their predicted relative error.
        floor_length_rel: f64,
        /// The part of it that all have in common, where their ratios are good: of the known size that the
        /// scale is from.
        scale_rel: Option<f64>,
        /// The drawing that would improve it most.
        next: Option<Suggestion>,
    },
    /// The camera sees no floor.
    NoFloor,
    /// A line was rejected as an outlier.
    LineOutlier {
        /// The line.
        line: Source,
        /// Its residual in pixels; `None` above the horizon.
        px: Option<f64>,
    },
    /// The residuals are too large for the drawing noise.
    Misfit {
        /// Sum of the squared residuals over their variances.
        chi2: f64,
        /// Number of residuals minus number of parameters.
        dof: i64,
        /// The line with the largest residual, and the residual in pixels.
        worst: Option<(Source, f64)>,
    },
    /// Uprights contradict each other about the height of the camera, where residuals are too large.
    HeightsApart {
        /// The one by which the camera is lowest, and that height in metres.
        lowest: (Source, f64),
        /// The one by which it is highest, and that height in metres.
        highest: (Source, f64),
    },
    /// The residuals of the bundle adjustment are too large for the noise.
    JointMisfit {
        /// Sum of the squared residuals over their variances.
        chi2: f64,
        /// Number of residuals minus number of parameters.
        dof: i64,
    },
    /// Edges drawn as straight are not straight under the lens that fits best.
    BentEdges {
        /// Root mean square distance from straight, in pixels.
        px: f64,
        /// The same without a lens.
        px_without_lens: f64,
    },
    /// Lines of one direction alone are bent as a lens would, or as a road that curves.
    BentOneWay {
        /// Root mean square distance from straight, in pixels.
        px: f64,
    },
    /// Straight edges carry next to no information about the lens.
    UninformativeEdges {
        /// Which.
        edges: Vec<Source>,
        /// How many were drawn.
        drawn: usize,
        /// The largest sagitta that a distortion of 10 px in the corner would give them, in pixels.
        bend_px: f64,
    },
    /// The straight edges leave the corners of the image uncertain.
    UncertainCorners {
        /// By so many pixels.
        px: f64,
        /// It is the rim of a fisheye's image.
        is_round: bool,
        /// Whether edges reach as far as the image shows anything.
        is_reached: bool,
    },
    /// Straight edges under a fixed lens: their residuals are reported, they estimate nothing.
    UnusedEdges {
        /// The annotation of the first.
        first: usize,
        /// How many there are.
        count: usize,
        /// The fixed lens has no distortion.
        is_undistorted: bool,
        /// Their mean distance from straight under it, in pixels.
        px: f64,
    },
    /// The estimator does not use annotations of this kind.
    UnusedKind {
        /// Index of the annotation.
        annotation: usize,
        /// The estimator that does not use it.
        by: Estimator,
    },
    /// An annotation has fewer segments than its kind needs.
    TooFewSegments {
        /// Index of the annotation.
        annotation: usize,
        /// The estimator that does not use it.
        by: Estimator,
        /// How many it has.
        drawn: usize,
        /// How many it needs.
        least: usize,
    },
    /// A prior that is not used: the paper's method has none.
    UnusedPrior {
        /// Of what.
        parameter: Parameter,
    },
    /// A line has a point that cannot be undistorted.
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
    /// Control points are not visible from the camera's placement.
    HiddenControlPoints {
        /// Their indices.
        points: Vec<usize>,
    },
    /// The drawing has too few residuals beyond its unknowns to be a check of itself.
    Unchecked {
        /// Residuals minus unknowns, of the drawing alone.
        dof: i64,
        /// How many lines were rejected.
        rejected: usize,
        /// What to draw.
        next: Option<Suggestion>,
    },
    /// The standard deviations are Student's, of a noise that few residuals estimate.
    FewResiduals {
        /// Residuals minus unknowns.
        dof: i64,
        /// The factor by which the standard deviations are wider.
        factor: f64,
    },
    /// Nothing is known of the errors of the camera.
    UncertaintyUnknown,
    /// The solution is not of what is drawn now.
    OutOfDate {
        /// What differs most from what the solution says of it.
        what: Subject,
        /// Its residual as the solution has it, in pixels; `None` of what the solution does not know.
        stored: Option<f64>,
        /// Its residual now, in pixels; `None` of what is not there any more, or cannot be where it is.
        now: Option<f64>,
    },
    /// Points that are drawn lie outside the image.
    PointsOutside {
        /// How many.
        outside: usize,
        /// How many are drawn.
        drawn: usize,
        /// Width and height of the image, in pixels.
        size: [u32; 2],
        /// All would lie inside if u and v, or width and height, were exchanged.
        fits_exchanged: bool,
        /// Too many for what is drawn to be of this image.
        is_other_image: bool,
        /// What the first of them is of.
        first: Subject,
    },
    /// The camera stands below the floor.
    BelowFloor {
        /// Its height, in metres.
        height: f64,
    },
    /// The reprojection errors of control points are too large for the drawing noise.
    FarControlPoints {
        /// Root mean square reprojection error, in pixels.
        rms_px: f64,
        /// Index of the worst.
        worst: usize,
        /// Its reprojection error, in pixels.
        worst_px: f64,
    },
    /// Nothing gives the scale of the camera.
    ScaleAssumed {
        /// The height that it is taken to have, in metres.
        height: f64,
    },
    /// A hand says where the camera stands, and nothing tells how well.
    PlacedByHand,
    /// The height by drawings or as entered, and the height by placement, disagree.
    ScaleConflict {
        /// As entered or estimated from drawings, in metres.
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
    /// A control point was rejected as an outlier.
    ControlPointOutlier {
        /// Index of the camera.
        camera: usize,
        /// Index of the point in its camera.
        point: usize,
    },
    /// A link or a mark was rejected as an outlier.
    ElementOutlier {
        /// The link or the mark.
        element: Subject,
        /// The camera of its largest residual, and that residual in pixels.
        worst: Option<(usize, f64)>,
    },
    /// A distance was rejected as an outlier.
    DistanceOutlier {
        /// Index of the distance.
        distance: usize,
    },
    /// Cameras are not connected to the rest of the site.
    NotConnected {
        /// Their indices.
        cameras: Vec<usize>,
        /// Why not.
        why: WhyNotConnected,
    },
    /// The links of a camera do not determine its position.
    Sliding {
        /// Index of the camera.
        camera: usize,
    },
    /// The scale of a component of the view graph is not determined.
    ScaleUnknown {
        /// Their indices.
        cameras: Vec<usize>,
        /// The camera whose height fixes the scale.
        root: usize,
    },
    /// Cameras share too much to be adjusted together.
    TooManyCameras {
        /// How many they are.
        count: usize,
        /// The index of one.
        first: usize,
    },
    /// What cameras share and the bundle adjustment does not use.
    Unused {
        /// What.
        what: Vec<Subject>,
        /// Why it is not used.
        why: WhyUnused,
    },
    /// Evidence that cameras share, while every camera is solved by itself.
    UnusedEvidence {
        /// What.
        evidence: SharedEvidence,
        /// How many there are.
        count: usize,
    },
}

impl Finding {
    /// The code in files.
    #[must_use]
    pub const fn code(&self) -> Code {
        match self {
            Self::FocalUnobservable { .. } => Code::FocalUnobservable,
            Self::PriorDominates { .. } => Code::PriorDominates,
            Self::TwoSolutions { .. } => Code::TwoSolutions,
            Self::Weak { .. } => Code::Weak,
            Self::Unusable { .. } => Code::Unusable,
            Self::NoFloor => Code::NoFloor,
            Self::Unchecked { .. } => Code::Unchecked,
            Self::FewResiduals { .. } => Code::FewResiduals,
            Self::UncertaintyUnknown => Code::UncertaintyUnknown,
            Self::OutOfDate { .. } => Code::OutOfDate,
            Self::PointsOutside { is_other_image: false, .. } => Code::PointsOutside,
            Self::PointsOutside { is_other_image: true, .. } => Code::NotThisImage,
            Self::BelowFloor { .. } => Code::BelowFloor,
            Self::LineOutlier { .. }
            | Self::ControlPointOutlier { .. }
            | Self::ElementOutlier { .. }
            | Self::DistanceOutlier { .. } => Code::Outlier,
            Self::Misfit { .. }
            | Self::JointMisfit { .. }
            | Self::HeightsApart { .. }
            | Self::BentEdges { .. }
            | Self::HiddenControlPoints { .. }
            | Self::FarControlPoints { .. } => Code::Misfit,
            Self::UninformativeEdges { .. } | Self::UncertainCorners { .. } | Self::BentOneWay { .. } => {
                Code::UninformativePolyline
            }
            Self::UnusedEdges { .. }
            | Self::UnusedKind { .. }
            | Self::TooFewSegments { .. }
            | Self::UnusedPrior { .. }
            | Self::OutsideLens { .. }
            | Self::NoLength { .. }
            | Self::TooFewControlPoints { .. }
            | Self::TooManyCameras { .. }
            | Self::Unused { .. }
            | Self::UnusedEvidence { .. } => Code::UnusedAnnotation,
            Self::ScaleAssumed { .. } => Code::ScaleAssumed,
            Self::PlacedByHand => Code::PlacedByHand,
            Self::ScaleConflict { .. } => Code::ScaleConflict,
            Self::EfovAboveHorizon { .. } => Code::EfovAboveHorizon,
            Self::DistortionNotInvertible => Code::DistortionNotInvertible,
            Self::NotConnected { .. } | Self::Sliding { .. } => Code::NotConnected,
            Self::ScaleUnknown { .. } => Code::ScaleUnknown,
        }
    }

    /// Its severity.
    #[must_use]
    pub const fn severity(&self) -> Severity {
        self.code().severity()
    }

    /// The drawing that it suggests.
    #[must_use]
    pub const fn suggestion(&self) -> Option<Suggestion> {
        match self {
            Self::FocalUnobservable { next, .. }
            | Self::TwoSolutions { next, .. }
            | Self::Weak { next, .. }
            | Self::Unusable { next, .. }
            | Self::Unchecked { next, .. } => *next,
            _ => None,
        }
    }
}

impl Finding {
    /// What it is about; of several things the first.
    #[must_use]
    pub fn subject(&self) -> Subject {
        match self {
            Self::FocalUnobservable { .. } | Self::PriorDominates { .. } => {
                Subject::Parameter(Parameter::Focal)
            }
            Self::TwoSolutions { .. }
            | Self::Misfit { worst: None, .. }
            | Self::Unchecked { .. }
            | Self::FewResiduals { .. }
            | Self::UncertaintyUnknown => Subject::Orientation,
            Self::BelowFloor { .. } => Subject::Parameter(Parameter::Height),
            Self::Weak { .. } | Self::Unusable { .. } | Self::NoFloor => Subject::Floor,
            Self::LineOutlier { line, .. }
            | Self::Misfit { worst: Some((line, _)), .. }
            | Self::HeightsApart { lowest: (line, _), .. }
            | Self::OutsideLens { line }
            | Self::NoLength { line } => Subject::Line(*line),
            Self::UninformativeEdges { edges, .. } => {
                edges.first().map_or(Subject::Lens, |line| Subject::Line(*line))
            }
            Self::BentEdges { .. }
            | Self::BentOneWay { .. }
            | Self::UncertainCorners { .. }
            | Self::DistortionNotInvertible => Subject::Lens,
            Self::UnusedEdges { first: annotation, .. }
            | Self::UnusedKind { annotation, .. }
            | Self::TooFewSegments { annotation, .. } => Subject::Annotation(*annotation),
            Self::UnusedPrior { parameter } => Subject::Parameter(*parameter),
            Self::TooFewControlPoints { .. } => Subject::Placement,
            Self::HiddenControlPoints { points } => {
                points.first().map_or(Subject::Placement, |&point| Subject::OwnControlPoint(point))
            }
            Self::FarControlPoints { worst, .. } => Subject::OwnControlPoint(*worst),
            Self::ScaleAssumed { .. } | Self::ScaleConflict { .. } => Subject::Parameter(Parameter::Height),
            Self::PlacedByHand => Subject::Placement,
            Self::EfovAboveHorizon { .. } => Subject::Efov,
            Self::ControlPointOutlier { camera, point } => {
                Subject::ControlPoint { camera: *camera, point: *point }
            }
            Self::ElementOutlier { element, .. } => *element,
            Self::OutOfDate { what, .. } | Self::PointsOutside { first: what, .. } => *what,
            Self::DistanceOutlier { distance } => Subject::Distance(*distance),
            Self::NotConnected { cameras, .. } => {
                cameras.first().map_or(Subject::Site, |&camera| Subject::Camera(camera))
            }
            Self::Sliding { camera }
            | Self::ScaleUnknown { root: camera, .. }
            | Self::TooManyCameras { first: camera, .. } => Subject::Camera(*camera),
            Self::Unused { what, .. } => what.first().copied().unwrap_or(Subject::Site),
            Self::JointMisfit { .. } | Self::UnusedEvidence { .. } => Subject::Site,
        }
    }
}
