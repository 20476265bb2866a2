//! Pose of one camera relative to another camera, up to the scale of the floor.

use std::f64::consts::PI;

/// Pose of a camera A in the local frame of a camera B. Lengths are in heights of B.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RelativePose {
    /// Yaw of A relative to B, in radians.
    pub(crate) yaw: f64,
    /// Log of the ratio of the heights of A and B, relative to the ratio of the given heights.
    pub(crate) log_ratio: f64,
    /// Position of A on the floor, in heights of B.
    pub(crate) at: [f64; 2],
}

impl RelativePose {
    /// Returns the pose of B relative to A. `ratio` is the ratio of the given heights of A and B.
    pub(crate) fn inverse(&self, ratio: f64) -> Self {
        let (sin, cos) = self.yaw.sin_cos();
        let scale = ratio * self.log_ratio.exp();
        let [x, y] = self.at;
        let at = [-(cos * x + sin * y) / scale, -(cos * y - sin * x) / scale];
        Self { yaw: -self.yaw, log_ratio: -self.log_ratio, at }
    }

    /// Whether two poses have the same yaw and the same direction of the baseline, within `tolerance`, in
    /// radians. Colours determine the length of the baseline least, so such poses belong to one ridge of the
    /// score.
    pub(crate) fn is_on_ridge(&self, other: &Self, tolerance: f64) -> bool {
        /// Distance below which two positions are on one ridge, in heights of B.
        const NEAR: f64 = 0.25;
        let [p, q] = [self.at, other.at];
        let unit = |p: [f64; 2]| p.map(|c| c / p[0].hypot(p[1]).max(1e-9));
        let apart = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
        let is_near = apart(unit(p), unit(q)) < tolerance || apart(p, q) < NEAR;
        wrapped(self.yaw - other.yaw).abs() < tolerance && is_near
    }

    /// Returns the pose after a change of yaw, log ratio, x and y. A is rotated about the floor point ahead
    /// of it at the distance `pivot`, in heights of B.
    pub(crate) fn pivoted(&self, [turn, log_ratio, x, y]: [f64; 4], pivot: f64) -> Self {
        let ahead = |yaw: f64| [-pivot * yaw.sin(), pivot * yaw.cos()];
        let (old, new) = (ahead(self.yaw), ahead(self.yaw + turn));
        Self {
            yaw: self.yaw + turn,
            log_ratio: self.log_ratio + log_ratio,
            at: [self.at[0] + old[0] - new[0] + x, self.at[1] + old[1] - new[1] + y],
        }
    }

    /// Returns the parameters: yaw, log ratio, x and y.
    pub(crate) fn to_parameters(self) -> [f64; 4] {
        [self.yaw, self.log_ratio, self.at[0], self.at[1]]
    }

    /// Creates a pose from its parameters: yaw (radians), log of the height ratio, x and y (in
    /// heights of camera B).
    pub(crate) fn from_parameters([yaw, log_ratio, x, y]: [f64; 4]) -> Self {
        Self { yaw, log_ratio, at: [x, y] }
    }
}

/// Returns an angle between -pi and pi, in radians.
pub(crate) fn wrapped(angle: f64) -> f64 {
    let turns = (angle / (2.0 * PI)).round();
    angle - 2.0 * PI * turns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_of_the_inverse_is_the_pose() {
        let pose = RelativePose { yaw: 0.7, log_ratio: 0.1, at: [2.0, -1.5] };
        let back = pose.inverse(1.3).inverse(1.0 / 1.3);
        let pairs = pose.to_parameters().into_iter().zip(back.to_parameters());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
    }

    #[test]
    fn a_ridge_contains_all_lengths_of_a_baseline() {
        let pose = RelativePose { yaw: 3.1, log_ratio: 0.0, at: [2.0, 2.0] };
        let on = |yaw: f64, at: [f64; 2]| RelativePose { yaw, at, ..pose }.is_on_ridge(&pose, 0.14);
        assert!(on(-3.15, [4.0, 4.0]) && on(3.1, [2.1, 1.9]));
        assert!(!on(2.8, [2.0, 2.0]) && !on(3.1, [2.0, 3.0]) && !on(3.1, [-2.0, -2.0]));
    }
}
