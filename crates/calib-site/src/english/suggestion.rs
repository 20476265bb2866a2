//! What to draw next.

use calib_core::outcome::{Drawing, Suggestion};

/// What to draw next, and what it is good for.
pub(crate) fn what_to_draw(suggestion: &Suggestion) -> String {
    let what = match suggestion.drawing {
        Drawing::VerticalOnTheLeft => "A vertical near the left edge of the image",
        Drawing::VerticalOnTheRight => "A vertical near the right edge of the image",
        Drawing::ParallelsAway => "Two parallel floor lines that run away from the camera, left and right",
        Drawing::ParallelsAcross => "Two parallel floor lines across the view, near and far",
        Drawing::RightAngle => "A right angle near the middle of the floor, at about 45 degrees to the view,",
        Drawing::EqualLengths => "Three floor segments of equal length, near, far and across,",
        Drawing::SharedPoints => "Links of four floor points to another camera that sees them as well",
        Drawing::KnownSize => "One thing on the floor whose length you know (a tile, a lane, a parking bay)",
    };
    let gain = match suggestion.ratio {
        r if r < 0.28 => "cut the uncertainty of the floor to a fraction".into(),
        r if r < 0.4 => "cut the uncertainty of the floor to a third".into(),
        r if r < 0.6 => "halve the uncertainty of the floor".into(),
        r => format!("lower the uncertainty of the floor by {:.0} %", 100.0 * (1.0 - r)),
    };
    // A floor without a scale has a smaller number, which is of its shape alone.
    let scale = if suggestion.drawing == Drawing::KnownSize { ", its scale included" } else { "" };
    format!("{what} would {gain} (then floor \u{b1} {:.1} %{scale}).", 100.0 * suggestion.floor_length_rel)
}
