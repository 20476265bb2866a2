//! Window of a camera: the part of the calibrated image that the image of the camera shows, after a digital zoom or a
//! crop.
//!
//! The lens values of the entry belong to the calibrated image. A window (x, y, w, h) in pixels of that image,
//! shown as an image of W x H pixels, moves a pixel (u, v) of the calibrated image to
//! `((u - x) W / w, (v - y) H / h)`. The distortion coefficients do not change, because they belong to
//! normalised coordinates.

use std::borrow::Cow;

use calib_core::camera::{ImageCircle, Pixel};
use calib_core::single::{Known, PrincipalPointPrior, Prior};

use serde::{Deserialize, Serialize};

use crate::document::{LensEntry, SiteCamera};
use crate::pixel_aspect::PixelAspectEntry;
use crate::principal_point::PrincipalPointEntry;

/// Largest relative difference of the scales along u and v that counts as rounding of the window to whole pixels.
/// Both scales are then set to the scale along u.
const MAX_SCALE_DIFFERENCE: f64 = 2e-3;

/// Map from pixels of one image to pixels of another image that shows a window of the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowMap {
    /// Upper left corner of the window, in pixels of the first image.
    pub corner: Pixel,
    /// Pixels of the second image per pixel of the first, along u and v.
    pub scale: [f64; 2],
}

impl WindowMap {
    /// Creates the map to an image of this width and height that shows a window (left, top, width, height).
    #[must_use]
    pub fn new([x, y, w, h]: [f64; 4], size: [u32; 2]) -> Self {
        let [scale_u, scale_v] = [f64::from(size[0]) / w, f64::from(size[1]) / h];
        let is_equal = (scale_u / scale_v - 1.0).abs() < MAX_SCALE_DIFFERENCE;
        Self { corner: Pixel::new(x, y), scale: [scale_u, if is_equal { scale_u } else { scale_v }] }
    }

    /// Maps a pixel of the first image to the second image.
    #[must_use]
    pub fn pixel(&self, Pixel { u, v }: Pixel) -> Pixel {
        Pixel::new(self.scale[0] * (u - self.corner.u), self.scale[1] * (v - self.corner.v))
    }

    /// Returns the window that an image of this width and height shows: left, top, width and height, in pixels
    /// of the first image.
    #[must_use]
    pub fn window(&self, size: [u32; 2]) -> [f64; 4] {
        let [w, h] = [0, 1].map(|axis| f64::from(size[axis]) / self.scale[axis]);
        [self.corner.u, self.corner.v, w, h]
    }

    /// Returns the map that applies this map after `first`.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        let [a, b] = first.scale;
        let corner = Pixel::new(first.corner.u + self.corner.u / a, first.corner.v + self.corner.v / b);
        Self { corner, scale: [a * self.scale[0], b * self.scale[1]] }
    }

    fn length(&self, known: Known) -> Known {
        let by = self.scale[0];
        Known { value: by * known.value, sigma: known.sigma.map(|sigma| by * sigma), ..known }
    }

    fn pixel_aspect(&self, entry: Option<PixelAspectEntry>) -> Option<PixelAspectEntry> {
        let by = self.scale[1] / self.scale[0];
        Some(match entry {
            None if by == 1.0 => return None,
            None => PixelAspectEntry::Known(by),
            Some(PixelAspectEntry::Known(value)) => PixelAspectEntry::Known(by * value),
            Some(PixelAspectEntry::Prior(Prior { value, sigma })) => {
                PixelAspectEntry::Prior(Prior { value: by * value, sigma: by * sigma })
            }
            Some(PixelAspectEntry::Fit) => PixelAspectEntry::Fit,
        })
    }
}

impl LensEntry {
    /// Returns the lens values in pixels of an image of this size, without the window.
    #[must_use]
    pub fn in_image(&self, size: [u32; 2]) -> Cow<'_, Self> {
        let Some(window) = self.window_px else { return Cow::Borrowed(self) };
        let map = WindowMap::new(window, size);
        let distortion = self.distortion.clone().map(|mut distortion| {
            distortion.focal_px = distortion.focal_px.map(|focal| map.scale[0] * focal);
            distortion
        });
        let circle = |circle: ImageCircle| {
            let Pixel { u, v } = map.pixel(circle.centre());
            ImageCircle::from([u, v, map.scale[0] * circle.radius])
        };
        Cow::Owned(Self {
            focal_px: self.focal_px.map(|focal| map.length(focal)),
            principal_point_px: self.principal_point_px.map(|PrincipalPointEntry { value, sigma }| {
                let sigma = sigma.map(|sigma| map.scale[0] * sigma);
                PrincipalPointEntry { value: map.pixel(value), sigma }
            }),
            pixel_aspect: map.pixel_aspect(self.pixel_aspect),
            image_circle_px: self.image_circle_px.map(circle),
            distortion,
            window_px: None,
            ..self.clone()
        })
    }
}

impl SiteCamera {
    /// Returns the entered lens values in pixels of the image of this camera.
    #[must_use]
    pub fn lens_of_image(&self) -> Option<Cow<'_, LensEntry>> {
        self.lens.as_ref().map(|lens| lens.in_image(self.size_px))
    }

    /// Returns the prior on the principal point if none is entered: near the centre of the calibrated image.
    ///
    /// A window that fits into an image of the camera's own size is a digital zoom: the calibrated image has this
    /// size. For other windows the size of the calibrated image is unknown, so the prior allows a principal point
    /// anywhere in the image or near it.
    #[must_use]
    pub fn principal_point_near_centre(&self) -> PrincipalPointPrior {
        let (size, window) = (self.size(), self.lens.as_ref().and_then(|lens| lens.window_px));
        let Some(window) = window else { return PrincipalPointPrior::of_image(size) };
        let [x, y, w, h] = window;
        let is_zoom = x >= 0.0 && y >= 0.0 && x + w <= size[0] && y + h <= size[1];
        if !is_zoom || w >= size[0] && h >= size[1] {
            return PrincipalPointPrior::of_crop(size);
        }
        let map = WindowMap::new(window, self.size_px);
        let PrincipalPointPrior { value, sigma } = PrincipalPointPrior::of_image(size);
        PrincipalPointPrior { value: map.pixel(value), sigma: map.scale[0] * sigma }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solution::DistortionEntry;
    use calib_core::camera::{BrownConrady, Distortion, Lens};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_window_shows_the_rays_of_the_calibrated_image(
            x in 0.0..900.0_f64, y in 0.0..500.0_f64, zoom in 1.0..4.0_f64, stretch in 0.5..2.0_f64,
            u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, aspect in 0.8..1.2_f64,
        ) {
            let brown = Distortion::BrownConrady(BrownConrady { k1: -0.2, k2: 0.05, p1: 1e-3, ..BrownConrady::default() });
            let lens = Lens { principal_point: Pixel::new(950.0, 560.0), focal: 1300.0, pixel_aspect: aspect, distortion: brown, image_circle: None };
            let entry = LensEntry {
                focal_px: Some(Known::fixed(1300.0)),
                principal_point_px: Some(PrincipalPointEntry::known(lens.principal_point)),
                pixel_aspect: Some(PixelAspectEntry::Known(aspect)),
                distortion: DistortionEntry::from_lens(&lens, 1300.0),
                ..LensEntry::default()
            };
            let calibrated = SiteCamera { lens: Some(entry.clone()), ..SiteCamera::new("a", [1920, 1080]) };
            let window = [x, y, 1920.0 / zoom, 1080.0 / zoom / stretch];
            let shown = SiteCamera {
                lens: Some(LensEntry { window_px: Some(window), ..entry }),
                ..SiteCamera::new("a", [1920, 1080])
            };
            let pixel = Pixel::new(u, v);
            let moved = Pixel::new((u - x) * 1920.0 / window[2], (v - y) * 1080.0 / window[3]);
            let rays = [(&calibrated, pixel), (&shown, moved)].map(|(camera, pixel)| {
                let (lens, focal) = (camera.lens(), camera.lens_of_image().unwrap().focal_px.unwrap().value);
                lens.bearing(pixel).map(|[x, y, w]| [x / focal, y / focal, w])
            });
            if let [Some(a), Some(b)] = rays {
                // A window need not consist of whole pixels, but almost equal scales count as equal.
                let tolerance = if (stretch - 1.0).abs() < 3e-3 { 3e-3 } else { 1e-9 };
                prop_assert!((0..3).all(|k| (a[k] - b[k]).abs() < tolerance), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn the_centre_of_a_zoomed_image_is_that_of_the_sensor() {
        let camera = |window: [f64; 4]| SiteCamera {
            lens: Some(LensEntry { window_px: Some(window), ..LensEntry::default() }),
            ..SiteCamera::new("a", [1920, 1080])
        };
        let prior = camera([0.0, 0.0, 960.0, 540.0]).principal_point_near_centre();
        let whole = PrincipalPointPrior::of_image([1920.0, 1080.0]);
        assert_eq!(prior.value, Pixel::new(1920.0, 1080.0));
        assert_eq!(prior.sigma, 2.0 * whole.sigma);
        assert_eq!(
            camera([300.0, 200.0, 1920.0, 1080.0]).principal_point_near_centre(),
            PrincipalPointPrior::of_crop([1920.0, 1080.0])
        );
    }
}
