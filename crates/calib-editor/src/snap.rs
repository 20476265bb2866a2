//! Moves annotated lines onto edges of the image.

use std::collections::BTreeSet;

use calib_core::{Lens, Pixel};

use calib_image::{snap_image_curve, snap_polyline};
use calib_site::Site;
use image::RgbImage;

use crate::edit;
use crate::hit::Part;

pub use calib_image::SNAP_RADIUS_PX;

/// Moves every line that contains any of these parts onto the nearest image edge. With a lens, the edge of a line of
/// two points is a curve, the image of a straight edge. Returns the number of lines that were moved.
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

/// Length of the part of a line, next to the end that is moved, that is compared with the image, in raw pixels.
const END_LENGTH_PX: f64 = 60.0;

/// Moves the end `at` of a line from `other` onto the image edge that runs along the line there, and returns the new
/// end. Only the part of the line next to `at` is compared with the image. `None` if no edge is found.
#[must_use]
pub(crate) fn snap_end(image: &RgbImage, lens: &Lens, other: Pixel, at: Pixel) -> Option<Pixel> {
    let length = other.distance(at);
    let share = (END_LENGTH_PX / length).min(1.0);
    let inner = Pixel::new(at.u + share * (other.u - at.u), at.v + share * (other.v - at.v));
    snap_image_curve(image, lens, [inner, at]).map(|[_, end]| end)
}

/// Moves one point of a line onto the image edge under it. Other points of the line stay.
pub(crate) fn pull_point(site: &mut Site, camera: usize, part: Part, lens: &Lens, image: &RgbImage) {
    let Part::Vertex { annotation, segment, vertex } = part else { return };
    let neighbour = vertex.checked_sub(1).unwrap_or(1);
    let [other, at] = [neighbour, vertex].map(|vertex| {
        edit::pixel_mut(site, camera, Part::Vertex { annotation, segment, vertex }).map(|pixel| *pixel)
    });
    let moved = other.zip(at).and_then(|(other, at)| snap_end(image, lens, other, at));
    if let (Some(to), Some(pixel)) = (moved, edit::pixel_mut(site, camera, part)) {
        *pixel = to;
    }
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
