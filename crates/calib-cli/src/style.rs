//! Colours, widths and sizes of everything drawn.

use calib_core::Kind;

/// Colours of cameras, in turn; never without the camera's name.
const CAMERAS: [&str; 8] =
    ["#FF9D7A", "#6FE0D2", "#C3A6FF", "#E6DC6A", "#8DB7FF", "#F7A1C4", "#A9D66B", "#D9B38C"];

/// Colour of the camera of this index.
pub(crate) fn camera(index: usize) -> &'static str {
    CAMERAS[index % CAMERAS.len()]
}

/// The same hues, dark enough for lines on a light plan.
const CAMERAS_ON_LIGHT: [&str; 8] =
    ["#C4552B", "#0F8A7A", "#7A4FD0", "#857300", "#2F62C4", "#B8437C", "#4F8010", "#8A6038"];

/// Colour of the lines of the camera of this index on a plan.
pub(crate) fn camera_on_light(index: usize) -> &'static str {
    CAMERAS_ON_LIGHT[index % CAMERAS_ON_LIGHT.len()]
}

/// Colours of the kinds of annotation, in the order of their rows.
const KINDS: [&str; 7] = ["#5BB8F5", "#FFB020", "#38D391", "#F48FC3", "#F2DF4A", "#EEF1F4", "#FF7F57"];

/// Colour of a kind of annotation.
pub(crate) fn kind(kind: Kind) -> &'static str {
    KINDS[kind.row().colour % KINDS.len()]
}

/// Control points, marks, grid and horizon.
pub(crate) const WHITE: &str = "#FFFFFF";
/// Grid that is straight in the scene, bent by the lens.
pub(crate) const LENS: &str = "#8CE6FF";
/// Outline of every line on an image, so that it is legible on any ground.
pub(crate) const OUTLINE: &str = "#07090B";
/// Text and lines on a plan: plans are light.
pub(crate) const INK: &str = "#1B1F23";
/// Suspects and gross errors.
pub(crate) const BAD: &str = "#FF5470";
/// The same, dark enough for a light plan.
pub(crate) const BAD_ON_LIGHT: &str = "#C4123A";
/// Ground of a tag.
pub(crate) const TAG: &str = "#0D0F12";

/// Widths on an image of 1440 pixels; larger images scale them.
pub(crate) const LINE: f64 = 2.0;
pub(crate) const GRID: f64 = 1.0;
pub(crate) const HORIZON: f64 = 1.5;
pub(crate) const PRISM: f64 = 1.25;
pub(crate) const FIELD: f64 = 2.0;
pub(crate) const HANDLE: f64 = 3.5;
pub(crate) const TEXT: f64 = 12.0;

/// How much larger than on screen things are drawn on an image of this size.
pub(crate) fn scale(size: [f64; 2]) -> f64 {
    (size[0].hypot(size[1]) / 1700.0).max(0.5)
}
