//! Images without the bend of their lens.

use calib_core::{Crop, Lens, Remap};
use numpy::{PyArrayDyn, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::prelude::*;

use crate::array;
use crate::camera::Camera;
use crate::error::refused;
use crate::stream::named;

/// Takes the bend of a lens out of images, as many as there are: ``straight = undistorter(image)``.
///
/// Made by `Camera.undistorter`.
///
/// Attributes:
///     size: (width, height) of the images, in pixels.
///     focal: focal of the new image, in pixels.
///     principal_point: (u, v) of the new image, in pixels from its corner.
#[pyclass(frozen, module = "calib")]
#[derive(Debug)]
pub(crate) struct Undistorter {
    camera: Camera,
    /// By its name.
    view: String,
    remap: Remap,
    #[pyo3(get)]
    size: (usize, usize),
    #[pyo3(get)]
    focal: f64,
    #[pyo3(get)]
    principal_point: (f64, f64),
}

/// Which part of the undistorted plane, by its name.
fn crop_of_name(name: &str) -> Option<Crop> {
    match name {
        "same-focal" => Some(Crop::SameFocal),
        "all-valid" => Some(Crop::AllValid),
        "all-pixels" => Some(Crop::AllPixels),
        _ => None,
    }
}

impl Undistorter {
    /// For the images of the stream of a camera.
    pub(crate) fn new(py: Python<'_>, camera: Camera, view: &str) -> PyResult<Self> {
        let expected = "\"same-focal\", \"all-valid\" or \"all-pixels\"";
        let crop = named(py, Some(camera.id()), "view", view, crop_of_name, expected)?;
        let refused = |field: &str, what: &str| refused(py, Some(camera.id()), field, what);
        let Some((lens, size)) = camera.view().lens_in_stream() else {
            let what = "a stretched stream has no one focal: undistort images in the proportion of the still";
            return Err(refused("fit", what));
        };
        let ratio = camera.view().camera().focal / camera.view().camera().lens.focal;
        let made = py.detach(|| Self::made(&camera, view, &lens, ratio, size, crop));
        made.ok_or_else(|| refused("size", "expected images of 2 x 2 to 1.4 gigapixels"))
    }

    fn made(
        camera: &Camera,
        view: &str,
        lens: &Lens,
        ratio: f64,
        size: [f64; 2],
        crop: Crop,
    ) -> Option<Self> {
        let [width, height] = size.map(|side| side as usize);
        let undistortion = calib_core::Undistortion::new(lens, width, height, crop)?;
        let centre = undistortion.principal_point();
        Some(Self {
            camera: camera.clone(),
            view: view.to_owned(),
            remap: undistortion.remap(),
            size: (width, height),
            focal: undistortion.focal(ratio * lens.focal),
            principal_point: (centre.u, centre.v),
        })
    }
}

#[pymethods]
impl Undistorter {
    /// Takes the bend out of an image.
    ///
    /// Args:
    ///     image: uint8 array of the shape (height, width), (height, width, 3) or (height, width, 4), of the
    ///         size of the stream; in any order of colours.
    ///     out: array of the same kind to write to, in place of a new one.
    ///
    /// Returns:
    ///     uint8 array of the same shape; black where the image shows nothing.
    #[pyo3(signature = (image, out=None))]
    fn __call__<'py>(
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
            py.detach(|| self.remap.apply_into(raw, to));
        }
        Ok(straight)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (&str,))> {
        let camera = Bound::new(py, self.camera.clone())?;
        Ok((camera.getattr("undistorter")?, (&self.view,)))
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size;
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
        let (width, height) = self.size;
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
            ref found => {
                return Err(self.refused(py, format_args!("found the shape {found:?}, {expected}")));
            }
        }
        if given.is_c_contiguous() {
            return Ok(given.clone());
        }
        let plain = py.import("numpy")?.call_method1("ascontiguousarray", (given,))?;
        Ok(plain.cast_into::<PyArrayDyn<u8>>()?)
    }
}
