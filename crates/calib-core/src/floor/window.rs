//! Windows: perspective or cylindrical views in any direction within a lens, from the position of the camera.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::camera::{
    Camera, Covariance, Lens, Pixel, angle_from_axis, angles_from_rotation, camera_from_world, dot, hypot,
    sin_cos,
};
use crate::floor::remap::Remap;

/// Direction and field of view of a flat window relative to the axis of its camera, in radians.
///
/// The angles are applied in the order yaw, pitch, roll, as for a [`Camera`]. If all angles are 0, the window
/// looks along the axis, and its up direction is the up direction of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewDirection {
    /// Pitch, in radians, positive downwards.
    pub pitch: f64,
    /// Yaw, in radians, positive to the left.
    pub yaw: f64,
    /// Roll, in radians, positive if the window is rotated clockwise, so that its image rotates
    /// counter-clockwise.
    pub roll: f64,
    /// Horizontal field of view, in radians.
    pub hfov: f64,
}

/// Mounting of a camera, which determines the upright direction of its windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mount {
    /// Ceiling mount, looking down: up in a window is the direction away from the optical axis.
    Ceiling,
    /// Wall mount: up in a window is the up direction of the image.
    Wall,
}

impl Mount {
    /// Returns the likely mounting of a camera with this pitch, in radians: a ceiling above 45°, otherwise a wall.
    #[must_use]
    pub fn from_pitch(pitch: f64) -> Self {
        if pitch > 0.25 * PI { Self::Ceiling } else { Self::Wall }
    }
}

/// View of a camera with its own size, direction and projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Rows right, down, forward of the window in camera axes.
    rotation: [[f64; 3]; 3],
    /// Width and height, in pixels.
    pub size: [usize; 2],
    /// Focal length, in pixels; for a cylindrical window, pixels per radian around it.
    pub focal: f64,
    /// Principal point, from the corner of the window, in pixels.
    pub principal_point: Pixel,
    /// Whether the window is an unrolled cylinder. Each column then shows a plane through the axis of the
    /// cylinder.
    pub is_round: bool,
}

impl Window {
    /// Maximum field of view of a flat window, in radians.
    pub const MAX_HFOV: f64 = 170.0 / 180.0 * PI;

    /// Creates a flat window. Returns `None` if a side of `size` is 0, or if the field of view is not between
    /// 0 and [`Self::MAX_HFOV`].
    #[must_use]
    pub fn flat(look: ViewDirection, size: [usize; 2]) -> Option<Self> {
        let [right, down, forward] = camera_from_world(look.roll, look.pitch, look.yaw);
        // The axes right, forward, up of the camera are the world axes of its windows.
        let rotation = [right, down, forward].map(|[x, y, z]| [x, -z, y]);
        Self::from_rotation(rotation, look.hfov, size)
    }

    /// Creates a flat window with the rows right, down, forward of `rotation`, in camera axes.
    fn from_rotation(rotation: [[f64; 3]; 3], hfov: f64, size: [usize; 2]) -> Option<Self> {
        let [width, height] = size.map(|side| side as f64);
        let is_finite = rotation.iter().flatten().all(|part| part.is_finite());
        if size.contains(&0) || !is_finite || !(hfov > 0.0 && hfov <= Self::MAX_HFOV) {
            return None;
        }
        let (sin, cos) = sin_cos(0.5 * hfov);
        let principal_point = Pixel::new(0.5 * width, 0.5 * height);
        Some(Self { rotation, size, focal: 0.5 * width * cos / sin, principal_point, is_round: false })
    }

    /// Creates a flat window towards a direction in camera axes, in which upright objects are upright.
    /// Returns `None` if a side of `size` is 0, or if the field of view is not between 0 and
    /// [`Self::MAX_HFOV`]. Along the axis of a ceiling camera, up is the up direction of the image.
    #[must_use]
    pub fn toward(mount: Mount, direction: [f64; 3], hfov: f64, size: [usize; 2]) -> Option<Self> {
        let [x, y, z] = direction;
        let out = hypot(x, y);
        match mount {
            Mount::Wall => {
                let (pitch, yaw) = (y.atan2(hypot(x, z)), (-x).atan2(z));
                Self::flat(ViewDirection { pitch, yaw, roll: 0.0, hfov }, size)
            }
            Mount::Ceiling => {
                let length = hypot(out, z);
                let [sin, cos] = [out / length, z / length];
                let [out_u, out_v] = if out > 1e-9 * length { [x / out, y / out] } else { [0.0, -1.0] };
                let forward = [sin * out_u, sin * out_v, cos];
                let down = [-cos * out_u, -cos * out_v, sin];
                Self::from_rotation([cross(down, forward), down, forward], hfov, size)
            }
        }
    }

    /// Creates four windows around the axis of a camera. On a ceiling they look outwards to the top, right,
    /// bottom and left side of the image, with upright objects upright. On a wall they look up left, up right,
    /// down left and down right. Returns `None` if a side of `size` is 0.
    #[must_use]
    pub fn quadrants(mount: Mount, size: [usize; 2]) -> Option<[Self; 4]> {
        /// Angle of the windows from the axis of the camera, in radians.
        const AXIS_ANGLE_RAD: f64 = 52.0 / 180.0 * PI;
        /// Horizontal field of view of each window, in radians.
        const QUADRANT_HFOV_RAD: f64 = 95.0 / 180.0 * PI;
        let quadrant = |index: usize| match mount {
            Mount::Ceiling => {
                let (out_u, out_v) = [(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)][index];
                let (sin, cos) = sin_cos(AXIS_ANGLE_RAD);
                Self::toward(mount, [sin * out_u, sin * out_v, cos], QUADRANT_HFOV_RAD, size)
            }
            Mount::Wall => {
                let (side, up) = [(1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)][index];
                let look = ViewDirection {
                    yaw: 0.25 * PI * side,
                    pitch: 0.2 * PI * up,
                    roll: 0.0,
                    hfov: QUADRANT_HFOV_RAD,
                };
                Self::flat(look, size)
            }
        };
        Some([quadrant(0)?, quadrant(1)?, quadrant(2)?, quadrant(3)?])
    }

    /// Creates a cylindrical window with the whole view of a lens, unrolled. On a ceiling the cylinder is
    /// about the optical axis. The window extends from the rim of the image downwards, and shows the top of
    /// the image in its middle. On a wall the cylinder is about the up direction of the image. `reach` is the
    /// largest visible angle from the axis, in radians; see [`lens_reach`]. Returns `None` if a side of
    /// `size` is 0, or if `reach` is not between 0 and pi.
    #[must_use]
    pub fn panorama(mount: Mount, reach: f64, size: [usize; 2]) -> Option<Self> {
        /// Largest shown slope of a ray above the horizon, for a lens that sees above the horizon.
        const MAX_SLOPE_ABOVE_HORIZON: f64 = 0.27;
        if size.contains(&0) || !(reach > 0.0 && reach < PI) {
            return None;
        }
        let [width, height] = size.map(|side| side as f64);
        let (rotation, angle, above) = match mount {
            Mount::Ceiling => {
                let (sin, cos) = sin_cos(reach - FRAC_PI_2);
                let rotation = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
                (rotation, TAU, Some((sin / cos).min(MAX_SLOPE_ABOVE_HORIZON)))
            }
            Mount::Wall => {
                ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], (2.0 * reach).min(TAU), None)
            }
        };
        let focal = width / angle;
        let middle = above.map_or(0.5 * height, |above| above * focal);
        let principal_point = Pixel::new(0.5 * width, middle);
        Some(Self { rotation, size, focal, principal_point, is_round: true })
    }

    /// Returns the rows right, down, forward of the window in camera axes (right, down, forward).
    #[must_use]
    pub const fn window_from_camera(&self) -> &[[f64; 3]; 3] {
        &self.rotation
    }

    /// Returns the direction of a window pixel in camera axes. The vector has any length.
    #[must_use]
    pub fn direction(&self, pixel: Pixel) -> [f64; 3] {
        let Pixel { u: cu, v: cv } = self.principal_point;
        let (x, y) = ((pixel.u - cu) / self.focal, (pixel.v - cv) / self.focal);
        let (x, z) = if self.is_round { sin_cos(x) } else { (x, 1.0) };
        std::array::from_fn(|i| {
            let [right, down, forward] = &self.rotation;
            x * right[i] + y * down[i] + z * forward[i]
        })
    }

    /// Maps a direction in camera axes to a window pixel. Returns `None` for directions 90° or more from the
    /// axis of a flat window, and on the axis of a cylindrical one.
    #[must_use]
    pub fn pixel(&self, direction: [f64; 3]) -> Option<Pixel> {
        let [x, y, z] = self.rotation.map(|row| dot(&row, &direction));
        let Pixel { u: cu, v: cv } = self.principal_point;
        if !self.is_round {
            return (z > 0.0).then(|| Pixel::new(cu + self.focal * x / z, cv + self.focal * y / z));
        }
        let level = hypot(x, z);
        (level > 0.0).then(|| Pixel::new(cu + self.focal * x.atan2(z), cv + self.focal * y / level))
    }

    /// Maps a window pixel to the raw image of a camera. `focal` is the focal length of the camera, in
    /// pixels. Returns `None` if the lens does not show the direction.
    #[must_use]
    pub fn raw(&self, lens: &Lens, focal: f64, pixel: Pixel) -> Option<Pixel> {
        let [x, y, z] = self.direction(pixel);
        lens.bearing_to_pixel([focal * x, focal * y, z])
    }

    /// Maps a raw pixel of a camera to the window. The result may be outside the borders of the window. Returns
    /// `None` if no ray reaches the raw pixel, or if [`Self::pixel`] returns `None` for its direction.
    #[must_use]
    pub fn raw_to_window(&self, lens: &Lens, focal: f64, raw: Pixel) -> Option<Pixel> {
        let [x, y, z] = lens.bearing(raw)?;
        self.pixel([x / focal, y / focal, z])
    }

    /// Computes the map from the window to raw images of the size `raw`, in pixels. Returns `None` for a raw image
    /// of fewer than 2 x 2 pixels, and for images of 1.4 gigapixels and more.
    #[must_use]
    pub fn remap(&self, lens: &Lens, focal: f64, raw: [usize; 2]) -> Option<Remap> {
        Remap::new(raw, self.size, |pixel| self.raw(lens, focal, pixel))
    }

    /// Returns the pinhole camera that is equivalent to a flat window of the camera `of`. Returns `None` for a
    /// cylindrical window. The covariance of the pinhole camera is zero.
    #[must_use]
    pub fn camera(&self, of: &Camera) -> Option<Camera> {
        let camera = of.rotation();
        let row = |own: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|j| (0..3).map(|i| own[i] * camera[i][j]).sum())
        };
        let (roll, pitch, yaw) = angles_from_rotation(&self.rotation.map(row));
        let lens = Lens::pinhole(self.principal_point);
        let covariance = Covariance::EXACT;
        let pinhole = Camera { position: of.position, yaw, pitch, roll, focal: self.focal, lens, covariance };
        (!self.is_round).then_some(pinhole)
    }
}

/// Returns the largest visible angle from the axis, in radians, along the row and the column of the principal
/// point. For a fisheye with a circle inside the image, it is the angle of the rim. `focal` is the focal length
/// of the camera, in pixels.
#[must_use]
pub fn lens_reach(lens: &Lens, focal: f64, [width, height]: [f64; 2]) -> f64 {
    let Pixel { u: cu, v: cv } = lens.principal_point;
    let sides = [[0.0, cv], [width, cv], [cu, 0.0], [cu, height]];
    sides.into_iter().filter_map(|side| reach_toward(lens, focal, side)).fold(0.0, f64::max)
}

/// Returns the angle from the optical axis at a pixel, in radians, or at the last visible point on the way to
/// it from the principal point. Returns `None` if no ray is visible.
fn reach_toward(lens: &Lens, focal: f64, [u, v]: [f64; 2]) -> Option<f64> {
    /// Number of bisection steps to the last visible point, for an accuracy far below a pixel.
    const BISECTION_STEPS: u32 = 20;
    let Pixel { u: cu, v: cv } = lens.principal_point;
    let angle = |share: f64| {
        let [x, y, z] = lens.bearing(Pixel::new(cu + share * (u - cu), cv + share * (v - cv)))?;
        Some(angle_from_axis(hypot(x, y) / focal, z))
    };
    angle(1.0).or_else(|| {
        let halved = |(share, last): (f64, Option<f64>), step: u32| {
            let next = share + 0.5_f64.powi(step as i32);
            angle(next).map_or((share, last), |angle| (next, Some(angle)))
        };
        (1..=BISECTION_STEPS).fold((0.0, None), halved).1
    })
}

/// Returns the horizontal field of view of an image, in radians. The angle excludes lens distortion, except
/// for a wide lens. For a wide lens it is the sum of the visible angles to both sides. `focal` is the focal
/// length of the camera, in pixels.
#[must_use]
pub fn view_angle(lens: &Lens, focal: f64, size: [f64; 2]) -> f64 {
    if lens.distortion.is_wide() {
        let [left, right] = [0.0, size[0]].map(|u| reach_toward(lens, focal, [u, lens.principal_point.v]));
        left.unwrap_or(0.0) + right.unwrap_or(0.0)
    } else {
        2.0 * (0.5 * size[0] / focal).atan()
    }
}

/// Returns the cross product of two vectors.
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, ImageCircle, WorldPoint, any_camera};
    use proptest::prelude::*;

    fn fisheye() -> Lens {
        let distortion = Distortion::KannalaBrandt { k: [0.01, -0.002, 0.0, 0.0] };
        Lens {
            principal_point: Pixel::new(500.0, 490.0),
            focal: 300.0,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        }
    }

    fn any_window() -> impl Strategy<Value = Window> {
        let flat = [-1.5..1.5_f64, -3.0..3.0_f64, -3.0..3.0_f64, 0.2..2.8_f64].prop_map(
            |[pitch, yaw, roll, hfov]| {
                Window::flat(ViewDirection { pitch, yaw, roll, hfov }, [640, 480]).unwrap()
            },
        );
        let mount = prop_oneof![Just(Mount::Ceiling), Just(Mount::Wall)];
        let four = (mount.clone(), 0..4_usize)
            .prop_map(|(mount, i)| Window::quadrants(mount, [640, 480]).unwrap()[i]);
        let round = mount.prop_map(|mount| Window::panorama(mount, 1.6, [1200, 400]).unwrap());
        prop_oneof![flat, four, round]
    }

    proptest! {
        #[test]
        fn window_pixel_maps_to_raw_image_and_back(
            window in any_window(), u in 0.02..0.98_f64, v in 0.02..0.98_f64,
        ) {
            let lens = fisheye();
            let pixel = Pixel::new(u * window.size[0] as f64, v * window.size[1] as f64);
            let raw = window.raw(&lens, lens.focal, pixel);
            prop_assume!(raw.is_some());
            let back = window.raw_to_window(&lens, lens.focal, raw.unwrap()).unwrap();
            prop_assert!(back.distance(pixel) < 1e-6, "{back:?} {pixel:?}");
        }

        #[test]
        fn a_flat_window_of_a_camera_is_a_pinhole_camera(
            camera in any_camera(), window in any_window(), at in [-9.0..9.0_f64, -9.0..9.0_f64, 0.0..3.0_f64],
        ) {
            prop_assume!(!window.is_round);
            let pinhole = window.camera(&camera).unwrap();
            let point = WorldPoint::from(at);
            let direct = window.pixel(camera.in_camera(point));
            let shown = pinhole.world_to_pixel(point);
            prop_assume!(pinhole.in_camera(point)[2].abs() > 1e-3);
            prop_assert_eq!(direct.is_some(), shown.is_some());
            if let (Some(a), Some(b)) = (direct, shown) {
                prop_assert!(a.distance(b) < 1e-5 * (1.0 + a.u.abs() + a.v.abs()), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn view_direction_rotates_like_a_camera() {
        let look = |pitch: f64, yaw: f64| ViewDirection { pitch, yaw, roll: 0.0, hfov: 1.0 };
        let middle = |look| {
            let window = Window::flat(look, [100, 50]).unwrap();
            window.direction(window.principal_point)
        };
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(middle(look(0.0, 0.0)), [0.0, 0.0, 1.0]), "along the axis");
        assert!(near(middle(look(FRAC_PI_2, 0.0)), [0.0, 1.0, 0.0]), "down");
        assert!(near(middle(look(0.0, FRAC_PI_2)), [-1.0, 0.0, 0.0]), "left");
    }

    #[test]
    fn ceiling_windows_show_people_upright() {
        // A camera that looks straight down, and the foot and head of people all around it.
        let camera = Camera {
            position: WorldPoint { x: 0.0, y: 0.0, z: 4.0 },
            yaw: 0.3,
            pitch: FRAC_PI_2,
            roll: 0.0,
            focal: 300.0,
            lens: fisheye(),
            covariance: Covariance::EXACT,
        };
        let panorama = Window::panorama(Mount::Ceiling, 1.6, [1200, 400]).unwrap();
        let four = Window::quadrants(Mount::Ceiling, [640, 480]).unwrap();
        for step in 0..36 {
            let (sin, cos) = (TAU * f64::from(step) / 36.0).sin_cos();
            let at = |z: f64| camera.in_camera(WorldPoint { x: 5.0 * cos, y: 5.0 * sin, z });
            let (foot, head) = (panorama.pixel(at(0.0)).unwrap(), panorama.pixel(at(1.8)).unwrap());
            assert!((foot.u - head.u).abs() < 1e-6 && head.v < foot.v, "{foot:?} {head:?}");
            let shown =
                four.iter().filter_map(|window| Some((window.pixel(at(0.0))?, window.pixel(at(1.8))?)));
            let inside = |p: Pixel| p.u > 0.0 && p.u < 640.0 && p.v > 0.0 && p.v < 480.0;
            let seen: Vec<_> = shown.filter(|&(foot, head)| inside(foot) && inside(head)).collect();
            assert!(!seen.is_empty(), "every one is in one of the four");
            assert!(seen.iter().all(|(foot, head)| head.v < foot.v));
        }
    }

    #[test]
    fn direction_is_at_the_window_centre() {
        for mount in [Mount::Ceiling, Mount::Wall] {
            for direction in [[0.0, 0.0, 2.0], [0.3, -0.4, 0.5], [-1.0, 0.2, -0.1]] {
                let window = Window::toward(mount, direction, 1.2, [640, 480]).unwrap();
                let middle = window.pixel(direction).unwrap();
                assert!(
                    middle.distance(window.principal_point) < 1e-9,
                    "{mount:?} {direction:?}: {middle:?}"
                );
            }
        }
    }

    #[test]
    fn invalid_windows_are_rejected() {
        let look = |hfov: f64| ViewDirection { hfov, ..ViewDirection::default() };
        assert_eq!(Window::flat(look(0.0), [10, 10]), None);
        assert_eq!(Window::flat(look(PI), [10, 10]), None);
        assert_eq!(Window::flat(look(1.0), [0, 10]), None);
        assert_eq!(Window::flat(ViewDirection { pitch: f64::NAN, ..look(1.0) }, [10, 10]), None);
        assert_eq!(Window::toward(Mount::Ceiling, [0.0; 3], 1.0, [10, 10]), None);
        assert_eq!(Window::panorama(Mount::Wall, 0.0, [10, 10]), None);
        let window = Window::flat(look(1.0), [10, 10]).unwrap();
        assert!(window.remap(&fisheye(), 300.0, [1, 10]).is_none());
    }

    #[test]
    fn window_pixels_have_colour_of_raw_position() {
        let lens = fisheye();
        let raw: Vec<u8> =
            (0..980_usize).flat_map(|y| (0..1000_usize).map(move |x| ((x + y) / 8) as u8)).collect();
        let look = ViewDirection { pitch: 1.1, yaw: 0.7, roll: 0.2, hfov: 1.4 };
        let window = Window::flat(look, [320, 200]).unwrap();
        let mut out = vec![0; 320 * 200];
        assert!(window.remap(&lens, lens.focal, [1000, 980]).unwrap().apply_into(&raw, &mut out));
        let mut seen = 0;
        for (i, &value) in out.iter().enumerate() {
            let pixel = Pixel::new((i % 320) as f64 + 0.5, (i / 320) as f64 + 0.5);
            let Some(at) = window.raw(&lens, lens.focal, pixel) else { continue };
            if at.u > 1.0 && at.v > 1.0 && at.u < 999.0 && at.v < 979.0 {
                assert!((f64::from(value) - (at.u + at.v - 1.0) / 8.0).abs() < 1.2, "{value} at {at:?}");
                seen += 1;
            }
        }
        assert!(seen > 10_000, "{seen}");
        let wide = view_angle(&lens, lens.focal, [1000.0, 980.0]).to_degrees();
        assert!((185.0..200.0).contains(&wide), "{wide}");
        let flat = Lens::pinhole(Pixel::new(500.0, 490.0));
        assert_eq!(view_angle(&flat, 500.0, [1000.0, 980.0]), FRAC_PI_2);
        assert!((lens_reach(&lens, lens.focal, [1000.0, 980.0]) - 500.0 / 300.0).abs() < 0.1);
        // The visible angle ends at the image circle.
        let half = 92.5_f64.to_radians();
        let rim = lens.bearing_to_pixel([lens.focal * half.sin(), 0.0, half.cos()]).unwrap();
        let circle = ImageCircle { u: 500.0, v: 490.0, radius: rim.u - 500.0 };
        let reach = lens_reach(&Lens { image_circle: Some(circle), ..lens }, lens.focal, [1000.0, 980.0]);
        assert!((reach - half).abs() < 1e-5, "{reach} for {half}");
    }
}
