//! A number with its derivatives: what analytic Jacobians of long formulas are made of.
//!
//! Formulas of stage 1 have two kinds of arguments: the parameters of the camera, and the end points of what
//! was drawn, which depend on the lens. The hot path takes derivatives by the former ([`Dual`] parameters,
//! `f64` end points); a bundle adjustment with a free lens takes those by the latter as well ([`ByLens`] for
//! both). [`NumberOver`] is what a formula asks for.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Derivatives with respect to roll, pitch, log focal, log height and the two tilts of the floor.
pub(crate) type Gradient = [f64; PARAMETERS];

/// Number of parameters of stage 1 that a formula may depend on, its own nuisance parameters apart.
const PARAMETERS: usize = 6;

/// A value with its derivatives by the parameters of a lens.
pub(crate) type ByLens = Dual<LENS>;

/// Number of parameters of a lens.
pub(crate) const LENS: usize = 7;

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
    /// Whether it carries derivatives by the parameters.
    const HAS_GRADIENT: bool;

    /// A value with its derivatives by the parameters, which a number without them drops.
    fn new(value: f64, gradient: Gradient) -> Self;
    fn value(self) -> f64;
    /// The derivatives by the parameters; zeros of a number without them.
    fn gradient(self) -> Gradient {
        [0.0; PARAMETERS]
    }
    /// This number with other derivatives by the parameters, where it carries them.
    fn with_gradient(self, gradient: Gradient) -> Self {
        if Self::HAS_GRADIENT { Self::new(self.value(), gradient) } else { self }
    }
    /// A function of this number, with its value and derivative here.
    fn chain(self, value: f64, derivative: f64) -> Self;

    fn constant(value: f64) -> Self {
        Self::new(value, [0.0; PARAMETERS])
    }

    /// The parameter of this index.
    fn unknown(value: f64, index: usize) -> Self {
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

    /// The angle of the point `(x, self)`.
    #[inline]
    fn atan2(self, x: Self) -> Self {
        let (y, square) = (self.value(), x.value() * x.value() + self.value() * self.value());
        self.chain(y.atan2(x.value()), x.value() / square) + x.chain(0.0, -y / square)
    }

    /// This number, or the constant `least` where it is less.
    #[inline]
    fn at_least(self, least: f64) -> Self {
        if self.value() > least { self } else { Self::constant(least) }
    }
}

/// A number that formulas may mix with end points of coordinates `E`.
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

/// A value with its derivatives (forward differentiation): by the parameters of stage 1, or by others.
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
        // One division; the derivatives are multiplied.
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
