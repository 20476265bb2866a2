//! Covariances of cameras and landmarks, from the inverse of the normal equations at the minimum.

use std::collections::{BTreeSet, HashMap};

use nalgebra::DMatrix;

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::landmark::{LANDMARK_PARAMS, observing_in_common};
use crate::bundle::problem::BundleProblem;
use crate::camera::{Camera, Covariance};
use crate::optimize::BlockCovariance;

/// Covariance of the parameters of one camera (rows) with those of another (columns), in the order and
/// units of [`Covariance`].
pub type CrossCovariance = Box<[[f64; Covariance::SIZE]; Covariance::SIZE]>;

/// Covariances of a problem at a state.
pub(crate) struct Marginals<'a> {
    pub(crate) problem: &'a BundleProblem<'a>,
    pub(crate) covariance: &'a BlockCovariance,
    /// The cameras at the state.
    pub(crate) cameras: &'a [Camera],
    /// Factor of the standard deviations of every view.
    pub(crate) inflation: &'a [f64],
    /// Of all blocks of all cameras, by their pairs, where there are few cameras.
    pub(crate) between: Option<&'a HashMap<[usize; 2], DMatrix<f64>>>,
}

/// Most pairs of cameras, those of 45, of which all covariances are given; of more cameras only those are that the
/// cameras have which observe something in common.
const MOST_PAIRS: usize = 1000;

/// Whether there are so few views that the covariances of all pairs are given.
pub(crate) fn are_few(views: usize) -> bool {
    views > 1 && views * (views - 1) / 2 <= MOST_PAIRS
}

/// The blocks of all cameras.
pub(crate) fn camera_blocks(problem: &BundleProblem) -> Vec<usize> {
    let of = |view: usize| problem.camera_layout(view).iter().flatten().map(|&(block, _)| block);
    (0..problem.views.len()).flat_map(of).collect::<BTreeSet<usize>>().into_iter().collect()
}

impl Marginals<'_> {
    /// Covariance of the parameters of two cameras, or of one, with the focal in pixels.
    pub(crate) fn of_cameras(&self, [a, b]: [usize; 2]) -> CrossCovariance {
        let inflation = self.inflation[a] * self.inflation[b];
        let mut found = Box::new([[0.0; CAMERA_PARAMS]; CAMERA_PARAMS]);
        // The few blocks that two cameras have, each taken from the inverse once.
        let mut blocks: Vec<([usize; 2], DMatrix<f64>)> = Vec::new();
        for (i, from) in self.problem.camera_layout(a).iter().enumerate() {
            for (j, to) in self.problem.camera_layout(b).iter().enumerate() {
                let (Some((p, row)), Some((q, column))) = (from, to) else { continue };
                let known = blocks.iter().position(|(pair, _)| *pair == [*p, *q]);
                let at = known.unwrap_or_else(|| {
                    blocks.push(([*p, *q], self.block([*p, *q])));
                    blocks.len() - 1
                });
                let scale = self.per_parameter(i, a) * self.per_parameter(j, b);
                found[i][j] = blocks[at].1[(*row, *column)] * scale * inflation;
            }
        }
        found
    }

    fn block(&self, pair: [usize; 2]) -> DMatrix<f64> {
        let known = self.between.and_then(|between| between.get(&pair)).cloned();
        known.unwrap_or_else(|| self.covariance.block(&self.problem.blocks, pair[0], pair[1]))
    }

    /// Derivative of a reported value by its parameter: 1, but of the focal by its log.
    fn per_parameter(&self, index: usize, view: usize) -> f64 {
        if index == Covariance::FOCAL { self.cameras[view].focal } else { 1.0 }
    }

    /// Pairs of cameras that err together, the lower index first, with their covariance.
    pub(crate) fn of_pairs(&self) -> Vec<([usize; 2], CrossCovariance)> {
        let views = self.cameras.len();
        let pairs = match self.between {
            Some(_) => (0..views).flat_map(|a| (a + 1..views).map(move |b| [a, b])).collect(),
            None => observing_in_common(&self.problem.landmarks),
        };
        let with_covariance = pairs.into_iter().map(|pair| (pair, self.of_cameras(pair)));
        with_covariance.filter(|(_, found)| found.iter().flatten().any(|&value| value != 0.0)).collect()
    }
}

/// Covariance of the parameters of a landmark; zeros for those that are not free.
pub(crate) fn of_landmark(
    problem: &BundleProblem,
    covariance: &BlockCovariance,
    landmark: usize,
    inflation: f64,
) -> [[f64; LANDMARK_PARAMS]; LANDMARK_PARAMS] {
    let mut found = [[0.0; LANDMARK_PARAMS]; LANDMARK_PARAMS];
    let Some(block) = problem.landmark_block(landmark) else { return found };
    let own = covariance.block(&problem.blocks, block, block);
    let free: Vec<usize> = (0..LANDMARK_PARAMS).filter(|&k| problem.landmarks[landmark].free[k]).collect();
    for (i, &k) in free.iter().enumerate() {
        for (j, &l) in free.iter().enumerate() {
            found[k][l] = own[(i, j)] * inflation;
        }
    }
    found
}
