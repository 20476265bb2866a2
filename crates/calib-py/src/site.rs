//! Site with its cameras, findings and calibration.

use std::path::{Path, PathBuf};

use calib_core::floor::TangentPlane;
use calib_core::{FloorPoint, PlanScale};

use calib_input::FileError;
use calib_site::{CameraLookupError, MAX_BYTES, Method, Options, SiteErrorKind};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use crate::array::{self, Pair};
use crate::camera::Camera;
use crate::error::Finding;
use crate::error::{camera_error, site_error, value_error};

/// Site document: cameras with their annotations and solutions.
///
/// Args: source: the document as a dict (NumPy arrays in it are accepted) or as JSON text. `Site.open` reads
/// a file.
///
/// Raises: CalibError: an invalid value, with its camera and field.
#[pyclass(frozen, eq, module = "calib")]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Site(pub(crate) calib_site::Site);

#[pymethods]
impl Site {
    #[new]
    fn new(source: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (text, is_written) = match source.cast::<PyString>() {
            Ok(text) => (text.to_str()?.to_owned(), true),
            Err(_) => (json(source)?, false),
        };
        if !source.is_instance_of::<PyDict>() && !text.trim_start().starts_with('{') {
            let found = source.repr()?.to_string_lossy().chars().take(60).collect::<String>();
            let what = format!("found {found}, expected a dict or JSON text; `Site.open` reads a file");
            return Err(value_error(source.py(), None, "source", what));
        }
        Self::parse(source.py(), &text, "", is_written)
    }

    /// Reads a site file.
    ///
    /// Args:
    ///     path: text or a path object.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let name = format!("{}: ", path.display());
        let bytes = calib_input::read(&path, MAX_BYTES as u64).map_err(|error| match error {
            FileError::System(error) => os_error(&error, &path),
            other => value_error(py, None, "path", format_args!("{name}{other}")),
        })?;
        let text = calib_input::json_document(bytes)
            .map_err(|why| value_error(py, None, "path", format_args!("{} {why}", path.display())))?;
        Self::parse(py, &text, &name, true)
    }

    /// Returns a calibrated camera.
    ///
    /// Args: id: id of the camera. at: time (RFC 3339, such as "2026-05-01T08:00:00Z", or a datetime with a
    /// time zone); required if the id has several periods, for example because the camera was moved. origin,
    /// stream_size, fit, crop: default kind of pixels of the camera's methods, see `Camera`.
    #[pyo3(
        signature = (id, at=None, **stream),
        text_signature = "($self, id, at=None, *, origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn camera(
        &self,
        py: Python<'_>,
        id: &str,
        at: Option<&Bound<'_, PyAny>>,
        stream: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Camera> {
        let at = at.map(|at| time(at, Some(id))).transpose()?;
        let entry =
            self.0.camera_at(id, at.as_deref()).map_err(|why| self.camera_lookup_error(py, id, &why))?;
        Camera::of_entry(py, &self.0, entry)?.with_stream(stream)
    }

    /// Ids of the calibrated cameras, in the order of the file. An id with several periods appears once.
    #[getter]
    fn cameras(&self) -> Vec<&str> {
        self.0.calibrated()
    }

    /// Findings about the calibration: of the cameras, then of the site.
    #[getter]
    fn findings(&self) -> Vec<Finding> {
        self.0.findings().map(|entry| Finding::of_entry(&entry)).collect()
    }

    /// Converts floor points to pixels of the plan.
    ///
    /// Args:
    ///     x, y: numbers or arrays, in metres.
    ///
    /// Returns:
    ///     (px, py): arrays of the same shape as x and y, in pixels of the plan from its upper left corner, y down.
    fn floor_to_plan<'py>(&self, x: &Bound<'py, PyAny>, y: &Bound<'py, PyAny>) -> PyResult<Pair<'py>> {
        let scale = self.plan(x.py())?;
        let to_plan = |x, y| scale.plan_from_floor(FloorPoint { x, y }).into();
        array::each(x.py(), [x, y], ["x", "y"], to_plan)
    }

    /// Width of a pixel of the plan in metres; None without a plan.
    #[getter]
    fn plan_metres_per_px(&self) -> Option<f64> {
        self.0.plan.as_ref().map(|plan| plan.metres_per_px)
    }

    /// Converts pixels of the plan to floor points.
    ///
    /// Args:
    ///     px, py: numbers or arrays, in pixels of the plan from its upper left corner, y down.
    ///
    /// Returns:
    ///     (x, y): arrays of the same shape as px and py, in metres.
    #[pyo3(signature = (px, py))]
    fn plan_to_floor<'py>(&self, px: &Bound<'py, PyAny>, py: &Bound<'py, PyAny>) -> PyResult<Pair<'py>> {
        let scale = self.plan(px.py())?;
        let to_floor = |px, py| scale.floor_from_plan([px, py].into()).into();
        array::each(px.py(), [px, py], ["px", "py"], to_floor)
    }

    /// Converts floor points to latitude and longitude (WGS84). Raises ValueError for a site without a
    /// georeference.
    ///
    /// Args:
    ///     x, y: numbers or arrays, in metres.
    ///
    /// Returns:
    ///     (lat, lon): arrays of the same shape as x and y, in degrees.
    fn floor_to_geographic<'py>(&self, x: &Bound<'py, PyAny>, y: &Bound<'py, PyAny>) -> PyResult<Pair<'py>> {
        let plane = self.tangent_plane(x.py())?;
        let convert = |x, y| {
            let at = plane.to_geographic(FloorPoint { x, y }.at_height(0.0));
            [at.latitude.to_degrees(), at.longitude.to_degrees()]
        };
        array::each(x.py(), [x, y], ["x", "y"], convert)
    }

    /// Converts latitude and longitude (WGS84) to floor points. Raises ValueError for a site without a
    /// georeference.
    ///
    /// Args:
    ///     lat, lon: numbers or arrays, in degrees.
    ///
    /// Returns:
    ///     (x, y): arrays of the same shape as lat and lon, in metres.
    fn geographic_to_floor<'py>(
        &self,
        lat: &Bound<'py, PyAny>,
        lon: &Bound<'py, PyAny>,
    ) -> PyResult<Pair<'py>> {
        let plane = self.tangent_plane(lat.py())?;
        let convert = |lat: f64, lon: f64| plane.floor_of_degrees([lat, lon]).into();
        array::each(lat.py(), [lat, lon], ["lat", "lon"], convert)
    }

    /// Calibrates the site from its annotations and entered values.
    ///
    /// A camera that cannot be solved does not prevent the others from being solved. The reason is in `findings`.
    ///
    /// Args:
    ///     method: "ml" (maximum likelihood) or "paper".
    ///     refine: whether to refine all cameras jointly.
    ///     prior: whether to use a weak prior on the focal length if the lines do not determine it.
    ///     cameras: ids of the cameras that get a new solution, or None for all.
    ///
    /// Returns:
    ///     A new site that contains the solutions.
    #[pyo3(signature = (*, method="ml", refine=true, prior=true, cameras=None))]
    fn calibrate(
        &self,
        py: Python<'_>,
        method: &str,
        refine: bool,
        prior: bool,
        cameras: Option<Vec<String>>,
    ) -> PyResult<Self> {
        let method = match method {
            "ml" => Method::MaximumLikelihood,
            "paper" => Method::Paper,
            _ => {
                return Err(value_error(
                    py,
                    None,
                    "method",
                    format_args!("found {method:?}, expected \"ml\" or \"paper\""),
                ));
            }
        };
        let unknown = cameras.iter().flatten().find(|id| self.0.cameras.iter().all(|entry| entry.id != **id));
        if let Some(id) = unknown {
            return Err(self.camera_lookup_error(py, id, &CameraLookupError::Unknown));
        }
        let options = Options { method, refine, prior, cameras };
        Ok(Self(py.detach(|| self.0.calibrate(&options).write_into(&self.0))))
    }

    /// Returns the document as JSON text, as in a site file.
    fn to_json(&self) -> String {
        self.0.to_json()
    }

    /// Returns the document as a dict.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("json")?.call_method1("loads", (self.0.to_json(),))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyAny>, (String,)) {
        (py.get_type::<Self>().into_any(), (self.0.to_json(),))
    }

    fn __repr__(&self) -> String {
        let name = self.0.name.as_ref().map_or_else(String::new, |name| format!(" {name:?}"));
        format!("<Site{name}, {} cameras, {} calibrated>", self.0.cameras.len(), self.cameras().len())
    }
}

impl Site {
    /// Returns the site with the cameras that are valid at a time (RFC 3339).
    pub(crate) fn valid_at(&self, py: Python<'_>, at: &str) -> PyResult<calib_site::Site> {
        let mut site = self.0.clone();
        for entry in std::mem::take(&mut site.cameras) {
            if entry.is_valid_at(at).map_err(|why| value_error(py, None, "at", why.message()))? {
                site.cameras.push(entry);
            }
        }
        Ok(site)
    }

    fn plan(&self, py: Python<'_>) -> PyResult<PlanScale> {
        let plan = self.0.plan.as_ref().map(calib_site::Plan::scale);
        plan.ok_or_else(|| {
            value_error(py, None, "plan", "the site has no plan; add \"plan\" with \"metres_per_px\"")
        })
    }

    fn tangent_plane(&self, py: Python<'_>) -> PyResult<TangentPlane> {
        self.0.tangent_plane().ok_or_else(|| {
            let what = "the site has no georeference; add \"georeference\", or two control points with \"lat_deg\" \
                        and \"lon_deg\"";
            value_error(py, None, "georeference", what)
        })
    }

    /// Parses a document. `is_written` is false for text generated from a dict: error messages then omit line and
    /// column.
    fn parse(py: Python<'_>, text: &str, file: &str, is_written: bool) -> PyResult<Self> {
        py.detach(|| calib_site::Site::from_json(text)).map(Self).map_err(|mut error| {
            if let SiteErrorKind::Unreadable { at, .. } = &mut error.kind {
                *at = at.filter(|_| is_written);
            }
            site_error(py, file, &error)
        })
    }

    fn camera_lookup_error(&self, py: Python<'_>, id: &str, why: &CameraLookupError) -> PyErr {
        match why {
            CameraLookupError::Unknown => {}
            CameraLookupError::SeveralPeriods => return camera_error(py, id, format_args!("{why} with at=")),
            CameraLookupError::NotValidThen | CameraLookupError::NotATime => {
                return value_error(py, Some(id), "at", why);
            }
        }
        let ids: Vec<&str> = self.0.cameras.iter().map(|entry| entry.id.as_str()).collect();
        camera_error(py, id, format_args!("{why}; the site has {}", ids.join(", ")))
    }
}

/// Returns an `OSError` with number and file name, like Python's own.
fn os_error(error: &std::io::Error, path: &Path) -> PyErr {
    match error.raw_os_error() {
        Some(number) => {
            let words = error.to_string();
            let words = words.split(" (os error").next().unwrap_or(&words).to_owned();
            PyOSError::new_err((number, words, path.to_owned()))
        }
        None => PyOSError::new_err(format!("{}: {error}", path.display())),
    }
}

/// Converts a Python document to JSON text; arrays become lists.
fn json(source: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = source.py();
    let lists = py.import("operator")?.call_method1("methodcaller", ("tolist",))?;
    let options = PyDict::new(py);
    options.set_item("default", lists)?;
    let text = py.import("json")?.call_method("dumps", (source,), Some(&options)).map_err(|why| {
        let what =
            format!("expected a dict or JSON text of a site (`Site.open` reads a file): {}", why.value(py));
        value_error(py, None, "source", what)
    })?;
    text.extract()
}

/// Converts a time to text; accepts text, or a datetime with a time zone.
pub(crate) fn time(at: &Bound<'_, PyAny>, camera: Option<&str>) -> PyResult<String> {
    if at.is_instance_of::<PyString>() {
        return at.extract();
    }
    let py = at.py();
    let zone = at.getattr("tzinfo").ok();
    if zone.is_none() || !at.hasattr("isoformat")? {
        let what = format!("found {}, expected {TIME_FORMAT}", at.repr()?.to_string_lossy());
        return Err(value_error(py, camera, "at", what));
    }
    if zone.is_some_and(|zone| zone.is_none()) {
        let what =
            format!("found {} without a time zone, expected {TIME_FORMAT}", at.str()?.to_string_lossy());
        return Err(value_error(py, camera, "at", what));
    }
    at.call_method0("isoformat")?.extract()
}

const TIME_FORMAT: &str = "text such as \"2026-05-01T08:00:00Z\", or a datetime with a time zone, such as \
                      datetime.now(timezone.utc)";
