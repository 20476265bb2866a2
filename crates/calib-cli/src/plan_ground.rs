//! Background image and overlay of the plan view of a site.

use calib_report::{BACKGROUND, PLAN_OPACITY, PlanBackground, Svg};
use calib_site::{Site, SiteCoverage};
use image::{Rgb, RgbImage, imageops};

/// Returns the background of the plan view, with the plan's image if it exists, and the overlay of the site.
pub(crate) fn plan_view(site: &Site, picture: Option<RgbImage>) -> (RgbImage, Svg) {
    let sides = picture.as_ref().map(|picture| picture.dimensions().into());
    on_ground(calib_report::plan_view(site, sides), picture)
}

/// Returns the background of the plan view, and the overlay with the coverage of the site.
pub(crate) fn coverage_view(
    site: &Site,
    picture: Option<RgbImage>,
    coverage: &SiteCoverage<'_>,
) -> (RgbImage, Svg) {
    let sides = picture.as_ref().map(|picture| picture.dimensions().into());
    on_ground(calib_report::coverage_view(site, sides, coverage), picture)
}

/// Returns the background of a view as pixels, with a lightened plan image, and its overlay.
fn on_ground((background, svg): (PlanBackground, Svg), picture: Option<RgbImage>) -> (RgbImage, Svg) {
    let PlanBackground { size: [w, h], has_image } = background;
    let mut ground = RgbImage::from_pixel(w, h, Rgb(BACKGROUND));
    if let Some(picture) = picture.filter(|_| has_image) {
        imageops::replace(&mut ground, &lighten(picture), 0, 0);
    }
    (ground, svg)
}

fn lighten(mut image: RgbImage) -> RgbImage {
    for pixel in image.pixels_mut() {
        let mix = |value: u8| f64::from(value) * PLAN_OPACITY + 255.0 * (1.0 - PLAN_OPACITY);
        pixel.0 = pixel.0.map(|value| mix(value).round() as u8);
    }
    image
}
