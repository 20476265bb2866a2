//! What a camera maps: whole columns at once, in typed arrays.

use calib_core::{Covariance, Status};

use calib_core::floor::BoxForm;
use js_sys::{Float64Array, Uint8Array};
use wasm_bindgen::prelude::*;

use crate::camera::Camera;
use crate::object::{doubles, object};

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Points of a plane, in metres, NaN where there is none; statuses are numbers of `statusNames`. */
export interface FloorColumns { x: Float64Array; y: Float64Array; status: Uint8Array; }
/** Pixels, NaN where there is none; statuses are numbers of `statusNames`. */
export interface PixelColumns { u: Float64Array; v: Float64Array; status: Uint8Array; }
/** Pixels of a camera without distortion, NaN outside the lens. */
export interface StraightColumns { u: Float64Array; v: Float64Array; }
/**
 * Covariances xx, xy, yx, yy of every point, one after the other, in square metres. The pixel's part is independent from
 * detection to detection; the calibration's is common to all of a camera, so that a filter must not average it away.
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

fn of_one_length(columns: &[&[f64]]) -> Result<usize, JsError> {
    let count = columns[0].len();
    if columns.iter().any(|column| column.len() != count) {
        return Err(JsError::new("columns of one length are expected"));
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

/// Two columns and their statuses under names.
fn columns<T: JsCast>(names: [&str; 2], values: [&[f64]; 2], status: &[u8]) -> T {
    let status = Uint8Array::from(status).into();
    object(&[(names[0], doubles(values[0])), (names[1], doubles(values[1])), ("status", status)])
}

/// Boxes of a form, four numbers each.
fn boxes_of<'a>(form: &str, boxes: &'a [f64]) -> Result<(BoxForm, &'a [[f64; 4]]), JsError> {
    let form = BoxForm::of_name(form)
        .ok_or_else(|| JsError::new("form: expected \"xywh\", \"xyxy\" or \"cxcywh\""))?;
    match boxes.as_chunks() {
        (boxes, []) => Ok((form, boxes)),
        _ => Err(JsError::new("boxes: four numbers each are expected")),
    }
}

/// Both parts of covariances under their names.
fn covariance_columns(parts: [Vec<[f64; 4]>; 2]) -> CovarianceColumns {
    let [pixel, calibration] = parts.map(|part| doubles(part.as_flattened()));
    object(&[("pixel", pixel), ("calibration", calibration)])
}

#[wasm_bindgen]
impl Camera {
    /// Pixels to points of the plane `height` metres above the floor (0 if it is not given).
    ///
    /// # Errors
    /// Throws when the columns are not of one length.
    #[wasm_bindgen(js_name = toFloor)]
    pub fn to_floor(&self, u: &[f64], v: &[f64], height: Option<f64>) -> Result<FloorColumns, JsError> {
        let count = of_one_length(&[u, v])?;
        let (mut x, mut y, mut status) = (vec![0.0; count], vec![0.0; count], vec![0; count]);
        let height = finite("height", height.unwrap_or(0.0))?;
        self.view.to_floor(height, [u, v], [&mut x, &mut y], &mut status);
        Ok(columns(["x", "y"], [&x, &y], &status))
    }

    /// Boxes, four numbers each, to the points on which their contents stand: the middle of the lower edge.
    ///
    /// `form` is "xywh", "xyxy" or "cxcywh".
    ///
    /// # Errors
    /// Throws when the numbers do not make boxes, and for another form.
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

    /// How uncertain the points are that pixels show, for a standard deviation of `sigmaPx` pixels (1 if it is not
    /// given) of the stream; NaN where there is no point, or nobody knows, as of the calibration's part where `scaleKnown` is
    /// false.
    ///
    /// # Errors
    /// Throws when the columns are not of one length.
    #[wasm_bindgen(js_name = floorCovariance)]
    pub fn floor_covariance(
        &self,
        u: &[f64],
        v: &[f64],
        #[wasm_bindgen(js_name = sigmaPx)] sigma_px: Option<f64>,
        height: Option<f64>,
    ) -> Result<CovarianceColumns, JsError> {
        let count = of_one_length(&[u, v])?;
        let sigma = finite("sigmaPx", sigma_px.unwrap_or(1.0))?;
        let (mut pixel, mut calibration) = (vec![[0.0; 4]; count], vec![[0.0; 4]; count]);
        let height = finite("height", height.unwrap_or(0.0))?;
        self.view.covariances(height, [u, v], sigma, [&mut pixel, &mut calibration]);
        Ok(covariance_columns([pixel, calibration]))
    }

    /// How uncertain the points are on which the contents of boxes stand, for a standard deviation of `sigmaPx` pixels (1 if
    /// it is not given) of each coordinate of the middle of their lower edges.
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

    /// Derivatives of the floor points of pixels by the unknowns of the camera, as a filter needs that considers the
    /// errors of the calibration (their covariance is `covariance`): of every point fourteen of x, then fourteen of y, in
    /// metres per unit of the unknown; NaN where there is no floor point.
    ///
    /// # Errors
    /// Throws when the columns are not of one length.
    #[wasm_bindgen(js_name = floorJacobian)]
    pub fn floor_jacobian(&self, u: &[f64], v: &[f64]) -> Result<Float64Array, JsError> {
        let mut found = vec![[[0.0; Covariance::SIZE]; 2]; of_one_length(&[u, v])?];
        self.view.floor_jacobians([u, v], &mut found);
        Ok(Float64Array::from(found.as_flattened().as_flattened()))
    }

    /// Points of space, in metres, to pixels; points of the floor if `z` is not given.
    ///
    /// # Errors
    /// Throws when the columns are not of one length.
    #[wasm_bindgen(js_name = toPixel)]
    pub fn to_pixel(&self, x: &[f64], y: &[f64], z: Option<Vec<f64>>) -> Result<PixelColumns, JsError> {
        let z = z.unwrap_or_else(|| vec![0.0; x.len()]);
        let count = of_one_length(&[x, y, &z])?;
        let (mut u, mut v, mut status) = (vec![0.0; count], vec![0.0; count], vec![0; count]);
        self.view.to_pixels([x, y, &z], [&mut u, &mut v], &mut status);
        Ok(columns(["u", "v"], [&u, &v], &status))
    }

    /// The rays that pixels show: unit vectors x, y, z one after the other; NaN outside the lens.
    ///
    /// # Errors
    /// Throws when the columns are not of one length.
    pub fn rays(&self, u: &[f64], v: &[f64]) -> Result<Float64Array, JsError> {
        let mut directions = vec![[0.0; 3]; of_one_length(&[u, v])?];
        self.view.rays([u, v], &mut directions);
        Ok(Float64Array::from(directions.as_flattened()))
    }

    /// Where a camera of the same focal without distortion would show what this one shows at pixels.
    ///
    /// # Errors
    /// Throws when the columns are not of one length.
    pub fn undistort(&self, u: &[f64], v: &[f64]) -> Result<StraightColumns, JsError> {
        let count = of_one_length(&[u, v])?;
        let (mut to_u, mut to_v) = (vec![0.0; count], vec![0.0; count]);
        self.view.undistort([u, v], [&mut to_u, &mut to_v]);
        Ok(object(&[("u", doubles(&to_u)), ("v", doubles(&to_v))]))
    }
}

/// What the numbers of statuses are called.
#[wasm_bindgen(js_name = statusNames)]
#[must_use]
pub fn status_names() -> Vec<String> {
    Status::ALL.map(|status| status.name().to_owned()).into()
}
