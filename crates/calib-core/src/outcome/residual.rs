//! The residual of one drawing or observation, as reports have it, in pixels.

/// What a residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
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
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Residual {
    /// What it belongs to.
    pub of: ResidualOf,
    /// Index of the annotation in its camera.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub annotation: Option<usize>,
    /// Index of the segment in its annotation.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub segment: Option<usize>,
    /// Id of a control point, link or mark.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub id: Option<String>,
    /// Distance from the prediction, in pixels; of lines and lengths with a sign for the side.
    pub px: f64,
    /// Whether it was rejected.
    pub outlier: bool,
}
