//! Image analysis for camera calibration: edges, automatic calibration, the image circle of fisheye lenses,
//! comparison of two images of a camera, and registration of the cameras of a site.
//!
//! Rule: no files, threads, clocks or windows; callers pass pixels. Pixel coordinates are raw (distorted),
//! with the origin at the top left corner of the image, as in `calib-core`. The modules, in data-flow order:
//!
//! - `xor_shift`: pseudo-random numbers;
//! - `line_segment`: straight edge with its standard deviation;
//! - `pull`: lines snapped to the edge along them;
//! - `edges`: detection of straight edges;
//! - `image_circle`: the circle that a fisheye lens fills;
//! - `bars`: black bars at the sides of an image;
//! - `empty_scene`: median of several images, without the objects that move;
//! - `shrunk`: smaller copies of images;
//! - `proposal`: automatic calibration from edges;
//! - `compare`: change of a camera between two images, and recovery after a rotation;
//! - `registration`: relative poses of the cameras of a site, from the colours of their images.
//!
//! ```
//! use calib_image::{AutomaticCalibration, Confidence, EdgeImage, line_segments};
//! use image::{Rgb, RgbImage};
//!
//! let wall = RgbImage::from_fn(320, 240, |x, _| Rgb([if x < 160 { 60 } else { 180 }; 3]));
//! let edges = EdgeImage::new(line_segments(&wall), [320, 240]);
//! let calibration = AutomaticCalibration::new(&edges);
//! assert_eq!(calibration.confidence, Confidence::None, "one edge does not determine a camera");
//! ```

// A module uses only the modules above it.
mod xor_shift;
mod line_segment;
mod pull;
pub mod edges;
mod image_circle;
mod bars;
mod empty_scene;
mod shrunk;
mod proposal;
mod compare;
mod registration;

pub use bars::{Bars, ImageEdges};
pub use compare::{
    CameraChange, Comparison, ComparisonError, EdgeOffset, FitParameters, RecoveryError, RotationFit,
    STEP_SIZE, ShownWindow, SizeMismatchError, TONE_SIZE, annotation_edges, recover,
};
pub use edges::{Edge, line_segments};
pub use empty_scene::EmptyScene;
pub use image_circle::image_circle;
pub use line_segment::{LineSegment, Rise, distance_to_segment};
pub use proposal::{
    Alternative, AutomaticCalibration, Confidence, EdgeClass, EdgeImage, Group, Reason, join_edges,
};
pub use pull::{SNAP_RADIUS_PX, snap_image_curve, snap_line, snap_polyline};
pub use registration::{
    CameraPlacement, PairAgreement, PairDecision, PairPlacement, PairRegistration, PlacementSearch,
    SiteColours, SitePlacement, SiteRegistration, View, join, register, register_pair,
};
pub use shrunk::shrunk;
