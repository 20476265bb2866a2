//! Reliability of annotations, control points, links and marks in the result of every camera.

use std::collections::BTreeSet;

use calib_core::bundle::Reliability;
use calib_core::outcome::{Failure, Finding, ResidualOf, Source, Subject};

use crate::bundle_step::BundleResult;
use crate::camera_result::CameraResult;
use crate::document::Site;

impl Site {
    /// Adds the reliability of every observation to the residuals of its camera, and reports links and marks
    /// without redundancy.
    pub(crate) fn add_reliabilities(
        &self,
        bundle: &BundleResult,
        solutions: &mut [(usize, Result<CameraResult, Failure>)],
    ) {
        for (camera, result) in solutions {
            let Ok(result) = result else { continue };
            for (source, reliability) in bundle.annotation_reliabilities.get(*camera).into_iter().flatten() {
                add(result, *reliability, |of, annotation, _| {
                    of == ResidualOf::Annotation && annotation == Some(*source)
                });
            }
            let mut unchecked: Vec<usize> = Vec::new();
            for (index, found) in bundle.landmark_reliabilities.iter().enumerate() {
                let (what, id) = self.landmark_name(bundle.landmarks[index].0);
                for (_, reliability) in found.iter().filter(|(view, _)| view == camera) {
                    add(result, *reliability, |of, _, name| of == what && name == Some(&id));
                    if !reliability.is_checked && what != ResidualOf::ControlPoint {
                        unchecked.push(index);
                    }
                }
            }
            unchecked.dedup();
            result.findings.extend(unchecked_links(bundle, *camera, &unchecked));
        }
    }
}

/// Adds the reliability to the residuals for which `is_of` returns true. Several observations of one element
/// have the least redundancy number and the largest undetectable move.
fn add(
    result: &mut CameraResult,
    reliability: Reliability,
    is_of: impl Fn(ResidualOf, Option<Source>, Option<&String>) -> bool,
) {
    for residual in &mut result.solution.residuals {
        let source = residual.annotation.zip(residual.segment);
        let source = source.map(|(annotation, segment)| Source { annotation, segment });
        if is_of(residual.of, source, residual.id.as_ref()) {
            let redundancy = residual.redundancy.unwrap_or(1.0).min(reliability.redundancy);
            let undetectable = residual.undetectable_m.unwrap_or(0.0).max(reliability.undetectable);
            (residual.redundancy, residual.undetectable_m) = (Some(redundancy), Some(undetectable));
        }
    }
}

/// Returns the finding about unchecked landmarks of a camera, given by their indices.
fn unchecked_links(bundle: &BundleResult, camera: usize, unchecked: &[usize]) -> Option<Finding> {
    let elements: Vec<Subject> = unchecked.iter().map(|&index| bundle.landmarks[index].0.into()).collect();
    let views = unchecked.iter().flat_map(|&index| bundle.landmarks[index].1.views());
    let others: BTreeSet<usize> = views.filter(|&view| view != camera).collect();
    (!elements.is_empty())
        .then(|| Finding::UncheckedLinks { elements, cameras: others.into_iter().collect() })
}
