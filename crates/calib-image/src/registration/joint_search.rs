//! Joint maximum of the scores of all pairs of a group, over the floor poses and heights of its cameras.
//!
//! Each pair has a quadratic model of its score. Their sum is a quadratic model of the joint score, whose
//! maximum is a step of Newton's method with the damping of Levenberg and Marquardt. Moves of single
//! cameras would not reach the maximum, because the parameters of all cameras are correlated.

use nalgebra::{DMatrix, DVector};

use crate::registration::floor_pose::{FloorPose, Poses};
use crate::registration::pair_model::{PairModel, Steps};
use crate::registration::pair_score::{PRIOR_WEIGHT, PairScore};
use crate::registration::pair_search::PairRegistration;
use crate::registration::relative_pose::RelativePose;
use crate::registration::site_colours::{Level, SiteColours};

/// Number of parameters of a camera: yaw, log height, x and y.
const PARAMETERS: usize = 4;
/// Factor by which the damping increases after a step that decreases the score. A step that increases the
/// score divides the damping by this factor.
const DAMPING_FACTOR: f64 = 5.0;

/// Score of a group of cameras, with its current poses.
pub(crate) struct JointSearch<'a> {
    site: &'a SiteColours,
    /// Current poses.
    pub(crate) poses: Poses,
    /// Cameras of the group; position and yaw of the first one are not changed.
    members: Vec<usize>,
    /// Pairs, with their scores.
    pairs: Vec<([usize; 2], PairScore<'a>)>,
    /// Mean height of the group, in metres.
    height: f64,
}

/// Stage of a joint search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// Steps of the finite differences in the first round. Each further round halves them.
    pub(crate) steps: Steps,
    /// Number of rounds.
    pub(crate) rounds: usize,
    /// Relative gain of the score below which a round ends.
    pub(crate) tolerance: f64,
}

impl<'a> JointSearch<'a> {
    /// Creates the search with the scores of the given pairs. The poses determine the cameras of the group.
    /// For more than `full_count` pairs, a pair has fewer items.
    pub(crate) fn new(
        site: &'a SiteColours,
        poses: Poses,
        pairs: &[&PairRegistration],
        level: Level,
        full_count: f64,
    ) -> Self {
        let members: Vec<usize> = (0..poses.len()).filter(|&index| poses[index].is_some()).collect();
        let share = (full_count / pairs.len().max(1) as f64).sqrt().min(1.0);
        let score = |pair: &&PairRegistration| {
            Some((pair.views, PairScore::with_share(site.pair(pair.views)?, level, share)))
        };
        let pairs: Vec<_> = pairs.iter().filter_map(score).collect();
        let sum: f64 = members.iter().map(|&index| site.cameras[index].position.z).sum();
        let height = sum / members.len().max(1) as f64;
        Self { site, poses, members, pairs, height }
    }

    /// Returns the score of the current poses, with the prior of the heights.
    pub(crate) fn score(&self) -> f64 {
        let prior = |&camera: &usize| {
            PRIOR_WEIGHT * (self.pose(camera).log_height / self.height_sigma(camera)).powi(2)
        };
        let value = |index: usize| self.pairs[index].1.colour(&self.relative(index));
        (0..self.pairs.len()).map(value).sum::<f64>() - self.members.iter().map(prior).sum::<f64>()
    }

    /// Maximises the score from the given poses. Returns the score.
    pub(crate) fn maximise(&mut self, poses: Poses, stage: Stage) -> f64 {
        /// Levenberg-Marquardt damping at the start of the search: the value added to the
        /// Hessian, in units of score per squared finite-difference step.
        const START_DAMPING: f64 = 10.0;
        /// Largest number of steps of Newton's method in one round.
        const MAX_STEPS: usize = 8;
        self.poses = poses;
        let mut score = self.score();
        let (mut steps, mut damping) = (stage.steps, START_DAMPING);
        for _ in 0..stage.rounds {
            for _ in 0..MAX_STEPS {
                let before = score;
                score = self.step(score, steps, &mut damping);
                if score - before < stage.tolerance * score.abs() {
                    break;
                }
            }
            damping = damping.min(2.0 * START_DAMPING);
            steps = steps.halved();
        }
        score
    }

    /// Makes one step of Newton's method that increases the score. Increases the damping until there is
    /// such a step. Returns the new score, or `score` if no such step is found.
    fn step(&mut self, score: f64, steps: Steps, damping: &mut f64) -> f64 {
        /// Largest number of damping values that are tried.
        const TRIALS: usize = 5;
        /// Smallest damping.
        const MIN_DAMPING: f64 = 0.1;
        let models: Vec<PairModel> = (0..self.pairs.len())
            .map(|index| PairModel::new(&self.pairs[index].1, &self.relative(index), steps))
            .collect();
        let (matrix, gradient) = self.normal_equations(&models);
        let old = self.poses.clone();
        for _ in 0..TRIALS {
            if let Some(step) = self.solve(&matrix, &gradient, steps, *damping) {
                self.apply(&step);
                let new = self.score();
                if new > score {
                    *damping = (*damping / DAMPING_FACTOR).max(MIN_DAMPING);
                    return new;
                }
                self.poses.clone_from(&old);
            }
            *damping *= DAMPING_FACTOR;
        }
        score
    }

    /// Computes the curvature and the gradient of the joint score.
    fn normal_equations(&self, models: &[PairModel]) -> (DMatrix<f64>, DVector<f64>) {
        let count = PARAMETERS * self.members.len();
        let (mut matrix, mut gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let start = |camera: usize| {
            PARAMETERS * self.members.iter().position(|member| *member == camera).unwrap_or(0)
        };
        for (model, &([a, b], _)) in models.iter().zip(&self.pairs) {
            let height = self.site.cameras[b].position.z;
            let derivatives = self.pose(a).relative_derivatives(&self.pose(b), height);
            let sides = [(start(a), derivatives[0]), (start(b), derivatives[1])];
            for (row, left) in sides {
                let mut part = gradient.fixed_rows_mut::<PARAMETERS>(row);
                part += left.transpose() * model.gradient;
                for (column, right) in sides {
                    let mut part = matrix.fixed_view_mut::<PARAMETERS, PARAMETERS>(row, column);
                    part += left.transpose() * model.curvature * right;
                }
            }
        }
        for (index, &camera) in self.members.iter().enumerate() {
            let weight = 2.0 * PRIOR_WEIGHT / self.height_sigma(camera).powi(2);
            let row = PARAMETERS * index + 1;
            matrix[(row, row)] += weight;
            gradient[row] -= weight * self.pose(camera).log_height;
        }
        (matrix, gradient)
    }

    /// Computes a damped step. Returns `None` if the equations have no solution.
    fn solve(
        &self,
        matrix: &DMatrix<f64>,
        gradient: &DVector<f64>,
        steps: Steps,
        damping: f64,
    ) -> Option<DVector<f64>> {
        /// Weight of the position and yaw of the first camera, which are fixed.
        const FIXED_WEIGHT: f64 = 1e12;
        let shift = steps.shift * self.height;
        let units = [steps.turn, steps.turn, shift, shift];
        let mut matrix = matrix.clone();
        for row in 0..matrix.nrows() {
            let is_fixed = row < PARAMETERS && row != 1;
            let weight = damping / units[row % PARAMETERS].powi(2);
            matrix[(row, row)] += if is_fixed { FIXED_WEIGHT } else { weight };
        }
        let step = matrix.cholesky()?.solve(gradient);
        step.iter().all(|c| c.is_finite()).then_some(step)
    }

    /// Adds a step to the current poses.
    fn apply(&mut self, step: &DVector<f64>) {
        for (index, &camera) in self.members.iter().enumerate() {
            let [yaw, log_height, x, y] = std::array::from_fn(|i| step[PARAMETERS * index + i]);
            let old = self.pose(camera);
            self.poses[camera] = Some(FloorPose {
                at: [old.at[0] + x, old.at[1] + y],
                yaw: old.yaw + yaw,
                log_height: old.log_height + log_height,
            });
        }
    }

    /// Returns the current pose of a camera of the group.
    fn pose(&self, camera: usize) -> FloorPose {
        self.poses[camera].unwrap_or(FloorPose { at: [0.0; 2], yaw: 0.0, log_height: 0.0 })
    }

    /// Returns the current relative pose of a pair.
    fn relative(&self, index: usize) -> RelativePose {
        let [a, b] = self.pairs[index].0;
        self.pose(a).relative_to(&self.pose(b), self.site.cameras[b].position.z)
    }

    /// Returns the standard deviation of the log of the height of a camera.
    fn height_sigma(&self, camera: usize) -> f64 {
        self.site.colours[camera].as_ref().map_or(1.0, |colours| colours.height_sigma)
    }
}
