//! Floor and planes on an image: the grid of the floor, the fields of view, the prism over the camera's own field of
//! view, and the regions of planes.

use calib_core::floor::{PRISM_HEIGHT, prism, vertical};
use calib_core::{Camera, FloorPoint, Pixel, Plane, Polyline, WorldPoint, floor_grid};
use calib_site::Units;

use crate::image::{ImageView, project};
use crate::item::{Item, Meaning};

/// Returns the regions of the planes other than the floor, with their names.
pub(super) fn planes(view: &ImageView) -> Vec<Item<Pixel>> {
    let (Some(camera), site) = (view.pose, view.site()) else { return Vec::new() };
    let mut items = Vec::new();
    for (index, entry) in site.planes.iter().enumerate().filter(|(_, plane)| !plane.region.is_empty()) {
        let (plane, meaning) = (view.scene.plane(Some(&entry.id)), Meaning::Plane(index));
        items.extend(project(&camera, meaning, &outline(&entry.region, &plane, 0.0)));
        let centre = entry.anchor();
        let at = camera.world_to_pixel(centre.at_height(plane.height_at(centre)));
        items.extend(at.map(|at| Item::label(meaning, at, entry.title().to_owned())));
    }
    items
}

/// Returns the closed outline of a floor polygon, raised by `height` metres above a plane.
pub(super) fn outline(polygon: &[FloorPoint], plane: &Plane, height: f64) -> Polyline {
    let raised = plane.raised(height);
    polygon.iter().chain(polygon.first()).map(|&at| at.at_height(raised.height_at(at))).collect()
}

/// Raises each point of a polyline by the height of a plane at this point, in metres.
pub(super) fn onto_plane(line: &[WorldPoint], plane: &Plane) -> Polyline {
    line.iter().map(|&at| WorldPoint { z: at.z + plane.height_at(at.on_floor()), ..at }).collect()
}

/// Returns the grid inside the solved EFOV, on the plane of the EFOV; `step` is the distance between the grid
/// lines, in metres.
pub(super) fn grid(view: &ImageView, step: f64) -> Vec<Item<Pixel>> {
    let Some((camera, solution)) = view.solved() else { return Vec::new() };
    let (mut items, plane) = (Vec::new(), view.efov_plane(view.camera));
    for line in floor_grid(&solution.efov_m, step) {
        let line = onto_plane(&line, &plane);
        items.extend(project(&camera, Meaning::Grid, &line));
        let size = view.entry().map(calib_site::SiteCamera::size);
        if let (Some(scale), Some(size)) = (view.label_scale, size) {
            items.extend(grid_label(&camera, &line, (size, scale), view.site().units));
        }
    }
    items
}

/// Returns the label of a grid line: its x or y, at its visible point closest to the camera. `scale` is the size
/// of letters relative to the screen.
fn grid_label(
    camera: &Camera,
    line: &[WorldPoint],
    ([w, h], scale): ([f64; 2], f64),
    units: Units,
) -> Option<Item<Pixel>> {
    /// Number of intervals in which a grid line is sampled.
    const SAMPLES: usize = 200;
    let (&a, &b) = (line.first()?, line.last()?);
    let margin = 16.0 * scale;
    // The title and the legend of the image are on the left; labels keep clear of them.
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
    let (axis, value) = if along_y { ("x", a.x) } else { ("y", a.y) };
    let text = format!("{axis} {}", units.trimmed_length(value));
    Some(Item::label(Meaning::Grid, at, text))
}

/// Returns the step of a grid over a polygon, in metres: 0.5, 1, 2, 5, 10, … units. The diagonal of the bounding
/// rectangle has fewer than `most` cells.
#[must_use]
pub fn grid_step(polygon: &[FloorPoint], units: Units, most: f64) -> f64 {
    let span = |value: fn(&FloorPoint) -> f64| {
        let values = || polygon.iter().map(value);
        (values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)).max(0.0)
    };
    units.step(span(|p| p.x).hypot(span(|p| p.y)), most).max(0.5 * units.metres())
}

/// Returns the annotated EFOV with its corners.
pub(super) fn annotated_efov(view: &ImageView) -> Vec<Item<Pixel>> {
    let corners = view.entry().and_then(|entry| entry.efov_px.as_ref()).filter(|corners| corners.len() >= 2);
    let Some(corners) = corners else { return Vec::new() };
    let meaning = Meaning::Efov(view.camera);
    let points = corners.iter().map(|&corner| Item::point(meaning, corner));
    // The polygon has straight sides in raw pixels under any lens, because pixels are tested against it.
    std::iter::once(Item::polygon(meaning, corners.clone())).chain(points).collect()
}

/// Returns the prism over an annotated field of view; its vertical edges start at the annotated corners. The
/// result is empty if the field of view is not annotated.
pub(super) fn annotated_prism(view: &ImageView) -> Vec<Item<Pixel>> {
    let annotated = view.entry().and_then(|entry| entry.efov_px.as_ref());
    let (Some((camera, solution)), Some(drawn)) = (view.solved(), annotated) else { return Vec::new() };
    let plane = view.efov_plane(view.camera);
    let corners = drawn.iter().filter_map(|&corner| camera.pixel_to_plane(corner, &plane));
    let edges = corners.map(|at| onto_plane(&vertical(at.on_floor(), PRISM_HEIGHT), &plane));
    let lines = std::iter::once(outline(&solution.efov_m, &plane, PRISM_HEIGHT)).chain(edges);
    lines.flat_map(|line| project(&camera, Meaning::Prism(view.camera), &line)).collect()
}

/// Returns the solved EFOV and the prism over it.
pub(super) fn solved_efov(view: &ImageView) -> Vec<Item<Pixel>> {
    /// Largest number of corners of an EFOV whose prism is drawn with vertical edges. Clipped or curved
    /// outlines have more corners; only the base and the top face of their prism are drawn.
    const MAX_PRISM_CORNERS: usize = 8;
    /// Number of faces of a prism: base and top.
    const PRISM_FACES: usize = 2;
    let Some((camera, solution)) = view.solved() else { return Vec::new() };
    let lines = prism(&solution.efov_m);
    let count = if solution.efov_m.len() > MAX_PRISM_CORNERS { PRISM_FACES } else { lines.len() };
    let meaning = |index| if index == 0 { Meaning::Efov(view.camera) } else { Meaning::Prism(view.camera) };
    let (lines, plane) = (lines.iter().take(count).enumerate(), view.efov_plane(view.camera));
    lines.flat_map(|(index, line)| project(&camera, meaning(index), &onto_plane(line, &plane))).collect()
}

/// Returns the EFOVs of the other placed cameras.
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
            project(&camera, Meaning::OtherEfov(other), &line)
        })
        .collect()
}
