//! The lean of the verticals against a floor that several views show: two parameters in the base system, of
//! which every view sees the components to its right and ahead.
//!
//! With yaw y the right of a camera on the floor is `(cos y, sin y)` and ahead of it is `(-sin y, cos y)`, so
//! that a lean t is seen as `(right . t, ahead . t)`, with the derivatives `(ahead . t, -right . t)` by y. Taken
//! for one each, the leans of two views would count as twice the evidence.

use crate::optimize::NuisanceJacobian;

/// The tilt that views have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CommonTilt {
    /// Its block, of two parameters.
    pub(crate) block: usize,
    /// The view whose residuals have its prior.
    pub(crate) first: usize,
}

/// To the right of a camera of this yaw and ahead of it, on the floor.
fn axes(yaw: f64) -> [[f64; 2]; 2] {
    let (sin, cos) = yaw.sin_cos();
    [[cos, sin], [-sin, cos]]
}

/// A lean in the base system as a view of this yaw sees it.
pub(crate) fn in_view([x, y]: [f64; 2], yaw: f64) -> [f64; 2] {
    axes(yaw).map(|[a, b]| a * x + b * y)
}

/// Derivatives by components in the base system from those by what a view of this yaw sees.
pub(crate) fn in_base([right, ahead]: [f64; 2], yaw: f64) -> [f64; 2] {
    let [[rx, ry], [ax, ay]] = axes(yaw);
    [right * rx + ahead * ax, right * ry + ahead * ay]
}

/// The derivatives of a residual by the lean in the base system and by yaw, from those by the lean in the view,
/// whose parameters start at `tilt`; `None` of a residual that does not depend on it.
pub(crate) fn by_common(
    nuisance: &NuisanceJacobian,
    tilt: usize,
    lean: [f64; 2],
    yaw: f64,
) -> Option<([f64; 2], f64)> {
    let mut by = [0.0; 2];
    let entries = nuisance.entries().iter().filter(|(index, _)| (tilt..tilt + 2).contains(index));
    for &(index, derivative) in entries.clone() {
        by[index - tilt] += derivative;
    }
    entries.clone().next()?;
    let [right, ahead] = in_view(lean, yaw);
    Some((in_base(by, yaw), by[0] * ahead - by[1] * right))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn derivatives_are_those_of_differences(
            lean in [-0.1..0.1_f64, -0.1..0.1_f64], yaw in -3.0..3.0_f64, by in [-9.0..9.0_f64, -9.0..9.0_f64],
        ) {
            const STEP: f64 = 1e-5;
            let residual = |lean, yaw| in_view(lean, yaw).iter().zip(by).map(|(lean, by)| lean * by).sum::<f64>();
            let jacobian = NuisanceJacobian::of(4, by[0]).and(5, by[1]);
            let (by_lean, by_yaw) = by_common(&jacobian, 4, lean, yaw).unwrap();
            let central = |at: &dyn Fn(f64) -> f64| (at(STEP) - at(-STEP)) / (2.0 * STEP);
            prop_assert!((central(&|step| residual([lean[0] + step, lean[1]], yaw)) - by_lean[0]).abs() < 1e-8);
            prop_assert!((central(&|step| residual([lean[0], lean[1] + step], yaw)) - by_lean[1]).abs() < 1e-8);
            prop_assert!((central(&|step| residual(lean, yaw + step)) - by_yaw).abs() < 1e-8);
        }

        #[test]
        fn a_residual_without_lean_has_none(yaw in -3.0..3.0_f64) {
            prop_assert_eq!(by_common(&NuisanceJacobian::of(1, 2.0), 4, [0.1, 0.2], yaw), None);
        }
    }
}
