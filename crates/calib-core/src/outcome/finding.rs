//! Findings about a result, as values with a subject and numbers, and the suggestions that they contain.

use crate::camera::Pixel;
use crate::outcome::code::{Code, Severity};
use crate::outcome::subject::{Parameter, Source, Subject};

/// Kind of annotation that can be suggested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum SuggestedAnnotation {
    /// A vertical line near the left edge of the image.
    VerticalOnTheLeft,
    /// A vertical line near the right edge of the image.
    VerticalOnTheRight,
    /// Two parallel floor lines that run away from the camera.
    ParallelsAway,
    /// Two parallel floor lines across the view.
    ParallelsAcross,
    /// A right angle near the middle of the floor, at about 45 degrees to the view.
    RightAngle,
    /// Three floor segments of equal length: near, far and across.
    EqualLengths,
    /// Links of four floor points with another camera.
    SharedPoints,
    /// One floor segment of known length in metres.
    KnownSize,
}

/// Suggested annotation with its predicted effect on the floor error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suggestion {
    /// Annotation to draw.
    pub annotation: SuggestedAnnotation,
    /// Ratio of the predicted relative error of floor lengths with the annotation to the present one.
    pub ratio: f64,
    /// Predicted relative error of floor lengths with the annotation.
    pub floor_length_rel: f64,
}

/// Another local minimum: a camera that fits the lines equally well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherMinimum {
    /// Focal length, in pixels.
    pub focal: f64,
    /// Pitch, in radians.
    pub pitch: f64,
    /// Roll, in radians.
    pub roll: f64,
}

/// Estimator of stage 1, named in findings about annotations that it does not use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// Maximum-likelihood fit.
    MaximumLikelihood,
    /// Minimum of the paper's criterion C.
    Paper,
}

/// Reason why cameras are not connected to the rest of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DisconnectionReason {
    /// The cameras share too few landmarks with the other cameras to be placed.
    TooFewLandmarks,
    /// The cameras share no landmarks with others, and keep the placement that the operator set.
    PlacedByOperator,
    /// The cameras share no landmarks with others and have no placement.
    NoLandmarks,
}

/// Reason why shared evidence is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnusedReason {
    /// The position that the other views determine is not visible in one of the cameras.
    NotVisible,
    /// Only one camera observes the landmark.
    SingleView,
    /// The distance has no length, or an end whose position is unknown.
    UnknownLengthOrEnd,
    /// No camera poses make all shared landmarks visible.
    NoPoses,
    /// The points have map coordinates, and the site has no georeference.
    NoGeoreference,
}

/// Kind of evidence that cameras share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SharedEvidence {
    /// Links between cameras.
    Links,
    /// Marks with observed pixels.
    Marks,
    /// Distances between links or marks.
    Distances,
}

/// Finding about a result.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// The lines do not determine the focal length.
    FocalUnobservable {
        /// Standard deviation of the log focal length, before the weak prior.
        sigma: f64,
        /// Whether the camera looks down, so that the floor may be accurate nevertheless.
        looks_down: bool,
        /// Predicted relative error of floor lengths, if it is small.
        good_floor: Option<f64>,
        /// Annotation that would improve the result most.
        next: Option<Suggestion>,
    },
    /// The weak prior determines the focal length more than the lines do.
    PriorDominates {
        /// Focal length, in pixels.
        focal: f64,
        /// Relative standard deviation of the focal length.
        sigma: f64,
    },
    /// Other solutions of the camera fit the lines equally well.
    TwoSolutions {
        /// Other local minima.
        others: Vec<OtherMinimum>,
        /// Whether every other minimum is the solution rotated by about 180 degrees. Lines cannot distinguish
        /// between the two.
        is_turned: bool,
        /// Suggested next annotation, which would reduce the error of floor lengths the most. `None` without
        /// a suggestion.
        next: Option<Suggestion>,
    },
    /// The predicted relative error of floor lengths is large.
    Weak {
        /// Predicted relative error of floor lengths.
        floor_length_rel: f64,
        /// Part of the error that is common to all lengths, if their ratios are accurate. It comes from the
        /// known size that determines the scale.
        scale_rel: Option<f64>,
        /// Annotation that would improve the result most.
        next: Option<Suggestion>,
    },
    /// The predicted relative error of floor lengths is too large for use.
    Unusable {
        /// Predicted relative error of floor lengths.
        floor_length_rel: f64,
        /// Part of the error that is common to all lengths, if their ratios are accurate. It comes from the
        /// known size that determines the scale.
        scale_rel: Option<f64>,
        /// Annotation that would improve the result most.
        next: Option<Suggestion>,
    },
    /// The camera sees no floor.
    NoFloor,
    /// A line was rejected as an outlier.
    LineOutlier {
        /// Line that was rejected.
        line: Source,
        /// Residual of the line, in pixels; `None` without a prediction, for example above the horizon.
        px: Option<f64>,
        /// Entered length, and length according to the other lines, in metres; `None` for lines without length.
        lengths: Option<[f64; 2]>,
    },
    /// The residuals are too large for the annotation noise.
    Misfit {
        /// Chi-square: sum of the squared residuals divided by their variances.
        chi2: f64,
        /// Number of residuals minus number of parameters.
        dof: i64,
        /// The line with the largest residual, and the residual in pixels.
        worst: Option<(Source, f64)>,
    },
    /// The uprights give contradictory camera heights, and the residuals are too large.
    ContradictoryUprights {
        /// The upright that gives the lowest camera height, and that height in metres.
        lowest: (Source, f64),
        /// The upright that gives the highest camera height, and that height in metres.
        highest: (Source, f64),
    },
    /// The entered principal point contradicts the lines; another principal point explains all lines.
    WrongPrincipalPoint {
        /// Entered principal point, in raw pixels.
        entered: Pixel,
        /// Principal point that explains the lines, in raw pixels.
        estimated: Pixel,
        /// Whether the entered coordinates are probably swapped.
        is_exchanged: bool,
    },
    /// The estimated principal point is far from the image centre, as in a cropped image.
    OffCentre {
        /// Estimated principal point, in raw pixels.
        estimated: Pixel,
        /// Distance from the image centre, divided by the longer side of the image.
        distance: f64,
    },
    /// The entered principal point is the centre of an image of another resolution, so that the whole lens
    /// probably belongs to that resolution.
    OtherResolution {
        /// Entered principal point, in raw pixels.
        entered: Pixel,
        /// Width and height of the image, in pixels.
        size: [u32; 2],
    },
    /// The focal length of the data sheet contradicts the focal length that the lines alone determine.
    DataSheetConflict {
        /// Focal length of the data sheet, in pixels.
        entered: f64,
        /// Standard deviation of the focal length of the data sheet, in pixels; `None` if it is fixed.
        entered_sigma: Option<f64>,
        /// Focal length that the lines determine without the data sheet, in pixels.
        estimated: f64,
        /// Standard deviation of `estimated`, in pixels.
        sigma: f64,
    },
    /// Floor lengths depend on the slope of the ground, which is unknown.
    UnknownSlope {
        /// Relative standard deviation of floor lengths, for ground that slopes as usual.
        usual: f64,
        /// Relative standard deviation of floor lengths, for ground that may slope by 6 %; `None` if the
        /// annotations then do not determine the camera.
        sloping: Option<f64>,
    },
    /// Recorders code images of this size with pixels that are not square, and no pixel aspect is entered.
    PixelsNotSquare {
        /// Width and height of the image, in pixels.
        size: [u32; 2],
        /// Usual pixel aspect of images of this size.
        aspect: f64,
    },
    /// The residuals of the bundle adjustment are too large for the noise.
    JointMisfit {
        /// Chi-square: sum of the squared residuals divided by their variances.
        chi2: f64,
        /// Number of residuals minus number of parameters.
        dof: i64,
    },
    /// Straight edges are not straight under the best-fitting lens.
    CurvedEdges {
        /// Root mean square deviation of the edges from straight lines under the best-fitting lens, in
        /// pixels.
        px: f64,
        /// Root mean square deviation of the edges from straight lines without a distortion model, in pixels.
        px_without_lens: f64,
    },
    /// Curved lines exist in one direction only: the cause may be the lens, or a curved road.
    CurvedInOneDirection {
        /// Root mean square deviation of the lines from straight lines, in pixels.
        px: f64,
    },
    /// Some straight edges carry almost no information about the lens.
    UninformativeEdges {
        /// The uninformative edges.
        edges: Vec<Source>,
        /// Number of all straight edges.
        total: usize,
        /// Largest sagitta of the uninformative edges under a distortion of 10 px in the corner, in pixels.
        sagitta_px: f64,
    },
    /// The straight edges do not determine the distortion in the corners of the image well.
    UncertainCorners {
        /// Standard deviation of the undistorted corner, in pixels.
        px: f64,
        /// Whether `px` refers to the rim of a fisheye image instead of the corners.
        is_round: bool,
        /// Whether edges reach the border of the visible scene.
        is_reached: bool,
    },
    /// Straight edges are not used because the lens is fixed; their residuals are reported.
    UnusedEdges {
        /// Index of the annotation of the first edge.
        first: usize,
        /// Number of edges.
        count: usize,
        /// Whether the fixed lens has no distortion.
        is_undistorted: bool,
        /// Mean deviation of the edges from straight lines under the fixed lens, in pixels.
        px: f64,
    },
    /// The estimator does not use annotations of this kind.
    UnusedKind {
        /// Index of the annotation.
        annotation: usize,
        /// Estimator that does not use the annotation.
        by: Estimator,
    },
    /// An annotation has fewer segments than its kind needs.
    TooFewSegments {
        /// Index of the annotation.
        annotation: usize,
        /// Estimator that needs more segments.
        by: Estimator,
        /// Number of segments of the annotation.
        count: usize,
        /// Number of segments that the kind needs.
        required: usize,
    },
    /// A prior is not used: the paper's method has no priors.
    UnusedPrior {
        /// Parameter of the prior.
        parameter: Parameter,
    },
    /// A line has a point that cannot be undistorted.
    OutsideLens {
        /// Line that contains the point.
        line: Source,
    },
    /// The ends of a line coincide.
    NoLength {
        /// Line whose ends coincide.
        line: Source,
    },
    /// There are too few control points to place the camera.
    TooFewControlPoints {
        /// Number of control points.
        count: usize,
    },
    /// Control points are not visible from the camera's position.
    HiddenControlPoints {
        /// Indices of the control points.
        points: Vec<usize>,
    },
    /// There are too few redundant lines to detect errors in the annotations.
    Unchecked {
        /// Degrees of freedom: residuals minus unknowns, of the annotations alone.
        dof: i64,
        /// Number of rejected lines.
        rejected: usize,
        /// Annotation to draw next.
        next: Option<Suggestion>,
    },
    /// The standard deviations are widened by Student's distribution, because few residuals estimate the
    /// noise.
    FewResiduals {
        /// Degrees of freedom: residuals minus unknowns.
        dof: i64,
        /// Widening factor of the standard deviations.
        factor: f64,
    },
    /// The uncertainty of the camera is unknown.
    UncertaintyUnknown,
    /// A calibration that was imported or entered has no standard deviations.
    NoStandardDeviations,
    /// The annotations have changed since the camera was solved.
    OutOfDate {
        /// The annotation, control point, link or mark whose residual differs most.
        subject: Subject,
        /// Residual in the stored solution, in pixels; `None` if the solution does not contain it.
        stored: Option<f64>,
        /// Residual now, in pixels; `None` if the subject was removed or has no prediction.
        now: Option<f64>,
    },
    /// Annotated points are outside the image.
    PointsOutside {
        /// Number of points outside.
        outside: usize,
        /// Number of all annotated points.
        total: usize,
        /// Width and height of the image, in pixels.
        size: [u32; 2],
        /// Whether all points would be inside the image if u and v, or its width and height, were exchanged.
        fits_exchanged: bool,
        /// Whether the annotations belong to another image, because too many points are outside.
        is_other_image: bool,
        /// Annotation or observation that contains the first point outside the image.
        first: Subject,
    },
    /// The camera is below the floor.
    BelowFloor {
        /// Height of the camera, in metres.
        height: f64,
    },
    /// The reprojection errors of the control points are too large for the annotation noise.
    FarControlPoints {
        /// Root mean square reprojection error, in pixels.
        rms_px: f64,
        /// Index of the control point with the largest error.
        worst: usize,
        /// Largest reprojection error, in pixels.
        worst_px: f64,
    },
    /// There are too few redundant coordinates of control points to detect a wrong point.
    UncheckedPoints {
        /// Degrees of freedom: residuals minus unknowns, of the control points, annotations and priors.
        dof: i64,
    },
    /// Links or marks of the camera have no redundancy. A wrong link or mark moves the camera without a
    /// residual.
    UncheckedLinks {
        /// Links and marks without redundancy.
        elements: Vec<Subject>,
        /// Indices of the other cameras that observe these links and marks.
        cameras: Vec<usize>,
    },
    /// Two control points fit if their pixels are exchanged.
    ExchangedControlPoints {
        /// Indices of the control points.
        points: [usize; 2],
    },
    /// The scale of the camera is unknown, so its height is assumed.
    ScaleAssumed {
        /// Assumed height, in metres.
        height: f64,
    },
    /// The camera was placed by hand, so the uncertainty of its position is unknown.
    PlacedByHand,
    /// The placement disagrees with the entered or estimated height.
    ScaleConflict {
        /// Height as entered or as estimated from annotations, in metres.
        estimated: f64,
        /// Camera height that follows from the placement on the plan, in metres.
        placed: f64,
    },
    /// A part of the EFOV is not on the floor.
    EfovAboveHorizon {
        /// Whether no part of the EFOV is on the floor.
        is_whole: bool,
    },
    /// The distortion folds back on itself inside the image.
    DistortionNotInvertible,
    /// A control point was rejected as an outlier.
    ControlPointOutlier {
        /// Index of the camera.
        camera: usize,
        /// Index of the control point in its camera.
        point: usize,
    },
    /// A control point is far from its geographic coordinates, under the georeference from all control points.
    FarFromMap {
        /// Index of the camera.
        camera: usize,
        /// Index of the control point in its camera.
        point: usize,
        /// Distance between the control point and its geographic coordinates, in metres.
        distance: f64,
    },
    /// A camera is far from the point at which the floor touches the ellipsoid of the earth.
    LargeSite {
        /// Index of the camera.
        camera: usize,
        /// Distance from the point at which the floor touches the ellipsoid, in metres.
        distance: f64,
        /// Height of the plane of the floor above the curved ground at the camera, in metres.
        drop: f64,
        /// Whether all cameras are near each other, so that another origin helps.
        is_compact: bool,
    },
    /// A link or a mark was rejected as an outlier.
    ElementOutlier {
        /// Link or mark that was rejected.
        element: Subject,
        /// Index of the camera with the largest residual of the link or mark, and that residual in pixels.
        worst: Option<(usize, f64)>,
    },
    /// A distance was rejected as an outlier.
    DistanceOutlier {
        /// Index of the distance.
        distance: usize,
        /// Entered length, and length according to the other measurements, in metres.
        lengths: [f64; 2],
    },
    /// Cameras are not connected to the rest of the site.
    NotConnected {
        /// Indices of the cameras.
        cameras: Vec<usize>,
        /// Reason why the cameras are not connected.
        reason: DisconnectionReason,
    },
    /// The links of a camera do not determine its position.
    UndeterminedPosition {
        /// Index of the camera.
        camera: usize,
    },
    /// The scale of a component of the view graph is undetermined.
    ScaleUnknown {
        /// Indices of the cameras of the component.
        cameras: Vec<usize>,
        /// Index of the camera whose height fixes the scale.
        root: usize,
    },
    /// Too many cameras share landmarks to be adjusted together.
    TooManyCameras {
        /// Number of cameras.
        count: usize,
        /// Index of the first camera.
        first: usize,
    },
    /// The bundle adjustment does not use some shared evidence.
    Unused {
        /// Links, marks, distances or cameras that are not used.
        subjects: Vec<Subject>,
        /// Reason why the evidence is not used.
        reason: UnusedReason,
    },
    /// Shared evidence is not used because every camera is solved separately.
    UnusedEvidence {
        /// Kind of evidence that is not used.
        evidence: SharedEvidence,
        /// Number of links, marks or distances that are not used.
        count: usize,
    },
}

impl Finding {
    /// Returns the code of the finding.
    #[must_use]
    pub const fn code(&self) -> Code {
        match self {
            Self::FocalUnobservable { .. } => Code::FocalUnobservable,
            Self::PriorDominates { .. } => Code::PriorDominates,
            Self::TwoSolutions { .. } => Code::TwoSolutions,
            Self::Weak { .. } => Code::Weak,
            Self::Unusable { .. } => Code::Unusable,
            Self::NoFloor => Code::NoFloor,
            Self::ExchangedControlPoints { .. } => Code::PointsExchanged,
            Self::Unchecked { .. } | Self::UncheckedPoints { .. } | Self::UncheckedLinks { .. } => {
                Code::Unchecked
            }
            Self::FewResiduals { .. } => Code::FewResiduals,
            Self::UncertaintyUnknown | Self::NoStandardDeviations => Code::UncertaintyUnknown,
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
            | Self::ContradictoryUprights { .. }
            | Self::CurvedEdges { .. }
            | Self::HiddenControlPoints { .. }
            | Self::FarFromMap { .. }
            | Self::FarControlPoints { .. } => Code::Misfit,
            Self::UninformativeEdges { .. }
            | Self::UncertainCorners { .. }
            | Self::CurvedInOneDirection { .. } => Code::UninformativePolyline,
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
            Self::WrongPrincipalPoint { .. } | Self::OffCentre { .. } => Code::PrincipalPoint,
            Self::OtherResolution { .. } => Code::TwoResolutions,
            Self::DataSheetConflict { .. } => Code::FocalConflict,
            Self::UnknownSlope { .. } => Code::FloorSlope,
            Self::PixelsNotSquare { .. } => Code::PixelsNotSquare,
            Self::DistortionNotInvertible => Code::DistortionNotInvertible,
            Self::NotConnected { .. } | Self::UndeterminedPosition { .. } => Code::NotConnected,
            Self::ScaleUnknown { .. } => Code::ScaleUnknown,
            Self::LargeSite { .. } => Code::LargeSite,
        }
    }

    /// Returns the severity of the finding.
    #[must_use]
    pub const fn severity(&self) -> Severity {
        self.code().severity()
    }

    /// Returns the suggested annotation, if the finding contains one.
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
    /// Returns the subject of the finding; if there are several, the first.
    #[must_use]
    pub fn subject(&self) -> Subject {
        match self {
            Self::FocalUnobservable { .. } | Self::PriorDominates { .. } | Self::DataSheetConflict { .. } => {
                Subject::Parameter(Parameter::Focal)
            }
            Self::TwoSolutions { .. }
            | Self::Misfit { worst: None, .. }
            | Self::Unchecked { .. }
            | Self::FewResiduals { .. }
            | Self::UncertaintyUnknown
            | Self::NoStandardDeviations => Subject::Orientation,
            Self::BelowFloor { .. } => Subject::Parameter(Parameter::Height),
            Self::Weak { .. } | Self::Unusable { .. } | Self::NoFloor | Self::UnknownSlope { .. } => {
                Subject::Floor
            }
            Self::LineOutlier { line, .. }
            | Self::Misfit { worst: Some((line, _)), .. }
            | Self::ContradictoryUprights { lowest: (line, _), .. }
            | Self::OutsideLens { line }
            | Self::NoLength { line } => Subject::Line(*line),
            Self::UninformativeEdges { edges, .. } => {
                edges.first().map_or(Subject::Lens, |line| Subject::Line(*line))
            }
            Self::CurvedEdges { .. }
            | Self::CurvedInOneDirection { .. }
            | Self::UncertainCorners { .. }
            | Self::WrongPrincipalPoint { .. }
            | Self::OffCentre { .. }
            | Self::OtherResolution { .. }
            | Self::PixelsNotSquare { .. }
            | Self::DistortionNotInvertible => Subject::Lens,
            Self::UnusedEdges { first: annotation, .. }
            | Self::UnusedKind { annotation, .. }
            | Self::TooFewSegments { annotation, .. } => Subject::Annotation(*annotation),
            Self::UnusedPrior { parameter } => Subject::Parameter(*parameter),
            Self::TooFewControlPoints { .. } => Subject::Placement,
            Self::HiddenControlPoints { points } => {
                points.first().map_or(Subject::Placement, |&point| Subject::OwnControlPoint(point))
            }
            Self::FarControlPoints { worst: point, .. }
            | Self::ExchangedControlPoints { points: [point, _] } => Subject::OwnControlPoint(*point),
            Self::ScaleAssumed { .. } | Self::ScaleConflict { .. } => Subject::Parameter(Parameter::Height),
            Self::PlacedByHand | Self::UncheckedPoints { .. } => Subject::Placement,
            Self::EfovAboveHorizon { .. } => Subject::Efov,
            Self::ControlPointOutlier { camera, point } | Self::FarFromMap { camera, point, .. } => {
                Subject::ControlPoint { camera: *camera, point: *point }
            }
            Self::ElementOutlier { element, .. } => *element,
            Self::UncheckedLinks { elements, .. } => elements.first().copied().unwrap_or(Subject::Placement),
            Self::OutOfDate { subject: what, .. } | Self::PointsOutside { first: what, .. } => *what,
            Self::DistanceOutlier { distance, .. } => Subject::Distance(*distance),
            Self::NotConnected { cameras, .. } => {
                cameras.first().map_or(Subject::Site, |&camera| Subject::Camera(camera))
            }
            Self::UndeterminedPosition { camera }
            | Self::LargeSite { camera, .. }
            | Self::ScaleUnknown { root: camera, .. }
            | Self::TooManyCameras { first: camera, .. } => Subject::Camera(*camera),
            Self::Unused { subjects: what, .. } => what.first().copied().unwrap_or(Subject::Site),
            Self::JointMisfit { .. } | Self::UnusedEvidence { .. } => Subject::Site,
        }
    }
}
