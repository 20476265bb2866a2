//! Control points where they were drawn, and where the camera shows them.

use calib_core::Pixel;

use crate::image::ImageView;
use crate::item::Item;
use crate::meaning::Meaning;

pub(super) fn control_points(view: &ImageView) -> Vec<Item<Pixel>> {
    let Some(entry) = view.entry() else { return Vec::new() };
    let plan = view.site().plan.as_ref();
    let mut items = Vec::new();
    for (index, point) in entry.control_points.iter().enumerate() {
        let meaning = Meaning::ControlPoint { camera: view.camera, index, is_off: point.off };
        items.push(Item::point(meaning, point.px));
        let world = point.control_point(plan).map(|control| control.world);
        let shown = view.pose.and_then(|camera| camera.world_to_pixel(world?));
        let residual = Meaning::Residual { is_off: point.off };
        items.extend(shown.map(|shown| Item::polyline(residual, vec![point.px, shown])));
        let name = point.name.as_ref().or(point.id.as_ref());
        items.extend(name.map(|name| Item::label(meaning, point.px, name.clone())));
    }
    items
}
