//! A calibrated camera, for the pixels of one of its streams.
//!
//! Images without the bend of their lens.

use std::borrow::Cow;

use calib_core::floor::{Crop, NoStraightView, StraightView};
use calib_core::{CameraView, Code, Pixel};
use calib_site::{Site, SiteCamera, SiteSolution, Solution};
use numpy::{PyArray2, PyArrayDyn, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array;
use crate::error::{of_camera, of_site, refused};
use crate::stream::{named, view_of};

/// Takes the bend of a lens out of images, as many as there are: ``straight = undistorter(image)``, as `apply` says.
///
/// Args:
///     camera: a `Camera`, for the images of its stream; `Camera.undistorter` does the same.
///     view: "same-focal" (the centre keeps its scale), "all-valid" (the largest view without a blank pixel)
///         or "all-pixels" (every pixel of the image, blank beyond).
#[pyclass(frozen, module = "calib")]
#[derive(Debug)]
pub(crate) struct Undistorter {
    camera: Camera,
    /// By its name.
    view: String,
    straight: StraightView,
}

impl Undistorter {
    /// For the images of the stream of a camera.
    pub(crate) fn of(py: Python<'_>, camera: Camera, view: &str) -> PyResult<Self> {
        let expected = "\"same-focal\", \"all-valid\" or \"all-pixels\"";
        let crop = named(py, Some(camera.id()), "view", view, Crop::of_name, expected)?;
        let made = py.detach(|| camera.view().straight_view(crop));
        let straight = made.map_err(|why| {
            let field = match why {
                NoStraightView::Stretched => "fit",
                NoStraightView::Round => "view",
                NoStraightView::Size => "size",
            };
            refused(py, Some(camera.id()), field, why)
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

    /// Focal of the new image, in pixels.
    #[getter]
    fn focal(&self) -> f64 {
        self.straight.focal
    }

    /// (u, v) of the new image, in pixels from its corner.
    #[getter]
    fn principal_point(&self) -> (f64, f64) {
        (self.straight.principal_point.u, self.straight.principal_point.v)
    }

    /// Takes the bend out of an image; calling the undistorter does the same.
    ///
    /// Args:
    ///     image: uint8 array of the shape (height, width), (height, width, 3) or (height, width, 4), of the
    ///         size of the stream; in any order of colours.
    ///     out: array of the same kind to write to, in place of a new one.
    ///
    /// Returns:
    ///     uint8 array of the same shape; black where the image shows nothing.
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
            let raw = image.try_readonly().map_err(|why| self.refused(py, why))?;
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
    fn refused(&self, py: Python<'_>, what: impl std::fmt::Display) -> PyErr {
        refused(py, Some(self.camera.id()), "image", what)
    }

    /// The image row by row.
    fn image<'py>(&self, image: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let py = image.py();
        let (width, height) = self.size();
        let expected = format!(
            "expected a uint8 array of the shape ({height}, {width}) or ({height}, {width}, 3 or 4), as its camera's stream is"
        );
        let Ok(given) = image.cast::<PyArrayDyn<u8>>() else {
            let found = match image.getattr("dtype") {
                Ok(kind) => format!("an array of {kind}"),
                Err(_) if image.is_none() => "None: was the file read?".to_owned(),
                Err(_) => format!("a {}", image.get_type().name()?),
            };
            return Err(self.refused(py, format_args!("found {found}, {expected}")));
        };
        match *given.shape() {
            [h, w] | [h, w, 1 | 3 | 4] if [h, w] == [height, width] => {}
            [h, w] | [h, w, 1 | 3 | 4] => {
                let what = format!(
                    "found an image of {w} x {h} pixels, this undistorter is for {width} x {height} pixels \
                     ({expected}); stream_size=({w}, {h}) makes one for the image"
                );
                return Err(self.refused(py, what));
            }
            ref found => {
                let found = array::shape_text(found);
                return Err(self.refused(py, format_args!("found the shape {found}, {expected}")));
            }
        }
        if given.is_c_contiguous() {
            return Ok(given.clone());
        }
        let plain = py.import("numpy")?.call_method1("ascontiguousarray", (given,))?;
        Ok(plain.cast_into::<PyArrayDyn<u8>>()?)
    }
}

/// A calibrated camera of a site, for the period that its calibration holds.
///
/// Made by `Site.camera`. Pixels count from the corner of the image, x right and y down (the centre of the first
/// pixel is (0.5, 0.5)); ``origin="centre"`` says that they count from the centre of the first pixel, as OpenCV's do.
/// They are of the still that was calibrated; ``stream_size=(width, height)`` says that they are of a stream of
/// another size, ``fit="letterbox"`` or ``"stretch"`` how the image was brought to it where the proportion is
/// another, and ``crop=(left, top, width, height)``, in pixels of the still, that the stream shows a part of it. All
/// calls take these keywords; `with_stream` sets them for good. Points are in metres, z up, the floor at z = 0.
///
/// Arrays may have any shape, strides and type of number; columns of different shapes are repeated as NumPy does.
/// Where there is no answer, results are NaN. Bulk work releases the GIL; a camera may be used by many threads.
#[pyclass(frozen, eq, module = "calib")]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Camera {
    id: String,
    view: CameraView,
    /// A site of this camera alone, as text: what it is made from again elsewhere.
    text: String,
}

/// Which pixels a call speaks of, as it says.
pub(crate) type Keywords<'a, 'py> = &'a Bound<'py, PyDict>;

impl Camera {
    /// The calibrated camera of an entry.
    pub(crate) fn of_entry(py: Python<'_>, site: &Site, entry: &SiteCamera) -> PyResult<Self> {
        let view = site.view_of(entry).map_err(|why| of_camera(py, &entry.id, why))?;
        Ok(Self { id: entry.id.clone(), view, text: alone(site, entry) })
    }

    /// What it maps.
    pub(crate) const fn view(&self) -> &CameraView {
        &self.view
    }

    /// The camera as its stream shows it.
    fn shown(&self, py: Python<'_>) -> PyResult<calib_core::Camera> {
        self.view.camera_in_stream().ok_or_else(|| {
            let what = "a stretched stream has no one focal: ask the camera of the still";
            refused(py, Some(&self.id), "fit", what)
        })
    }

    /// The camera for the pixels that a call speaks of.
    pub(crate) fn of<'a>(&'a self, pixels: Option<Keywords<'_, '_>>) -> PyResult<Cow<'a, CameraView>> {
        view_of(&self.id, &self.view, pixels)
    }
}

/// How a camera is made again: by what, and from what.
type Parts<'py> = (Bound<'py, PyAny>, (String, String, Bound<'py, PyDict>));

/// A site of this camera alone, without what it was solved from, but with whether its scale and place are known.
fn alone(site: &Site, entry: &SiteCamera) -> String {
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
    /// Prepares the undistortion of images of the stream that pixels are of, to be used for many.
    ///
    /// Args:
    ///     view: "same-focal" (the centre keeps its scale), "all-valid" (the largest view without a blank pixel)
    ///         or "all-pixels" (every pixel of the image, blank beyond).
    ///     origin, stream_size, fit, crop: of which images, as the class says.
    ///
    /// Returns:
    ///     An `Undistorter`, called with uint8 arrays of the shape (height, width), or with 3 or 4 colours.
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

    /// The same camera for the pixels of another stream.
    ///
    /// Args:
    ///     origin: "corner" or "centre".
    ///     stream_size: (width, height), in pixels.
    ///     fit: "stretch" or "letterbox".
    ///     crop: (left, top, width, height), in pixels of the still.
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

    /// The id in the site.
    #[getter]
    pub(crate) fn id(&self) -> &str {
        &self.id
    }

    /// (width, height) of the still that was calibrated, in pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        let [width, height] = self.view.size();
        (width as u32, height as u32)
    }

    /// "corner" or "centre": where pixels count from.
    #[getter]
    fn origin(&self) -> &'static str {
        self.view.stream().origin.name()
    }

    /// (width, height) of the stream that pixels are of, or None where it is the still itself, or its crop.
    #[getter]
    fn stream_size(&self) -> Option<(u32, u32)> {
        self.view.stream().size.map(Into::into)
    }

    /// "stretch" or "letterbox", or None where nobody said.
    #[getter]
    fn fit(&self) -> Option<&'static str> {
        self.view.stream().fit.map(calib_core::floor::StreamFit::name)
    }

    /// (left, top, width, height) of what the stream shows, in pixels of the still, or None for all of it.
    #[getter]
    fn crop(&self) -> Option<(f64, f64, f64, f64)> {
        self.view.stream().crop.map(Into::into)
    }

    /// (x, y, z), in metres.
    #[getter]
    fn position(&self) -> (f64, f64, f64) {
        let position = self.view.camera().position;
        (position.x, position.y, position.z)
    }

    /// Whether something gives the scale: a height, a length, a distance, control points, or a place on the plan. Where
    /// nothing does, the camera is taken to be 3 m high: its metres are right in their proportions alone, and the
    /// calibration's part of `floor_covariance` is NaN.
    #[getter]
    fn scale_known(&self) -> bool {
        self.view.scale_is_known()
    }

    /// Counter-clockwise about the vertical, seen from above, in degrees; 0 looks along y.
    #[getter]
    fn yaw_deg(&self) -> f64 {
        self.view.camera().yaw.to_degrees()
    }

    /// In degrees; positive looks down.
    #[getter]
    fn pitch_deg(&self) -> f64 {
        self.view.camera().pitch.to_degrees()
    }

    /// In degrees; positive where the camera is turned clockwise, seen from behind.
    #[getter]
    fn roll_deg(&self) -> f64 {
        self.view.camera().roll.to_degrees()
    }

    /// In pixels of the stream.
    #[getter]
    fn focal_px(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.shown(py)?.focal)
    }

    /// (u, v), in pixels of the stream.
    #[getter]
    fn principal_point_px(&self, py: Python<'_>) -> PyResult<(f64, f64)> {
        let Pixel { u, v } = self.shown(py)?.lens.principal_point;
        Ok((u, v))
    }

    /// K, shape (3, 3): points of the camera's axes to undistorted pixels of the stream, as OpenCV takes it where
    /// the camera has ``origin="centre"``.
    #[getter]
    fn camera_matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let camera = self.shown(py)?;
        let Pixel { u, v } = camera.lens.principal_point;
        matrix(py, &[[camera.focal, 0.0, u], [0.0, camera.focal, v], [0.0, 0.0, 1.0]])
    }

    /// The distortion: {"model": ..., "k1": ...}, with the focal that its coefficients are for; None without one.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let lens = self.shown(py)?.lens;
        let Some(model) = lens.distortion.model() else { return Ok(None) };
        let found = PyDict::new(py);
        found.set_item("model", model.row().name)?;
        for (name, value) in lens.distortion.names().iter().zip(lens.distortion.coefficients()) {
            found.set_item(name.name(), value)?;
        }
        found.set_item("focal_px", lens.focal)?;
        Ok(Some(found))
    }

    /// P = K R [I | -C], shape (3, 4): points of space to undistorted pixels of the stream.
    #[getter]
    fn projection_matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.shown(py)?.projection_matrix())
    }

    /// Homography, shape (3, 3): undistorted pixels of the stream to the floor.
    #[getter]
    fn floor_from_pixel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.shown(py)?.homography_floor_from_pixel(0.0))
    }

    /// Corners of the effective field of view on the floor, shape (n, 2), in metres.
    #[getter]
    fn efov<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let corners: Vec<[f64; 2]> = self.view.efov().iter().map(|corner| [corner.x, corner.y]).collect();
        if corners.is_empty() { Ok(PyArray2::zeros(py, [0, 2], false)) } else { matrix(py, &corners) }
    }

    /// Covariance of the unknowns, shape (14, 14): x, y, z (metres), yaw, pitch, roll (radians), focal (pixels of the still),
    /// five places for the coefficients of the distortion in the order of their model, of a fisheye the log of its own
    /// focal in the fifth, and the principal point, u and v (pixels of the still); zeros for what was not estimated,
    /// infinite variances where nothing is known of the errors, as of z where `scale_known` is False.
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

    /// What was taken apart by `__reduce__`.
    #[staticmethod]
    #[pyo3(name = "_again")]
    fn again(py: Python<'_>, text: &str, id: &str, stream: &Bound<'_, PyDict>) -> PyResult<Self> {
        let site = Site::from_json(text).map_err(|error| of_site(py, "", &error))?;
        let entry = site.camera(id).ok_or_else(|| of_camera(py, id, "is not in the text"))?;
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
