//! How far a scene is from what a drawing says of it: floors fall, corners are off square, edges off level,
//! tiles and lane marks of not quite one length.
//!
//! Each is an unknown with a normal prior about 0, and is eliminated like the other nuisance parameters:
//!
//! - the verticals lean against the normal of the floor by two small angles, `N(0, floor_tilt^2)` each: posts
//!   are plumb, floors fall. The base system is that of the floor, on which trackers stand;
//! - ground with marks of equal length falls to their side by `N(0, crossfall^2)` more (`crossfall.rs`);
//! - a right angle is 90 degrees and `N(0, angle^2)`;
//! - a drawn direction leaves the floor plane by `N(0, (angle / 4)^2)`;
//! - the log of a length differs from that of its group by `N(0, length^2)`.
//!
//! # Where the numbers come from
//!
//! Restricted maximum likelihood over 639 photographs of rooms with lines that people drew (NYU-VP, Kluger et
//! al. 2020), the sum of [`Fit::restricted_log_likelihood`](crate::Fit::restricted_log_likelihood) with the drawing's noise free: noise 0.82 px, right
//! angle 0.9 degrees, and 0.45 degrees for floor tilt and level together, which rooms do not tell apart (0.3
//! and 0.3 is as likely). Outdoors falls of 1 to 2 % are usual for drainage; 0.5 degrees stands between both kinds of
//! places; who knows the place says so (`scene` in the site file).
//!
//! Roads fall to their side by 2.5 % where they are straight and by up to 7 or 8 % in curves (RAA, RAL; AASHTO
//! Green Book: 1.5 to 2 %, and up to 8 %). Half of them straight and half anywhere between 2.5 and 7 % gives 3.9 %
//! root mean square, 2.2 degrees: 2 degrees. Marks in one direction alone may be tiles as
//! well, which are level: there the belief is too wide, which costs (`README.md`) where one too narrow would promise what
//! is not so.
//!
//! Lengths: tiles are alike to 0.2 %, lane marks to 3 %. A length may be of either
//! kind, and the normal distribution nearest to the mixture of both (Kullback and Leibler 1951) has its variance: that of
//! 2.1 %.

use crate::single::annotation::Annotation;

/// Standard deviations of the scene's own errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneErrors {
    /// Of the lean of verticals against the normal of the floor, along and across the view, in radians.
    pub floor_tilt: f64,
    /// Of the fall of the floor to the side of marks of equal length, in radians, besides its tilt; it climbs along them
    /// by a quarter of that.
    pub crossfall: f64,
    /// Of a right angle, in radians.
    pub angle: f64,
    /// Of the log of a length that is equal to others.
    pub length: f64,
}

impl SceneErrors {
    /// The scene is what the drawing says.
    pub const EXACT: Self = Self { floor_tilt: 0.0, crossfall: 0.0, angle: 0.0, length: 0.0 };

    /// Of the elevation of a drawn direction above the floor plane, in radians.
    #[must_use]
    pub fn level(&self) -> f64 {
        0.25 * self.angle
    }

    /// Those of one drawing, which may know better.
    pub(crate) fn of(&self, annotation: &Annotation) -> Self {
        if annotation.exact {
            return Self { angle: 0.0, length: 0.0, ..*self };
        }
        Self {
            angle: annotation.angle_sigma_deg.map_or(self.angle, f64::to_radians),
            length: annotation.length_sigma_rel.unwrap_or(self.length),
            ..*self
        }
    }
}

impl Default for SceneErrors {
    /// Those of a place of which nothing is known.
    fn default() -> Self {
        Self {
            floor_tilt: 0.5_f64.to_radians(),
            crossfall: 2.0_f64.to_radians(),
            angle: 0.9_f64.to_radians(),
            length: 0.02,
        }
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
    /// The plane it is level on, an index into [`Constraints::planes`](crate::Constraints::planes); the floor
    /// without.
    pub plane: Option<usize>,
}
