//! A calibrated site in JavaScript, for dashboards that show tracks on a plan: pixels to the floor and
//! back, and the solve. Everything happens in the page; nothing is sent anywhere.
//!
//! Units and axes are those of the site file: pixels from the corner of the image, metres with z up.

mod object;
mod point;
mod undistorter;
mod camera;
mod mapping;
mod site;

pub use camera::Camera;
pub use mapping::status_names;
pub use site::Site;
pub use undistorter::Undistorter;

use wasm_bindgen::prelude::*;

use crate::object::CalibrateOptions;

/// Calibrates a site file, and returns it with the solutions written into it.
///
/// A camera that cannot be solved has an `error` in place of a `solution`.
///
/// # Errors
/// Throws an `Error` that says what is wrong with the file or with an option, and where.
#[wasm_bindgen]
pub fn solve(
    #[wasm_bindgen(js_name = siteJson)] site_json: &str,
    options: Option<CalibrateOptions>,
) -> Result<String, JsError> {
    Ok(Site::new(site_json)?.calibrate(options)?.to_json())
}
