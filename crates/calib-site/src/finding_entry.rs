//! All that the solutions of a site say, in one list.

use crate::document::Site;
use crate::solution::{FailureEntry, Warning};
use calib_core::outcome::Severity;

/// Something that an operator should know about a calibration, as the site has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FindingEntry<'a> {
    /// The id of the camera that it is about; `None` where it is about the site.
    pub camera: Option<&'a str>,
    /// Which finding, as in files: of [`Code`](calib_core::Code) or of [`FailureCode`](calib_core::FailureCode).
    pub code: &'static str,
    /// How bad it is; a camera without a result is an error.
    pub severity: Severity,
    /// What is so, in a sentence.
    pub message: &'a str,
    /// What to do, in a sentence.
    pub advice: &'a str,
}

impl Site {
    /// What the solutions say of the cameras, in their order, and then of the site.
    pub fn findings(&self) -> impl Iterator<Item = FindingEntry<'_>> {
        let of_cameras = self.cameras.iter().flat_map(|entry| {
            let warnings = entry.solution.iter().flat_map(|solution| &solution.warnings);
            let failures = entry.error.iter().map(|failure| of_failure(&entry.id, failure));
            warnings.map(|warning| of_warning(Some(&entry.id), warning)).chain(failures)
        });
        let of_site = self.solution.iter().flat_map(|solution| &solution.warnings);
        of_cameras.chain(of_site.map(|warning| of_warning(None, warning)))
    }
}

fn of_warning<'a>(
    camera: Option<&'a str>,
    Warning { code, message, advice }: &'a Warning,
) -> FindingEntry<'a> {
    FindingEntry { camera, code: code.as_str(), severity: code.severity(), message, advice }
}

fn of_failure<'a>(
    camera: &'a str,
    FailureEntry { code, message, advice }: &'a FailureEntry,
) -> FindingEntry<'a> {
    FindingEntry { camera: Some(camera), code: code.as_str(), severity: Severity::Error, message, advice }
}
