//! The result of a bundle adjustment.

use std::collections::HashMap;

use crate::bundle::camera::BundleCamera;
use crate::bundle::converged::{OutlierCandidate, PlaneEstimate};
use crate::bundle::landmark::{DistanceMeasurement, Landmark};
use crate::bundle::marginals::CrossCovariance;
use crate::bundle::refinement::Refined;
use crate::bundle::residuals::ResidualKind;
use crate::bundle::view_graph::Component;
use crate::camera::Camera;
use crate::single::{Constraints, PlanePrior, Problem, Source, State, predictable};

/// A camera after the adjustment.
#[derive(Clone, Debug)]
pub struct CameraEstimate {
    /// With the covariance of what was estimated.
    pub camera: Camera,
    /// It is in the base system, or where its component is not located or oriented, in one system with the
    /// cameras of its component. If not, only its orientation, focal, lens and what its own annotations say
    /// of its height were refined; position and yaw are those it came with.
    pub is_connected: bool,
    /// Sum of the squared residuals, in sigmas, of all that was refined together with it.
    pub chi2: f64,
    /// Number of these residuals minus the number of parameters.
    pub dof: i64,
    /// Standard deviation of what was drawn on it, in pixels: as it was known, or as the residuals have it.
    pub sigma: f64,
    /// Distance of every annotation from its prediction, in pixels, those rejected among them.
    pub residuals: Vec<(Source, f64)>,
    /// The chi-square of what was refined together is too large for the noise, at a level of 1 %, and no
    /// outlier explains it.
    pub is_misfit: bool,
}

/// The result of a bundle adjustment. Indices are those of the adjustment.
#[derive(Clone, Debug, Default)]
pub struct BundleSummary {
    /// Of every camera; `None` where nothing connects it and its lens is not estimated, where it was
    /// [`oversized`](Self::oversized) or [`unsolved`](Self::unsolved).
    pub cameras: Vec<Option<CameraEstimate>>,
    /// Every landmark where it was found; switched off where it was rejected or took no part.
    pub landmarks: Vec<Landmark>,
    /// Covariance of the parameters of every landmark that was refined; zeros for those that are not free.
    pub landmark_covariances: Vec<Option<[[f64; 3]; 3]>>,
    /// Planes that were estimated.
    pub planes: Vec<Option<PlaneEstimate>>,
    /// Every distance; switched off where it was rejected or took no part.
    pub distances: Vec<DistanceMeasurement>,
    /// Outliers.
    pub rejected: Vec<OutlierCandidate>,
    /// The connected components of the view graph.
    pub components: Vec<Component>,
    /// Cameras of a component that share too little with the others to be placed.
    pub unreached: Vec<usize>,
    /// Cameras that share so much that the system of equations would fill the memory of any machine.
    pub oversized: Vec<usize>,
    /// Cameras of a cluster in which not everything that is shared can be seen from anywhere.
    pub unsolved: Vec<usize>,
    /// Landmarks that an observing camera cannot show at the place triangulated from the others.
    pub unobservable: Vec<usize>,
    /// Largest root mean square disagreement on the floor, in metres, that the initialisation left between
    /// two cameras that share landmarks and were not placed one by the other; `None` without loops.
    pub loop_closure: Option<f64>,
    /// Covariance of every two cameras that were refined together, the lower index first; of over 45 cameras, of those
    /// that observe a landmark in common.
    pub cross_covariances: HashMap<[usize; 2], CrossCovariance>,
}

impl BundleSummary {
    /// Whether a camera is placed in its component.
    pub(crate) fn is_connected(&self, camera: usize) -> bool {
        !self.unreached.contains(&camera) && self.components.iter().any(|c| c.views.contains(&camera))
    }

    /// The component of a camera, unless it is not reached in it.
    pub(crate) fn component(&self, camera: usize) -> Option<&Component> {
        let component = self.components.iter().find(|component| component.views.contains(&camera));
        component.filter(|_| !self.unreached.contains(&camera))
    }

    /// Landmarks that these cameras observe, and distances between them.
    pub(crate) fn observed_by(&self, cluster: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let is_observed = |landmark: &Landmark| {
            let mut seen = landmark.observations.iter();
            !landmark.off && seen.any(|seen| cluster.binary_search(&seen.view).is_ok())
        };
        let landmarks: Vec<usize> =
            (0..self.landmarks.len()).filter(|&i| is_observed(&self.landmarks[i])).collect();
        let is_between = |distance: &DistanceMeasurement| {
            let mut ends = distance.between.iter();
            !distance.off && ends.all(|landmark| landmarks.binary_search(landmark).is_ok())
        };
        let distances = (0..self.distances.len()).filter(|&i| is_between(&self.distances[i])).collect();
        (landmarks, distances)
    }

    /// Takes over a refined cluster, of which cameras, landmarks and distances have these indices.
    pub(crate) fn take(
        &mut self,
        refined: Refined,
        of: (&[BundleCamera], &[PlanePrior]),
        [cluster, landmarks, distances]: [&[usize]; 3],
    ) {
        let own = annotation_residuals(&refined, cluster.len());
        for (plane, estimate) in self.planes.iter_mut().zip(&refined.planes) {
            *plane = estimate.or(*plane);
        }
        for (view, &camera) in cluster.iter().enumerate() {
            let estimate =
                CameraEstimate::new(of, &refined, [camera, view], &own[view], self.is_connected(camera));
            self.cameras[camera] = Some(estimate);
        }
        for (estimate, &landmark) in refined.landmarks.iter().zip(landmarks) {
            if let Some(estimate) = estimate {
                let Landmark { model, place, plane, ground, .. } = &mut self.landmarks[landmark];
                (*model, *place) = (estimate.model.clone(), estimate.place);
                let found = plane.and_then(|plane| refined.planes[plane]);
                *ground = found.map_or(*ground, |found| found.plane);
                self.landmark_covariances[landmark] = Some(estimate.covariance);
            }
        }
        for candidate in &refined.rejected {
            self.rejected.push(match *candidate {
                OutlierCandidate::Landmark(landmark) => {
                    self.landmarks[landmarks[landmark]].off = true;
                    OutlierCandidate::Landmark(landmarks[landmark])
                }
                OutlierCandidate::Distance(distance) => {
                    self.distances[distances[distance]].off = true;
                    OutlierCandidate::Distance(distances[distance])
                }
            });
        }
        let pairs = refined.pairs.into_iter();
        self.cross_covariances.extend(pairs.map(|(pair, block)| (pair.map(|view| cluster[view]), block)));
    }
}

impl CameraEstimate {
    fn new(
        (cameras, planes): (&[BundleCamera], &[PlanePrior]),
        refined: &Refined,
        [index, view]: [usize; 2],
        residuals: &[(Source, f64)],
        is_connected: bool,
    ) -> Self {
        let (entry, camera) = (&cameras[index], refined.cameras[view]);
        let inflation = if entry.noise_is_known { 1.0 } else { refined.inflation };
        let sigma = entry.fit.map_or(1.0, |fit| fit.sigma);
        let stage_1 = entry.stage_1();
        let pixels = |&(source, residual): &(Source, f64)| {
            (source, residual * stage_1.sigma_of(source) * entry.constraints.repeats.times(source).sqrt())
        };
        let mut residuals: Vec<(Source, f64)> = residuals.iter().map(pixels).collect();
        residuals.extend(rejected_residuals(entry, &camera, &refined.nuisances[view], planes));
        Self {
            camera,
            is_connected,
            chi2: refined.chi2,
            dof: refined.dof,
            sigma: sigma * inflation.sqrt(),
            residuals,
            is_misfit: refined.is_misfit,
        }
    }
}

/// Residuals of the annotations of every view in sigmas, those of one annotation's parts together.
fn annotation_residuals(refined: &Refined, views: usize) -> Vec<Vec<(Source, f64)>> {
    let mut own: Vec<Vec<(Source, f64)>> = vec![Vec::new(); views];
    for (kind, residual) in &refined.residuals {
        let ResidualKind::Annotation { view, source } = kind else { continue };
        match own[*view].last_mut() {
            Some((last, sum)) if last == source => *sum = sum.hypot(*residual),
            _ => own[*view].push((*source, *residual)),
        }
    }
    own
}

/// Distances in pixels of the annotations that stage 1 rejected from what the refined camera predicts.
fn rejected_residuals(
    entry: &BundleCamera,
    camera: &Camera,
    nuisance: &[f64],
    planes: &[PlanePrior],
) -> Vec<(Source, f64)> {
    let rejected = entry.fit.map_or(&[][..], |fit| &fit.outliers[..]);
    if rejected.is_empty() {
        return Vec::new();
    }
    let scene = entry.constraints.scene;
    let constraints = Constraints::on_planes(entry.annotations, &camera.lens, scene, planes);
    let log_height = camera.position.z.abs().max(1e-9).ln();
    let parameters = [camera.roll, camera.pitch, camera.focal.ln(), log_height];
    let constraints = predictable(&constraints, &parameters);
    let everything = Problem { rejected: &[], constraints: &constraints, ..entry.stage_1() };
    let state = State { parameters, nuisance: nuisance.to_vec() };
    let mut residuals = everything.residuals_in_pixels(&state).unwrap_or_default();
    residuals.retain(|(source, _)| rejected.contains(source));
    residuals
}
