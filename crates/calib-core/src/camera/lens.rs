//! A lens: distortion as a map of pixels, in both directions, with its derivatives.

use crate::camera::distortion::{ByCoefficient, Distortion, Matrix2, RayByCoefficient, RayMatrix};
use crate::camera::space::{ImageCircle, Pixel, UndistortedPixel};

/// A lens: principal point and distortion, as a map between raw and undistorted pixels.
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
    /// Where a wide lens shows something, if that is known: it shows no ray outside. Other lenses fill the image.
    pub image_circle: Option<ImageCircle>,
}

/// How a place changes with every parameter of a lens, in the order of [`Lens::PARAMETERS`].
pub(crate) type ByParameters = [ByCoefficient; Lens::PARAMETERS];

impl Lens {
    /// Number of parameters: the coefficients of the distortion, then the principal point, u and v. Of a wide lens the
    /// one before the principal point, which no model has as a coefficient, is the log of its own focal.
    pub const PARAMETERS: usize = Distortion::MOST + 2;
    /// Index of the log of the own focal of a wide lens.
    pub const OWN_FOCAL: usize = Distortion::MOST - 1;
    /// Index of the principal point's u; v follows.
    pub const CENTRE: usize = Distortion::MOST;

    /// A lens that does not bend lines.
    #[must_use]
    pub const fn pinhole(principal_point: Pixel) -> Self {
        Self { principal_point, focal: 1.0, distortion: Distortion::None, image_circle: None }
    }

    /// Where a pinhole would show what this lens shows at `pixel`.
    ///
    /// `None` outside the domain in which the lens can be inverted: no ray of the scene leads there.
    #[must_use]
    pub fn undistort(&self, pixel: Pixel) -> Option<UndistortedPixel> {
        if self.distortion == Distortion::None {
            return Some(UndistortedPixel { u: pixel.u, v: pixel.v });
        }
        if !self.lights(pixel) {
            return None;
        }
        let Pixel { u: cu, v: cv } = self.principal_point;
        let [x, y] = self.distortion.undistort(self.normalised(pixel.into()))?;
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
        let [x, y] = self.distortion.distort(self.normalised(pixel.into()))?;
        Some(Pixel { u: cu + self.focal * x, v: cv + self.focal * y }).filter(|&pixel| self.lights(pixel))
    }

    /// The bearing of a pixel: where a pinhole would show what this lens shows there, as a homogeneous pixel relative
    /// to the principal point. Its third coordinate is positive ahead of the camera, and not beside and behind it,
    /// where a pinhole has no image and [`Self::undistort`] no answer.
    ///
    /// `None` where no ray of the scene leads.
    #[must_use]
    pub fn bearing(&self, pixel: Pixel) -> Option<[f64; 3]> {
        if !self.distortion.is_wide() {
            let (straight, Pixel { u: cu, v: cv }) = (self.undistort(pixel)?, self.principal_point);
            return Some([straight.u - cu, straight.v - cv, 1.0]);
        }
        if !self.lights(pixel) {
            return None;
        }
        let [x, y, w] = self.distortion.ray(self.normalised(pixel.into()))?;
        Some([self.focal * x, self.focal * y, w])
    }

    /// Where this lens shows a bearing, of any length; `None` where it does not.
    #[must_use]
    pub fn shown(&self, [x, y, w]: [f64; 3]) -> Option<Pixel> {
        let Pixel { u: cu, v: cv } = self.principal_point;
        if !self.distortion.is_wide() {
            let straight = UndistortedPixel { u: cu + x / w, v: cv + y / w };
            return if w > 0.0 { self.distort(straight) } else { None };
        }
        let [a, b] = self.distortion.shown([x / self.focal, y / self.focal, w])?;
        Some(Pixel { u: cu + self.focal * a, v: cv + self.focal * b }).filter(|&pixel| self.lights(pixel))
    }

    /// Whether a pixel is within the image circle, where one is known.
    fn lights(&self, pixel: Pixel) -> bool {
        self.image_circle.is_none_or(|circle| circle.holds(pixel) || !self.distortion.is_wide())
    }

    /// [`Self::bearing`] with its derivatives by u and v.
    pub(crate) fn bearing_with_jacobian(&self, pixel: Pixel) -> Option<([f64; 3], RayMatrix)> {
        if !self.distortion.is_wide() {
            let (straight, [u, v]) = self.undistort_with_jacobian(pixel)?;
            let Pixel { u: cu, v: cv } = self.principal_point;
            return Some(([straight.u - cu, straight.v - cv, 1.0], [u, v, [0.0; 2]]));
        }
        if !self.lights(pixel) {
            return None;
        }
        let bent = self.normalised(pixel.into());
        let ray = self.distortion.ray(bent)?;
        let [u, v, ahead] = self.distortion.ray_jacobian(bent, ray);
        let [x, y, w] = ray;
        Some(([self.focal * x, self.focal * y, w], [u, v, ahead.map(|by| by / self.focal)]))
    }

    /// How a bearing and its derivatives change with every parameter at the pixel that has it; with focal and
    /// principal point of a wide lens only.
    pub(crate) fn bearing_by_parameters(
        &self,
        pixel: Pixel,
        [x, y, w]: [f64; 3],
    ) -> [RayByCoefficient; Self::PARAMETERS] {
        let ray = [x / self.focal, y / self.focal, w];
        let bent = self.normalised(pixel.into());
        let mut by = [RayByCoefficient::default(); Self::PARAMETERS];
        for (by, of) in by.iter_mut().zip(&self.distortion.ray_by_coefficients(bent, ray)) {
            let ([x, y, w], [u, v, ahead]) = (of.at, of.jacobian);
            by.at = [self.focal * x, self.focal * y, w];
            by.jacobian = [u, v, [ahead[0] / self.focal, ahead[1] / self.focal]];
        }
        if self.distortion.is_wide() {
            let [focal, u, v] = self.bearing_by_scale_and_centre(bent, ray);
            by[Self::OWN_FOCAL] = focal;
            [by[Self::CENTRE], by[Self::CENTRE + 1]] = [u, v];
        }
        by
    }

    /// How the bearing `(f x, f y, w)(q)` of `q = (pixel - c) / f` and its Jacobian `(J, J_w / f)`, with J that of the
    /// ray by q, change with log f, where `dq = -q`, and with c, where `f dq = -e`.
    fn bearing_by_scale_and_centre(&self, bent: [f64; 2], ray: [f64; 3]) -> [RayByCoefficient; 3] {
        let focal = self.focal;
        let jacobian = self.distortion.ray_jacobian(bent, ray);
        let curvature = self.distortion.ray_curvature(bent, ray);
        let along = |row: usize| jacobian[row][0] * bent[0] + jacobian[row][1] * bent[1];
        let bend = |row: usize, k: usize| curvature[0][row][k] * bent[0] + curvature[1][row][k] * bent[1];
        let by_focal = RayByCoefficient {
            at: [focal * (ray[0] - along(0)), focal * (ray[1] - along(1)), -along(2)],
            jacobian: [
                [-bend(0, 0), -bend(0, 1)],
                [-bend(1, 0), -bend(1, 1)],
                [0, 1].map(|k| -(bend(2, k) + jacobian[2][k]) / focal),
            ],
        };
        let by_centre = |axis: usize| {
            let [x, y, ahead] = jacobian.map(|row| row[axis]);
            let [u, v, bent_ahead] = curvature[axis];
            RayByCoefficient {
                at: [-x, -y, -ahead / focal],
                jacobian: [u, v, bent_ahead.map(|by| by / focal)].map(|row| row.map(|by| -by / focal)),
            }
        };
        [by_focal, by_centre(0), by_centre(1)]
    }

    /// The log of the slope of a wide lens at a pixel, `d radius / d angle` over that at the axis, and its derivatives by
    /// every parameter. `None` where the lens shows nothing.
    pub(crate) fn log_slope(&self, pixel: Pixel) -> Option<(f64, [f64; Self::PARAMETERS])> {
        let bearing = self.bearing(pixel)?;
        let [u, v] = self.normalised(pixel.into());
        let radius = u.hypot(v).max(f64::MIN_POSITIVE);
        let out = [u / radius, v / radius];
        // Outwards by the unit of q = (pixel - c) / f: a change of c turns it across the radius only.
        let outwards = |rows: RayMatrix| rows.map(|[u, v]| u * out[0] + v * out[1]);
        let in_rays = |[u, v, ahead]: RayMatrix| outwards([u, v, ahead.map(|by| by * self.focal)]);
        let (_, jacobian) = self.bearing_with_jacobian(pixel)?;
        let turn = in_rays(jacobian);
        let square = turn.iter().map(|c| c * c).sum::<f64>();
        let mut by = self.bearing_by_parameters(pixel, bearing).map(|by| in_rays(by.jacobian));
        // There the focal is divided by once more.
        by[Self::OWN_FOCAL][2] += turn[2];
        let by = by.map(|change| -turn.iter().zip(change).map(|(a, b)| a * b).sum::<f64>() / square);
        // Where the angle is small there is no slope to speak of, nor a change of it.
        if radius < 1e-6 { Some((0.0, [0.0; Self::PARAMETERS])) } else { Some((-0.5 * square.ln(), by)) }
    }

    /// Whether every corner of an image of this width and height shows a ray: then all of it does. The corners of a wide
    /// lens are beyond its image circle, and not asked.
    #[must_use]
    pub fn shows_image(&self, [w, h]: [f64; 2]) -> bool {
        if self.distortion.is_wide() {
            return true;
        }
        let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
        corners.into_iter().all(|corner| self.distortion.reaches(self.normalised(corner)))
    }

    /// The same lens with one of its coefficients changed.
    #[cfg(test)]
    pub(crate) fn nudged(&self, parameter: usize, by: f64) -> Self {
        let mut lens = *self;
        match parameter {
            Self::OWN_FOCAL if self.distortion.is_wide() => lens.focal *= by.exp(),
            Self::CENTRE => lens.principal_point.u += by,
            coefficient if coefficient < Self::CENTRE => {
                let mut coefficients = self.distortion.coefficients();
                coefficients[coefficient] += by;
                lens.distortion = self.distortion.with_coefficients(coefficients);
            }
            _ => lens.principal_point.v += by,
        }
        lens
    }

    /// The same map of pixels with coefficients that refer to another focal.
    ///
    /// `None` for a model whose coefficients have a focal of their own.
    #[must_use]
    pub fn at_focal(&self, focal: f64) -> Option<Self> {
        let ratio = focal / self.focal;
        Some(Self { focal, distortion: self.distortion.rescaled(ratio)?, ..*self })
    }

    /// `d undistorted / d raw` at `pixel`, rows u and v; `None` outside the lens.
    #[must_use]
    pub fn undistort_jacobian(&self, pixel: Pixel) -> Option<[[f64; 2]; 2]> {
        self.undistort_with_jacobian(pixel).map(|(_, jacobian)| jacobian)
    }

    /// [`Self::undistort`] and [`Self::undistort_jacobian`] at once.
    #[must_use]
    pub fn undistort_with_jacobian(&self, pixel: Pixel) -> Option<(UndistortedPixel, [[f64; 2]; 2])> {
        let straight = self.undistort(pixel)?;
        let jacobian = self
            .distortion
            .undistort_jacobian(self.normalised(pixel.into()), self.normalised(straight.into()));
        Some((straight, jacobian))
    }

    /// How [`Self::undistort`] and its Jacobian change with every coefficient at `pixel`, which undistorts to
    /// `straight`; zeros for focal and principal point.
    pub(crate) fn undistort_by_parameters(&self, pixel: Pixel, straight: UndistortedPixel) -> ByParameters {
        let (bent, straight) = (self.normalised(pixel.into()), self.normalised(straight.into()));
        let mut by = ByParameters::default();
        let coefficients = self.distortion.undistort_by_coefficients(bent, straight);
        for (by, of) in by.iter_mut().zip(coefficients) {
            *by = ByCoefficient { at: of.at.map(|change| self.focal * change), ..of };
        }
        by
    }

    /// Derivatives of [`Self::distort`] at `straight`: `d raw / d undistorted`, rows u and v, and by every
    /// coefficient.
    pub(crate) fn distort_derivatives(
        &self,
        straight: UndistortedPixel,
    ) -> (Matrix2, [[f64; 2]; Distortion::MOST]) {
        let straight = self.normalised(straight.into());
        let by = self.distortion.distort_by_coefficients(straight);
        let by = by.map(|by| by.map(|change| self.focal * change));
        (self.distortion.distort_jacobian(straight), by)
    }

    /// Coordinates relative to the principal point, divided by the focal.
    fn normalised(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let Pixel { u: cu, v: cv } = self.principal_point;
        [(u - cu) / self.focal, (v - cv) / self.focal]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::distortion::tests::any_distortion;
    use crate::camera::distortion::times;
    use proptest::prelude::*;

    fn lens_of(distortion: Distortion) -> Lens {
        Lens { principal_point: Pixel::new(950.0, 530.0), focal: 1200.0, distortion, image_circle: None }
    }

    proptest! {
        #[test]
        fn a_rescaled_lens_is_the_same_map_of_pixels(
            distortion in any_distortion(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, focal in 600.0..3000.0_f64,
        ) {
            let lens = lens_of(distortion);
            if let (Some(other), Some(straight)) = (lens.at_focal(focal), lens.undistort(Pixel { u, v })) {
                let again = other.undistort(Pixel { u, v });
                prop_assert!(again.is_some_and(|p| p.distance(straight) < 1e-7 * (1.0 + straight.u.abs())));
            }
        }

        #[test]
        fn the_jacobian_of_undistortion_is_that_of_differences(
            distortion in any_distortion(), u in 300.0..1600.0_f64, v in 200.0..900.0_f64,
        ) {
            /// Of a pixel: truncation 1e-4 px^2 times the third derivative, rounding 1e-11.
            const STEP: f64 = 0.01;
            let lens = lens_of(distortion);
            let at = |du: f64, dv: f64| lens.undistort(Pixel { u: u + du, v: v + dv });
            let Some(exact) = lens.undistort_jacobian(Pixel { u, v }) else { return Ok(()) };
            let neighbours = [(at(STEP, 0.0), at(-STEP, 0.0)), (at(0.0, STEP), at(0.0, -STEP))];
            for (k, pair) in neighbours.into_iter().enumerate() {
                let (Some(ahead), Some(behind)) = pair else { continue };
                for (row, difference) in [ahead.u - behind.u, ahead.v - behind.v].into_iter().enumerate() {
                    let (a, b) = (exact[row][k], difference / (2.0 * STEP));
                    prop_assert!((a - b).abs() < 1e-5 * (1.0 + a.abs()).powi(2), "{exact:?} {a} {b}");
                }
            }
        }

        #[test]
        fn what_distorting_takes_undistorting_gives_back(
            distortion in any_distortion(), u in 300.0..1600.0_f64, v in 200.0..900.0_f64,
        ) {
            let lens = lens_of(distortion);
            let Some((straight, inverse)) = lens.undistort_with_jacobian(Pixel { u, v }) else { return Ok(()) };
            let (jacobian, by) = lens.distort_derivatives(straight);
            prop_assume!(inverse.iter().flatten().all(|slope| slope.abs() < 100.0));
            for (column, unit) in [[1.0, 0.0], [0.0, 1.0]].into_iter().enumerate() {
                let back = times(inverse, [jacobian[0][column], jacobian[1][column]]);
                prop_assert!((back[0] - unit[0]).hypot(back[1] - unit[1]) < 1e-9, "{back:?}");
            }
            let back = lens.undistort_by_parameters(Pixel { u, v }, straight);
            for (forward, back) in by.iter().zip(back) {
                // The implicit function: what a coefficient moves one way it moves back the other.
                let moved = times(inverse, *forward);
                let apart = (moved[0] + back.at[0]).hypot(moved[1] + back.at[1]);
                prop_assert!(apart < 1e-9 * (1.0 + moved[0].hypot(moved[1])), "{moved:?} {back:?}");
            }
        }
    }
}
