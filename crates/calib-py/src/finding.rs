//! What is to be said of a calibration, as objects.

use calib_site::FindingEntry;
use pyo3::prelude::*;

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
