//! The site document, its checks, and the pipeline that solves it.
//!
//! Law: the only folder that knows names, degrees and the words of files; it states no formula.
//!
//! - `document`, `elements`, `scene`, `planes`, `surfaces`, `solution`, `site_solution`, `conversions`, `efov` the document, and its
//!   entries as the types of the geometry;
//! - `english` findings and failures as sentences; `points_outside` whether a drawing is of its image, with what
//!   others share with it in `shared_drawings`, and its lens in `shared_lenses`; `camera_result` a result before it is
//!   put into words;
//! - `bounded_list`, `bounds`, `check`, `check_elements`, `check_planes`, `check_solution`, `period`, `site_error` reading and checking;
//! - `view` a calibrated camera by its id, and `finding_entry` all findings in one list, as other languages ask for them;
//! - `lens_step`, `single_step`, `placement_step`, `observations`, `bundle_step`, `overlap`, `quality`, in this order
//!   called by `pipeline`; `lens_cache`, `lens_family` what need not be solved again while an operator draws;
//! - `out_of_date` whether a solution is of what is drawn;
//! - `recovered` a camera that turned as a new entry, with what was drawn on its old still.
//!
//! # In a tracker
//!
//! Load a site, map detections to the floor with what became of each and how uncertain it is, and show
//! a box of space in an image:
//!
//! ```
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
//! ```
//!
//! # Features
//!
//! `schema`: the JSON Schema of the site document.

mod site_error;
mod bounds;
mod solution;
mod site_solution;
mod scene;
mod document;
mod conversions;
mod options;
mod english;
mod camera_result;
mod points_outside;
mod lens_cache;
mod shared_lenses;
mod lens_step;
mod single_step;
mod observations;
mod bundle_step;
mod covariance_entry;
mod check_entries;
mod period;
mod view;
mod check;
mod placement_step;
mod overlap;
mod quality;
mod pipeline;
mod out_of_date;
mod lens_family;
mod recovered;

pub use bounds::{MAX_CAMERAS, MAX_ITEMS};
pub use check::{MAX_BYTES, MAX_SIDE, MAX_VALUES};
pub use document::{
    ControlPointEntry, Distance, Format, Georeference, HeldEntry, LensEntry, Link, LinkKind, LinkSeen, Mark,
    MarkSeen, PlacementEntry, Plan, Site, SiteCamera,
};
pub use english::{Names, counted};
pub use lens_cache::LensCache;
pub use options::Options;
pub use period::NoCamera;
pub use pipeline::Report;
pub use recovered::{Carrier, NewStill, Recovered};
pub use scene::{ExactScene, PlaneEntry, PlaneNumber, PlaneSolution, SceneEntry, SceneSigmas, TiltEntry};
pub use site_error::{About, Fault, NamedAnnotation, SiteError};
pub use site_solution::{CrossCovarianceEntry, ElementSolution, Overlap, Scale, SeenResidual, SiteSolution};
pub use solution::{
    Alternative, CovarianceEntry, DistortionEntry, DrawNext, FailureEntry, Method, Sigmas, Solution, Stage,
    Warning,
};
pub use view::{FindingEntry, NoView};
