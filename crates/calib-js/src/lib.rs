//! JavaScript bindings for dashboards that show tracks on a plan: from pixels to the floor and back, and the
//! calibration itself. All computation is in the page, without network access.
//!
//! Units and axes are the same as in the site file: metres with z up, and pixels from the corner of the
//! image.
//!
//! - `object`, `point`: conversion of options, arrays and results.
//! - `undistorter`: undistortion of images.
//! - `camera`, `mapping`: the class `Camera`.
//! - `site`: the class `Site`.

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

/// Calibrates a site file, and returns it with its solutions.
///
/// A camera that cannot be solved has an `error` instead of a `solution`.
///
/// # Errors
/// Throws for an invalid file or option; the message names the position and the cause.
#[wasm_bindgen]
pub fn solve(
    #[wasm_bindgen(js_name = siteJson)] site_json: &str,
    options: Option<CalibrateOptions>,
) -> Result<String, JsError> {
    Ok(Site::new(site_json)?.calibrate(options)?.to_json())
}
