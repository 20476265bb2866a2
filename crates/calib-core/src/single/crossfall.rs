//! What is known of the floor's tilt before solving.
//!
//! A floor is off level by `N(0, floor_tilt^2)` each way. Ground with marks of equal length on it is made to be
//! driven on, and falls to the side of its marks, to be drained: by `N(0, (r crossfall)^2)` more, r the mean
//! resultant length of the doubled directions of the marks (Mardia and Jupp 2000, section 2.3.1: directions have
//! no sign). It is 1 where marks lie along a lane, and 0 where they lie at right angles, as the joints of tiles do,
//! which are laid level. Along its marks it climbs by less, g of that ([`GRADIENT`]). With the mean (c, s) of
//! `(cos 2a, sin 2a)`, `r^2 = c^2 + s^2`, the covariance of the lean of the verticals against the floor is
//!
//! `floor_tilt^2 I + crossfall^2 r / 2 [(1 + g^2) r - (1 - g^2) c, -(1 - g^2) s; -(1 - g^2) s, (1 + g^2) r + (1 - g^2) c]`.
//!
//! The directions are those at the state, with their derivatives.

use crate::optimize::{NuisanceJacobian, Number, NumberOver};
use crate::single::constraints::Constraints;
use crate::single::likelihood::{Problem, State};
use crate::single::size_residual::{CameraTerms, floor_direction};

/// How much ground climbs along its marks, over what it falls to their side, as standard deviations: main roads climb by
/// up to 4 or 6 %, and mostly by less than 2.
const GRADIENT: f64 = 0.25;

/// Lower Cholesky factor of the covariance of the lean to the right and away from the camera: its first column,
/// and the last entry.
pub(super) struct LeanSpread<N> {
    right: N,
    ahead_by_right: N,
    ahead: N,
}

impl<E> Constraints<E> {
    /// Whether the floor may fall to the side of what is drawn on it.
    pub(crate) fn has_crossfall(&self) -> bool {
        self.tilt_sigma().is_some()
            && self.scene.crossfall > 0.0
            && self.lengths.iter().any(|length| length.is_mark)
    }
}

impl<E: Number> Problem<'_, E> {
    /// The spread of the lean at a state; `None` where it is no unknown.
    pub(super) fn lean_spread<N: NumberOver<E>>(&self, at: &CameraTerms<N>) -> Option<LeanSpread<N>> {
        let constraints = self.constraints;
        let level = N::constant(constraints.tilt_sigma()?.powi(2));
        if !constraints.has_crossfall() {
            let sigma = level.sqrt();
            return Some(LeanSpread { right: sigma, ahead_by_right: N::constant(0.0), ahead: sigma });
        }
        let [cos, sin] = self.mean_direction(at);
        // A hair above zero, where a root has no derivative.
        let resultant = (cos * cos + sin * sin).at_least(1e-18).sqrt();
        let share = resultant * (0.5 * constraints.scene.crossfall.powi(2));
        let (both, [cos, sin]) = (
            resultant * (1.0 + GRADIENT * GRADIENT),
            [cos, sin].map(|mean| mean * (1.0 - GRADIENT * GRADIENT)),
        );
        let right = (level + share * (both - cos)).sqrt();
        let ahead_by_right = -(share * sin) / right;
        let ahead = (level + share * (both + cos) - ahead_by_right * ahead_by_right).sqrt();
        Some(LeanSpread { right, ahead_by_right, ahead })
    }

    /// The mean of cosine and sine of the doubled directions of marks.
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

    /// The two residuals of the lean: over its spread.
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
                sink(N::constant(state.nuisance[at] / level), NuisanceJacobian::of(at, level.recip()));
            }
            return;
        }
        let Some(LeanSpread { right, ahead_by_right, ahead }) = self.lean_spread(at) else { return };
        let first = N::constant(state.nuisance[tilt]) / right;
        sink(first, NuisanceJacobian::of(tilt, right.value().recip()));
        let second = (N::constant(state.nuisance[tilt + 1]) - ahead_by_right * first) / ahead;
        let by_right = -ahead_by_right.value() / (right.value() * ahead.value());
        sink(second, NuisanceJacobian::of(tilt, by_right).and(tilt + 1, ahead.value().recip()));
    }
}

impl LeanSpread<f64> {
    /// Log of the determinant of the covariance.
    pub(super) fn log_determinant(&self) -> f64 {
        2.0 * (self.right * self.ahead).ln()
    }
}
