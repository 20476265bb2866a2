//! What cameras have in common: things of the scene with a place of their own, and the pixels that
//! show them.

use crate::likelihood::Prior;
use crate::space::{Pixel, WorldPoint};

/// The most unknowns a thing has.
pub(crate) const PLACE: usize = 3;

/// What a thing is, and what its unknowns are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Thing {
    /// A point at a known height: x, y.
    Point {
        /// In metres.
        height: f64,
    },
    /// Something plumb on the floor, foot and head: x, y, length.
    Post,
    /// A mark of known shape: x, y, turn.
    Mark {
        /// Height of its foot, in metres.
        z: f64,
        /// Its points relative to its foot, turn 0.
        points: Vec<[f64; 3]>,
    },
    /// A point whose coordinates were measured: x, y, z.
    Measured,
    /// A line of the floor: metres to the left of an origin, and angle.
    Line {
        /// A point near it.
        origin: [f64; 2],
    },
}

/// A pixel that shows a point of a thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sighting {
    /// Index of the camera.
    pub(crate) view: usize,
    /// Index of the point; of a line, any point of it.
    pub(crate) point: usize,
    /// Raw pixel.
    pub(crate) pixel: Pixel,
    /// Standard deviation of its coordinates, in pixels.
    pub(crate) sigma: f64,
}

/// A thing of the scene and who sees it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tie {
    pub(crate) thing: Thing,
    /// Its unknowns, where they start.
    pub(crate) place: [f64; PLACE],
    /// Which of them are free.
    pub(crate) free: [bool; PLACE],
    /// What is believed of them.
    pub(crate) beliefs: Vec<(usize, Prior)>,
    pub(crate) sightings: Vec<Sighting>,
    /// Never set aside.
    pub(crate) keep: bool,
    /// Says nothing: switched off, or set aside.
    pub(crate) off: bool,
}

/// A distance between two things that was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gap {
    /// Indices of the two.
    pub(crate) between: [usize; 2],
    /// In metres.
    pub(crate) length: Prior,
    /// Never set aside.
    pub(crate) keep: bool,
    /// Says nothing: switched off, or set aside.
    pub(crate) off: bool,
}

impl Thing {
    /// A point of the thing at a place, with its slopes: row by row x, y, z by the unknowns.
    ///
    /// The point of a line is its origin moved to it.
    pub(crate) fn point(&self, place: &[f64; PLACE], index: usize) -> (WorldPoint, [[f64; PLACE]; 3]) {
        let [a, b, c] = *place;
        let still = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]];
        match self {
            Self::Point { height } => (WorldPoint::new(a, b, *height), still),
            Self::Post if index == 0 => (WorldPoint::new(a, b, 0.0), still),
            Self::Post => (WorldPoint::new(a, b, c), [still[0], still[1], [0.0, 0.0, 1.0]]),
            Self::Mark { z, points } => {
                let [x, y, up] = points.get(index).copied().unwrap_or_default();
                let (sin, cos) = c.sin_cos();
                let (dx, dy) = (cos * x - sin * y, sin * x + cos * y);
                (WorldPoint::new(a + dx, b + dy, z + up), [[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0; 3]])
            }
            Self::Measured => (WorldPoint::new(a, b, c), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            Self::Line { origin: [x, y] } => {
                let (sin, cos) = b.sin_cos();
                let slopes = [[-sin, -a * cos, 0.0], [cos, -a * sin, 0.0], [0.0; 3]];
                (WorldPoint::new(x - a * sin, y + a * cos, 0.0), slopes)
            }
        }
    }

    /// Number of residuals of a sighting.
    pub(crate) fn residuals(&self) -> usize {
        if matches!(self, Self::Line { .. }) { 1 } else { 2 }
    }
}

impl Tie {
    /// Number of residuals less number of unknowns: what the tie says beyond its own place.
    pub(crate) fn spare(&self) -> i64 {
        let unknowns = self.free.iter().filter(|&&free| free).count();
        let said = self.sightings.len() * self.thing.residuals() + self.beliefs.len();
        said as i64 - unknowns as i64
    }

    /// Indices of the cameras that see it, each once.
    pub(crate) fn views(&self) -> Vec<usize> {
        let mut views: Vec<usize> = self.sightings.iter().map(|seen| seen.view).collect();
        views.sort_unstable();
        views.dedup();
        views
    }
}
