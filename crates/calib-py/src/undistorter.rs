//! Images without the bend of their lens.

use calib_core::floor::{Crop, NoStraightView, StraightView};
use numpy::{PyArrayDyn, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::prelude::*;

use crate::array;
use crate::camera::Camera;
use crate::error::refused;
use crate::stream::named;

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
