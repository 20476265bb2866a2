//! Exception of this package, with the camera and the value that it is about.
//!
//! Also the findings of a calibration as objects.

use calib_site::FindingEntry;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    calib,
    CalibError,
    PyValueError,
    "Invalid argument, file or value.\n\n\
     Attributes:\n    camera: id of the camera with the error, or None.\n    \
     field: name of the argument, or JSON pointer of the value in the site file, or None."
);

/// Sets the default attributes of the exception class, for exceptions that Python code raises without a
/// camera and a field.
pub(crate) fn add_default_attributes(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let class = module.py().get_type::<CalibError>();
    class.setattr("camera", None::<&str>)?;
    class.setattr("field", None::<&str>)
}

/// Returns an exception about a value, with the id of the camera of this value, if any.
pub(crate) fn value_error(
    py: Python<'_>,
    camera: Option<&str>,
    field: &str,
    what: impl std::fmt::Display,
) -> PyErr {
    let place = camera.map_or_else(String::new, |id| format!("camera {id:?}: "));
    let error = CalibError::new_err(format!("{place}{field}: {what}"));
    with_attributes(py, error, camera, Some(field))
}

/// Returns an exception about a site file, with the name of the file as a prefix.
pub(crate) fn site_error(py: Python<'_>, file: &str, error: &calib_site::SiteError) -> PyErr {
    let camera = error.subject.as_ref().map(|about| about.camera.as_str());
    with_attributes(py, CalibError::new_err(format!("{file}{error}")), camera, Some(&error.pointer))
}

/// Returns an exception about a whole camera.
pub(crate) fn camera_error(py: Python<'_>, id: &str, what: impl std::fmt::Display) -> PyErr {
    with_attributes(py, CalibError::new_err(format!("camera {id:?}: {what}")), Some(id), None)
}

fn with_attributes(py: Python<'_>, error: PyErr, camera: Option<&str>, field: Option<&str>) -> PyErr {
    let value = error.value(py);
    match value.setattr("camera", camera).and_then(|()| value.setattr("field", field)) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// Finding about a calibration, for the operator.
///
/// Attributes:
///     camera: id of the camera, or None for a finding about the site.
///     code: code of the finding, such as "weak", from a closed list.
///     severity: "note", "warning" or "error".
///     message: description, one sentence.
///     advice: recommended action, one sentence.
#[pyclass(frozen, eq, hash, get_all, module = "calib")]
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Finding {
    /// Id of the camera, or None for a finding about the site.
    camera: Option<String>,
    /// Code of the finding, such as "weak", from a closed list.
    code: String,
    /// Severity: "note", "warning" or "error".
    severity: String,
    /// Description, one sentence.
    message: String,
    /// Recommended action, one sentence.
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

    /// Restores a finding from the parts of `__reduce__`.
    #[staticmethod]
    #[pyo3(name = "_again")]
    fn restore(camera: Option<&str>, code: &str, severity: &str, message: &str, advice: &str) -> Self {
        Self {
            camera: camera.map(str::to_owned),
            code: code.to_owned(),
            severity: severity.to_owned(),
            message: message.to_owned(),
            advice: advice.to_owned(),
        }
    }
}

/// Constructor arguments of a finding for pickling: camera, code, severity, message, advice.
type Parts<'a> = (Option<&'a str>, &'a str, &'a str, &'a str, &'a str);

impl Finding {
    pub(crate) fn of_entry(entry: &FindingEntry<'_>) -> Self {
        let FindingEntry { camera, code, severity, message, advice } = *entry;
        Self::restore(camera, code, severity.name(), message, advice)
    }
}
