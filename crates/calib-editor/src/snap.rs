//! Moves annotated lines onto edges of the image.

use std::collections::BTreeSet;

use calib_core::{Lens, Pixel};

use calib_image::{snap_image_curve, snap_polyline};
use calib_site::Site;
use image::RgbImage;

use crate::edit;
use crate::hit::Part;

pub use calib_image::SNAP_RADIUS_PX;

/// Moves every line that contains any of these parts onto the nearest image edge. With a lens, the edge is a
/// curve. Returns the number of lines that were moved.
pub(crate) fn pull_parts(
    site: &mut Site,
    camera: usize,
    parts: &BTreeSet<Part>,
    lens: Option<Lens>,
    image: &RgbImage,
) -> usize {
    let lines =
        edit::lines_of(parts).into_iter().map(|(annotation, segment)| Part::Line { annotation, segment });
    let points = edit::points_of(site, camera, &lines.collect());
    pull_points(site, camera, &points, lens, image)
}

/// Moves only these points onto the image edges along their lines. Returns the number of lines that were
/// moved.
pub(crate) fn pull_points(
    site: &mut Site,
    camera: usize,
    points: &BTreeSet<Part>,
    lens: Option<Lens>,
    image: &RgbImage,
) -> usize {
    let mut pulled = 0;
    for (annotation, segment) in edit::lines_of(points) {
        let whole = [Part::Line { annotation, segment }].into();
        let vertices: Vec<Part> = edit::points_of(site, camera, &whole).into_iter().collect();
        let drawn: Vec<Pixel> =
            vertices.iter().filter_map(|&part| edit::pixel_mut(site, camera, part).copied()).collect();
        let line = match (&drawn[..], lens) {
            (&[a, b], Some(lens)) => snap_image_curve(image, &lens, [a, b]).map(Vec::from),
            _ => snap_polyline(image, &drawn),
        };
        let Some(line) = line else { continue };
        for (&part, to) in vertices.iter().zip(line).filter(|(part, _)| points.contains(part)) {
            if let Some(pixel) = edit::pixel_mut(site, camera, part) {
                *pixel = to;
            }
        }
        pulled += 1;
    }
    pulled
}
