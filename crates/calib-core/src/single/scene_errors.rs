//! Errors of the scene itself: sloping floors, corners off 90 degrees, edges off level, and tiles or lane
//! marks of slightly different lengths.
//!
//! Each error is an unknown with a normal prior of mean 0. It is eliminated like the other nuisance
//! parameters:
//!
//! - The floor normal deviates from the vertical by two small angles, `N(0, floor_tilt^2)` each: posts are
//!   plumb, but floors slope. The base system follows the floor, because trackers work on the floor.
//! - A floor with marks of equal length has an additional slope across the marks, `N(0, crossfall^2)`
//!   (`crossfall.rs`).
//! - A right angle is 90 degrees plus `N(0, angle^2)`.
//! - The elevation of an annotated direction above the floor plane is `N(0, (angle / 4)^2)`.
//! - The log of a length differs from that of its group by `N(0, length^2)`.
//!
//! # Sources of the numbers
//!
//! Noise, angle and tilt come from restricted maximum likelihood over 639 photographs of rooms with
//! hand-drawn lines (NYU-VP, Kluger et al. 2020). The objective is the sum of
//! [`Fit::restricted_log_likelihood`](crate::Fit::restricted_log_likelihood) with the annotation noise free.
//! The estimates are 0.82 px of noise, 0.9 degrees for a right angle, and 0.45 degrees for floor tilt and
//! level together. Rooms do not separate the last two: 0.3 degrees for each is equally likely. Outdoors, slopes of 1
//! to 2 % are usual for drainage. The default of 0.5 degrees is a compromise between rooms and outdoors. The
//! site file can override it (`scene`).
//!
//! Straight roads slope to their side by 2.5 %, curves by up to 7 or 8 % (RAA, RAL; AASHTO Green Book: 1.5 to 2 %,
//! and up to 8 %). If half of them are straight and half are uniform between 2.5 and 7 %, the root mean square is
//! 3.9 %, or 2.2 degrees; 2 degrees are used. Marks in a single direction may also be tiles, which are level. For
//! tiles this prior is too wide and reduces the precision (`docs/src/accuracy.md`). A narrower prior would
//! underestimate the uncertainty on roads.
//!
//! Tiles have equal lengths to 0.2 %, lane marks to 3 %. A length may be of either kind. The normal
//! distribution nearest to the mixture of both (Kullback and Leibler 1951) has the variance of the mixture, a
//! standard deviation of 2.1 %.

use crate::single::annotation::Annotation;

/// Standard deviations of the scene's own errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneErrors {
    /// Standard deviation of the angle between the vertical and the floor normal, in radians; for each of two
    /// components, along and across the view.
    pub floor_tilt: f64,
    /// Standard deviation of the floor's slope across marks of equal length, in radians, in addition to
    /// `floor_tilt`. The slope along the marks has a quarter of this standard deviation.
    pub crossfall: f64,
    /// Standard deviation of a right angle from 90 degrees, in radians.
    pub angle: f64,
    /// Standard deviation of the natural logarithm of a length within its group (about the relative deviation).
    pub length: f64,
}

impl SceneErrors {
    /// Standard deviations of a scene without errors: every annotation is exactly true.
    pub const EXACT: Self = Self { floor_tilt: 0.0, crossfall: 0.0, angle: 0.0, length: 0.0 };

    /// Returns the standard deviation of the elevation of an annotated direction above the floor plane, in
    /// radians.
    #[must_use]
    pub fn level(&self) -> f64 {
        0.25 * self.angle
    }

    /// Returns the standard deviations for one annotation, which may override those of the scene.
    pub(crate) fn for_annotation(&self, annotation: &Annotation) -> Self {
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
    /// Returns the default standard deviations, for a scene of unknown kind; see the sources at the top of this
    /// file.
    fn default() -> Self {
        Self {
            floor_tilt: 0.5_f64.to_radians(),
            crossfall: 2.0_f64.to_radians(),
            angle: 0.9_f64.to_radians(),
            length: 0.02,
        }
    }
}

/// Standard deviations of the two nuisance parameters (azimuth and elevation) of an annotated direction, relative
/// to the direction of its group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Index of the group.
    pub group: usize,
    /// Whether the direction is at right angles to the direction of the group.
    pub orthogonal: bool,
    /// Standard deviation of the azimuth relative to the group, in radians; 0 for the annotation that defines
    /// the group.
    pub azimuth: f64,
    /// Standard deviation of the elevation above the floor plane, in radians.
    pub level: f64,
    /// Plane of the annotation, as an index into [`Constraints::planes`](crate::Constraints::planes); `None`
    /// for the floor.
    pub plane: Option<usize>,
}
