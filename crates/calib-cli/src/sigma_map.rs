//! Colour map of the predicted floor error, with a legend.

use calib_core::{Camera, Pixel};

use calib_draw::Rgb;
use calib_report::{Anchor, Svg};
use calib_site::SiteCamera;
use image::RgbImage;

/// Side of a coloured cell, in pixels.
const CELL_PX: u32 = 4;
/// Opacity of the colours over the image, from 0 to 1.
const OPACITY: f64 = 0.55;
/// Floor errors at the borders between two colours, in centimetres, as in the legend. The largest is too large
/// for most uses.
const LEGEND_STEPS_CM: [f64; 6] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0];
/// Colours from small to large error, light to dark, distinguishable with colour blindness (viridis,
/// reversed).
const COLOURS: [Rgb; 7] = [
    Rgb([253, 231, 37]),
    Rgb([159, 218, 58]),
    Rgb([74, 193, 109]),
    Rgb([31, 161, 135]),
    Rgb([39, 127, 142]),
    Rgb([54, 92, 141]),
    Rgb([70, 50, 126]),
];

/// Colours the floor of an image by the standard deviation of its points in their worst direction, and adds
/// the legend. A detection is assumed to have the same noise as an annotation.
pub(crate) fn shade(image: &mut RgbImage, svg: &mut Svg, entry: &SiteCamera, camera: &Camera) {
    let sigma = entry.sigma_px.unwrap_or(1.0);
    let (width, height) = image.dimensions();
    for y in (0..height).step_by(CELL_PX as usize) {
        for x in (0..width).step_by(CELL_PX as usize) {
            let centre = Pixel { u: f64::from(x + CELL_PX / 2), v: f64::from(y + CELL_PX / 2) };
            let covariance = camera.floor_covariance(centre, sigma);
            let Some(worst) = covariance.and_then(|covariance| covariance.worst_sigma()) else { continue };
            let Rgb(colour) = colour(100.0 * worst);
            for v in y..(y + CELL_PX).min(height) {
                for u in x..(x + CELL_PX).min(width) {
                    let image::Rgb(below) = *image.get_pixel(u, v);
                    let mix = |i: usize| {
                        (f64::from(below[i]) * (1.0 - OPACITY) + f64::from(colour[i]) * OPACITY) as u8
                    };
                    image.put_pixel(u, v, image::Rgb([mix(0), mix(1), mix(2)]));
                }
            }
        }
    }
    legend(svg, [f64::from(width), f64::from(height)], sigma);
}

fn colour(centimetres: f64) -> Rgb {
    COLOURS[LEGEND_STEPS_CM.iter().take_while(|&&step| centimetres > step).count()]
}

fn legend(svg: &mut Svg, [w, h]: [f64; 2], sigma: f64) {
    let (cell, tall) = (52.0 * svg.scale, 16.0 * svg.scale);
    let left = w - cell * COLOURS.len() as f64 - 20.0 * svg.scale;
    let top = h - 46.0 * svg.scale;
    for (index, &colour) in COLOURS.iter().enumerate() {
        let x = left + cell * index as f64;
        svg.fill(&[[x, top], [x + cell, top], [x + cell, top + tall], [x, top + tall]], colour, 1.0);
        if let Some(step) = LEGEND_STEPS_CM.get(index) {
            svg.text(
                [x + cell, top + tall + 15.0 * svg.scale],
                &format!("{step}"),
                Rgb::WHITE,
                Anchor::Middle,
            );
        }
    }
    let title = format!("floor error, cm (one sigma, detection \u{b1} {sigma} px)");
    svg.text([left, top - 7.0 * svg.scale], &title, Rgb::WHITE, Anchor::Start);
}
