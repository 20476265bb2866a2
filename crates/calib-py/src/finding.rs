//! What is to be said of a calibration, as objects.

use calib_core::{FailureEntry, Severity, Site, Warning};
use pyo3::prelude::*;
use serde_json::Value;

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
    camera: Option<String>,
    code: String,
    severity: String,
    message: String,
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
        Self::new(camera, code.to_owned(), severity, message, advice)
    }
}

/// Camera, code, severity, message, advice.
type Parts<'a> = (Option<&'a str>, &'a str, &'a str, &'a str, &'a str);

impl Finding {
    fn of_warning(camera: Option<&str>, warning: &Warning) -> Self {
        let severity = match warning.code.severity() {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        Self::new(camera, name(&warning.code), severity, &warning.message, &warning.advice)
    }

    fn of_failure(camera: &str, failure: &FailureEntry) -> Self {
        Self::new(Some(camera), name(&failure.code), "error", &failure.message, &failure.advice)
    }

    fn new(camera: Option<&str>, code: String, severity: &str, message: &str, advice: &str) -> Self {
        let camera = camera.map(str::to_owned);
        Self {
            camera,
            code,
            severity: severity.to_owned(),
            message: message.to_owned(),
            advice: advice.to_owned(),
        }
    }
}

/// As the file has it.
fn name(code: &impl serde::Serialize) -> String {
    match serde_json::to_value(code) {
        Ok(Value::String(name)) => name,
        _ => String::new(),
    }
}

/// Of all cameras, in their order, and then of the site.
pub(crate) fn findings(site: &Site) -> Vec<Finding> {
    let mut found = Vec::new();
    for entry in &site.cameras {
        let id = entry.id.as_str();
        let warnings = entry.solution.iter().flat_map(|solution| &solution.warnings);
        found.extend(warnings.map(|warning| Finding::of_warning(Some(id), warning)));
        found.extend(entry.error.iter().map(|failure| Finding::of_failure(id, failure)));
    }
    let warnings = site.solution.iter().flat_map(|solution| &solution.warnings);
    found.extend(warnings.map(|warning| Finding::of_warning(None, warning)));
    found
}
