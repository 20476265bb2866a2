//! Elementary functions that have the same bits on every machine.
//!
//! Those of the standard library are the system's, and no two systems agree in the last bit: what a camera maps in a
//! browser would not be what it maps on a server.

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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn they_are_those_of_the_system_to_the_last_bits(x in -7.0..7.0_f64, y in -7.0..7.0_f64) {
            let near = |a: f64, b: f64| (a - b).abs() <= 4.0 * f64::EPSILON * (1e-3 + b.abs());
            let ((sin, cos), expected) = (sin_cos(x), x.sin_cos());
            prop_assert!(near(sin, expected.0) && near(cos, expected.1));
            prop_assert!(near(tan(x), x.tan()) && near(atan(x), x.atan()) && near(hypot(x, y), x.hypot(y)));
        }
    }
}
