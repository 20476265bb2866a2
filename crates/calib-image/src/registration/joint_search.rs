//! Joint maximum of the scores of all pairs of a group, over the floor poses and heights of its cameras.

use crate::registration::floor_pose::{FloorPose, Poses};
use crate::registration::pair_score::{PRIOR_WEIGHT, PairScore};
use crate::registration::pair_search::PairRegistration;
use crate::registration::site_colours::{Level, SiteColours};

/// Distance ahead of a camera of the point about which it is rotated, in heights: a rotation about this point
/// changes its view of the floor least.
const PIVOT_DISTANCE: f64 = 3.0;
/// Pitch above which a camera is rotated about its own position, in radians.
const MAX_PIVOT_PITCH: f64 = 1.0;
/// Largest number of sweeps with one step size.
const SWEEPS: usize = 4;

/// Change of the pose of one camera.
#[derive(Clone, Copy)]
enum Move {
    /// Shift along x or y of the floor.
    Axis(usize),
    /// Shift along the baseline from another camera.
    Baseline(usize),
    /// Rotation about a point ahead.
    Pivot,
    /// Rotation about the position.
    Yaw,
    /// Change of the log of the height.
    Height,
}

/// Score of a group of cameras, with its current maximum.
pub(crate) struct JointSearch<'a> {
    site: &'a SiteColours,
    /// Current poses.
    pub(crate) poses: Poses,
    /// Cameras of the group; the first one is not moved.
    members: Vec<usize>,
    /// Pairs, with their scores.
    pairs: Vec<([usize; 2], PairScore<'a>)>,
    /// Current score of each pair.
    values: Vec<f64>,
    /// Mean height of the group, in metres.
    height: f64,
}

impl<'a> JointSearch<'a> {
    /// Creates the search from start poses, with the scores of the given pairs.
    pub(crate) fn new(
        site: &'a SiteColours,
        poses: Poses,
        pairs: &[&PairRegistration],
        level: Level,
    ) -> Self {
        let members: Vec<usize> = (0..poses.len()).filter(|&index| poses[index].is_some()).collect();
        let score =
            |pair: &&PairRegistration| Some((pair.views, PairScore::new(site.pair(pair.views)?, level)));
        let pairs: Vec<_> = pairs.iter().filter_map(score).collect();
        let sum: f64 = members.iter().map(|&index| site.cameras[index].position.z).sum();
        let height = sum / members.len().max(1) as f64;
        let mut search = Self { site, poses, members, values: vec![0.0; pairs.len()], pairs, height };
        search.restart(search.poses.clone());
        search
    }

    /// Replaces the current poses.
    pub(crate) fn restart(&mut self, poses: Poses) {
        self.poses = poses;
        self.values = (0..self.pairs.len()).map(|index| self.value(index)).collect();
    }

    /// Returns the score of the current poses, with the prior of the heights.
    pub(crate) fn score(&self) -> f64 {
        let priors: f64 = self.members.iter().map(|&index| self.prior(index)).sum();
        self.values.iter().sum::<f64>() - priors
    }

    /// Maximises the score with a pattern search of `rounds` step sizes. The first steps are a position in
    /// heights, and yaw or log height.
    pub(crate) fn climb(&mut self, rounds: usize, [mut shift, mut turn]: [f64; 2]) {
        for _ in 0..rounds {
            for _ in 0..SWEEPS {
                let mut is_better = false;
                for camera in self.members.clone() {
                    for change in self.moves(camera) {
                        is_better |= self.try_move(camera, change, [shift, turn]);
                    }
                }
                is_better |= self.try_scale(0.16 * shift);
                if !is_better {
                    break;
                }
            }
            (shift, turn) = (0.5 * shift, 0.5 * turn);
        }
        self.centre_heights();
    }

    /// Returns the current pose of a camera of the group.
    fn pose(&self, camera: usize) -> FloorPose {
        self.poses[camera].unwrap_or(FloorPose { at: [0.0; 2], yaw: 0.0, log_height: 0.0 })
    }

    /// Computes the score of a pair.
    fn value(&self, index: usize) -> f64 {
        let ([a, b], score) = &self.pairs[index];
        let relative = self.pose(*a).relative_to(&self.pose(*b), self.site.cameras[*b].position.z);
        score.colour(&relative)
    }

    /// Returns the standard deviation of the log of the height of a camera.
    fn height_sigma(&self, camera: usize) -> f64 {
        self.site.colours[camera].as_ref().map_or(1.0, |colours| colours.height_sigma)
    }

    /// Returns the prior of the height of a camera, as a cost.
    fn prior(&self, camera: usize) -> f64 {
        PRIOR_WEIGHT * (self.pose(camera).log_height / self.height_sigma(camera)).powi(2)
    }

    /// Returns the moves of a camera.
    fn moves(&self, camera: usize) -> Vec<Move> {
        let mut moves = vec![Move::Height];
        if self.members.first() != Some(&camera) {
            moves.extend([Move::Axis(0), Move::Axis(1), Move::Pivot, Move::Yaw]);
            let others = self.pairs.iter().filter(|(views, _)| views.contains(&camera));
            moves.extend(others.map(|([a, b], _)| Move::Baseline(if *a == camera { *b } else { *a })));
        }
        moves
    }

    /// Applies a move in both directions, and keeps it if the score increases. Returns whether it does.
    fn try_move(&mut self, camera: usize, change: Move, steps: [f64; 2]) -> bool {
        let own: Vec<usize> =
            (0..self.pairs.len()).filter(|&index| self.pairs[index].0.contains(&camera)).collect();
        let old = self.pose(camera);
        let before = own.iter().map(|&index| self.values[index]).sum::<f64>() - self.prior(camera);
        for sign in [1.0, -1.0] {
            self.poses[camera] = Some(self.moved(camera, change, steps.map(|step| sign * step)));
            let values: Vec<f64> = own.iter().map(|&index| self.value(index)).collect();
            if values.iter().sum::<f64>() - self.prior(camera) > before {
                own.iter().zip(values).for_each(|(&index, value)| self.values[index] = value);
                return true;
            }
        }
        self.poses[camera] = Some(old);
        false
    }

    /// Returns the pose of a camera after a move.
    fn moved(&self, camera: usize, change: Move, [shift, turn]: [f64; 2]) -> FloorPose {
        let mut pose = self.pose(camera);
        let step = shift * self.height;
        match change {
            Move::Axis(axis) => pose.at[axis] += step,
            Move::Baseline(other) => {
                let from = self.pose(other).at;
                let [dx, dy] = [0, 1].map(|i| pose.at[i] - from[i]);
                let length = dx.hypot(dy).max(1e-9);
                pose.at = [pose.at[0] + 2.0 * step * dx / length, pose.at[1] + 2.0 * step * dy / length];
            }
            Move::Pivot => {
                let given = &self.site.cameras[camera];
                let is_level = given.pitch.abs() < MAX_PIVOT_PITCH;
                let distance = if is_level { PIVOT_DISTANCE * given.position.z } else { 0.0 };
                let ahead = |yaw: f64| [-distance * yaw.sin(), distance * yaw.cos()];
                let (old, new) = (ahead(pose.yaw), ahead(pose.yaw + turn));
                pose.yaw += turn;
                pose.at = [0, 1].map(|i| pose.at[i] + old[i] - new[i]);
            }
            Move::Yaw => pose.yaw += turn,
            Move::Height => pose.log_height += turn,
        }
        pose
    }

    /// Scales all positions about the first camera, and keeps the scale if the score increases.
    fn try_scale(&mut self, step: f64) -> bool {
        let (old, before) = (self.poses.clone(), self.values.iter().sum::<f64>());
        let Some(&first) = self.members.first() else { return false };
        let centre = self.pose(first).at;
        for factor in [1.0 + step, 1.0 - step] {
            for pose in self.poses.iter_mut().flatten() {
                pose.at = [0, 1].map(|i| centre[i] + factor * (pose.at[i] - centre[i]));
            }
            let values: Vec<f64> = (0..self.pairs.len()).map(|index| self.value(index)).collect();
            if values.iter().sum::<f64>() > before {
                self.values = values;
                return true;
            }
            self.poses.clone_from(&old);
        }
        false
    }

    /// Scales the group as a whole, so that the prior of the heights is largest. Colours do not determine
    /// this scale.
    fn centre_heights(&mut self) {
        let (mut sum, mut weights) = (0.0, 0.0);
        for &camera in &self.members {
            let weight = self.height_sigma(camera).powi(-2);
            sum += weight * self.pose(camera).log_height;
            weights += weight;
        }
        let log = if weights > 0.0 { -sum / weights } else { 0.0 };
        for pose in self.poses.iter_mut().flatten() {
            pose.log_height += log;
            pose.at = pose.at.map(|c| c * log.exp());
        }
    }
}
