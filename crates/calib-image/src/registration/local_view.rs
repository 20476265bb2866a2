//! Camera in its local frame: the origin is the floor point below the camera, y points ahead, z up, and the
//! unit of length is the height of the camera.

use calib_core::{Camera, ImageCircle, Pixel, WorldPoint};
use image::RgbImage;

use crate::image_circle;

/// Smallest width and height of an image, in pixels.
const MIN_SIDE_PX: u32 = 48;
/// Largest ratio of the sides of an image.
const MAX_ASPECT: f64 = 4.0;

/// Calibrated camera with its image, for the registration.
///
/// The registration uses the height `z`, the pitch, the roll, the focal length and the lens of the camera. It
/// ignores the x and y of the position.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Camera with the measured or assumed height. The first camera of a group keeps its yaw.
    pub camera: &'a Camera,
    /// Size of the images for which the camera is calibrated: width and height, in pixels.
    pub size_px: [u32; 2],
    /// Image of the camera. It may be smaller than `size_px`.
    pub image: &'a RgbImage,
    /// Whether the height is measured. The standard deviation of a measured height is 2 %, otherwise 10 %.
    pub is_height_known: bool,
}

/// Returns the image circle that an image shows, in pixels of the calibrated size.
fn circle_of_image(view: &View) -> Option<ImageCircle> {
    let circle = image_circle(view.image)?;
    let scale = f64::from(view.size_px[0]) / f64::from(view.image.width());
    Some(ImageCircle { u: scale * circle.u, v: scale * circle.v, radius: scale * circle.radius })
}

/// Maps between the pixels of an image and the local frame of its camera.
#[derive(Clone, Debug)]
pub(crate) struct LocalView {
    /// Camera at height 1 above the origin, with yaw 0.
    camera: Camera,
    /// Rows right, down and forward of the camera, in the local frame.
    pub(crate) rotation: [[f64; 3]; 3],
    /// Width and height for which the camera is calibrated, in pixels.
    size: [f64; 2],
    /// Image circle of a wide lens, without its blurred rim.
    rim: Option<ImageCircle>,
    /// Whether black pixels may be outside an unknown image circle.
    pub(crate) is_black_hidden: bool,
}

impl LocalView {
    /// Creates the local view. `margin` is the width of the blurred rim of a fisheye image, in pixels.
    /// Returns `None` if the image is too small or too narrow. Also returns `None` if a value of the camera
    /// is not finite, or the height or a focal length is not positive.
    pub(crate) fn new(view: &View, margin: f64) -> Option<Self> {
        let size = view.size_px.map(f64::from);
        let (w, h) = view.image.dimensions();
        let is_usable = w.min(h) >= MIN_SIDE_PX
            && view.size_px[0].min(view.size_px[1]) > 0
            && size[0].max(size[1]) <= MAX_ASPECT * size[0].min(size[1]);
        let given = view.camera;
        let numbers = [given.pitch, given.roll, given.focal, given.position.z, given.lens.focal];
        let is_finite = numbers.iter().all(|number| number.is_finite());
        let is_camera = is_finite && given.focal > 0.0 && given.lens.focal > 0.0 && given.position.z > 0.0;
        if !is_usable || !is_camera || !given.lens.principal_point.is_finite() {
            return None;
        }
        let is_wide = given.lens.distortion.is_wide();
        let circle = given.lens.image_circle.or_else(|| circle_of_image(view)).filter(|_| is_wide);
        let rim = circle.map(|circle| ImageCircle { radius: circle.radius - margin, ..circle });
        let camera = Camera { position: WorldPoint::new(0.0, 0.0, 1.0), yaw: 0.0, ..*given };
        let is_black_hidden = is_wide && circle.is_none();
        Some(Self { rotation: camera.rotation(), camera, size, rim, is_black_hidden })
    }

    /// Whether a raw pixel is in the image, and within the image circle of a wide lens.
    pub(crate) fn shows(&self, pixel: Pixel) -> bool {
        let is_in = |at: f64, length: f64| (0.0..length).contains(&at);
        let is_in_rim = || self.rim.is_none_or(|rim| rim.contains(self.camera.lens.to_square_pixel(pixel)));
        is_in(pixel.u, self.size[0]) && is_in(pixel.v, self.size[1]) && is_in_rim()
    }

    /// Maps a vector in camera axes (right, down, forward) to its raw pixel. Returns `None` if the image does
    /// not show it.
    pub(crate) fn vector_to_pixel(&self, [x, y, z]: [f64; 3]) -> Option<Pixel> {
        let bearing = [self.camera.focal * x, self.camera.focal * y, z];
        self.camera.lens.bearing_to_pixel(bearing).filter(|&pixel| self.shows(pixel))
    }

    /// Maps a point of the local frame to its raw pixel. Returns `None` if the image does not show it.
    pub(crate) fn project(&self, [x, y, z]: [f64; 3]) -> Option<Pixel> {
        let from_camera = [x, y, z - 1.0];
        self.vector_to_pixel(self.rotation.map(|row| (0..3).map(|i| row[i] * from_camera[i]).sum()))
    }

    /// Returns the unit vector of a raw pixel, in the local frame.
    pub(crate) fn direction(&self, pixel: Pixel) -> Option<[f64; 3]> {
        let direction = self.camera.pixel_to_ray(pixel).filter(|_| self.shows(pixel))?.direction;
        direction.iter().all(|c| c.is_finite()).then_some(direction)
    }

    /// Returns the unit vector of a raw pixel, in camera axes.
    pub(crate) fn vector(&self, pixel: Pixel) -> Option<[f64; 3]> {
        let direction = self.direction(pixel)?;
        Some(self.rotation.map(|row| (0..3).map(|i| row[i] * direction[i]).sum()))
    }
}
