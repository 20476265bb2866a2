//! The horizon, as the lens bends it.

use calib_core::{Camera, Pixel};

use crate::image::ImageView;
use crate::item::{Geometry, Item};
use crate::meaning::Meaning;

pub(super) fn of_view(view: &ImageView) -> Vec<Item<Pixel>> {
    let (Some(camera), Some(entry)) = (view.pose, view.entry()) else { return Vec::new() };
    let mut items = horizon(&camera, entry.size());
    if let Some(scale) = view.letters {
        items.extend(word(&items, entry.size(), scale));
    }
    items
}

/// The horizon of a camera on an image of this size.
#[must_use]
pub fn horizon(camera: &Camera, size: [f64; 2]) -> Vec<Item<Pixel>> {
    let pieces = calib_core::horizon(camera, size).into_iter();
    pieces.map(|piece| Item::polyline(Meaning::Horizon, piece)).collect()
}

/// The word stands where the horizon leaves the image on the right.
fn word(items: &[Item<Pixel>], [w, h]: [f64; 2], scale: f64) -> Option<Item<Pixel>> {
    let is_shown = |p: &&Pixel| p.u > 0.1 * w && p.u < 0.9 * w && p.v > 48.0 * scale && p.v < h;
    let points = items.iter().flat_map(|item| match &item.geometry {
        Geometry::Polyline(points) => points.as_slice(),
        _ => &[],
    });
    let at = points.filter(is_shown).max_by(|a, b| a.u.total_cmp(&b.u))?;
    Some(Item::label(Meaning::Horizon, *at, "horizon".into()))
}
