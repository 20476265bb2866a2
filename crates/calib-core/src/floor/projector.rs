//! Projector of slices of pixels to a plane and back. The camera is prepared once, and mapping allocates no
//! memory.

use crate::camera::{
    BrownInverse, Camera, Distortion, FloorCovariance, FloorPoint, LANES, Lens, Pixel, Plane, WorldPoint,
    dispatch,
};
use crate::floor::extent::Extent;
use crate::floor::extent::Status;
use crate::floor::floor_covariances::{CovarianceLanes, STRAIGHT_LANES};
use crate::floor::floor_covariances::{lanes, store};

/// Camera prepared to map many pixels to one plane, and points of the plane to pixels.
///
/// Results that do not exist are NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorProjector {
    camera: Camera,
    plane: Plane,
    /// Homography from undistorted coordinates to x and y on the plane. The coordinates are relative to the
    /// principal point, and divided by the focal length of the lens.
    floor_from_lens: [[f64; 3]; 3],
    /// Homography from x and y on the plane to undistorted coordinates: the inverse of `floor_from_lens`.
    lens_from_floor: [[f64; 3]; 3],
    /// Inverse of a Brown-Conrady lens, which has no closed form, for many points at once.
    inverse: Option<BrownInverse>,
}

impl FloorProjector {
    /// Prepares `camera` for the plane at `height` metres.
    #[must_use]
    pub fn new(camera: &Camera, height: f64) -> Self {
        Self::on(camera, &Plane::level(height))
    }

    /// Prepares `camera` for a plane of any slope.
    #[must_use]
    pub fn on(camera: &Camera, plane: &Plane) -> Self {
        let h = camera.homography_plane_from_pixel(plane);
        let Pixel { u: cu, v: cv } = camera.lens.principal_point;
        let f = camera.lens.focal;
        let floor_from_lens = h.map(|[a, b, c]| [a * f, b * f, a * cu + b * cv + c]);
        let p = camera.projection_matrix();
        let ([along_x, along_y], height) = (plane.slope, plane.height_at(FloorPoint::default()));
        let on_plane = p.map(|[a, b, c, d]| [a + along_x * c, b + along_y * c, c * height + d]);
        let [x, y, w] = on_plane;
        let lens_from_floor = [
            std::array::from_fn(|j| (x[j] - cu * w[j]) / f),
            std::array::from_fn(|j| (y[j] - cv * w[j]) / f),
            w,
        ];
        let inverse = match &camera.lens.distortion {
            Distortion::BrownConrady(brown) => Some(BrownInverse::new(brown, reach(&camera.lens))),
            _ => None,
        };
        Self { camera: *camera, plane: *plane, floor_from_lens, lens_from_floor, inverse }
    }

    /// Returns the prepared camera.
    #[must_use]
    pub const fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns the height of the plane, in metres. The height of a sloping plane is the one at its anchor.
    #[must_use]
    pub const fn height(&self) -> f64 {
        self.plane.height
    }

    /// Returns the plane to which the pixels are mapped.
    #[must_use]
    pub const fn plane(&self) -> &Plane {
        &self.plane
    }

    /// Maps raw pixels `(u, v)` to points `(x, y)` of the plane, in metres.
    ///
    /// A pixel that does not show the plane becomes NaN.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn pixels_to_floor(&self, u: &[f64], v: &[f64], x: &mut [f64], y: &mut [f64]) {
        assert!(u.len() == v.len() && u.len() == x.len() && u.len() == y.len(), "slices of equal length");
        match (self.camera.lens.distortion, &self.inverse) {
            (Distortion::None, _) => self.map_by_division_model(0.0, [u, v], [x, y]),
            (Distortion::Division { lambda }, _) => self.map_by_division_model(lambda, [u, v], [x, y]),
            (_, Some(inverse)) => {
                let (side, h) = (self.side(), self.floor_from_lens);
                let to_floor = |a: f64, b: f64| {
                    let w = h[2][0] * a + h[2][1] * b + h[2][2];
                    let scale = if w * side > 0.0 { w.recip() } else { f64::NAN };
                    (
                        (h[0][0] * a + h[0][1] * b + h[0][2]) * scale,
                        (h[1][0] * a + h[1][1] * b + h[1][2]) * scale,
                    )
                };
                self.undistort_in_lockstep(inverse, to_floor, [u, v], [x, y]);
            }
            // Other models are mapped pixel by pixel.
            _ => {
                for i in 0..u.len() {
                    let floor = self.pixel_to_floor(Pixel { u: u[i], v: v[i] });
                    (x[i], y[i]) = floor.map_or((f64::NAN, f64::NAN), |p| (p.x, p.y));
                }
            }
        }
    }

    /// Returns the height of the camera above the plane, in metres. Its sign equals the sign of the third
    /// homogeneous coordinate of visible points. A plane above the camera is visible above the horizon; a
    /// plane at the height of the camera is not visible.
    fn side(&self) -> f64 {
        self.camera.position.z - self.plane.height_at(self.camera.position.on_floor())
    }

    /// Maps pixels with the division model of coefficient `lambda`, or without distortion if `lambda` is 0.
    /// The undistorted point is the raw point (a, b) divided by `q = 1 + lambda (a^2 + b^2)`. The floor point
    /// therefore follows from the homogeneous vector (a, b, q).
    fn map_by_division_model(&self, lambda: f64, [u, v]: [&[f64]; 2], [x, y]: [&mut [f64]; 2]) {
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let [inverse, inverse_v] = self.inverse_focals();
        let (side, h) = (self.side(), self.floor_from_lens);
        // A pincushion lens folds back at q = 2.
        let most = if lambda > 0.0 { 2.0 } else { f64::INFINITY };
        dispatch(
            #[inline(always)]
            || {
                for (((x, y), &u), &v) in x.iter_mut().zip(y.iter_mut()).zip(u).zip(v) {
                    let (a, b) = ((u - cu) * inverse, (v - cv) * inverse_v);
                    let q = 1.0 + lambda * (a * a + b * b);
                    let w = h[2][0] * a + h[2][1] * b + h[2][2] * q;
                    let shown = (q > 0.0) & (q <= most) & (w * side > 0.0);
                    let scale = if shown { w.recip() } else { f64::NAN };
                    *x = (h[0][0] * a + h[0][1] * b + h[0][2] * q) * scale;
                    *y = (h[1][0] * a + h[1][1] * b + h[1][2] * q) * scale;
                }
            },
        );
    }

    /// Returns the inverse focal lengths of the lens along u and v.
    fn inverse_focals(&self) -> [f64; 2] {
        let Lens { focal, pixel_aspect, .. } = self.camera.lens;
        [focal.recip(), (focal * pixel_aspect).recip()]
    }

    /// Undistorts pixels in lockstep, and maps the normalised points with `onward`.
    #[inline(always)]
    fn undistort_in_lockstep(
        &self,
        lens: &BrownInverse,
        onward: impl Fn(f64, f64) -> (f64, f64),
        [u, v]: [&[f64]; 2],
        [x, y]: [&mut [f64]; 2],
    ) {
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let [inverse, inverse_v] = self.inverse_focals();
        dispatch(
            #[inline(always)]
            move || {
                let pixels = u.chunks(LANES).zip(v.chunks(LANES));
                for ((u, v), (x, y)) in pixels.zip(x.chunks_mut(LANES).zip(y.chunks_mut(LANES))) {
                    // The last chunk is padded with the principal point.
                    let mut a = lanes(u, cu).map(|u| (u - cu) * inverse);
                    let mut b = lanes(v, cv).map(|v| (v - cv) * inverse_v);
                    lens.undistort(&mut a, &mut b);
                    for i in 0..LANES {
                        (a[i], b[i]) = onward(a[i], b[i]);
                    }
                    store(&a, x);
                    store(&b, y);
                }
            },
        );
    }

    /// Maps raw pixels `(u, v)` to undistorted pixels; see [`Camera::undistort`].
    ///
    /// A pixel outside the lens becomes NaN.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn undistort_pixels(&self, u: &[f64], v: &[f64], to_u: &mut [f64], to_v: &mut [f64]) {
        assert!(
            u.len() == v.len() && u.len() == to_u.len() && u.len() == to_v.len(),
            "slices of equal length"
        );
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let Lens { focal: f, pixel_aspect, .. } = self.camera.lens;
        match (self.camera.lens.distortion, &self.inverse) {
            (Distortion::None, _) if pixel_aspect == 1.0 => {
                to_u.copy_from_slice(u);
                to_v.copy_from_slice(v);
            }
            (_, Some(inverse)) => {
                self.undistort_in_lockstep(inverse, |a, b| (cu + f * a, cv + f * b), [u, v], [to_u, to_v]);
            }
            _ => {
                for i in 0..u.len() {
                    let straight = self.camera.undistort(Pixel { u: u[i], v: v[i] });
                    (to_u[i], to_v[i]) = straight.map_or((f64::NAN, f64::NAN), |p| (p.u, p.v));
                }
            }
        }
    }

    /// Maps pixels as [`Self::pixels_to_floor`] does, and computes the status of each pixel.
    ///
    /// A pixel is inside the EFOV if the floor point on its ray is inside, for a plane at any height.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn pixels_to_floor_within(
        &self,
        extent: &Extent<'_>,
        [u, v]: [&[f64]; 2],
        [x, y]: [&mut [f64]; 2],
        status: &mut [Status],
    ) {
        assert!(status.len() == u.len(), "slices of equal length");
        self.pixels_to_floor(u, v, x, y);
        extent.classify(self.camera.position, &self.plane, [u, v], [x, y], status);
        if !status.contains(&Status::AboveHorizon) {
            return;
        }
        for i in 0..u.len() {
            if status[i] == Status::AboveHorizon {
                (x[i], y[i]) = (f64::NAN, f64::NAN);
                status[i] = self.status_without_point(Pixel { u: u[i], v: v[i] });
            }
        }
    }

    /// Returns the reason why a pixel has no point.
    fn status_without_point(&self, pixel: Pixel) -> Status {
        if !pixel.is_finite() {
            Status::Missing
        } else if self.camera.lens.bearing(pixel).is_none() {
            Status::OutsideLens
        } else {
            Status::AboveHorizon
        }
    }

    /// Computes the covariances of the points of the plane at raw pixels `(u, v)`, in square metres; see
    /// [`Camera::floor_covariance`]. `pixel_sigma` is the standard deviation of each coordinate, in pixels.
    /// The pixel part and the calibration part have the columns xx, xy, yy.
    ///
    /// The covariances of a pixel without a point are NaN. An unknown calibration part is also NaN.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn floor_covariances(
        &self,
        [u, v]: [&[f64]; 2],
        pixel_sigma: f64,
        [pixel, calibration]: [[&mut [f64]; 3]; 2],
    ) {
        let is_of_one_length = |column: &&mut [f64]| column.len() == u.len();
        let columns = || pixel.iter().chain(&calibration);
        assert!(v.len() == u.len() && columns().all(is_of_one_length), "slices of equal length");
        let ([pixel_xx, pixel_xy, pixel_yy], [xx, xy, yy]) = (pixel, calibration);
        let to = [pixel_xx, pixel_xy, pixel_yy, xx, xy, yy];
        match (&self.camera.lens.distortion, &self.inverse) {
            (Distortion::None, _) => self.covariances_in_step(
                #[inline(always)]
                |of, u: &[f64; STRAIGHT_LANES], v| of.straight(u, v),
                [u, v],
                pixel_sigma,
                to,
            ),
            (Distortion::BrownConrady(brown), Some(inverse)) => self.covariances_in_step(
                #[inline(always)]
                |of, u, v| of.distorted((inverse, brown), u, v),
                [u, v],
                pixel_sigma,
                to,
            ),
            _ => self.covariances_one_by_one([u, v], pixel_sigma, to),
        }
    }

    /// Computes the covariances with the function `of` for `N` pixels at a time.
    #[inline(always)]
    fn covariances_in_step<const N: usize>(
        &self,
        of: impl Fn(&CovarianceLanes<'_>, &[f64; N], &[f64; N]) -> [[[f64; N]; 3]; 2],
        [u, v]: [&[f64]; 2],
        sigma: f64,
        to: [&mut [f64]; 6],
    ) {
        let prepared = CovarianceLanes::new(&self.camera, &self.plane, sigma);
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        dispatch(
            #[inline(always)]
            move || {
                let ((u, last_u), (v, last_v)) = (u.as_chunks(), v.as_chunks());
                let mut to = to.map(<[f64]>::as_chunks_mut);
                let [(xx, _), (xy, _), (yy, _), calibration @ ..] = &mut to;
                let [(of_xx, _), (of_xy, _), (of_yy, _)] = calibration;
                let columns = xx.iter_mut().zip(xy.iter_mut()).zip(yy.iter_mut());
                let columns = columns.zip(of_xx.iter_mut().zip(of_xy.iter_mut()).zip(of_yy.iter_mut()));
                for ((u, v), (((xx, xy), yy), ((of_xx, of_xy), of_yy))) in u.iter().zip(v).zip(columns) {
                    [[*xx, *xy, *yy], [*of_xx, *of_xy, *of_yy]] = of(&prepared, u, v);
                }
                if !last_u.is_empty() {
                    let found = of(&prepared, &lanes(last_u, cu), &lanes(last_v, cv));
                    for ((_, last), found) in to.iter_mut().zip(found.as_flattened()) {
                        last.copy_from_slice(&found[..last.len()]);
                    }
                }
            },
        );
    }

    /// Computes the covariances pixel by pixel, for models without a faster method.
    fn covariances_one_by_one(&self, [u, v]: [&[f64]; 2], sigma: f64, mut to: [&mut [f64]; 6]) {
        for (i, (&u, &v)) in u.iter().zip(v).enumerate() {
            let found = self.camera.covariance_on(Pixel { u, v }, sigma, &self.plane, &[[0.0; 3]; 3]);
            let [pixel, calibration] = found.unwrap_or(FloorCovariance::NAN).rows();
            let six = [pixel[0], pixel[1], pixel[3], calibration[0], calibration[1], calibration[3]];
            to.iter_mut().zip(six).for_each(|(column, value)| column[i] = value);
        }
    }

    /// Maps points `(x, y)` of the plane, in metres, to raw pixels `(u, v)`.
    ///
    /// A point that the lens does not show becomes NaN.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn floor_to_pixels(&self, x: &[f64], y: &[f64], u: &mut [f64], v: &mut [f64]) {
        assert!(u.len() == v.len() && u.len() == x.len() && u.len() == y.len(), "slices of equal length");
        let h = self.lens_from_floor;
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let Lens { focal: f, pixel_aspect, .. } = self.camera.lens;
        let f_v = pixel_aspect * f;
        let plain = self.camera.lens.distortion == Distortion::None;
        if self.camera.lens.distortion.is_wide() {
            for i in 0..x.len() {
                let at = FloorPoint { x: x[i], y: y[i] };
                let shown = self.camera.world_to_pixel(at.at_height(self.plane.height_at(at)));
                (u[i], v[i]) = shown.map_or((f64::NAN, f64::NAN), |pixel| (pixel.u, pixel.v));
            }
            return;
        }
        for i in 0..x.len() {
            let w = h[2][0] * x[i] + h[2][1] * y[i] + h[2][2];
            let a = (h[0][0] * x[i] + h[0][1] * y[i] + h[0][2]) / w;
            let b = (h[1][0] * x[i] + h[1][1] * y[i] + h[1][2]) / w;
            let bent = if plain { Some([a, b]) } else { self.camera.lens.distortion.distort([a, b]) };
            let shown = bent.filter(|_| w > 0.0).map(|[a, b]| (cu + f * a, cv + f_v * b));
            (u[i], v[i]) = shown.unwrap_or((f64::NAN, f64::NAN));
        }
    }

    /// Maps one raw pixel to a point of the plane; see [`Camera::pixel_to_plane`].
    #[must_use]
    pub fn pixel_to_floor(&self, pixel: Pixel) -> Option<FloorPoint> {
        self.camera.pixel_to_plane(pixel, &self.plane).map(WorldPoint::on_floor)
    }
}

/// Returns the expected largest distance of a pixel from the principal point, in units of the focal length,
/// for a principal point near the image centre. The value affects only the run time.
fn reach(lens: &Lens) -> f64 {
    let Pixel { u, v } = lens.principal_point;
    (1.2 * u.hypot(v) / lens.focal).clamp(0.3, 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use crate::camera::{Covariance, Lens};
    use proptest::prelude::*;

    fn check(camera: &Camera, at: &[(f64, f64)], height: f64) {
        let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
        let (mut x, mut y) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        FloorProjector::new(camera, height).pixels_to_floor(&u, &v, &mut x, &mut y);
        for i in 0..u.len() {
            match camera.pixel_to_floor(Pixel { u: u[i], v: v[i] }, height) {
                Some(floor) => {
                    let range = floor.distance(camera.position.on_floor());
                    let off = floor.distance(FloorPoint { x: x[i], y: y[i] });
                    assert!(
                        range > 1e6 || off < 1e-11 * (1.0 + range).powi(2) * 10.0,
                        "{off} m at {range} m"
                    );
                }
                None => assert!(x[i].is_nan() && y[i].is_nan()),
            }
        }
    }

    proptest! {
        #[test]
        fn slice_maps_like_single_pixels(
            camera in any_camera(), lambda in -0.3..0.1_f64, division: bool,
            at in proptest::collection::vec((-200.0..2200.0_f64, -200.0..1300.0_f64), 1..40), height in -1.0..9.0_f64,
        ) {
            let bent = Lens { distortion: Distortion::Division { lambda }, ..camera.lens };
            let camera = if division { Camera { lens: bent, ..camera } } else { camera };
            prop_assume!((height - camera.position.z).abs() > 0.2);
            check(&camera, &at, height);
        }

        #[test]
        fn result_of_a_pixel_is_independent_of_its_neighbours(
            camera in any_camera(),
            at in proptest::collection::vec((-200.0..2200.0_f64, -200.0..1300.0_f64), 1..40), first in 0..40_usize,
        ) {
            let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
            let mapped = |u: &[f64], v: &[f64]| {
                let (mut x, mut y) = (vec![0.0; u.len()], vec![0.0; u.len()]);
                FloorProjector::new(&camera, 0.0).pixels_to_floor(u, v, &mut x, &mut y);
                x.iter().chain(&y).map(|value| value.to_bits()).collect::<Vec<_>>()
            };
            let (all, first) = (mapped(&u, &v), first % u.len());
            let rest = mapped(&u[first..], &v[first..]);
            prop_assert_eq!(&rest[..u.len() - first], &all[first..u.len()]);
        }

        #[test]
        fn slice_status_equals_single_pixel_status(
            camera in any_camera(), height in -1.0..9.0_f64,
            at in proptest::collection::vec((-900.0..2800.0_f64, -900.0..1900.0_f64), 1..200),
        ) {
            prop_assume!((height - camera.position.z).abs() > 0.2);
            let size = [1920.0, 1080.0];
            let efov = crate::floor::efov::default_efov(&camera, size).polygon;
            let extent = Extent { size, efov: &efov };
            let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
            let (mut x, mut y, mut status) = (vec![0.0; u.len()], vec![0.0; u.len()], vec![Status::Ok; u.len()]);
            FloorProjector::new(&camera, height)
                .pixels_to_floor_within(&extent, [&u, &v], [&mut x, &mut y], &mut status);
            for i in 0..u.len() {
                let pixel = Pixel { u: u[i], v: v[i] };
                let point = camera.pixel_to_floor(pixel, height);
                prop_assert_eq!(point.is_none(), x[i].is_nan() && y[i].is_nan());
                let floor = camera.pixel_to_floor(pixel, 0.0);
                let expected = match (point, floor) {
                    (None, _) if camera.undistort(pixel).is_none() => Status::OutsideLens,
                    (None, _) => Status::AboveHorizon,
                    _ if !extent.shows(pixel) => Status::OutsideImage,
                    (_, Some(floor)) if extent.contains(floor) => Status::Ok,
                    _ => Status::OutsideEfov,
                };
                // On an edge of the polygon, the status depends on rounding.
                let on_edge = floor.is_some_and(|f| {
                    [(1e-7, 0.0), (-1e-7, 0.0), (0.0, 1e-7), (0.0, -1e-7)].iter().any(|(dx, dy)| {
                        extent.contains(FloorPoint { x: f.x + dx, y: f.y + dy }) != extent.contains(f)
                    })
                });
                prop_assert!(status[i] == expected || on_edge, "{:?}, not {expected:?}", status[i]);
            }
        }

        #[test]
        fn raised_plane_has_covariance_of_floor_under_lowered_camera(
            camera in any_camera(), u in 0.0..1920.0_f64, v in 200.0..1080.0_f64, height in -1.0..1.5_f64,
        ) {
            let mut camera = camera;
            for (index, sigma) in [(Covariance::Z, 0.02), (Covariance::PITCH, 0.003), (Covariance::FOCAL, 9.0)] {
                camera.covariance.0[index][index] = sigma * sigma;
            }
            let mut lower = camera;
            lower.position.z -= height;
            let mut found = [[[0.0]; 3]; 2];
            let to = found.each_mut().map(|part| part.each_mut().map(|column| &mut column[..]));
            FloorProjector::new(&camera, height).floor_covariances([&[u], &[v]], 0.7, to);
            let [pixel, calibration] = found.map(|part| part.map(|[value]| value));
            match lower.floor_covariance(Pixel { u, v }, 0.7) {
                Some(floor) => {
                    let [[xx, xy], [_, yy]] = floor.total().unwrap();
                    let off = |i: usize, value: f64| (pixel[i] + calibration[i] - value).abs();
                    let worst = off(0, xx).max(off(1, xy)).max(off(2, yy));
                    prop_assert!(worst < 1e-6 * (xx + yy), "{pixel:?} {calibration:?} {floor:?}");
                }
                None => prop_assert!(pixel[0].is_nan()),
            }
        }

        #[test]
        fn floor_points_map_back_to_pixels(
            camera in any_camera(), at in proptest::collection::vec((0.0..1920.0_f64, 0.0..1080.0_f64), 1..20),
        ) {
            let projector = FloorProjector::new(&camera, 0.0);
            let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
            let mut out = [(); 4].map(|()| vec![0.0; u.len()]);
            let [x, y, a, b] = &mut out;
            projector.pixels_to_floor(&u, &v, x, y);
            projector.floor_to_pixels(x, y, a, b);
            for i in 0..u.len() {
                prop_assert!(x[i].is_nan() || x[i].hypot(y[i]) > 1e5 || (a[i] - u[i]).hypot(b[i] - v[i]) < 1e-6);
            }
        }
    }
}
