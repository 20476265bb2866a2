//! Lens distortion: models, both directions, and the domain in which a lens can be inverted.

use crate::camera::polynomial::{OddPolynomial, positive_roots};
use crate::camera::space::{Pixel, UndistortedPixel};

/// A lens: where its axis meets the image and how it bends lines.
///
/// The map is one of pixels: [`Lens::focal`] is the focal that the coefficients refer to, and it
/// stays as it is when the focal of the [`Camera`](crate::Camera) changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Principal point, in pixels.
    pub principal_point: Pixel,
    /// Focal that normalises the coordinates the coefficients apply to, in pixels.
    pub focal: f64,
    /// Distortion of the normalised coordinates.
    pub distortion: Distortion,
}

/// Distortion of coordinates divided by the focal, in the terms of OpenCV.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// A perfect pinhole.
    #[default]
    None,
    /// Radial k1, k2, k3 and tangential p1, p2; OpenCV's order of a vector is k1, k2, p1, p2, k3.
    BrownConrady(BrownConrady),
    /// `x_undistorted = x_distorted / (1 + lambda r_distorted^2)` (Fitzgibbon 2001).
    Division {
        /// The one coefficient; negative for barrel distortion.
        lambda: f64,
    },
    /// OpenCV's fisheye: `theta_distorted = theta (1 + k1 theta^2 + ... + k4 theta^8)`.
    KannalaBrandt {
        /// k1 to k4.
        k: [f64; 4],
    },
}

/// Coefficients of the Brown-Conrady model, as OpenCV names them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BrownConrady {
    /// Radial, with r^2.
    pub k1: f64,
    /// Radial, with r^4.
    pub k2: f64,
    /// Radial, with r^6.
    pub k3: f64,
    /// Tangential: vertical decentring.
    pub p1: f64,
    /// Tangential: horizontal decentring.
    pub p2: f64,
}

impl Lens {
    /// A lens that does not bend lines.
    #[must_use]
    pub const fn pinhole(principal_point: Pixel) -> Self {
        Self { principal_point, focal: 1.0, distortion: Distortion::None }
    }

    /// Where a pinhole would show what this lens shows at `pixel`.
    ///
    /// `None` outside the domain in which the lens can be inverted: no ray of the scene leads there.
    #[must_use]
    pub fn undistort(&self, pixel: Pixel) -> Option<UndistortedPixel> {
        if self.distortion == Distortion::None {
            return Some(UndistortedPixel { u: pixel.u, v: pixel.v });
        }
        let Pixel { u: cu, v: cv } = self.principal_point;
        let [x, y] = self.distortion.undistort([(pixel.u - cu) / self.focal, (pixel.v - cv) / self.focal])?;
        Some(UndistortedPixel { u: cu + self.focal * x, v: cv + self.focal * y })
    }

    /// Where this lens shows what a pinhole would show at `pixel`.
    ///
    /// `None` beyond [`Distortion::max_radius`], where the model folds back on itself.
    #[must_use]
    pub fn distort(&self, pixel: UndistortedPixel) -> Option<Pixel> {
        if self.distortion == Distortion::None {
            return Some(Pixel { u: pixel.u, v: pixel.v });
        }
        let Pixel { u: cu, v: cv } = self.principal_point;
        let [x, y] = self.distortion.distort([(pixel.u - cu) / self.focal, (pixel.v - cv) / self.focal])?;
        Some(Pixel { u: cu + self.focal * x, v: cv + self.focal * y })
    }

    /// Whether every corner of an image of this width and height shows a ray: then all of it does.
    #[must_use]
    pub(crate) fn shows_image(&self, [w, h]: [f64; 2]) -> bool {
        let Pixel { u: cu, v: cv } = self.principal_point;
        let normalised = |[u, v]: [f64; 2]| [(u - cu) / self.focal, (v - cv) / self.focal];
        let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
        corners.into_iter().all(|corner| self.distortion.reaches(normalised(corner)))
    }

    /// The same lens with one of its coefficients changed.
    pub(crate) fn nudged(&self, coefficient: usize, by: f64) -> Self {
        let mut coefficients = self.distortion.coefficients();
        coefficients[coefficient] += by;
        Self { distortion: self.distortion.with_coefficients(coefficients), ..*self }
    }

    /// The same map of pixels with coefficients that refer to another focal.
    ///
    /// `None` for the Kannala-Brandt model, whose coefficients have a focal of their own.
    #[must_use]
    pub fn at_focal(&self, focal: f64) -> Option<Self> {
        let ratio = focal / self.focal;
        Some(Self { focal, distortion: self.distortion.rescaled(ratio)?, ..*self })
    }

    /// `d undistorted / d raw` at `pixel`, rows u and v; `None` outside the lens.
    #[must_use]
    pub fn undistort_jacobian(&self, pixel: Pixel) -> Option<[[f64; 2]; 2]> {
        self.undistort_with_jacobian(pixel).map(|(_, slope)| slope)
    }

    /// [`Self::undistort`] and [`Self::undistort_jacobian`] at once.
    #[must_use]
    pub fn undistort_with_jacobian(&self, pixel: Pixel) -> Option<(UndistortedPixel, [[f64; 2]; 2])> {
        let straight = self.undistort(pixel)?;
        let Pixel { u: cu, v: cv } = self.principal_point;
        let raw = [(pixel.u - cu) / self.focal, (pixel.v - cv) / self.focal];
        let slope = match self.distortion {
            Distortion::None => Some([[1.0, 0.0], [0.0, 1.0]]),
            Distortion::BrownConrady(brown) => {
                let [a, b, d] =
                    brown.jacobian([(straight.u - cu) / self.focal, (straight.v - cv) / self.focal]);
                let determinant = a * d - b * b;
                Some([[d / determinant, -b / determinant], [-b / determinant, a / determinant]])
            }
            Distortion::Division { lambda } => {
                let [x, y] = raw;
                let divisor = 1.0 + lambda * (x * x + y * y);
                let square = divisor * divisor;
                let cross = -2.0 * lambda * x * y / square;
                let along = |c: f64| 1.0 / divisor - 2.0 * lambda * c * c / square;
                (divisor > 0.0).then(|| [[along(x), cross], [cross, along(y)]])
            }
            Distortion::KannalaBrandt { .. } => self.jacobian_by_differences(pixel),
        };
        Some((straight, slope?))
    }

    fn jacobian_by_differences(&self, pixel: Pixel) -> Option<[[f64; 2]; 2]> {
        // Truncation 1e-4 px^2 times the third derivative, rounding 1e-11: both far below a drawn pixel.
        const STEP: f64 = 0.01;
        let at = |du: f64, dv: f64| self.undistort(Pixel { u: pixel.u + du, v: pixel.v + dv });
        let (right, left) = (at(STEP, 0.0)?, at(-STEP, 0.0)?);
        let (down, up) = (at(0.0, STEP)?, at(0.0, -STEP)?);
        let half = 0.5 / STEP;
        Some([
            [(right.u - left.u) * half, (down.u - up.u) * half],
            [(right.v - left.v) * half, (down.v - up.v) * half],
        ])
    }
}

impl Distortion {
    /// Number of coefficients of the largest model.
    pub const MOST: usize = 5;

    /// Names of the coefficients in files, in the order of [`Self::coefficients`].
    #[must_use]
    pub const fn names(&self) -> &'static [&'static str] {
        match self {
            Self::None => &[],
            Self::BrownConrady(_) => &["k1", "k2", "k3", "p1", "p2"],
            Self::Division { .. } => &["lambda"],
            Self::KannalaBrandt { .. } => &["k1", "k2", "k3", "k4"],
        }
    }

    /// The coefficients; zeros beyond those the model has.
    #[must_use]
    pub const fn coefficients(&self) -> [f64; Self::MOST] {
        match *self {
            Self::None => [0.0; Self::MOST],
            Self::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }) => [k1, k2, k3, p1, p2],
            Self::Division { lambda } => [lambda, 0.0, 0.0, 0.0, 0.0],
            Self::KannalaBrandt { k: [k1, k2, k3, k4] } => [k1, k2, k3, k4, 0.0],
        }
    }

    /// The same model with other coefficients.
    #[must_use]
    pub const fn with_coefficients(&self, [a, b, c, d, e]: [f64; Self::MOST]) -> Self {
        match self {
            Self::None => Self::None,
            Self::BrownConrady(_) => Self::BrownConrady(BrownConrady { k1: a, k2: b, k3: c, p1: d, p2: e }),
            Self::Division { .. } => Self::Division { lambda: a },
            Self::KannalaBrandt { .. } => Self::KannalaBrandt { k: [a, b, c, d] },
        }
    }

    /// With which power of the focal every coefficient grows when the map of pixels stays what it is.
    #[must_use]
    pub(crate) const fn powers(&self) -> [i32; Self::MOST] {
        match self {
            Self::None | Self::KannalaBrandt { .. } => [0; Self::MOST],
            Self::BrownConrady(_) => [2, 4, 6, 1, 1],
            Self::Division { .. } => [2, 0, 0, 0, 0],
        }
    }

    /// Radius of the largest disc of undistorted, focal-normalised coordinates on which the model grows
    /// in every direction; infinite where it always does. Beyond it the model is not a lens.
    #[must_use]
    pub fn max_radius(&self) -> f64 {
        match *self {
            Self::None => f64::INFINITY,
            Self::BrownConrady(b) => b.fold(),
            Self::Division { lambda } if lambda > 0.0 => 0.5 / lambda.sqrt(),
            Self::Division { .. } => f64::INFINITY,
            Self::KannalaBrandt { k } => {
                let theta = OddPolynomial(k).first_turn();
                if theta < std::f64::consts::FRAC_PI_2 { theta.tan() } else { f64::INFINITY }
            }
        }
    }

    /// Distorted from undistorted, both divided by the focal. `None` beyond [`Self::max_radius`].
    #[must_use]
    pub fn distort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let scale = match *self {
            Self::None => 1.0,
            Self::BrownConrady(b) => return b.is_regular([x, y]).then(|| b.distort([x, y])),
            Self::Division { lambda } => {
                let root = 1.0 - 4.0 * lambda * (x * x + y * y);
                if root < 0.0 {
                    return None;
                }
                2.0 / (1.0 + root.sqrt())
            }
            Self::KannalaBrandt { k } => {
                let radius = x.hypot(y);
                let theta = radius.atan();
                if theta > OddPolynomial(k).first_turn() {
                    return None;
                }
                if radius < 1e-9 { 1.0 } else { OddPolynomial(k).value(theta) / radius }
            }
        };
        let bent = [scale * x, scale * y];
        bent.iter().all(|value| value.is_finite()).then_some(bent)
    }

    /// Undistorted from distorted, both divided by the focal, to 1e-12.
    ///
    /// `None` where no undistorted point inside [`Self::max_radius`] leads here.
    #[must_use]
    pub fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let scale = match *self {
            Self::None => 1.0,
            Self::BrownConrady(b) => return b.undistort([x, y]),
            Self::Division { lambda } => {
                let square = x * x + y * y;
                if lambda > 0.0 && square > 1.0 / lambda {
                    return None;
                }
                let divisor = 1.0 + lambda * square;
                if divisor <= 0.0 {
                    return None;
                }
                divisor.recip()
            }
            Self::KannalaBrandt { k } => {
                let radius = x.hypot(y);
                let theta = OddPolynomial(k).inverse(radius)?;
                if theta >= std::f64::consts::FRAC_PI_2 {
                    return None;
                }
                if radius < 1e-9 { 1.0 } else { theta.tan() / radius }
            }
        };
        let straight = [scale * x, scale * y];
        straight.iter().all(|value| value.is_finite()).then_some(straight)
    }

    /// Whether the model still grows at this distorted point, so that a ray of the scene leads there:
    /// for a fisheye also one from beside or behind the camera, which no pinhole sees.
    pub(crate) fn reaches(&self, [x, y]: [f64; 2]) -> bool {
        match *self {
            Self::KannalaBrandt { k } => OddPolynomial(k).inverse(x.hypot(y)).is_some(),
            _ => self.undistort([x, y]).is_some(),
        }
    }

    /// The coefficients of the same map of pixels when the focal is multiplied by `ratio`.
    ///
    /// `None` for Kannala-Brandt: its map of pixels exists at one focal only.
    #[must_use]
    pub fn rescaled(&self, ratio: f64) -> Option<Self> {
        if let Self::KannalaBrandt { .. } = self {
            return (ratio == 1.0).then_some(*self);
        }
        let (coefficients, powers) = (self.coefficients(), self.powers());
        Some(self.with_coefficients(std::array::from_fn(|i| coefficients[i] * ratio.powi(powers[i]))))
    }
}

impl BrownConrady {
    /// The radial part, as a polynomial of the radius.
    pub(crate) fn radial(&self) -> OddPolynomial {
        OddPolynomial([self.k1, self.k2, self.k3, 0.0])
    }

    /// `x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)`, and
    /// `y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y`.
    #[inline]
    pub(crate) fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let square = x * x + y * y;
        let radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3));
        [
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (square + 2.0 * x * x),
            y * radial + self.p1 * (square + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        ]
    }

    /// Derivative of [`Self::distort`], which is symmetric: `[dx'/dx, dx'/dy, dy'/dy]`.
    #[inline]
    pub(crate) fn jacobian(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let square = x * x + y * y;
        let radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3));
        let slope = self.k1 + square * (2.0 * self.k2 + 3.0 * self.k3 * square);
        [
            radial + 2.0 * x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            2.0 * x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y,
            radial + 2.0 * y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        ]
    }

    /// The smallest radius at which the model stops growing in some direction; infinite if there is none.
    ///
    /// Across a radius the tangential part is `3 r^2 (p1 sin + p2 cos)` of its direction.
    fn fold(&self) -> f64 {
        let tangential = self.p1.hypot(self.p2);
        if tangential == 0.0 {
            return self.radial().first_turn();
        }
        let slope = [1.0, -6.0 * tangential, 3.0 * self.k1, 0.0, 5.0 * self.k2, 0.0, 7.0 * self.k3];
        positive_roots(&slope).first().copied().unwrap_or(f64::INFINITY)
    }

    /// Whether the map can be inverted within the radius of this undistorted point.
    fn is_regular(&self, [x, y]: [f64; 2]) -> bool {
        let radius = x.hypot(y);
        self.surely_grows(radius) || radius <= self.fold()
    }

    /// Whether the model grows up to this radius by what only takes from its derivative: where even that
    /// leaves some, no root need be looked for.
    fn surely_grows(&self, radius: f64) -> bool {
        self.radial().least_slope(radius) > 6.0 * self.p1.hypot(self.p2) * radius
    }

    /// Newton's method from the solution of the radial part, which a bracket guards.
    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        /// Newton doubles its digits: the tangential part is small, five steps are many; at the very fold
        /// it only halves the error.
        const ROUNDS: usize = 50;
        /// Of the focal-normalised coordinates; a millionth of a millionth of the focal.
        const TOLERANCE: f64 = 1e-13;
        let radius = x.hypot(y);
        let tangential = self.p1 != 0.0 || self.p2 != 0.0;
        let straight = match self.radial().inverse(radius) {
            Some(straight) if !tangential => straight,
            None if !tangential => return None,
            Some(straight) if self.surely_grows(1.1 * straight) => straight,
            // From within: beyond the fold Newton's method runs away, up to it it never oversteps.
            straight => straight.unwrap_or(f64::INFINITY).min(0.99 * self.fold()),
        };
        let scale = if radius > 0.0 { straight / radius } else { 1.0 };
        let mut point = [scale * x, scale * y];
        if !tangential {
            return point.iter().all(|value| value.is_finite()).then_some(point);
        }
        for _ in 0..ROUNDS {
            let bent = self.distort(point);
            let (ex, ey) = (bent[0] - x, bent[1] - y);
            let [a, b, d] = self.jacobian(point);
            let determinant = a * d - b * b;
            let step = [(d * ex - b * ey) / determinant, (a * ey - b * ex) / determinant];
            point = [point[0] - step[0], point[1] - step[1]];
            if step[0].abs().max(step[1].abs()) < TOLERANCE * (1.0 + radius) {
                let bent = self.distort(point);
                let close = (bent[0] - x).hypot(bent[1] - y) < 1e-12 * (1.0 + radius);
                return (close && self.is_regular(point)).then_some(point);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_distortion() -> impl Strategy<Value = Distortion> {
        let brown = (-0.4..0.3_f64, -0.2..0.2_f64, -0.05..0.05_f64, -0.003..0.003_f64, -0.003..0.003_f64)
            .prop_map(|(k1, k2, k3, p1, p2)| Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }));
        let fisheye = [-0.1..0.1_f64, -0.05..0.05_f64, -0.02..0.02_f64, -0.005..0.005_f64]
            .prop_map(|k| Distortion::KannalaBrandt { k });
        prop_oneof![brown, (-1.0..0.5_f64).prop_map(|lambda| Distortion::Division { lambda }), fisheye]
    }

    proptest! {
        #[test]
        fn undistorting_a_distorted_point_gives_it_back(
            distortion in any_distortion(), x in -1.5..1.5_f64, y in -1.5..1.5_f64,
        ) {
            if let Some(bent) = distortion.distort([x, y]) {
                // At the very fold the derivative vanishes, and digits with it.
                prop_assume!(x.hypot(y) < 0.98 * distortion.max_radius());
                let back = distortion.undistort(bent);
                let near = |back: [f64; 2]| (back[0] - x).hypot(back[1] - y) < 1e-10;
                prop_assert!(back.is_some_and(near), "{back:?} {x} {y}");
            }
        }

        #[test]
        fn distorting_an_undistorted_point_gives_it_back(
            distortion in any_distortion(), x in -1.0..1.0_f64, y in -1.0..1.0_f64,
        ) {
            if let Some(straight) = distortion.undistort([x, y]) {
                prop_assume!(straight[0].hypot(straight[1]) < 100.0);
                let back = distortion.distort(straight);
                prop_assert!(back.is_some(), "undistorted out of the domain: {straight:?}");
                if let Some(back) = back {
                    prop_assert!((back[0] - x).hypot(back[1] - y) < 1e-11, "{back:?} {x} {y}");
                }
            }
        }

        #[test]
        fn a_rescaled_lens_is_the_same_map_of_pixels(
            distortion in any_distortion(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, focal in 600.0..3000.0_f64,
        ) {
            let lens = Lens { principal_point: Pixel::new(950.0, 530.0), focal: 1200.0, distortion };
            if let (Some(other), Some(straight)) = (lens.at_focal(focal), lens.undistort(Pixel { u, v })) {
                let again = other.undistort(Pixel { u, v });
                prop_assert!(again.is_some_and(|p| p.distance(straight) < 1e-7 * (1.0 + straight.u.abs())));
            }
        }

        #[test]
        fn the_slope_of_undistortion_is_that_of_differences(
            distortion in any_distortion(), u in 300.0..1600.0_f64, v in 200.0..900.0_f64,
        ) {
            let lens = Lens { principal_point: Pixel::new(950.0, 530.0), focal: 1200.0, distortion };
            let pixel = Pixel { u, v };
            if let (Some(exact), Some(numeric)) = (lens.undistort_jacobian(pixel), lens.jacobian_by_differences(pixel)) {
                for (a, b) in exact.iter().flatten().zip(numeric.iter().flatten()) {
                    prop_assert!((a - b).abs() < 1e-5 * (1.0 + a.abs()).powi(2), "{exact:?} {numeric:?}");
                }
            }
        }
    }

    #[test]
    fn a_barrel_lens_says_where_it_folds() {
        let b = BrownConrady { k1: -0.35, ..BrownConrady::default() };
        let turn = Distortion::BrownConrady(b).max_radius();
        assert!((1.0 - 3.0 * 0.35 * turn * turn).abs() < 1e-12);
        assert_eq!(Distortion::BrownConrady(b).distort([turn * 1.01, 0.0]), None);
        let last = b.radial().value(turn);
        assert_eq!(Distortion::BrownConrady(b).undistort([last * 1.01, 0.0]), None);
        assert!(Distortion::BrownConrady(b).reaches([0.0, last * 0.99]));
        assert!(!Distortion::BrownConrady(b).reaches([0.0, last * 1.01]));
    }
}
