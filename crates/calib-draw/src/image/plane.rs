//! Where planes besides the floor hold, at their height and slope.

use calib_core::{FloorPoint, Pixel, Plane, Polyline, WorldPoint};

use crate::image::{ImageView, seen};
use crate::item::Item;
use crate::meaning::Meaning;

pub(super) fn planes(view: &ImageView) -> Vec<Item<Pixel>> {
    let (Some(camera), site) = (view.pose, view.site()) else { return Vec::new() };
    let mut items = Vec::new();
    for (index, entry) in site.planes.iter().enumerate().filter(|(_, plane)| !plane.region.is_empty()) {
        let (plane, meaning) = (view.scene.plane(Some(&entry.id)), Meaning::Plane(index));
        items.extend(seen(&camera, meaning, &outline(&entry.region, &plane, 0.0)));
        let centre = entry.anchor();
        let at = camera.world_to_pixel(centre.at_height(plane.height_at(centre)));
        items.extend(at.map(|at| Item::label(meaning, at, entry.title().to_owned())));
    }
    items
}

/// An outline on a plane or so many metres above it, back to its start.
pub(super) fn outline(polygon: &[FloorPoint], plane: &Plane, height: f64) -> Polyline {
    let raised = plane.raised(height);
    polygon.iter().chain(polygon.first()).map(|&at| at.at_height(raised.height_at(at))).collect()
}

/// What lies on the floor, or above it, laid on a plane.
pub(super) fn laid(line: &[WorldPoint], plane: &Plane) -> Polyline {
    line.iter().map(|&at| WorldPoint { z: at.z + plane.height_at(at.on_floor()), ..at }).collect()
}
