//! Landmarks, their observations, and measured distances between them; the reprojection error of an
//! observation with its Jacobian.

use crate::camera::{
    Covariance, FloorPoint, Lens, LineDistance, ObservedPixel, POSE_PARAMS, Pixel, Plane, PosedCamera,
    ReprojectedLine, Reprojection, WorldPoint,
};
use crate::single::Prior;

/// The most parameters that a landmark has.
pub const LANDMARK_PARAMS: usize = 3;

/// Two points nearer to each other than this, in metres, are the same place.
pub(crate) const SAME_PLACE: f64 = 1e-3;

/// What a landmark is, and with it the meaning of its three parameters ([`Landmark::place`]).
#[derive(Clone, Debug, PartialEq)]
pub enum LandmarkModel {
    /// A point at a known height: x, y in metres; the third parameter is not used.
    Point {
        /// In metres above the floor.
        height: f64,
    },
    /// A vertical post on the floor; point 0 is its foot, point 1 its head: x, y, length, in metres.
    Post,
    /// An upright rigid shape: x, y in metres, and turn about the vertical in radians.
    Mark {
        /// Height of its origin, in metres above the floor.
        z: f64,
        /// Its points relative to its origin at turn 0, in metres.
        points: Vec<[f64; 3]>,
    },
    /// A point whose coordinates were measured (a control point): x, y, z in metres.
    Measured,
    /// A line of the floor: distance of the line to the left of an origin in metres, and the angle it
    /// leads along, counter-clockwise from +x in radians. The pixels that show it need not show the same
    /// points of it.
    Line {
        /// A point near the line, x and y in metres; it is replaced when the line is triangulated.
        origin: [f64; 2],
    },
}

/// A pixel that shows a point of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the camera.
    pub view: usize,
    /// Index of the point in the landmark; of a line any point of it, each with an index of its own.
    pub point: usize,
    /// Raw pixel.
    pub pixel: Pixel,
    /// Standard deviation of each of its coordinates, in pixels.
    pub sigma: f64,
}

impl Observation {
    /// The only or first point of a landmark, seen with a standard deviation of one pixel.
    #[must_use]
    pub const fn new(view: usize, pixel: Pixel) -> Self {
        Self { view, point: 0, pixel, sigma: 1.0 }
    }
}

/// A landmark of the scene with the observations of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// What it is.
    pub model: LandmarkModel,
    /// Its parameters in the base system, in the order and units that the model says. Those that are free
    /// are triangulated before they are refined: their values here do not matter, but for the length of a
    /// post and the turn of a mark that no observation tells.
    pub place: [f64; 3],
    /// The plane that it stands or lies on, an index into
    /// [`BundleAdjustment::planes`](crate::BundleAdjustment::planes); the floor without.
    pub plane: Option<usize>,
    /// Where that plane is thought to be, and after the adjustment where it was found: heights of the model are
    /// above it.
    pub ground: Plane,
    /// Which parameters are estimated.
    pub free: [bool; 3],
    /// Priors of single parameters, with the index of each.
    pub priors: Vec<(usize, Prior)>,
    /// The pixels that show it.
    pub observations: Vec<Observation>,
    /// Is never rejected as an outlier.
    pub keep: bool,
    /// Takes no part: switched off, or rejected.
    pub off: bool,
}

impl Landmark {
    /// A landmark of which only the model is known: x and y (of a line offset and angle), the
    /// length of a post and the turn of a mark are free; a measured point is fixed at the origin.
    #[must_use]
    pub fn new(model: LandmarkModel, observations: Vec<Observation>) -> Self {
        let is_free = model != LandmarkModel::Measured;
        let third = matches!(model, LandmarkModel::Post | LandmarkModel::Mark { .. });
        Self {
            model,
            place: [0.0; LANDMARK_PARAMS],
            plane: None,
            ground: Plane::FLOOR,
            free: [is_free, is_free, third],
            priors: Vec::new(),
            observations,
            keep: false,
            off: false,
        }
    }

    /// A control point: its coordinates in metres with their standard deviation, exact where there is
    /// none.
    #[must_use]
    pub fn measured(at: WorldPoint, sigma: Option<f64>, observations: Vec<Observation>) -> Self {
        let place = <[f64; LANDMARK_PARAMS]>::from(at);
        let priors = sigma.map_or(Vec::new(), |sigma| {
            place.into_iter().map(|value| Prior { value, sigma }).enumerate().collect()
        });
        let free = [sigma.is_some(); LANDMARK_PARAMS];
        Self { place, free, priors, ..Self::new(LandmarkModel::Measured, observations) }
    }
}

/// A measured distance between two landmarks: between the origins of marks, the feet of posts, the points
/// themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceMeasurement {
    /// Indices of the two landmarks, neither of them a line.
    pub between: [usize; 2],
    /// In metres.
    pub length: Prior,
    /// Is never rejected as an outlier.
    pub keep: bool,
    /// Takes no part: switched off, or rejected.
    pub off: bool,
}

impl DistanceMeasurement {
    /// A length in metres with its standard deviation.
    #[must_use]
    pub const fn new(between: [usize; 2], value: f64, sigma: f64) -> Self {
        Self { between, length: Prior { value, sigma }, keep: false, off: false }
    }
}

/// One residual of an observation, reprojected less observed, in raw pixels, with its Jacobian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReprojectionError {
    pub(crate) pixels: f64,
    /// By the camera's pose, its log focal, and its coefficients.
    pub(crate) d_view: [f64; Covariance::SIZE],
    pub(crate) d_landmark: [f64; LANDMARK_PARAMS],
    /// By height and slope of the plane that the landmark stands on.
    pub(crate) d_plane: [f64; 3],
}

/// A point with its derivatives: row by row x, y, z by the parameters of its landmark.
pub(crate) type PointJacobian = (WorldPoint, [[f64; LANDMARK_PARAMS]; 3]);

impl LandmarkModel {
    /// A point of the landmark at a place on level ground.
    ///
    /// The point of a line is its origin moved to it.
    fn on_level(&self, place: &[f64; LANDMARK_PARAMS], index: usize) -> PointJacobian {
        let [a, b, c] = *place;
        let by_xy = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]];
        match self {
            Self::Point { height } => (WorldPoint::new(a, b, *height), by_xy),
            Self::Post if index == 0 => (WorldPoint::new(a, b, 0.0), by_xy),
            Self::Post => (WorldPoint::new(a, b, c), [by_xy[0], by_xy[1], [0.0, 0.0, 1.0]]),
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

    /// The point that distances are measured to and that is reported as the landmark's position, with its
    /// derivatives by the parameters.
    pub fn anchor(&self, place: &[f64; LANDMARK_PARAMS], ground: &Plane) -> PointJacobian {
        let level = match self {
            // Its foot, whichever of its points was seen.
            Self::Mark { z, .. } => {
                let jacobian = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]];
                (WorldPoint::new(place[0], place[1], *z), jacobian)
            }
            _ => self.on_level(place, 0),
        };
        self.lifted(level, place, ground)
    }

    /// A point of the landmark at a place on its ground.
    pub(crate) fn point(
        &self,
        place: &[f64; LANDMARK_PARAMS],
        index: usize,
        ground: &Plane,
    ) -> PointJacobian {
        self.lifted(self.on_level(place, index), place, ground)
    }

    /// A point of level ground, lifted by the height of the ground under the landmark: shapes stay upright.
    fn lifted(
        &self,
        (point, mut jacobian): PointJacobian,
        place: &[f64; LANDMARK_PARAMS],
        ground: &Plane,
    ) -> PointJacobian {
        let Some(foot) = self.foot(place) else { return (point, jacobian) };
        if *ground == Plane::FLOOR {
            return (point, jacobian);
        }
        let is_line = matches!(self, Self::Line { .. });
        let by_foot = if is_line { [jacobian[0], jacobian[1]] } else { [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        for k in 0..LANDMARK_PARAMS {
            jacobian[2][k] += ground.slope[0] * by_foot[0][k] + ground.slope[1] * by_foot[1][k];
        }
        (WorldPoint { z: point.z + ground.height_at(foot), ..point }, jacobian)
    }

    /// The point of the floor below which or above which its ground counts; none of what was measured.
    pub(crate) fn foot(&self, place: &[f64; LANDMARK_PARAMS]) -> Option<FloorPoint> {
        match self {
            Self::Measured => None,
            Self::Line { .. } => Some(self.on_level(place, 0).0.on_floor()),
            _ => Some(FloorPoint { x: place[0], y: place[1] }),
        }
    }

    /// The reprojection error of an observation: the reprojected less the observed pixel, u and v; of a line,
    /// the signed distance of the observed pixel from the reprojected line. `None` behind the camera.
    pub(crate) fn reprojection_error(
        &self,
        place: &[f64; LANDMARK_PARAMS],
        point: usize,
        ground: &Plane,
        pose: &PosedCamera,
        observed: &ObservedPixel,
    ) -> Option<impl Iterator<Item = ReprojectionError>> {
        if let Self::Line { origin } = self {
            let error = line_error(&pose.reproject_line(ground, *origin, place[0], place[1]), observed);
            return Some([error; 2].into_iter().take(1));
        }
        let (point, jacobian) = self.point(place, point, ground);
        let by_plane = self.foot(place).map_or([0.0; 3], |foot| ground.height_by_parameters(foot));
        Some(
            point_errors(&pose.reproject(point, observed.chart.as_ref())?, &jacobian, &by_plane, observed)
                .into_iter()
                .take(2),
        )
    }

    /// Number of residuals that one observation gives.
    pub(crate) fn residuals(&self) -> usize {
        if matches!(self, Self::Line { .. }) { 1 } else { 2 }
    }
}

/// The derivatives by camera and lens with that by the own focal of a wide lens, which is there where it is that of the
/// camera, added to that by this.
fn by_view(mut by: [f64; Covariance::SIZE], observed: &ObservedPixel) -> [f64; Covariance::SIZE] {
    if observed.chart.is_some() {
        by[Covariance::FOCAL] += std::mem::take(&mut by[POSE_PARAMS + Lens::OWN_FOCAL]);
    }
    by
}

/// Signed distance of an observed pixel from the reprojected floor line.
fn line_error(line: &ReprojectedLine, observed: &ObservedPixel) -> ReprojectionError {
    let LineDistance { pixels, d_camera, d_lens, d_line: [offset, angle], d_plane } = line.distance(observed);
    let mut d_camera_and_lens = [0.0; Covariance::SIZE];
    d_camera_and_lens[..POSE_PARAMS].copy_from_slice(&d_camera);
    d_camera_and_lens[POSE_PARAMS..].copy_from_slice(&d_lens);
    let d_view = by_view(d_camera_and_lens, observed);
    ReprojectionError { pixels, d_view, d_landmark: [offset, angle, 0.0], d_plane }
}

/// Reprojected less observed pixel, u and v, with `jacobian` the derivatives of the point by the parameters
/// of its landmark, and `by_plane` those of its height by its plane.
fn point_errors(
    reprojected: &Reprojection,
    jacobian: &[[f64; LANDMARK_PARAMS]; 3],
    by_plane: &[f64; 3],
    observed: &ObservedPixel,
) -> [ReprojectionError; 2] {
    let pixels = observed.raw([reprojected.at[0] - observed.at[0], reprojected.at[1] - observed.at[1]]);
    let d_camera: [[f64; 2]; POSE_PARAMS] =
        std::array::from_fn(|k| observed.raw([reprojected.d_camera[0][k], reprojected.d_camera[1][k]]));
    let d_lens: [[f64; 2]; Lens::PARAMETERS] =
        std::array::from_fn(|k| observed.raw([-observed.d_lens[0][k], -observed.d_lens[1][k]]));
    let d_landmark: [[f64; 2]; LANDMARK_PARAMS] = std::array::from_fn(|k| {
        let along = |row: usize| (0..3).map(|axis| reprojected.d_point[row][axis] * jacobian[axis][k]).sum();
        observed.raw([along(0), along(1)])
    });
    let up = observed.raw([reprojected.d_point[0][2], reprojected.d_point[1][2]]);
    [0, 1].map(|i| {
        let mut d_view = [0.0; Covariance::SIZE];
        (0..POSE_PARAMS).for_each(|k| d_view[k] = d_camera[k][i]);
        (0..Lens::PARAMETERS).for_each(|k| d_view[POSE_PARAMS + k] = d_lens[k][i]);
        let d_view = by_view(d_view, observed);
        let d_landmark = d_landmark.map(|column| column[i]);
        let d_plane = by_plane.map(|by| by * up[i]);
        ReprojectionError { pixels: pixels[i], d_view, d_landmark, d_plane }
    })
}

impl Landmark {
    /// Number of residuals minus number of free parameters.
    pub fn redundancy(&self) -> i64 {
        let unknowns = self.free.iter().filter(|&&free| free).count();
        let residuals = self.observations.len() * self.model.residuals() + self.priors.len();
        residuals as i64 - unknowns as i64
    }

    /// Where it is: the point, the foot of a post, the origin of a mark, the point of a line next to the
    /// line's own origin.
    #[must_use]
    pub fn position(&self) -> WorldPoint {
        self.model.anchor(&self.place, &self.ground).0
    }

    /// The plane at the height of a point of it above its ground.
    pub(crate) fn plane_of(&self, point: usize) -> Plane {
        self.ground.raised(self.model.on_level(&self.place, point).0.z)
    }

    /// A point of it where it is.
    pub fn point(&self, point: usize) -> WorldPoint {
        self.model.point(&self.place, point, &self.ground).0
    }

    /// Every two of the cameras that see it, the lower first.
    fn pairs_of_views(&self) -> Vec<[usize; 2]> {
        pairs_among(&self.views()).collect()
    }

    /// Indices of the cameras that see it, each once, ascending.
    pub fn views(&self) -> Vec<usize> {
        let mut views: Vec<usize> = self.observations.iter().map(|seen| seen.view).collect();
        views.sort_unstable();
        views.dedup();
        views
    }
}

/// Every two views that observe a landmark in common which takes part, in their order.
pub(crate) fn observing_in_common(landmarks: &[Landmark]) -> Vec<[usize; 2]> {
    let taking_part = landmarks.iter().filter(|landmark| !landmark.off);
    let mut pairs: Vec<[usize; 2]> = taking_part.flat_map(Landmark::pairs_of_views).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Every two of ascending indices, the lower first.
pub(crate) fn pairs_among(views: &[usize]) -> impl Iterator<Item = [usize; 2]> + '_ {
    let with_later = |(k, &a): (usize, &usize)| views[k + 1..].iter().map(move |&b| [a, b]);
    views.iter().enumerate().flat_map(with_later)
}
