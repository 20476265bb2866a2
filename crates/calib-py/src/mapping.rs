//! Methods of a camera that map columns of pixels and points.

use calib_core::{CameraView, Covariance, Status};
use numpy::{PyArrayDyn, PyUntypedArrayMethods as _};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyTuple;

use crate::array::{self, Doubles};
use crate::camera::{Camera, Keywords};
use crate::error::value_error;

pub(crate) type Triple<'py> = Bound<'py, PyTuple>;

/// Members of the Python enumeration `calib.Status`, indexed by their numbers.
static STATUSES: PyOnceLock<Vec<Py<PyAny>>> = PyOnceLock::new();

fn status_of<'py>(py: Python<'py>, code: u8) -> PyResult<Bound<'py, PyAny>> {
    let members = STATUSES.get_or_try_init(py, || {
        let class = py.import("calib")?.getattr("Status")?;
        (0..Status::ALL.len()).map(|code| Ok(class.call1((code,))?.unbind())).collect::<PyResult<_>>()
    })?;
    Ok(members[usize::from(code)].bind(py).clone())
}

impl Camera {
    /// Maps one pixel, given as plain numbers, without creating arrays.
    fn point<'py>(
        py: Python<'py>,
        view: &CameraView,
        height: f64,
        [u, v]: [f64; 2],
    ) -> PyResult<Triple<'py>> {
        let (mut x, mut y, mut status) = ([0.0], [0.0], [0]);
        view.to_floor(height, [&[u], &[v]], [&mut x, &mut y], &mut status);
        (x[0], y[0], status_of(py, status[0])?).into_pyobject(py)
    }

    fn points<'py>(
        py: Python<'py>,
        view: &CameraView,
        height: f64,
        [u, v]: [&Doubles<'py>; 2],
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Triple<'py>> {
        let (x, y, status) = outputs(py, u.shape(), out)?;
        {
            let (u, v) = (array::read(u, "u")?, array::read(v, "v")?);
            let (mut x, mut y, mut status) = (array::write(&x)?, array::write(&y)?, array::write(&status)?);
            let (pixels, status) = ([u.as_slice()?, v.as_slice()?], status.as_slice_mut()?);
            let floor = [x.as_slice_mut()?, y.as_slice_mut()?];
            py.detach(|| view.to_floor(height, pixels, floor, status));
        }
        (x, y, status).into_pyobject(py)
    }
}

impl Camera {
    /// Maps pixels to floor points without statuses.
    fn only_points<'py>(
        py: Python<'py>,
        view: &CameraView,
        height: f64,
        [u, v]: [&Doubles<'py>; 2],
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let [x, y] = match out {
            None => [array::zeros(py, u.shape())?, array::zeros(py, u.shape())?],
            Some(out) => {
                let Ok(pair) = out.extract::<[Bound<'py, PyAny>; 2]>() else {
                    return Err(value_error(py, None, "out", "expected two arrays of float64"));
                };
                let [x, y] = pair.each_ref().map(|one| array::output::<f64>(one, u.shape(), "float64"));
                [x?, y?]
            }
        };
        {
            let (u, v) = (array::read(u, "u")?, array::read(v, "v")?);
            let (mut x, mut y) = (array::write(&x)?, array::write(&y)?);
            let (pixels, floor) = ([u.as_slice()?, v.as_slice()?], [x.as_slice_mut()?, y.as_slice_mut()?]);
            py.detach(|| view.to_floor_points(height, pixels, floor));
        }
        (x, y).into_pyobject(py)
    }
}

pub(crate) type Outputs<'py> = (Doubles<'py>, Doubles<'py>, Bound<'py, PyArrayDyn<u8>>);

/// Returns the arrays that the caller passed as output, or new arrays.
pub(crate) fn outputs<'py>(
    py: Python<'py>,
    shape: &[usize],
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Outputs<'py>> {
    let Some(out) = out else {
        return Ok((array::zeros(py, shape)?, array::zeros(py, shape)?, array::zeros(py, shape)?));
    };
    let Ok((first, second, status)) =
        out.extract::<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)>()
    else {
        return Err(value_error(py, None, "out", "expected three arrays: two of float64, and one of uint8"));
    };
    let double = |value| array::output::<f64>(value, shape, "float64");
    Ok((double(&first)?, double(&second)?, array::output::<u8>(&status, shape, "uint8")?))
}

pub(crate) fn extend_shape<const N: usize>(shape: &[usize], more: [usize; N]) -> Vec<usize> {
    shape.iter().copied().chain(more).collect()
}

#[pymethods]
impl Camera {
    /// Maps pixels to points of the plane ``height`` metres above the floor.
    ///
    /// Args: u, v: numbers or arrays, in pixels. height: height of the plane above the floor, in metres.
    /// status: False omits the statuses, which is faster. out: (x, y, status), or (x, y), for the results:
    /// contiguous arrays of float64, float64 and uint8. origin, stream_size, fit, crop: kind of pixels, see
    /// the class.
    ///
    /// Returns: (x, y, status), or (x, y): metres, and a `Status`, or arrays of the shape of u and v
    /// (statuses as uint8). x and y are NaN if the pixel shows no point of the plane.
    #[pyo3(
        signature = (u, v, height=None, *, status=true, out=None, **stream),
        text_signature = "($self, u, v, height=0.0, *, status=True, out=None, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn to_floor<'py>(
        &self,
        u: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        height: Option<&Bound<'py, PyAny>>,
        status: bool,
        out: Option<&Bound<'py, PyAny>>,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let (py, view) = (u.py(), self.of(stream)?);
        let height = array::real(height, "height", 0.0)?;
        if !status {
            let [u, v] = array::columns([u, v], ["u", "v"])?;
            return Self::only_points(py, &view, height, [&u, &v], out);
        }
        if let (Some(u), Some(v), None) = (array::number(u), array::number(v), out) {
            return Self::point(py, &view, height, [u, v]);
        }
        let [u, v] = array::columns([u, v], ["u", "v"])?;
        Self::points(py, &view, height, [&u, &v], out)
    }

    /// Computes the covariance of the floor points of pixels, in two parts.
    ///
    /// The pixel part is independent between detections. The calibration part is common to all detections of this
    /// camera, so a filter must not average it away.
    ///
    /// Args: u, v: numbers or arrays, in pixels. sigma_px: standard deviation of each coordinate, in pixels
    /// of the stream; one number for all. For different standard deviations, call this with 1 and multiply
    /// the first result by their squares. height: height of the plane above the floor, in metres. origin,
    /// stream_size, fit, crop: kind of pixels, see the class.
    ///
    /// Returns: (pixel, calibration): arrays of the shape (..., 2, 2), in square metres. Both are NaN without
    /// a floor point. The second is also NaN if the errors of the calibration or its scale (`scale_known`)
    /// are unknown.
    #[pyo3(
        signature = (u, v, sigma_px=None, height=None, **stream),
        text_signature = "($self, u, v, sigma_px=1.0, height=0.0, *, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn floor_covariance<'py>(
        &self,
        u: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        sigma_px: Option<&Bound<'py, PyAny>>,
        height: Option<&Bound<'py, PyAny>>,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<(Doubles<'py>, Doubles<'py>)> {
        let (py, view) = (u.py(), self.of(stream)?);
        let (sigma_px, height) = (self.sigma(py, sigma_px)?, array::real(height, "height", 0.0)?);
        let [u, v] = array::columns([u, v], ["u", "v"])?;
        let shape = extend_shape(u.shape(), [2, 2]);
        let parts = [array::zeros::<f64>(py, &shape)?, array::zeros::<f64>(py, &shape)?];
        {
            let (u, v) = (array::read(&u, "u")?, array::read(&v, "v")?);
            let (mut pixel, mut calibration) = (array::write(&parts[0])?, array::write(&parts[1])?);
            let pixels = [u.as_slice()?, v.as_slice()?];
            let to = [pixel.as_slice_mut()?, calibration.as_slice_mut()?].map(|part| part.as_chunks_mut().0);
            py.detach(|| view.covariances(height, pixels, sigma_px, to));
        }
        Ok(parts.into())
    }

    /// Computes the Jacobian of floor points with respect to the parameters of the camera.
    ///
    /// A Schmidt-Kalman filter uses it to include the errors of the calibration, whose covariance is
    /// `covariance`.
    ///
    /// Args:
    ///     u, v: numbers or arrays, in pixels.
    ///     origin, stream_size, fit, crop: kind of pixels, see the class.
    ///
    /// Returns:
    ///     Array of the shape (..., 2, 15), in metres per unit of the parameter; NaN without a floor point.
    #[pyo3(
        signature = (u, v, **stream),
        text_signature = "($self, u, v, *, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn floor_jacobian<'py>(
        &self,
        u: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<Doubles<'py>> {
        let (py, view) = (u.py(), self.of(stream)?);
        let [u, v] = array::columns([u, v], ["u", "v"])?;
        let found = array::zeros::<f64>(py, &extend_shape(u.shape(), [2, Covariance::SIZE]))?;
        {
            let (u, v, mut to) = (array::read(&u, "u")?, array::read(&v, "v")?, array::write(&found)?);
            let (pixels, to) = ([u.as_slice()?, v.as_slice()?], to.as_slice_mut()?);
            let to = to.as_chunks_mut::<{ Covariance::SIZE }>().0.as_chunks_mut::<2>().0;
            py.detach(|| view.floor_jacobians(pixels, to));
        }
        Ok(found)
    }

    /// Projects world points to pixels.
    ///
    /// Args: x, y, z: numbers or arrays, in metres. out: (u, v, status) for the results: contiguous arrays of
    /// float64, float64 and uint8. origin, stream_size, fit, crop: kind of pixels, see the class.
    ///
    /// Returns: (u, v, status): pixels, and a `Status`, or arrays (statuses as uint8). u and v are NaN if the
    /// camera cannot show the point.
    #[pyo3(
        signature = (x, y, z=None, *, out=None, **stream),
        text_signature = "($self, x, y, z=0.0, *, out=None, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn to_pixel<'py>(
        &self,
        x: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
        z: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<Triple<'py>> {
        let (py, view) = (x.py(), self.of(stream)?);
        let floor = pyo3::types::PyFloat::new(py, 0.0).into_any();
        let z = z.unwrap_or(&floor);
        if let (Some(x), Some(y), Some(z), None) = (array::number(x), array::number(y), array::number(z), out)
        {
            let (mut u, mut v, mut status) = ([0.0], [0.0], [0]);
            view.to_pixels([&[x], &[y], &[z]], [&mut u, &mut v], &mut status);
            return (u[0], v[0], status_of(py, status[0])?).into_pyobject(py);
        }
        let space = array::columns([x, y, z], ["x", "y", "z"])?;
        let (u, v, status) = outputs(py, space[0].shape(), out)?;
        {
            let [x, y, z] = &space;
            let (x, y, z) = (array::read(x, "x")?, array::read(y, "y")?, array::read(z, "z")?);
            let (mut u, mut v, mut status) = (array::write(&u)?, array::write(&v)?, array::write(&status)?);
            let (space, status) = ([x.as_slice()?, y.as_slice()?, z.as_slice()?], status.as_slice_mut()?);
            let pixels = [u.as_slice_mut()?, v.as_slice_mut()?];
            py.detach(|| view.to_pixels(space, pixels, status));
        }
        (u, v, status).into_pyobject(py)
    }

    /// Computes the viewing rays of pixels. They start at `position`.
    ///
    /// Args:
    ///     u, v: numbers or arrays, in pixels.
    ///     origin, stream_size, fit, crop: kind of pixels, see the class.
    ///
    /// Returns:
    ///     Array of the shape (..., 3): unit vectors in the axes of the site; NaN outside the lens.
    #[pyo3(
        signature = (u, v, **stream),
        text_signature = "($self, u, v, *, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn rays<'py>(
        &self,
        u: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<Doubles<'py>> {
        let (py, view) = (u.py(), self.of(stream)?);
        let [u, v] = array::columns([u, v], ["u", "v"])?;
        let found = array::zeros::<f64>(py, &extend_shape(u.shape(), [3]))?;
        {
            let (u, v, mut to) = (array::read(&u, "u")?, array::read(&v, "v")?, array::write(&found)?);
            let (pixels, to) = ([u.as_slice()?, v.as_slice()?], to.as_slice_mut()?);
            py.detach(|| view.rays(pixels, to.as_chunks_mut().0));
        }
        Ok(found)
    }

    /// Undistorts pixels: returns their position in a camera with the same focal length and no distortion.
    ///
    /// Args:
    ///     u, v: numbers or arrays, in pixels.
    ///     origin, stream_size, fit, crop: kind of pixels, see the class.
    ///
    /// Returns:
    ///     (u, v): arrays, in pixels of the same stream; NaN outside the lens.
    #[pyo3(
        signature = (u, v, **stream),
        text_signature = "($self, u, v, *, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn undistort<'py>(
        &self,
        u: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        stream: Option<Keywords<'_, 'py>>,
    ) -> PyResult<(Doubles<'py>, Doubles<'py>)> {
        let (py, view) = (u.py(), self.of(stream)?);
        let [u, v] = array::columns([u, v], ["u", "v"])?;
        let straight = [array::zeros::<f64>(py, u.shape())?, array::zeros::<f64>(py, u.shape())?];
        {
            let (u, v) = (array::read(&u, "u")?, array::read(&v, "v")?);
            let (mut to_u, mut to_v) = (array::write(&straight[0])?, array::write(&straight[1])?);
            let (pixels, to) = ([u.as_slice()?, v.as_slice()?], [to_u.as_slice_mut()?, to_v.as_slice_mut()?]);
            py.detach(|| view.undistort(pixels, to));
        }
        Ok(straight.into())
    }
}
