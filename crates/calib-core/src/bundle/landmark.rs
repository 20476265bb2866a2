//! What cameras have in common: things of the scene with a place of their own, and the pixels that
//! show them.

use crate::camera::{Covariance, Distortion, Drawn, POSE, Pixel, Pose, WorldPoint};
use crate::single::Prior;

/// The most unknowns a thing has.
pub(crate) const PLACE: usize = 3;

/// Metres between two places that are not one.
pub(crate) const APART: f64 = 1e-3;

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

/// One residual of a sighting, in raw pixels, with its slopes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub(crate) off: f64,
    /// By the camera, its log focal, and its coefficients.
    pub(crate) by_view: [f64; Covariance::SIZE],
    pub(crate) by_place: [f64; PLACE],
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

    /// Where distances to the thing are measured to, and where it is said to be, with its slopes.
    pub(crate) fn anchor(&self, place: &[f64; PLACE]) -> (WorldPoint, [[f64; PLACE]; 3]) {
        match self {
            // Its foot, whichever of its points was seen.
            Self::Mark { z, .. } => {
                let slopes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]];
                (WorldPoint::new(place[0], place[1], *z), slopes)
            }
            _ => self.point(place, 0),
        }
    }

    /// Where a camera shows a point of the thing against where it was drawn: u and v; of a line, the
    /// distance from it. `None` behind the camera.
    pub(crate) fn sighted(
        &self,
        place: &[f64; PLACE],
        point: usize,
        pose: &Pose,
        drawn: &Drawn,
    ) -> Option<Vec<Row>> {
        let mut by_view = [0.0; Covariance::SIZE];
        if let Self::Line { origin } = self {
            let line = pose.show_line(*origin, place[0], place[1]);
            let (off, by_camera, by_lens, [offset, angle]) = line.distance(drawn);
            by_view[..POSE].copy_from_slice(&by_camera);
            by_view[POSE..].copy_from_slice(&by_lens);
            return Some(vec![Row { off, by_view, by_place: [offset, angle, 0.0] }]);
        }
        let (point, slopes) = self.point(place, point);
        let shown = pose.show(point)?;
        let off = drawn.raw([shown.at[0] - drawn.at[0], shown.at[1] - drawn.at[1]]);
        let by_camera: [[f64; 2]; POSE] =
            std::array::from_fn(|k| drawn.raw([shown.by_camera[0][k], shown.by_camera[1][k]]));
        let by_lens: [[f64; 2]; Distortion::MOST] =
            std::array::from_fn(|k| drawn.raw([-drawn.by_lens[0][k], -drawn.by_lens[1][k]]));
        let by_place: [[f64; 2]; PLACE] = std::array::from_fn(|k| {
            let along = |row: usize| (0..3).map(|axis| shown.by_point[row][axis] * slopes[axis][k]).sum();
            drawn.raw([along(0), along(1)])
        });
        let row = |i: usize| {
            (0..POSE).for_each(|k| by_view[k] = by_camera[k][i]);
            (0..Distortion::MOST).for_each(|k| by_view[POSE + k] = by_lens[k][i]);
            Row { off: off[i], by_view, by_place: by_place.map(|slope| slope[i]) }
        };
        Some([0, 1].map(row).to_vec())
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
