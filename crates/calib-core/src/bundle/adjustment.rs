//! The joint fit as a whole: the minimum, wrong ties, beliefs, sigmas.

use nalgebra::DMatrix;

use crate::bundle::landmark::{Gap, PLACE, Tie};
use crate::bundle::parameters::VIEW;
use crate::bundle::problem::{Joint, Of, View};
use crate::camera::{Camera, Covariance};
use crate::optimize::{BlockCovariance, Reached, least_squares};
use crate::single::{LEVEL, OPEN_FOCAL, Prior, chi2_score, inflation, is_misfit, stands_out};

/// Steps of one run; a start along a spanning tree is near.
const ROUNDS: usize = 60;
/// Share of the information of its own residuals that an unknown gets on top, so that what they leave
/// open together has a large variance and not an infinite one.
const OPEN: f64 = 1e-12;

/// Something that may be set aside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Suspect {
    /// A tie, by its index.
    Tie(usize),
    /// A measured distance, by its index.
    Gap(usize),
}

/// Where a thing is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placed {
    pub(crate) place: [f64; PLACE],
    /// Of the unknowns of the place; zeros for those held.
    pub(crate) covariance: [[f64; PLACE]; PLACE],
}

/// What the joint fit found.
#[derive(Clone, Debug)]
pub(crate) struct Adjusted {
    /// With the covariance of what was estimated.
    pub(crate) cameras: Vec<Camera>,
    /// Of ties that were used.
    pub(crate) places: Vec<Option<Placed>>,
    pub(crate) chi2: f64,
    pub(crate) dof: i64,
    /// By which the variances of what was drawn are multiplied.
    pub(crate) inflation: f64,
    /// Ties and distances that were set aside.
    pub(crate) aside: Vec<Suspect>,
    /// The evidence contradicts itself, and nothing that may be set aside explains it.
    pub(crate) misfit: bool,
    /// Every residual in sigmas.
    pub(crate) residuals: Vec<(Of, f64)>,
    /// Directions and lengths of stage 1, of every camera.
    pub(crate) nuisance: Vec<Vec<f64>>,
    /// Covariance of cameras that see things in common, for the first and the second of a pair.
    pub(crate) pairs: Vec<([usize; 2], Across)>,
}

/// Covariance of the unknowns of one camera with those of another, as [`Covariance`] has them.
pub(crate) type Across = Box<[[f64; VIEW]; VIEW]>;

/// A state of a joint problem that is a minimum.
struct Settled<'a> {
    joint: Joint<'a>,
    state: Vec<f64>,
    chi2: f64,
    dof: i64,
    /// Where something had to be asked of it already.
    covariance: Option<BlockCovariance>,
}

/// Everything that is known together: cameras, lenses, ties and distances, and the noise.
#[derive(Clone, Debug)]
pub(crate) struct Network<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) ties: Vec<Tie>,
    pub(crate) gaps: Vec<Gap>,
    /// Whose drawing noise was given; where all of it was, a chi-square is a judgement.
    pub(crate) noise_is_given: Vec<bool>,
}

impl Network<'_> {
    fn noise_is_known(&self) -> bool {
        self.noise_is_given.iter().all(|&given| given)
    }

    /// The joint fit; `None` where the start is impossible.
    pub(crate) fn adjust(&self) -> Option<Adjusted> {
        let mut aside = Vec::new();
        let mut settled = self.settle(&aside)?;
        // Every wrong tie costs a search; many wrong ones are a misfit that the operator must see.
        let most = (self.ties.len() / 10).clamp(1, 20);
        while aside.len() < most && settled.is_suspicious() {
            let Some((suspect, without)) = self.culprit(&settled, &aside) else { break };
            let explains = !is_misfit(without.chi2, without.dof);
            let count = self.ties.len() + self.gaps.len();
            let stark = stands_out(settled.chi2, without.chi2, without.dof, count);
            if !(stark || explains && (self.noise_is_known() || aside.is_empty())) {
                break;
            }
            aside.push(suspect);
            settled = without;
        }
        Some(self.finish(settled, aside))
    }

    /// Ties and distances with some of them set aside.
    fn without(&self, aside: &[Suspect]) -> (Vec<Tie>, Vec<Gap>) {
        let (mut ties, mut gaps) = (self.ties.clone(), self.gaps.clone());
        for suspect in aside {
            match *suspect {
                Suspect::Tie(tie) => {
                    ties[tie].off = true;
                    gaps.iter_mut().filter(|gap| gap.between.contains(&tie)).for_each(|gap| gap.off = true);
                }
                Suspect::Gap(gap) => gaps[gap].off = true,
            }
        }
        (ties, gaps)
    }

    /// The minimum without what is set aside. The weak belief about a focal enters where nothing else
    /// tells it, links included.
    fn settle(&self, aside: &[Suspect]) -> Option<Settled<'_>> {
        let believed: Vec<Option<Prior>> =
            self.views.iter().map(|view| view.stage_1.priors.weak_log_focal).collect();
        let with = |which: &dyn Fn(usize) -> bool| {
            let mut views = self.views.clone();
            for (index, view) in views.iter_mut().enumerate() {
                view.stage_1.priors.weak_log_focal = believed[index].filter(|_| which(index));
            }
            let (ties, gaps) = self.without(aside);
            Joint::new(views, ties, gaps)
        };
        if believed.iter().all(Option::is_none) {
            return settled(with(&|_| false));
        }
        let Some(alone) = settled(with(&|_| false)) else { return settled(with(&|_| true)) };
        let asked: Vec<(usize, (usize, usize))> = (0..self.views.len())
            .filter(|&view| believed[view].is_some())
            .filter_map(|view| Some((view, alone.joint.slots(view)[Covariance::FOCAL]?)))
            .collect();
        let covariance = alone.covariance();
        let mut open = vec![false; self.views.len()];
        for (view, (block, place)) in asked {
            let own = covariance.as_ref().map(|known| known.block(&alone.joint.blocks, block, block));
            // A focal is as sure as the variance of its log; not a number is not sure.
            open[view] = !own.is_some_and(|own| own[(place, place)] < OPEN_FOCAL * OPEN_FOCAL);
        }
        if open.contains(&true) {
            settled(with(&|view| open[view]))
        } else {
            Some(Settled { covariance, ..alone })
        }
    }

    /// What the rest agrees best without, with the minimum there.
    fn culprit(&self, settled: &Settled, aside: &[Suspect]) -> Option<(Suspect, Settled<'_>)> {
        // Exact where it is cheap; a big network has the redundancy to show it by the residual alone.
        let most = (4000 / settled.joint.blocks.unknowns().max(1)).clamp(1, 8);
        let mut suspects = settled.suspects();
        suspects.truncate(most);
        let tried = suspects.into_iter().filter_map(|suspect| {
            let without: Vec<Suspect> = aside.iter().copied().chain([suspect]).collect();
            let found = self.settle(&without)?;
            (found.dof >= 1).then_some((suspect, found))
        });
        tried.min_by(|a, b| {
            let score = |found: &Settled| chi2_score(found.chi2, found.dof);
            score(&a.1).total_cmp(&score(&b.1))
        })
    }

    fn finish(&self, mut settled: Settled, aside: Vec<Suspect>) -> Adjusted {
        let covariance = settled.covariance.take().or_else(|| settled.covariance());
        let Settled { joint, state, chi2, dof, .. } = settled;
        let misfit = is_misfit(chi2, dof);
        let inflation = if self.noise_is_known() { 1.0 } else { inflation(chi2, dof) };
        let mut residuals = Vec::new();
        let _ = joint.each_residual(&state, |residual, _, of| residuals.push((of, residual)));
        let mut cameras: Vec<Camera> = (0..joint.views.len())
            .map(|view| {
                let camera = joint.camera(&state, view);
                let is_free = joint.slots(view)[Covariance::YAW].is_some();
                let yaw = if is_free { wrapped(camera.yaw) } else { camera.yaw };
                Camera { yaw, covariance: Covariance::EXACT, ..camera }
            })
            .collect();
        // Noise that was given is used as it is.
        let inflated = |views: [usize; 2]| -> f64 {
            views.iter().map(|&view| if self.noise_is_given[view] { 1.0 } else { inflation.sqrt() }).product()
        };
        let mut pairs = Vec::new();
        if let Some(covariance) = &covariance {
            let all: Vec<Across> = (0..cameras.len())
                .map(|view| across(&joint, covariance, [view, view], &cameras, inflated([view, view])))
                .collect();
            for (camera, own) in cameras.iter_mut().zip(all) {
                camera.covariance = Covariance(*own);
            }
            let coupled: std::collections::BTreeSet<[usize; 2]> = joint
                .ties
                .iter()
                .filter(|tie| !tie.off)
                .flat_map(|tie| {
                    let views = tie.views();
                    let pairs = |i: usize| views[i + 1..].iter().map(|&b| [views[i], b]).collect::<Vec<_>>();
                    (0..views.len()).flat_map(pairs).collect::<Vec<_>>()
                })
                .collect();
            pairs = coupled
                .into_iter()
                .map(|pair| (pair, across(&joint, covariance, pair, &cameras, inflated(pair))))
                .collect();
        }
        let placed = |tie: usize| {
            (!joint.ties[tie].off).then(|| Placed {
                place: joint.place(&state, tie),
                covariance: covariance.as_ref().map_or([[0.0; PLACE]; PLACE], |covariance| {
                    place_covariance(&joint, covariance, tie, inflation)
                }),
            })
        };
        let places = (0..joint.ties.len()).map(placed).collect();
        let nuisance = (0..joint.views.len()).map(|view| joint.nuisance(&state, view)).collect();
        Adjusted { nuisance, cameras, places, chi2, dof, inflation, aside, misfit, residuals, pairs }
    }
}

/// The same angle between minus and plus half a turn.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

fn settled(joint: Joint<'_>) -> Option<Settled<'_>> {
    let Reached { state, cost: chi2, .. } = least_squares(&joint, joint.start(), ROUNDS)?;
    let dof = joint.dof(&state)?;
    Some(Settled { joint, state, chi2, dof, covariance: None })
}

impl Settled<'_> {
    fn covariance(&self) -> Option<BlockCovariance> {
        self.joint.blocks.covariance(self.joint.normal(&self.state)?, OPEN)
    }

    /// What may be set aside with its chi-square and its spare residuals, the worst first.
    fn scores(&self) -> Vec<(Suspect, f64)> {
        let mut ties = vec![0.0; self.joint.ties.len()];
        let mut gaps = vec![0.0; self.joint.gaps.len()];
        let _ = self.joint.each_residual(&self.state, |residual, _, of| match of {
            Of::Sighting { tie, .. } | Of::Place { tie } => ties[tie] += residual * residual,
            Of::Gap { gap } => gaps[gap] += residual * residual,
            Of::Drawing { .. } | Of::Edge { .. } | Of::Belief => {}
        });
        let tie = |(index, tie): (usize, &Tie)| {
            let free = !tie.off && !tie.keep && tie.spare() > 0;
            free.then(|| (Suspect::Tie(index), chi2_score(ties[index], tie.spare())))
        };
        let gap = |(index, gap): (usize, &Gap)| {
            (!gap.off && !gap.keep).then(|| (Suspect::Gap(index), chi2_score(gaps[index], 1)))
        };
        let mut scores: Vec<(Suspect, f64)> = self.joint.ties.iter().enumerate().filter_map(tie).collect();
        scores.extend(self.joint.gaps.iter().enumerate().filter_map(gap));
        scores.sort_by(|a, b| b.1.total_cmp(&a.1));
        scores
    }

    fn suspects(&self) -> Vec<Suspect> {
        self.scores().into_iter().map(|(suspect, _)| suspect).collect()
    }

    /// The whole is too far off for drawing noise, or one of the ties is, as the worst of so many.
    fn is_suspicious(&self) -> bool {
        let scores = self.scores();
        let worst = scores.first().map_or(0.0, |(_, score)| *score);
        let limit = (LEVEL * LEVEL + 2.0 * (scores.len().max(1) as f64).ln()).sqrt();
        is_misfit(self.chi2, self.dof) || worst > limit
    }
}

/// Covariance of the unknowns of two cameras, or of one, with the focal in pixels.
fn across(
    joint: &Joint,
    covariance: &BlockCovariance,
    [a, b]: [usize; 2],
    cameras: &[Camera],
    inflation: f64,
) -> Across {
    let mut found = Box::new([[0.0; VIEW]; VIEW]);
    let mut cache: Vec<([usize; 2], DMatrix<f64>)> = Vec::new();
    for (i, from) in joint.slots(a).iter().enumerate() {
        for (j, to) in joint.slots(b).iter().enumerate() {
            let (Some((p, row)), Some((q, column))) = (from, to) else { continue };
            let known = cache.iter().position(|(pair, _)| *pair == [*p, *q]);
            let at = known.unwrap_or_else(|| {
                cache.push(([*p, *q], covariance.block(&joint.blocks, *p, *q)));
                cache.len() - 1
            });
            let focal = |index: usize, view: usize| {
                if index == Covariance::FOCAL { cameras[view].focal } else { 1.0 }
            };
            found[i][j] = cache[at].1[(*row, *column)] * focal(i, a) * focal(j, b) * inflation;
        }
    }
    found
}

fn place_covariance(
    joint: &Joint,
    covariance: &BlockCovariance,
    tie: usize,
    inflation: f64,
) -> [[f64; PLACE]; PLACE] {
    let mut found = [[0.0; PLACE]; PLACE];
    let Some(block) = joint.tie_block(tie) else { return found };
    let own = covariance.block(&joint.blocks, block, block);
    let free: Vec<usize> = (0..PLACE).filter(|&k| joint.ties[tie].free[k]).collect();
    for (i, &k) in free.iter().enumerate() {
        for (j, &l) in free.iter().enumerate() {
            found[k][l] = own[(i, j)] * inflation;
        }
    }
    found
}
