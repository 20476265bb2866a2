//! Subjects of findings, and the residual of one annotation or observation as reports contain it.

/// Parameter of one camera that is estimated or has a prior.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Roll angle of the camera.
    Roll,
    /// Pitch angle of the camera.
    Pitch,
    /// Focal length of the camera.
    Focal,
    /// Height of the camera above the floor.
    Height,
}

/// Annotated segment that a constraint or residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Source {
    /// Index of the annotation in its camera.
    pub annotation: usize,
    /// Index of the segment in its annotation.
    pub segment: usize,
}

/// Subject of a finding; the numbers are indices in the lists of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The site as a whole.
    Site,
    /// Camera, by its index in the site.
    Camera(usize),
    /// Link, by its index in the site.
    Link(usize),
    /// Mark, by its index in the site.
    Mark(usize),
    /// Distance between links or marks, by its index in the site.
    Distance(usize),
    /// A control point.
    ControlPoint {
        /// Index of the camera.
        camera: usize,
        /// Index of the point in its camera.
        point: usize,
    },
    /// Annotation of the camera that the finding belongs to, by its index.
    Annotation(usize),
    /// A line of an annotation of the camera that the finding belongs to.
    Line(Source),
    /// Control point of the camera that the finding belongs to, by its index.
    OwnControlPoint(usize),
    /// A parameter of the camera that the finding belongs to.
    Parameter(Parameter),
    /// The orientation of the camera that the finding belongs to.
    Orientation,
    /// The lens of the camera that the finding belongs to.
    Lens,
    /// The placement of the camera that the finding belongs to.
    Placement,
    /// The floor in the view of the camera that the finding belongs to.
    Floor,
    /// The effective field of view of the camera that the finding belongs to.
    Efov,
}

/// Kind of evidence that a residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum ResidualOf {
    /// An annotation.
    Annotation,
    /// A point with known coordinates.
    ControlPoint,
    /// A link between cameras.
    Link,
    /// A mark (virtual element) with an observed pixel.
    Mark,
}

/// Difference between one annotation or observation and its prediction by the solved camera.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Residual {
    /// Kind of evidence that the residual belongs to.
    pub of: ResidualOf,
    /// Index of the annotation in its camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub annotation: Option<usize>,
    /// Index of the segment in its annotation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<usize>,
    /// Id of a control point, link or mark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Distance from the prediction, in pixels. For a line the sign gives the side. For a length it is negative
    /// if the length is too short.
    pub px: f64,
    /// Whether the evidence was rejected as an outlier.
    pub outlier: bool,
    /// Redundancy number (Baarda 1968) of the error that moves the floor most: from 0 (no other evidence checks
    /// this one) to 1. Absent if it is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redundancy: Option<f64>,
    /// Largest root mean square displacement of the floor, in metres, that an undetected error of this evidence can
    /// cause. Absent if it is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undetectable_m: Option<f64>,
}

/// Redundancy below which an observation is not checked by others (Förstner 1987).
const MIN_REDUNDANCY: f64 = 0.01;

/// Largest accepted displacement of the floor by an undetected error of an observation without redundancy, in camera
/// heights. Two links between two cameras exceed this limit. Three links at different places do not.
const MAX_ACCEPTED_MOVE: f64 = 0.5;

/// Whether a gross error of an observation may stay undetected, although it moves the floor by more than half of
/// the height of the camera. `redundancy` and `undetectable_m` are fields of [`Residual`]. `height` is the
/// height of the camera, in metres.
#[must_use]
pub fn is_unchecked(redundancy: f64, undetectable_m: f64, height: f64) -> bool {
    redundancy < MIN_REDUNDANCY && undetectable_m > MAX_ACCEPTED_MOVE * height.abs()
}

impl Residual {
    /// Creates a residual in pixels without a name, an index and a reliability.
    #[must_use]
    pub const fn new(of: ResidualOf, px: f64) -> Self {
        Self {
            of,
            annotation: None,
            segment: None,
            id: None,
            px,
            outlier: false,
            redundancy: None,
            undetectable_m: None,
        }
    }

    /// Whether a gross error may stay undetected, although it moves the floor ([`is_unchecked`]). `height` is the
    /// height of the camera, in metres.
    #[must_use]
    pub fn is_unchecked(&self, height: f64) -> bool {
        self.redundancy
            .zip(self.undetectable_m)
            .is_some_and(|(redundancy, undetectable)| is_unchecked(redundancy, undetectable, height))
    }
}
