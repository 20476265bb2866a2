//! What a finding is about.

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
