//! Overlay of a camera's image.

use calib_core::{Pixel, ResidualOf};

use calib_core::floor::view_angle;

use calib_draw::{
    Geometry, ImageLayer, ImageView, Item, KindLook, Look, Meaning, PlacedShape, Rgb, Sign, Signs, grid_step,
    on_image, place_sign,
};
use calib_site::{Site, SiteCamera, Units};

use crate::labels::{LabelOffset, Labels, label_position};
use crate::style;
use crate::svg::{Anchor, Stroke, Svg};
use crate::words::straight_down_text;

/// Draws the annotations and all results of a camera over its image. `lens_grid` adds the grid that shows the
/// distortion.
#[must_use]
pub fn overlay(site: &Site, entry: &SiteCamera, lens_grid: bool) -> Svg {
    let size = entry.size();
    let mut svg = Svg::new(size, style::scale(size));
    let index = site.cameras.iter().position(|other| std::ptr::eq(other, entry)).unwrap_or(0);
    let colour = Rgb::camera(index);
    let items =
        on_image(&ImageView::new(site, index).with_labels(svg.scale), &layers(entry, site.units, lens_grid));
    for item in &items {
        draw_item(&mut svg, item);
    }
    let title = entry.name.as_deref().unwrap_or(&entry.id);
    let margin = 10.0 * svg.scale;
    let caption = Tag { at: [margin, margin], text: format!("{title}{}", summary(site, entry)), colour };
    let mut tags = legend(&svg, entry, colour, lens_grid, &items);
    tags.push(caption);
    draw_labels(&mut svg, &items, &tags);
    for Tag { at, text, colour } in &tags {
        svg.tag(*at, text, *colour);
    }
    svg
}

/// Maximum number of grid cells along the diagonal of the polygon that the grid covers; more cells would not be
/// distinguishable.
pub(crate) const MAX_GRID_CELLS: f64 = 24.0;

/// Returns the layers of the overlay in drawing order: the first one is the lowest.
fn layers(entry: &SiteCamera, units: Units, lens_grid: bool) -> Vec<ImageLayer> {
    let efov = entry.solution.as_ref().map_or(&[][..], |solution| &solution.efov_m);
    let others = [
        ImageLayer::Grid(grid_step(efov, units, MAX_GRID_CELLS)),
        ImageLayer::Planes,
        ImageLayer::SolvedEfov,
        ImageLayer::Horizon,
        ImageLayer::Marks,
        ImageLayer::Annotations(Signs::RightAngles),
        ImageLayer::ControlPoints,
        ImageLayer::Observations,
    ];
    lens_grid.then_some(ImageLayer::LensGrid).into_iter().chain(others).collect()
}

/// Converts pixels to coordinate pairs.
fn to_arrays(pixels: &[Pixel]) -> Vec<[f64; 2]> {
    pixels.iter().map(|&pixel| pixel.into()).collect()
}

/// Draws the geometry of an item, except labels.
fn draw_item(svg: &mut Svg, item: &Item<Pixel>) {
    let meaning = item.meaning;
    if matches!(meaning, Meaning::ControlPoint { is_off: true, .. } | Meaning::Residual { is_off: true }) {
        return;
    }
    let stroke = Stroke::of(Look::of(meaning));
    match &item.geometry {
        Geometry::Polyline(points) if matches!(meaning, Meaning::Residual { .. }) => {
            draw_residual(svg, points, stroke);
        }
        Geometry::Polyline(points) => svg.line(&to_arrays(points), false, stroke),
        Geometry::Polygon(points) => svg.line(&to_arrays(points), true, stroke),
        Geometry::Point(at) => draw_point(svg, meaning, (*at).into(), stroke),
        Geometry::Sign(sign, ends) => draw_sign(svg, meaning, sign, ends.map(<[f64; 2]>::from)),
        Geometry::Label(..) | Geometry::Cone { .. } => {}
    }
}

/// Draws a line from the annotated to the reprojected point. Residuals below one pixel are omitted, because
/// they would be invisible.
fn draw_residual(svg: &mut Svg, points: &[Pixel], stroke: Stroke) {
    let [annotated, shown] = points else { return };
    if shown.distance(*annotated) > 1.0 {
        svg.line(&to_arrays(points), false, stroke);
        svg.dot((*shown).into(), 2.5, stroke.colour);
    }
}

/// Draws the symbol of a point: a cross, a ring or a dot, depending on its meaning.
fn draw_point(svg: &mut Svg, meaning: Meaning, at: [f64; 2], stroke: Stroke) {
    match meaning {
        Meaning::ControlPoint { .. } => draw_cross(svg, at, 7.0, stroke),
        Meaning::Observed(_) => svg.ring(at, style::HANDLE + 1.0, stroke),
        Meaning::Solved(_) => draw_cross(svg, at, 4.0, stroke),
        Meaning::Annotation(line) => svg.dot(at, style::HANDLE, line.colour()),
        _ => svg.dot(at, style::HANDLE, stroke.colour),
    }
}

/// Draws a cross; `arm` is half its width in screen pixels.
fn draw_cross(svg: &mut Svg, [u, v]: [f64; 2], arm: f64, stroke: Stroke) {
    let arm = arm * svg.scale;
    svg.line(&[[u - arm, v], [u + arm, v]], false, stroke);
    svg.line(&[[u, v - arm], [u, v + arm]], false, stroke);
}

/// Draws the sign of an annotated line.
fn draw_sign(svg: &mut Svg, meaning: Meaning, sign: Sign, ends: [[f64; 2]; 2]) {
    let Meaning::Annotation(line) = meaning else { return };
    let colour = KindLook::of(line.kind).colour;
    let stroke = Stroke::new(colour, 1.5);
    for part in place_sign(sign, ends, svg.scale) {
        match part {
            PlacedShape::Stroke(points) => svg.line(&points, false, stroke),
            PlacedShape::Fill(points) => svg.fill(&points, colour, 1.0),
            PlacedShape::Ring(at, radius) => svg.ring(at, radius / svg.scale, stroke),
            PlacedShape::Disc(at, radius) => svg.dot(at, radius / svg.scale, colour),
        }
    }
}

/// Text on a dark background.
struct Tag {
    /// Upper left corner, in pixels.
    at: [f64; 2],
    text: String,
    colour: Rgb,
}

/// Draws each label at the first offset from its point where it overlaps no other label. If there is no such offset, a
/// label of the grid is omitted, and another label is drawn at its first offset.
fn draw_labels(svg: &mut Svg, items: &[Item<Pixel>], tags: &[Tag]) {
    let mut labels = Labels::default();
    tags.iter().for_each(|tag| labels.reserve_tag(svg, tag.at, &tag.text));
    let (last, first): (Vec<_>, Vec<_>) = items.iter().partition(|item| item.meaning == Meaning::Grid);
    for Item { meaning, geometry } in first.into_iter().chain(last) {
        let Geometry::Label(at, text) = geometry else { continue };
        let (at, places) = (<[f64; 2]>::from(*at), label_offsets(*meaning));
        let [usual, ..] = &places[..] else { continue };
        if labels.has_duplicate(svg, at, text, usual) {
            continue;
        }
        let covering = (*meaning != Meaning::Grid).then(|| label_position(svg, at, usual));
        if let Some((at, anchor)) = labels.place(svg, at, text, &places).or(covering) {
            let colour = match meaning {
                Meaning::Annotation(line) => line.colour(),
                _ => Look::of(*meaning).colour,
            };
            svg.text(at, text, colour, anchor);
        }
    }
}

/// Returns the possible offsets of a label from its point; the preferred offset is first.
fn label_offsets(meaning: Meaning) -> Vec<LabelOffset> {
    let beside = |down: f64| {
        let [right, left] = [(7.0, Anchor::Start), (-7.0, Anchor::End)];
        let at = |(right, anchor): (f64, Anchor), down: f64| (right, down, anchor);
        vec![at(right, down), at(right, 14.0), at(left, down), at(left, 14.0)]
    };
    let above_or_below = |downs: &[f64]| downs.iter().map(|&down| (0.0, down, Anchor::Middle)).collect();
    match meaning {
        // The label is below the edge of the field of view, and does not touch the line of the edge.
        Meaning::Grid => above_or_below(&[15.0]),
        Meaning::Horizon => above_or_below(&[-7.0, 15.0]),
        Meaning::Mark(_) => above_or_below(&[16.0, 30.0, -7.0]),
        Meaning::Plane(_) => above_or_below(&[0.0, 14.0, -14.0]),
        Meaning::Annotation(_) => beside(-5.0),
        Meaning::ControlPoint { .. } => beside(-3.5),
        _ => beside(-4.2),
    }
}

/// Describes the pose of a camera and its accuracy in one line.
fn summary(site: &Site, entry: &SiteCamera) -> String {
    let Some(solution) = &entry.solution else {
        return entry
            .error
            .as_ref()
            .map_or_else(String::new, |error| format!(" \u{b7} not solved: {}", error.message));
    };
    let (Some(pitch), Some(roll)) = (solution.pitch_deg, solution.roll_deg) else {
        return " \u{b7} only the lens is known".into();
    };
    let hfov = view_angle(&solution.lens(), solution.focal_px, entry.size()).to_degrees();
    let is_down = straight_down_text(solution).is_some();
    let roll = if is_down { String::new() } else { format!(" \u{b7} roll {roll:.1}\u{b0}") };
    let mut text = format!(" \u{b7} pitch {pitch:.1}\u{b0}{roll} \u{b7} field of view {hfov:.0}\u{b0}");
    let is_assumed = !site.scale_is_known(entry);
    let [assumed, floor] =
        if is_assumed { ["assumed ", "ratio of floor lengths"] } else { ["", "floor lengths"] };
    if let Some(position) = solution.position_m {
        text.push_str(&format!(" \u{b7} {assumed}height {}", site.units.length(position.z, 2)));
    }
    if let Some(rel) = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel) {
        text.push_str(&format!(" \u{b7} {floor} \u{b1} {:.1} %", 100.0 * rel));
    }
    text.replace('-', "\u{2212}")
}

/// Returns the legend as tags: the name of every kind of item in use, with its position and colour.
fn legend(svg: &Svg, entry: &SiteCamera, camera: Rgb, lens_grid: bool, items: &[Item<Pixel>]) -> Vec<Tag> {
    let [_, h] = entry.size();
    let step = 22.0 * svg.scale;
    let used: Vec<_> = calib_core::single::KINDS
        .iter()
        .filter(|row| entry.annotations.iter().any(|a| a.kind == row.kind))
        .collect();
    let outliers = entry
        .solution
        .iter()
        .flat_map(|solution| &solution.residuals)
        .any(|residual| residual.outlier && residual.of == ResidualOf::Annotation);
    let mut shared = items.iter().filter_map(|item| match item.meaning {
        Meaning::Observed(of) => Some(of),
        _ => None,
    });
    let outliers = outliers || shared.clone().any(|of| of.is_rejected);
    let field = entry.solution.as_ref().is_some_and(|solution| !solution.efov_m.is_empty());
    let regions = items.iter().any(|item| matches!(item.meaning, Meaning::Plane(_)));
    let rows: Vec<(&str, Rgb)> = used
        .iter()
        .map(|row| (row.title, KindLook::of(row.kind).colour))
        .chain(field.then_some(("Field of view on the floor (dashed) and 2 m above it", camera)))
        .chain(regions.then_some(("Region of a plane (dotted)", Rgb::WHITE)))
        .chain(lens_grid.then_some(("Straight lines in the scene, as distorted by the lens", Rgb::LENS)))
        .chain(
            shared.next().is_some().then_some(("Link or mark: annotated (ring), solved (cross)", Rgb::WHITE)),
        )
        .chain(outliers.then_some(("Rejected", Rgb::BAD)))
        .collect();
    let place = |(index, &(title, colour)): (usize, &(&str, Rgb))| {
        let y = h - 10.0 * svg.scale - step * (rows.len() - index) as f64;
        Tag { at: [10.0 * svg.scale, y], text: title.to_owned(), colour }
    };
    rows.iter().enumerate().map(place).collect()
}
