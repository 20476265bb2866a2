//! The exception of this package, which says about which camera and which value it is.
//!
//! What is to be said of a calibration, as objects.

use calib_site::FindingEntry;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    calib,
    CalibError,
    PyValueError,
    "What was given cannot be used.\n\n\
     Attributes:\n    camera: id of the camera that it is about, or None.\n    \
     field: name of the argument, or JSON pointer of the value in the site file, or None."
);

/// Instances that nobody told have no camera and no field.
pub(crate) fn declare(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let class = module.py().get_type::<CalibError>();
    class.setattr("camera", None::<&str>)?;
    class.setattr("field", None::<&str>)
}

/// An exception about a value, of a camera or of none.
pub(crate) fn refused(
    py: Python<'_>,
    camera: Option<&str>,
    field: &str,
    what: impl std::fmt::Display,
) -> PyErr {
    let place = camera.map_or_else(String::new, |id| format!("camera {id:?}: "));
    let error = CalibError::new_err(format!("{place}{field}: {what}"));
    about(py, error, camera, Some(field))
}

/// What is wrong with a site file, after the name of the file.
pub(crate) fn of_site(py: Python<'_>, file: &str, error: &calib_site::SiteError) -> PyErr {
    let camera = error.about.as_ref().map(|about| about.camera.as_str());
    about(py, CalibError::new_err(format!("{file}{error}")), camera, Some(&error.pointer))
}

/// An exception about a camera as a whole.
pub(crate) fn of_camera(py: Python<'_>, id: &str, what: impl std::fmt::Display) -> PyErr {
    about(py, CalibError::new_err(format!("camera {id:?}: {what}")), Some(id), None)
}

fn about(py: Python<'_>, error: PyErr, camera: Option<&str>, field: Option<&str>) -> PyErr {
    let value = error.value(py);
    match value.setattr("camera", camera).and_then(|()| value.setattr("field", field)) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// Something that an operator should know about a calibration.
///
/// Attributes:
///     camera: id of the camera that it is about, or None where it is about the site.
///     code: which finding, such as "weak"; the list is closed.
///     severity: "note", "warning" or "error".
///     message: what is so, in a sentence.
///     advice: what to do, in a sentence.
#[pyclass(frozen, eq, hash, get_all, module = "calib")]
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Finding {
    /// Id of the camera that it is about, or None where it is about the site.
    camera: Option<String>,
    /// Which finding, such as "weak"; the list is closed.
    code: String,
    /// "note", "warning" or "error".
    severity: String,
    /// What is so, in a sentence.
    message: String,
    /// What to do, in a sentence.
    advice: String,
}

#[pymethods]
impl Finding {
    fn __repr__(&self) -> String {
        let place = self.camera.as_ref().map_or_else(String::new, |id| format!("camera {id:?}, "));
        format!("<Finding {place}{} ({}): {} {}>", self.code, self.severity, self.message, self.advice)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts<'_>)> {
        let parts = (self.camera.as_deref(), &*self.code, &*self.severity, &*self.message, &*self.advice);
        Ok((py.get_type::<Self>().getattr("_again")?, parts))
    }

    /// What was taken apart by `__reduce__`.
    #[staticmethod]
    #[pyo3(name = "_again")]
    fn again(camera: Option<&str>, code: &str, severity: &str, message: &str, advice: &str) -> Self {
        Self {
            camera: camera.map(str::to_owned),
            code: code.to_owned(),
            severity: severity.to_owned(),
            message: message.to_owned(),
            advice: advice.to_owned(),
        }
    }
}

/// Camera, code, severity, message, advice.
type Parts<'a> = (Option<&'a str>, &'a str, &'a str, &'a str, &'a str);

impl Finding {
    pub(crate) fn of_entry(entry: &FindingEntry<'_>) -> Self {
        let FindingEntry { camera, code, severity, message, advice } = *entry;
        Self::again(camera, code, severity.name(), message, advice)
    }
}
