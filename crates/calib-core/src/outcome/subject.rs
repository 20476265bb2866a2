//! What a finding is about.
//!
//! The residual of one drawing or observation, as reports have it, in pixels.

/// A parameter of one camera that is estimated or has a prior.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Roll.
    Roll,
    /// Pitch.
    Pitch,
    /// Focal length.
    Focal,
    /// Height of the camera.
    Height,
}

/// The drawing that a constraint comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Source {
    /// Index of the annotation in its camera.
    pub annotation: usize,
    /// Index of the segment in its annotation.
    pub segment: usize,
}

/// What a finding is about; numbers are indices in the lists of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The site as a whole.
    Site,
    /// A camera.
    Camera(usize),
    /// A link.
    Link(usize),
    /// A mark.
    Mark(usize),
    /// A distance between links or marks.
    Distance(usize),
    /// A control point.
    ControlPoint {
        /// Index of the camera.
        camera: usize,
        /// Index of the point in its camera.
        point: usize,
    },
    /// An annotation of the camera in question.
    Annotation(usize),
    /// A line of an annotation of the camera in question.
    Line(Source),
    /// A control point of the camera in question.
    OwnControlPoint(usize),
    /// A parameter of the camera in question.
    Parameter(Parameter),
    /// The orientation of the camera in question.
    Orientation,
    /// The lens of the camera in question.
    Lens,
    /// The placement of the camera in question.
    Placement,
    /// The floor that the camera in question sees.
    Floor,
    /// Its effective field of view.
    Efov,
}

/// What a residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum ResidualOf {
    /// A drawn annotation.
    Annotation,
    /// A point with known coordinates.
    ControlPoint,
    /// Evidence shared by cameras.
    Link,
    /// A virtual element tied to a pixel.
    Mark,
}

/// How far one piece of evidence is from what the result predicts.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Residual {
    /// What it belongs to.
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
    /// Distance from the prediction, in pixels; of lines and lengths with a sign for the side.
    pub px: f64,
    /// Whether it was rejected.
    pub outlier: bool,
}
