//! Camera relative to a plane: an annotation on a plane equals an annotation on the floor for a camera with
//! another pose.
//!
//! The other camera has roll, pitch and height relative to the plane. Its verticals lean relative to the normal
//! of the plane. So the formulas for the floor also apply to planes and are not duplicated.
//!
//! In unrolled axes, with the pitch p, up is `(0, -cos p, -sin p)` and ahead on the floor is
//! `(0, -sin p, cos p)`. The plane rises by s to the right and by t ahead. Its normal is
//! `up - s right - t ahead` divided by its length N. It equals `(-cos p' sin q, -cos p' cos q, -sin p')`,
//! with p' the pitch relative to the plane. q is the roll relative to the plane minus the roll relative to
//! the floor. The distance of the camera from the plane is `(z0 - h) / N`, with z0 the height of the camera
//! and h the height of the plane under the camera.

use crate::optimize::{Dual, Gradient, NuisanceJacobian, Number};
use crate::single::nuisances::PlaneNuisances;
use crate::single::residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, Parameters, ROLL, TILT, Tilt};

/// Pose of a camera relative to a plane.
#[derive(Clone, Debug)]
pub(crate) struct PlaneFrame {
    /// Roll, pitch, log focal length, and log of the perpendicular distance from the plane.
    pub(crate) parameters: Parameters,
    /// Roll, pitch, log focal length, and log of the distance from the plane along the verticals.
    pub(crate) along_verticals: Parameters,
    /// Lean of the verticals relative to the normal of the plane: to the right, and away from the camera, in
    /// radians.
    pub(crate) tilt: Tilt,
    /// Rows: derivatives of roll, pitch, both log distances and both leans. Columns: with respect to the pitch of
    /// the camera, both tilts of the floor, and both slopes of the plane ([`PITCH_SLOT`] and following).
    by: [Gradient; 6],
    /// Derivative of both log distances with respect to the log height of the camera.
    by_log_height: f64,
    /// Derivative of both log distances with respect to the height of the plane under the camera.
    by_foot: f64,
}

/// Row of the relative roll in [`PlaneFrame::by`].
const ROLL_ROW: usize = 0;
/// Row of the relative pitch in [`PlaneFrame::by`].
const PITCH_ROW: usize = 1;
/// Row of the log distance perpendicular to the plane in [`PlaneFrame::by`].
const DISTANCE_ROW: usize = 2;
/// Row of the log distance along the verticals in [`PlaneFrame::by`].
const VERTICAL_ROW: usize = 3;
/// Rows of both leans of the verticals in [`PlaneFrame::by`].
const LEAN_ROWS: [usize; 2] = [4, 5];

/// Column of the derivatives with respect to the pitch of the camera.
const PITCH_SLOT: usize = 0;
/// Columns of the derivatives with respect to both tilts of the floor.
const TILT_SLOTS: [usize; 2] = [1, 2];
/// Columns of the derivatives with respect to both slopes of the plane.
const SLOPE_SLOTS: [usize; 2] = [3, 4];

/// Reference direction of the distance from a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DistanceKind {
    /// Distance perpendicular to the plane, for annotations in the plane.
    OnPlane,
    /// Distance along the verticals, for uprights on the plane.
    Upright,
}

impl PlaneFrame {
    /// Computes the camera relative to a plane; `None` if the camera is not above the plane.
    ///
    /// The plane rises by `slope` to the right of the camera and ahead of it. Under the camera, the plane is
    /// `foot` metres above the floor.
    pub(crate) fn new(parameters: &Parameters, tilt: Tilt, slope: [f64; 2], foot: f64) -> Option<Self> {
        let [roll, pitch, log_focal, log_height] = *parameters;
        let drop = log_height.exp() - foot;
        if drop.is_nan() || drop <= 0.0 {
            return None;
        }
        let [turn, pitch, flatness, lift, right, ahead] = relative(pitch, tilt, slope);
        let by = [turn, pitch, flatness, lift, right, ahead].map(|dual| dual.gradient);
        let parameters = [roll + turn.value, pitch.value, log_focal, drop.ln() + flatness.value];
        let along_verticals = [roll + turn.value, pitch.value, log_focal, drop.ln() + lift.value];
        Some(Self {
            parameters,
            along_verticals,
            tilt: [right.value, ahead.value],
            by,
            by_log_height: (drop + foot) / drop,
            by_foot: -drop.recip(),
        })
    }

    /// Returns the log height of the camera minus the log distance from the plane.
    pub(crate) fn log_ratio(&self, log_height: f64) -> f64 {
        log_height - self.parameters[LOG_HEIGHT]
    }

    /// Converts the derivatives of a residual from parameters relative to the plane to parameters of the
    /// camera, the floor and the plane.
    pub(crate) fn propagated(
        &self,
        of: &Gradient,
        measured: DistanceKind,
        nuisances: &PlaneNuisances,
    ) -> (Gradient, NuisanceJacobian) {
        let height = if measured == DistanceKind::OnPlane { DISTANCE_ROW } else { VERTICAL_ROW };
        let rows = [
            (of[ROLL], ROLL_ROW),
            (of[PITCH], PITCH_ROW),
            (of[LOG_HEIGHT], height),
            (of[TILT], LEAN_ROWS[0]),
            (of[TILT + 1], LEAN_ROWS[1]),
        ];
        let by = |slot: usize| rows.iter().map(|&(of, row)| of * self.by[row][slot]).sum::<f64>();
        let mut gradient = [0.0; 6];
        gradient[ROLL] = of[ROLL];
        gradient[PITCH] = by(PITCH_SLOT);
        gradient[LOG_FOCAL] = of[LOG_FOCAL];
        gradient[LOG_HEIGHT] = of[LOG_HEIGHT] * self.by_log_height;
        let mut jacobian = NuisanceJacobian::NONE;
        if let Some(at) = nuisances.tilt {
            jacobian = TILT_SLOTS
                .iter()
                .enumerate()
                .fold(jacobian, |all, (k, &slot)| all.with_derivative(at + k, by(slot)));
        }
        if let Some(at) = nuisances.slope {
            jacobian = SLOPE_SLOTS
                .iter()
                .enumerate()
                .fold(jacobian, |all, (k, &slot)| all.with_derivative(at + k, by(slot)));
        }
        if let Some(at) = nuisances.foot {
            jacobian = jacobian.with_derivative(at, of[LOG_HEIGHT] * self.by_foot);
        }
        (gradient, jacobian)
    }
}

/// Computes roll, pitch, the logs of two distances, and two leans of a camera relative to a plane, with their
/// derivatives.
///
/// The roll is the difference from the roll relative to the floor. The distances from the plane are perpendicular to
/// it and along the verticals. They are divided by the height of the camera above the plane.
fn relative(pitch: f64, tilt: Tilt, slope: [f64; 2]) -> [Dual; 6] {
    let (sp, cp) = Dual::parameter(pitch, PITCH_SLOT).sin_cos();
    let [t0, t1] = [0, 1].map(|k| Dual::parameter(tilt[k], TILT_SLOTS[k]));
    let [s0, s1] = [0, 1].map(|k| Dual::parameter(slope[k], SLOPE_SLOTS[k]));
    let (across, up, forward) = (s0, cp - s1 * sp, sp + s1 * cp);
    let level = (across * across + up * up).sqrt();
    let (turn, pitch) = (across.atan2(up), forward.atan2(level));
    let ((sq, cq), (sp_on, cp_on)) = (turn.sin_cos(), pitch.sin_cos());
    let vertical = [t0, -(cp + t1 * sp), t1 * cp - sp];
    let along = |[x, y, w]: [Dual; 3]| vertical[0] * x + vertical[1] * y + vertical[2] * w;
    let right = along([cq, -sq, Dual::constant(0.0)]);
    let ahead = along([-(sq * sp_on), -(cq * sp_on), cp_on]);
    let off_plane = along([-(cp_on * sq), -(cp_on * cq), -sp_on]);
    let flatness = -((s0 * s0 + s1 * s1 + 1.0).ln() * 0.5);
    let lift = -((-(t0 * s0) - t1 * s1 + 1.0).ln());
    [turn, pitch, flatness, lift, right / off_plane, ahead / off_plane]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn level_plane_acts_as_a_floor_at_another_height(roll in -0.3..0.3_f64, pitch in 0.1..1.3_f64, height in 0.5..5.0_f64, lower in -1.0..0.4_f64, tilt in [-0.02..0.02_f64, -0.02..0.02_f64]) {
            let frame = PlaneFrame::new(&[roll, pitch, 7.0, height.ln()], tilt, [0.0; 2], lower).unwrap();
            prop_assert!((frame.parameters[ROLL] - roll).abs() < 1e-12);
            prop_assert!((frame.parameters[PITCH] - pitch).abs() < 1e-12);
            prop_assert!((frame.parameters[LOG_HEIGHT] - (height - lower).ln()).abs() < 1e-12);
            prop_assert!((frame.tilt[0] - tilt[0]).abs() < 1e-12 && (frame.tilt[1] - tilt[1]).abs() < 1e-12);
        }

        #[test]
        fn up_relative_to_the_plane_is_its_normal(roll in -0.3..0.3_f64, pitch in 0.1..1.3_f64, slope in [-0.2..0.2_f64, -0.2..0.2_f64]) {
            let frame = PlaneFrame::new(&[roll, pitch, 7.0, 1.0], [0.0; 2], slope, 0.0).unwrap();
            let up = |[roll, pitch, ..]: Parameters| {
                let ((sr, cr), (sp, cp)) = (roll.sin_cos(), pitch.sin_cos());
                [-cp * sr, -cp * cr, -sp]
            };
            let ((sr, cr), (sp, cp)) = (roll.sin_cos(), pitch.sin_cos());
            let (right, ahead) = ([cr, -sr, 0.0], [-sp * sr, -sp * cr, cp]);
            let of_floor = up([roll, pitch, 0.0, 0.0]);
            let length = (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
            for (k, on_plane) in up(frame.parameters).into_iter().enumerate() {
                let normal = (of_floor[k] - slope[0] * right[k] - slope[1] * ahead[k]) / length;
                prop_assert!((on_plane - normal).abs() < 1e-12);
            }
        }

        #[test]
        fn derivatives_match_finite_differences(
            roll in -0.3..0.3_f64, pitch in 0.1..1.3_f64, height in 2.0..5.0_f64, foot in -1.0..1.0_f64,
            tilt in [-0.02..0.02_f64, -0.02..0.02_f64], slope in [-0.2..0.2_f64, -0.2..0.2_f64],
            of in [-9.0..9.0_f64, -9.0..9.0_f64, -9.0..9.0_f64, -9.0..9.0_f64, -9.0..9.0_f64, -9.0..9.0_f64], is_upright in proptest::bool::ANY,
        ) {
            const STEP: f64 = 1e-5;
            let measured = if is_upright { DistanceKind::Upright } else { DistanceKind::OnPlane };
            let at = [roll, pitch, 7.0, height.ln(), tilt[0], tilt[1], slope[0], slope[1], foot];
            let frame = |at: [f64; 9]| PlaneFrame::new(&[at[0], at[1], at[2], at[3]], [at[4], at[5]], [at[6], at[7]], at[8]).unwrap();
            let residual = |at: [f64; 9]| {
                let frame = frame(at);
                let [a, b, c, d] = if is_upright { frame.along_verticals } else { frame.parameters };
                [a, b, c, d, frame.tilt[0], frame.tilt[1]].iter().zip(of).map(|(value, by)| value * by).sum::<f64>()
            };
            let nuisances = PlaneNuisances { tilt: Some(4), slope: Some(6), foot: Some(8) };
            let (core, jacobian) = frame(at).propagated(&of, measured, &nuisances);
            let mut by: Vec<(usize, f64)> = (0..4).map(|k| (k, core[k])).collect();
            by.extend(jacobian.entries());
            prop_assert_eq!(by.len(), 9);
            for (index, analytic) in by {
                let nudged = |step: f64| { let mut moved = at; moved[index] += step; residual(moved) };
                let numeric = (nudged(STEP) - nudged(-STEP)) / (2.0 * STEP);
                prop_assert!((numeric - analytic).abs() < 1e-6 * (1.0 + analytic.abs()), "{index}: {numeric} {analytic}");
            }
        }
    }
}
