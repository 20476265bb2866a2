//! The site as one problem: which cameras are fitted together, by what, and what came of it.

use std::collections::{BTreeSet, HashMap, HashSet};

use crate::bundle::{
    Across, Adjusted, Component, Gap, Network, Of, Stand, Start, Suspect, Tie, VIEW, View, start,
};
use crate::camera::{Camera, POSE, WorldPoint};
use crate::finding::Failure;
use crate::floor::STAGE_1_HEIGHT;
use crate::single::{Edge, Fitted, LOG_HEIGHT, Prior, Priors, Problem, Source, State, weak_belief};
use crate::site::document::{Site, SiteCamera};
use crate::site::lens_step::edges;
use crate::site::observations::{Muted, Shared, TieOf};
use crate::site::single_step::First;
use crate::site::solution::Stage;

/// A camera after the joint fit.
#[derive(Clone, Debug)]
pub(crate) struct Joined {
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
pub(crate) struct Together {
    /// For every camera of the site that took part.
    pub(crate) cameras: Vec<Option<Joined>>,
    /// Every tie and what it is in the site, its place improved, switched off if it was set aside.
    pub(crate) ties: Vec<(TieOf, Tie)>,
    /// Covariance of the places of ties.
    pub(crate) covariances: Vec<Option<[[f64; 3]; 3]>>,
    pub(crate) gaps: Vec<(usize, Gap)>,
    /// Ties and distances set aside, by their index here.
    pub(crate) aside: Vec<Suspect>,
    pub(crate) components: Vec<Component>,
    /// Cameras tied to others by too little.
    pub(crate) unreached: Vec<usize>,
    /// Cameras that share so much that no machine fits them together.
    pub(crate) too_many: Vec<usize>,
    /// Cameras that no place suits where everything they share can be seen.
    pub(crate) unfitted: Vec<usize>,
    /// Ties that a camera cannot see where the others put them.
    pub(crate) lost: Vec<usize>,
    /// Ties and distances that say nothing.
    pub(crate) muted: Muted,
    pub(crate) loop_closure: Option<f64>,
    /// Covariance of pairs of cameras that see things in common.
    pub(crate) pairs: HashMap<[usize; 2], Across>,
}

/// What the joint fit knows of one camera before it starts.
struct Before<'a> {
    entry: &'a SiteCamera,
    first: &'a First,
    /// Where stage 1 has it.
    own: Camera,
    stand: Stand,
    height_is_told: bool,
}

impl Together {
    /// The cameras of the joint fit; nobody stands in for those that took no part.
    pub(crate) fn tied_cameras(&self) -> Vec<Camera> {
        let tied =
            |joined: &Option<Joined>| joined.as_ref().filter(|j| j.is_tied).map_or(NOBODY, |j| j.camera);
        self.cameras.iter().map(tied).collect()
    }

    /// Ties that these cameras see, and distances between them.
    fn among(&self, cluster: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let is_seen = |tie: &Tie| {
            !tie.off && tie.sightings.iter().any(|seen| cluster.binary_search(&seen.view).is_ok())
        };
        let ties: Vec<usize> = (0..self.ties.len()).filter(|&i| is_seen(&self.ties[i].1)).collect();
        let is_between =
            |gap: &Gap| !gap.off && gap.between.iter().all(|tie| ties.binary_search(tie).is_ok());
        let gaps = (0..self.gaps.len()).filter(|&i| is_between(&self.gaps[i].1)).collect();
        (ties, gaps)
    }
}

impl Site {
    /// The joint fit of everything that was asked for; without ties only of lenses with stage 1.
    pub(crate) fn join(&self, firsts: &[Result<First, Failure>], with_ties: bool) -> Together {
        let before: Vec<Option<Before>> = self
            .cameras
            .iter()
            .zip(firsts)
            .map(|(entry, first)| before(entry, first.as_ref().ok()?))
            .collect();
        let is_there = |camera: usize| before[camera].is_some();
        let Shared { mut ties, mut gaps, muted } =
            if with_ties { self.shared(firsts, &is_there) } else { Shared::default() };
        let mut cameras: Vec<Camera> = before.iter().map(|b| b.as_ref().map_or(NOBODY, placed)).collect();
        let stands: Vec<Stand> =
            before.iter().map(|b| b.as_ref().map_or(Stand::Nowhere, |b| b.stand)).collect();
        let told: Vec<bool> = before.iter().map(|b| b.as_ref().is_some_and(|b| b.height_is_told)).collect();
        let held: Vec<Option<f64>> = before
            .iter()
            .map(|b| b.as_ref().and_then(|b| b.first.held.height.filter(|_| b.stand != Stand::Held)))
            .collect();
        let mut things: Vec<Tie> = ties.iter().map(|(_, tie)| tie.clone()).collect();
        let distances: Vec<Gap> = gaps.iter().map(|(_, gap)| *gap).collect();
        let Start { components, unreached, lost, loop_closure } =
            start(&mut cameras, &stands, &mut things, &distances, &told, &held);
        let mut aside: Vec<Suspect> = Vec::new();
        for (tie, thing) in ties.iter_mut().zip(things) {
            tie.1 = thing;
        }
        for (_, gap) in &mut gaps {
            gap.off |= gap.between.iter().any(|&tie| ties[tie].1.off);
        }
        let mut together = Together {
            cameras: vec![None; self.cameras.len()],
            covariances: vec![None; ties.len()],
            ties,
            gaps,
            aside: Vec::new(),
            unreached,
            too_many: Vec::new(),
            unfitted: Vec::new(),
            lost,
            muted,
            loop_closure,
            pairs: HashMap::new(),
            components,
        };
        let groups = self.lens_groups(&before);
        for cluster in clusters(&before, &together, &groups) {
            let set_aside = self.fit_cluster(&before, &cameras, &groups, &cluster, &mut together);
            aside.extend(set_aside);
        }
        together.aside = aside;
        together
    }

    /// Which cameras have one lens: the index of the camera it belongs to.
    fn lens_groups(&self, before: &[Option<Before>]) -> Vec<usize> {
        let owner = |(index, entry): (usize, &SiteCamera)| {
            let like = entry.lens.as_ref().and_then(|lens| lens.like.as_ref())?;
            let owner = self.cameras.iter().position(|other| other.id == *like)?;
            (before[owner].is_some() && before[index].is_some()).then_some(owner)
        };
        self.cameras.iter().enumerate().map(|(index, entry)| owner((index, entry)).unwrap_or(index)).collect()
    }

    /// Fits cameras that hang together by ties or by their lens, and writes down what came of it.
    fn fit_cluster(
        &self,
        before: &[Option<Before>],
        cameras: &[Camera],
        groups: &[usize],
        cluster: &[usize],
        together: &mut Together,
    ) -> Vec<Suspect> {
        let local = |camera: usize| cluster.binary_search(&camera).ok();
        let (tie_indices, gap_indices) = together.among(cluster);
        if has_too_many_pairs(tie_indices.iter().map(|&i| &together.ties[i].1)) {
            together.too_many.extend(cluster);
            return Vec::new();
        }
        let members: Vec<&Before> = cluster.iter().filter_map(|&camera| before[camera].as_ref()).collect();
        let problems: Vec<Problem> = members.iter().map(|member| stage_1_problem(member)).collect();
        let views: Vec<View> = members
            .iter()
            .zip(&problems)
            .zip(cluster)
            .map(|((member, problem), &camera)| {
                let owner = local(groups[camera]).unwrap_or(0);
                let component = together.components.iter().find(|c| c.views.contains(&camera));
                let component = component.filter(|_| !together.unreached.contains(&camera));
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
        let ties = tie_indices.iter().map(|&i| {
            let mut tie = together.ties[i].1.clone();
            tie.sightings.retain_mut(|seen| local(seen.view).map(|view| seen.view = view).is_some());
            tie
        });
        let gaps = gap_indices.iter().map(|&i| {
            let mut gap = together.gaps[i].1;
            gap.between = gap.between.map(|tie| tie_indices.binary_search(&tie).unwrap_or(0));
            gap
        });
        let network = Network { views, ties: ties.collect(), gaps: gaps.collect(), noise_is_given };
        let Some(adjusted) = network.adjust() else {
            together.unfitted.extend(cluster);
            return Vec::new();
        };
        write_down(&adjusted, &members, cluster, &tie_indices, together);
        adjusted
            .aside
            .iter()
            .map(|suspect| match *suspect {
                Suspect::Tie(tie) => {
                    together.ties[tie_indices[tie]].1.off = true;
                    Suspect::Tie(tie_indices[tie])
                }
                Suspect::Gap(gap) => {
                    together.gaps[gap_indices[gap]].1.off = true;
                    Suspect::Gap(gap_indices[gap])
                }
            })
            .collect()
    }
}

/// Whether the cameras share so much that the system would fill the memory of any machine.
fn has_too_many_pairs<'a>(ties: impl Iterator<Item = &'a Tie>) -> bool {
    /// Pairs of cameras that see a thing in common: 450 cameras, every one with every other.
    const MOST: usize = 100_000;
    let mut pairs = HashSet::new();
    for tie in ties {
        let views = tie.views();
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
pub(crate) const NOBODY: Camera = Camera {
    position: WorldPoint { x: 0.0, y: 0.0, z: STAGE_1_HEIGHT },
    yaw: 0.0,
    pitch: 0.0,
    roll: 0.0,
    focal: 1.0,
    lens: crate::camera::Lens::pinhole(crate::camera::Pixel { u: 0.0, v: 0.0 }),
    covariance: crate::camera::Covariance::EXACT,
};

fn before<'a>(entry: &'a SiteCamera, first: &'a First) -> Option<Before<'a>> {
    let own = first.solution.camera()?;
    if entry.is_given() && first.solution.stage <= Stage::Partial {
        // A camera that was imported without its place has none to offer.
        return None;
    }
    let stand = match &entry.placement {
        _ if entry.is_given() => Stand::Held,
        Some(placement) if placement.fixed => Stand::Held,
        Some(_) => Stand::ByHand,
        None => Stand::Nowhere,
    };
    first.fit.as_ref().filter(|_| !entry.is_given()).map_or(entry.is_given(), |_| true).then_some(Before {
        entry,
        first,
        own,
        stand,
        height_is_told: first.fit.as_ref().is_some_and(|fit| fit.height_known),
    })
}

/// Where a camera starts: where the operator put it, or where stage 1 has it.
fn placed(before: &Before) -> Camera {
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
fn clusters(before: &[Option<Before>], together: &Together, groups: &[usize]) -> Vec<Vec<usize>> {
    let mut sets: Vec<BTreeSet<usize>> = together
        .components
        .iter()
        .map(|component| {
            let reached = component.views.iter().filter(|view| !together.unreached.contains(view));
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
fn free_coefficients(before: &Before) -> Vec<usize> {
    let fitted = before.first.optics.fit.as_ref().and_then(|fit| fit.fitted.as_ref());
    fitted.map_or(Vec::new(), Fitted::indices)
}

/// What stage 1 left, as a part of the joint fit.
fn stage_1_problem<'a>(before: &Before<'a>) -> Problem<'a> {
    let First { evidence, held, fit, .. } = before.first;
    let width = before.entry.size()[0];
    let (sigma, aside, believed) =
        fit.as_ref().map_or((1.0, &[][..], false), |fit| (fit.sigma, &fit.outliers[..], fit.believed));
    let own = if before.entry.is_given() { Priors::default() } else { before.entry.priors() };
    let weak_log_focal: Option<Prior> = believed.then(|| weak_belief(width));
    let priors = Priors { focal: own.focal.filter(|_| held.focal.is_none()), weak_log_focal, ..own };
    Problem { aside, ..Problem::new(evidence, *held, priors, sigma, width) }
}

/// What of a group's place the camera holds for all of them: place, turn, scale.
fn is_root(component: Option<&Component>, camera: usize) -> [bool; 3] {
    let holds = component.filter(|component| component.root == camera);
    holds.map_or([false; 3], |c| [!c.is_held, !c.is_turned, !c.is_scaled])
}

fn view<'a>(
    before: &Before<'a>,
    problem: &Problem<'a>,
    [start, lens_start]: [Camera; 2],
    owner: &Before,
    lens: usize,
    is_alone: bool,
    [holds_place, holds_turn, holds_scale]: [bool; 3],
) -> View<'a> {
    let is_held = before.stand == Stand::Held;
    let held = &before.first.held;
    let mut free = [false; VIEW];
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
        free[POSE + k] = true;
    }
    let fits_lens = free[POSE..].contains(&true);
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
    adjusted: &Adjusted,
    members: &[&Before],
    cluster: &[usize],
    tie_indices: &[usize],
    together: &mut Together,
) {
    let mut drawn: Vec<Vec<(Source, f64)>> = vec![Vec::new(); members.len()];
    for (of, residual) in &adjusted.residuals {
        let Of::Drawing { view, source } = of else { continue };
        match drawn[*view].last_mut() {
            Some((last, px)) if last == source => *px = px.hypot(*residual),
            _ => drawn[*view].push((*source, *residual)),
        }
    }
    for (view, (&camera, member)) in cluster.iter().zip(members).enumerate() {
        let is_tied = !together.unreached.contains(&camera)
            && together.components.iter().any(|component| component.views.contains(&camera));
        let found = adjusted.cameras[view];
        let sigma = member.first.fit.as_ref().map_or(1.0, |fit| fit.sigma);
        let inflation = if member.entry.sigma_px.is_none() { adjusted.inflation } else { 1.0 };
        together.cameras[camera] = Some(Joined {
            camera: found,
            is_tied,
            chi2: adjusted.chi2,
            dof: adjusted.dof,
            sigma: sigma * inflation.sqrt(),
            residuals: drawings(&drawn[view], &adjusted.nuisance[view], member, &found),
            misfit: adjusted.misfit,
        });
    }
    for (local, &index) in tie_indices.iter().enumerate() {
        if let Some(placed) = adjusted.places[local] {
            together.ties[index].1.place = placed.place;
            together.covariances[index] = Some(placed.covariance);
        }
    }
    let pairs = adjusted.pairs.iter().map(|([a, b], across)| ([cluster[*a], cluster[*b]], across.clone()));
    together.pairs.extend(pairs);
}

/// Residuals of a camera's drawings in pixels, those set aside among them.
fn drawings(
    in_sigmas: &[(Source, f64)],
    nuisance: &[f64],
    member: &Before,
    camera: &Camera,
) -> Vec<(Source, f64)> {
    let sigma = member.first.fit.as_ref().map_or(1.0, |fit| fit.sigma);
    let mut found: Vec<(Source, f64)> = in_sigmas.iter().map(|(source, r)| (*source, r * sigma)).collect();
    let aside = member.first.fit.as_ref().map_or(&[][..], |fit| &fit.outliers[..]);
    if !aside.is_empty() {
        let evidence = crate::single::Evidence::new(&member.entry.annotations, &camera.lens, false);
        let core = [camera.roll, camera.pitch, camera.focal.ln(), camera.position.z.abs().max(1e-9).ln()];
        let shown = crate::single::predictable(&evidence, &core);
        let everything = Problem { aside: &[], evidence: &shown, ..stage_1_problem(member) };
        let all =
            everything.residuals_in_pixels(&State { core, nuisance: nuisance.to_vec() }).unwrap_or_default();
        found.extend(all.into_iter().filter(|(source, _)| aside.contains(source)));
    }
    found
}
