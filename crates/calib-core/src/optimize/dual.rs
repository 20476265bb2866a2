//! Dual numbers: values with their derivatives, for the analytic Jacobians of long formulas.
//!
//! Formulas of stage 1 have two kinds of arguments: the camera parameters, and the end points of the
//! annotations. The end points depend on the lens. Most evaluations need only the derivatives with respect to
//! the camera parameters. For them, parameters are [`Dual`] and end points are `f64`. A bundle adjustment
//! with a free lens also needs the derivatives with respect to the lens. For these derivatives, parameters and
//! end points are [`ByLens`]. A formula is generic, with the trait bound [`NumberOver`].

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Derivatives with respect to roll, pitch, log focal length, log height and the two tilts of the floor.
pub(crate) type Gradient = [f64; PARAMETERS];

/// Number of parameters of a formula of one camera (stage 1) without nuisance parameters: roll, pitch,
/// log focal length, log height and two floor tilts.
const PARAMETERS: usize = 6;

/// Value with its derivatives with respect to the lens parameters.
pub(crate) type ByLens = Dual<LENS>;

/// Number of lens parameters, as in [`Lens::PARAMETERS`](crate::Lens::PARAMETERS).
pub(crate) const LENS: usize = 8;

/// Number type of a formula: a plain value, or a value with derivatives. A search evaluates the formula at
/// many states, but needs derivatives at only a few of them.
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
    /// Whether the number type contains derivatives with respect to the parameters of stage 1.
    const HAS_GRADIENT: bool;

    /// Creates a number from a value and its derivatives with respect to the parameters of stage 1. A type
    /// without these derivatives ignores them.
    fn new(value: f64, gradient: Gradient) -> Self;
    /// Returns the value without its derivatives.
    fn value(self) -> f64;
    /// Returns the derivatives with respect to the parameters of stage 1; zeros if the type contains none.
    fn gradient(self) -> Gradient {
        [0.0; PARAMETERS]
    }
    /// Returns this number with its derivatives replaced by `gradient`. Returns it unchanged if its type
    /// contains no derivatives with respect to the parameters of stage 1.
    fn with_gradient(self, gradient: Gradient) -> Self {
        if Self::HAS_GRADIENT { Self::new(self.value(), gradient) } else { self }
    }
    /// Applies the chain rule: returns f of this number. `value` is the value of the function f at this
    /// number, `derivative` its derivative there.
    fn chain(self, value: f64, derivative: f64) -> Self;

    /// Creates a constant: a number whose derivatives are zero.
    fn constant(value: f64) -> Self {
        Self::new(value, [0.0; PARAMETERS])
    }

    /// Creates the parameter of stage 1 with this index: the derivative with respect to itself is 1.
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

    /// Returns the angle of the point `(x, self)` from the x axis, in radians from -pi to pi.
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

/// Number that a formula can combine with end points whose coordinates have the type `E`.
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

/// Value with its derivatives with respect to K parameters, by default those of stage 1 (forward
/// differentiation).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual<const K: usize = PARAMETERS> {
    /// Value of the number.
    pub(crate) value: f64,
    /// Derivatives of the value with respect to the parameters.
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
        // The derivatives are multiplied by the inverse, because divisions are slow.
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
