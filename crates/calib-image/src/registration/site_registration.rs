//! Registration of all cameras of a site.

use calib_core::{Camera, WorldPoint};

use crate::registration::floor_pose::{FloorPose, Poses, is_usable, spanning_tree};
use crate::registration::joint_search::{JointSearch, Stage};
use crate::registration::local_view::View;
use crate::registration::pair_model::Steps;
use crate::registration::pair_search::{DECISION_TOLERANCE, PairDecision, PairRegistration, register_pair};
use crate::registration::relative_pose::wrapped;
use crate::registration::site_colours::{Level, SiteColours};
use crate::xor_shift::XorShift;

/// Largest number of spanning trees that start the joint search.
const TREE_COUNT: usize = 6;

/// Agreement of the estimate of one pair with the joint estimate. A group with more pairs than a spanning tree
/// has loops. The agreement of its pairs then checks the registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairAgreement {
    /// Indices of the first and the second camera.
    pub views: [usize; 2],
    /// Yaw of the pair minus yaw of the joint estimate, in radians.
    pub yaw_difference: f64,
    /// Distance between the baselines of the pair and of the joint estimate, in metres.
    pub baseline_difference: f64,
    /// Whether both have the same yaw and baseline direction, within 12 degrees.
    pub agrees: bool,
}

/// Registration of all cameras of a site.
#[derive(Clone, Debug)]
pub struct SiteRegistration {
    /// Groups of at least two connected cameras, as indices of the views. The relative pose of two groups is
    /// unknown.
    pub groups: Vec<Vec<usize>>,
    /// Cameras with their estimated poses; `None` for cameras without a group. The first camera of a group is
    /// at x = y = 0 and has its given yaw. The height `z` of each camera is estimated. The covariance is
    /// unchanged.
    pub cameras: Vec<Option<Camera>>,
    /// All pairs.
    pub pairs: Vec<PairRegistration>,
    /// Agreement of each pair that the joint estimate uses.
    pub agreement: Vec<PairAgreement>,
}

/// Registers all cameras of a site. `progress` receives the completed fraction, 0 to 1, and returns `false`
/// to cancel. Returns `None` if it was cancelled.
pub fn register(views: &[View], progress: &mut dyn FnMut(f64) -> bool) -> Option<SiteRegistration> {
    /// Fractions of the work after the preparation and after the pairs.
    const PREPARED: f64 = 0.1;
    const PAIRED: f64 = 0.7;
    progress(0.0).then_some(())?;
    let site = SiteColours::new(views);
    progress(PREPARED).then_some(())?;
    let pairs = site.pairs();
    let mut registered = Vec::with_capacity(pairs.len());
    for (index, &pair) in pairs.iter().enumerate() {
        registered.push(register_pair(&site, pair));
        let done = (index + 1) as f64 / pairs.len() as f64;
        progress(PREPARED + (PAIRED - PREPARED) * done).then_some(())?;
    }
    join(&site, &registered, &mut |done| progress(PAIRED + (1.0 - PAIRED) * done))
}

/// Combines registered pairs to a registration of the site. `progress` receives the completed fraction, 0 to
/// 1, and returns `false` to cancel. Returns `None` if it was cancelled.
pub fn join(
    site: &SiteColours,
    pairs: &[PairRegistration],
    progress: &mut dyn FnMut(f64) -> bool,
) -> Option<SiteRegistration> {
    let heights: Vec<f64> = site.cameras.iter().map(|camera| camera.position.z).collect();
    let is_valid = |pair: &&PairRegistration| site.pair(pair.views).is_some();
    let known: Vec<PairRegistration> = pairs.iter().filter(is_valid).cloned().collect();
    let mut result = SiteRegistration {
        groups: Vec::new(),
        cameras: vec![None; heights.len()],
        pairs: pairs.to_vec(),
        agreement: Vec::new(),
    };
    let first_of = |pairs: &[PairRegistration], is_placed: &dyn Fn(usize) -> bool| {
        let found = pairs.iter().filter(|pair| pair.decision == PairDecision::Found);
        found
            .filter(|pair| !is_placed(pair.views[0]))
            .max_by(|a, b| rank(a).total_cmp(&rank(b)))
            .map(|pair| pair.views[1])
    };
    while let Some(first) = first_of(&known, &|view| result.cameras[view].is_some()) {
        let done = result.cameras.iter().flatten().count() as f64 / heights.len().max(1) as f64;
        let poses =
            join_group(site, &known, &heights, first, &mut |part| progress(done + (1.0 - done) * part))?;
        result.add_group(site, &known, &heights, &poses);
    }
    progress(1.0).then_some(result)
}

/// Returns the rank of a pair for a spanning tree.
fn rank(pair: &PairRegistration) -> f64 {
    /// Ratio above which a pair is not ranked higher.
    const MAX_RATIO: f64 = 3.0;
    pair.ratio.min(MAX_RATIO) * pair.score
}

/// First stage of the joint search, at half resolution of the small images.
const MEDIUM_STAGE: Stage = Stage { steps: Steps { shift: 0.3, turn: 0.08 }, rounds: 2, tolerance: 0.003 };
/// Second stage of the joint search, at full resolution of the small images.
const FINE_STAGE: Stage = Stage { steps: Steps { shift: 0.075, turn: 0.02 }, rounds: 2, tolerance: 0.001 };
/// Last stage of the joint search, at full resolution with more items.
const LAST_STAGE: Stage = Stage { steps: Steps { shift: 0.06, turn: 0.016 }, rounds: 3, tolerance: 0.0001 };

/// Estimates the poses of the group of the camera `first`. The joint maximum is narrow, so the search
/// starts from several spanning trees. The best results of the medium level are refined at the fine level,
/// and the best of these with more items.
fn join_group(
    site: &SiteColours,
    pairs: &[PairRegistration],
    heights: &[f64],
    first: usize,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Option<Poses> {
    /// Largest number of pairs at which every pair has all its items, for each stage.
    const FULL_COUNTS: [f64; 3] = [4.0, 5.0, 20.0];
    /// Number of results of the first stage that are refined.
    const FINE_COUNT: usize = 2;
    /// Fractions of the work after the first and the second stage.
    const DONE: [f64; 2] = [0.3, 0.7];
    let trees = distinct_trees(pairs, heights, first);
    let tree = trees.first()?;
    let used: Vec<&PairRegistration> = pairs.iter().filter(|pair| is_usable(pair, tree, heights)).collect();
    let search =
        |level: Level, full_count: f64| JointSearch::new(site, tree.clone(), &used, level, full_count);
    let mut medium = search(Level::Medium, FULL_COUNTS[0]);
    let mut ranked: Vec<(f64, Poses)> = Vec::new();
    for (index, start) in trees.iter().enumerate() {
        let score = medium.maximise(start.clone(), MEDIUM_STAGE);
        ranked.push((score, medium.poses.clone()));
        progress(DONE[0] * (index + 1) as f64 / trees.len() as f64).then_some(())?;
    }
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    ranked.truncate(FINE_COUNT);
    let mut fine = search(Level::Fine, FULL_COUNTS[1]);
    for (score, poses) in &mut ranked {
        *score = fine.maximise(poses.clone(), FINE_STAGE);
        poses.clone_from(&fine.poses);
        progress(DONE[1]).then_some(())?;
    }
    let (_, best) = ranked.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut last = search(Level::Fine, FULL_COUNTS[2]);
    last.maximise(best, LAST_STAGE);
    Some(last.poses)
}

/// Returns the spanning tree of the best pairs, and others with random ranks of the pairs.
fn distinct_trees(pairs: &[PairRegistration], heights: &[f64], first: usize) -> Vec<Poses> {
    /// Number of random trees. Equal trees are used once.
    const DRAW_COUNT: usize = 24;
    /// Standard deviation of the log of the random factor of a rank.
    const RANK_SIGMA: f64 = 1.0;
    let mut chance = XorShift(0x9e37_79b9_7f4a_7c15);
    let mut trees = vec![spanning_tree(pairs, heights, first, &mut rank)];
    for _ in 0..DRAW_COUNT {
        let mut random_rank = |pair: &PairRegistration| rank(pair) * (RANK_SIGMA * chance.normal()).exp();
        let tree = spanning_tree(pairs, heights, first, &mut random_rank);
        if trees.len() < TREE_COUNT && !trees.contains(&tree) {
            trees.push(tree);
        }
    }
    trees
}

impl SiteRegistration {
    /// Adds a group, in the frame of its first camera.
    fn add_group(&mut self, site: &SiteColours, pairs: &[PairRegistration], heights: &[f64], poses: &Poses) {
        let members: Vec<usize> = (0..poses.len()).filter(|&index| poses[index].is_some()).collect();
        let Some(base) = members.first().and_then(|&first| poses[first]) else { return };
        let turn = members.first().map_or(0.0, |&first| site.cameras[first].yaw - base.yaw);
        let (sin, cos) = turn.sin_cos();
        for (index, pose) in poses.iter().enumerate() {
            let Some(pose) = pose else { continue };
            let [x, y] = [0, 1].map(|i| pose.at[i] - base.at[i]);
            let z = heights[index] * pose.log_height.exp();
            let position = WorldPoint::new(cos * x - sin * y, sin * x + cos * y, z);
            let yaw = if members.first() == Some(&index) {
                site.cameras[index].yaw
            } else {
                wrapped(pose.yaw + turn)
            };
            self.cameras[index] = Some(Camera { position, yaw, ..site.cameras[index] });
        }
        let used = pairs.iter().filter(|pair| is_usable(pair, poses, heights));
        self.agreement.extend(used.filter_map(|pair| PairAgreement::new(pair, poses, heights)));
        self.groups.push(members);
    }
}

impl PairAgreement {
    /// Compares the best pose of a pair with the joint estimate.
    fn new(pair: &PairRegistration, poses: &Poses, heights: &[f64]) -> Option<Self> {
        let [a, b] = pair.views;
        let (first, second): (FloorPose, FloorPose) = (poses[a]?, poses[b]?);
        let joint = first.relative_to(&second, heights[b]);
        let own = pair.poses.first()?;
        let distance = (own.at[0] - joint.at[0]).hypot(own.at[1] - joint.at[1]);
        Some(Self {
            views: pair.views,
            yaw_difference: wrapped(own.yaw - joint.yaw),
            baseline_difference: distance * heights[b] * second.log_height.exp(),
            agrees: own.is_on_ridge(&joint, DECISION_TOLERANCE),
        })
    }
}
