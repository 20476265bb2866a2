//! Covariances of cameras and landmarks, from the inverse of the normal equations at the minimum.

use std::collections::BTreeSet;

use nalgebra::DMatrix;

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::landmark::LANDMARK_PARAMS;
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
                    blocks.push(([*p, *q], self.covariance.block(&self.problem.blocks, *p, *q)));
                    blocks.len() - 1
                });
                let scale = self.per_parameter(i, a) * self.per_parameter(j, b);
                found[i][j] = blocks[at].1[(*row, *column)] * scale * inflation;
            }
        }
        found
    }

    /// Derivative of a reported value by its parameter: 1, but of the focal by its log.
    fn per_parameter(&self, index: usize, view: usize) -> f64 {
        if index == Covariance::FOCAL { self.cameras[view].focal } else { 1.0 }
    }

    /// Pairs of cameras that observe a landmark in common, the lower index first, with their covariance.
    pub(crate) fn of_pairs(&self) -> Vec<([usize; 2], CrossCovariance)> {
        let mut pairs: BTreeSet<[usize; 2]> = BTreeSet::new();
        for landmark in self.problem.landmarks.iter().filter(|landmark| !landmark.off) {
            let views = landmark.views();
            for (i, &a) in views.iter().enumerate() {
                pairs.extend(views[i + 1..].iter().map(|&b| [a, b]));
            }
        }
        pairs.into_iter().map(|pair| (pair, self.of_cameras(pair))).collect()
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
