//! The camera: spaces, lenses, the pinhole, and how they depend on each other.
//!
//! Law: one camera, no scene. Nothing here knows what was drawn, where the floor ends or who asks; every map
//! has its derivatives beside it.

mod space;
mod polynomial;
mod distortion;
mod lens;
mod covariance;
mod pinhole;
mod floor_covariance;
mod reprojection;
#[cfg(feature = "mint")]
mod as_mint;
#[cfg(feature = "nalgebra")]
mod as_nalgebra;
#[cfg(feature = "cam-geom")]
mod as_cam_geom;

pub use covariance::Covariance;
pub use distortion::{BrownConrady, Coefficient, Distortion, DistortionModel, MODELS, ModelRow};
pub use floor_covariance::FloorCovariance;
pub use lens::Lens;
pub use pinhole::{Camera, Ray, angles_from_rotation, camera_from_world};
pub use space::{FloorPoint, Pixel, PlanPixel, PlanScale, UndistortedPixel, WorldPoint};

#[cfg(test)]
pub(crate) use distortion::tests::any_distortion;
pub(crate) use distortion::{ByCoefficient, ByCoefficients, Matrix2, times};
pub(crate) use pinhole::dot;
#[cfg(test)]
pub(crate) use pinhole::tests::any_camera;
pub(crate) use reprojection::{ObservedPixel, POSE_PARAMS, PosedCamera, ReprojectedLine, Reprojection};
