//! Elementary functions, vectorised loops and polynomials whose results have the same bits on every machine.
//!
//! - The elementary functions of the standard library depend on the operating system: their results differ in
//!   the last bit. With them, a browser and a server would map the same pixel differently.
//! - Loops over many points are compiled for every width of vector instructions. The widest that the
//!   processor supports is used. All widths compute the same bits: operations are not fused, and the order of
//!   sums is fixed.
//! - For polynomials of one variable, the maxima, inverse values and roots are computed.

use pulp::Arch;

/// Returns the sine and cosine of an angle in radians.
#[inline]
pub(crate) fn sin_cos(angle: f64) -> (f64, f64) {
    libm::sincos(angle)
}

/// Returns the tangent of an angle in radians.
#[inline]
pub(crate) fn tan(angle: f64) -> f64 {
    libm::tan(angle)
}

/// Returns the arc tangent of a number, in radians between -pi/2 and pi/2.
#[inline]
pub(crate) fn atan(tangent: f64) -> f64 {
    libm::atan(tangent)
}

/// Returns the length of the vector (x, y). The square of the length must not overflow. The same function of
/// `libm` is slower: without a square root instruction, as in a browser, it computes roots with integers.
#[inline]
pub(crate) fn hypot(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// Returns the angle between the optical axis and a ray, in radians from 0 to pi. `across` and `along` are
/// the components of the ray perpendicular to the axis and along it.
pub(crate) fn angle_from_axis(across: f64, along: f64) -> f64 {
    if along > across { atan(across / along) } else { std::f64::consts::FRAC_PI_2 - atan(along / across) }
}

/// Widest set of vector instructions that is used: `v3` (AVX2) if the library was built with `CALIB_SIMD=v3`.
/// This setting serves to measure the speed of older processors on newer ones. By default, there is no limit.
#[cfg(target_arch = "x86_64")]
const INSTRUCTION_SET: Option<&str> = option_env!("CALIB_SIMD");

/// Runs a closure, compiled for the widest vector instructions that the processor supports. The closure and
/// the functions that it calls must be marked `#[inline(always)]`.
#[inline(always)]
pub(crate) fn dispatch<R>(run: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if INSTRUCTION_SET == Some("v3")
        && let Some(v3) = pulp::x86::V3::try_new()
    {
        return v3.vectorize(run);
    }
    Arch::new().dispatch(run)
}

/// Polynomial `r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8)` with the coefficients k1 to k4: the radial map of a
/// lens. The variable r is a radius divided by the focal length, or an angle in radians.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OddPolynomial(pub(crate) [f64; 4]);

impl OddPolynomial {
    /// Returns the value of the polynomial at `r`.
    pub(crate) fn value(&self, r: f64) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        let s = r * r;
        r * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    }

    /// Returns the first derivative of the polynomial at `r`.
    pub(crate) fn derivative(&self, r: f64) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        let s = r * r;
        1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))
    }

    /// Returns the second derivative of the polynomial at `r`.
    pub(crate) fn curvature(&self, r: f64) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        let s = r * r;
        r * (6.0 * k1 + s * (20.0 * k2 + s * (42.0 * k3 + s * 72.0 * k4)))
    }

    /// Returns a lower bound of the derivative between 0 and `r`, from the negative terms only. If the bound
    /// is positive, the polynomial increases up to `r`.
    pub(crate) fn derivative_lower_bound(&self, r: f64) -> f64 {
        Self(self.0.map(|k| k.min(0.0))).derivative(r)
    }

    /// Returns the smallest positive `r` at which the polynomial stops increasing, or infinity.
    pub(crate) fn first_maximum(&self) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        if k3 == 0.0 && k4 == 0.0 {
            return smallest_biquadratic_root(3.0 * k1, 5.0 * k2);
        }
        let roots = positive_roots(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4]);
        roots.first().map_or(f64::INFINITY, |s| s.sqrt())
    }

    /// Returns the `r` below [`Self::first_maximum`] at which the polynomial has this value. Returns `None`
    /// if there is no such `r`.
    ///
    /// Newton's method starts from the first terms of the inverse series. A bracket ensures convergence.
    pub(crate) fn inverse(&self, value: f64) -> Option<f64> {
        /// Candidates for the upper end of the bracket, as multiples of the start. One of them exceeds the
        /// solution for all but the outermost points of a lens.
        const BRACKET_FACTORS: [f64; 4] = [1.001, 1.02, 1.1, 1.3];
        let [k1, k2, ..] = self.0;
        let s = value * value;
        let series = value * (1.0 - s * (k1 - s * (3.0 * k1 * k1 - k2)));
        // If the series is not usable, the iteration starts at the value.
        let start = if series > 0.5 * value && series < 2.0 * value { series } else { value };
        let grows_past = |near: &f64| self.value(*near) > value && self.derivative_lower_bound(*near) > 0.0;
        let mut high = match BRACKET_FACTORS.map(|share| share * start).iter().find(|near| grows_past(near)) {
            Some(near) => *near,
            None => {
                let turn = self.first_maximum();
                if turn.is_finite() { turn } else { find_upper_end(|r| self.value(r), value)? }
            }
        };
        if value.is_nan() || value > self.value(high) {
            return None;
        }
        let mut low = 0.0;
        let mut r = start.min(high);
        // Every iteration halves the bracket or doubles the number of correct digits.
        for _ in 0..200 {
            let error = self.value(r) - value;
            if error > 0.0 {
                high = r;
            } else {
                low = r;
            }
            let newton = r - error / self.derivative(r);
            if (newton - r).abs() <= 2.0 * f64::EPSILON * (1.0 + r) {
                return Some(newton.clamp(low.min(r), high.max(r)));
            }
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            r = next;
        }
        Some(r)
    }
}

/// Returns the smallest positive root r of `1 + a r^2 + b r^4`, or infinity if there is none.
fn smallest_biquadratic_root(a: f64, b: f64) -> f64 {
    let discriminant = a * a - 4.0 * b;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    // The root is computed as 2 divided by (-a +- sqrt(...)). This form has no cancellation, and is correct
    // for b = 0.
    let divisor = -a + discriminant.sqrt();
    if divisor > 0.0 { (2.0 / divisor).sqrt() } else { f64::INFINITY }
}

/// Returns a positive argument at which an increasing function is at least `value`. Returns `None` if no such
/// argument below a million is found.
fn find_upper_end(function: impl Fn(f64) -> f64, value: f64) -> Option<f64> {
    let mut radius = value.abs().max(1.0);
    while radius < 1e6 {
        if function(radius) >= value {
            return Some(radius);
        }
        radius *= 2.0;
    }
    None
}

/// Returns the positive roots of a polynomial in ascending order. The coefficients are in the order of
/// ascending powers, so the first is the constant.
///
/// Between two neighbouring roots of the derivative there is at most one root, which is found by bisection.
pub(crate) fn positive_roots(coefficients: &[f64]) -> Vec<f64> {
    let degree = coefficients.iter().rposition(|&c| c != 0.0).unwrap_or(0);
    if degree == 0 {
        return Vec::new();
    }
    let coefficients = &coefficients[..=degree];
    let value = |s: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c);
    let derivative: Vec<f64> = coefficients.iter().enumerate().skip(1).map(|(i, c)| i as f64 * c).collect();
    let leading = coefficients[degree];
    let bound = 1.0 + coefficients.iter().fold(0.0_f64, |most, c| most.max((c / leading).abs()));
    let mut knots = vec![0.0];
    knots.extend(positive_roots(&derivative).into_iter().filter(|&s| s < bound));
    knots.push(bound);
    let mut roots = Vec::new();
    for pair in knots.windows(2) {
        let (mut low, mut high) = (pair[0], pair[1]);
        let positive_at_low = value(low) > 0.0;
        if positive_at_low == (value(high) > 0.0) {
            continue;
        }
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if (value(middle) > 0.0) == positive_at_low { low = middle } else { high = middle }
        }
        roots.push(low);
    }
    roots
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn functions_agree_with_the_system_to_the_last_bits(x in -7.0..7.0_f64, y in -7.0..7.0_f64) {
            let near = |a: f64, b: f64| (a - b).abs() <= 4.0 * f64::EPSILON * (1e-3 + b.abs());
            let ((sin, cos), expected) = (sin_cos(x), x.sin_cos());
            prop_assert!(near(sin, expected.0) && near(cos, expected.1));
            prop_assert!(near(tan(x), x.tan()) && near(atan(x), x.atan()) && near(hypot(x, y), x.hypot(y)));
        }
    }

    proptest! {
        #[test]
        fn first_maximum_is_the_first_root_of_the_derivative(
            k in [-0.5..0.5_f64, -0.3..0.3_f64, -0.1..0.1_f64, -0.05..0.05_f64],
        ) {
            let polynomial = OddPolynomial(k);
            let turn = polynomial.first_maximum();
            for i in 1..200 {
                let r = f64::from(i) / 200.0 * turn.min(20.0) * 0.9999;
                prop_assert!(polynomial.derivative(r) > 0.0, "slope {} at {r} before {turn}", polynomial.derivative(r));
            }
            if turn.is_finite() {
                prop_assert!(polynomial.derivative(turn * 1.0001) < 1e-6 * (1.0 + turn.powi(8)));
            }
        }
    }
}
