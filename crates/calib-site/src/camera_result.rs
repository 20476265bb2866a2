//! A camera's result before it is put into words.

use crate::document::Site;
use crate::english::{Names, what_to_draw};
use crate::solution::{DrawNext, FailureEntry, Solution, Warning};
use calib_core::outcome::{Code, Failure, Finding, Suggestion};
use calib_core::single::Sketch;

/// The numbers of a camera's result, and what is to be said of them.
#[derive(Clone, Debug)]
pub(crate) struct CameraResult {
    /// What the document has of it; words are added last.
    pub(crate) solution: Solution,
    pub(crate) findings: Vec<Finding>,
    /// The drawing that would help most.
    pub(crate) sketches: Vec<Sketch>,
}

impl CameraResult {
    /// A result of which there is nothing to be said.
    pub(crate) const fn new(solution: Solution) -> Self {
        Self { solution, findings: Vec::new(), sketches: Vec::new() }
    }

    pub(crate) fn suggestion(&self) -> Option<Suggestion> {
        self.sketches.first().map(|sketch| sketch.suggestion)
    }

    /// The solution as the document has it, and the findings. What a given one brings along comes first.
    fn into_document(self, site: &Site, camera: usize) -> (Solution, Vec<Finding>) {
        let Self { mut solution, findings, sketches } = self;
        solution.warnings.extend(site.words(Some(camera), &findings));
        if let Some((best, others)) = sketches.split_first() {
            let otherwise = others.iter().map(DrawNext::from).collect();
            solution.draw_next = Some(DrawNext { otherwise, ..DrawNext::from(best) });
        }
        (solution, findings)
    }
}

/// What the document has of a camera: its solution, or why it has none.
pub(crate) type DocumentEntry = Result<Solution, FailureEntry>;

/// What is to be said of a camera's result, or why it has none.
pub(crate) type FindingsOrFailure = Result<Vec<Finding>, Failure>;

impl Site {
    /// Findings in the words of the document.
    pub(crate) fn words(&self, camera: Option<usize>, findings: &[Finding]) -> Vec<Warning> {
        findings.iter().map(|finding| self.in_english(camera, finding, Names::InFile)).collect()
    }

    /// A camera's result as the document has it, and its findings as values.
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

    /// Why a camera has no result. That what is drawn is of another image explains more than what came of it.
    fn failure_entry(&self, camera: usize, failure: &Failure) -> FailureEntry {
        let mut entry = FailureEntry::from(failure);
        let outside = self.cameras.get(camera).and_then(|camera| self.points_outside(camera));
        if let Some(outside) = outside.filter(|outside| outside.code() == Code::NotThisImage) {
            let Warning { message, advice, .. } = self.in_english(Some(camera), &outside, Names::InFile);
            entry = FailureEntry { message: format!("{} {message}", entry.message), advice, ..entry };
        }
        entry
    }
}

impl From<&Sketch> for DrawNext {
    fn from(sketch: &Sketch) -> Self {
        Self {
            drawing: Some(sketch.suggestion.drawing),
            kind: sketch.kind,
            message: what_to_draw(&sketch.suggestion),
            segments_px: sketch.segments.clone(),
            floor_length_rel: sketch.suggestion.floor_length_rel,
            otherwise: Vec::new(),
        }
    }
}
