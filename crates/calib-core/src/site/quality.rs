//! How good the site is as a whole: where links and marks are, how far cameras disagree, what hangs
//! together and what does not.

use std::collections::BTreeMap;

use crate::bundle::{LANDMARK_PARAMS, Landmark, LandmarkModel, Observation, OutlierCandidate, triangulate};
use crate::camera::{Camera, Covariance, ObservedPixel, PosedCamera};
use crate::finding::{Code, Failure, Residual, ResidualOf, Warning};
use crate::site::bundle_step::BundleResult;
use crate::site::document::Site;
use crate::site::observations::LandmarkSource;
use crate::site::solution::{ElementSolution, Scale, SeenResidual, Sigmas, SiteSolution, Solution, Stage};

/// Where a landmark is and what every observation of it is off, in pixels.
#[derive(Clone, Debug)]
pub(crate) struct Triangulated {
    model: LandmarkModel,
    place: [f64; LANDMARK_PARAMS],
    seen: Vec<(Observation, f64)>,
}

impl BundleResult {
    /// Every landmark that a camera of the joint fit shows.
    pub(crate) fn triangulated(&self) -> Vec<Option<Triangulated>> {
        let cameras = self.tied_cameras();
        let is_tied = |view: usize| self.cameras[view].as_ref().is_some_and(|joined| joined.is_connected);
        self.landmarks
            .iter()
            .map(|(_, landmark)| {
                let seen: Vec<Observation> =
                    landmark.observations.iter().filter(|seen| is_tied(seen.view)).copied().collect();
                if seen.is_empty() {
                    return None;
                }
                // What is off has no place in the fit: it is where a camera puts it.
                let (model, place) = if landmark.off {
                    triangulate(
                        &Landmark { observations: seen.clone(), ..landmark.clone() },
                        &cameras,
                        &|_| true,
                    )?
                } else {
                    (landmark.model.clone(), landmark.place)
                };
                let off = |seen: Observation| Some((seen, off(&model, &place, &seen, &cameras[seen.view])?));
                let seen = seen.into_iter().filter_map(off).collect();
                Some(Triangulated { seen, model, place })
            })
            .collect()
    }

    fn is_aside(&self, landmark: usize) -> bool {
        self.rejected.contains(&OutlierCandidate::Landmark(landmark))
    }
}

/// Distance of an observation from where its camera shows the landmark, in raw pixels.
fn off(
    model: &LandmarkModel,
    place: &[f64; LANDMARK_PARAMS],
    seen: &Observation,
    camera: &Camera,
) -> Option<f64> {
    let px = match *model {
        LandmarkModel::Line { origin } => {
            let observed = ObservedPixel::new(seen.pixel, &camera.lens, [false; 5])?;
            PosedCamera::new(*camera).reproject_line(origin, place[0], place[1]).distance(&observed).0.abs()
        }
        _ => camera.world_to_pixel(model.point(place, seen.point).0)?.distance(seen.pixel),
    };
    px.is_finite().then_some(px)
}

/// The id that the operator gave, or else its number in the list.
fn name(id: Option<&String>, index: usize) -> String {
    id.cloned().unwrap_or_else(|| index.to_string())
}

/// "a, b, c and 7 more".
fn enumerated(names: &[&str]) -> String {
    const MOST: usize = 6;
    match names.len() {
        0..=MOST => names.join(", "),
        count => format!("{} and {} more", names[..MOST - 1].join(", "), count - MOST + 1),
    }
}

impl Site {
    fn landmark_name(&self, of: LandmarkSource) -> (ResidualOf, String) {
        match of {
            LandmarkSource::Link(i) => (ResidualOf::Link, name(self.links[i].id.as_ref(), i)),
            LandmarkSource::Mark(i) => (ResidualOf::Mark, name(self.marks[i].id.as_ref(), i)),
            LandmarkSource::ControlPoint { camera, point } => {
                let entry = &self.cameras[camera].control_points[point];
                (ResidualOf::ControlPoint, name(entry.id.as_ref(), point))
            }
        }
    }

    /// Writes into every camera what links and marks are off there, and which of its control points
    /// were rejected.
    pub(crate) fn add_shared_residuals(
        &self,
        bundle: &BundleResult,
        triangulated: &[Option<Triangulated>],
        solutions: &mut [(usize, Result<Solution, Failure>)],
    ) {
        let mut d_camera: BTreeMap<usize, &mut Solution> =
            solutions.iter_mut().filter_map(|(index, s)| Some((*index, s.as_mut().ok()?))).collect();
        for (index, ((of, _), triangulated)) in bundle.landmarks.iter().zip(triangulated).enumerate() {
            let (what, id) = self.landmark_name(*of);
            let outlier = bundle.is_aside(index);
            if let LandmarkSource::ControlPoint { camera, .. } = of {
                let Some(solution) = d_camera.get_mut(camera).filter(|_| outlier) else { continue };
                let own = solution.residuals.iter_mut().filter(|r| r.of == what);
                own.filter(|r| r.id.as_ref() == Some(&id)).for_each(|r| r.outlier = true);
                solution.warnings.push(Warning::new(
                    Code::Outlier,
                    format!("Control point {id} contradicts the others and was set aside."),
                    "Check its coordinates and its pixel; \"keep\" has it used all the same.",
                ));
                continue;
            }
            let mut squares: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
            for (seen, px) in triangulated.iter().flat_map(|triangulated| &triangulated.seen) {
                let sum = squares.entry(seen.view).or_default();
                *sum = (sum.0 + px * px, sum.1 + 1.0);
            }
            for (view, (sum, count)) in squares {
                let Some(solution) = d_camera.get_mut(&view) else { continue };
                let (annotation, segment, px) = (None, None, f64::sqrt(sum / count));
                let id = Some(id.clone());
                solution.residuals.push(Residual { of: what, annotation, segment, id, px, outlier });
            }
        }
    }

    /// Where links and marks are that took part, or would have.
    pub(crate) fn elements(
        &self,
        bundle: &BundleResult,
        triangulated: &[Option<Triangulated>],
    ) -> [Vec<Option<ElementSolution>>; 2] {
        let mut links = vec![None; self.links.len()];
        let mut marks = vec![None; self.marks.len()];
        for (index, (of, landmark)) in bundle.landmarks.iter().enumerate() {
            let Some(Triangulated { model, place, seen }) = &triangulated[index] else { continue };
            let mut found = element(model, place, bundle.covariances[index], landmark);
            found.residuals = seen
                .iter()
                .map(|(seen, px)| SeenResidual {
                    camera: self.cameras[seen.view].id.clone(),
                    px: *px,
                    outlier: bundle.is_aside(index),
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

    /// What hangs together, what gives the scale, how far cameras disagree.
    pub(crate) fn quality(
        &self,
        bundle: &BundleResult,
        triangulated: &[Option<Triangulated>],
        solutions: &[(usize, Result<Solution, Failure>)],
    ) -> SiteSolution {
        let id = |&view: &usize| self.cameras[view].id.clone();
        let solved: Vec<usize> =
            solutions.iter().filter(|(_, s)| s.is_ok()).map(|(index, _)| *index).collect();
        let mut components: Vec<Vec<usize>> = bundle
            .components
            .iter()
            .map(|c| {
                let is_fitted =
                    |view: &usize| !bundle.unreached.contains(view) && bundle.cameras[*view].is_some();
                c.views.iter().copied().filter(is_fitted).collect()
            })
            .filter(|views: &Vec<usize>| !views.is_empty())
            .collect();
        let mut warnings = Vec::new();
        let is_shared =
            bundle.landmarks.iter().any(|(of, _)| !matches!(of, LandmarkSource::ControlPoint { .. }));
        if is_shared {
            let alone: Vec<usize> =
                solved.iter().copied().filter(|view| !components.iter().any(|c| c.contains(view))).collect();
            components.extend(alone.iter().map(|&view| vec![view]));
            warnings.extend(self.not_connected(&components, bundle, solutions));
        }
        let unscaled = bundle.components.iter().filter(|c| !c.is_scaled);
        for component in unscaled.clone() {
            let names: Vec<&str> =
                component.views.iter().map(|&view| self.cameras[view].id.as_str()).collect();
            warnings.push(Warning::new(
                Code::ScaleUnknown,
                format!(
                    "Nothing gives the scale of {}: camera {} stands at the height it was placed with.",
                    enumerated(&names),
                    id(&component.root)
                ),
                "Enter one known distance, height or length, or two points of the plan.",
            ));
        }
        if let Some(&first) = bundle.too_many.first() {
            warnings.push(Warning::new(
                Code::UnusedAnnotation,
                format!(
                    "{} cameras, {} among them, share more than can be fitted together: each is solved by itself.",
                    bundle.too_many.len(),
                    id(&first)
                ),
                "Let every link and mark be seen by fewer cameras.",
            ));
        }
        warnings.extend(self.unused_landmarks(bundle));
        let scale = (!bundle.components.is_empty())
            .then(|| if unscaled.count() == 0 { Scale::Known } else { Scale::Unknown });
        warnings.extend(self.rejected_elements(bundle, triangulated));
        SiteSolution {
            components: components.iter().map(|views| views.iter().map(id).collect()).collect(),
            scale,
            loop_closure_m: bundle.loop_closure,
            overlaps: self.overlaps(bundle, solutions),
            warnings,
        }
    }

    fn not_connected(
        &self,
        components: &[Vec<usize>],
        bundle: &BundleResult,
        solutions: &[(usize, Result<Solution, Failure>)],
    ) -> Vec<Warning> {
        let largest = components.iter().max_by_key(|views| views.len());
        let apart = components.iter().filter(|views| Some(*views) != largest);
        let mut warnings: Vec<Warning> = apart
            .map(|views| {
                let names: Vec<&str> = views.iter().map(|&view| self.cameras[view].id.as_str()).collect();
                let unreached = views.iter().all(|view| bundle.unreached.contains(view));
                let by_hand = views.iter().any(|&view| self.cameras[view].placement.is_some());
                let message = match (unreached, by_hand) {
                    (true, _) => format!(
                        "What {} shares with other cameras is too little to place it.",
                        enumerated(&names)
                    ),
                    (false, true) => format!(
                        "Nothing ties {} to the rest of the site: it stands where it was placed.",
                        enumerated(&names)
                    ),
                    (false, false) => format!("Nothing ties {} to the rest of the site.", enumerated(&names)),
                };
                Warning::new(
                    Code::NotConnected,
                    message,
                    "Link two points or more with a camera that is tied, or give control points.",
                )
            })
            .collect();
        // Tied, and yet free to slide: a line along its view, a point behind another.
        for (index, solution) in solutions {
            let Some(camera) =
                solution.as_ref().ok().filter(|s| s.stage == Stage::Refined).and_then(Solution::camera)
            else {
                continue;
            };
            let wide =
                |unknown: usize, limit: f64| camera.covariance.sigma(unknown).is_some_and(|s| s > limit);
            if wide(Covariance::X, 100.0) || wide(Covariance::Y, 100.0) || wide(Covariance::YAW, 1.0) {
                let message = format!("The links of {} leave open where it stands.", self.cameras[*index].id);
                warnings.push(Warning::new(
                    Code::NotConnected,
                    message,
                    "Link points far apart from each other.",
                ));
            }
        }
        warnings
    }

    /// What is there and was not used, with the reason.
    fn unused_landmarks(&self, bundle: &BundleResult) -> Vec<Warning> {
        let name = |landmark: &usize| {
            let (of, id) = self.landmark_name(bundle.landmarks[*landmark].0);
            let what = match of {
                ResidualOf::Mark => "mark",
                ResidualOf::ControlPoint => "control point",
                ResidualOf::Link | ResidualOf::Annotation => "link",
            };
            format!("{what} \"{id}\"")
        };
        let distance = |index: &usize| {
            let [a, b] = &self.distances[*index].between;
            format!("the distance between \"{a}\" and \"{b}\"")
        };
        let camera = |view: &usize| format!("camera {}", self.cameras[*view].id);
        let list = [
            (
                bundle.lost.iter().map(name).collect::<Vec<String>>(),
                "a camera that shows it cannot see anything where the others put it",
                "Check that it is drawn below the horizon, inside the lens, and on the same thing in every view.",
            ),
            (
                bundle.unused.landmarks.iter().map(name).collect(),
                "one camera alone shows it",
                "Draw it in a second camera, or give it a distance to something else.",
            ),
            (
                bundle.unused.distances.iter().map(distance).collect(),
                "an end of it has no place, or its length no \"sigma\" and no \"fixed\"",
                "Measure between links or marks that cameras show, and say how well.",
            ),
            (
                bundle.unfitted.iter().map(camera).collect(),
                "no place was found from which all that is shared can be seen",
                "Switch links and marks off one by one, the farthest first.",
            ),
        ];
        let told = |(names, why, advice): (Vec<String>, &str, &str)| {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let message = format!("Not used: {}; {why}.", enumerated(&names));
            (!names.is_empty()).then(|| Warning::new(Code::UnusedAnnotation, message, advice))
        };
        list.into_iter().filter_map(told).collect()
    }

    fn rejected_elements(
        &self,
        bundle: &BundleResult,
        triangulated: &[Option<Triangulated>],
    ) -> Vec<Warning> {
        let warning = |candidate: &OutlierCandidate| match *candidate {
            OutlierCandidate::Landmark(landmark) => {
                let (of, id) = self.landmark_name(bundle.landmarks[landmark].0);
                let what = match of {
                    ResidualOf::Link => "Link",
                    ResidualOf::Mark => "Mark",
                    ResidualOf::ControlPoint | ResidualOf::Annotation => return None,
                };
                let worst = triangulated[landmark]
                    .as_ref()
                    .and_then(|triangulated| triangulated.seen.iter().max_by(|a, b| a.1.total_cmp(&b.1)));
                let far = worst.map_or(String::new(), |(seen, px)| {
                    format!(" ({px:.0} px in {})", self.cameras[seen.view].id)
                });
                Some(Warning::new(
                    Code::Outlier,
                    format!("{what} \"{id}\" contradicts the others and was set aside{far}."),
                    "Check that every camera shows the same thing there; \"keep\" has it used all the same.",
                ))
            }
            OutlierCandidate::Distance(measurement) => {
                let entry = &self.distances[bundle.measurements[measurement].0];
                let [a, b] = &entry.between;
                Some(Warning::new(
                    Code::Outlier,
                    format!(
                        "The distance between \"{a}\" and \"{b}\" contradicts the rest and was set aside."
                    ),
                    "Check the length and its unit.",
                ))
            }
        };
        bundle.rejected.iter().filter_map(warning).collect()
    }
}

fn element(
    model: &LandmarkModel,
    place: &[f64; LANDMARK_PARAMS],
    covariance: Option<[[f64; LANDMARK_PARAMS]; LANDMARK_PARAMS]>,
    landmark: &Landmark,
) -> ElementSolution {
    let (at, jacobian) = model.anchor(place);
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
