//! How far a scene is from what a drawing says of it: floors fall, corners are off square, edges off level,
//! tiles and lane marks of not quite one length.
//!
//! Each is an unknown with a normal prior about 0, and is eliminated like the other nuisance parameters:
//!
//! - the verticals lean against the normal of the floor by two small angles, `N(0, floor_tilt^2)` each;
//! - a level direction leaves the floor plane by `N(0, angle^2)`;
//! - a right angle is 90 degrees and `N(0, angle^2)`;
//! - a length differs from that of its group by a factor `exp(N(0, length^2))`.
//!
//! The base system is that of the floor, on which trackers stand; what leans are the verticals.

/// Standard deviations of the scene's own errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneErrors {
    /// Of the lean of verticals against the normal of the floor, along and across the view, in radians.
    pub floor_tilt: f64,
    /// Of the elevation of a level direction above the floor plane, in radians.
    pub level: f64,
    /// Of a right angle, in radians.
    pub square: f64,
    /// Of the log of a length that is equal to others, or known.
    pub length: f64,
}

impl SceneErrors {
    /// The scene is what the drawing says.
    pub const EXACT: Self = Self { floor_tilt: 0.0, level: 0.0, square: 0.0, length: 0.0 };
}

impl Default for SceneErrors {
    fn default() -> Self {
        Self::EXACT
    }
}

/// How far one drawn direction may be from that of its group: two nuisance parameters with their sigmas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Index of the group.
    pub group: usize,
    /// At right angles to the direction of the group.
    pub orthogonal: bool,
    /// Standard deviation of its angle off that direction, in radians; 0 for the one that the group is named
    /// after.
    pub azimuth: f64,
    /// Standard deviation of its elevation above the floor plane, in radians.
    pub level: f64,
}
