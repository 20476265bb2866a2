//! A number with its derivatives: what analytic Jacobians of long formulas are made of.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Derivatives with respect to roll, pitch, log focal and log height.
pub(crate) type Gradient = [f64; 4];

/// What a formula is evaluated in: values alone, or values with their derivatives. Searches ask for
/// the values of many states, and for the derivatives of few.
pub(crate) trait Number:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// Whether it carries derivatives.
    const HAS_GRADIENT: bool;

    /// A value with its derivatives, which a number without them drops.
    fn new(value: f64, gradient: Gradient) -> Self;
    fn value(self) -> f64;
    /// A function of this number, with its value and derivative here.
    fn chain(self, value: f64, derivative: f64) -> Self;

    fn constant(value: f64) -> Self {
        Self::new(value, [0.0; 4])
    }

    /// The unknown of this index.
    fn unknown(value: f64, index: usize) -> Self {
        let mut gradient = [0.0; 4];
        gradient[index] = 1.0;
        Self::new(value, gradient)
    }

    #[inline]
    fn sqrt(self) -> Self {
        let root = self.value().sqrt();
        self.chain(root, 0.5 / root)
    }

    #[inline]
    fn ln(self) -> Self {
        self.chain(self.value().ln(), self.value().recip())
    }

    #[inline]
    fn exp(self) -> Self {
        let value = self.value().exp();
        self.chain(value, value)
    }

    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value().sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }
}

impl Number for f64 {
    const HAS_GRADIENT: bool = false;

    #[inline]
    fn new(value: f64, _: Gradient) -> Self {
        value
    }

    #[inline]
    fn value(self) -> f64 {
        self
    }

    #[inline]
    fn chain(self, value: f64, _: f64) -> Self {
        value
    }
}

/// A value with its derivatives (forward differentiation).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual {
    pub(crate) value: f64,
    pub(crate) gradient: Gradient,
}

impl Number for Dual {
    const HAS_GRADIENT: bool = true;

    #[inline]
    fn new(value: f64, gradient: Gradient) -> Self {
        Self { value, gradient }
    }

    #[inline]
    fn value(self) -> f64 {
        self.value
    }

    #[inline]
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, gradient: self.gradient.map(|s| s * derivative) }
    }
}

impl Add for Dual {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            gradient: std::array::from_fn(|i| self.gradient[i] + other.gradient[i]),
        }
    }
}

impl Sub for Dual {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self {
            value: self.value - other.value,
            gradient: std::array::from_fn(|i| self.gradient[i] - other.gradient[i]),
        }
    }
}

impl Mul for Dual {
    type Output = Self;
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the rules of derivation mix operators")]
    #[inline]
    fn mul(self, other: Self) -> Self {
        let gradient = |i: usize| self.gradient[i] * other.value + self.value * other.gradient[i];
        Self { value: self.value * other.value, gradient: std::array::from_fn(gradient) }
    }
}

impl Div for Dual {
    type Output = Self;
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the rules of derivation mix operators")]
    #[inline]
    fn div(self, other: Self) -> Self {
        // One division; the derivatives are multiplied.
        let (value, inverse) = (self.value / other.value, other.value.recip());
        let gradient = |i: usize| (self.gradient[i] - value * other.gradient[i]) * inverse;
        Self { value, gradient: std::array::from_fn(gradient) }
    }
}

impl Add<f64> for Dual {
    type Output = Self;
    #[inline]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, ..self }
    }
}

impl Sub<f64> for Dual {
    type Output = Self;
    #[inline]
    fn sub(self, other: f64) -> Self {
        Self { value: self.value - other, ..self }
    }
}

impl Mul<f64> for Dual {
    type Output = Self;
    #[inline]
    fn mul(self, other: f64) -> Self {
        self.chain(self.value * other, other)
    }
}

impl Neg for Dual {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self * -1.0
    }
}
