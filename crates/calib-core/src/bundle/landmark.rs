//! What cameras have in common: landmarks of the scene with a place of their own, and the pixels that
//! show them.

use crate::camera::{Covariance, Distortion, ObservedPixel, POSE_PARAMS, Pixel, PosedCamera, WorldPoint};
use crate::single::Prior;

/// The most unknowns a landmark has.
pub(crate) const LANDMARK_PARAMS: usize = 3;

/// Metres between two places that are not one.
pub(crate) const APART: f64 = 1e-3;

/// What a landmark is, and what its unknowns are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum LandmarkModel {
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

/// A pixel that shows a point of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Observation {
    /// Index of the camera.
    pub(crate) view: usize,
    /// Index of the point; of a line, any point of it.
    pub(crate) point: usize,
    /// Raw pixel.
    pub(crate) pixel: Pixel,
    /// Standard deviation of its coordinates, in pixels.
    pub(crate) sigma: f64,
}

/// A landmark of the scene and who sees it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Landmark {
    pub(crate) model: LandmarkModel,
    /// Its unknowns, where they start.
    pub(crate) place: [f64; LANDMARK_PARAMS],
    /// Which of them are free.
    pub(crate) free: [bool; LANDMARK_PARAMS],
    /// What is believed of them.
    pub(crate) priors: Vec<(usize, Prior)>,
    pub(crate) observations: Vec<Observation>,
    /// Never rejected.
    pub(crate) keep: bool,
    /// Says nothing: switched off, or rejected.
    pub(crate) off: bool,
}

/// A distance between two landmarks that was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DistanceMeasurement {
    /// Indices of the two.
    pub(crate) between: [usize; 2],
    /// In metres.
    pub(crate) length: Prior,
    /// Never rejected.
    pub(crate) keep: bool,
    /// Says nothing: switched off, or rejected.
    pub(crate) off: bool,
}

/// One residual of an observation, in raw pixels, with its derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub(crate) off: f64,
    /// By the camera, its log focal, and its coefficients.
    pub(crate) d_view: [f64; Covariance::SIZE],
    pub(crate) d_landmark: [f64; LANDMARK_PARAMS],
}

impl LandmarkModel {
    /// A point of the landmark at a place, with its derivatives: row by row x, y, z by the unknowns.
    ///
    /// The point of a line is its origin moved to it.
    pub(crate) fn point(
        &self,
        place: &[f64; LANDMARK_PARAMS],
        index: usize,
    ) -> (WorldPoint, [[f64; LANDMARK_PARAMS]; 3]) {
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
                let jacobian = [[-sin, -a * cos, 0.0], [cos, -a * sin, 0.0], [0.0; 3]];
                (WorldPoint::new(x - a * sin, y + a * cos, 0.0), jacobian)
            }
        }
    }

    /// Where distances to the landmark are measured to, and where it is said to be, with its derivatives.
    pub(crate) fn anchor(&self, place: &[f64; LANDMARK_PARAMS]) -> (WorldPoint, [[f64; LANDMARK_PARAMS]; 3]) {
        match self {
            // Its foot, whichever of its points was seen.
            Self::Mark { z, .. } => {
                let jacobian = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]];
                (WorldPoint::new(place[0], place[1], *z), jacobian)
            }
            _ => self.point(place, 0),
        }
    }

    /// Where a camera shows a point of the landmark against where it was drawn: u and v; of a line, the
    /// distance from it. `None` behind the camera.
    pub(crate) fn reprojection_error(
        &self,
        place: &[f64; LANDMARK_PARAMS],
        point: usize,
        pose: &PosedCamera,
        observed: &ObservedPixel,
    ) -> Option<Vec<Row>> {
        let mut d_view = [0.0; Covariance::SIZE];
        if let Self::Line { origin } = self {
            let line = pose.reproject_line(*origin, place[0], place[1]);
            let (off, d_camera, d_lens, [offset, angle]) = line.distance(observed);
            d_view[..POSE_PARAMS].copy_from_slice(&d_camera);
            d_view[POSE_PARAMS..].copy_from_slice(&d_lens);
            return Some(vec![Row { off, d_view, d_landmark: [offset, angle, 0.0] }]);
        }
        let (point, jacobian) = self.point(place, point);
        let reprojected = pose.reproject(point)?;
        let off = observed.raw([reprojected.at[0] - observed.at[0], reprojected.at[1] - observed.at[1]]);
        let d_camera: [[f64; 2]; POSE_PARAMS] =
            std::array::from_fn(|k| observed.raw([reprojected.d_camera[0][k], reprojected.d_camera[1][k]]));
        let d_lens: [[f64; 2]; Distortion::MOST] =
            std::array::from_fn(|k| observed.raw([-observed.d_lens[0][k], -observed.d_lens[1][k]]));
        let d_landmark: [[f64; 2]; LANDMARK_PARAMS] = std::array::from_fn(|k| {
            let along =
                |row: usize| (0..3).map(|axis| reprojected.d_point[row][axis] * jacobian[axis][k]).sum();
            observed.raw([along(0), along(1)])
        });
        let row = |i: usize| {
            (0..POSE_PARAMS).for_each(|k| d_view[k] = d_camera[k][i]);
            (0..Distortion::MOST).for_each(|k| d_view[POSE_PARAMS + k] = d_lens[k][i]);
            Row { off: off[i], d_view, d_landmark: d_landmark.map(|jacobian| jacobian[i]) }
        };
        Some([0, 1].map(row).to_vec())
    }

    /// Number of residuals of an observation.
    pub(crate) fn residuals(&self) -> usize {
        if matches!(self, Self::Line { .. }) { 1 } else { 2 }
    }
}

impl Landmark {
    /// Number of residuals less number of unknowns: what the landmark says beyond its own place.
    pub(crate) fn redundancy(&self) -> i64 {
        let unknowns = self.free.iter().filter(|&&free| free).count();
        let said = self.observations.len() * self.model.residuals() + self.priors.len();
        said as i64 - unknowns as i64
    }

    /// Indices of the cameras that see it, each once.
    pub(crate) fn views(&self) -> Vec<usize> {
        let mut views: Vec<usize> = self.observations.iter().map(|seen| seen.view).collect();
        views.sort_unstable();
        views.dedup();
        views
    }
}
