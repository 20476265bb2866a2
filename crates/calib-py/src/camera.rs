//! Calibrated camera for the pixels of one of its streams.
//!
//! Also the undistortion of images.

use std::borrow::Cow;

use calib_core::floor::{Crop, StraightView, StraightViewError};
use calib_core::{CameraView, Code, Pixel};
use calib_site::{Site, SiteCamera, SiteSolution, Solution};
use numpy::{PyArray2, PyArrayDyn, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array;
use crate::error::{camera_error, site_error, value_error};
use crate::stream::{named, view_of};

/// Removes the lens distortion from any number of images: ``straight = undistorter(image)``, see `apply`.
///
/// Args:
///     camera: `Camera` whose stream settings match the images.
///         `Camera.undistorter` also creates an `Undistorter`.
///     view: "same-focal" (the centre keeps its scale), "all-valid" (the largest view without blank pixels)
///         or "all-pixels" (the whole image, with blank borders).
#[pyclass(frozen, module = "calib")]
#[derive(Debug)]
pub(crate) struct Undistorter {
    camera: Camera,
    /// Name of the view.
    view: String,
    straight: StraightView,
}

impl Undistorter {
    /// Prepares the undistortion of images of the camera's stream.
    pub(crate) fn of(py: Python<'_>, camera: Camera, view: &str) -> PyResult<Self> {
        let expected = "\"same-focal\", \"all-valid\" or \"all-pixels\"";
        let crop = named(py, Some(camera.id()), "view", view, Crop::from_name, expected)?;
        let made = py.detach(|| camera.view().straight_view(crop));
        let straight = made.map_err(|why| {
            let field = match why {
                StraightViewError::Stretched => "fit",
                StraightViewError::Round => "view",
                StraightViewError::Size => "size",
            };
            value_error(py, Some(camera.id()), field, why)
        })?;
        Ok(Self { camera, view: view.to_owned(), straight })
    }
}

#[pymethods]
impl Undistorter {
    #[new]
    #[pyo3(signature = (camera, view="same-focal"))]
    fn new(py: Python<'_>, camera: PyRef<'_, Camera>, view: &str) -> PyResult<Self> {
        Self::of(py, camera.clone(), view)
    }

    /// (width, height) of the images, in pixels.
    #[getter]
    fn size(&self) -> (usize, usize) {
        self.straight.size.into()
    }

    /// Focal length of the undistorted image, in pixels.
    #[getter]
    fn focal(&self) -> f64 {
        self.straight.focal
    }

    /// Principal point (u, v) of the undistorted image, in pixels from its corner.
    #[getter]
    fn principal_point(&self) -> (f64, f64) {
        (self.straight.principal_point.u, self.straight.principal_point.v)
    }

    /// Removes the lens distortion from an image. Calling the undistorter does the same.
    ///
    /// Args: image: uint8 array of the shape (height, width), (height, width, 3) or (height, width, 4), with
    /// the size of the stream in pixels, in any order of colours. out: array of the same type and shape for
    /// the result.
    ///
    /// Returns: uint8 array of the same shape; black where the raw image has no pixel.
    #[pyo3(signature = (image, out=None))]
    fn apply<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let image = self.image(image)?;
        let shape = image.shape();
        let straight = match out {
            Some(out) => array::output::<u8>(out, shape, "uint8")?,
            None => array::zeros::<u8>(py, shape)?,
        };
        {
            let raw = image.try_readonly().map_err(|why| self.image_error(py, why))?;
            let mut to = array::write(&straight)?;
            let (raw, to) = (raw.as_slice()?, to.as_slice_mut()?);
            py.detach(|| self.straight.remap.apply_into(raw, to));
        }
        Ok(straight)
    }

    #[pyo3(signature = (image, out=None))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        self.apply(py, image, out)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (&str,))> {
        let camera = Bound::new(py, self.camera.clone())?;
        Ok((camera.getattr("undistorter")?, (&self.view,)))
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size();
        format!("<Undistorter of camera {:?}, {width} x {height} pixels, {}>", self.camera.id(), self.view)
    }
}

impl Undistorter {
    fn image_error(&self, py: Python<'_>, what: impl std::fmt::Display) -> PyErr {
        value_error(py, Some(self.camera.id()), "image", what)
    }

    /// Returns an image argument as a C-contiguous array; fails for another type or size.
    fn image<'py>(&self, image: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let py = image.py();
        let (width, height) = self.size();
        let expected = format!(
            "expected a uint8 array of the shape ({height}, {width}) or ({height}, {width}, 3 or 4), the size of the camera's stream"
        );
        let Ok(given) = image.cast::<PyArrayDyn<u8>>() else {
            let found = match image.getattr("dtype") {
                Ok(kind) => format!("an array of {kind}"),
                Err(_) if image.is_none() => "None (was the image file read?)".to_owned(),
                Err(_) => format!("a {}", image.get_type().name()?),
            };
            return Err(self.image_error(py, format_args!("found {found}, {expected}")));
        };
        match *given.shape() {
            [h, w] | [h, w, 1 | 3 | 4] if [h, w] == [height, width] => {}
            [h, w] | [h, w, 1 | 3 | 4] => {
                let what = format!(
                    "found an image of {w} x {h} pixels, this undistorter is for {width} x {height} pixels \
                     ({expected}); create one with stream_size=({w}, {h})"
                );
                return Err(self.image_error(py, what));
            }
            ref found => {
                let found = array::shape_text(found);
                return Err(self.image_error(py, format_args!("found the shape {found}, {expected}")));
            }
        }
        if given.is_c_contiguous() {
            return Ok(given.clone());
        }
        let plain = py.import("numpy")?.call_method1("ascontiguousarray", (given,))?;
        Ok(plain.cast_into::<PyArrayDyn<u8>>()?)
    }
}

/// Calibrated camera of a site, for one period of its calibration.
///
/// `Site.camera` returns it. Pixels count from the corner of the image, x right and y down: the centre of the
/// first pixel is (0.5, 0.5). With ``origin="centre"`` they count from the centre of the first pixel, as in
/// OpenCV.
///
/// Pixels refer to the calibrated image by default. ``stream_size=(width, height)`` selects a stream of
/// another size. If its aspect ratio differs, ``fit="letterbox"`` or ``"stretch"`` states how the image was
/// fitted. ``crop=(left, top, width, height)``, in pixels of the calibrated image, selects a stream that
/// shows a part of it. All methods accept these keywords, and `with_stream` sets them permanently.
///
/// Points are in metres, z up, with the floor at z = 0. Arrays may have any shape, strides and numeric type,
/// and are broadcast by NumPy's rules. Missing results are NaN. Calls on arrays release the GIL, and threads
/// may share a camera.
#[pyclass(frozen, eq, module = "calib")]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Camera {
    id: String,
    view: CameraView,
    /// JSON text of a site with only this camera, for pickling.
    text: String,
}

/// Keywords of a call that select the kind of pixels.
pub(crate) type Keywords<'a, 'py> = &'a Bound<'py, PyDict>;

impl Camera {
    /// Returns the calibrated camera of a site entry.
    pub(crate) fn of_entry(py: Python<'_>, site: &Site, entry: &SiteCamera) -> PyResult<Self> {
        let view = site.view_of(entry).map_err(|why| camera_error(py, &entry.id, why))?;
        Ok(Self { id: entry.id.clone(), view, text: single_camera_site(site, entry) })
    }

    /// Returns the calibrated camera with its field of view and its stream.
    pub(crate) const fn view(&self) -> &CameraView {
        &self.view
    }

    /// Returns the camera at the size of its stream; fails if the stream is stretched.
    fn camera_in_stream(&self, py: Python<'_>) -> PyResult<calib_core::Camera> {
        self.view.camera_in_stream().ok_or_else(|| {
            let what = "a stretched stream has two focal lengths; use the camera of the calibrated image";
            value_error(py, Some(&self.id), "fit", what)
        })
    }

    /// Returns the camera for the pixels of the stream that the keywords of a call select.
    pub(crate) fn of<'a>(&'a self, pixels: Option<Keywords<'_, '_>>) -> PyResult<Cow<'a, CameraView>> {
        view_of(&self.id, &self.view, pixels)
    }
}

/// Constructor of a camera and its arguments, for pickling.
type Parts<'py> = (Bound<'py, PyAny>, (String, String, Bound<'py, PyDict>));

/// Returns the JSON text of a site with only this camera, without annotations and residuals. It keeps two warnings that
/// affect the uncertainty: an assumed scale, and a placement by hand.
fn single_camera_site(site: &Site, entry: &SiteCamera) -> String {
    let tells_use = |code: Code| matches!(code, Code::ScaleAssumed | Code::PlacedByHand);
    let mut camera = SiteCamera::new(entry.id.clone(), entry.size_px);
    camera.efov_px.clone_from(&entry.efov_px);
    camera.efov_plane.clone_from(&entry.efov_plane);
    camera.placement.clone_from(&entry.placement);
    camera.solution = entry.solution.as_ref().map(|solution| Solution {
        residuals: Vec::new(),
        warnings: solution.warnings.iter().filter(|said| tells_use(said.code)).cloned().collect(),
        draw_next: None,
        ..solution.clone()
    });
    let scale = site.solution.as_ref().and_then(|solution| solution.scale);
    let solution = scale.map(|scale| SiteSolution { scale: Some(scale), ..SiteSolution::default() });
    let (planes, scene) = (site.planes.clone(), site.scene);
    Site { cameras: vec![camera], planes, scene, solution, ..Site::new() }.to_json()
}

#[pymethods]
impl Camera {
    /// Prepares the undistortion of images of a stream. Reuse the result for all images.
    ///
    /// Args: view: "same-focal" (the centre keeps its scale), "all-valid" (the largest view without blank pixels) or
    /// "all-pixels" (the whole image, with blank borders). origin, stream_size, fit, crop: stream settings of the
    /// images; see `Camera`.
    ///
    /// Returns: An `Undistorter` for uint8 arrays of the shape (height, width), (height, width, 3) or (height, width,
    /// 4).
    #[pyo3(
        signature = (view="same-focal", **stream),
        text_signature = "($self, view='same-focal', *, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn undistorter(
        &self,
        py: Python<'_>,
        view: &str,
        stream: Option<Keywords<'_, '_>>,
    ) -> PyResult<Undistorter> {
        Undistorter::of(py, self.with_stream(stream)?, view)
    }

    /// Returns the same camera for the pixels of another stream.
    ///
    /// Args:
    ///     origin: "corner" or "centre".
    ///     stream_size: (width, height), in pixels.
    ///     fit: "stretch" or "letterbox".
    ///     crop: (left, top, width, height), in pixels of the calibrated image.
    ///
    /// Returns:
    ///     A `Camera`.
    #[pyo3(
        signature = (**stream),
        text_signature = "($self, *, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    pub(crate) fn with_stream(&self, stream: Option<Keywords<'_, '_>>) -> PyResult<Self> {
        let view = self.of(stream)?.into_owned();
        Ok(Self { view, ..self.clone() })
    }

    /// Id in the site.
    #[getter]
    pub(crate) fn id(&self) -> &str {
        &self.id
    }

    /// (width, height) of the calibrated image, in pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        let [width, height] = self.view.size();
        (width as u32, height as u32)
    }

    /// Pixel origin: "corner" or "centre".
    #[getter]
    fn origin(&self) -> &'static str {
        self.view.stream().origin.name()
    }

    /// (width, height) of the stream in pixels; None for the calibrated image or its crop.
    #[getter]
    fn stream_size(&self) -> Option<(u32, u32)> {
        self.view.stream().size.map(Into::into)
    }

    /// Fit of the stream: "stretch", "letterbox" or None.
    #[getter]
    fn fit(&self) -> Option<&'static str> {
        self.view.stream().fit.map(calib_core::floor::StreamFit::name)
    }

    /// (left, top, width, height) of the stream's view, in pixels of the calibrated image; None for the whole
    /// image.
    #[getter]
    fn crop(&self) -> Option<(f64, f64, f64, f64)> {
        self.view.stream().crop.map(Into::into)
    }

    /// Position (x, y, z), in metres.
    #[getter]
    fn position(&self) -> (f64, f64, f64) {
        let position = self.view.camera().position;
        (position.x, position.y, position.z)
    }

    /// Whether a height, a length, a distance, control points or a placement on the plan determine the scale.
    /// Otherwise the camera is assumed to be 3 m high: its metres have an unknown common factor, and the
    /// calibration's part of `floor_covariance` is NaN.
    #[getter]
    fn scale_known(&self) -> bool {
        self.view.scale_is_known()
    }

    /// Yaw in degrees, counter-clockwise seen from above; 0 looks along y.
    #[getter]
    fn yaw_deg(&self) -> f64 {
        self.view.camera().yaw.to_degrees()
    }

    /// Pitch in degrees; positive looks down.
    #[getter]
    fn pitch_deg(&self) -> f64 {
        self.view.camera().pitch.to_degrees()
    }

    /// Roll in degrees; positive if the camera is rotated clockwise, seen from behind.
    #[getter]
    fn roll_deg(&self) -> f64 {
        self.view.camera().roll.to_degrees()
    }

    /// Focal length, in pixels of the stream.
    #[getter]
    fn focal_px(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.camera_in_stream(py)?.focal)
    }

    /// Principal point (u, v), in pixels of the stream.
    #[getter]
    fn principal_point_px(&self, py: Python<'_>) -> PyResult<(f64, f64)> {
        let Pixel { u, v } = self.camera_in_stream(py)?.lens.principal_point;
        Ok((u, v))
    }

    /// Camera matrix K, shape (3, 3): camera coordinates to undistorted pixels of the stream. It is OpenCV's
    /// matrix if the camera has ``origin="centre"`` and square pixels.
    #[getter]
    fn camera_matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let camera = self.camera_in_stream(py)?;
        let Pixel { u, v } = camera.lens.principal_point;
        matrix(py, &[[camera.focal, 0.0, u], [0.0, camera.focal, v], [0.0, 0.0, 1.0]])
    }

    /// Distortion as {"model": ..., "k1": ..., "focal_px": ...}, or None. The coefficients refer to this
    /// focal length.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let lens = self.camera_in_stream(py)?.lens;
        let Some(model) = lens.distortion.model() else { return Ok(None) };
        let found = PyDict::new(py);
        found.set_item("model", model.row().name)?;
        for (name, value) in lens.distortion.names().iter().zip(lens.distortion.coefficients()) {
            found.set_item(name.name(), value)?;
        }
        found.set_item("focal_px", lens.focal)?;
        Ok(Some(found))
    }

    /// Projection matrix P = K R [I | -C], shape (3, 4): world points to undistorted pixels of the stream.
    #[getter]
    fn projection_matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.camera_in_stream(py)?.projection_matrix())
    }

    /// Homography, shape (3, 3): undistorted pixels of the stream to the floor.
    #[getter]
    fn floor_from_pixel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.camera_in_stream(py)?.homography_floor_from_pixel(0.0))
    }

    /// Corners of the effective field of view (EFOV) on the floor, shape (n, 2), in metres.
    #[getter]
    fn efov<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let corners: Vec<[f64; 2]> = self.view.efov().iter().map(|corner| [corner.x, corner.y]).collect();
        if corners.is_empty() { Ok(PyArray2::zeros(py, [0, 2], false)) } else { matrix(py, &corners) }
    }

    /// Covariance of the camera's parameters, shape (15, 15).
    ///
    /// They are x, y, z (metres), yaw, pitch, roll (radians), and focal length (pixels of the calibrated image). Five
    /// distortion coefficients follow in the order of their model, then the principal point u, v (pixels of the
    /// calibrated image) and the pixel aspect. For a fisheye the fifth distortion parameter is the logarithm of the
    /// lens's focal length. Rows of fixed parameters are 0. A variance is infinite if it is unknown, for example of z
    /// if `scale_known` is False.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.view.camera().covariance.0)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Parts<'py>> {
        let stream = PyDict::new(py);
        stream.set_item("origin", self.origin())?;
        stream.set_item("stream_size", self.stream_size())?;
        stream.set_item("fit", self.fit())?;
        stream.set_item("crop", self.crop())?;
        let class = py.get_type::<Self>();
        Ok((class.getattr("_again")?, (self.text.clone(), self.id.clone(), stream)))
    }

    /// Restores a camera from the parts of `__reduce__`.
    #[staticmethod]
    #[pyo3(name = "_again")]
    fn restore(py: Python<'_>, text: &str, id: &str, stream: &Bound<'_, PyDict>) -> PyResult<Self> {
        let site = Site::from_json(text).map_err(|error| site_error(py, "", &error))?;
        let entry = site.camera(id).ok_or_else(|| camera_error(py, id, "is missing in the pickled site"))?;
        Self::of_entry(py, &site, entry)?.with_stream(Some(stream))
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.view.size();
        let (x, y, z) = self.position();
        let stream = match (self.stream_size(), self.fit()) {
            (None, _) => String::new(),
            (Some((width, height)), None) => format!(", for a stream of {width} x {height}"),
            (Some((width, height)), Some(fit)) => format!(", for a stream of {width} x {height} ({fit})"),
        };
        let origin = if self.origin() == "corner" { "" } else { ", from the centre of the first pixel" };
        format!(
            "<Camera {:?}, {width} x {height} pixels, at ({x:.2}, {y:.2}, {z:.2}) m{stream}{origin}>",
            self.id
        )
    }
}

fn matrix<'py, const N: usize>(py: Python<'py>, rows: &[[f64; N]]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<Vec<f64>> = rows.iter().map(|row| row.to_vec()).collect();
    Ok(PyArray2::from_vec2(py, &rows)?)
}
