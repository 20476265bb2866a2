//! C and C++ bindings: calibrated cameras, from pixels to the floor and back, and the calibration itself.
//!
//! All computation is in `calib-core` and `calib-site`. This crate contains opaque handles, plain arrays, and
//! checks of all arguments. A null, misaligned or overlapping pointer returns an error code, and so does a
//! panic.
//!
//! - `raw`: pointers, error codes and constants.
//! - `site`, `camera`: handles.
//! - `about`: properties of a camera, and the plan.
//! - `mapping`: pixels and points.
//!
//! `include/calib.h` is generated from these sources.

mod raw;
mod site;
mod camera;
mod about;
mod mapping;

pub use about::{
    CALIB_COEFFICIENTS, CALIB_UNKNOWNS, calib_camera_angles, calib_camera_covariance,
    calib_camera_distortion, calib_camera_focal, calib_camera_id, calib_camera_matrix, calib_camera_position,
    calib_camera_scale_known, calib_camera_size, calib_site_floor_to_plan, calib_site_plan_metres_per_px,
    calib_site_plan_to_floor,
};
pub use camera::{CalibCamera, CalibStream, calib_camera_free, calib_site_camera};
pub use mapping::{
    calib_camera_boxes_covariance, calib_camera_boxes_to_floor, calib_camera_floor_covariance,
    calib_camera_floor_jacobian, calib_camera_rays, calib_camera_to_floor, calib_camera_to_pixel,
    calib_camera_undistort,
};
pub use raw::{
    CALIB_BOX_CENTRE_SIZE, CALIB_BOX_CORNER_SIZE, CALIB_BOX_CORNERS, CALIB_BOX_FRACTIONS,
    CALIB_FIT_LETTERBOX, CALIB_FIT_STRETCH, CALIB_FIT_UNSAID, CALIB_ORIGIN_CENTRE, CALIB_ORIGIN_CORNER,
    CALIB_STATUS_ABOVE_HORIZON, CALIB_STATUS_BEHIND_CAMERA, CALIB_STATUS_MISSING,
    CALIB_STATUS_NO_CALIBRATION, CALIB_STATUS_OK, CALIB_STATUS_ON_WALL, CALIB_STATUS_OUTSIDE_EFOV,
    CALIB_STATUS_OUTSIDE_IMAGE, CALIB_STATUS_OUTSIDE_LENS, CalibResult, calib_result_text, calib_status_name,
    calib_version,
};
pub use site::{
    CalibSite, calib_site_calibrate, calib_site_camera_count, calib_site_camera_id, calib_site_free,
    calib_site_json, calib_site_parse,
};
