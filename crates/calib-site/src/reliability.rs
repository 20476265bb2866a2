//! Reliability of annotations, control points, links and marks in the result of every camera.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::bundle::Reliability;
use calib_core::outcome::{Failure, Finding, Residual, ResidualOf, Source, is_unchecked};

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
        let mut by_camera: BTreeMap<usize, &mut CameraResult> = solutions
            .iter_mut()
            .filter_map(|(index, result)| Some((*index, result.as_mut().ok()?)))
            .collect();
        for (camera, result) in &mut by_camera {
            let found = bundle.annotation_reliabilities.get(*camera);
            found.iter().for_each(|found| add_to_annotations(result, found));
        }
        let mut unchecked: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
        for (landmark, found) in bundle.landmark_reliabilities.iter().enumerate() {
            let (what, id) = self.landmark_name(bundle.landmarks[landmark].0);
            for (camera, reliability) in found {
                let Some(result) = by_camera.get_mut(camera) else { continue };
                let solution = &mut result.solution;
                let is_own =
                    |residual: &&mut Residual| residual.of == what && residual.id.as_ref() == Some(&id);
                solution.residuals.iter_mut().filter(is_own).for_each(|residual| add(residual, *reliability));
                let height = solution.position_m.map_or(0.0, |position| position.z);
                let Reliability { redundancy, undetectable } = *reliability;
                if what != ResidualOf::ControlPoint && is_unchecked(redundancy, undetectable, height) {
                    unchecked.entry(*camera).or_default().insert(landmark);
                }
            }
        }
        for (camera, landmarks) in unchecked {
            let elements = landmarks.iter().map(|&index| bundle.landmarks[index].0.into()).collect();
            let views = landmarks.iter().flat_map(|&index| bundle.landmarks[index].1.views());
            let others: BTreeSet<usize> = views.filter(|&view| view != camera).collect();
            let cameras = others.into_iter().collect();
            if let Some(result) = by_camera.get_mut(&camera) {
                result.findings.push(Finding::UncheckedLinks { elements, cameras });
            }
        }
    }
}

/// Adds the reliability of annotations to their residuals.
pub(crate) fn add_to_annotations(result: &mut CameraResult, found: &[(Source, Reliability)]) {
    for residual in &mut result.solution.residuals {
        let Some((annotation, segment)) = residual.annotation.zip(residual.segment) else { continue };
        let source = Source { annotation, segment };
        // The list is ascending by source.
        if let Ok(index) = found.binary_search_by_key(&source, |(source, _)| *source) {
            add(residual, found[index].1);
        }
    }
}

/// Adds the reliability of one observation to a residual. If a link or mark has several observations, the residual
/// contains the smallest redundancy number and the largest undetectable displacement of the floor.
fn add(residual: &mut Residual, Reliability { redundancy, undetectable }: Reliability) {
    let redundancy = residual.redundancy.unwrap_or(1.0).min(redundancy);
    let undetectable = residual.undetectable_m.unwrap_or(0.0).max(undetectable);
    (residual.redundancy, residual.undetectable_m) = (Some(redundancy), Some(undetectable));
}
