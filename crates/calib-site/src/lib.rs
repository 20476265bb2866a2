//! Site document of the camera calibration: its types, its checks, and the pipeline that solves it.
//!
//! Rule: this crate handles names, degrees and the format of the site file. Camera models and estimators are in
//! `calib_core`.
//!
//! Document:
//!
//! - `document`, `scene`, `solution`, `site_solution`, `survey_entries`: entries of the site file and their
//!   results;
//! - `coordinate_system`, `geographic`, `map_plan`: projected grids, geographic coordinates of the site, and
//!   georeferenced plans;
//! - `data_sheet`, `nominal_focal`, `principal_point`, `pixel_aspect`, `lens_window`: entered values of a lens;
//! - `units`: display and input of lengths;
//! - `conversions`, `covariance_entry`: conversions between entries and geometric types;
//! - `bounds`, `check`, `check_entries`, `check_geographic`, `period`, `site_error`: reading and checking a site
//!   file;
//! - `view`, `frame`: lookup of calibrated cameras and of stored findings, and their coordinate systems.
//!
//! Pipeline, in the order of the data:
//!
//! - `options`: options of a calibration;
//! - `pipeline`: runs all steps and returns the report;
//! - `lens_step`: the lens of each camera, with `shared_lenses` (cameras with a common lens), `lens_cache`
//!   and `lens_family` (recalibration of one lens family while the operator annotates);
//! - `single_step`: stage 1, each camera separately, with `points_step` (stage 1 from control points);
//! - `aspect_step`, `data_sheet_step`: estimates of an unknown pixel aspect, and the comparison of the data sheet with
//!   the lines;
//! - `observations`, `bundle_step`: stage 2, all cameras jointly, from their shared observations;
//! - `placement_step`: placement of cameras by control points or by hand;
//! - `georeference_step`: georeference from the solved cameras;
//! - `overlap`, `quality`, `reliability`, `points_outside`: agreement between cameras, and findings;
//! - `camera_result`, `english`: conversion of findings to sentences.
//!
//! After solving:
//!
//! - `out_of_date`: detection of solutions that no longer match the annotations;
//! - `recovered`: new validity period for a camera that was rotated or zoomed;
//! - `coverage`, `measurement`: visible floor and pixel densities, and measurements in the images.
//!
//! # In a tracker
//!
//! Load a site, map detections to the floor with their status and uncertainty, and project a box into an
//! image:
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use calib_core::{
//!     Extent, FloorCovariance, FloorProjector, MarkKind, MarkShape, Pixel, Status, WorldPoint, on_image,
//! };
//! use calib_site::Site;
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
//! // Map pixels to the floor, in slices without allocation.
//! let projector = FloorProjector::new(&camera, 0.0);
//! let efov = entry.floor_polygon();
//! let extent = Extent { size: entry.size(), efov: &efov };
//! let (u, v) = ([960.0, 960.0], [800.0, -900.0]);
//! let (mut x, mut y, mut status) = ([0.0; 2], [0.0; 2], [Status::Ok; 2]);
//! projector.pixels_to_floor_within(&extent, [&u, &v], [&mut x, &mut y], &mut status);
//! assert_eq!(status, [Status::Ok, Status::AboveHorizon]);
//! assert!(x[1].is_nan());
//!
//! // Covariance: the pixel part is independent between detections, the calibration part is not.
//! let covariance: FloorCovariance =
//!     camera.floor_covariance(Pixel::new(u[0], v[0]), 2.0).ok_or("above the horizon")?;
//! assert!(covariance.worst_sigma().is_some_and(|sigma| sigma > 0.005), "the standard deviations of the file are used");
//!
//! // Project the edges of a box into the image.
//! let at = WorldPoint::new(x[0], y[0], 0.0);
//! let pallet = MarkShape { kind: MarkKind::Box, at, turn: 0.3, size: vec![1.2, 0.8, 0.9] };
//! let lines: Vec<Vec<Pixel>> = pallet.polylines().iter().flat_map(|line| on_image(&camera, line)).collect();
//! assert!(!lines.is_empty());
//! # Ok(())
//! # }
//! ```
//!
//! # Features
//!
//! - `schema`: adds the JSON Schema of the site document.
//! - `epsg`: adds the definitions of all EPSG codes. Without it, only UTM and common national grids are known.

mod site_error;
mod bounds;
mod pixel_aspect;
mod units;
mod solution;
mod site_solution;
mod scene;
mod data_sheet;
mod principal_point;
mod survey_entries;
mod document;
mod lens_window;
mod nominal_focal;
mod coordinate_system;
mod geographic;
mod map_plan;
mod conversions;
mod options;
mod english;
mod camera_result;
mod points_outside;
mod lens_cache;
mod shared_lenses;
mod lens_step;
mod points_step;
mod single_step;
mod observations;
mod bundle_step;
mod aspect_step;
mod data_sheet_step;
mod covariance_entry;
mod check_geographic;
mod check_entries;
mod period;
mod view;
mod frame;
mod georeference_step;
mod check;
mod placement_step;
mod overlap;
mod quality;
mod reliability;
mod pipeline;
mod out_of_date;
mod lens_family;
mod recovered;
mod coverage;
mod measurement;

pub use bounds::{MAX_CAMERAS, MAX_ITEMS};
pub use check::{MAX_BYTES, MAX_SIDE, MAX_VALUES};
pub use coordinate_system::{CoordinateSystem, CoordinateSystemError};
pub use coverage::{AreaResult, CoverageError, CoverageOptions, FloorRectangle, SiteCoverage};
pub use data_sheet::{DataSheet, DataSheetError, Nominal};
pub use document::{
    ControlPointEntry, Distance, FixedEntry, Format, Georeference, GroundPoint, LensEntry, Link, LinkKind,
    LinkObservation, Mark, MarkObservation, PlacementEntry, Plan, Site, SiteCamera,
};
pub use english::{Names, counted};
pub use geographic::typed_degrees;
pub use lens_cache::LensCache;
pub use lens_window::WindowMap;
pub use map_plan::{MapPlanError, MapPosition};
pub use measurement::{MeasurementError, speed_limits};
pub use options::Options;
pub use period::CameraLookupError;
pub use pipeline::Report;
pub use pixel_aspect::{PixelAspectEntry, usual_pixel_aspect};
pub use principal_point::PrincipalPointEntry;
pub use recovered::{ImageTransfer, NewImage, Recovered};
pub use scene::{ExactScene, PlaneEntry, PlaneNumber, PlaneSolution, SceneEntry, SceneSigmas, TiltEntry};
pub use site_error::{ErrorSubject, NamedAnnotation, SiteError, SiteErrorKind};
pub use site_solution::{
    CrossCovarianceEntry, ElementSolution, GeoreferenceSigmas, GeoreferenceSolution, ObservationResidual,
    Overlap, Scale, SiteSolution,
};
pub use solution::{
    Alternative, CovarianceEntry, DistortionEntry, FailureEntry, Method, Sigmas, Solution, Stage,
    SuggestionEntry, Warning,
};
pub use survey_entries::{Area, LevelLimitsEntry, Measurement, MeasurementKind, MeasurementPoint, WallEntry};
pub use units::{Units, number};
pub use view::{CameraViewError, FindingEntry};
