//! The exception of this package, which says about which camera and which value it is.

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
