//! What one camera shows of the floor, and the floor of what it shows.
//!
//! Law: forward only. A camera is given here, never estimated from drawings.

mod placement;
mod resection;
mod efov;
mod scene;
mod status;
mod extent;
mod projector;
mod remap;

pub use efov::{Efov, default_efov, efov_on_floor};
pub use extent::Extent;
pub use placement::{Placement, STAGE_1_HEIGHT};
pub use projector::FloorProjector;
pub use remap::{Crop, Remap, Undistortion};
pub use resection::{ControlPoint, from_control_points, with_placement_covariance};
pub use scene::{
    MarkKind, MarkShape, PRISM_HEIGHT, Polyline, ellipse, floor_grid, horizon, in_front, on_image,
    position_ellipse, prism, vertical,
};
pub use status::Status;
