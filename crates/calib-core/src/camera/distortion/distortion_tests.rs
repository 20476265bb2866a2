//! Tests of properties that all distortion models share.

use super::*;
use proptest::prelude::*;

/// Returns distortions of all models with plausible coefficients.
pub(crate) fn any_distortion() -> impl Strategy<Value = Distortion> {
    let brown = (-0.4..0.3_f64, -0.2..0.2_f64, -0.05..0.05_f64, -0.003..0.003_f64, -0.003..0.003_f64)
        .prop_map(|(k1, k2, k3, p1, p2)| Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }));
    let fisheye = [-0.1..0.1_f64, -0.05..0.05_f64, -0.02..0.02_f64, -0.005..0.005_f64]
        .prop_map(|k| Distortion::KannalaBrandt { k });
    let unified = (-0.5..2.5_f64).prop_map(Distortion::unified);
    let eucm = (0.0..1.0_f64, 0.3..3.0_f64).prop_map(|(alpha, beta)| Distortion::Eucm { alpha, beta });
    let double = (-0.5..1.5_f64, 0.0..1.0_f64).prop_map(|(xi, alpha)| Distortion::DoubleSphere { xi, alpha });
    let division = (-1.0..0.5_f64).prop_map(|lambda| Distortion::Division { lambda });
    let radial = [-0.2..0.5_f64, -0.1..0.2_f64, 0.0..0.02_f64, 0.0..0.9_f64, 0.0..0.4_f64, 0.0..0.06_f64];
    let small = -0.003..0.003_f64;
    let tangential = [small.clone(), small.clone()];
    let bent = (0.0..2.0_f64, [-0.4..0.2_f64, -0.1..0.2_f64], tangential.clone())
        .prop_map(|(xi, radial, tangential)| Distortion::Unified(Unified { xi, radial, tangential }));
    let prism = [small.clone(), small.clone(), small.clone(), small];
    let rational = (radial, tangential, prism)
        .prop_map(|(radial, tangential, prism)| Distortion::Rational(Rational { radial, tangential, prism }));
    prop_oneof![brown, division, fisheye, unified, bent, double, eucm, rational]
}

/// Step of finite differences, in coordinates divided by the focal length and in coefficients. It balances
/// rounding and truncation errors.
const STEP: f64 = 1e-6;

/// Returns the distortion with the change `by` added to one coefficient.
fn nudged(distortion: &Distortion, coefficient: usize, by: f64) -> Distortion {
    let mut coefficients = distortion.coefficients();
    coefficients[coefficient] += by;
    distortion.with_coefficients(coefficients)
}

/// Returns the indices and names of the coefficients for which a model has derivatives.
fn names_with_derivatives(distortion: &Distortion) -> impl Iterator<Item = (usize, &'static Coefficient)> {
    let is_fitted = distortion.model().is_some_and(|model| model.row().is_fitted);
    distortion.names().iter().enumerate().filter(move |_| is_fitted)
}

/// Returns central differences of a pair of numbers, extrapolated from two steps (Richardson). This removes
/// the error term in the square of the step. Returns `None` just inside a fold, where the differences have
/// not converged.
fn difference_quotient(at: impl Fn(f64) -> Option<[f64; 2]>) -> Option<[f64; 2]> {
    let central = |step: f64| {
        let (ahead, behind) = (at(step)?, at(-step)?);
        Some([0, 1].map(|i| (ahead[i] - behind[i]) / (2.0 * step)))
    };
    let (whole, half) = (central(STEP)?, central(0.5 * STEP)?);
    let has_converged = (0..2).all(|i| (whole[i] - half[i]).abs() < 1e-3 * (1.0 + half[i].abs()));
    has_converged.then(|| [0, 1].map(|i| (4.0 * half[i] - whole[i]) / 3.0))
}

/// Whether an analytic derivative agrees with the finite differences. Always true if there are no
/// differences, because they leave the lens.
fn agrees(analytic: [f64; 2], numeric: Option<[f64; 2]>) -> bool {
    let size = analytic[0].abs().max(analytic[1].abs());
    numeric.is_none_or(|n| [0, 1].iter().all(|&i| (n[i] - analytic[i]).abs() < 1e-5 * (1.0 + size)))
}

/// Returns column `k` of a matrix.
fn column(matrix: Matrix2, k: usize) -> [f64; 2] {
    [matrix[0][k], matrix[1][k]]
}

#[test]
fn table_has_the_order_of_the_models() {
    for row in &MODELS {
        assert_eq!(row.model.row().name, row.name);
        assert_eq!(row.zero.model(), Some(row.model));
        assert!(
            row.coefficients.len() <= Distortion::MAX_COEFFICIENTS
                && row.default_count <= row.coefficients.len()
        );
    }
}

proptest! {
    #[test]
    fn any_coefficients_give_finite_results_without_panic(
        xi in any::<f64>(), alpha in prop_oneof![any::<f64>(), 0.0..1.0_f64], near in -2.0..2.0_f64,
        x in prop_oneof![any::<f64>(), -3.0..3.0_f64, Just(0.0)], y in prop_oneof![-3.0..3.0_f64, Just(0.0)],
        w in prop_oneof![any::<f64>(), -1.0..1.0_f64],
    ) {
        prop_assume!(x.is_finite());
        for xi in [xi, near] {
            for lens in [Distortion::unified(xi), Distortion::DoubleSphere { xi, alpha }] {
                let is_number = |at: &[f64]| at.iter().all(|value| value.is_finite());
                prop_assert!(lens.distort([x, y]).is_none_or(|at| is_number(&at)));
                prop_assert!(lens.undistort([x, y]).is_none_or(|at| is_number(&at)));
                prop_assert!(lens.ray([x, y]).is_none_or(|at| is_number(&at)));
                prop_assert!(lens.ray_to_distorted([x, y, w]).is_none_or(|at| is_number(&at)));
                prop_assert!(lens.max_radius() >= 0.0);
                let is_double = matches!(lens, Distortion::DoubleSphere { .. });
                if xi.is_nan() || xi <= -1.0 || is_double && !(0.0..=1.0).contains(&alpha) {
                    prop_assert!(lens.ray([x, y]).is_none() && lens.ray_to_distorted([x, y, w]).is_none());
                    prop_assert!(lens.distort([x, y]).is_none() && lens.undistort([x, y]).is_none());
                }
            }
        }
    }

    #[test]
    fn undistortion_inverts_distortion(
        distortion in any_distortion(), x in -1.5..1.5_f64, y in -1.5..1.5_f64,
    ) {
        if let Some(distorted) = distortion.distort([x, y]) {
            // The derivative vanishes at the fold, so digits are lost there.
            prop_assume!(x.hypot(y) < 0.98 * distortion.max_radius());
            let back = distortion.undistort(distorted);
            let near = |back: [f64; 2]| (back[0] - x).hypot(back[1] - y) < 1e-10;
            prop_assert!(back.is_some_and(near), "{back:?} {x} {y}");
        }
    }

    #[test]
    fn distortion_inverts_undistortion(
        distortion in any_distortion(), x in -1.0..1.0_f64, y in -1.0..1.0_f64,
    ) {
        if let Some(undistorted) = distortion.undistort([x, y]) {
            prop_assume!(undistorted[0].hypot(undistorted[1]) < 100.0);
            let back = distortion.distort(undistorted);
            prop_assert!(back.is_some(), "undistorted out of the domain: {undistorted:?}");
            if let Some(back) = back {
                prop_assert!((back[0] - x).hypot(back[1] - y) < 1e-11, "{back:?} {x} {y}");
            }
        }
    }

    #[test]
    fn ray_maps_back_to_its_distorted_point(distortion in any_distortion(), x in -2.5..2.5_f64, y in -2.5..2.5_f64) {
        let Some(ray) = distortion.ray([x, y]) else { return Ok(()) };
        let [a, b, w] = ray;
        // The derivative vanishes at the fold, so digits are lost there. A pinhole loses digits far from the
        // axis.
        let jacobian = distortion.ray_jacobian([x, y], ray);
        prop_assume!(jacobian.iter().flatten().all(|slope| slope.abs() < 50.0));
        let back = distortion.ray_to_distorted([3.0 * a, 3.0 * b, 3.0 * w]);
        prop_assert!(back.is_some_and(|back| (back[0] - x).hypot(back[1] - y) < 1e-11), "{back:?} {x} {y}");
        prop_assert!(distortion.is_wide() || w == 1.0);
    }

    #[test]
    fn ray_derivatives_agree_with_finite_differences(
        distortion in any_distortion(), x in -1.8..1.8_f64, y in -1.8..1.8_f64,
    ) {
        let Some(ray) = distortion.ray([x, y]) else { return Ok(()) };
        let jacobian = distortion.ray_jacobian([x, y], ray);
        prop_assume!(jacobian.iter().flatten().all(|slope| slope.abs() < 20.0));
        let pair = |at: [f64; 3], i: usize| [at[i], at[2 - i / 2]];
        for i in 0..3 {
            let column = |k: usize| pair(jacobian.map(|row| row[k]), i);
            prop_assert!(agrees(column(0), difference_quotient(|d| Some(pair(distortion.ray([x + d, y])?, i)))), "x");
            prop_assert!(agrees(column(1), difference_quotient(|d| Some(pair(distortion.ray([x, y + d])?, i)))), "y");
        }
        let by = distortion.ray_by_coefficients([x, y], ray);
        for (k, name) in names_with_derivatives(&distortion) {
            for i in 0..3 {
                let numeric = difference_quotient(|d| Some(pair(nudged(&distortion, k, d).ray([x, y])?, i)));
                prop_assert!(agrees(pair(by[k].at, i), numeric), "{name:?}: {:?} {numeric:?}", by[k]);
                let row = |lens: &Distortion| Some(lens.ray_jacobian([x, y], lens.ray([x, y])?)[i]);
                let numeric = difference_quotient(|d| row(&nudged(&distortion, k, d)));
                prop_assert!(agrees(by[k].jacobian[i], numeric), "{name:?} {i}: {:?} {numeric:?}", by[k]);
            }
        }
    }

    #[test]
    fn distortion_derivatives_agree_with_finite_differences(
        distortion in any_distortion(), x in -1.5..1.5_f64, y in -1.5..1.5_f64,
    ) {
        // Near the fold all derivatives grow without bound.
        prop_assume!(x.hypot(y) < 0.9 * distortion.max_radius());
        let (jacobian, by) = (distortion.distort_jacobian([x, y]), distortion.distort_by_coefficients([x, y]));
        prop_assert!(agrees(column(jacobian, 0), difference_quotient(|d| distortion.distort([x + d, y]))), "x");
        prop_assert!(agrees(column(jacobian, 1), difference_quotient(|d| distortion.distort([x, y + d]))), "y");
        for (k, name) in names_with_derivatives(&distortion) {
            let numeric = difference_quotient(|d| nudged(&distortion, k, d).distort([x, y]));
            prop_assert!(agrees(by[k], numeric), "{name:?}: {:?} {numeric:?}", by[k]);
        }
    }

    #[test]
    fn undistortion_derivatives_agree_with_finite_differences(
        distortion in any_distortion(), x in -1.2..1.2_f64, y in -1.2..1.2_f64,
    ) {
        let Some(undistorted) = distortion.undistort([x, y]) else { return Ok(()) };
        prop_assume!(undistorted[0].hypot(undistorted[1]) < (0.9 * distortion.max_radius()).min(4.0));
        let jacobian_of = |lens: &Distortion| {
            Some(lens.undistort_jacobian([x, y], lens.undistort([x, y])?))
        };
        let jacobian = distortion.undistort_jacobian([x, y], undistorted);
        prop_assert!(agrees(column(jacobian, 0), difference_quotient(|d| distortion.undistort([x + d, y]))), "x");
        prop_assert!(agrees(column(jacobian, 1), difference_quotient(|d| distortion.undistort([x, y + d]))), "y");
        let by = distortion.undistort_by_coefficients([x, y], undistorted);
        for (k, name) in names_with_derivatives(&distortion) {
            let numeric = difference_quotient(|d| nudged(&distortion, k, d).undistort([x, y]));
            prop_assert!(agrees(by[k].at, numeric), "{name:?}: {:?} {numeric:?}", by[k]);
            for row in 0..2 {
                let numeric = difference_quotient(|d| Some(jacobian_of(&nudged(&distortion, k, d))?[row]));
                prop_assert!(agrees(by[k].jacobian[row], numeric), "{name:?}: {:?} {numeric:?}", by[k]);
            }
        }
    }
}
