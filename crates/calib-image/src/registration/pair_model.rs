//! Quadratic model of the score of a pair, from finite differences.

use nalgebra::{Matrix4, SymmetricEigen, Vector4};

use crate::registration::pair_score::PairScore;
use crate::registration::relative_pose::RelativePose;

/// Steps of the finite differences. Large steps smooth the score.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Steps {
    /// Step of the position, in heights of the second camera.
    pub(crate) shift: f64,
    /// Step of the yaw, in radians, and of the log of the height.
    pub(crate) turn: f64,
}

/// Quadratic model of the score of a pair about a pose, in the parameters of [`RelativePose`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairModel {
    /// Gradient of the score.
    pub(crate) gradient: Vector4<f64>,
    /// Hessian matrix of the negative score. Its eigenvalues are replaced by their absolute values, so that a
    /// step of Newton's method increases the score (saddle-free Newton method, Dauphin et al. 2014).
    pub(crate) curvature: Matrix4<f64>,
}

impl Steps {
    /// Returns steps of half the size.
    pub(crate) fn halved(self) -> Self {
        Self { shift: 0.5 * self.shift, turn: 0.5 * self.turn }
    }
}

impl PairModel {
    /// Computes the model from the scores of 15 poses. The first camera is rotated about a floor point ahead of
    /// it, because this changes its view of the floor least.
    pub(crate) fn new(score: &PairScore, pose: &RelativePose, steps: Steps) -> Self {
        let pivot = score.pivot_distance;
        let steps = [steps.turn, steps.turn, steps.shift, steps.shift];
        let at = |changes: &[(usize, f64)]| {
            let mut by = [0.0; 4];
            changes.iter().for_each(|&(i, sign)| by[i] = sign * steps[i]);
            score.colour(&pose.pivoted(by, pivot))
        };
        let centre = at(&[]);
        let [forward, back] = [1.0, -1.0].map(|sign| Vector4::from_fn(|i, _| at(&[(i, sign)])));
        // Derivatives with respect to the numbers of steps.
        let gradient = 0.5 * (forward - back);
        let mut hessian = Matrix4::from_diagonal(&(forward + back).add_scalar(-2.0 * centre));
        for (i, j) in (0..4).flat_map(|i| (0..i).map(move |j| (i, j))) {
            let mixed = at(&[(i, 1.0), (j, 1.0)]) - forward[i] - forward[j] + centre;
            hessian[(i, j)] = mixed;
            hessian[(j, i)] = mixed;
        }
        let mut eigen = SymmetricEigen::new(-hessian);
        eigen.eigenvalues.apply(|value| *value = value.abs());
        // Derivatives of the numbers of steps with respect to the parameters of the pose.
        let mut jacobian = Matrix4::identity();
        jacobian[(2, 0)] = -pivot * pose.yaw.cos();
        jacobian[(3, 0)] = -pivot * pose.yaw.sin();
        let jacobian = Matrix4::from_diagonal(&Vector4::from(steps.map(f64::recip))) * jacobian;
        Self {
            gradient: jacobian.transpose() * gradient,
            curvature: jacobian.transpose() * eigen.recompose() * jacobian,
        }
    }
}
