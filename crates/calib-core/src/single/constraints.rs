//! The constraints of one camera: annotations, undistorted. Lines toward a vanishing point, lengths on the
//! floor, and uprights of known height, their end points in undistorted pixels relative to the principal
//! point with the covariance that the undistortion gives their noise.
//!
//! Annotations say *what* was drawn; constraints are what the residuals of stage 1 are computed from
//! (`residual.rs`). They depend on the lens, and are made anew when it changes.

use crate::camera::Chart;
pub use crate::outcome::Source;
use crate::single::annotation::Known;
pub use crate::single::endpoint::Endpoint;
use crate::single::plane_prior::PlanePrior;
use crate::single::repeats::Repeats;
use crate::single::scene_errors::{Deviation, SceneErrors};

/// The direction of a line in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// Vertical: the line passes through the nadir's vanishing point.
    Vertical,
    /// Horizontal: along the direction of a group, or at right angles to it.
    Floor {
        /// Index of the group, below [`Constraints::groups`].
        group: usize,
        /// At right angles to the direction of the group.
        orthogonal: bool,
    },
}

/// A segment whose direction in space is constrained.
#[derive(Clone, Copy, Debug)]
pub struct Line<E = f64> {
    /// Where the ends are given, of a wide lens; undistorted pixels without.
    pub chart: Option<Chart>,
    /// Its two ends; of a polyline of three points and more, two points of the same first and second moments.
    pub ends: [Endpoint<E>; 2],
    /// Its direction in space.
    pub direction: Direction,
    /// How far its direction may be from that: index into [`Constraints::deviations`], if at all.
    pub deviation: Option<usize>,
    /// The drawing that it comes from.
    pub source: Source,
}

/// A segment of the floor whose length is known, or equal to that of others.
#[derive(Clone, Copy, Debug)]
pub struct Length<E = f64> {
    /// Where the ends are given, of a wide lens; undistorted pixels without.
    pub chart: Option<Chart>,
    /// First and last point.
    pub ends: [Endpoint<E>; 2],
    /// Index into [`Constraints::length_groups`].
    pub group: usize,
    /// Standard deviation of its log against that of its group.
    pub spread: f64,
    /// Whether it is one of several marks of equal length on the floor, to whose side ground falls.
    pub is_mark: bool,
    /// The plane it lies on, an index into [`Constraints::planes`]; the floor without.
    pub plane: Option<usize>,
    /// The drawing that it comes from.
    pub source: Source,
}

/// A vertical object of known height that stands on the floor: a person, a post.
#[derive(Clone, Copy, Debug)]
pub struct Upright<E = f64> {
    /// Where foot and head are given, of a wide lens; undistorted pixels without.
    pub chart: Option<Chart>,
    /// Its foot, on the floor.
    pub foot: Endpoint<E>,
    /// Its head, vertically above the foot.
    pub head: Endpoint<E>,
    /// From foot to head, in metres.
    pub height: Known,
    /// The plane it stands on, an index into [`Constraints::planes`]; the floor without.
    pub plane: Option<usize>,
    /// The drawing that it comes from.
    pub source: Source,
}

/// A plane that something was drawn on.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnPlane {
    /// Its index among all planes of the scene.
    pub index: usize,
    /// What is known of it.
    pub prior: PlanePrior,
}

/// The constraints of one camera.
#[derive(Clone, Debug)]
pub struct Constraints<E = f64> {
    /// Segments whose direction is constrained.
    pub lines: Vec<Line<E>>,
    /// Number of groups of floor directions: each is a nuisance parameter, an angle.
    pub groups: usize,
    /// Segments whose length is constrained.
    pub lengths: Vec<Length<E>>,
    /// Length of every group in metres, where it is known; else, and where it has a standard deviation, it is a
    /// nuisance parameter.
    pub length_groups: Vec<Option<Known>>,
    /// Persons and posts.
    pub uprights: Vec<Upright<E>>,
    /// How far drawn directions may be from those of their groups, where they may.
    pub deviations: Vec<Deviation>,
    /// Planes besides the floor that something was drawn on.
    pub planes: Vec<DrawnPlane>,
    /// How far the scene may be from what was drawn.
    pub scene: SceneErrors,
    /// What is drawn more than once: the variance of its ends is so many times that of one.
    pub repeats: Repeats,
    /// Standard deviation of a drawn coordinate of every annotation, in pixels, where it is not that of all.
    pub sigma_px: Vec<Option<f64>>,
    /// Segments that give no constraint, and why.
    pub invalid: Vec<(Source, InvalidSegment)>,
}

/// Why a segment gives no constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InvalidSegment {
    /// One of its points cannot be undistorted.
    OutsideLens,
    /// Its ends coincide.
    NoLength,
}

impl<E> Default for Constraints<E> {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl<E> Constraints<E> {
    /// Those of an image on which nothing was drawn.
    pub const EMPTY: Self = Self {
        lines: Vec::new(),
        groups: 0,
        lengths: Vec::new(),
        length_groups: Vec::new(),
        uprights: Vec::new(),
        deviations: Vec::new(),
        planes: Vec::new(),
        scene: SceneErrors::EXACT,
        repeats: Repeats::NONE,
        sigma_px: Vec::new(),
        invalid: Vec::new(),
    };

    /// Whether there is nothing to fit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty() && self.lengths.is_empty() && self.uprights.is_empty()
    }
}
