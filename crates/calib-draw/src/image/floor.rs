//! On the floor, or on the plane of a field of view: the metre grid, the fields, the prism over the camera's own.
//!
//! Where planes besides the floor hold, at their height and slope.

use calib_core::floor::{PRISM_HEIGHT, prism, vertical};
use calib_core::{Camera, FloorPoint, Pixel, Plane, Polyline, WorldPoint, floor_grid};

use crate::image::{ImageView, seen};
use crate::item::{Item, Meaning};

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

pub(super) fn grid(view: &ImageView, step: f64) -> Vec<Item<Pixel>> {
    let Some((camera, solution)) = view.solved() else { return Vec::new() };
    let (mut items, plane) = (Vec::new(), view.efov_plane(view.camera));
    for line in floor_grid(&solution.efov_m, step) {
        let line = laid(&line, &plane);
        items.extend(seen(&camera, Meaning::Grid, &line));
        let size = view.entry().map(calib_site::SiteCamera::size);
        if let (Some(scale), Some(size)) = (view.letters, size) {
            items.extend(number(&camera, &line, size, scale));
        }
    }
    items
}

/// The metres of a grid line where it comes into the image, on the side of the camera.
fn number(camera: &Camera, line: &[WorldPoint], [w, h]: [f64; 2], scale: f64) -> Option<Item<Pixel>> {
    const SAMPLES: usize = 200;
    let (&a, &b) = (line.first()?, line.last()?);
    let margin = 16.0 * scale;
    // Title and legend stand on the left: numbers stay clear of them.
    let inside = |p: &Pixel| p.u > 7.0 * margin && p.v > 3.0 * margin && p.u < w - margin && p.v < h - margin;
    let points = (0..=SAMPLES).map(|i| {
        let t = i as f64 / SAMPLES as f64;
        WorldPoint::new(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z))
    });
    let shown = points.filter_map(|point| {
        Some((point.distance(camera.position), camera.world_to_pixel(point).filter(inside)?))
    });
    let (_, at) = shown.min_by(|one, other| one.0.total_cmp(&other.0))?;
    let along_y = (a.x - b.x).abs() < 1e-9;
    let text = if along_y { format!("x {}", metres(a.x)) } else { format!("y {}", metres(a.y)) };
    Some(Item::label(Meaning::Grid, at, text))
}

/// Metres with a real minus and no more digits than there are.
#[must_use]
pub fn metres(value: f64) -> String {
    let rounded = (value * 1000.0).round() / 1000.0;
    format!("{}", rounded + 0.0).replace('-', "\u{2212}")
}

/// The diagonal of the rectangle about a polygon, in metres: by it the step of a grid is chosen.
#[must_use]
pub fn reach(polygon: &[FloorPoint]) -> f64 {
    let span = |value: fn(&FloorPoint) -> f64| {
        let values = || polygon.iter().map(value);
        (values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)).max(0.0)
    };
    span(|p| p.x).hypot(span(|p| p.y))
}

pub(super) fn drawn_efov(view: &ImageView) -> Vec<Item<Pixel>> {
    let corners = view.entry().and_then(|entry| entry.efov_px.as_ref()).filter(|corners| corners.len() >= 2);
    let Some(corners) = corners else { return Vec::new() };
    let meaning = Meaning::Efov(view.camera);
    let points = corners.iter().map(|&corner| Item::point(meaning, corner));
    // It is a polygon of pixels, whatever the lens: what is asked of a pixel is whether it lies inside.
    std::iter::once(Item::polygon(meaning, corners.clone())).chain(points).collect()
}

/// Its edges stand on the corners that were drawn; a field that nobody drew has no prism worth looking at.
pub(super) fn drawn_prism(view: &ImageView) -> Vec<Item<Pixel>> {
    let drawn = view.entry().and_then(|entry| entry.efov_px.as_ref());
    let (Some((camera, solution)), Some(drawn)) = (view.solved(), drawn) else { return Vec::new() };
    let plane = view.efov_plane(view.camera);
    let corners = drawn.iter().filter_map(|&corner| camera.pixel_to_plane(corner, &plane));
    let edges = corners.map(|at| laid(&vertical(at.on_floor(), PRISM_HEIGHT), &plane));
    let lines = std::iter::once(outline(&solution.efov_m, &plane, PRISM_HEIGHT)).chain(edges);
    lines.flat_map(|line| seen(&camera, Meaning::Prism(view.camera), &line)).collect()
}

pub(super) fn solved_efov(view: &ImageView) -> Vec<Item<Pixel>> {
    /// A clipped or bent outline has more corners than this; its prism shows its faces and no more.
    const CORNERS: usize = 8;
    const FACES: usize = 2;
    let Some((camera, solution)) = view.solved() else { return Vec::new() };
    let lines = prism(&solution.efov_m);
    let count = if solution.efov_m.len() > CORNERS { FACES } else { lines.len() };
    let meaning = |index| if index == 0 { Meaning::Efov(view.camera) } else { Meaning::Prism(view.camera) };
    let (lines, plane) = (lines.iter().take(count).enumerate(), view.efov_plane(view.camera));
    lines.flat_map(|(index, line)| seen(&camera, meaning(index), &laid(line, &plane))).collect()
}

pub(super) fn other_efovs(view: &ImageView) -> Vec<Item<Pixel>> {
    let Some(camera) = view.pose.filter(|_| view.scene.placed(view.camera).is_some()) else {
        return Vec::new();
    };
    let others = (0..view.site().cameras.len()).filter(|&other| other != view.camera);
    let fields = others.filter_map(|other| Some((other, view.scene.placed(other)?)));
    let fields = fields.filter(|(_, solution)| solution.efov_m.len() >= 3);
    fields
        .flat_map(|(other, solution)| {
            let line = outline(&solution.efov_m, &view.efov_plane(other), 0.0);
            seen(&camera, Meaning::OtherEfov(other), &line)
        })
        .collect()
}
