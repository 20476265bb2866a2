//! Camera calibration from scene geometry: one image per camera, without patterns.
//!
//! The method is A. Abramov's "Two-Stage Camera Calibration Method for Multi-Camera Systems Using Scene
//! Geometry":
//!
//! 1. Lens distortion is fitted to straight edges ([`LensFit`]) or given ([`Lens`]).
//! 2. Stage 1 estimates one camera. Lines of the operator ([`Annotation`]) determine roll, pitch and focal
//!    length ([`Fit`]). The effective field of view (EFOV) is projected to the floor ([`efov_on_floor`]),
//!    with the camera 3 m above (0, 0).
//! 3. Stage 2 estimates all cameras in one coordinate system. The placement of the EFOV on a plan
//!    ([`Placement`]) or control points determine x0, y0, z0 and yaw. Points, posts and lines that several
//!    cameras observe, and known distances, refine all cameras jointly ([`BundleAdjustment::solve`]).
//! 4. A [`Camera`] maps pixels to the floor, and points in space to pixels.
//!
//! This crate takes values and returns values. The site file, its checks and its messages are in
//! `calib-site`, drift detection is in `calib-health`.
//!
//! # Modules, in data-flow order
//!
//! - Module [`camera`] contains point types for each coordinate system, distortion models, the pinhole,
//!   reprojection with Jacobians, and covariances.
//! - Module [`optimize`] contains Levenberg-Marquardt, Nelder-Mead, normal equations, Schur complement,
//!   sparse Cholesky, and statistics.
//! - Module [`floor`] contains the floor seen by a calibrated camera: projection, EFOV, resection,
//!   undistorted images, coverage, and measurements.
//! - Module [`outcome`] contains results as values: findings, failures, residuals, and suggestions.
//! - Module [`single`] is stage 1: plumb-line lens fit, maximum-likelihood fit, the paper's criterion,
//!   outliers, and accuracy.
//! - Module [`bundle`] is stage 2: landmarks, view graph, triangulation, and bundle adjustment.
//!
//! A module uses only modules above it. The residual of every annotation is derived in `single/residual.rs`
//! and evaluated in `single/likelihood.rs`. Reprojection errors are in `bundle/landmark.rs`. The predicted
//! error of floor lengths is in `single/accuracy.rs`, the covariance of a floor point in
//! `camera/floor_covariance.rs` ([`Camera::floor_covariance`]).
//!
//! # Conventions
//!
//! - World: right-handed, metres, z up, floor at z = 0. The camera is at (x0, y0, z0).
//! - With yaw = pitch = roll = 0 the optical axis points along +y, image right is +x, image down is -z.
//! - Yaw is about world z, counter-clockwise seen from above. Pitch is positive looking down. Roll is about
//!   the optical axis, positive if the camera is rotated clockwise seen from behind. They apply in the order
//!   yaw, pitch, roll. Angles are in radians; names that end in `_deg` are in degrees.
//! - Pixels: x right, y down. The image spans `[0, width] x [0, height]`, so the centre of the first pixel is
//!   (0.5, 0.5). OpenCV's pixel coordinates are smaller by 0.5.
//! - The focal length is in pixels along x. Pixels are square, unless the lens has another pixel aspect.
//!   Undistorted pixels are always square. The principal point defaults to the image centre.
//! - Distortion coefficients follow OpenCV, on coordinates divided by the focal length.
//!
//! # Example
//!
//! ```
//! use calib_core::{Camera, Covariance, Lens, Pixel, WorldPoint};
//!
//! let camera = Camera {
//!     position: WorldPoint::new(0.0, 0.0, 3.0),
//!     yaw: 0.0,
//!     pitch: 30_f64.to_radians(),
//!     roll: 0.0,
//!     focal: 1400.0,
//!     lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
//!     covariance: Covariance::EXACT,
//! };
//! let foot = camera.pixel_to_floor(Pixel::new(960.0, 540.0), 0.0).unwrap();
//! assert!((foot.y - 3.0 / 30_f64.to_radians().tan()).abs() < 1e-12);
//! assert_eq!(camera.pixel_to_floor(Pixel::new(960.0, -600.0), 0.0), None, "above the horizon");
//! ```
//!
//! # Features
//!
//! `mint`, `nalgebra`, `cam-geom`: conversions to and from those libraries.

pub mod camera;
pub mod optimize;
pub mod floor;
pub mod outcome;
pub mod single;
pub mod bundle;

pub use bundle::{
    BundleAdjustment, BundleCamera, BundleError, BundleSummary, InitialPose, Landmark, LandmarkModel,
    Observation,
};
pub use camera::{
    BrownConrady, Camera, Covariance, Distortion, DistortionModel, FloorCovariance, FloorPoint, ImageCircle,
    Lens, Pixel, PlanPixel, PlanScale, Plane, Ray, UndistortedPixel, WorldPoint,
};
pub use floor::{
    CameraView, ControlPoint, Extent, FloorProjector, MarkKind, MarkShape, Placement, PointProjector,
    Polyline, Remap, Status, Surface, SurfaceProjector, Undistortion, Window, default_efov, efov_on_floor,
    floor_grid, from_control_points, horizon, on_image,
};
pub use outcome::{
    Code, Failure, FailureCode, Finding, Parameter, Residual, ResidualOf, Severity, Subject, Suggestion,
};
pub use single::{
    Annotation, Constraints, Fit, FitOptions, FittedCoefficients, Kind, LensFit, LensOptions, Orientation,
    Prior, Priors, SceneErrors,
};
