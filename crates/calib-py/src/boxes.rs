//! Mapping of detection boxes by a camera.

use calib_core::floor::BoxForm;
use numpy::PyUntypedArrayMethods as _;
use pyo3::prelude::*;

use crate::array::{self, Doubles};
use crate::camera::{Camera, Keywords};
use crate::error::value_error;
use crate::mapping::{Triple, extend_shape, outputs};
use crate::stream::named;

impl Camera {
    /// Returns the argument `sigma_px`, a standard deviation in pixels; 1 if it is absent. Fails if it is
    /// invalid.
    pub(crate) fn sigma(&self, py: Python<'_>, sigma_px: Option<&Bound<'_, PyAny>>) -> PyResult<f64> {
        let sigma = array::real(sigma_px, "sigma_px", 1.0)?;
        if sigma < 0.0 {
            return Err(value_error(py, Some(self.id()), "sigma_px", "expected 0 or more pixels"));
        }
        Ok(sigma)
    }

    /// Reads the arguments `boxes` and `form`. Returns the form, the values and the shape of the results.
    fn boxes<'py>(
        &self,
        boxes: &Bound<'py, PyAny>,
        form: &str,
    ) -> PyResult<(BoxForm, Doubles<'py>, Vec<usize>)> {
        let (py, id) = (boxes.py(), Some(self.id()));
        let form =
            named(py, id, "form", form, BoxForm::from_name, "\"xywh\", \"xyxy\", \"cxcywh\" or \"yolo\"")?;
        let boxes = array::doubles(boxes, "boxes")?;
        let shape = match boxes.shape() {
            [shape @ .., 4] => shape.to_vec(),
            [0] => vec![0],
            found => {
                let more = "; for rows such as x1, y1, x2, y2, confidence, class pass boxes[..., :4]";
                let more = if found.last().is_some_and(|&columns| columns > 4) { more } else { "" };
                let what = format!("found the shape {}, expected (..., 4){more}", array::shape_text(found));
                return Err(value_error(py, id, "boxes", what));
            }
        };
        Ok((form, boxes, shape))
    }
}

#[pymethods]
impl Camera {
    /// Maps boxes of a detector to floor points: the foot point of a box is the middle of its lower edge.
    ///
    /// Args: boxes: array of the shape (..., 4), in pixels, or fractions for "yolo". For rows with more
    /// columns pass ``boxes[..., :4]``. height: height of the plane above the floor, in metres. form: "xywh"
    /// (upper left corner, width, height), "xyxy" (upper left and lower right corner), "cxcywh" (centre,
    /// width, height) or "yolo" (centre, width, height as fractions of the stream); required. A box with
    /// exchanged corners gets the status `MISSING`. out, origin, stream_size, fit, crop: as for `to_floor`.
    ///
    /// Returns: (x, y, status), arrays of the shape (...): metres, and statuses as uint8.
    #[pyo3(
        signature = (boxes, height=None, *, form, out=None, **stream),
        text_signature = "($self, boxes, height=0.0, *, form, out=None, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn boxes_to_floor<'py>(
        &self,
        boxes: &Bound<'py, PyAny>,
        height: Option<&Bound<'py, PyAny>>,
        form: &str,
        out: Option<&Bound<'py, PyAny>>,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<Triple<'py>> {
        let (py, view) = (boxes.py(), self.of(stream)?);
        let height = array::real(height, "height", 0.0)?;
        let (form, boxes, shape) = self.boxes(boxes, form)?;
        let (x, y, status) = outputs(py, &shape, out)?;
        {
            let boxes = array::read(&boxes, "boxes")?;
            let (mut x, mut y, mut status) = (array::write(&x)?, array::write(&y)?, array::write(&status)?);
            let (boxes, status) = (boxes.as_slice()?.as_chunks().0, status.as_slice_mut()?);
            let floor = [x.as_slice_mut()?, y.as_slice_mut()?];
            py.detach(|| view.boxes_to_floor(height, (form, boxes), floor, status));
        }
        (x, y, status).into_pyobject(py)
    }

    /// Computes the covariance of the foot points of boxes, in the two parts of `floor_covariance`.
    ///
    /// Args: boxes, form: as for `boxes_to_floor`. sigma_px: standard deviation of each coordinate of the
    /// middle of the lower edge, in pixels of the stream. height: height of the plane above the floor, in
    /// metres. origin, stream_size, fit, crop: kind of pixels, see the class.
    ///
    /// Returns: (pixel, calibration): arrays of the shape (..., 2, 2), in square metres; NaN as for
    /// `floor_covariance`.
    #[pyo3(
        signature = (boxes, sigma_px=None, height=None, *, form, **stream),
        text_signature = "($self, boxes, sigma_px=1.0, height=0.0, *, form, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn boxes_covariance<'py>(
        &self,
        boxes: &Bound<'py, PyAny>,
        sigma_px: Option<&Bound<'py, PyAny>>,
        height: Option<&Bound<'py, PyAny>>,
        form: &str,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<(Doubles<'py>, Doubles<'py>)> {
        let (py, view) = (boxes.py(), self.of(stream)?);
        let (sigma, height) = (self.sigma(py, sigma_px)?, array::real(height, "height", 0.0)?);
        let (form, boxes, shape) = self.boxes(boxes, form)?;
        let shape = extend_shape(&shape, [2, 2]);
        let parts = [array::zeros::<f64>(py, &shape)?, array::zeros::<f64>(py, &shape)?];
        {
            let boxes = array::read(&boxes, "boxes")?;
            let (mut pixel, mut calibration) = (array::write(&parts[0])?, array::write(&parts[1])?);
            let boxes = boxes.as_slice()?.as_chunks().0;
            let to = [pixel.as_slice_mut()?, calibration.as_slice_mut()?].map(|part| part.as_chunks_mut().0);
            py.detach(|| view.boxes_covariances(height, (form, boxes), sigma, to));
        }
        Ok(parts.into())
    }
}
