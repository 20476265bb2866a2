//! Methods of a camera that map whole columns, as typed arrays.

use calib_core::{Covariance, Status};

use calib_core::floor::BoxForm;
use js_sys::{Float64Array, Uint8Array};
use wasm_bindgen::prelude::*;

use crate::camera::Camera;
use crate::object::{doubles, object};

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Points of a plane, in metres; NaN without a point. Statuses are indices into `statusNames`. */
export interface FloorColumns { x: Float64Array; y: Float64Array; status: Uint8Array; }
/** Pixels; NaN without a pixel. Statuses are indices into `statusNames`. */
export interface PixelColumns { u: Float64Array; v: Float64Array; status: Uint8Array; }
/** Undistorted pixels; NaN outside the lens. */
export interface StraightColumns { u: Float64Array; v: Float64Array; }
/**
 * Covariances xx, xy, yx, yy of each point, one after the other, in square metres. The part of the pixel is independent
 * for each detection. The part of the calibration is common to all detections of a camera, so a filter must not average
 * it away.
 */
export interface CovarianceColumns { pixel: Float64Array; calibration: Float64Array; }
"#;

#[wasm_bindgen]
extern "C" {
    /// Points of a plane.
    #[wasm_bindgen(typescript_type = "FloorColumns")]
    #[derive(Debug)]
    pub type FloorColumns;
    /// Pixels.
    #[wasm_bindgen(typescript_type = "PixelColumns")]
    #[derive(Debug)]
    pub type PixelColumns;
    /// Undistorted pixels.
    #[wasm_bindgen(typescript_type = "StraightColumns")]
    #[derive(Debug)]
    pub type StraightColumns;
    /// Covariances.
    #[wasm_bindgen(typescript_type = "CovarianceColumns")]
    #[derive(Debug)]
    pub type CovarianceColumns;
}

fn common_length(columns: &[&[f64]]) -> Result<usize, JsError> {
    let count = columns[0].len();
    if columns.iter().any(|column| column.len() != count) {
        return Err(JsError::new("columns must have the same length"));
    }
    Ok(count)
}

pub(crate) fn finite(name: &str, value: f64) -> Result<f64, JsError> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(JsError::new(&format!("{name}: expected a finite number")))
    }
}

/// Returns an object with two columns and their statuses.
fn columns<T: JsCast>(names: [&str; 2], values: [&[f64]; 2], status: &[u8]) -> T {
    let status = Uint8Array::from(status).into();
    object(&[(names[0], doubles(values[0])), (names[1], doubles(values[1])), ("status", status)])
}

/// Returns the form and the boxes, four numbers each.
fn boxes_of<'a>(form: &str, boxes: &'a [f64]) -> Result<(BoxForm, &'a [[f64; 4]]), JsError> {
    let form = BoxForm::from_name(form)
        .ok_or_else(|| JsError::new("form: expected \"xywh\", \"xyxy\", \"cxcywh\" or \"yolo\""))?;
    match boxes.as_chunks() {
        (boxes, []) => Ok((form, boxes)),
        _ => Err(JsError::new("boxes: expected four numbers for each box")),
    }
}

/// Returns an object with both parts of covariances.
fn covariance_columns(parts: [Vec<[f64; 4]>; 2]) -> CovarianceColumns {
    let [pixel, calibration] = parts.map(|part| doubles(part.as_flattened()));
    object(&[("pixel", pixel), ("calibration", calibration)])
}

#[wasm_bindgen]
impl Camera {
    /// Maps pixels to points of the plane `height` metres above the floor (default 0).
    ///
    /// # Errors
    /// Throws if the columns have different lengths.
    #[wasm_bindgen(js_name = toFloor)]
    pub fn to_floor(&self, u: &[f64], v: &[f64], height: Option<f64>) -> Result<FloorColumns, JsError> {
        let count = common_length(&[u, v])?;
        let (mut x, mut y, mut status) = (vec![0.0; count], vec![0.0; count], vec![0; count]);
        let height = finite("height", height.unwrap_or(0.0))?;
        self.view.to_floor(height, [u, v], [&mut x, &mut y], &mut status);
        Ok(columns(["x", "y"], [&x, &y], &status))
    }

    /// Maps boxes, four numbers each, to floor points. The foot point of a box is the middle of its lower
    /// edge.
    ///
    /// `form` is "xywh", "xyxy" or "cxcywh", in pixels of the stream, or "yolo": centre, width and height as
    /// fractions of the width and height of the stream.
    ///
    /// # Errors
    /// Throws if the array does not contain four numbers for each box, and for an unknown form.
    #[wasm_bindgen(js_name = boxesToFloor)]
    pub fn boxes_to_floor(
        &self,
        boxes: &[f64],
        form: &str,
        height: Option<f64>,
    ) -> Result<FloorColumns, JsError> {
        let (form, boxes) = boxes_of(form, boxes)?;
        let count = boxes.len();
        let (mut x, mut y, mut status) = (vec![0.0; count], vec![0.0; count], vec![0; count]);
        let height = finite("height", height.unwrap_or(0.0))?;
        self.view.boxes_to_floor(height, (form, boxes), [&mut x, &mut y], &mut status);
        Ok(columns(["x", "y"], [&x, &y], &status))
    }

    /// Computes the covariance of the floor points of pixels, for a standard deviation of `sigmaPx` pixels of
    /// the stream (default 1). Both parts are NaN without a floor point. The calibration's part is also NaN
    /// if it is unknown, for example if `scaleKnown` is false.
    ///
    /// # Errors
    /// Throws if the columns have different lengths.
    #[wasm_bindgen(js_name = floorCovariance)]
    pub fn floor_covariance(
        &self,
        u: &[f64],
        v: &[f64],
        #[wasm_bindgen(js_name = sigmaPx)] sigma_px: Option<f64>,
        height: Option<f64>,
    ) -> Result<CovarianceColumns, JsError> {
        let count = common_length(&[u, v])?;
        let sigma = finite("sigmaPx", sigma_px.unwrap_or(1.0))?;
        let (mut pixel, mut calibration) = (vec![[0.0; 4]; count], vec![[0.0; 4]; count]);
        let height = finite("height", height.unwrap_or(0.0))?;
        self.view.covariances(height, [u, v], sigma, [&mut pixel, &mut calibration]);
        Ok(covariance_columns([pixel, calibration]))
    }

    /// Computes the covariance of the foot points of boxes, for a standard deviation of `sigmaPx` pixels
    /// (default 1) of each coordinate of the foot point.
    ///
    /// # Errors
    /// Throws as `boxesToFloor` does.
    #[wasm_bindgen(js_name = boxesCovariance)]
    pub fn boxes_covariance(
        &self,
        boxes: &[f64],
        form: &str,
        #[wasm_bindgen(js_name = sigmaPx)] sigma_px: Option<f64>,
        height: Option<f64>,
    ) -> Result<CovarianceColumns, JsError> {
        let (form, boxes) = boxes_of(form, boxes)?;
        let sigma = finite("sigmaPx", sigma_px.unwrap_or(1.0))?;
        let height = finite("height", height.unwrap_or(0.0))?;
        let (mut pixel, mut calibration) = (vec![[0.0; 4]; boxes.len()], vec![[0.0; 4]; boxes.len()]);
        self.view.boxes_covariances(height, (form, boxes), sigma, [&mut pixel, &mut calibration]);
        Ok(covariance_columns([pixel, calibration]))
    }

    /// Computes the Jacobian of floor points with respect to the parameters of the camera.
    ///
    /// A Schmidt-Kalman filter uses it to include the errors of the calibration, whose covariance is
    /// `covariance`. Each point has fifteen values of x, then fifteen of y, in metres per unit of the parameter; NaN
    /// without a floor point.
    ///
    /// # Errors
    /// Throws if the columns have different lengths.
    #[wasm_bindgen(js_name = floorJacobian)]
    pub fn floor_jacobian(&self, u: &[f64], v: &[f64]) -> Result<Float64Array, JsError> {
        let mut found = vec![[[0.0; Covariance::SIZE]; 2]; common_length(&[u, v])?];
        self.view.floor_jacobians([u, v], &mut found);
        Ok(Float64Array::from(found.as_flattened().as_flattened()))
    }

    /// Projects world points, in metres, to pixels. Without `z` they are on the floor.
    ///
    /// # Errors
    /// Throws if the columns have different lengths.
    #[wasm_bindgen(js_name = toPixel)]
    pub fn to_pixel(&self, x: &[f64], y: &[f64], z: Option<Vec<f64>>) -> Result<PixelColumns, JsError> {
        let z = z.unwrap_or_else(|| vec![0.0; x.len()]);
        let count = common_length(&[x, y, &z])?;
        let (mut u, mut v, mut status) = (vec![0.0; count], vec![0.0; count], vec![0; count]);
        self.view.to_pixels([x, y, &z], [&mut u, &mut v], &mut status);
        Ok(columns(["u", "v"], [&u, &v], &status))
    }

    /// Computes the viewing rays of pixels: unit vectors x, y, z one after the other; NaN outside the lens.
    ///
    /// # Errors
    /// Throws if the columns have different lengths.
    pub fn rays(&self, u: &[f64], v: &[f64]) -> Result<Float64Array, JsError> {
        let mut directions = vec![[0.0; 3]; common_length(&[u, v])?];
        self.view.rays([u, v], &mut directions);
        Ok(Float64Array::from(directions.as_flattened()))
    }

    /// Undistorts pixels: returns their position in a camera with the same focal length and no distortion.
    ///
    /// # Errors
    /// Throws if the columns have different lengths.
    pub fn undistort(&self, u: &[f64], v: &[f64]) -> Result<StraightColumns, JsError> {
        let count = common_length(&[u, v])?;
        let (mut to_u, mut to_v) = (vec![0.0; count], vec![0.0; count]);
        self.view.undistort([u, v], [&mut to_u, &mut to_v]);
        Ok(object(&[("u", doubles(&to_u)), ("v", doubles(&to_v))]))
    }
}

/// Returns the names of the statuses, in the order of their numbers.
#[wasm_bindgen(js_name = statusNames)]
#[must_use]
pub fn status_names() -> Vec<String> {
    Status::ALL.map(|status| status.name().to_owned()).into()
}
