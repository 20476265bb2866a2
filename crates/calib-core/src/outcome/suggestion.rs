//! The drawing that would improve a result most.

/// A kind of drawing that can be suggested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
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
