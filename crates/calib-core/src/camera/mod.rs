//! Camera model: a pinhole with a lens, the maps between pixels and space, and the derivatives of the maps.
//!
//! Rule: one camera, no scene. This module contains no annotations, landmarks or EFOV. Every map has its
//! Jacobian.
//!
//! - `space`: one type for each space: raw pixel, undistorted pixel, floor, world, plan
//! - `numerics`: elementary functions with identical bits on every machine, vector loops, polynomials
//! - `distortion`: distortion models, one per file
//! - `lens`: distortion and principal point as a map of pixels
//! - `covariance`: covariance of the camera parameters
//! - `pinhole`: the camera, its projection and its rays
//! - `straight_down`: orientation of a camera that looks straight down, where roll and yaw are not separable
//! - `chart`: virtual pinhole views of a wide lens, in which straight lines in space are straight
//! - `plane`: planes other than the floor
//! - `floor_covariance`: covariance of a floor point
//! - `reprojection`: pixels of points and floor lines with Jacobians, for the bundle adjustment
//! - `rotation`: rotation and zoom of a camera at a fixed position
//! - `as_mint`, `as_nalgebra`, `as_cam_geom`: conversions to other libraries

mod space;
mod numerics;
mod distortion;
mod lens;
mod covariance;
mod pinhole;
mod straight_down;
mod chart;
mod plane;
mod floor_covariance;
mod reprojection;
mod rotation;
#[cfg(feature = "mint")]
mod as_mint;
#[cfg(feature = "nalgebra")]
mod as_nalgebra;
#[cfg(feature = "cam-geom")]
mod as_cam_geom;

pub use chart::Chart;
pub use covariance::Covariance;
pub use distortion::{
    BrownConrady, Coefficient, Distortion, DistortionModel, MODELS, ModelRow, Rational, Unified,
};
pub use floor_covariance::FloorCovariance;
pub(crate) use lens::ByParameters;
pub use lens::Lens;
pub(crate) use numerics::{angle_from_axis, dispatch, hypot, sin_cos};
pub use pinhole::{Camera, Ray, angles_from_rotation, camera_from_world};
pub use plane::Plane;
pub use rotation::{PanTiltZoom, RotatedCamera, RotationZoom, inverse_floor_depth, pixel_to_camera_ray};
pub use space::{FloorPoint, ImageCircle, Pixel, PlanPixel, PlanScale, UndistortedPixel, WorldPoint};
pub use straight_down::StraightDown;

pub(crate) use chart::ChartPoint;
#[cfg(test)]
pub(crate) use distortion::tests::any_distortion;
pub(crate) use distortion::{BrownInverse, ByCoefficient, LANES, Matrix2, multiply};
pub(crate) use floor_covariance::FloorDerivatives;
#[cfg(test)]
pub(crate) use pinhole::tests::any_camera;
pub(crate) use pinhole::{MIN_DEPTH, dot};
pub(crate) use reprojection::{LineDistance, POSE_PARAMS, ReprojectedLine, Reprojection};
pub use reprojection::{ObservedPixel, PosedCamera};
