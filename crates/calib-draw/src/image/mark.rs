//! Virtual elements and links on an image: marks of the site, a person for comparison, and links as annotated
//! and as solved.

use calib_core::{Camera, MarkKind, MarkShape, Pixel, WorldPoint};
use calib_site::Mark;

use crate::agreement::{Element, View, elements};
use crate::image::{ImageView, project};
use crate::item::{ElementStatus, Item, Meaning};

/// Returns the marks that are switched on, as outlines with names.
pub(super) fn marks(view: &ImageView) -> Vec<Item<Pixel>> {
    let Some(camera) = view.pose else { return Vec::new() };
    let mut items = Vec::new();
    for (index, mark) in used_marks(view) {
        let (shape, meaning) = (mark.shape(), Meaning::Mark(index));
        items.extend(shape.polylines().iter().flat_map(|line| project(&camera, meaning, line)));
        let named = mark.name.as_ref().or(mark.id.as_ref()).zip(camera.world_to_pixel(shape.at));
        items.extend(named.map(|(name, at)| Item::label(meaning, at, name.clone())));
    }
    items
}

/// Returns the corners of marks that the operator pinned to pixels of this image, with their residuals.
pub(super) fn pins(view: &ImageView) -> Vec<Item<Pixel>> {
    let entry = view.entry().filter(|_| view.site().owns_links(view.camera));
    let (Some(camera), Some(entry)) = (view.pose, entry) else { return Vec::new() };
    let mut items = Vec::new();
    // The pins of marks behind the camera are omitted: they have no reprojection.
    for (index, mark) in used_marks(view).filter(|(_, mark)| camera.world_to_pixel(mark.at_m).is_some()) {
        let shape = mark.shape();
        for pin in mark.seen.iter().filter(|seen| seen.camera == entry.id) {
            items.push(Item::point(Meaning::MarkObservation(index), pin.px));
            let shown = shape.point(&pin.point).and_then(|point| camera.world_to_pixel(point));
            let residual = Meaning::Residual { is_off: false };
            items.extend(shown.map(|shown| Item::polyline(residual, vec![pin.px, shown])));
        }
    }
    items
}

/// Returns the marks that are switched on, each with its index.
fn used_marks<'a>(view: &ImageView<'a>) -> impl Iterator<Item = (usize, &'a Mark)> {
    view.site().marks.iter().enumerate().filter(|(_, mark)| !mark.off)
}

/// Returns the outline of a person whose feet are at the floor point of a pixel, and the pixel of the top of
/// the head. `height` is in metres. `None` if the pixel shows no floor.
#[must_use]
pub fn guide(camera: &Camera, foot: Pixel, height: f64) -> Option<(Vec<Item<Pixel>>, Option<Pixel>)> {
    let at = camera.pixel_to_floor(foot, 0.0)?.at_height(0.0);
    let shape = MarkShape { kind: MarkKind::Person, at, turn: camera.yaw, size: vec![height] };
    let items = shape.polylines().iter().flat_map(|line| project(camera, Meaning::Guide, line)).collect();
    Some((items, camera.world_to_pixel(WorldPoint { z: height, ..at })))
}

/// Returns the links annotated in this image. A link is incomplete if only one view shows it, or if its index
/// is `begun`.
pub(super) fn links(view: &ImageView, begun: Option<usize>) -> Vec<Item<Pixel>> {
    let Some(entry) = view.entry().filter(|_| view.site().owns_links(view.camera)) else { return Vec::new() };
    let mut items = Vec::new();
    for (index, link) in view.site().links.iter().enumerate() {
        let meaning = Meaning::Link { index, is_incomplete: link.seen.len() == 1 || begun == Some(index) };
        let Some(seen) = link.seen.iter().find(|seen| seen.camera == entry.id) else { continue };
        let parts = seen.px.iter().chain(&seen.foot).chain(&seen.head).chain(seen.segment.iter().flatten());
        let points: Vec<Pixel> = parts.copied().collect();
        let first = points.first().copied();
        let dots: Vec<Item<Pixel>> = points.iter().map(|&at| Item::point(meaning, at)).collect();
        items.push(Item::polyline(meaning, view.image_curve(points)));
        items.extend(dots);
        if let (Some(id), Some(at)) = (&link.id, first) {
            items.push(Item::label(meaning, at, id.clone()));
        }
    }
    items
}

/// Returns the solved links and marks as observed and as reprojected in this image.
pub(super) fn sightings(view: &ImageView) -> Vec<Item<Pixel>> {
    let mut items = Vec::new();
    for element in elements(view.site()) {
        for own in element.views.iter().filter(|of| of.index == view.camera) {
            items.extend(observation_items(view, &element, own));
        }
    }
    items
}

/// Returns the observed and the reprojected points of an element in one view, with lines between them.
fn observation_items(image: &ImageView, element: &Element, view: &View) -> Vec<Item<Pixel>> {
    let of =
        ElementStatus { camera: Some(view.index), is_rejected: element.is_rejected, is_off: element.is_off };
    let (seen, solved) = (Meaning::Observed(of), Meaning::Solved(of));
    let shown: Vec<Pixel> = view.sightings.iter().map(|seen| seen.reprojected).collect();
    let first = shown.first().copied();
    let mut items = Vec::new();
    if element.is_long {
        items.push(Item::polyline(solved, image.image_curve(shown)));
    }
    for sighting in &view.sightings {
        items.push(Item::polyline(seen, vec![sighting.annotated, sighting.reprojected]));
        items.push(Item::point(seen, sighting.annotated));
        items.push(Item::point(solved, sighting.reprojected));
    }
    // Only links are labelled here: the layer of marks labels the marks.
    let named = first.filter(|_| element.kind == "link");
    items.extend(named.map(|at| Item::label(solved, at, element.id.clone())));
    items
}
