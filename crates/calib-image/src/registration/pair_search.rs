//! Registration of two cameras: coarse search, two refinements, and the decision.

use std::f64::consts::PI;

use crate::registration::coarse_search::{RIDGE_TOLERANCE, coarse_peaks};
use crate::registration::pair_score::PairScore;
use crate::registration::relative_pose::RelativePose;
use crate::registration::site_colours::{Level, SiteColours};

/// Tolerance of a ridge for the decision, in radians. Poses on the ridge of the best pose are no
/// alternatives.
pub(crate) const DECISION_TOLERANCE: f64 = 12.0 * PI / 180.0;
/// Number of poses that are refined with small steps at half resolution.
const MEDIUM_COUNT: usize = 20;
/// Number of poses that are refined at full resolution.
const FINE_COUNT: usize = 8;
/// Largest number of poses on one ridge among the poses that are refined at full resolution.
const MAX_FINE_PER_RIDGE: usize = 2;
/// Largest value of the ratio of a pair; also the ratio without an alternative pose.
const MAX_RATIO: f64 = 9.99;

/// Decision about the relative pose of two cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PairDecision {
    /// The pose is determined.
    Found,
    /// The pose is likely, but another pose has a similar score.
    Ambiguous,
    /// The images show no common colours: the cameras may observe different places.
    NotShown,
}

/// Registration of two cameras.
#[derive(Clone, Debug)]
pub struct PairRegistration {
    /// Indices of the first and the second camera.
    pub views: [usize; 2],
    /// Score of the best pose, in bits. Items of both images have a total weight of 1000.
    pub score: f64,
    /// Score of the best pose divided by the score of the best pose with another yaw or baseline direction.
    pub ratio: f64,
    /// Decision from score and ratio.
    pub decision: PairDecision,
    /// Yaw of the first camera relative to the second, in radians.
    pub yaw: f64,
    /// Position of the first camera in the local frame of the second (x right, y ahead), in metres. The scale
    /// is correct if the height of the second camera is correct.
    pub baseline: [f64; 2],
    /// Ratio of the heights of the first and the second camera, divided by the ratio of the given heights.
    pub height_ratio: f64,
    /// Best poses, the best first.
    pub(crate) poses: Vec<RelativePose>,
}

/// Estimates the relative pose of two cameras. Pairs are independent of each other, and may be registered on
/// several threads.
#[must_use]
pub fn register_pair(site: &SiteColours, views: [usize; 2]) -> PairRegistration {
    let Some(pair) = site.pair(views) else { return PairRegistration::new(views, &[], 1.0) };
    let medium = PairScore::new(pair, Level::Medium);
    if medium.is_empty() {
        return PairRegistration::new(views, &[], 1.0);
    }
    let refine = |start: &RelativePose| medium.climb(start, [3.0 * PI / 180.0, 0.06, 0.125], 1);
    let mut ranked: Vec<(f64, RelativePose)> = coarse_peaks(pair).iter().map(refine).collect();
    sort(&mut ranked);
    ranked.truncate(MEDIUM_COUNT);
    let refine = |(_, start): &(f64, RelativePose)| medium.climb(start, [1.5 * PI / 180.0, 0.03, 0.0625], 2);
    ranked = ranked.iter().map(refine).collect();
    sort(&mut ranked);
    let mut starts: Vec<RelativePose> = Vec::new();
    for (_, pose) in &ranked {
        let is_near = |other: &&RelativePose| pose.is_on_ridge(other, RIDGE_TOLERANCE);
        if starts.len() < FINE_COUNT && starts.iter().filter(is_near).count() < MAX_FINE_PER_RIDGE {
            starts.push(*pose);
        }
    }
    let fine = PairScore::new(pair, Level::Fine);
    let refine = |start: &RelativePose| fine.climb(start, [PI / 180.0, 0.03, 0.0625], 3);
    let mut ranked: Vec<(f64, RelativePose)> = starts.iter().map(refine).collect();
    sort(&mut ranked);
    PairRegistration::new(views, &ranked, pair[1].height)
}

/// Sorts poses by their scores, the best first.
fn sort(ranked: &mut [(f64, RelativePose)]) {
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
}

impl PairRegistration {
    /// Creates the result from the ranked poses. `height` is the height of the second camera, in metres.
    fn new(views: [usize; 2], ranked: &[(f64, RelativePose)], height: f64) -> Self {
        let nothing = (0.0, RelativePose::from_parameters([0.0; 4]));
        let (score, best) = ranked.first().copied().unwrap_or(nothing);
        let other = ranked.iter().find(|(_, pose)| !pose.is_on_ridge(&best, DECISION_TOLERANCE));
        let ratio = other.map_or(MAX_RATIO, |(other, _)| (score / other.max(1.0)).min(MAX_RATIO));
        Self {
            views,
            score,
            ratio,
            decision: PairDecision::new(score, ratio),
            yaw: best.yaw,
            baseline: best.at.map(|c| c * height),
            height_ratio: best.log_ratio.exp(),
            poses: ranked.iter().map(|(_, pose)| *pose).collect(),
        }
    }
}

impl PairDecision {
    /// Decides from the score and the ratio. The thresholds are from pairs with known poses. Unrelated views
    /// have no large ratio together with a large score. Symmetric scenes, such as equal racks on both sides of
    /// an aisle, reach a ratio of 1.46 with the opposite pose, at scores below 1000.
    fn new(score: f64, ratio: f64) -> Self {
        let min_ratio = if score < 1000.0 { 1.5 } else { 1.4 };
        if ratio >= min_ratio && score >= 500.0 {
            Self::Found
        } else if ratio >= 1.2 && score >= 250.0 {
            Self::Ambiguous
        } else {
            Self::NotShown
        }
    }
}
