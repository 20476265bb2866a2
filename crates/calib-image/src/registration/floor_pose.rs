//! Poses of the cameras of a group on a common floor, and the spanning trees that initialise them.

use nalgebra::Matrix4;

use crate::registration::pair_search::{DECISION_TOLERANCE, PairDecision, PairRegistration};
use crate::registration::relative_pose::{RelativePose, wrapped};

/// Pose of a camera on the floor of its group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FloorPose {
    /// Position, in metres.
    pub(crate) at: [f64; 2],
    /// Yaw, in radians.
    pub(crate) yaw: f64,
    /// Log of the height divided by the given height.
    pub(crate) log_height: f64,
}

/// Floor poses of all cameras; `None` for a camera that is not in the group.
pub(crate) type Poses = Vec<Option<FloorPose>>;

impl FloorPose {
    /// Pose of the first camera of a spanning tree: the origin, with the given height.
    const ORIGIN: Self = Self { at: [0.0; 2], yaw: 0.0, log_height: 0.0 };

    /// Returns the pose of this camera relative to the camera `base`. `height` is the given height of `base`,
    /// in metres.
    pub(crate) fn relative_to(&self, base: &Self, height: f64) -> RelativePose {
        let (sin, cos) = base.yaw.sin_cos();
        let unit = height * base.log_height.exp();
        let [x, y] = [0, 1].map(|i| (self.at[i] - base.at[i]) / unit);
        RelativePose {
            yaw: wrapped(self.yaw - base.yaw),
            log_ratio: self.log_height - base.log_height,
            at: [cos * x + sin * y, cos * y - sin * x],
        }
    }

    /// Returns the derivatives of the result of [`Self::relative_to`]: first with respect to yaw, log height, x
    /// and y of this camera, then with respect to the same parameters of `base`.
    pub(crate) fn relative_derivatives(&self, base: &Self, height: f64) -> [Matrix4<f64>; 2] {
        let [x, y] = self.relative_to(base, height).at;
        let (sin, cos) = base.yaw.sin_cos();
        let unit = height * base.log_height.exp();
        let (p, q) = (cos / unit, sin / unit);
        #[rustfmt::skip]
        let own = Matrix4::new(
            1.0, 0.0, 0.0, 0.0,
            0.0, 1.0, 0.0, 0.0,
            0.0, 0.0,   p,   q,
            0.0, 0.0,  -q,   p,
        );
        #[rustfmt::skip]
        let other = Matrix4::new(
            -1.0,  0.0, 0.0, 0.0,
             0.0, -1.0, 0.0, 0.0,
               y,   -x,  -p,  -q,
              -x,   -y,   q,  -p,
        );
        [own, other]
    }

    /// Returns the floor pose of a camera from its pose relative to this camera. `height` is the given height of
    /// this camera, in metres.
    pub(crate) fn compose(&self, relative: &RelativePose, height: f64) -> Self {
        let (sin, cos) = self.yaw.sin_cos();
        let unit = height * self.log_height.exp();
        let [x, y] = relative.at;
        let shift = [cos * x - sin * y, sin * x + cos * y];
        Self {
            at: [0, 1].map(|i| self.at[i] + unit * shift[i]),
            yaw: wrapped(self.yaw + relative.yaw),
            log_height: self.log_height + relative.log_ratio,
        }
    }
}

/// Places the cameras of one group by the best pairs that connect them. The tree starts at the camera `first`.
/// `heights` contains the given heights, in metres. `rank` returns the rank of a pair; the pairs with the
/// highest ranks are used.
pub(crate) fn spanning_tree(
    pairs: &[PairRegistration],
    heights: &[f64],
    first: usize,
    rank: &mut dyn FnMut(&PairRegistration) -> f64,
) -> Poses {
    let mut poses: Poses = vec![None; heights.len()];
    if let Some(pose) = poses.get_mut(first) {
        *pose = Some(FloorPose::ORIGIN);
    }
    let mut edges: Vec<(f64, &PairRegistration)> = pairs
        .iter()
        .filter(|pair| pair.decision == PairDecision::Found)
        .map(|pair| (rank(pair), pair))
        .collect();
    edges.sort_by(|a, b| b.0.total_cmp(&a.0));
    while let Some((index, pose)) = edges.iter().find_map(|(_, pair)| next_pose(&poses, pair, heights)) {
        poses[index] = Some(pose);
    }
    poses
}

/// Returns the camera that a pair adds to the tree, with its pose. Returns `None` if the pair has no or both
/// cameras in the tree.
fn next_pose(poses: &Poses, pair: &PairRegistration, heights: &[f64]) -> Option<(usize, FloorPose)> {
    let ([a, b], relative) = (pair.views, pair.poses.first()?);
    match (poses[a], poses[b]) {
        (None, Some(base)) => Some((a, base.compose(relative, heights[b]))),
        (Some(base), None) => Some((b, base.compose(&relative.inverse(heights[a] / heights[b]), heights[a]))),
        _ => None,
    }
}

/// Whether the joint estimate uses a pair: both cameras are in the group, and the pair is found, or one of
/// its two best poses agrees with the poses of the group.
pub(crate) fn is_usable(pair: &PairRegistration, poses: &Poses, heights: &[f64]) -> bool {
    let [a, b] = pair.views;
    let (Some(first), Some(second)) = (poses[a], poses[b]) else { return false };
    let relative = first.relative_to(&second, heights[b]);
    let agrees = |pose: &RelativePose| pose.is_on_ridge(&relative, DECISION_TOLERANCE);
    pair.decision == PairDecision::Found || pair.poses.iter().take(2).any(agrees)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_the_relative_pose_are_its_differences() {
        const STEP: f64 = 1e-6;
        let poses = [
            FloorPose { at: [1.0, 5.0], yaw: 2.0, log_height: 0.1 },
            FloorPose { at: [3.0, -2.0], yaw: 0.4, log_height: -0.05 },
        ];
        let derivatives = poses[0].relative_derivatives(&poses[1], 3.5);
        for (side, parameter) in [0, 1].into_iter().flat_map(|side| (0..4).map(move |i| (side, i))) {
            let at = |step: f64| {
                let mut moved = poses;
                let FloorPose { at: [x, y], yaw, log_height } = &mut moved[side];
                *[yaw, log_height, x, y][parameter] += step;
                moved[0].relative_to(&moved[1], 3.5).to_parameters()
            };
            for (row, (high, low)) in at(STEP).into_iter().zip(at(-STEP)).enumerate() {
                let difference = (high - low) / (2.0 * STEP);
                assert!((derivatives[side][(row, parameter)] - difference).abs() < 1e-8, "{side} {row}");
            }
        }
    }

    #[test]
    fn compose_and_relative_pose_are_inverse() {
        let base = FloorPose { at: [3.0, -2.0], yaw: 0.4, log_height: 0.05 };
        let relative = RelativePose { yaw: 2.1, log_ratio: -0.1, at: [1.0, 2.0] };
        let found = base.compose(&relative, 3.5).relative_to(&base, 3.5);
        let pairs = relative.to_parameters().into_iter().zip(found.to_parameters());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        let other = base.compose(&relative, 3.5);
        let back = other.compose(&relative.inverse(4.0 / 3.5), 4.0);
        assert!(
            (back.at[0] - 3.0).abs() + (back.at[1] + 2.0).abs() + (back.yaw - 0.4).abs() < 1e-12,
            "{back:?}"
        );
    }
}
