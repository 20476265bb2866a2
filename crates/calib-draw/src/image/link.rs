//! Links and marks that several cameras show: as they are drawn, and as they were solved.

use calib_core::Pixel;

use crate::agreement::{Element, View, elements};
use crate::image::ImageView;
use crate::item::Item;
use crate::meaning::{Meaning, Sighted};

/// A link that only one view shows waits for another, and so does the one that was begun.
pub(super) fn links(view: &ImageView, begun: Option<usize>) -> Vec<Item<Pixel>> {
    let Some(entry) = view.entry().filter(|_| view.site().has_shared(view.camera)) else { return Vec::new() };
    let mut items = Vec::new();
    for (index, link) in view.site().links.iter().enumerate() {
        let meaning = Meaning::Link { index, waits: link.seen.len() == 1 || begun == Some(index) };
        let Some(seen) = link.seen.iter().find(|seen| seen.camera == entry.id) else { continue };
        let parts = seen.px.iter().chain(&seen.foot).chain(&seen.head).chain(seen.segment.iter().flatten());
        let points: Vec<Pixel> = parts.copied().collect();
        let first = points.first().copied();
        let dots: Vec<Item<Pixel>> = points.iter().map(|&at| Item::point(meaning, at)).collect();
        items.push(Item::polyline(meaning, view.drawn(points)));
        items.extend(dots);
        if let (Some(id), Some(at)) = (&link.id, first) {
            items.push(Item::label(meaning, at, id.clone()));
        }
    }
    items
}

pub(super) fn sightings(view: &ImageView) -> Vec<Item<Pixel>> {
    let mut items = Vec::new();
    for element in elements(view.site()) {
        for own in element.views.iter().filter(|of| of.index == view.camera) {
            items.extend(sighting(view, &element, own));
        }
    }
    items
}

fn sighting(image: &ImageView, element: &Element, view: &View) -> Vec<Item<Pixel>> {
    let of = Sighted { camera: Some(view.index), is_aside: element.is_aside, is_off: element.is_off };
    let (seen, solved) = (Meaning::Seen(of), Meaning::Solved(of));
    let shown: Vec<Pixel> = view.sightings.iter().map(|seen| seen.shown).collect();
    let first = shown.first().copied();
    let mut items = Vec::new();
    if element.is_long {
        items.push(Item::polyline(solved, image.drawn(shown)));
    }
    for sighting in &view.sightings {
        items.push(Item::polyline(seen, vec![sighting.drawn, sighting.shown]));
        items.push(Item::point(seen, sighting.drawn));
        items.push(Item::point(solved, sighting.shown));
    }
    // A mark's own drawing has its name.
    let named = first.filter(|_| element.what == "link");
    items.extend(named.map(|at| Item::label(solved, at, element.id.clone())));
    items
}
