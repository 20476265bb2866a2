//! Elementary functions that have the same bits on every machine.
//!
//! Those of the standard library are the system's, and no two systems agree in the last bit: what a camera maps in a
//! browser would not be what it maps on a server.
//!
//! Loops over many points, compiled for every width of vector instructions; the widest that the processor has is
//! taken. Whichever it is, the bits of a result are the same: nothing is fused, and nothing summed in another order.
//!
//! Polynomials of one variable: where they turn, where they have a value, and their roots.

use pulp::Arch;

/// Sine and cosine of an angle in radians.
#[inline]
pub(crate) fn sin_cos(angle: f64) -> (f64, f64) {
    libm::sincos(angle)
}

/// Tangent of an angle in radians.
#[inline]
pub(crate) fn tan(angle: f64) -> f64 {
    libm::tan(angle)
}

/// The angle in radians, between -pi/2 and pi/2, whose tangent this is.
#[inline]
pub(crate) fn atan(tangent: f64) -> f64 {
    libm::atan(tangent)
}

/// Length of the vector (x, y), as long as its square is a number: not `libm`'s, which takes the root in whole numbers
/// where it knows no instruction for it, as in a browser.
#[inline]
pub(crate) fn hypot(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// The angle between the axis and a ray of this length across and along it, from 0 to pi.
pub(crate) fn angle_from_axis(across: f64, along: f64) -> f64 {
    if along > across { atan(across / along) } else { std::f64::consts::FRAC_PI_2 - atan(along / across) }
}

/// The widest instructions that are taken: `v3` (AVX2) where the library was built with `CALIB_SIMD=v3`, so that a
/// machine that has more can be measured as one that has not.
#[cfg(target_arch = "x86_64")]
const WIDEST: Option<&str> = option_env!("CALIB_SIMD");

/// Runs a loop, which has to be inlined here, with the widest vector instructions there are.
#[inline(always)]
pub(crate) fn dispatch<R>(run: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if WIDEST == Some("v3")
        && let Some(v3) = pulp::x86::V3::try_new()
    {
        return v3.vectorize(run);
    }
    Arch::new().dispatch(run)
}

/// `r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8)`: what a radial lens does to a radius or an angle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OddPolynomial(pub(crate) [f64; 4]);

impl OddPolynomial {
    pub(crate) fn value(&self, r: f64) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        let s = r * r;
        r * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    }

    pub(crate) fn derivative(&self, r: f64) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        let s = r * r;
        1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))
    }

    /// The second derivative.
    pub(crate) fn curvature(&self, r: f64) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        let s = r * r;
        r * (6.0 * k1 + s * (20.0 * k2 + s * (42.0 * k3 + s * 72.0 * k4)))
    }

    /// No more than the derivative anywhere up to this radius: of what only takes from it. Where that leaves some,
    /// no root need be looked for.
    pub(crate) fn least_derivative(&self, r: f64) -> f64 {
        Self(self.0.map(|k| k.min(0.0))).derivative(r)
    }

    /// The smallest positive radius at which the polynomial stops growing; infinite if it never does.
    pub(crate) fn first_turn(&self) -> f64 {
        let [k1, k2, k3, k4] = self.0;
        if k3 == 0.0 && k4 == 0.0 {
            return first_turn_of_two(3.0 * k1, 5.0 * k2);
        }
        let roots = positive_roots(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4]);
        roots.first().map_or(f64::INFINITY, |s| s.sqrt())
    }

    /// The radius below [`Self::first_turn`] at which the polynomial has this value: Newton's method from the first terms
    /// of the inverse series, kept inside a bracket, so that it always ends.
    pub(crate) fn inverse(&self, value: f64) -> Option<f64> {
        /// Radii, in the series' own, one of which is beyond the answer for all but the outermost points of a lens.
        const NEAR: [f64; 4] = [1.001, 1.02, 1.1, 1.3];
        let [k1, k2, ..] = self.0;
        let s = value * value;
        let series = value * (1.0 - s * (k1 - s * (3.0 * k1 * k1 - k2)));
        // Where the series is of no use: it starts at the value.
        let start = if series > 0.5 * value && series < 2.0 * value { series } else { value };
        let grows_past = |near: &f64| self.value(*near) > value && self.least_derivative(*near) > 0.0;
        let mut high = match NEAR.map(|share| share * start).iter().find(|near| grows_past(near)) {
            Some(near) => *near,
            None => {
                let turn = self.first_turn();
                if turn.is_finite() { turn } else { grow_past(|r| self.value(r), value)? }
            }
        };
        if value.is_nan() || value > self.value(high) {
            return None;
        }
        let mut low = 0.0;
        let mut r = start.min(high);
        // Every round halves the bracket or doubles the digits.
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

/// The smallest positive `r` with `1 + a r^2 + b r^4 = 0`; infinite if there is none.
fn first_turn_of_two(a: f64, b: f64) -> f64 {
    let discriminant = a * a - 4.0 * b;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    // 2 c / (-b -+ sqrt(...)) form: no cancellation, and right for b = 0.
    let divisor = -a + discriminant.sqrt();
    if divisor > 0.0 { (2.0 / divisor).sqrt() } else { f64::INFINITY }
}

/// A radius at which a growing function exceeds `value`; `None` if there is none below a million.
fn grow_past(function: impl Fn(f64) -> f64, value: f64) -> Option<f64> {
    let mut radius = value.abs().max(1.0);
    while radius < 1e6 {
        if function(radius) >= value {
            return Some(radius);
        }
        radius *= 2.0;
    }
    None
}

/// The positive roots of a polynomial, ascending; coefficients from the constant upwards.
///
/// Between two neighbouring roots of the derivative there is at most one root: bisect there.
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
        fn they_are_those_of_the_system_to_the_last_bits(x in -7.0..7.0_f64, y in -7.0..7.0_f64) {
            let near = |a: f64, b: f64| (a - b).abs() <= 4.0 * f64::EPSILON * (1e-3 + b.abs());
            let ((sin, cos), expected) = (sin_cos(x), x.sin_cos());
            prop_assert!(near(sin, expected.0) && near(cos, expected.1));
            prop_assert!(near(tan(x), x.tan()) && near(atan(x), x.atan()) && near(hypot(x, y), x.hypot(y)));
        }
    }

    proptest! {
        #[test]
        fn the_first_turn_is_where_the_derivative_vanishes_first(
            k in [-0.5..0.5_f64, -0.3..0.3_f64, -0.1..0.1_f64, -0.05..0.05_f64],
        ) {
            let polynomial = OddPolynomial(k);
            let turn = polynomial.first_turn();
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
