//! Dual numbers: values with their derivatives, for the analytic Jacobians of long formulas.
//!
//! Formulas of stage 1 have two kinds of arguments: the camera parameters, and the end points of the
//! annotations, which depend on the lens. The hot path needs only the derivatives by the camera parameters
//! ([`Dual`] parameters, `f64` end points). A bundle adjustment with a free lens also needs those by the lens
//! ([`ByLens`] for both). [`NumberOver`] is the bound of a formula.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Derivatives by roll, pitch, log focal length, log height and the two tilts of the floor.
pub(crate) type Gradient = [f64; PARAMETERS];

/// Number of parameters of stage 1 in a formula, without its nuisance parameters.
const PARAMETERS: usize = 6;

/// Value with its derivatives by the lens parameters.
pub(crate) type ByLens = Dual<LENS>;

/// Number of lens parameters.
pub(crate) const LENS: usize = 7;

/// Number type of a formula: a plain value, or a value with derivatives. A search evaluates many states, but
/// needs the derivatives of only a few.
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
    /// Whether the number has derivatives by the parameters.
    const HAS_GRADIENT: bool;

    /// Creates a number from a value and its derivatives by the parameters. A plain value drops the
    /// derivatives.
    fn new(value: f64, gradient: Gradient) -> Self;
    fn value(self) -> f64;
    /// Returns the derivatives by the parameters; zeros for a plain value.
    fn gradient(self) -> Gradient {
        [0.0; PARAMETERS]
    }
    /// Returns this number with other derivatives by the parameters, if it has any.
    fn with_gradient(self, gradient: Gradient) -> Self {
        if Self::HAS_GRADIENT { Self::new(self.value(), gradient) } else { self }
    }
    /// Applies the chain rule: returns a function of this number, from its value and its derivative at this
    /// number.
    fn chain(self, value: f64, derivative: f64) -> Self;

    fn constant(value: f64) -> Self {
        Self::new(value, [0.0; PARAMETERS])
    }

    /// Creates the parameter with this index.
    fn parameter(value: f64, index: usize) -> Self {
        let mut gradient = [0.0; PARAMETERS];
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

    /// Returns the angle of the point `(x, self)`.
    #[inline]
    fn atan2(self, x: Self) -> Self {
        let (y, square) = (self.value(), x.value() * x.value() + self.value() * self.value());
        self.chain(y.atan2(x.value()), x.value() / square) + x.chain(0.0, -y / square)
    }

    /// Returns the larger of this number and the constant `least`.
    #[inline]
    fn at_least(self, least: f64) -> Self {
        if self.value() > least { self } else { Self::constant(least) }
    }
}

/// Number that a formula can combine with end points of the coordinate type `E`.
pub(crate) trait NumberOver<E>:
    Number + From<E> + Add<E, Output = Self> + Sub<E, Output = Self> + Mul<E, Output = Self>
{
}

impl<E, N> NumberOver<E> for N where
    N: Number + From<E> + Add<E, Output = N> + Sub<E, Output = N> + Mul<E, Output = N>
{
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

/// Value with its derivatives (forward differentiation), by the parameters of stage 1 or by others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual<const K: usize = PARAMETERS> {
    pub(crate) value: f64,
    pub(crate) gradient: [f64; K],
}

impl Number for Dual {
    const HAS_GRADIENT: bool = true;

    #[inline]
    fn new(value: f64, gradient: Gradient) -> Self {
        Self { value, gradient }
    }

    #[inline]
    fn gradient(self) -> Gradient {
        self.gradient
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

impl Number for ByLens {
    const HAS_GRADIENT: bool = false;

    #[inline]
    fn new(value: f64, _: Gradient) -> Self {
        Self { value, gradient: [0.0; LENS] }
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

impl From<f64> for Dual {
    #[inline]
    fn from(value: f64) -> Self {
        Self::constant(value)
    }
}

impl<const K: usize> Add for Dual<K> {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            gradient: std::array::from_fn(|i| self.gradient[i] + other.gradient[i]),
        }
    }
}

impl<const K: usize> Sub for Dual<K> {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self {
            value: self.value - other.value,
            gradient: std::array::from_fn(|i| self.gradient[i] - other.gradient[i]),
        }
    }
}

impl<const K: usize> Mul for Dual<K> {
    type Output = Self;
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the rules of derivation mix operators")]
    #[inline]
    fn mul(self, other: Self) -> Self {
        let gradient = |i: usize| self.gradient[i] * other.value + self.value * other.gradient[i];
        Self { value: self.value * other.value, gradient: std::array::from_fn(gradient) }
    }
}

impl<const K: usize> Div for Dual<K> {
    type Output = Self;
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the rules of derivation mix operators")]
    #[inline]
    fn div(self, other: Self) -> Self {
        // A single division; the derivatives are multiplied by the inverse.
        let (value, inverse) = (self.value / other.value, other.value.recip());
        let gradient = |i: usize| (self.gradient[i] - value * other.gradient[i]) * inverse;
        Self { value, gradient: std::array::from_fn(gradient) }
    }
}

impl<const K: usize> Add<f64> for Dual<K> {
    type Output = Self;
    #[inline]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, ..self }
    }
}

impl<const K: usize> Sub<f64> for Dual<K> {
    type Output = Self;
    #[inline]
    fn sub(self, other: f64) -> Self {
        Self { value: self.value - other, ..self }
    }
}

impl<const K: usize> Mul<f64> for Dual<K> {
    type Output = Self;
    #[inline]
    fn mul(self, other: f64) -> Self {
        Self { value: self.value * other, gradient: self.gradient.map(|s| s * other) }
    }
}

impl<const K: usize> Neg for Dual<K> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self * -1.0
    }
}
