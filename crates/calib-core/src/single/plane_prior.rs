//! What is known of a plane that drawings, links or fields of view lie on.

use crate::camera::Plane;

/// A plane of the scene, with how well its height and its slope are known.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanePrior {
    /// By which annotations refer to it.
    pub id: String,
    /// Where it is thought to be.
    pub plane: Plane,
    /// The horizontal direction of its fall, of unit length.
    pub along: [f64; 2],
    /// Standard deviations of its height in metres, and of its slope along and across that direction in rise
    /// per metre; 0 of what is held.
    pub sigma: [f64; 3],
}

/// How far from the anchor of a plane a camera that sees it may stand, in metres.
const REACH: f64 = 10.0;

impl PlanePrior {
    /// A plane that is known exactly.
    #[must_use]
    pub fn held(id: impl Into<String>, plane: Plane) -> Self {
        Self { id: id.into(), plane, along: [1.0, 0.0], sigma: [0.0; 3] }
    }

    /// Whether nothing of it is estimated.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.sigma == [0.0; 3]
    }

    /// Covariance of height and slope, in square metres and squares of rise per metre.
    #[must_use]
    pub fn covariance(&self) -> [[f64; 3]; 3] {
        let rows = self.directions();
        let entry = |i: usize, j: usize| -> f64 {
            (0..3).map(|k| self.sigma[k] * self.sigma[k] * rows[k][i] * rows[k][j]).sum()
        };
        std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
    }

    /// Height, slope along and slope across, as rows over height and slope.
    pub(crate) fn directions(&self) -> [[f64; 3]; 3] {
        let [x, y] = self.along;
        [[1.0, 0.0, 0.0], [0.0, x, y], [0.0, -y, x]]
    }

    /// Root mean square of the slope in a direction of which nothing is known, as that of a camera without
    /// place: in rise per metre.
    pub(crate) fn slope_in_any_direction(&self) -> f64 {
        let [x, y] = self.plane.slope;
        let [_, along, across] = self.sigma;
        (0.5 * (x * x + y * y + along * along + across * across)).sqrt()
    }

    /// Standard deviation of the height of the plane under a camera without place, in metres.
    pub(crate) fn height_sigma_under_camera(&self) -> f64 {
        self.sigma[0].hypot(self.slope_in_any_direction() * REACH)
    }
}
