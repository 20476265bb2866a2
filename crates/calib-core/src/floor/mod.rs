//! One calibrated camera and the floor: projection in both directions, and what follows from it.
//!
//! Law: roll, pitch, focal and lens are given here, never estimated from drawings.
//!
//! - `placement` stage 2 by hand: move, turn, scale; `resection` position and yaw from control points;
//! - `efov` the effective field of view on the floor; `scene` grids, prisms and virtual elements as polylines; `image_curve` **their way across an image**;
//! - `floor_line` a line of the floor and where an image shows it;
//! - `lanes` values in step; `flow_covariance`, `covariance_lanes` **how sure many points of the floor are**, by camera and by
//!   pixel; `status`, `extent`, `projector` many pixels to the floor and back, with what became of each; `point_projector` many
//!   points of space to pixels;
//! - `surfaces`, `surface_projector` the same of a site with planes besides the floor;
//! - `stream`, `detection_box`, `camera_view` the same for the pixels and boxes of a stream, as other languages ask for it;
//! - `remap` undistorted images; `straight_view` those of a stream; `window` **flat and round windows that look anywhere
//!   within a lens**.

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
mod window;

pub use camera_view::CameraView;
pub use detection_box::BoxForm;
pub use efov::{Efov, default_efov, efov_on_floor, efov_on_plane};
pub use extent::{Extent, Status};
pub use image_curve::{FloorLine, drawn_line, horizon, in_front, line_beyond, on_image};
pub use placement::{Placement, STAGE_1_HEIGHT};
pub use point_projector::PointProjector;
pub use projector::FloorProjector;
pub use remap::{Crop, NoStraightView, Remap, StraightView, Undistortion};
pub use resection::{ControlPoint, from_control_points, with_placement_covariance};
pub use scene::{
    MarkKind, MarkShape, PRISM_HEIGHT, Polyline, ellipse, floor_grid, position_ellipse, prism, vertical,
};
pub use stream::{PixelOrigin, Stream, StreamError, StreamFit, StreamMap};
pub use surface::{Surface, SurfacePoint, SurfaceProjector, SurfaceSigmas};
pub use window::{Look, Mount, Window, lens_reach, view_angle};
