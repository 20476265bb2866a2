//! Prior on the tilt of the floor.
//!
//! A floor is off level by `N(0, floor_tilt^2)` in each direction. Ground with marks of equal length is
//! usually a road, which slopes to the side of its marks for drainage. Its additional slope is
//! `N(0, (r crossfall)^2)`. r is the mean resultant length of the doubled directions a of the marks (Mardia
//! and Jupp 2000, section 2.3.1). The directions are doubled because they have no sign. r is 1 for marks
//! along a lane. It is 0 for marks at right angles, as for the joints of tiles, which are laid level. The
//! slope along the marks is smaller by the factor g ([`GRADIENT_RATIO`]). Let (c, s) be the mean of
//! `(cos 2a, sin 2a)`, with `r^2 = c^2 + s^2`. The covariance of the lean of the verticals against the floor is
//!
//! `floor_tilt^2 I + crossfall^2 r / 2 [k - m c, -m s; -m s, k + m c]` with `k = (1 + g^2) r` and
//! `m = 1 - g^2`.
//!
//! The directions are computed at the current state, with their derivatives.

use crate::optimize::{NuisanceJacobian, Number, NumberOver};
use crate::single::constraints::Constraints;
use crate::single::likelihood::{Problem, State};
use crate::single::size_residual::{CameraTerms, floor_direction};

/// Ratio of the standard deviations of the slopes along and across the marks. Main roads climb by up to 4 or
/// 6 %, and mostly by less than 2 %.
const GRADIENT_RATIO: f64 = 0.25;

/// Lower Cholesky factor of the covariance of the lean of the verticals against the floor, in radians. The components
/// of the lean are to the right and away from the camera.
pub(super) struct LeanSpread<N> {
    /// Standard deviation of the lean to the right.
    right: N,
    /// Entry below the diagonal: lean away from the camera per standard deviation of the lean to the right.
    ahead_by_right: N,
    /// Standard deviation of the lean away from the camera, given the lean to the right.
    ahead: N,
}

impl<E> Constraints<E> {
    /// Whether the prior on the tilt of the floor includes a slope across floor marks of equal length.
    pub(crate) fn has_crossfall(&self) -> bool {
        self.tilt_sigma().is_some()
            && self.scene.crossfall > 0.0
            && self.lengths.iter().any(|length| length.is_mark)
    }
}

impl<E: Number> Problem<'_, E> {
    /// Returns the spread of the lean at a state; `None` if the lean is not estimated.
    pub(super) fn lean_spread<N: NumberOver<E>>(&self, at: &CameraTerms<N>) -> Option<LeanSpread<N>> {
        let constraints = self.constraints;
        let level = N::constant(constraints.tilt_sigma()?.powi(2));
        if !constraints.has_crossfall() {
            let sigma = level.sqrt();
            return Some(LeanSpread { right: sigma, ahead_by_right: N::constant(0.0), ahead: sigma });
        }
        let [cos, sin] = self.mean_direction(at);
        // The argument is slightly above zero, because the root has no derivative at zero.
        let resultant = (cos * cos + sin * sin).at_least(1e-18).sqrt();
        let share = resultant * (0.5 * constraints.scene.crossfall.powi(2));
        let (both, [cos, sin]) = (
            resultant * (1.0 + GRADIENT_RATIO * GRADIENT_RATIO),
            [cos, sin].map(|mean| mean * (1.0 - GRADIENT_RATIO * GRADIENT_RATIO)),
        );
        let right = (level + share * (both - cos)).sqrt();
        let ahead_by_right = -(share * sin) / right;
        let ahead = (level + share * (both + cos) - ahead_by_right * ahead_by_right).sqrt();
        Some(LeanSpread { right, ahead_by_right, ahead })
    }

    /// Returns the mean cosine and sine of the doubled directions of marks.
    fn mean_direction<N: NumberOver<E>>(&self, at: &CameraTerms<N>) -> [N; 2] {
        let (mut sums, mut count) = ([N::constant(0.0); 2], 0.0);
        for mark in self.lengths().filter(|length| length.is_mark) {
            let [x, y] = floor_direction(at, mark.chart.as_ref(), &mark.ends);
            let square = x * x + y * y;
            sums = [sums[0] + (x * x - y * y) / square, sums[1] + x * y * 2.0 / square];
            count += 1.0;
        }
        sums.map(|sum| sum * f64::max(count, 1.0).recip())
    }

    /// Passes the two residuals of the prior on the lean of the verticals to `sink`, in standard deviations.
    pub(super) fn each_lean_prior<N: NumberOver<E>>(
        &self,
        state: &State,
        at: &CameraTerms<N>,
        mut sink: impl FnMut(N, NuisanceJacobian),
    ) {
        let Some(level) = self.constraints.tilt_sigma() else { return };
        let tilt = self.nuisances().tilt();
        if !self.constraints.has_crossfall() {
            for at in [tilt, tilt + 1] {
                sink(N::constant(state.nuisance[at] / level), NuisanceJacobian::new(at, level.recip()));
            }
            return;
        }
        let Some(LeanSpread { right, ahead_by_right, ahead }) = self.lean_spread(at) else { return };
        let first = N::constant(state.nuisance[tilt]) / right;
        sink(first, NuisanceJacobian::new(tilt, right.value().recip()));
        let second = (N::constant(state.nuisance[tilt + 1]) - ahead_by_right * first) / ahead;
        let by_right = -ahead_by_right.value() / (right.value() * ahead.value());
        sink(second, NuisanceJacobian::new(tilt, by_right).with_derivative(tilt + 1, ahead.value().recip()));
    }
}

impl LeanSpread<f64> {
    /// Returns the log determinant of the covariance of the lean.
    pub(super) fn log_determinant(&self) -> f64 {
        2.0 * (self.right * self.ahead).ln()
    }
}
