//! Result of a camera before its findings are converted to sentences.

use crate::document::Site;
use crate::english::{Names, suggestion_text};
use crate::solution::{FailureEntry, Solution, SuggestionEntry, Warning};
use calib_core::outcome::{Code, Failure, Finding, Suggestion};
use calib_core::single::SuggestedLine;

/// Numerical result of a camera, with its findings as values instead of sentences.
#[derive(Clone, Debug)]
pub(crate) struct CameraResult {
    /// Solution for the document; its warnings and suggestions are added last.
    pub(crate) solution: Solution,
    pub(crate) findings: Vec<Finding>,
    /// Suggested annotations, the most useful first.
    pub(crate) sketches: Vec<SuggestedLine>,
}

impl CameraResult {
    /// Creates a result without findings.
    pub(crate) const fn new(solution: Solution) -> Self {
        Self { solution, findings: Vec::new(), sketches: Vec::new() }
    }

    /// Returns the most useful suggestion.
    pub(crate) fn suggestion(&self) -> Option<Suggestion> {
        self.sketches.first().map(|sketch| sketch.suggestion)
    }

    /// Converts the result to the solution for the document, and returns the findings. Warnings of an entered
    /// solution come first.
    fn into_document(self, site: &Site, camera: usize) -> (Solution, Vec<Finding>) {
        let Self { mut solution, findings, sketches } = self;
        solution.warnings.extend(site.warnings(Some(camera), &findings));
        let is_height_unknown = |finding: &Finding| {
            matches!(finding, Finding::FocalUnobservable { looks_down: true, good_floor: Some(_), .. })
        };
        solution.heights_known = findings.iter().any(is_height_unknown).then_some(false);
        if let Some((best, others)) = sketches.split_first() {
            let otherwise = others.iter().map(SuggestionEntry::from).collect();
            solution.draw_next = Some(SuggestionEntry { otherwise, ..SuggestionEntry::from(best) });
        }
        (solution, findings)
    }
}

/// Entry of a camera in the document: its solution, or the failure.
pub(crate) type DocumentEntry = Result<Solution, FailureEntry>;

/// Findings about a camera's result, or the failure.
pub(crate) type FindingsOrFailure = Result<Vec<Finding>, Failure>;

impl Site {
    /// Converts findings to warnings of the document.
    pub(crate) fn warnings(&self, camera: Option<usize>, findings: &[Finding]) -> Vec<Warning> {
        findings.iter().map(|finding| self.describe_finding(camera, finding, Names::InFile)).collect()
    }

    /// Converts the result of a camera to its entry in the document, and returns its findings.
    pub(crate) fn to_document(
        &self,
        camera: usize,
        result: Result<CameraResult, Failure>,
    ) -> (DocumentEntry, FindingsOrFailure) {
        match result {
            Ok(result) => {
                let (solution, findings) = result.into_document(self, camera);
                (Ok(solution), Ok(findings))
            }
            Err(failure) => (Err(self.failure_entry(camera, &failure)), Err(failure)),
        }
    }

    /// Converts a failure to its entry. If the annotations belong to another image, the message also contains
    /// this reason, and the advice is about it.
    fn failure_entry(&self, camera: usize, failure: &Failure) -> FailureEntry {
        let mut entry = FailureEntry::from(failure);
        let outside = self.cameras.get(camera).and_then(|camera| self.points_outside(camera));
        if let Some(outside) = outside.filter(|outside| outside.code() == Code::NotThisImage) {
            let Warning { message, advice, .. } =
                self.describe_finding(Some(camera), &outside, Names::InFile);
            entry = FailureEntry { message: format!("{} {message}", entry.message), advice, ..entry };
        }
        entry
    }
}

impl From<&SuggestedLine> for SuggestionEntry {
    fn from(sketch: &SuggestedLine) -> Self {
        Self {
            drawing: Some(sketch.suggestion.annotation),
            kind: sketch.kind,
            message: suggestion_text(&sketch.suggestion),
            segments_px: sketch.segments.clone(),
            floor_length_rel: sketch.suggestion.floor_length_rel,
            otherwise: Vec::new(),
        }
    }
}
