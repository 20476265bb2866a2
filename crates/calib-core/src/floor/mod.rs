//! One calibrated camera and the floor: projection in both directions, and everything that is computed from
//! it.
//!
//! Rule: roll, pitch, focal length and lens are inputs here. They are never estimated from annotations.
//!
//! The files, in the order of the data:
//!
//! - `placement`: stage 2 by hand, which moves, rotates and scales the EFOV; `resection`: position and yaw
//!   from control points.
//! - `efov`: the effective field of view on the floor.
//! - `scene`: the floor grid, prisms and virtual elements as polylines in space.
//! - `image_curve`: **the image curves of straight lines**, of the horizon, and of a line on the floor.
//! - `extent`: the area that a camera covers, and the status of a mapped point.
//! - `floor_covariances`: **covariances of many floor points**, from the errors of the camera and of the
//!   pixel.
//! - `projector`: slices of pixels to a plane and back; `point_projector`: slices of points in space to
//!   pixels.
//! - `surface`: the planes of a site in addition to the floor, and the first one that the ray of a pixel
//!   meets.
//! - `stream`, `detection_box`, `camera_view`: the same for the pixels and the detection boxes of a stream.
//!   The bindings for other languages use these.
//! - `remap`: undistorted images; `window`: **flat and cylindrical windows that look anywhere within a
//!   lens**.

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
