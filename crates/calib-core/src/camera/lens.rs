//! Lens: distortion as a map between raw and undistorted pixels, with its derivatives.

use crate::camera::distortion::{ByCoefficient, Distortion, Matrix2, RayByCoefficient, RayMatrix};
use crate::camera::space::{ImageCircle, Pixel, UndistortedPixel};

/// Lens: principal point and distortion, as a map between raw and undistorted pixels.
///
/// [`Lens::focal`] is the focal length to which the coefficients refer. It does not change with the focal
/// length of the [`Camera`](crate::Camera).
///
/// Focal lengths are in pixels along u. With the pixel aspect `a = fy / fx`, the focal length along v is a
/// times as large. The maps first scale the image to square pixels: `(u, cv + (v - cv) / a)`, with the
/// principal point (cu, cv). Undistorted pixels are square, for every aspect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Principal point, in raw pixels from the upper left corner.
    pub principal_point: Pixel,
    /// Focal length that normalises the coordinates of the distortion, in pixels.
    pub focal: f64,
    /// Pixel aspect: width over height of a pixel, which is the ratio `fy / fx` of the focal lengths; 1 for
    /// square pixels.
    pub pixel_aspect: f64,
    /// Distortion of the normalised coordinates.
    pub distortion: Distortion,
    /// Image circle of a wide lens, in square pixels (see [`Lens::to_square_pixel`]), if it is known. Pixels
    /// outside the circle show no rays. Other lenses fill the image, and ignore this field.
    pub image_circle: Option<ImageCircle>,
}

/// Derivatives of a point and of its Jacobian with respect to every lens parameter, in the order of
/// [`Lens::PARAMETERS`].
pub(crate) type ByParameters = [ByCoefficient; Lens::PARAMETERS];

impl Lens {
    /// Number of parameters: the distortion coefficients, then u and v of the principal point, and the pixel
    /// aspect. For a wide lens, the parameter before the principal point is the log of the focal length of
    /// the lens. No wide model that can be fitted has a coefficient at this index.
    pub const PARAMETERS: usize = Distortion::MAX_FITTED + 3;
    /// Index of the log of the focal length of the lens, for wide lenses only.
    pub const LENS_FOCAL: usize = Distortion::MAX_FITTED - 1;
    /// Index of the u coordinate of the principal point; v follows.
    pub const CENTRE: usize = Distortion::MAX_FITTED;
    /// Index of the pixel aspect.
    pub const ASPECT: usize = Self::CENTRE + 2;

    /// Creates a lens without distortion.
    #[must_use]
    pub const fn pinhole(principal_point: Pixel) -> Self {
        Self {
            principal_point,
            focal: 1.0,
            pixel_aspect: 1.0,
            distortion: Distortion::None,
            image_circle: None,
        }
    }

    /// Maps a raw pixel to the undistorted pixel: the pixel at which a pinhole would show the same ray.
    ///
    /// Returns `None` if no ray of the scene reaches the raw pixel, or if its ray is 90° or more from the
    /// optical axis.
    #[must_use]
    pub fn undistort(&self, pixel: Pixel) -> Option<UndistortedPixel> {
        let pixel = self.to_square_pixel(pixel);
        if self.distortion == Distortion::None {
            return Some(UndistortedPixel { u: pixel.u, v: pixel.v });
        }
        if !self.is_in_image_circle(pixel) {
            return None;
        }
        let Pixel { u: cu, v: cv } = self.principal_point;
        let [x, y] = self.distortion.undistort(self.normalised(pixel.into()))?;
        Some(UndistortedPixel { u: cu + self.focal * x, v: cv + self.focal * y })
    }

    /// Maps an undistorted pixel to the raw pixel that shows the same ray.
    ///
    /// Returns `None` beyond [`Distortion::max_radius`], where the model folds back on itself, and outside
    /// the image circle of a wide lens.
    #[must_use]
    pub fn distort(&self, pixel: UndistortedPixel) -> Option<Pixel> {
        if self.distortion == Distortion::None {
            return Some(self.to_raw_pixel(Pixel { u: pixel.u, v: pixel.v }));
        }
        let Pixel { u: cu, v: cv } = self.principal_point;
        let [x, y] = self.distortion.distort(self.normalised(pixel.into()))?;
        Some(Pixel { u: cu + self.focal * x, v: cv + self.focal * y })
            .filter(|&pixel| self.is_in_image_circle(pixel))
            .map(|pixel| self.to_raw_pixel(pixel))
    }

    /// Returns the bearing of a raw pixel: the homogeneous undistorted pixel relative to the principal point.
    /// The third coordinate of the bearing is positive in front of the camera. It is zero or negative for
    /// rays 90° or more from the optical axis, for which [`Self::undistort`] returns `None`.
    ///
    /// Returns `None` if no ray of the scene reaches the pixel.
    #[must_use]
    pub fn bearing(&self, pixel: Pixel) -> Option<[f64; 3]> {
        if !self.distortion.is_wide() {
            let (undistorted, Pixel { u: cu, v: cv }) = (self.undistort(pixel)?, self.principal_point);
            return Some([undistorted.u - cu, undistorted.v - cv, 1.0]);
        }
        let pixel = self.to_square_pixel(pixel);
        if !self.is_in_image_circle(pixel) {
            return None;
        }
        let [x, y, w] = self.distortion.ray(self.normalised(pixel.into()))?;
        Some([self.focal * x, self.focal * y, w])
    }

    /// Maps a bearing of any length to the raw pixel: the inverse of [`Self::bearing`]. Returns `None` if the
    /// lens does not show the bearing.
    #[must_use]
    pub fn bearing_to_pixel(&self, [x, y, w]: [f64; 3]) -> Option<Pixel> {
        let Pixel { u: cu, v: cv } = self.principal_point;
        if !self.distortion.is_wide() {
            let undistorted = UndistortedPixel { u: cu + x / w, v: cv + y / w };
            return if w > 0.0 { self.distort(undistorted) } else { None };
        }
        let [a, b] = self.distortion.ray_to_distorted([x / self.focal, y / self.focal, w])?;
        Some(Pixel { u: cu + self.focal * a, v: cv + self.focal * b })
            .filter(|&pixel| self.is_in_image_circle(pixel))
            .map(|pixel| self.to_raw_pixel(pixel))
    }

    /// Maps a raw pixel to the image with square pixels. The principal point does not move.
    #[must_use]
    pub fn to_square_pixel(&self, Pixel { u, v }: Pixel) -> Pixel {
        let cv = self.principal_point.v;
        if self.pixel_aspect == 1.0 {
            Pixel { u, v }
        } else {
            Pixel { u, v: cv + (v - cv) / self.pixel_aspect }
        }
    }

    /// Maps a pixel of the image with square pixels to the raw pixel: the inverse of
    /// [`Self::to_square_pixel`].
    #[must_use]
    pub fn to_raw_pixel(&self, Pixel { u, v }: Pixel) -> Pixel {
        let cv = self.principal_point.v;
        if self.pixel_aspect == 1.0 {
            Pixel { u, v }
        } else {
            Pixel { u, v: cv + (v - cv) * self.pixel_aspect }
        }
    }

    /// Converts derivatives with respect to a square pixel to derivatives with respect to the raw pixel.
    fn by_raw_pixel<const N: usize>(&self, rows: [[f64; 2]; N]) -> [[f64; 2]; N] {
        rows.map(|[by_u, by_v]| [by_u, by_v / self.pixel_aspect])
    }

    /// Whether a pixel of the image with square pixels is within the image circle, or no image circle applies.
    fn is_in_image_circle(&self, pixel: Pixel) -> bool {
        self.image_circle.is_none_or(|circle| circle.contains(pixel) || !self.distortion.is_wide())
    }

    /// Returns the bearing of a raw pixel, and its derivatives with respect to u and v of the pixel; see
    /// [`Self::bearing`].
    pub(crate) fn bearing_with_jacobian(&self, pixel: Pixel) -> Option<([f64; 3], RayMatrix)> {
        if !self.distortion.is_wide() {
            let (undistorted, [u, v]) = self.undistort_with_jacobian(pixel)?;
            let Pixel { u: cu, v: cv } = self.principal_point;
            return Some(([undistorted.u - cu, undistorted.v - cv, 1.0], [u, v, [0.0; 2]]));
        }
        let pixel = self.to_square_pixel(pixel);
        if !self.is_in_image_circle(pixel) {
            return None;
        }
        let distorted = self.normalised(pixel.into());
        let ray = self.distortion.ray(distorted)?;
        let [u, v, ahead] = self.distortion.ray_jacobian(distorted, ray);
        let [x, y, w] = ray;
        let jacobian = self.by_raw_pixel([u, v, ahead.map(|by| by / self.focal)]);
        Some(([self.focal * x, self.focal * y, w], jacobian))
    }

    /// Returns the derivatives of a bearing and of its Jacobian with respect to every lens parameter. The
    /// second argument is the bearing of `pixel`. Only wide lenses have a focal length among their parameters.
    pub(crate) fn bearing_by_parameters(
        &self,
        pixel: Pixel,
        [x, y, w]: [f64; 3],
    ) -> [RayByCoefficient; Self::PARAMETERS] {
        let ray = [x / self.focal, y / self.focal, w];
        let distorted = self.normalised(self.to_square_pixel(pixel).into());
        let mut by = [RayByCoefficient::default(); Self::PARAMETERS];
        for (by, of) in by.iter_mut().zip(&self.distortion.ray_by_coefficients(distorted, ray)) {
            let ([x, y, w], [u, v, ahead]) = (of.at, of.jacobian);
            by.at = [self.focal * x, self.focal * y, w];
            by.jacobian = [u, v, [ahead[0] / self.focal, ahead[1] / self.focal]];
        }
        let [focal, u, v] = self.bearing_by_scale_and_centre(distorted, ray);
        if self.distortion.is_wide() {
            by[Self::LENS_FOCAL] = focal;
        }
        [by[Self::CENTRE], by[Self::CENTRE + 1]] = [u, v];
        // The relative square pixel is `(v - cv) / aspect`, so derivatives with respect to cv have the factor
        // `1 / aspect`.
        by[Self::CENTRE + 1] = by[Self::CENTRE + 1].times(self.pixel_aspect.recip());
        by[Self::ASPECT] = by[Self::CENTRE + 1].times(self.down(distorted));
        let [u, v, ahead] = self.distortion.ray_jacobian(distorted, ray);
        for (by, along) in by[Self::ASPECT].jacobian.iter_mut().zip([u, v, ahead.map(|by| by / self.focal)]) {
            by[1] -= along[1] / self.pixel_aspect;
        }
        by.map(|by| RayByCoefficient { jacobian: self.by_raw_pixel(by.jacobian), ..by })
    }

    /// Returns the distance of a normalised point q below the principal point, in square pixels.
    ///
    /// It is the factor between the derivatives with respect to v of the principal point c and with respect
    /// to the pixel aspect a. With `q_y = (v - c_v) / (a f)`, a change of `c_v` has `a f dq_y = -dc_v`. A
    /// change of a has `a f dq_y = -q_y f da`. The Jacobian with respect to the raw pixel also contains a
    /// factor 1 / a in its second column, which changes by `-da / a` relative to its value.
    fn down(&self, distorted: [f64; 2]) -> f64 {
        self.focal * distorted[1]
    }

    /// Returns the derivatives of a bearing and of its Jacobian with respect to the log of the focal length
    /// f, and to u and v of the principal point c.
    ///
    /// The distorted point is `q = (pixel - c) / f`. If its ray is `(x, y, w)`, the bearing is
    /// `(f x, f y, w)`. Let J be the Jacobian of x and y with respect to q, and `J_w` the Jacobian of w. The
    /// Jacobian of the bearing is `(J, J_w / f)`. A change of log f has `dq = -q`. A change of c along the
    /// image axis e has `f dq = -e`.
    fn bearing_by_scale_and_centre(&self, distorted: [f64; 2], ray: [f64; 3]) -> [RayByCoefficient; 3] {
        let focal = self.focal;
        let jacobian = self.distortion.ray_jacobian(distorted, ray);
        let curvature = self.distortion.ray_curvature(distorted, ray);
        let along = |row: usize| jacobian[row][0] * distorted[0] + jacobian[row][1] * distorted[1];
        let bend =
            |row: usize, k: usize| curvature[0][row][k] * distorted[0] + curvature[1][row][k] * distorted[1];
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
            let [u, v, distorted_ahead] = curvature[axis];
            RayByCoefficient {
                at: [-x, -y, -ahead / focal],
                jacobian: [u, v, distorted_ahead.map(|by| by / focal)].map(|row| row.map(|by| -by / focal)),
            }
        };
        [by_focal, by_centre(0), by_centre(1)]
    }

    /// Returns the log of the radial slope of a wide lens at a raw pixel, and the derivatives of the log with
    /// respect to every lens parameter. The slope is `d radius / d angle`: the radius is divided by the focal
    /// length, and the angle is in radians from the optical axis. The slope is 1 on the axis. Returns `None`
    /// if no ray reaches the pixel.
    pub(crate) fn log_slope(&self, pixel: Pixel) -> Option<(f64, [f64; Self::PARAMETERS])> {
        let bearing = self.bearing(pixel)?;
        let [u, v] = self.normalised(self.to_square_pixel(pixel).into());
        let radius = u.hypot(v).max(f64::MIN_POSITIVE);
        // A step along a radius of the square pixels, in raw pixels.
        let out = [u / radius, self.pixel_aspect * v / radius];
        // Derivative along the unit vector of q = (pixel - c) / f, with the principal point c and the focal
        // length f. A change of c rotates this vector, which is a change perpendicular to the radius only.
        let outwards = |rows: RayMatrix| rows.map(|[u, v]| u * out[0] + v * out[1]);
        let in_rays = |[u, v, ahead]: RayMatrix| outwards([u, v, ahead.map(|by| by * self.focal)]);
        let (_, jacobian) = self.bearing_with_jacobian(pixel)?;
        let turn = in_rays(jacobian);
        let square = turn.iter().map(|c| c * c).sum::<f64>();
        let mut by = self.bearing_by_parameters(pixel, bearing).map(|by| in_rays(by.jacobian));
        // The Jacobian of w in a bearing contains the factor 1 / f. The derivative of this factor is removed.
        by[Self::LENS_FOCAL][2] += turn[2];
        // A change of the aspect changes the raw step, too. This derivative is also removed.
        let down = jacobian.map(|row| row[1] * v / radius);
        let of_step = [down[0], down[1], down[2] * self.focal];
        by[Self::ASPECT].iter_mut().zip(of_step).for_each(|(by, step)| *by += step);
        let by = by.map(|change| -turn.iter().zip(change).map(|(a, b)| a * b).sum::<f64>() / square);
        // On the optical axis the slope is 1 and does not depend on the parameters.
        if radius < 1e-6 { Some((0.0, [0.0; Self::PARAMETERS])) } else { Some((-0.5 * square.ln(), by)) }
    }

    /// Whether every corner of an image of this width and height, in pixels, shows a ray. If so, all pixels show
    /// rays. Always true for a wide lens, because the corners may be outside its image circle.
    #[must_use]
    pub fn covers_image(&self, [w, h]: [f64; 2]) -> bool {
        if self.distortion.is_wide() {
            return true;
        }
        let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
        let square = |[u, v]: [f64; 2]| self.to_square_pixel(Pixel { u, v });
        corners.into_iter().all(|corner| self.distortion.has_ray(self.normalised(square(corner).into())))
    }

    /// Returns the lens with the change `by` added to the parameter with this index; see [`Self::PARAMETERS`].
    pub(crate) fn nudged(&self, parameter: usize, by: f64) -> Self {
        let mut lens = *self;
        match parameter {
            Self::LENS_FOCAL if self.distortion.is_wide() => lens.focal *= by.exp(),
            Self::CENTRE => lens.principal_point.u += by,
            Self::ASPECT => lens.pixel_aspect += by,
            coefficient if coefficient < Self::CENTRE => {
                let mut coefficients = self.distortion.fitted_coefficients();
                coefficients[coefficient] += by;
                lens.distortion = self.distortion.with_fitted_coefficients(coefficients);
            }
            _ => lens.principal_point.v += by,
        }
        lens
    }

    /// Returns the lens that maps pixels in the same way, with coefficients that refer to the focal length
    /// `focal`, in pixels.
    ///
    /// Returns `None` for a distortion model whose map of pixels determines its focal length, unless `focal`
    /// equals [`Lens::focal`].
    #[must_use]
    pub fn at_focal(&self, focal: f64) -> Option<Self> {
        let ratio = focal / self.focal;
        Some(Self { focal, distortion: self.distortion.rescaled(ratio)?, ..*self })
    }

    /// Returns the Jacobian `d undistorted / d raw` at the raw pixel `pixel`, with one row for each
    /// coordinate of the undistorted pixel. Returns `None` outside the lens.
    #[must_use]
    pub fn undistort_jacobian(&self, pixel: Pixel) -> Option<[[f64; 2]; 2]> {
        self.undistort_with_jacobian(pixel).map(|(_, jacobian)| jacobian)
    }

    /// Returns the undistorted pixel of a raw pixel, and the Jacobian `d undistorted / d raw`. Returns `None`
    /// outside the lens; see [`Self::undistort`] and [`Self::undistort_jacobian`].
    #[must_use]
    pub fn undistort_with_jacobian(&self, pixel: Pixel) -> Option<(UndistortedPixel, [[f64; 2]; 2])> {
        let undistorted = self.undistort(pixel)?;
        let distorted = self.normalised(self.to_square_pixel(pixel).into());
        let jacobian = self.distortion.undistort_jacobian(distorted, self.normalised(undistorted.into()));
        Some((undistorted, self.by_raw_pixel(jacobian)))
    }

    /// Returns the derivatives of the undistorted pixel relative to the principal point, and of its Jacobian,
    /// with respect to every parameter of a lens that is not wide. `undistorted` is the undistorted pixel of
    /// `pixel`.
    ///
    /// With the principal point c, the relative pixel is a function of `pixel - c`. Its derivatives with
    /// respect to c are the negative derivatives with respect to the pixel.
    pub(crate) fn undistort_by_parameters(
        &self,
        pixel: Pixel,
        undistorted: UndistortedPixel,
    ) -> ByParameters {
        let distorted = self.normalised(self.to_square_pixel(pixel).into());
        let undistorted = self.normalised(undistorted.into());
        let mut by = ByParameters::default();
        let coefficients = self.distortion.undistort_by_coefficients(distorted, undistorted);
        for (by, of) in by.iter_mut().zip(coefficients) {
            *by = ByCoefficient { at: of.at.map(|change| self.focal * change), ..of };
        }
        let [x, y] = undistorted;
        let ray = [x, y, 1.0];
        let [[xu, xv], [yu, yv], _] = self.distortion.ray_jacobian(distorted, ray);
        let curvature = self.distortion.ray_curvature(distorted, ray);
        for (axis, at) in [[-xu, -yu], [-xv, -yv]].into_iter().enumerate() {
            let [u, v, _] = curvature[axis].map(|row| row.map(|by| -by / self.focal));
            by[Self::CENTRE + axis] = ByCoefficient { at, jacobian: [u, v] };
        }
        by[Self::CENTRE + 1] = by[Self::CENTRE + 1].times(self.pixel_aspect.recip());
        by[Self::ASPECT] = by[Self::CENTRE + 1].times(self.down(distorted));
        for (by, along) in by[Self::ASPECT].jacobian.iter_mut().zip([xv, yv]) {
            by[1] -= along / self.pixel_aspect;
        }
        by.map(|by| ByCoefficient { jacobian: self.by_raw_pixel(by.jacobian), ..by })
    }

    /// Returns the derivatives of [`Self::distort`] at `undistorted`: the Jacobian `d raw / d undistorted`,
    /// and the derivatives `d raw / d coefficient` with respect to every distortion coefficient.
    pub(crate) fn distort_derivatives(
        &self,
        undistorted: UndistortedPixel,
    ) -> (Matrix2, [[f64; 2]; Distortion::MAX_FITTED]) {
        let undistorted = self.normalised(undistorted.into());
        let by = self.distortion.distort_by_coefficients(undistorted);
        let to_raw = |[u, v]: [f64; 2]| [u, self.pixel_aspect * v];
        let by = by.map(|by| to_raw(by.map(|change| self.focal * change)));
        (self.normalised_distort_jacobian(undistorted), by)
    }

    /// Returns the Jacobian `d raw / d undistorted` of [`Self::distort`] at `undistorted`.
    pub(crate) fn distort_jacobian(&self, undistorted: UndistortedPixel) -> Matrix2 {
        self.normalised_distort_jacobian(self.normalised(undistorted.into()))
    }

    fn normalised_distort_jacobian(&self, undistorted: [f64; 2]) -> Matrix2 {
        let [u, v] = self.distortion.distort_jacobian(undistorted);
        [u, v.map(|slope| self.pixel_aspect * slope)]
    }

    /// Returns square pixel coordinates relative to the principal point, divided by the focal length of the
    /// lens.
    fn normalised(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let Pixel { u: cu, v: cv } = self.principal_point;
        [(u - cu) / self.focal, (v - cv) / self.focal]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::distortion::multiply;
    use crate::camera::distortion::tests::any_distortion;
    use proptest::prelude::*;

    fn lens_of(distortion: Distortion) -> Lens {
        Lens {
            principal_point: Pixel::new(950.0, 530.0),
            focal: 1200.0,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        }
    }

    proptest! {
        #[test]
        fn pixels_of_another_aspect_are_the_stretched_pixels(
            distortion in any_distortion(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, aspect in 0.4..2.5_f64,
        ) {
            let (square, pixel) = (lens_of(distortion), Pixel { u, v });
            let lens = Lens { pixel_aspect: aspect, ..square };
            let raw = lens.to_raw_pixel(pixel);
            prop_assert!(lens.to_square_pixel(raw).distance(pixel) < 1e-9);
            let (Some(one), Some(other)) = (square.bearing(pixel), lens.bearing(raw)) else { return Ok(()) };
            let off: f64 = (0..3).map(|k| (one[k] - other[k]).abs() / (1.0 + one[k].abs())).sum();
            prop_assert!(off < 1e-6, "{one:?} {other:?}");
            if let Some(again) = lens.bearing_to_pixel(other) {
                prop_assert!(again.distance(raw) < 1e-5, "{again:?} {raw:?}");
            }
        }

        #[test]
        fn a_rescaled_lens_is_the_same_map_of_pixels(
            distortion in any_distortion(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, focal in 600.0..3000.0_f64,
        ) {
            let lens = lens_of(distortion);
            if let (Some(other), Some(undistorted)) = (lens.at_focal(focal), lens.undistort(Pixel { u, v })) {
                let again = other.undistort(Pixel { u, v });
                prop_assert!(again.is_some_and(|p| p.distance(undistorted) < 1e-7 * (1.0 + undistorted.u.abs())));
            }
        }

        #[test]
        fn undistortion_jacobian_agrees_with_finite_differences(
            distortion in any_distortion(), u in 300.0..1600.0_f64, v in 200.0..900.0_f64, aspect in 0.5..2.0_f64,
        ) {
            /// Step in pixels: truncation 1e-4 px^2 times the third derivative, rounding 1e-11.
            const STEP: f64 = 0.01;
            let lens = Lens { pixel_aspect: aspect, ..lens_of(distortion) };
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
        fn derivatives_of_distortion_and_undistortion_are_inverse(
            distortion in any_distortion(), u in 300.0..1600.0_f64, v in 200.0..900.0_f64, aspect in 0.5..2.0_f64,
        ) {
            let lens = Lens { pixel_aspect: aspect, ..lens_of(distortion) };
            let Some((undistorted, inverse)) = lens.undistort_with_jacobian(Pixel { u, v }) else { return Ok(()) };
            let (jacobian, by) = lens.distort_derivatives(undistorted);
            prop_assume!(inverse.iter().flatten().all(|slope| slope.abs() < 100.0));
            for (column, unit) in [[1.0, 0.0], [0.0, 1.0]].into_iter().enumerate() {
                let back = multiply(inverse, [jacobian[0][column], jacobian[1][column]]);
                prop_assert!((back[0] - unit[0]).hypot(back[1] - unit[1]) < 1e-9, "{back:?}");
            }
            let back = lens.undistort_by_parameters(Pixel { u, v }, undistorted);
            for (forward, back) in by.iter().zip(back) {
                // By the implicit function theorem, a coefficient moves the point by opposite amounts in the
                // two directions.
                let moved = multiply(inverse, *forward);
                let apart = (moved[0] + back.at[0]).hypot(moved[1] + back.at[1]);
                prop_assert!(apart < 1e-9 * (1.0 + moved[0].hypot(moved[1])), "{moved:?} {back:?}");
            }
        }
    }
}
