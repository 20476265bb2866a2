//! Quality of the solved site: positions of links and marks, disagreement between cameras, connected
//! components of the view graph, scale.
//!
//! The file also contains the findings about a camera's pose that do not depend on the method.

use std::collections::BTreeMap;

use calib_core::bundle::{
    DistanceMeasurement, LANDMARK_PARAMS, Landmark, LandmarkModel, Observation, OutlierCandidate, triangulate,
};
use calib_core::camera::{Camera, Covariance, ObservedPixel, Pixel, PosedCamera};
use calib_core::floor::{default_efov, efov_on_floor};
use calib_core::outcome::{
    Code, DisconnectionReason, Failure, Finding, Residual, ResidualOf, Subject, UnusedReason,
};

use crate::bundle_step::BundleResult;
use crate::camera_result::CameraResult;
use crate::document::{Site, SiteCamera};
use crate::observations::LandmarkSource;
use crate::site_solution::{ElementSolution, ObservationResidual, Scale, SiteSolution};
use crate::solution::{Sigmas, Stage};

/// Landmark at its estimated position, with the residual of each observation, in pixels.
#[derive(Clone, Debug)]
pub(crate) struct Triangulated {
    landmark: Landmark,
    seen: Vec<(Observation, f64)>,
}

impl BundleResult {
    /// Returns every landmark with its residuals in the jointly solved cameras; `None` if no such camera
    /// observes it.
    pub(crate) fn triangulated(&self) -> Vec<Option<Triangulated>> {
        let cameras = self.connected_cameras();
        let is_tied = |view: usize| self.cameras[view].as_ref().is_some_and(|joined| joined.is_connected);
        self.landmarks
            .iter()
            .map(|(_, landmark)| {
                let seen: Vec<Observation> =
                    landmark.observations.iter().filter(|seen| is_tied(seen.view)).copied().collect();
                if seen.is_empty() {
                    return None;
                }
                // A landmark that is switched off is not part of the fit, so it is triangulated here.
                let (model, place) = if landmark.off {
                    triangulate(
                        &Landmark { observations: seen.clone(), ..landmark.clone() },
                        &cameras,
                        &|_| true,
                    )?
                } else {
                    (landmark.model.clone(), landmark.params)
                };
                let landmark = Landmark { model, params: place, ..landmark.clone() };
                let off = |seen: Observation| {
                    Some((seen, reprojection_error(&landmark, &seen, &cameras[seen.view])?))
                };
                let seen = seen.into_iter().filter_map(off).collect();
                Some(Triangulated { seen, landmark })
            })
            .collect()
    }

    /// Whether a landmark was rejected as an outlier, by its index.
    fn is_rejected(&self, landmark: usize) -> bool {
        self.rejected.contains(&OutlierCandidate::Landmark(landmark))
    }
}

/// Returns the distance between an observation and the projected landmark, in raw pixels.
fn reprojection_error(landmark: &Landmark, seen: &Observation, camera: &Camera) -> Option<f64> {
    let (place, ground) = (&landmark.params, &landmark.ground);
    let px = match landmark.model {
        LandmarkModel::Line { origin } => {
            let observed = ObservedPixel::new(seen.pixel, &camera.lens)?;
            PosedCamera::new(*camera)
                .reproject_line(ground, origin, place[0], place[1])
                .distance(&observed)
                .pixels
                .abs()
        }
        _ => camera.world_to_pixel(landmark.point(seen.point))?.distance(seen.pixel),
    };
    px.is_finite().then_some(px)
}

impl From<LandmarkSource> for Subject {
    fn from(source: LandmarkSource) -> Self {
        match source {
            LandmarkSource::Link(i) => Self::Link(i),
            LandmarkSource::Mark(i) => Self::Mark(i),
            LandmarkSource::ControlPoint { camera, point } => Self::ControlPoint { camera, point },
        }
    }
}

impl Site {
    pub(crate) fn landmark_name(&self, of: LandmarkSource) -> (ResidualOf, String) {
        match of {
            LandmarkSource::Link(i) => (ResidualOf::Link, self.links[i].label(i)),
            LandmarkSource::Mark(i) => (ResidualOf::Mark, self.marks[i].label(i)),
            LandmarkSource::ControlPoint { camera, point } => {
                let entry = &self.cameras[camera].control_points[point];
                (ResidualOf::ControlPoint, entry.label(point))
            }
        }
    }

    /// Adds the residuals of links and marks to every camera, and marks rejected control points.
    pub(crate) fn add_shared_residuals(
        &self,
        bundle: &BundleResult,
        triangulated: &[Option<Triangulated>],
        solutions: &mut [(usize, Result<CameraResult, Failure>)],
    ) {
        let mut by_camera: BTreeMap<usize, &mut CameraResult> =
            solutions.iter_mut().filter_map(|(index, s)| Some((*index, s.as_mut().ok()?))).collect();
        for (index, ((of, _), triangulated)) in bundle.landmarks.iter().zip(triangulated).enumerate() {
            let (what, id) = self.landmark_name(*of);
            let outlier = bundle.is_rejected(index);
            if let LandmarkSource::ControlPoint { camera, point } = *of {
                let Some(result) = by_camera.get_mut(&camera).filter(|_| outlier) else { continue };
                let own = result.solution.residuals.iter_mut().filter(|r| r.of == what);
                own.filter(|r| r.id.as_ref() == Some(&id)).for_each(|r| r.outlier = true);
                let is_explained = |finding: &Finding| matches!(finding, Finding::ExchangedControlPoints { points } if points.contains(&point));
                if !result.findings.iter().any(is_explained) {
                    result.findings.push(Finding::ControlPointOutlier { camera, point });
                }
                continue;
            }
            let mut squares: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
            for (seen, px) in triangulated.iter().flat_map(|triangulated| &triangulated.seen) {
                let sum = squares.entry(seen.view).or_default();
                *sum = (sum.0 + px * px, sum.1 + 1.0);
            }
            for (view, (sum, count)) in squares {
                let Some(result) = by_camera.get_mut(&view) else { continue };
                let id = Some(id.clone());
                let residual = Residual::new(what, f64::sqrt(sum / count));
                result.solution.residuals.push(Residual { id, outlier, ..residual });
            }
        }
    }

    /// Returns the results of the links and marks with observations by connected cameras.
    pub(crate) fn elements(
        &self,
        bundle: &BundleResult,
        triangulated: &[Option<Triangulated>],
    ) -> [Vec<Option<ElementSolution>>; 2] {
        let mut links = vec![None; self.links.len()];
        let mut marks = vec![None; self.marks.len()];
        for (index, (of, _)) in bundle.landmarks.iter().enumerate() {
            let Some(Triangulated { landmark, seen }) = &triangulated[index] else { continue };
            let mut found = element_solution(landmark, bundle.covariances[index]);
            found.residuals = seen
                .iter()
                .map(|(seen, px)| ObservationResidual {
                    camera: self.cameras[seen.view].id.clone(),
                    px: *px,
                    outlier: bundle.is_rejected(index),
                })
                .collect();
            match of {
                LandmarkSource::Link(i) => links[*i] = Some(found),
                LandmarkSource::Mark(i) => marks[*i] = Some(found),
                LandmarkSource::ControlPoint { .. } => {}
            }
        }
        [links, marks]
    }

    /// Computes components, scale, overlaps and covariances of the site, with findings.
    pub(crate) fn quality(
        &self,
        bundle: &BundleResult,
        triangulated: &[Option<Triangulated>],
        solutions: &[(usize, Result<CameraResult, Failure>)],
    ) -> (SiteSolution, Vec<Finding>) {
        let id = |&view: &usize| self.cameras[view].id.clone();
        let solved: Vec<usize> =
            solutions.iter().filter(|(_, s)| s.is_ok()).map(|(index, _)| *index).collect();
        let mut components: Vec<Vec<usize>> = bundle
            .components
            .iter()
            .map(|c| {
                let is_fitted =
                    |view: &usize| !bundle.unplaced.contains(view) && bundle.cameras[*view].is_some();
                c.views.iter().copied().filter(is_fitted).collect()
            })
            .filter(|views: &Vec<usize>| !views.is_empty())
            .collect();
        let mut findings = Vec::new();
        let is_shared =
            bundle.landmarks.iter().any(|(of, _)| !matches!(of, LandmarkSource::ControlPoint { .. }));
        if is_shared {
            let alone: Vec<usize> =
                solved.iter().copied().filter(|view| !components.iter().any(|c| c.contains(view))).collect();
            components.extend(alone.iter().map(|&view| vec![view]));
            findings.extend(self.not_connected(&components, bundle, solutions));
        }
        let unscaled = bundle.components.iter().filter(|c| !c.is_scaled);
        findings.extend(unscaled.clone().map(|component| Finding::ScaleUnknown {
            cameras: component.views.clone(),
            root: component.root,
        }));
        if let Some(&first) = bundle.too_many.first() {
            findings.push(Finding::TooManyCameras { count: bundle.too_many.len(), first });
        }
        findings.extend(unused_landmarks(bundle));
        let scale = (!bundle.components.is_empty())
            .then(|| if unscaled.count() == 0 { Scale::Known } else { Scale::Unknown });
        findings.extend(rejected_elements(bundle, triangulated));
        let solution = SiteSolution {
            components: components.iter().map(|views| views.iter().map(id).collect()).collect(),
            scale,
            loop_closure_m: bundle.loop_closure,
            overlaps: self.overlaps(bundle, solutions),
            cross_covariances: self.cross_covariances(bundle, solutions),
            georeference: None,
            warnings: Vec::new(),
        };
        (solution, findings)
    }

    /// Returns findings about all groups of connected cameras except the largest, and about cameras with an
    /// undetermined position.
    fn not_connected(
        &self,
        components: &[Vec<usize>],
        bundle: &BundleResult,
        solutions: &[(usize, Result<CameraResult, Failure>)],
    ) -> Vec<Finding> {
        let largest = components.iter().max_by_key(|views| views.len());
        let apart = components.iter().filter(|views| Some(*views) != largest);
        let mut findings: Vec<Finding> = apart
            .map(|views| {
                let unreached = views.iter().all(|view| bundle.unplaced.contains(view));
                let by_hand = views.iter().any(|&view| self.cameras[view].placement.is_some());
                let why = match (unreached, by_hand) {
                    (true, _) => DisconnectionReason::TooFewLandmarks,
                    (false, true) => DisconnectionReason::PlacedByOperator,
                    (false, false) => DisconnectionReason::NoLandmarks,
                };
                Finding::NotConnected { cameras: views.clone(), reason: why }
            })
            .collect();
        // A connected camera may have an undetermined position: for example, from a line along the view, or
        // from two points behind each other.
        let slides = |result: &CameraResult| {
            let camera = Some(&result.solution).filter(|s| s.stage == Stage::Refined)?.camera()?;
            let wide =
                |unknown: usize, limit: f64| camera.covariance.sigma(unknown).is_some_and(|s| s > limit);
            Some(wide(Covariance::X, 100.0) || wide(Covariance::Y, 100.0) || wide(Covariance::YAW, 1.0))
        };
        let sliding = solutions
            .iter()
            .filter(|(_, result)| result.as_ref().ok().and_then(slides) == Some(true))
            .map(|&(camera, _)| Finding::UndeterminedPosition { camera });
        findings.extend(sliding);
        findings
    }
}

/// Returns findings about unused landmarks, distances and cameras, with the reason.
fn unused_landmarks(bundle: &BundleResult) -> impl Iterator<Item = Finding> {
    let landmarks = |list: &[usize]| -> Vec<Subject> {
        // Stage 1 uses the marks in `single_marks`, so they are not reported as unused.
        let is_unused = |of: &LandmarkSource| match of {
            LandmarkSource::Mark(mark) => !bundle.single_marks.contains(mark),
            LandmarkSource::ControlPoint { .. } | LandmarkSource::Link(_) => true,
        };
        let sources = list.iter().map(|&landmark| bundle.landmarks[landmark].0);
        sources.filter(is_unused).map(Subject::from).collect()
    };
    let list = [
        (landmarks(&bundle.unobservable), UnusedReason::NotVisible),
        (landmarks(&bundle.unused.landmarks), UnusedReason::SingleView),
        (
            bundle.unused.distances.iter().copied().map(Subject::Distance).collect(),
            UnusedReason::UnknownLengthOrEnd,
        ),
        (bundle.unsolved.iter().copied().map(Subject::Camera).collect(), UnusedReason::NoPoses),
    ];
    list.into_iter()
        .filter(|(what, _)| !what.is_empty())
        .map(|(what, why)| Finding::Unused { subjects: what, reason: why })
}

/// Returns findings about links, marks and distances that were rejected as outliers.
fn rejected_elements(
    bundle: &BundleResult,
    triangulated: &[Option<Triangulated>],
) -> impl Iterator<Item = Finding> {
    let finding = |candidate: &OutlierCandidate| match *candidate {
        OutlierCandidate::Landmark(landmark) => {
            let element = Subject::from(bundle.landmarks[landmark].0);
            let worst = triangulated[landmark]
                .as_ref()
                .and_then(|triangulated| triangulated.seen.iter().max_by(|a, b| a.1.total_cmp(&b.1)));
            let worst = worst.map(|(seen, px)| (seen.view, *px));
            // Rejected control points are reported with their cameras.
            let is_element = matches!(element, Subject::Link(_) | Subject::Mark(_));
            is_element.then_some(Finding::ElementOutlier { element, worst })
        }
        OutlierCandidate::Distance(measurement) => {
            let (distance, DistanceMeasurement { between, length, .. }) = bundle.measurements[measurement];
            let [a, b] = between.map(|landmark| bundle.landmarks[landmark].1.position());
            let lengths = [length.value, a.distance(b)];
            Some(Finding::DistanceOutlier { distance, lengths })
        }
    };
    bundle.rejected.iter().filter_map(finding)
}

/// Converts a landmark and the covariance of its parameters to the result of a link or mark.
fn element_solution(
    landmark: &Landmark,
    covariance: Option<[[f64; LANDMARK_PARAMS]; LANDMARK_PARAMS]>,
) -> ElementSolution {
    let Landmark { model, params: place, ground, .. } = landmark;
    let (at, jacobian) = model.anchor(place, ground);
    let turn = match model {
        LandmarkModel::Mark { .. } => Some(place[2]),
        LandmarkModel::Line { .. } => Some(place[1]),
        LandmarkModel::Point { .. } | LandmarkModel::Post | LandmarkModel::Measured => None,
    };
    let sigma = |jacobian: &[f64; LANDMARK_PARAMS]| {
        let covariance = covariance?;
        let variance: f64 = (0..LANDMARK_PARAMS)
            .flat_map(|i| (0..LANDMARK_PARAMS).map(move |j| (i, j)))
            .map(|(i, j)| jacobian[i] * covariance[i][j] * jacobian[j])
            .sum();
        (variance > 0.0).then(|| variance.sqrt())
    };
    let turn_index = if matches!(model, LandmarkModel::Line { .. }) { 1 } else { 2 };
    let mut by_turn = [0.0; LANDMARK_PARAMS];
    by_turn[turn_index] = 1.0;
    let sigmas = Sigmas {
        x_m: sigma(&jacobian[0]),
        y_m: sigma(&jacobian[1]),
        yaw_deg: turn
            .filter(|_| landmark.free[turn_index])
            .and_then(|_| sigma(&by_turn))
            .map(f64::to_degrees),
        ..Sigmas::default()
    };
    ElementSolution {
        at_m: at,
        turn_deg: turn.map(f64::to_degrees),
        length_m: (*model == LandmarkModel::Post).then_some(place[2]),
        sigma: (sigmas != Sigmas::default()).then_some(sigmas),
        residuals: Vec::new(),
    }
}

impl SiteCamera {
    /// Returns findings about the current pose that do not depend on the annotations. They report a camera
    /// below the floor, an image without visible floor, or an unknown uncertainty.
    #[must_use]
    pub fn pose_findings(&self) -> Vec<Finding> {
        self.camera().map_or_else(Vec::new, |camera| self.findings_at(&camera))
    }

    /// Returns the findings of [`Self::pose_findings`] for a given camera.
    pub(crate) fn findings_at(&self, camera: &Camera) -> Vec<Finding> {
        let height = camera.position.z;
        let mut findings = Vec::new();
        if height < 0.0 {
            findings.push(Finding::BelowFloor { height });
        }
        if !shows_floor(camera, self.efov_px.as_deref(), self.size()) {
            findings.push(Finding::NoFloor);
        }
        if !camera.covariance.is_known() {
            findings.push(if self.is_given() {
                Finding::NoStandardDeviations
            } else {
                Finding::UncertaintyUnknown
            });
        }
        // A finding that is not recomputed would be added to an imported camera again by every solve.
        debug_assert!(findings.iter().all(|finding| is_recomputed(finding.code())));
        findings
    }
}

/// Whether findings with this code are recomputed instead of taken from a stored solution. These are all
/// findings of [`SiteCamera::pose_findings`], and the findings about annotations outside the image.
pub(crate) const fn is_recomputed(code: Code) -> bool {
    matches!(
        code,
        Code::BelowFloor
            | Code::NoFloor
            | Code::UncertaintyUnknown
            | Code::PointsOutside
            | Code::NotThisImage
    )
}

/// Whether the camera shows floor inside its EFOV, or inside its image without an EFOV.
fn shows_floor(camera: &Camera, efov: Option<&[Pixel]>, size: [f64; 2]) -> bool {
    let polygon = match efov {
        Some(corners) => efov_on_floor(camera, corners).polygon,
        None => default_efov(camera, size).polygon,
    };
    !polygon.is_empty()
}
