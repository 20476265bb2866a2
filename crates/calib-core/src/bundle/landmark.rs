//! Landmarks, their observations, and measured distances between them; the reprojection error of an
//! observation with its Jacobian.

use crate::camera::{
    Covariance, FloorPoint, Lens, LineDistance, ObservedPixel, POSE_PARAMS, Pixel, Plane, PosedCamera,
    ReprojectedLine, Reprojection, WorldPoint,
};
use crate::single::Prior;

/// Largest number of parameters of a landmark.
pub const LANDMARK_PARAMS: usize = 3;

/// Distance below which two points count as the same position, in metres.
pub(crate) const SAME_POSITION_M: f64 = 1e-3;

/// Kind of a landmark, which defines the meaning of its three parameters ([`Landmark::params`]).
#[derive(Clone, Debug, PartialEq)]
pub enum LandmarkModel {
    /// Point at a known height. Parameters: x, y in metres; the third is not used.
    Point {
        /// Height above the floor, in metres.
        height: f64,
    },
    /// Vertical post on the floor; point 0 is its foot, point 1 its head. Parameters: x, y, length, in
    /// metres.
    Post,
    /// Upright rigid shape. Parameters: x, y in metres, and rotation about the vertical in radians.
    Mark {
        /// Height of the origin of the shape above the floor, in metres.
        z: f64,
        /// Points of the shape relative to its origin, at rotation 0, in metres.
        points: Vec<[f64; 3]>,
    },
    /// Point with measured coordinates (a control point). Parameters: x, y, z in metres.
    Measured,
    /// Line of the floor. Parameters: signed distance of the line to the left of an origin, in metres, and
    /// its direction, counter-clockwise from +x, in radians. Its observations in different images need not be
    /// the same points of the line.
    Line {
        /// Point near the line, x and y in metres; it is replaced when the line is triangulated.
        origin: [f64; 2],
    },
}

/// Observation of a point of a landmark in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the camera.
    pub view: usize,
    /// Index of the point in the landmark. Every observed point of a line has its own index.
    pub point: usize,
    /// Raw (distorted) pixel.
    pub pixel: Pixel,
    /// Standard deviation of each coordinate, in pixels.
    pub sigma: f64,
}

impl Observation {
    /// Creates an observation of point 0 of a landmark with a standard deviation of one pixel.
    #[must_use]
    pub const fn new(view: usize, pixel: Pixel) -> Self {
        Self { view, point: 0, pixel, sigma: 1.0 }
    }
}

/// Landmark of the scene with its observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// Kind of the landmark.
    pub model: LandmarkModel,
    /// Parameters in the base system, in the order and units of the model. Free parameters are triangulated
    /// before the refinement, so their initial values are ignored. Exceptions are the length of a post and
    /// the rotation of a mark, if no observation determines them.
    pub params: [f64; 3],
    /// Plane under the landmark, as an index into
    /// [`BundleAdjustment::planes`](crate::BundleAdjustment::planes); `None` is the floor.
    pub plane: Option<usize>,
    /// Plane under the landmark: its initial position, or its estimate after the adjustment. Heights of the
    /// model are relative to this plane.
    pub ground: Plane,
    /// Flags of the estimated parameters.
    pub free: [bool; 3],
    /// Priors on single parameters, each with the index of its parameter.
    pub priors: Vec<(usize, Prior)>,
    /// Observations in the images.
    pub observations: Vec<Observation>,
    /// Whether the landmark is protected from rejection as an outlier.
    pub keep: bool,
    /// Whether the landmark is not used: switched off, or rejected.
    pub off: bool,
    /// Whether a robust fit of one camera contradicts the landmark. If so, the landmark is rejected at first, and is
    /// restored if the refined cameras agree with it.
    pub is_suspect: bool,
}

impl Landmark {
    /// Creates a landmark at an unknown position. The first two parameters are free, and so are the length of
    /// a post and the rotation of a mark. A measured point is fixed at the origin.
    #[must_use]
    pub fn new(model: LandmarkModel, observations: Vec<Observation>) -> Self {
        let is_free = model != LandmarkModel::Measured;
        let third = matches!(model, LandmarkModel::Post | LandmarkModel::Mark { .. });
        Self {
            model,
            params: [0.0; LANDMARK_PARAMS],
            plane: None,
            ground: Plane::FLOOR,
            free: [is_free, is_free, third],
            priors: Vec::new(),
            observations,
            keep: false,
            off: false,
            is_suspect: false,
        }
    }

    /// Creates a control point from its coordinates and their standard deviation, in metres. `None` means
    /// exact.
    #[must_use]
    pub fn measured(at: WorldPoint, sigma: Option<f64>, observations: Vec<Observation>) -> Self {
        let params = <[f64; LANDMARK_PARAMS]>::from(at);
        let priors = sigma.map_or(Vec::new(), |sigma| {
            params.into_iter().map(|value| Prior { value, sigma }).enumerate().collect()
        });
        let free = [sigma.is_some(); LANDMARK_PARAMS];
        Self { params, free, priors, ..Self::new(LandmarkModel::Measured, observations) }
    }
}

/// Measured distance between two landmarks: between the origins of marks, the feet of posts, or the points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceMeasurement {
    /// Indices of the two landmarks; lines are not supported.
    pub between: [usize; 2],
    /// Length, in metres.
    pub length: Prior,
    /// Whether the distance is protected from rejection as an outlier.
    pub keep: bool,
    /// Whether the distance is not used: switched off, or rejected.
    pub off: bool,
}

impl DistanceMeasurement {
    /// Creates a distance from a length and its standard deviation, in metres.
    #[must_use]
    pub const fn new(between: [usize; 2], value: f64, sigma: f64) -> Self {
        Self { between, length: Prior { value, sigma }, keep: false, off: false }
    }
}

/// Residual of an observation, reprojected minus observed, in raw pixels, with its Jacobian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReprojectionError {
    /// Reprojected minus observed coordinate, or signed distance of the observed pixel from a reprojected line,
    /// in raw pixels.
    pub(crate) pixels: f64,
    /// Derivatives with respect to the camera's pose, log focal length and lens parameters.
    pub(crate) d_view: [f64; Covariance::SIZE],
    /// Derivatives with respect to the parameters of the landmark.
    pub(crate) d_landmark: [f64; LANDMARK_PARAMS],
    /// Derivatives with respect to the height and slope of the plane under the landmark.
    pub(crate) d_plane: [f64; 3],
}

/// Point with its derivatives: rows x, y, z, columns the parameters of its landmark.
pub(crate) type PointJacobian = (WorldPoint, [[f64; LANDMARK_PARAMS]; 3]);

impl LandmarkModel {
    /// Returns a point of the landmark on level ground, with its derivatives.
    ///
    /// The point of a line is the projection of its origin onto the line.
    fn on_level(&self, params: &[f64; LANDMARK_PARAMS], index: usize) -> PointJacobian {
        let [a, b, c] = *params;
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

    /// Returns the reference point of the landmark with its derivatives with respect to the parameters. This
    /// point is the reported position of the landmark and the end of measured distances.
    pub fn anchor(&self, params: &[f64; LANDMARK_PARAMS], ground: &Plane) -> PointJacobian {
        let level = match self {
            // A mark is represented by its origin, independently of the observed points.
            Self::Mark { z, .. } => {
                let jacobian = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]];
                (WorldPoint::new(params[0], params[1], *z), jacobian)
            }
            _ => self.on_level(params, 0),
        };
        self.raise_to_ground(level, params, ground)
    }

    /// Returns a point of the landmark on its ground plane, with its derivatives.
    pub(crate) fn point(
        &self,
        params: &[f64; LANDMARK_PARAMS],
        index: usize,
        ground: &Plane,
    ) -> PointJacobian {
        self.raise_to_ground(self.on_level(params, index), params, ground)
    }

    /// Raises a point on level ground by the height of the ground under the landmark. Shapes stay upright.
    fn raise_to_ground(
        &self,
        (point, mut jacobian): PointJacobian,
        params: &[f64; LANDMARK_PARAMS],
        ground: &Plane,
    ) -> PointJacobian {
        let Some(foot) = self.foot(params) else { return (point, jacobian) };
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

    /// Returns the floor position at which the height of the ground plane is evaluated; `None` for a measured
    /// point.
    pub(crate) fn foot(&self, params: &[f64; LANDMARK_PARAMS]) -> Option<FloorPoint> {
        match self {
            Self::Measured => None,
            Self::Line { .. } => Some(self.on_level(params, 0).0.on_floor()),
            _ => Some(FloorPoint { x: params[0], y: params[1] }),
        }
    }

    /// Returns the reprojection error of an observation: reprojected minus observed pixel, u and v. For a
    /// line it is the signed distance of the observed pixel from the reprojected line. Returns `None` if the
    /// point is behind the camera.
    pub(crate) fn reprojection_error(
        &self,
        params: &[f64; LANDMARK_PARAMS],
        point: usize,
        ground: &Plane,
        pose: &PosedCamera,
        observed: &ObservedPixel,
    ) -> Option<impl Iterator<Item = ReprojectionError>> {
        if let Self::Line { origin } = self {
            let error = line_error(&pose.reproject_line(ground, *origin, params[0], params[1]), observed);
            return Some([error; 2].into_iter().take(1));
        }
        let (point, jacobian) = self.point(params, point, ground);
        let by_plane = self.foot(params).map_or([0.0; 3], |foot| ground.height_by_parameters(foot));
        Some(
            point_errors(&pose.reproject(point, observed.chart.as_ref())?, &jacobian, &by_plane, observed)
                .into_iter()
                .take(2),
        )
    }

    /// Returns the number of residuals of one observation: 1 for a line, otherwise 2.
    pub(crate) fn residuals(&self) -> usize {
        if matches!(self, Self::Line { .. }) { 1 } else { 2 }
    }
}

/// Adds the derivative with respect to the own focal length of a wide lens to the derivative with respect to
/// the focal length of the camera. The observed pixel has a chart only if both focal lengths are equal.
fn merge_tied_focal(mut by: [f64; Covariance::SIZE], observed: &ObservedPixel) -> [f64; Covariance::SIZE] {
    if observed.chart.is_some() {
        by[Covariance::FOCAL] += std::mem::take(&mut by[POSE_PARAMS + Lens::LENS_FOCAL]);
    }
    by
}

/// Returns the signed distance of an observed pixel from the reprojected floor line.
fn line_error(line: &ReprojectedLine, observed: &ObservedPixel) -> ReprojectionError {
    let LineDistance { pixels, d_camera, d_lens, d_line: [offset, angle], d_plane } = line.distance(observed);
    let mut d_camera_and_lens = [0.0; Covariance::SIZE];
    d_camera_and_lens[..POSE_PARAMS].copy_from_slice(&d_camera);
    d_camera_and_lens[POSE_PARAMS..].copy_from_slice(&d_lens);
    let d_view = merge_tied_focal(d_camera_and_lens, observed);
    ReprojectionError { pixels, d_view, d_landmark: [offset, angle, 0.0], d_plane }
}

/// Returns reprojected minus observed pixel, u and v. `jacobian` contains the derivatives of the point with
/// respect to the parameters of its landmark. `by_plane` contains the derivatives of its height with respect
/// to its plane.
fn point_errors(
    reprojected: &Reprojection,
    jacobian: &[[f64; LANDMARK_PARAMS]; 3],
    by_plane: &[f64; 3],
    observed: &ObservedPixel,
) -> [ReprojectionError; 2] {
    let pixels =
        observed.raw_offset([reprojected.at[0] - observed.at[0], reprojected.at[1] - observed.at[1]]);
    let d_camera: [[f64; 2]; POSE_PARAMS] = std::array::from_fn(|k| {
        observed.raw_offset([reprojected.d_camera[0][k], reprojected.d_camera[1][k]])
    });
    let d_lens: [[f64; 2]; Lens::PARAMETERS] =
        std::array::from_fn(|k| observed.raw_offset([-observed.d_lens[0][k], -observed.d_lens[1][k]]));
    let d_landmark: [[f64; 2]; LANDMARK_PARAMS] = std::array::from_fn(|k| {
        let along = |row: usize| (0..3).map(|axis| reprojected.d_point[row][axis] * jacobian[axis][k]).sum();
        observed.raw_offset([along(0), along(1)])
    });
    let up = observed.raw_offset([reprojected.d_point[0][2], reprojected.d_point[1][2]]);
    [0, 1].map(|i| {
        let mut d_view = [0.0; Covariance::SIZE];
        (0..POSE_PARAMS).for_each(|k| d_view[k] = d_camera[k][i]);
        (0..Lens::PARAMETERS).for_each(|k| d_view[POSE_PARAMS + k] = d_lens[k][i]);
        let d_view = merge_tied_focal(d_view, observed);
        let d_landmark = d_landmark.map(|column| column[i]);
        let d_plane = by_plane.map(|by| by * up[i]);
        ReprojectionError { pixels: pixels[i], d_view, d_landmark, d_plane }
    })
}

impl Landmark {
    /// Whether x and y of the landmark are fixed or have priors. Always false for a line.
    pub(crate) fn is_measured(&self) -> bool {
        let is_known = |k: usize| !self.free[k] || self.priors.iter().any(|(prior, _)| *prior == k);
        !matches!(self.model, LandmarkModel::Line { .. }) && is_known(0) && is_known(1)
    }

    /// Returns the redundancy of the landmark: number of residuals minus number of free parameters.
    pub fn redundancy(&self) -> i64 {
        let unknowns = self.free.iter().filter(|&&free| free).count();
        let residuals = self.observations.len() * self.model.residuals() + self.priors.len();
        residuals as i64 - unknowns as i64
    }

    /// Returns the position of the landmark in metres. It is the point, the foot of a post, the origin of a
    /// mark, or the point of a line closest to the line's origin.
    #[must_use]
    pub fn position(&self) -> WorldPoint {
        self.model.anchor(&self.params, &self.ground).0
    }

    /// Returns the plane through a point of the landmark, parallel to its ground.
    pub(crate) fn plane_at_point(&self, point: usize) -> Plane {
        self.ground.raised(self.model.on_level(&self.params, point).0.z)
    }

    /// Returns the position of a point of the landmark.
    pub fn point(&self, point: usize) -> WorldPoint {
        self.model.point(&self.params, point, &self.ground).0
    }

    /// Returns all pairs of cameras that observe the landmark, the lower index first.
    fn view_pairs(&self) -> Vec<[usize; 2]> {
        pairs_among(&self.views()).collect()
    }

    /// Returns the indices of the cameras that observe the landmark, without duplicates, ascending.
    pub fn views(&self) -> Vec<usize> {
        let mut views: Vec<usize> = self.observations.iter().map(|seen| seen.view).collect();
        views.sort_unstable();
        views.dedup();
        views
    }
}

/// Returns all pairs of views that share an active landmark, sorted.
pub(crate) fn covisible_pairs(landmarks: &[Landmark]) -> Vec<[usize; 2]> {
    let taking_part = landmarks.iter().filter(|landmark| !landmark.off);
    let mut pairs: Vec<[usize; 2]> = taking_part.flat_map(Landmark::view_pairs).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Returns all pairs of ascending indices, the lower first.
pub(crate) fn pairs_among(views: &[usize]) -> impl Iterator<Item = [usize; 2]> + '_ {
    let with_later = |(k, &a): (usize, &usize)| views[k + 1..].iter().map(move |&b| [a, b]);
    views.iter().enumerate().flat_map(with_later)
}
