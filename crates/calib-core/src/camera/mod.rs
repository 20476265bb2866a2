//! The camera model: a pinhole with a lens in front, its maps between pixels and space, their derivatives.
//!
//! Law: one camera, no scene. Nothing here knows annotations, landmarks or the EFOV; every map comes with its
//! Jacobian.
//!
//! - `space` one type per space: raw pixel, undistorted pixel, floor, world, plan;
//! - `elementary` sines and roots that are the same on every machine; `simd` loops with its vector instructions;
//! - `polynomial`, `distortion` the distortion models, one a file; `lens` distortion as a map of pixels;
//! - `covariance` the covariance of a camera; `pinhole` the camera itself; `straight_down` its turn where roll and yaw are
//!   one; `chart` **views of a wide lens
//!   in which lines beside the camera are straight**;
//! - `plane` planes besides the floor; `floor_covariance` **the covariance of a floor point**; `reprojection` pixels of points and floor lines with
//!   Jacobians, for the bundle adjustment;
//! - `as_mint`, `as_nalgebra`, `as_cam_geom` conversions to other libraries.

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
pub use distortion::{BrownConrady, Coefficient, Distortion, DistortionModel, MODELS, ModelRow};
pub use floor_covariance::FloorCovariance;
pub(crate) use lens::ByParameters;
pub use lens::Lens;
pub(crate) use numerics::{angle_from_axis, dispatch, hypot, sin_cos};
pub use pinhole::{Camera, Ray, angles_from_rotation, camera_from_world};
pub use plane::Plane;
pub use rotation::{Movement, Turn, Turned, floor_nearness, ray_in_camera};
pub use space::{FloorPoint, ImageCircle, Pixel, PlanPixel, PlanScale, UndistortedPixel, WorldPoint};
pub use straight_down::StraightDown;

pub(crate) use chart::ChartPoint;
#[cfg(test)]
pub(crate) use distortion::tests::any_distortion;
pub(crate) use distortion::{BrownInverse, ByCoefficient, LANES, Matrix2, times};
pub(crate) use floor_covariance::FloorSlopes;
#[cfg(test)]
pub(crate) use pinhole::tests::any_camera;
pub(crate) use pinhole::{NEAREST, dot};
pub(crate) use reprojection::{LineDistance, POSE_PARAMS, ReprojectedLine, Reprojection};
pub use reprojection::{ObservedPixel, PosedCamera};
