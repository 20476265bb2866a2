//! Calibrated camera for the pixels of one of its streams.

use calib_core::{CameraView, Pixel};
use js_sys::{Array, Float64Array};
use wasm_bindgen::prelude::*;

use crate::object::StreamOptions;
use crate::object::{doubles, object, tuple};
use crate::undistorter::{Two, Undistorter, View};

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Distortion of a lens: its model, its coefficients by name, and the focal length that they refer to. */
export type Distortion = { model: string; focalPx: number } & { [coefficient: string]: number | string };
"#;

#[wasm_bindgen]
extern "C" {
    /// Distortion of a lens.
    #[wasm_bindgen(typescript_type = "Distortion")]
    #[derive(Debug)]
    pub type DistortionObject;

    /// Three numbers.
    #[wasm_bindgen(typescript_type = "[number, number, number]")]
    #[derive(Debug)]
    pub type Three;

    /// Four numbers.
    #[wasm_bindgen(typescript_type = "[number, number, number, number]")]
    #[derive(Debug)]
    pub type Four;

    /// Rows of a matrix.
    #[wasm_bindgen(typescript_type = "number[][]")]
    #[derive(Debug)]
    pub type Rows;
}

/// Calibrated camera for the pixels of one of its streams. `site.camera` returns it.
///
/// By default pixels refer to the calibrated image and count from its corner, x right and y down. Options
/// select other pixels. Points are in metres, z up, with the floor at z = 0.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Camera {
    id: String,
    pub(crate) view: CameraView,
}

impl Camera {
    pub(crate) fn new(id: &str, view: CameraView) -> Self {
        Self { id: id.to_owned(), view }
    }

    /// Returns the camera at the size of its stream; fails for a stretched stream.
    fn camera_in_stream(&self) -> Result<calib_core::Camera, JsError> {
        let stretched = "a stretched stream has two focal lengths; use the camera of the calibrated image";
        self.view
            .camera_in_stream()
            .ok_or_else(|| JsError::new(&format!("camera {:?}: {stretched}", self.id)))
    }
}

fn rows<const N: usize>(rows: &[[f64; N]]) -> Rows {
    rows.iter().map(|row| tuple(row)).collect::<Array>().unchecked_into()
}

#[wasm_bindgen]
impl Camera {
    /// Returns the same camera for the pixels of another stream.
    ///
    /// # Errors
    /// Throws if the stream does not match the size of the calibrated image.
    #[wasm_bindgen(js_name = withStream)]
    pub fn with_stream(&self, options: &StreamOptions) -> Result<Self, JsError> {
        let view = self.view.with_stream(options.read(*self.view.stream())?);
        Ok(Self::new(&self.id, view.map_err(|why| JsError::new(&format!("camera {:?}: {why}", self.id)))?))
    }

    /// Prepares the undistortion of images of the stream. Reuse the result for all images.
    ///
    /// `view` is "same-focal" (the default: the centre keeps its scale), "all-valid" (the largest view
    /// without blank pixels) or "all-pixels" (the whole image, with blank borders).
    ///
    /// # Errors
    /// Throws for an unknown view, and for a stretched stream.
    pub fn undistorter(&self, view: Option<View>) -> Result<Undistorter, JsError> {
        Undistorter::of(&self.view, view.as_ref())
    }

    /// Id in the site.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn id(&self) -> String {
        self.id.clone()
    }

    /// Width and height of the calibrated image, in pixels.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn size(&self) -> Two {
        tuple(&self.view.size()).unchecked_into()
    }

    /// Pixel origin: "corner" or "centre".
    #[wasm_bindgen(getter, unchecked_return_type = "\"corner\" | \"centre\"")]
    #[must_use]
    pub fn origin(&self) -> String {
        self.view.stream().origin.name().to_owned()
    }

    /// Width and height of the stream, in pixels; `undefined` for the calibrated image or its crop.
    #[wasm_bindgen(getter, js_name = streamSize)]
    #[must_use]
    pub fn stream_size(&self) -> Option<Two> {
        self.view.stream().size.map(|size| tuple(&size.map(f64::from)).unchecked_into())
    }

    /// Fit of the stream: "stretch" or "letterbox"; `undefined` if not stated.
    #[wasm_bindgen(getter, unchecked_return_type = "\"stretch\" | \"letterbox\" | undefined")]
    #[must_use]
    pub fn fit(&self) -> Option<String> {
        self.view.stream().fit.map(|fit| fit.name().to_owned())
    }

    /// Left, top, width and height of the stream's view, in pixels of the calibrated image; `undefined` for
    /// the whole image.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn crop(&self) -> Option<Four> {
        self.view.stream().crop.map(|crop| tuple(&crop).unchecked_into())
    }

    /// Position x, y and z, in metres.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn position(&self) -> Three {
        let position = self.view.camera().position;
        tuple(&[position.x, position.y, position.z]).unchecked_into()
    }

    /// Whether a height, a length, a distance, control points or a placement on the plan determine the scale.
    /// Otherwise the camera is assumed to be 3 m high: its metres have an unknown common factor, and the
    /// calibration's part of `floorCovariance` is NaN.
    #[wasm_bindgen(getter, js_name = scaleKnown)]
    #[must_use]
    pub fn scale_known(&self) -> bool {
        self.view.scale_is_known()
    }

    /// Yaw in degrees, counter-clockwise seen from above; 0 looks along y.
    #[wasm_bindgen(getter, js_name = yawDeg)]
    #[must_use]
    pub fn yaw_deg(&self) -> f64 {
        self.view.camera().yaw.to_degrees()
    }

    /// Pitch in degrees; positive looks down.
    #[wasm_bindgen(getter, js_name = pitchDeg)]
    #[must_use]
    pub fn pitch_deg(&self) -> f64 {
        self.view.camera().pitch.to_degrees()
    }

    /// Roll in degrees; positive if the camera is rotated clockwise, seen from behind.
    #[wasm_bindgen(getter, js_name = rollDeg)]
    #[must_use]
    pub fn roll_deg(&self) -> f64 {
        self.view.camera().roll.to_degrees()
    }

    /// Focal length, in pixels of the stream.
    ///
    /// # Errors
    /// Throws for a stretched stream.
    #[wasm_bindgen(getter, js_name = focalPx)]
    pub fn focal_px(&self) -> Result<f64, JsError> {
        Ok(self.camera_in_stream()?.focal)
    }

    /// Principal point u and v, in pixels of the stream.
    ///
    /// # Errors
    /// Throws for a stretched stream.
    #[wasm_bindgen(getter, js_name = principalPointPx)]
    pub fn principal_point_px(&self) -> Result<Two, JsError> {
        let Pixel { u, v } = self.camera_in_stream()?.lens.principal_point;
        Ok(tuple(&[u, v]).unchecked_into())
    }

    /// Camera matrix K, three rows of three: camera coordinates to undistorted pixels of the stream. It is
    /// OpenCV's matrix if the camera has `origin: "centre"` and square pixels.
    ///
    /// # Errors
    /// Throws for a stretched stream.
    #[wasm_bindgen(getter, js_name = cameraMatrix)]
    pub fn camera_matrix(&self) -> Result<Rows, JsError> {
        let camera = self.camera_in_stream()?;
        let Pixel { u, v } = camera.lens.principal_point;
        Ok(rows(&[[camera.focal, 0.0, u], [0.0, camera.focal, v], [0.0, 0.0, 1.0]]))
    }

    /// Distortion: its model, its coefficients, and the focal length that the coefficients refer to; `undefined`
    /// without distortion.
    ///
    /// # Errors
    /// Throws for a stretched stream.
    #[wasm_bindgen(getter)]
    pub fn distortion(&self) -> Result<Option<DistortionObject>, JsError> {
        let lens = self.camera_in_stream()?.lens;
        let Some(model) = lens.distortion.model() else { return Ok(None) };
        let values = lens.distortion.names().iter().zip(lens.distortion.coefficients());
        let head = [("model", model.row().name.into()), ("focalPx", lens.focal.into())];
        let coefficients = values.map(|(name, value)| (name.name(), value.into()));
        Ok(Some(object(&head.into_iter().chain(coefficients).collect::<Vec<_>>())))
    }

    /// Projection matrix P = K R [I | -C], three rows of four: world points to undistorted pixels of the
    /// stream.
    ///
    /// # Errors
    /// Throws for a stretched stream.
    #[wasm_bindgen(getter, js_name = projectionMatrix)]
    pub fn projection_matrix(&self) -> Result<Rows, JsError> {
        Ok(rows(&self.camera_in_stream()?.projection_matrix()))
    }

    /// Homography, three rows of three: undistorted pixels of the stream to the floor.
    ///
    /// # Errors
    /// Throws for a stretched stream.
    #[wasm_bindgen(getter, js_name = floorFromPixel)]
    pub fn floor_from_pixel(&self) -> Result<Rows, JsError> {
        Ok(rows(&self.camera_in_stream()?.homography_floor_from_pixel(0.0)))
    }

    /// Corners of the effective field of view (EFOV) on the floor: x, y, x, y and so on, in metres.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn efov(&self) -> Float64Array {
        let corners: Vec<f64> = self.view.efov().iter().flat_map(|corner| [corner.x, corner.y]).collect();
        doubles(&corners).unchecked_into()
    }

    /// Covariance of the camera's parameters, fifteen rows of fifteen.
    ///
    /// They are x, y, z (metres), yaw, pitch, roll (radians), and focal length (pixels of the calibrated image). Five
    /// distortion coefficients follow in the order of their model, then the principal point u, v (pixels of the
    /// calibrated image) and the pixel aspect. For a fisheye the fifth distortion parameter is the logarithm of the
    /// lens's focal length. Rows of fixed parameters are 0. A variance is infinite if it is unknown, for example of z
    /// if `scaleKnown` is false.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn covariance(&self) -> Rows {
        rows(&self.view.camera().covariance.0)
    }
}
