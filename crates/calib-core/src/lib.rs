//! Two-stage calibration of the cameras of a site from scene geometry, one still image each.
//!
//! The method is that of A. Abramov, "Two-Stage Camera Calibration Method for Multi-Camera Systems
//! Using Scene Geometry":
//!
//! 1. [`Lens`]: distortion, before all else.
//! 2. Stage 1, one camera: lines the operator draws ([`Annotation`]) give roll, pitch and focal;
//!    the polygon of the effective field of view is projected on the floor ([`efov_on_floor`]),
//!    right in shape, with the camera 3 m above (0, 0).
//! 3. Stage 2, the site: moving, turning and scaling that polygon ([`Placement`]), or control
//!    points, give x0, y0, yaw and z0; points, posts, lines and virtual elements that cameras see in
//!    common, and known distances, refine all cameras together ([`BundleAdjustment::solve`]).
//! 4. The result: a [`Camera`] maps pixels to the floor and points of space to pixels.
//!
//! The folders of the source, in the order of the method; each states its law in its `mod.rs`:
//!
//! - `camera`: points by space, distortion models, the pinhole, reprojection with Jacobians, covariances;
//! - `optimize`: Levenberg-Marquardt, Nelder-Mead, normal equations, Schur complement, sparse Cholesky;
//! - `floor`: what one calibrated camera shows of the floor: projection, EFOV, resection, undistorted images;
//! - `outcome`: how a solve ended, as values: findings, failures, residuals, suggestions;
//! - `single`: stage 1, one camera from annotations: the lens by the plumb-line method, then the
//!   maximum-likelihood fit or the paper's criterion, outliers, covariance;
//! - `bundle`: stage 2, several cameras: landmarks, view graph, triangulation, bundle adjustment;
//!
//! Where to look: the residual of a vertical line, like that of every drawn constraint, is derived in
//! `single/residual.rs` and evaluated in `single/likelihood.rs`; reprojection errors are in
//! `bundle/landmark.rs`. The predicted error of floor lengths is computed in `single/accuracy.rs`, the
//! covariance of a floor point in `camera/floor_covariance.rs` ([`Camera::floor_covariance`]).
//!
//! # Conventions
//!
//! - Base system: right-handed, metres, z up, floor at z = 0; the camera is at (x0, y0, z0).
//! - With yaw = pitch = roll = 0 the optical axis looks along +y, image right is +x, image down is -z.
//! - yaw turns about world z, counter-clockwise seen from above; pitch is positive looking down; roll
//!   is about the optical axis, positive when the camera is turned clockwise seen from behind; applied
//!   in the order yaw, pitch, roll. Radians in code, degrees in files and on screen (`_deg`).
//! - Pixels: x right, y down, the image spans `[0, width] x [0, height]`, so the centre of the first
//!   pixel is (0.5, 0.5). OpenCV's pixel is ours minus 0.5.
//! - Square pixels, one focal in pixels; the principal point defaults to the image centre.
//! - Distortion in OpenCV's terms, on focal-normalised coordinates.
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

// A folder uses only those above it, and in a folder a file only those above it; a test checks both.
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
