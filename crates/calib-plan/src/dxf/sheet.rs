//! Pixels of the model space, and its SVG document.

use std::fmt::Write as _;

use kurbo::{Affine, BezPath, Point, Rect};

use super::model::{Model, Stroke};
use super::pairs::Pairs;
use super::tables::{Tables, key, metres_of_unit};
use crate::drawing::{Drawing, DrawingFacts, DrawingKind, Layer, Picture, ScaleSource, View, has_layer};
use crate::error::PlanError;

/// Largest side of the picture, in pixels.
const MAX_SIDE: f64 = 4096.0;
/// Empty border around the drawing, in pixels.
const MARGIN: f64 = 24.0;
/// Width of lines, in pixels.
const LINE_WIDTH: f64 = 4.0;
/// Opacity of filled areas.
const FILL_OPACITY: f64 = 0.6;
/// Round numbers of drawing units per pixel, in a decade.
const ROUND: [f64; 10] = [1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0];
/// Height of capitals divided by the font size.
const CAPITAL_HEIGHT: f64 = 0.7;
/// Smallest height of capitals that is drawn, in pixels.
const MIN_CAPITALS: f64 = 4.0;
/// Largest number of corners in the result.
const MAX_CORNERS: usize = 100_000;

/// Reads a drawing.
pub(crate) fn read(bytes: &[u8], view: &View) -> Result<Drawing, PlanError> {
    let pairs = Pairs::read(bytes)?;
    let records = pairs.records();
    let tables = Tables::new(&records);
    let asked = view.layers.as_deref();
    let mut model = Model::new(&tables, asked);
    let mut layers = listed_layers(&tables, &model);
    let is_unknown = |name: &&String| !has_layer(&layers, name);
    let unknown: Vec<&str> =
        asked.unwrap_or_default().iter().filter(is_unknown).map(String::as_str).collect();
    if asked.is_some_and(|asked| asked.len() == unknown.len()) {
        // In a newer version of the drawing, the layers may have other names.
        model = Model::new(&tables, None);
        layers = listed_layers(&tables, &model);
    }
    let boxes = if model.boxes.is_empty() { &model.hidden_boxes } else { &model.boxes };
    let Some((bounds, distant)) = bounds(boxes).filter(|_| !model.strokes.is_empty()) else {
        let hidden: Vec<&str> = layers
            .iter()
            .filter(|layer| !layer.is_shown && layer.count > 0)
            .map(|layer| layer.name.as_str())
            .collect();
        let advice = if hidden.is_empty() {
            String::new()
        } else {
            format!("; show one of its hidden layers: {}", hidden.join(", "))
        };
        return Err(PlanError::Empty(advice));
    };
    let units_per_px = units_per_px(bounds);
    let size = [bounds.width(), bounds.height()].map(|side| side / units_per_px + 2.0 * MARGIN);
    let size = size.map(|side| side.ceil().max(1.0));
    let to_pixels = Affine::new([
        1.0 / units_per_px,
        0.0,
        0.0,
        -1.0 / units_per_px,
        MARGIN - bounds.x0 / units_per_px,
        MARGIN + bounds.y1 / units_per_px,
    ]);
    let metres = metres_of_unit(tables.unit);
    let origin = to_pixels * Point::ORIGIN;
    collect_lines(&mut layers, &model, to_pixels, size);
    let facts = DrawingFacts {
        units_per_px: Some(units_per_px),
        metres_per_px: metres.map(|metres| metres * units_per_px),
        scale_source: metres.map(|_| ScaleSource::Unit),
        origin_px: Some([origin.x, origin.y]),
        layers,
        corners_px: corners(&model, to_pixels, size),
        notes: notes(&model, &pairs, distant, &unknown),
        ..DrawingFacts::new(DrawingKind::Dxf, size.map(|side| side as u32))
    };
    let picture = Picture::Svg(document(&model, to_pixels, size));
    Ok(Drawing { picture, facts })
}

/// Stores the straight lines of the shown layers that are in a picture of this width and height in pixels.
fn collect_lines(layers: &mut [Layer], model: &Model<'_>, to_pixels: Affine, [width, height]: [f64; 2]) {
    let picture = Rect::new(0.0, 0.0, width, height);
    for layer in layers {
        let key = key(&layer.name);
        let lines = model.lines.get(&key).into_iter().flatten();
        layer.lines_px = lines
            .map(|line| [line.p0, line.p1].map(|end| to_pixels * end))
            .filter(|ends| ends.iter().all(|end| picture.contains(*end)))
            .map(|ends| ends.map(|end| [end.x as f32, end.y as f32]))
            .collect();
        layer.other_lines = model.other_lines.get(&key).copied().unwrap_or(0);
    }
}

/// Returns the layers in the tables, and the layers that occur only in records.
fn listed_layers(tables: &Tables<'_>, model: &Model<'_>) -> Vec<Layer> {
    let mut keys: Vec<&String> = tables.layers.keys().chain(model.counts.keys()).collect();
    keys.sort_unstable();
    keys.dedup();
    let layer = |key: &String| Layer {
        name: tables.layer_names.get(key).unwrap_or(key).clone(),
        is_shown: model.is_shown(key),
        count: model.counts.get(key).copied().unwrap_or(0),
        lines_px: Vec::new(),
        other_lines: 0,
    };
    keys.into_iter().map(layer).collect()
}

/// Returns the bounds of the lines of the plan, and the number of distant lines, which are not in the bounds.
///
/// Many drawings contain a forgotten line kilometres away, which would reduce the plan to a dot. A line is
/// distant if its distance from the bounds of the middle 98 % is more than ten times their size.
fn bounds(boxes: &[Rect]) -> Option<(Rect, usize)> {
    const MIDDLE: f64 = 0.98;
    const DISTANT: f64 = 10.0;
    /// Largest number of distant lines that are left out; in large drawings, one in 500 lines.
    const MAX_DISTANT: usize = 20;
    let quantile = |mut values: Vec<f64>, share: f64| {
        values.sort_unstable_by(f64::total_cmp);
        values.get(((values.len() - 1) as f64 * share).round() as usize).copied()
    };
    let low = 0.5 * (1.0 - MIDDLE);
    if boxes.is_empty() {
        return None;
    }
    let x = |share| quantile(boxes.iter().map(|one| one.center().x).collect(), share);
    let y = |share| quantile(boxes.iter().map(|one| one.center().y).collect(), share);
    let middle = Rect::new(x(low)?, y(low)?, x(1.0 - low)?, y(1.0 - low)?);
    let typical = quantile(boxes.iter().map(|one| one.width().max(one.height())).collect(), 0.5)?;
    let reach = DISTANT * middle.width().max(middle.height()).max(typical);
    let near = middle.inflate(reach, reach);
    let is_near = |one: &&Rect| near.contains(one.origin()) && near.contains(Point::new(one.x1, one.y1));
    let distant = boxes.len() - boxes.iter().filter(is_near).count();
    // If many lines are distant, they are the plan, and the near lines are a detail.
    let is_forgotten = distant <= MAX_DISTANT.max(boxes.len() / 500);
    let distant = if is_forgotten { distant } else { 0 };
    let kept = boxes.iter().filter(|one| distant == 0 || is_near(one)).copied();
    let kept = kept.reduce(|a, b| a.union(b))?;
    let side = kept.width().max(kept.height());
    (side > 0.0 && side.is_finite()).then_some((kept, distant))
}

/// Returns a round number of drawing units per pixel, so that the picture is at most [`MAX_SIDE`] wide and high.
fn units_per_px(bounds: Rect) -> f64 {
    let least = bounds.width().max(bounds.height()) / (MAX_SIDE - 2.0 * MARGIN - 1.0);
    let decade = 10_f64.powf(least.log10().floor());
    ROUND.into_iter().map(|step| step * decade).find(|&step| step >= least).unwrap_or(10.0 * decade)
}

/// Returns the SVG document of the strokes and texts, on white.
fn document(model: &Model<'_>, to_pixels: Affine, [width, height]: [f64; 2]) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
    );
    // Neighbouring strokes of one colour are one path, which is much faster to draw.
    let mut strokes = model.strokes.as_slice();
    while let Some(first) = strokes.first() {
        let is_same = |stroke: &&Stroke| (stroke.colour, stroke.is_filled) == (first.colour, first.is_filled);
        // Filled areas that overlap would cancel each other in one path.
        let count = if first.is_filled { 1 } else { strokes.iter().take_while(is_same).count() };
        let [r, g, b] = first.colour;
        let colour = format!("#{r:02x}{g:02x}{b:02x}");
        let paint = if first.is_filled {
            format!("fill=\"{colour}\" fill-opacity=\"{FILL_OPACITY}\" fill-rule=\"evenodd\"")
        } else {
            format!(
                "fill=\"none\" stroke=\"{colour}\" stroke-width=\"{LINE_WIDTH}\" stroke-linejoin=\"round\""
            )
        };
        let _ = write!(svg, "<path {paint} d=\"");
        for stroke in &strokes[..count] {
            add_path(&mut svg, &(to_pixels * &stroke.path));
        }
        svg.push_str("\"/>");
        strokes = &strokes[count..];
    }
    for label in &model.labels {
        // The document's y axis points down.
        let placed = to_pixels * label.placed * Affine::FLIP_Y;
        let [a, b, c, d, e, f] = placed.as_coeffs();
        if c.hypot(d) < MIN_CAPITALS || a.hypot(b) > MAX_SIDE {
            continue;
        }
        let anchor = ["start", "middle", "end"][usize::from(label.anchor.min(2))];
        let [r, g, blue] = label.colour;
        let _ = write!(
            svg,
            "<text transform=\"matrix({a} {b} {c} {d} {e} {f})\" font-size=\"{:.4}\" text-anchor=\"{anchor}\" \
             fill=\"#{r:02x}{g:02x}{blue:02x}\">{}</text>",
            1.0 / CAPITAL_HEIGHT,
            escaped(&label.text)
        );
    }
    svg.push_str("</svg>");
    svg
}

/// Adds the SVG commands of a path, with coordinates rounded to hundredths of a pixel.
fn add_path(svg: &mut String, path: &BezPath) {
    use kurbo::PathEl::{ClosePath, CurveTo, LineTo, MoveTo, QuadTo};
    for element in path.elements() {
        let _ = match element {
            MoveTo(p) => write!(svg, "M{:.2} {:.2}", p.x, p.y),
            LineTo(p) => write!(svg, "L{:.2} {:.2}", p.x, p.y),
            QuadTo(p, q) => write!(svg, "Q{:.2} {:.2} {:.2} {:.2}", p.x, p.y, q.x, q.y),
            CurveTo(p, q, r) => {
                write!(svg, "C{:.2} {:.2} {:.2} {:.2} {:.2} {:.2}", p.x, p.y, q.x, q.y, r.x, r.y)
            }
            ClosePath => write!(svg, "Z"),
        };
    }
}

/// Escapes the characters that XML reserves, and replaces or removes the characters that it forbids.
fn escaped(text: &str) -> String {
    let mut result = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '<' => result.push_str("&lt;"),
            '>' => result.push_str("&gt;"),
            '&' => result.push_str("&amp;"),
            '\u{fffe}' | '\u{ffff}' => {}
            other if other.is_control() => result.push(' '),
            other => result.push(other),
        }
    }
    result
}

/// Returns the corners in the picture without duplicates, in pixels: at most [`MAX_CORNERS`], evenly selected.
fn corners(model: &Model<'_>, to_pixels: Affine, [width, height]: [f64; 2]) -> Vec<[f32; 2]> {
    let picture = Rect::new(0.0, 0.0, width, height);
    let pixels = model.corners.iter().map(|&corner| to_pixels * corner);
    let mut corners: Vec<[f32; 2]> = pixels
        .filter(|&pixel| picture.contains(pixel))
        .map(|pixel| [pixel.x as f32, pixel.y as f32])
        .collect();
    corners.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    corners.dedup();
    let step = corners.len().div_ceil(MAX_CORNERS).max(1);
    corners.into_iter().step_by(step).collect()
}

fn notes(model: &Model<'_>, pairs: &Pairs<'_>, distant: usize, unknown: &[&str]) -> Vec<String> {
    let mut notes = Vec::new();
    if !unknown.is_empty() {
        notes.push(format!("Layers missing from the drawing: {}.", unknown.join(", ")));
    }
    if distant > 0 {
        notes.push(format!("Lines not shown because they are far from the plan: {distant}."));
    }
    if model.is_cut {
        notes.push("The drawing is incomplete: it exceeds the limit for lines or nested blocks.".into());
    }
    if pairs.damaged_lines > 0 {
        notes.push(format!("Damaged lines skipped in the file: {}.", pairs.damaged_lines));
    }
    if !model.ignored.is_empty() {
        let kinds: Vec<String> =
            model.ignored.iter().take(8).map(|(kind, count)| format!("{count} {kind}")).collect();
        notes.push(format!("Not drawn: {}.", kinds.join(", ")));
    }
    notes
}
