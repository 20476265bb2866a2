//! A number with its derivatives: what analytic Jacobians of long formulas are made of.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Derivatives with respect to roll, pitch, log focal and log height.
pub(crate) type Slope = [f64; 4];

/// A value with its derivatives (forward differentiation).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual {
    pub(crate) value: f64,
    pub(crate) slope: Slope,
}

impl Dual {
    pub(crate) const fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; 4] }
    }

    /// The unknown of this index.
    pub(crate) const fn unknown(value: f64, index: usize) -> Self {
        let mut slope = [0.0; 4];
        slope[index] = 1.0;
        Self { value, slope }
    }

    /// A function of this number, with its value and derivative here.
    #[inline]
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, slope: self.slope.map(|s| s * derivative) }
    }

    pub(crate) fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }

    pub(crate) fn ln(self) -> Self {
        self.chain(self.value.ln(), self.value.recip())
    }

    pub(crate) fn exp(self) -> Self {
        let value = self.value.exp();
        self.chain(value, value)
    }

    pub(crate) fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, |$a:ident, $b:ident| $value:expr, |$s:ident, $t:ident| $slope:expr) => {
        impl $trait for Dual {
            type Output = Self;
            #[allow(clippy::suspicious_arithmetic_impl, reason = "the rules of derivation mix operators")]
            #[inline]
            fn $method(self, other: Self) -> Self {
                let ($a, $b) = (self.value, other.value);
                let slope = std::array::from_fn(|i| {
                    let ($s, $t) = (self.slope[i], other.slope[i]);
                    $slope
                });
                Self { value: $value, slope }
            }
        }
        impl $trait<f64> for Dual {
            type Output = Self;
            #[inline]
            fn $method(self, other: f64) -> Self {
                $trait::$method(self, Self::constant(other))
            }
        }
    };
}

operator!(Add, add, |a, b| a + b, |s, t| s + t);
operator!(Sub, sub, |a, b| a - b, |s, t| s - t);
operator!(Mul, mul, |a, b| a * b, |s, t| s * b + a * t);
operator!(Div, div, |a, b| a / b, |s, t| (s - a / b * t) / b);

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self * -1.0
    }
}
