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
//!    common, and known distances, refine all cameras together ([`Site::calibrate`]).
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
//! - `health`: whether calibrations still hold, by the people that cameras see and by edges that moved;
//! - `site`: the site document, its checks, and the pipeline from document to results.
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

//! # In a tracker
//!
//! Load a site, map detections to the floor with what became of each and how uncertain it is, and show
//! a box of space in an image:
//!
//! ```
//! # #[cfg(feature = "serde")]
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use calib_core::{
//!     Extent, FloorCovariance, FloorProjector, MarkKind, Pixel, MarkShape, Site, Status, WorldPoint, on_image,
//! };
//!
//! let site = Site::from_json(
//!     r#"{"format": "calib-site", "version": 1, "cameras": [{
//!         "id": "door", "size_px": [1920, 1080],
//!         "solution": {"method": "given", "stage": "placed", "position_m": [1.2, -0.4, 4.5], "yaw_deg": 12,
//!             "pitch_deg": 31, "roll_deg": -1.5, "focal_px": 1486.2, "principal_point_px": [960, 540],
//!             "sigma": {"z_m": 0.03, "yaw_deg": 0.2, "pitch_deg": 0.3, "roll_deg": 0.1, "focal_px": 15}}}]}"#,
//! )?;
//! let entry = site.camera("door").ok_or("no such camera")?;
//! let camera = entry.camera().ok_or("not calibrated")?;
//!
//! // Pixels to the floor: slices, without allocating.
//! let projector = FloorProjector::new(&camera, 0.0);
//! let efov = entry.floor_polygon();
//! let extent = Extent { size: entry.size(), efov: &efov };
//! let (u, v) = ([960.0, 960.0], [800.0, -900.0]);
//! let (mut x, mut y, mut status) = ([0.0; 2], [0.0; 2], [Status::Ok; 2]);
//! projector.pixels_to_floor_within(&extent, [&u, &v], [&mut x, &mut y], &mut status);
//! assert_eq!(status, [Status::Ok, Status::AboveHorizon]);
//! assert!(x[1].is_nan());
//!
//! // With covariance: the pixel's part is independent from detection to detection, the calibration's is not.
//! let covariance: FloorCovariance =
//!     camera.floor_covariance(Pixel::new(u[0], v[0]), 2.0).ok_or("above the horizon")?;
//! assert!(covariance.worst_sigma().is_some_and(|sigma| sigma > 0.005), "the sigmas of the file");
//!
//! // A box of space to its lines in the image.
//! let at = WorldPoint::new(x[0], y[0], 0.0);
//! let pallet = MarkShape { kind: MarkKind::Box, at, turn: 0.3, size: vec![1.2, 0.8, 0.9] };
//! let lines: Vec<Vec<Pixel>> = pallet.polylines().iter().flat_map(|line| on_image(&camera, line)).collect();
//! assert!(!lines.is_empty());
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "serde"))]
//! # fn main() {}
//! ```
//!
//! # Features
//!
//! `serde` (on by default): the site document. `schema`: its JSON Schema. `mint`, `nalgebra`, `cam-geom`:
//! conversions to and from those libraries.

#![cfg_attr(
    not(feature = "serde"),
    expect(dead_code, unused_imports, reason = "some steps only the site asks for")
)]

// A folder uses only those above it, and in a folder a file only those above it; a test checks both.
mod camera;
mod optimize;
mod floor;
mod outcome;
mod single;
mod bundle;
mod health;
#[cfg(feature = "serde")]
mod site;

pub use bundle::{
    BundleAdjustment, BundleCamera, BundleError, BundleSummary, CameraEstimate, Component, CrossCovariance,
    DistanceMeasurement, HeldPose, InitialPose, Landmark, LandmarkModel, Observation, OutlierCandidate,
    PlaneEstimate,
};
pub use camera::{
    BrownConrady, Camera, Chart, Coefficient, Covariance, Distortion, DistortionModel, FloorCovariance,
    FloorPoint, ImageCircle, Lens, MODELS, ModelRow, Pixel, PlanPixel, PlanScale, Plane, Ray, StraightDown,
    UndistortedPixel, WorldPoint, angles_from_rotation, camera_from_world,
};
pub use floor::{
    BoxForm, CameraView, ControlPoint, Crop, Efov, Extent, FloorLine, FloorProjector, Look, MarkKind,
    MarkShape, Mount, NoStraightView, PRISM_HEIGHT, PixelOrigin, Placement, PointProjector, Polyline, Remap,
    STAGE_1_HEIGHT, Status, StraightView, Stream, StreamError, StreamFit, StreamMap, Surface, SurfacePoint,
    SurfaceProjector, SurfaceSigmas, Undistortion, Window, default_efov, drawn_line, efov_on_floor,
    efov_on_plane, ellipse, floor_grid, from_control_points, horizon, in_front, lens_reach, line_beyond,
    on_image, position_ellipse, prism, vertical, view_angle, with_placement_covariance,
};
pub use health::{
    CameraHealth, Change, Disagreement, EdgeOffset, Estimated, HeightThen, Memory, Movement, STEP, Sighting,
    TONE, Turn, TurnFit, Turned, Verdict, Walk, WalkMoment, WalkResult, Watch, Zone, Zones, floor_nearness,
    ray_in_camera,
};
pub use outcome::{
    Code, Drawing, Estimator, Failure, FailureCode, Finding, OtherMinimum, Parameter, Residual, ResidualOf,
    Severity, SharedEvidence, Source, Subject, Suggestion, WhyNotConnected, WhyUnused,
};
pub use single::{
    Annotation, ConstraintKind, Constraints, Deviation, Direction, DrawnPlane, Edge, Endpoint, Fit,
    FitOptions, Fitted, FixedParameters, InvalidSegment, KINDS, Kind, KindRow, Known, Length, LensFit,
    LensOptions, Line, LocalMinimum, Orientation, PlanePrior, Prior, Priors, RULED_OUT, Repeats, SceneErrors,
    Shape, Sketch, USUAL_SIZES, Upright, UsualSize, closed_form, draw_next, findings, line_name,
    paper_minimum, straightness, straightness_rms,
};
#[cfg(feature = "serde")]
pub use site::{
    About, Alternative, Carrier, ControlPointEntry, CovarianceEntry, CrossCovarianceEntry, Distance,
    DistortionEntry, DrawNext, ElementSolution, ExactScene, FailureEntry, Fault, FindingEntry, Format,
    Georeference, HeldEntry, LensCache, LensEntry, Link, LinkKind, LinkSeen, MAX_BYTES, MAX_CAMERAS,
    MAX_ITEMS, MAX_SIDE, MAX_VALUES, Mark, MarkSeen, Method, NamedAnnotation, Names, NewStill, NoCamera,
    NoView, Options, Overlap, PlacementEntry, Plan, PlaneEntry, PlaneNumber, PlaneSolution, Recovered,
    Report, Scale, SceneEntry, SceneSigmas, SeenResidual, Sigmas, Site, SiteCamera, SiteError, SiteSolution,
    Solution, Stage, TiltEntry, Warning, counted,
};
