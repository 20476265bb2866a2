//! A calibrated camera, for the pixels of one of its streams.

use calib_core::{CameraView, Pixel};
use js_sys::{Array, Float64Array};
use wasm_bindgen::prelude::*;

use crate::object::StreamOptions;
use crate::object::{doubles, object, tuple};
use crate::undistorter::{Two, Undistorter, View};

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** A lens: its model, its coefficients by name, and the focal that they are for. */
export type Distortion = { model: string; focalPx: number } & { [coefficient: string]: number | string };
"#;

#[wasm_bindgen]
extern "C" {
    /// The distortion.
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

/// A calibrated camera for the pixels of one of its streams, made by `site.camera`.
///
/// Pixels count from the corner of the image, x right and y down, of the still that was calibrated, unless options say
/// otherwise. Points are in metres, z up, the floor at z = 0.
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

    /// The camera as its stream shows it.
    fn shown(&self) -> Result<calib_core::Camera, JsError> {
        let stretched = "a stretched stream has no one focal: ask the camera of the still";
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
    /// The same camera for the pixels of another stream.
    ///
    /// # Errors
    /// Throws when the stream does not go with the size of the still.
    #[wasm_bindgen(js_name = withStream)]
    pub fn with_stream(&self, options: &StreamOptions) -> Result<Self, JsError> {
        let view = self.view.with_stream(options.read(*self.view.stream())?);
        Ok(Self::new(&self.id, view.map_err(|why| JsError::new(&format!("camera {:?}: {why}", self.id)))?))
    }

    /// Prepares the undistortion of images of the stream, to be used for many.
    ///
    /// `view` is "same-focal" (the centre keeps its scale; if nothing is said), "all-valid" (the largest view without a blank
    /// pixel) or "all-pixels" (every pixel of the image, blank beyond).
    ///
    /// # Errors
    /// Throws for another view, and where the stream is stretched.
    pub fn undistorter(&self, view: Option<View>) -> Result<Undistorter, JsError> {
        Undistorter::of(&self.view, view.as_ref())
    }

    /// The id in the site.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn id(&self) -> String {
        self.id.clone()
    }

    /// Width and height of the still that was calibrated, in pixels.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn size(&self) -> Two {
        tuple(&self.view.size()).unchecked_into()
    }

    /// "corner" or "centre": where pixels count from.
    #[wasm_bindgen(getter, unchecked_return_type = "\"corner\" | \"centre\"")]
    #[must_use]
    pub fn origin(&self) -> String {
        self.view.stream().origin.name().to_owned()
    }

    /// Width and height of the stream that pixels are of; `undefined` where it is the still itself, or its crop.
    #[wasm_bindgen(getter, js_name = streamSize)]
    #[must_use]
    pub fn stream_size(&self) -> Option<Two> {
        self.view.stream().size.map(|size| tuple(&size.map(f64::from)).unchecked_into())
    }

    /// "stretch" or "letterbox"; `undefined` where nobody said.
    #[wasm_bindgen(getter, unchecked_return_type = "\"stretch\" | \"letterbox\" | undefined")]
    #[must_use]
    pub fn fit(&self) -> Option<String> {
        self.view.stream().fit.map(|fit| fit.name().to_owned())
    }

    /// Left, top, width and height of what the stream shows, in pixels of the still; `undefined` for all of it.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn crop(&self) -> Option<Four> {
        self.view.stream().crop.map(|crop| tuple(&crop).unchecked_into())
    }

    /// x, y and z, in metres.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn position(&self) -> Three {
        let position = self.view.camera().position;
        tuple(&[position.x, position.y, position.z]).unchecked_into()
    }

    /// Whether something gives the scale: a height, a length, a distance, control points, or a place on the plan. Where
    /// nothing does, the camera is taken to be 3 m high: its metres are right in their proportions alone, and the
    /// calibration's part of `floorCovariance` is NaN.
    #[wasm_bindgen(getter, js_name = scaleKnown)]
    #[must_use]
    pub fn scale_known(&self) -> bool {
        self.view.scale_is_known()
    }

    /// Counter-clockwise about the vertical, seen from above, in degrees; 0 looks along y.
    #[wasm_bindgen(getter, js_name = yawDeg)]
    #[must_use]
    pub fn yaw_deg(&self) -> f64 {
        self.view.camera().yaw.to_degrees()
    }

    /// In degrees; positive looks down.
    #[wasm_bindgen(getter, js_name = pitchDeg)]
    #[must_use]
    pub fn pitch_deg(&self) -> f64 {
        self.view.camera().pitch.to_degrees()
    }

    /// In degrees; positive where the camera is turned clockwise, seen from behind.
    #[wasm_bindgen(getter, js_name = rollDeg)]
    #[must_use]
    pub fn roll_deg(&self) -> f64 {
        self.view.camera().roll.to_degrees()
    }

    /// In pixels of the stream.
    ///
    /// # Errors
    /// Throws where the stream is stretched.
    #[wasm_bindgen(getter, js_name = focalPx)]
    pub fn focal_px(&self) -> Result<f64, JsError> {
        Ok(self.shown()?.focal)
    }

    /// u and v, in pixels of the stream.
    ///
    /// # Errors
    /// Throws where the stream is stretched.
    #[wasm_bindgen(getter, js_name = principalPointPx)]
    pub fn principal_point_px(&self) -> Result<Two, JsError> {
        let Pixel { u, v } = self.shown()?.lens.principal_point;
        Ok(tuple(&[u, v]).unchecked_into())
    }

    /// K, three rows of three: points of the camera's axes to undistorted pixels of the stream, as OpenCV takes it
    /// where the camera has `origin: "centre"`.
    ///
    /// # Errors
    /// Throws where the stream is stretched.
    #[wasm_bindgen(getter, js_name = cameraMatrix)]
    pub fn camera_matrix(&self) -> Result<Rows, JsError> {
        let camera = self.shown()?;
        let Pixel { u, v } = camera.lens.principal_point;
        Ok(rows(&[[camera.focal, 0.0, u], [0.0, camera.focal, v], [0.0, 0.0, 1.0]]))
    }

    /// The distortion: its model, its coefficients, and the focal that they are for; `undefined` without one.
    ///
    /// # Errors
    /// Throws where the stream is stretched.
    #[wasm_bindgen(getter)]
    pub fn distortion(&self) -> Result<Option<DistortionObject>, JsError> {
        let lens = self.shown()?.lens;
        let Some(model) = lens.distortion.model() else { return Ok(None) };
        let values = lens.distortion.names().iter().zip(lens.distortion.coefficients());
        let head = [("model", model.row().name.into()), ("focalPx", lens.focal.into())];
        let coefficients = values.map(|(name, value)| (name.name(), value.into()));
        Ok(Some(object(&head.into_iter().chain(coefficients).collect::<Vec<_>>())))
    }

    /// P = K R [I | -C], three rows of four: points of space to undistorted pixels of the stream.
    ///
    /// # Errors
    /// Throws where the stream is stretched.
    #[wasm_bindgen(getter, js_name = projectionMatrix)]
    pub fn projection_matrix(&self) -> Result<Rows, JsError> {
        Ok(rows(&self.shown()?.projection_matrix()))
    }

    /// Homography, three rows of three: undistorted pixels of the stream to the floor.
    ///
    /// # Errors
    /// Throws where the stream is stretched.
    #[wasm_bindgen(getter, js_name = floorFromPixel)]
    pub fn floor_from_pixel(&self) -> Result<Rows, JsError> {
        Ok(rows(&self.shown()?.homography_floor_from_pixel(0.0)))
    }

    /// Corners of the effective field of view on the floor: x, y, x, y and so on, in metres.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn efov(&self) -> Float64Array {
        let corners: Vec<f64> = self.view.efov().iter().flat_map(|corner| [corner.x, corner.y]).collect();
        doubles(&corners).unchecked_into()
    }

    /// Covariance of the unknowns, fourteen rows of fourteen: x, y, z (metres), yaw, pitch, roll (radians), focal (pixels
    /// of the still), five places for the coefficients of the distortion in the order of their model, of a fisheye the log
    /// of its own focal in the fifth, and the principal point, u and v (pixels of the still); zeros for what was not
    /// estimated, infinite variances where nothing is known of the errors, as of z where `scaleKnown` is false.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn covariance(&self) -> Rows {
        rows(&self.view.camera().covariance.0)
    }
}
