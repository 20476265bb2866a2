//! Virtual elements: marks of the site, and a figure to compare with.

use calib_core::{Camera, MarkKind, MarkShape, Pixel, WorldPoint};

use calib_site::Mark;

use crate::image::{ImageView, seen};
use crate::item::Item;
use crate::meaning::Meaning;

pub(super) fn marks(view: &ImageView) -> Vec<Item<Pixel>> {
    let Some(camera) = view.pose else { return Vec::new() };
    let mut items = Vec::new();
    for (index, mark) in used(view) {
        let (shape, meaning) = (mark.shape(), Meaning::Mark(index));
        items.extend(shape.polylines().iter().flat_map(|line| seen(&camera, meaning, line)));
        let named = mark.name.as_ref().or(mark.id.as_ref()).zip(camera.world_to_pixel(shape.at));
        items.extend(named.map(|(name, at)| Item::label(meaning, at, name.clone())));
    }
    items
}

/// Corners of marks that the operator pinned to where this image shows them.
pub(super) fn pins(view: &ImageView) -> Vec<Item<Pixel>> {
    let entry = view.entry().filter(|_| view.site().has_shared(view.camera));
    let (Some(camera), Some(entry)) = (view.pose, entry) else { return Vec::new() };
    let mut items = Vec::new();
    // What stands behind the camera cannot be compared.
    for (index, mark) in used(view).filter(|(_, mark)| camera.world_to_pixel(mark.at_m).is_some()) {
        let shape = mark.shape();
        for pin in mark.seen.iter().filter(|seen| seen.camera == entry.id) {
            items.push(Item::point(Meaning::MarkSeen(index), pin.px));
            let shown = shape.point(&pin.point).and_then(|point| camera.world_to_pixel(point));
            let residual = Meaning::Residual { is_off: false };
            items.extend(shown.map(|shown| Item::polyline(residual, vec![pin.px, shown])));
        }
    }
    items
}

fn used<'a>(view: &ImageView<'a>) -> impl Iterator<Item = (usize, &'a Mark)> {
    view.site().marks.iter().enumerate().filter(|(_, mark)| !mark.off)
}

/// A person of this height in metres who stands where a pixel shows the floor, with the top of the head.
#[must_use]
pub fn guide(camera: &Camera, foot: Pixel, height: f64) -> Option<(Vec<Item<Pixel>>, Option<Pixel>)> {
    let at = camera.pixel_to_floor(foot, 0.0)?.at_height(0.0);
    let shape = MarkShape { kind: MarkKind::Person, at, turn: camera.yaw, size: vec![height] };
    let items = shape.polylines().iter().flat_map(|line| seen(camera, Meaning::Guide, line)).collect();
    Some((items, camera.world_to_pixel(WorldPoint { z: height, ..at })))
}
