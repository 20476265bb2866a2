//! One calibrated camera and the floor: projection in both directions, and quantities computed from it.
//!
//! Rule: roll, pitch, focal length and lens are fixed. This module never estimates them from annotations. The
//! files, in the order of the data:
//!
//! - `placement`: stage 2 by hand, as a translation, rotation and scale of the EFOV.
//! - `resection`: position and yaw from control points.
//! - `scene`: grids, prisms, verticals and virtual elements as 3-D polylines.
//! - `image_curve`: **the image of a 3-D line**, with lens distortion; floor lines and their nearest pixels.
//! - `efov`: the effective field of view on the floor.
//! - `floor_covariances`: **covariances of many floor points**, from the camera and from the pixel.
//! - `extent`: image and EFOV of a camera, and the status of a mapped pixel.
//! - `projector`: many pixels to the floor and back.
//! - `surface`: many pixels to the floor and to other planes.
//! - `point_projector`: many world points to pixels.
//! - `stream`: the pixels of a video stream in the calibrated image.
//! - `detection_box`: the foot points of detection boxes.
//! - `camera_view`: pixels and boxes of a stream, as the bindings for other languages use them.
//! - `remap`: undistorted images, also of a stream.
//! - `pixel_density`: **pixels per metre of a vertical target**, and the levels of IEC 62676-4.
//! - `density_border`: the borders of the density levels in an image, with standard deviations.
//! - `coverage`: visible floor, blind spots and walls of a group of cameras.
//! - `ruler`: **lengths, areas and heights with their standard deviations**.
//! - `hand_over`: floor that two cameras see, with the expected disagreement of the positions that they compute.
//! - `tangent_plane`: geographic coordinates of the site.
//! - `georeference`: georeference from points with both world and geographic coordinates.
//! - `window`: **perspective and cylindrical views in any direction within a lens**.

mod placement;
mod resection;
mod scene;
mod image_curve;
mod efov;
mod floor_covariances;
mod extent;
mod projector;
mod surface;
mod point_projector;
mod stream;
mod detection_box;
mod camera_view;
mod remap;
mod pixel_density;
mod density_border;
mod coverage;
mod ruler;
mod hand_over;
mod tangent_plane;
mod georeference;
mod window;

pub use camera_view::CameraView;
pub use coverage::{AreaCoverage, Coverage, CoverageCamera, FloorGrid, Reach, Requirement, Wall};
pub use density_border::DensityBorder;
pub use detection_box::BoxForm;
pub use efov::{Efov, default_efov, efov_on_floor, efov_on_plane};
pub use extent::{Extent, Status};
pub use georeference::{GeographicPair, GeoreferenceFit, georeference_covariance};
pub use hand_over::{Disagreement, HandOver, UnknownDisagreement};
pub use image_curve::{FloorLine, annotated_line_curve, horizon, in_front, line_extension, on_image};
pub use pixel_density::{DensityLevel, LevelLimits};
pub use placement::{Placement, STAGE_1_HEIGHT};
pub use point_projector::PointProjector;
pub use projector::FloorProjector;
pub use remap::{Crop, Remap, StraightView, StraightViewError, Undistortion};
pub use resection::{ControlPoint, ControlPointNoise, from_control_points, with_placement_covariance};
pub use ruler::{CameraCovariance, Measured, Ruler, RulerPoint};
pub use scene::{
    COURTS, Court, MarkKind, MarkShape, PRISM_HEIGHT, Polyline, ellipse, floor_grid, position_ellipse, prism,
    vertical,
};
pub use stream::{PixelOrigin, Stream, StreamError, StreamFit, StreamMap};
pub use surface::{Surface, SurfacePoint, SurfaceProjector, SurfaceSigmas};
pub use tangent_plane::{Geographic, TangentPlane};
pub use window::{Mount, ViewDirection, Window, lens_reach, view_angle};
