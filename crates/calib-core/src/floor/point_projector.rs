//! Projector of slices of world points to pixels. The camera is prepared once, and mapping allocates no
//! memory.

use crate::camera::{
    BrownConrady, Camera, Distortion, MIN_DEPTH, Pixel, UndistortedPixel, WorldPoint, dispatch,
};

/// Camera prepared to map many world points to pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointProjector {
    camera: Camera,
    /// Camera axes right, down and forward, as rows in world axes. Right and down are multiplied by the focal
    /// length of the camera divided by the focal length of the lens.
    axes: [[f64; 3]; 3],
    /// Largest squared radius of undistorted, normalised coordinates that the lens shows.
    most: f64,
}

impl PointProjector {
    /// Prepares a camera for the projection of many points.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        let ([right, down, forward], ratio) = (camera.rotation(), camera.focal / camera.lens.focal);
        let axes = [right.map(|axis| ratio * axis), down.map(|axis| ratio * axis), forward];
        Self { camera: *camera, axes, most: camera.lens.distortion.max_radius().powi(2) }
    }

    /// Maps world points, in metres, to raw pixels `(u, v)`; see [`Camera::world_to_pixel`].
    ///
    /// A point that the lens does not show becomes NaN.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn points_to_pixels(&self, [x, y, z]: [&[f64]; 3], [u, v]: [&mut [f64]; 2]) {
        let of_one_length = [x.len(), y.len(), z.len(), v.len()].iter().all(|&length| length == u.len());
        assert!(of_one_length, "slices of equal length");
        match self.camera.lens.distortion {
            Distortion::None => self.map_by_brown_model(None, [x, y, z], [u, v]),
            Distortion::BrownConrady(brown) => self.map_by_brown_model(Some(&brown), [x, y, z], [u, v]),
            // Other models are mapped point by point.
            _ => {
                for i in 0..u.len() {
                    let shown = self.world_to_pixel(WorldPoint { x: x[i], y: y[i], z: z[i] });
                    (u[i], v[i]) = shown.map_or((f64::NAN, f64::NAN), |pixel| (pixel.u, pixel.v));
                }
            }
        }
    }

    /// Maps points with the Brown-Conrady model, or without distortion if `brown` is `None`.
    #[inline(always)]
    fn map_by_brown_model(
        &self,
        brown: Option<&BrownConrady>,
        [x, y, z]: [&[f64]; 3],
        [u, v]: [&mut [f64]; 2],
    ) {
        let (eye, axes, most) = (self.camera.position, self.axes, self.most);
        let (Pixel { u: cu, v: cv }, f) = (self.camera.lens.principal_point, self.camera.lens.focal);
        let f_v = self.camera.lens.pixel_aspect * f;
        let (brown, straight) = (brown.copied().unwrap_or_default(), brown.is_none());
        dispatch(
            #[inline(always)]
            move || {
                let pixels = u.iter_mut().zip(v);
                for (((u, v), &x), (&y, &z)) in pixels.zip(x).zip(y.iter().zip(z)) {
                    let (x, y, z) = (x - eye.x, y - eye.y, z - eye.z);
                    let along = |axis: [f64; 3]| axis[0] * x + axis[1] * y + axis[2] * z;
                    let [right, down, depth] = axes.map(along);
                    let scale = if depth > MIN_DEPTH { depth.recip() } else { f64::NAN };
                    let (a, b) = (right * scale, down * scale);
                    let shown = a * a + b * b <= most;
                    let bent = if straight { [a, b] } else { brown.evaluate([a, b]) };
                    *u = if shown { cu + f * bent[0] } else { f64::NAN };
                    *v = if shown { cv + f_v * bent[1] } else { f64::NAN };
                }
            },
        );
    }

    /// Maps one world point to a raw pixel.
    fn world_to_pixel(&self, point: WorldPoint) -> Option<Pixel> {
        let from_eye = [
            point.x - self.camera.position.x,
            point.y - self.camera.position.y,
            point.z - self.camera.position.z,
        ];
        let [x, y, z] =
            self.axes.map(|axis| axis[0] * from_eye[0] + axis[1] * from_eye[1] + axis[2] * from_eye[2]);
        let (Pixel { u: cu, v: cv }, f) = (self.camera.lens.principal_point, self.camera.lens.focal);
        if self.camera.lens.distortion.is_wide() {
            return self.camera.lens.bearing_to_pixel([f * x, f * y, z]);
        }
        let straight = UndistortedPixel { u: cu + f * x / z, v: cv + f * y / z };
        if z > MIN_DEPTH { self.camera.lens.distort(straight) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Lens, any_camera, any_distortion};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn slice_maps_like_single_points(
            camera in any_camera(), other in any_distortion(), is_other: bool,
            at in proptest::collection::vec((-40.0..40.0_f64, -40.0..40.0_f64, -3.0..9.0_f64), 1..40),
        ) {
            let lens = Lens { distortion: if is_other { other } else { camera.lens.distortion }, ..camera.lens };
            let camera = Camera { lens, ..camera };
            let [x, y, z]: [Vec<f64>; 3] =
                [0, 1, 2].map(|k| at.iter().map(|&(x, y, z)| [x, y, z][k]).collect());
            let (mut u, mut v) = (vec![0.0; at.len()], vec![0.0; at.len()]);
            PointProjector::new(&camera).points_to_pixels([&x, &y, &z], [&mut u, &mut v]);
            for i in 0..at.len() {
                let point = WorldPoint { x: x[i], y: y[i], z: z[i] };
                // At the rim of the lens and near the camera plane, rounding decides whether a point has a pixel.
                let depth = camera.in_camera(point)[2];
                match camera.world_to_pixel(point) {
                    Some(pixel) if depth > 1e-3 => {
                        let off = (pixel.u - u[i]).hypot(pixel.v - v[i]);
                        let rim = camera.world_to_undistorted(point).is_some_and(|s| {
                            let straight = (s.u - lens.principal_point.u).hypot(s.v - lens.principal_point.v);
                            straight > (1.0 - 1e-9) * lens.focal * lens.distortion.max_radius()
                        });
                        prop_assert!(rim || off < 1e-9 * (1.0 + pixel.u.hypot(pixel.v)), "{pixel:?} {} {}", u[i], v[i]);
                    }
                    Some(_) => {}
                    None => prop_assert!(u[i].is_nan() == v[i].is_nan()),
                }
            }
            let mut alone = ([0.0], [0.0]);
            let first = [&x[..1], &y[..1], &z[..1]];
            PointProjector::new(&camera).points_to_pixels(first, [&mut alone.0, &mut alone.1]);
            prop_assert_eq!(alone.0[0].to_bits(), u[0].to_bits());
        }
    }
}
