//! Vectors of the renderer in single precision: points, directions and colours.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use calib_core::WorldPoint;

/// Point or direction (world axes, metres), or linear colour (red, green, blue).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Vec3 {
    pub(crate) x: f32,
    pub(crate) y: f32,
    pub(crate) z: f32,
}

/// Returns the lesser number with one instruction; [`f32::min`] needs more because it handles NaN.
#[inline]
pub(crate) const fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the greater number with one instruction; see [`lesser`].
#[inline]
pub(crate) const fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the vector with these coordinates.
pub(crate) const fn vec3(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3 { x, y, z }
}

impl Vec3 {
    pub(crate) const ZERO: Self = vec3(0.0, 0.0, 0.0);
    pub(crate) const UP: Self = vec3(0.0, 0.0, 1.0);

    pub(crate) const fn grey(value: f32) -> Self {
        vec3(value, value, value)
    }

    #[inline]
    pub(crate) fn dot(self, other: Self) -> f32 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    pub(crate) fn cross(self, o: Self) -> Self {
        vec3(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }

    pub(crate) fn length(self) -> f32 {
        self.dot(self).sqrt()
    }

    pub(crate) fn unit(self) -> Self {
        self * self.length().recip()
    }

    /// Returns the vector of the lesser coordinates of both vectors.
    #[inline]
    pub(crate) fn min(self, o: Self) -> Self {
        vec3(lesser(self.x, o.x), lesser(self.y, o.y), lesser(self.z, o.z))
    }

    /// Returns the vector of the greater coordinates of both vectors.
    #[inline]
    pub(crate) fn max(self, o: Self) -> Self {
        vec3(greater(self.x, o.x), greater(self.y, o.y), greater(self.z, o.z))
    }

    pub(crate) fn map(self, f: impl Fn(f32) -> f32) -> Self {
        vec3(f(self.x), f(self.y), f(self.z))
    }

    /// Returns the coordinate with index 0, 1 or 2: x, y or z.
    #[inline]
    pub(crate) const fn axis(self, index: usize) -> f32 {
        match index {
            0 => self.x,
            1 => self.y,
            _ => self.z,
        }
    }

    /// Interpolates between this vector (`t` = 0) and another one (`t` = 1).
    pub(crate) fn towards(self, there: Self, t: f32) -> Self {
        self + (there - self) * t
    }

    /// Returns the perceived brightness of a colour.
    pub(crate) fn luminance(self) -> f32 {
        0.2126 * self.x + 0.7152 * self.y + 0.0722 * self.z
    }
}

impl From<WorldPoint> for Vec3 {
    fn from(point: WorldPoint) -> Self {
        vec3(point.x as f32, point.y as f32, point.z as f32)
    }
}

impl Add for Vec3 {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        vec3(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl AddAssign for Vec3 {
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl Sub for Vec3 {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        vec3(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl Neg for Vec3 {
    type Output = Self;
    fn neg(self) -> Self {
        vec3(-self.x, -self.y, -self.z)
    }
}

impl Mul<f32> for Vec3 {
    type Output = Self;
    #[inline]
    fn mul(self, s: f32) -> Self {
        vec3(self.x * s, self.y * s, self.z * s)
    }
}

/// Multiplies coordinate by coordinate: light by reflectance.
impl Mul for Vec3 {
    type Output = Self;
    #[inline]
    fn mul(self, o: Self) -> Self {
        vec3(self.x * o.x, self.y * o.y, self.z * o.z)
    }
}

impl From<[f32; 3]> for Vec3 {
    fn from([x, y, z]: [f32; 3]) -> Self {
        vec3(x, y, z)
    }
}
