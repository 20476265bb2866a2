//! The site as one problem: which cameras are fitted together, by what, and what came of it.

use std::collections::{BTreeSet, HashMap, HashSet};

use crate::bundle::{
    Adjustment, BundleAdjustment, CAMERA_PARAMS, Component, CrossCovariance, DistanceMeasurement,
    InitialPose, Landmark, OutlierCandidate, ResidualBlock, Start, View, start,
};
use crate::camera::{Camera, POSE_PARAMS, WorldPoint};
use crate::floor::STAGE_1_HEIGHT;
use crate::outcome::Failure;
use crate::single::{Edge, Fitted, LOG_HEIGHT, Prior, Priors, Problem, Source, State, weak_prior};
use crate::site::document::{Site, SiteCamera};
use crate::site::lens_step::edges;
use crate::site::observations::{LandmarkSource, Shared, Unused};
use crate::site::single_step::SingleFit;
use crate::site::solution::Stage;

/// A camera after the joint fit.
#[derive(Clone, Debug)]
pub(crate) struct BundleCamera {
    /// Tied: in the base system. Else where stage 1 has it, with a better lens.
    pub(crate) camera: Camera,
    pub(crate) is_tied: bool,
    pub(crate) chi2: f64,
    pub(crate) dof: i64,
    /// Standard deviation of what was drawn on it, in pixels.
    pub(crate) sigma: f64,
    /// Of its drawings, in pixels.
    pub(crate) residuals: Vec<(Source, f64)>,
    pub(crate) misfit: bool,
}

/// All that the joint fit found.
#[derive(Clone, Debug, Default)]
pub(crate) struct BundleResult {
    /// For every camera of the site that took part.
    pub(crate) cameras: Vec<Option<BundleCamera>>,
    /// Every landmark and what it is in the site, its place improved, switched off if it was rejected.
    pub(crate) landmarks: Vec<(LandmarkSource, Landmark)>,
    /// Covariance of the places of landmarks.
    pub(crate) covariances: Vec<Option<[[f64; 3]; 3]>>,
    pub(crate) measurements: Vec<(usize, DistanceMeasurement)>,
    /// Landmarks and distances rejected, by their index here.
    pub(crate) rejected: Vec<OutlierCandidate>,
    pub(crate) components: Vec<Component>,
    /// Cameras tied to others by too little.
    pub(crate) unreached: Vec<usize>,
    /// Cameras that share so much that no machine fits them together.
    pub(crate) too_many: Vec<usize>,
    /// Cameras that no place suits where everything they share can be seen.
    pub(crate) unfitted: Vec<usize>,
    /// Landmarks that a camera cannot see where the others put them.
    pub(crate) lost: Vec<usize>,
    /// Landmarks and distances that say nothing.
    pub(crate) unused: Unused,
    pub(crate) loop_closure: Option<f64>,
    /// Covariance of pairs of cameras that see landmarks in common.
    pub(crate) pairs: HashMap<[usize; 2], CrossCovariance>,
}

/// What the joint fit knows of one camera before it starts.
struct Member<'a> {
    entry: &'a SiteCamera,
    first: &'a SingleFit,
    /// Where stage 1 has it.
    own: Camera,
    initial_pose: InitialPose,
    height_is_told: bool,
}

impl BundleResult {
    /// The cameras of the joint fit; nobody stands in for those that took no part.
    pub(crate) fn tied_cameras(&self) -> Vec<Camera> {
        let tied = |joined: &Option<BundleCamera>| {
            joined.as_ref().filter(|j| j.is_tied).map_or(ABSENT, |j| j.camera)
        };
        self.cameras.iter().map(tied).collect()
    }

    /// Landmarks that these cameras see, and distances between them.
    fn among(&self, cluster: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let is_seen = |landmark: &Landmark| {
            !landmark.off
                && landmark.observations.iter().any(|seen| cluster.binary_search(&seen.view).is_ok())
        };
        let landmarks: Vec<usize> =
            (0..self.landmarks.len()).filter(|&i| is_seen(&self.landmarks[i].1)).collect();
        let is_between = |measurement: &DistanceMeasurement| {
            !measurement.off
                && measurement.between.iter().all(|landmark| landmarks.binary_search(landmark).is_ok())
        };
        let measurements =
            (0..self.measurements.len()).filter(|&i| is_between(&self.measurements[i].1)).collect();
        (landmarks, measurements)
    }
}

impl Site {
    /// The joint fit of everything that was asked for; without landmarks only of lenses with stage 1.
    pub(crate) fn join(
        &self,
        single_fits: &[Result<SingleFit, Failure>],
        with_landmarks: bool,
    ) -> BundleResult {
        let before: Vec<Option<Member>> = self
            .cameras
            .iter()
            .zip(single_fits)
            .map(|(entry, first)| before(entry, first.as_ref().ok()?))
            .collect();
        let is_there = |camera: usize| before[camera].is_some();
        let Shared { mut landmarks, mut measurements, unused } =
            if with_landmarks { self.shared(single_fits, &is_there) } else { Shared::default() };
        let mut cameras: Vec<Camera> = before.iter().map(|b| b.as_ref().map_or(ABSENT, placed)).collect();
        let initial_poses: Vec<InitialPose> =
            before.iter().map(|b| b.as_ref().map_or(InitialPose::Unknown, |b| b.initial_pose)).collect();
        let told: Vec<bool> = before.iter().map(|b| b.as_ref().is_some_and(|b| b.height_is_told)).collect();
        let held: Vec<Option<f64>> = before
            .iter()
            .map(|b| {
                b.as_ref().and_then(|b| b.first.held.height.filter(|_| b.initial_pose != InitialPose::Fixed))
            })
            .collect();
        let mut started: Vec<Landmark> = landmarks.iter().map(|(_, landmark)| landmark.clone()).collect();
        let distances: Vec<DistanceMeasurement> =
            measurements.iter().map(|(_, measurement)| *measurement).collect();
        let Start { components, unreached, lost, loop_closure } =
            start(&mut cameras, &initial_poses, &mut started, &distances, &told, &held);
        let mut rejected: Vec<OutlierCandidate> = Vec::new();
        for (landmark, started) in landmarks.iter_mut().zip(started) {
            landmark.1 = started;
        }
        for (_, measurement) in &mut measurements {
            measurement.off |= measurement.between.iter().any(|&landmark| landmarks[landmark].1.off);
        }
        let mut bundle = BundleResult {
            cameras: vec![None; self.cameras.len()],
            covariances: vec![None; landmarks.len()],
            landmarks,
            measurements,
            rejected: Vec::new(),
            unreached,
            too_many: Vec::new(),
            unfitted: Vec::new(),
            lost,
            unused,
            loop_closure,
            pairs: HashMap::new(),
            components,
        };
        let groups = self.lens_groups(&before);
        for cluster in clusters(&before, &bundle, &groups) {
            let rejected_elements = self.fit_cluster(&before, &cameras, &groups, &cluster, &mut bundle);
            rejected.extend(rejected_elements);
        }
        bundle.rejected = rejected;
        bundle
    }

    /// Which cameras have one lens: the index of the camera it belongs to.
    fn lens_groups(&self, before: &[Option<Member>]) -> Vec<usize> {
        let owner = |(index, entry): (usize, &SiteCamera)| {
            let like = entry.lens.as_ref().and_then(|lens| lens.like.as_ref())?;
            let owner = self.cameras.iter().position(|other| other.id == *like)?;
            (before[owner].is_some() && before[index].is_some()).then_some(owner)
        };
        self.cameras.iter().enumerate().map(|(index, entry)| owner((index, entry)).unwrap_or(index)).collect()
    }

    /// Fits cameras that hang together by landmarks or by their lens, and writes down what came of it.
    fn fit_cluster(
        &self,
        before: &[Option<Member>],
        cameras: &[Camera],
        groups: &[usize],
        cluster: &[usize],
        bundle: &mut BundleResult,
    ) -> Vec<OutlierCandidate> {
        let local = |camera: usize| cluster.binary_search(&camera).ok();
        let (landmark_indices, measurement_indices) = bundle.among(cluster);
        if has_too_many_pairs(landmark_indices.iter().map(|&i| &bundle.landmarks[i].1)) {
            bundle.too_many.extend(cluster);
            return Vec::new();
        }
        let members: Vec<&Member> = cluster.iter().filter_map(|&camera| before[camera].as_ref()).collect();
        let problems: Vec<Problem> = members.iter().map(|member| stage_1_problem(member)).collect();
        let views: Vec<View> = members
            .iter()
            .zip(&problems)
            .zip(cluster)
            .map(|((member, problem), &camera)| {
                let owner = local(groups[camera]).unwrap_or(0);
                let component = bundle.components.iter().find(|c| c.views.contains(&camera));
                let component = component.filter(|_| !bundle.unreached.contains(&camera));
                view(
                    member,
                    problem,
                    [cameras[camera], cameras[groups[camera]]],
                    members[owner],
                    owner,
                    component.is_none(),
                    is_root(component, camera),
                )
            })
            .collect();
        let noise_is_given = members.iter().map(|member| member.entry.sigma_px.is_some()).collect();
        let landmarks = landmark_indices.iter().map(|&i| {
            let mut landmark = bundle.landmarks[i].1.clone();
            landmark.observations.retain_mut(|seen| local(seen.view).map(|view| seen.view = view).is_some());
            landmark
        });
        let measurements = measurement_indices.iter().map(|&i| {
            let mut measurement = bundle.measurements[i].1;
            measurement.between =
                measurement.between.map(|landmark| landmark_indices.binary_search(&landmark).unwrap_or(0));
            measurement
        });
        let adjustment = BundleAdjustment {
            views,
            landmarks: landmarks.collect(),
            measurements: measurements.collect(),
            noise_is_given,
        };
        let Some(result) = adjustment.adjust() else {
            bundle.unfitted.extend(cluster);
            return Vec::new();
        };
        write_down(&result, &members, cluster, &landmark_indices, bundle);
        result
            .rejected
            .iter()
            .map(|candidate| match *candidate {
                OutlierCandidate::Landmark(landmark) => {
                    bundle.landmarks[landmark_indices[landmark]].1.off = true;
                    OutlierCandidate::Landmark(landmark_indices[landmark])
                }
                OutlierCandidate::Distance(measurement) => {
                    bundle.measurements[measurement_indices[measurement]].1.off = true;
                    OutlierCandidate::Distance(measurement_indices[measurement])
                }
            })
            .collect()
    }
}

/// Whether the cameras share so much that the system would fill the memory of any machine.
fn has_too_many_pairs<'a>(landmarks: impl Iterator<Item = &'a Landmark>) -> bool {
    /// Pairs of cameras that see a landmark in common: 450 cameras, every one with every other.
    const MOST: usize = 100_000;
    let mut pairs = HashSet::new();
    for landmark in landmarks {
        let views = landmark.views();
        if views.len() * views.len() > 2 * MOST {
            return true;
        }
        pairs
            .extend(views.iter().enumerate().flat_map(|(i, &a)| views[i + 1..].iter().map(move |&b| (a, b))));
        if pairs.len() > MOST {
            return true;
        }
    }
    false
}

/// Stands in for a camera without a result; nothing sees it.
pub(crate) const ABSENT: Camera = Camera {
    position: WorldPoint { x: 0.0, y: 0.0, z: STAGE_1_HEIGHT },
    yaw: 0.0,
    pitch: 0.0,
    roll: 0.0,
    focal: 1.0,
    lens: crate::camera::Lens::pinhole(crate::camera::Pixel { u: 0.0, v: 0.0 }),
    covariance: crate::camera::Covariance::EXACT,
};

fn before<'a>(entry: &'a SiteCamera, first: &'a SingleFit) -> Option<Member<'a>> {
    let own = first.result.solution.camera()?;
    if entry.is_given() && first.result.solution.stage <= Stage::Partial {
        // A camera that was imported without its place has none to offer.
        return None;
    }
    let initial_pose = match &entry.placement {
        _ if entry.is_given() => InitialPose::Fixed,
        Some(placement) if placement.fixed => InitialPose::Fixed,
        Some(_) => InitialPose::ByHand,
        None => InitialPose::Unknown,
    };
    first.fit.as_ref().filter(|_| !entry.is_given()).map_or(entry.is_given(), |_| true).then_some(Member {
        entry,
        first,
        own,
        initial_pose,
        height_is_told: first.fit.as_ref().is_some_and(|fit| fit.height_known),
    })
}

/// Where a camera starts: where the operator put it, or where stage 1 has it.
fn placed(before: &Member) -> Camera {
    let own = before.own;
    match &before.entry.placement {
        Some(entry) if !before.entry.is_given() => {
            let placed = entry.placement().apply(&own);
            let told = before.height_is_told && !entry.fixed;
            let z = if told { own.position.z } else { placed.position.z };
            Camera { position: WorldPoint { z, ..placed.position }, ..placed }
        }
        _ => own,
    }
}

/// Cameras that are fitted together: those of a component, and those that have one lens.
fn clusters(before: &[Option<Member>], bundle: &BundleResult, groups: &[usize]) -> Vec<Vec<usize>> {
    let mut sets: Vec<BTreeSet<usize>> = bundle
        .components
        .iter()
        .map(|component| {
            let reached = component.views.iter().filter(|view| !bundle.unreached.contains(view));
            reached.copied().collect()
        })
        .collect();
    for (camera, &owner) in groups.iter().enumerate() {
        let Some(this) = &before[camera] else { continue };
        let fits_lens = !free_coefficients(this).is_empty();
        if owner != camera || fits_lens {
            sets.push(BTreeSet::from([camera, owner]));
        }
    }
    // Sets with a camera in common are one.
    let mut merged: Vec<BTreeSet<usize>> = Vec::new();
    for mut set in sets {
        merged.retain(|other| {
            let is_apart = other.is_disjoint(&set);
            if !is_apart {
                set.extend(other);
            }
            is_apart
        });
        merged.push(set);
    }
    merged.into_iter().filter(|set| !set.is_empty()).map(|set| set.into_iter().collect()).collect()
}

/// Indices of the coefficients that are fitted.
fn free_coefficients(before: &Member) -> Vec<usize> {
    let fitted = before.first.lens_estimate.fit.as_ref().and_then(|fit| fit.fitted.as_ref());
    fitted.map_or(Vec::new(), Fitted::indices)
}

/// What stage 1 left, as a part of the joint fit.
fn stage_1_problem<'a>(before: &Member<'a>) -> Problem<'a> {
    let SingleFit { constraints, held, fit, .. } = before.first;
    let width = before.entry.size()[0];
    let (sigma, rejected, weak_prior_used) =
        fit.as_ref().map_or((1.0, &[][..], false), |fit| (fit.sigma, &fit.outliers[..], fit.weak_prior_used));
    let own = if before.entry.is_given() { Priors::default() } else { before.entry.priors() };
    let weak_log_focal: Option<Prior> = weak_prior_used.then(|| weak_prior(width));
    let priors = Priors { focal: own.focal.filter(|_| held.focal.is_none()), weak_log_focal, ..own };
    Problem { rejected, ..Problem::new(constraints, *held, priors, sigma, width) }
}

/// What of a group's place the camera holds for all of them: place, turn, scale.
fn is_root(component: Option<&Component>, camera: usize) -> [bool; 3] {
    let holds = component.filter(|component| component.root == camera);
    holds.map_or([false; 3], |c| [!c.is_held, !c.is_turned, !c.is_scaled])
}

fn view<'a>(
    before: &Member<'a>,
    problem: &Problem<'a>,
    [start, lens_start]: [Camera; 2],
    owner: &Member,
    lens: usize,
    is_alone: bool,
    [holds_place, holds_turn, holds_scale]: [bool; 3],
) -> View<'a> {
    let is_held = before.initial_pose == InitialPose::Fixed;
    let held = &before.first.held;
    let mut free = [false; CAMERA_PARAMS];
    let stands_free = !is_alone && !is_held;
    free[0] = stands_free && !holds_place;
    free[1] = free[0];
    let may_rise = if is_alone { problem.free[LOG_HEIGHT] } else { !is_held && !holds_scale };
    free[2] = may_rise && held.height.is_none();
    free[3] = stands_free && !holds_turn;
    let is_given = before.entry.is_given();
    free[4] = held.pitch.is_none() && !is_given;
    free[5] = held.roll.is_none() && !is_given;
    free[6] = owner.first.held.focal.is_none() && !owner.entry.is_given();
    for k in free_coefficients(owner) {
        free[POSE_PARAMS + k] = true;
    }
    let fits_lens = free[POSE_PARAMS..].contains(&true);
    let camera = if is_alone { before.own } else { start };
    let distortion = lens_start.lens.distortion;
    let camera = Camera {
        focal: lens_start.focal,
        lens: crate::camera::Lens { distortion, focal: lens_start.lens.focal, ..camera.lens },
        ..camera
    };
    let camera = match held.height.filter(|_| !is_held) {
        Some(z) => Camera { position: WorldPoint { z, ..camera.position }, ..camera },
        None => camera,
    };
    let drawn: Vec<Edge> = if fits_lens { edges(&before.entry.annotations) } else { Vec::new() };
    View {
        camera,
        free,
        lens,
        annotations: &before.entry.annotations,
        stage_1: problem.clone(),
        nuisance: before.first.fit.as_ref().map_or(Vec::new(), |fit| fit.state.nuisance.clone()),
        edges: drawn,
        size: before.entry.size(),
    }
}

fn write_down(
    result: &Adjustment,
    members: &[&Member],
    cluster: &[usize],
    landmark_indices: &[usize],
    bundle: &mut BundleResult,
) {
    let mut drawn: Vec<Vec<(Source, f64)>> = vec![Vec::new(); members.len()];
    for (of, residual) in &result.residuals {
        let ResidualBlock::Annotation { view, source } = of else { continue };
        match drawn[*view].last_mut() {
            Some((last, px)) if last == source => *px = px.hypot(*residual),
            _ => drawn[*view].push((*source, *residual)),
        }
    }
    for (view, (&camera, member)) in cluster.iter().zip(members).enumerate() {
        let is_tied = !bundle.unreached.contains(&camera)
            && bundle.components.iter().any(|component| component.views.contains(&camera));
        let found = result.cameras[view];
        let sigma = member.first.fit.as_ref().map_or(1.0, |fit| fit.sigma);
        let inflation = if member.entry.sigma_px.is_none() { result.inflation } else { 1.0 };
        bundle.cameras[camera] = Some(BundleCamera {
            camera: found,
            is_tied,
            chi2: result.chi2,
            dof: result.dof,
            sigma: sigma * inflation.sqrt(),
            residuals: drawings(&drawn[view], &result.nuisance[view], member, &found),
            misfit: result.misfit,
        });
    }
    for (local, &index) in landmark_indices.iter().enumerate() {
        if let Some(placed) = result.places[local] {
            bundle.landmarks[index].1.place = placed.place;
            bundle.covariances[index] = Some(placed.covariance);
        }
    }
    let pairs = result
        .pairs
        .iter()
        .map(|([a, b], cross_covariance)| ([cluster[*a], cluster[*b]], cross_covariance.clone()));
    bundle.pairs.extend(pairs);
}

/// Residuals of a camera's drawings in pixels, those rejected among them.
fn drawings(
    in_sigmas: &[(Source, f64)],
    nuisance: &[f64],
    member: &Member,
    camera: &Camera,
) -> Vec<(Source, f64)> {
    let sigma = member.first.fit.as_ref().map_or(1.0, |fit| fit.sigma);
    let mut found: Vec<(Source, f64)> = in_sigmas.iter().map(|(source, r)| (*source, r * sigma)).collect();
    let rejected = member.first.fit.as_ref().map_or(&[][..], |fit| &fit.outliers[..]);
    if !rejected.is_empty() {
        let constraints = crate::single::Constraints::new(&member.entry.annotations, &camera.lens, false);
        let parameters =
            [camera.roll, camera.pitch, camera.focal.ln(), camera.position.z.abs().max(1e-9).ln()];
        let shown = crate::single::predictable(&constraints, &parameters);
        let everything = Problem { rejected: &[], constraints: &shown, ..stage_1_problem(member) };
        let all = everything
            .residuals_in_pixels(&State { parameters, nuisance: nuisance.to_vec() })
            .unwrap_or_default();
        found.extend(all.into_iter().filter(|(source, _)| rejected.contains(source)));
    }
    found
}
