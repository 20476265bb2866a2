//! Visible paths and texts of the model space, with nested blocks.

use std::collections::{BTreeMap, BTreeSet};

use kurbo::{Affine, BezPath, Point, Rect, Shape as _, Vec2};

use super::curves::{
    Vertex, arc, ellipse, face, from_above, hatch, line, point, polygon, spline, through, vertices,
};
use super::pairs::Record;
use super::tables::{BASE_LAYER, LayerEntry, Tables, decoded, indexed_colour, key, true_colour};

/// Largest depth of nested blocks.
const MAX_DEPTH: usize = 16;
/// Largest number of visited pairs and copies of blocks. A block that contains others many times would otherwise
/// never end.
const MAX_WORK: usize = 20_000_000;
/// Largest number of points of all paths.
const MAX_POINTS: usize = 4_000_000;
/// Largest number of texts.
const MAX_TEXTS: usize = 20_000;
/// Largest length of a text, in characters.
const MAX_TEXT_LENGTH: usize = 200;
/// Largest number of columns or rows of an array of blocks.
const MAX_ARRAY: i64 = 1000;

/// Layer and colour of a record. A line of a block on layer 0 is on the layer of the insertion of the block. A
/// line with the colour 0 has the colour of the insertion.
#[derive(Clone, Copy)]
struct Style<'a> {
    layer: &'a str,
    colour: [u8; 3],
}

/// Line or area.
#[derive(Clone, Debug)]
pub(super) struct Stroke {
    pub(super) path: BezPath,
    pub(super) colour: [u8; 3],
    pub(super) is_filled: bool,
}

/// Text of one line.
#[derive(Clone, Debug)]
pub(super) struct Label {
    pub(super) text: String,
    /// Transform from the coordinates of the text to the drawing. The baseline is on the x axis, and capitals have
    /// a height of 1.
    pub(super) placed: Affine,
    /// Horizontal position of the point (0, 0) in the text: 0 left, 1 centre, 2 right.
    pub(super) anchor: u8,
    pub(super) colour: [u8; 3],
}

/// Largest number of straight lines that are collected.
const MAX_LINES: usize = 100_000;

/// Visible contents of the model space.
pub(super) struct Model<'a> {
    tables: &'a Tables<'a>,
    /// Shown layers, in upper case; `None`: the layers that are on.
    shown: Option<BTreeSet<String>>,
    pub(super) strokes: Vec<Stroke>,
    pub(super) labels: Vec<Label>,
    /// Ends and corners of lines and polylines.
    pub(super) corners: Vec<Point>,
    /// Straight lines by layer, in upper case, with the straight parts of polylines.
    pub(super) lines: BTreeMap<String, Vec<kurbo::Line>>,
    /// Number of curves, and of lines beyond the limit, by layer.
    pub(super) other_lines: BTreeMap<String, usize>,
    /// Number of all lines of `lines`.
    line_count: usize,
    /// Bounds of the lines on layers that are on in the drawing. They do not depend on the layers selected for the
    /// view, so that pixel positions do not change with the selection.
    pub(super) boxes: Vec<Rect>,
    /// Bounds of the lines on layers that are off in the drawing.
    pub(super) hidden_boxes: Vec<Rect>,
    /// Number of lines and texts by layer, in upper case.
    pub(super) counts: BTreeMap<String, usize>,
    /// Types of records that are not drawn, and their number.
    pub(super) ignored: BTreeMap<String, usize>,
    /// Whether a limit was reached, so that a part of the drawing is missing.
    pub(super) is_cut: bool,
    /// Number of visited pairs and copies of blocks.
    work: usize,
    points: usize,
}

impl<'a> Model<'a> {
    /// Collects the contents of the shown layers.
    pub(super) fn new(tables: &'a Tables<'a>, shown: Option<&[String]>) -> Self {
        let shown = shown.map(|names| names.iter().map(|name| key(name)).collect());
        let mut model = Self {
            tables,
            shown,
            strokes: Vec::new(),
            labels: Vec::new(),
            corners: Vec::new(),
            lines: BTreeMap::new(),
            other_lines: BTreeMap::new(),
            line_count: 0,
            boxes: Vec::new(),
            hidden_boxes: Vec::new(),
            counts: BTreeMap::new(),
            ignored: BTreeMap::new(),
            is_cut: false,
            work: 0,
            points: 0,
        };
        let style = Style { layer: BASE_LAYER, colour: indexed_colour(7) };
        model.add_records(tables.entities, Affine::IDENTITY, style, 0);
        model
    }

    /// Whether a layer is shown.
    pub(super) fn is_shown(&self, key: &str) -> bool {
        match &self.shown {
            Some(names) => names.contains(key),
            None => self.tables.layer(key).is_on,
        }
    }

    fn add_records(&mut self, records: &[Record<'_>], at: Affine, outer: Style<'_>, depth: usize) {
        let mut index = 0;
        while let Some(record) = records.get(index) {
            index += 1;
            if !self.has_capacity(1 + record.pairs.len()) {
                return;
            }
            // The vertices of a polyline are separate records, up to SEQEND.
            let parts = match record.kind {
                "POLYLINE" => records[index..].iter().take_while(|part| part.kind == "VERTEX").count(),
                _ => 0,
            };
            let parts = &records[index..index + parts];
            index += parts.len();
            // Code 67: paper space. Code 60: invisible.
            if record.integer(67) == Some(1) || record.integer(60) == Some(1) {
                continue;
            }
            let layer = record.text(8).map_or_else(|| BASE_LAYER.to_owned(), key);
            let layer = if layer == BASE_LAYER { outer.layer.to_owned() } else { layer };
            let style = Style { layer: &layer, colour: self.colour(record, &layer, outer) };
            match record.kind {
                "INSERT" => self.add_insertion(record, at, style, depth),
                "DIMENSION" => self.add_block(record, at, style, depth),
                _ => self.add_record(record, parts, at, style),
            }
        }
    }

    /// Counts work; returns whether the drawing is within its limits.
    fn has_capacity(&mut self, work: usize) -> bool {
        self.work += work;
        let has_capacity = self.work <= MAX_WORK && self.points <= MAX_POINTS;
        self.is_cut |= !has_capacity;
        has_capacity
    }

    fn colour(&self, record: &Record<'_>, layer: &str, outer: Style<'_>) -> [u8; 3] {
        if let Some(value) = record.integer(420) {
            return true_colour(value);
        }
        match record.integer(62) {
            // Colour 0: the colour of the insertion of the block.
            Some(0) => outer.colour,
            None | Some(256) => {
                let LayerEntry { colour, .. } = self.tables.layer(layer);
                colour
            }
            Some(index) => indexed_colour(index.abs()),
        }
    }

    /// Adds the copies of a block at an insertion.
    fn add_insertion(&mut self, record: &Record<'_>, at: Affine, style: Style<'_>, depth: usize) {
        let is_hidden = self.tables.layer(style.layer).is_frozen;
        let Some(place) = point(record, [10, 20]).filter(|_| !is_hidden) else { return };
        let scale = |code| record.number(code).unwrap_or(1.0);
        let turned = at
            * from_above(record)
            * Affine::translate(place.to_vec2())
            * Affine::rotate(record.number(50).unwrap_or(0.0).to_radians());
        let count = |code| record.integer(code).unwrap_or(1).clamp(1, MAX_ARRAY);
        let spacing = |code| record.number(code).unwrap_or(0.0);
        for row in 0..count(71) {
            for column in 0..count(70) {
                let offset = Vec2::new(column as f64 * spacing(44), row as f64 * spacing(45));
                let placed =
                    turned * Affine::translate(offset) * Affine::scale_non_uniform(scale(41), scale(42));
                if !self.has_capacity(1 + record.pairs.len()) {
                    return;
                }
                self.add_block(record, placed, style, depth);
            }
        }
    }

    /// Adds the contents of the block that a record names.
    fn add_block(&mut self, record: &Record<'_>, at: Affine, style: Style<'_>, depth: usize) {
        let Some(block) = record.text(2).and_then(|name| self.tables.blocks.get(&key(name)).copied()) else {
            return;
        };
        if depth >= MAX_DEPTH {
            self.is_cut = true;
            return;
        }
        self.add_records(block.records, at * Affine::translate(-block.base.to_vec2()), style, depth + 1);
    }

    fn add_record(&mut self, record: &Record<'_>, parts: &[Record<'_>], at: Affine, style: Style<'_>) {
        let flat = at * from_above(record);
        let is_closed = record.integer(70).unwrap_or(0) & 1 != 0;
        match record.kind {
            "LINE" => self.add(line(record), at, style, true),
            "LWPOLYLINE" => self.add(through(&vertices(record), is_closed), flat, style, true),
            "POLYLINE" => self.add_polyline(record, parts, flat, style),
            "ARC" | "CIRCLE" => self.add(arc(record), flat, style, false),
            "ELLIPSE" => self.add(ellipse(record), at, style, false),
            "SPLINE" => self.add(spline(record), at, style, false),
            "3DFACE" => self.add(face(record, false), at, style, true),
            "SOLID" | "TRACE" => self.fill(face(record, true), flat, style),
            "LEADER" => {
                let points: Vec<Point> =
                    record.numbers(10).into_iter().zip(record.numbers(20)).map(Point::from).collect();
                self.add(polygon(&points, false), at, style, false);
            }
            // Code 70: solid fill.
            "HATCH" if is_closed => self.fill(hatch(record), flat, style),
            "HATCH" => self.add(hatch(record), flat, style, false),
            "TEXT" => self.add_text(record, flat, style),
            "ATTRIB" if !is_closed => self.add_text(record, flat, style),
            "MTEXT" => self.add_paragraphs(record, at, style),
            "ATTRIB" | "ATTDEF" | "SEQEND" | "VERTEX" | "POINT" | "VIEWPORT" | "XLINE" | "RAY" => {}
            other => *self.ignored.entry(other.chars().take(32).collect()).or_default() += 1,
        }
    }

    fn add_polyline(&mut self, record: &Record<'_>, parts: &[Record<'_>], at: Affine, style: Style<'_>) {
        let flags = record.integer(70).unwrap_or(0);
        // Flags 16 and 64: meshes, whose vertices are not in the order of a line.
        if flags & (16 | 64) != 0 {
            *self.ignored.entry("MESH".into()).or_default() += 1;
            return;
        }
        let vertices: Vec<Vertex> = parts
            .iter()
            // Flag 16 of a vertex: control point of a spline.
            .filter(|part| part.integer(70).unwrap_or(0) & 16 == 0)
            .filter_map(|part| {
                Some(Vertex { at: point(part, [10, 20])?, bulge: part.number(42).unwrap_or(0.0) })
            })
            .collect();
        self.add(through(&vertices, flags & 1 != 0), at, style, true);
    }

    /// Adds a path, and its corners if they are ends of straight lines.
    fn add(&mut self, path: Option<BezPath>, at: Affine, style: Style<'_>, has_corners: bool) {
        if let Some(path) = self.visible(path, at, style) {
            if has_corners {
                self.corners.extend(path.elements().iter().filter_map(kurbo::PathEl::end_point));
            }
            let layer = || style.layer.to_owned();
            for part in path.segments() {
                match part {
                    kurbo::PathSeg::Line(line) if has_corners && self.line_count < MAX_LINES => {
                        self.lines.entry(layer()).or_default().push(line);
                        self.line_count += 1;
                    }
                    _ => *self.other_lines.entry(layer()).or_default() += 1,
                }
            }
            self.strokes.push(Stroke { path, colour: style.colour, is_filled: false });
        }
    }

    fn fill(&mut self, path: Option<BezPath>, at: Affine, style: Style<'_>) {
        if let Some(path) = self.visible(path, at, style) {
            self.strokes.push(Stroke { path, colour: style.colour, is_filled: true });
        }
    }

    /// Counts a path, and returns it in the coordinates of the drawing if its layer is shown.
    fn visible(&mut self, path: Option<BezPath>, at: Affine, style: Style<'_>) -> Option<BezPath> {
        let path = at * path?;
        *self.counts.entry(style.layer.to_owned()).or_default() += 1;
        if !path.elements().iter().all(kurbo::PathEl::is_finite) {
            return None;
        }
        self.points += path.elements().len();
        let is_on = self.tables.layer(style.layer).is_on;
        let boxes = if is_on { &mut self.boxes } else { &mut self.hidden_boxes };
        boxes.push(path.bounding_box());
        self.is_shown(style.layer).then_some(path)
    }

    fn add_text(&mut self, record: &Record<'_>, at: Affine, style: Style<'_>) {
        // With an alignment, the second point counts, except for texts fitted between two points.
        let vertical = if record.kind == "ATTRIB" { 74 } else { 73 };
        let (across, up) = (record.integer(72).unwrap_or(0), record.integer(vertical).unwrap_or(0));
        let is_aligned = (across != 0 || up != 0) && !matches!(across, 3 | 5);
        let place = if is_aligned { point(record, [11, 21]) } else { None };
        let place = place.or_else(|| point(record, [10, 20]));
        let (Some(place), Some(height), Some(text)) = (place, record.number(40), record.text(1)) else {
            return;
        };
        let anchor = match across {
            1 | 4 => 1,
            2 => 2,
            _ => 0,
        };
        let lift = match up {
            2 => -0.5,
            3 => -1.0,
            _ if across == 4 => -0.5,
            _ => 0.0,
        };
        let placed = at
            * Affine::translate(place.to_vec2())
            * Affine::rotate(record.number(50).unwrap_or(0.0).to_radians())
            * Affine::scale(height)
            * Affine::translate(Vec2::new(0.0, lift));
        self.add_label(&with_signs(&decoded(text)), placed, anchor, style);
    }

    fn add_paragraphs(&mut self, record: &Record<'_>, at: Affine, style: Style<'_>) {
        /// Distance between baselines divided by the height of capitals.
        const LINE_SPACING: f64 = 5.0 / 3.0;
        let (Some(place), Some(height)) = (point(record, [10, 20]), record.number(40)) else { return };
        let raw: String = record
            .pairs
            .iter()
            .filter(|pair| matches!(pair.code, 1 | 3))
            .map(|pair| pair.value.as_ref())
            .collect();
        let turned = match point(record, [11, 21]) {
            Some(direction) => direction.to_vec2().atan2(),
            None => record.number(50).unwrap_or(0.0).to_radians(),
        };
        let attachment = record.integer(71).unwrap_or(1).clamp(1, 9) - 1;
        let text = unformatted(&decoded(&raw));
        let lines: Vec<&str> = text.lines().collect();
        let tall = 1.0 + LINE_SPACING * (lines.len().max(1) - 1) as f64;
        let top = [0.0, 0.5 * tall, tall][(attachment / 3) as usize];
        for (index, one) in lines.iter().enumerate() {
            let down = top - 1.0 - LINE_SPACING * index as f64;
            let placed = at
                * Affine::translate(place.to_vec2())
                * Affine::rotate(turned)
                * Affine::scale(height)
                * Affine::translate(Vec2::new(0.0, down));
            self.add_label(one, placed, (attachment % 3) as u8, style);
        }
    }

    fn add_label(&mut self, text: &str, placed: Affine, anchor: u8, style: Style<'_>) {
        *self.counts.entry(style.layer.to_owned()).or_default() += 1;
        let is_finite = placed.as_coeffs().iter().all(|value| value.is_finite());
        if is_finite && self.labels.len() < MAX_TEXTS && self.is_shown(style.layer) && !text.trim().is_empty()
        {
            let text = text.chars().take(MAX_TEXT_LENGTH).collect();
            self.labels.push(Label { text, placed, anchor, colour: style.colour });
        }
    }
}

/// Replaces the codes for signs, such as `%%d` for degrees, and removes those for lines under and over the text.
fn with_signs(text: &str) -> String {
    let mut parts = text.split("%%");
    let mut result = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let mut rest = part.chars();
        match rest.next() {
            Some('d' | 'D') => result.push('\u{b0}'),
            Some('p' | 'P') => result.push('\u{b1}'),
            Some('c' | 'C') => result.push('\u{2300}'),
            Some('u' | 'U' | 'o' | 'O' | 'k' | 'K') | None => {}
            Some(other) => result.push(other),
        }
        result.push_str(rest.as_str());
    }
    result
}

/// Removes the format codes of a text of several lines, such as `\P` and `{\fArial;text}`.
fn unformatted(text: &str) -> String {
    let mut result = String::new();
    let mut rest = text.chars();
    while let Some(character) = rest.next() {
        match character {
            '{' | '}' => {}
            '\\' => match rest.next() {
                Some('P' | 'X') => result.push('\n'),
                Some('~') => result.push(' '),
                Some(literal @ ('\\' | '{' | '}')) => result.push(literal),
                // Codes without an argument: underline, overline and strike on and off.
                Some('L' | 'l' | 'O' | 'o' | 'K' | 'k') | None => {}
                // Stacked fractions have their text as the argument.
                Some('S') => result.extend(rest.by_ref().take_while(|&c| c != ';').map(|c| match c {
                    '^' | '#' => '/',
                    other => other,
                })),
                Some(_) => {
                    let _ = rest.by_ref().find(|&c| c == ';');
                }
            },
            other => result.push(other),
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::{unformatted, with_signs};

    #[test]
    fn format_codes_are_removed() {
        assert_eq!(unformatted(r"{\fArial|b1;Hall} 2\P12.5 m\~x"), "Hall 2\n12.5 m x");
        assert_eq!(unformatted(r"\A1;\S1^2; \\ {"), "1/2 \\ ");
        assert_eq!(unformatted("\\"), "");
        assert_eq!(with_signs("%%uRoom%%u 45%%d %%p2"), "Room 45\u{b0} \u{b1}2");
    }
}
