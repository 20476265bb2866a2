//! Unit, layers and blocks of a drawing.

use std::collections::{BTreeMap, HashMap};

use kurbo::Point;

use super::pairs::{Record, integer};

/// Name of the layer whose lines, in a block, take the layer of the insertion of the block.
pub(super) const BASE_LAYER: &str = "0";

/// Properties of a layer.
#[derive(Clone, Copy, Debug)]
pub(super) struct LayerEntry {
    pub(super) colour: [u8; 3],
    /// Whether the drawing shows and prints the layer.
    pub(super) is_on: bool,
    /// Whether the layer is frozen: blocks that are inserted on it are hidden, too.
    pub(super) is_frozen: bool,
}

/// Block: lines that are drawn at several places.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block<'a> {
    /// Point of the block that is drawn at the place of the insertion.
    pub(super) base: Point,
    pub(super) records: &'a [Record<'a>],
}

/// Unit, layers, blocks and entities of a drawing.
#[derive(Debug, Default)]
pub(super) struct Tables<'a> {
    /// Value of $INSUNITS.
    pub(super) unit: i64,
    /// Layers by their names in upper case.
    pub(super) layers: BTreeMap<String, LayerEntry>,
    /// Names of the layers as written.
    pub(super) layer_names: BTreeMap<String, String>,
    /// Blocks by their names in upper case.
    pub(super) blocks: HashMap<String, Block<'a>>,
    pub(super) entities: &'a [Record<'a>],
}

impl<'a> Tables<'a> {
    /// Reads the unit, layers, blocks and entities of a DXF file from its records.
    pub(super) fn new(records: &'a [Record<'a>]) -> Self {
        let mut tables = Self::default();
        let mut at = 0;
        while at < records.len() {
            let start = &records[at];
            at += 1;
            if start.kind != "SECTION" {
                continue;
            }
            let rest = &records[at..];
            let end = rest.iter().position(|record| record.kind == "ENDSEC").unwrap_or(rest.len());
            let section = &rest[..end];
            match start.text(2) {
                Some("HEADER") => tables.unit = unit(start),
                Some("TABLES") => tables.read_layers(section),
                Some("BLOCKS") => tables.read_blocks(section),
                Some("ENTITIES") => tables.entities = section,
                _ => {}
            }
            at += end;
        }
        tables
    }

    fn read_layers(&mut self, records: &[Record<'_>]) {
        for layer in records.iter().filter(|record| record.kind == "LAYER") {
            let Some(name) = layer.text(2) else { continue };
            let index = layer.integer(62).unwrap_or(7);
            let colour = layer.integer(420).map_or_else(|| indexed_colour(index.abs()), true_colour);
            // Bit 1 of the flags: frozen. A negative colour: off. Code 290: not printed.
            let is_frozen = layer.integer(70).unwrap_or(0) & 1 != 0;
            let is_on = !is_frozen && index >= 0 && layer.integer(290) != Some(0);
            let is_on = is_on && !name.eq_ignore_ascii_case("defpoints");
            self.add_layer(name, LayerEntry { colour, is_on, is_frozen });
        }
    }

    fn add_layer(&mut self, name: &str, entry: LayerEntry) {
        let key = key(name);
        self.layer_names.entry(key.clone()).or_insert_with(|| decoded(name));
        self.layers.entry(key).or_insert(entry);
    }

    fn read_blocks(&mut self, records: &'a [Record<'a>]) {
        let mut start = 0;
        for (index, record) in records.iter().enumerate() {
            match record.kind {
                "BLOCK" => start = index,
                "ENDBLK" => {
                    let block = &records[start];
                    let Some(name) = block.text(2).filter(|_| block.kind == "BLOCK") else { continue };
                    let base = Point::new(block.number(10).unwrap_or(0.0), block.number(20).unwrap_or(0.0));
                    self.blocks.insert(key(name), Block { base, records: &records[start + 1..index] });
                }
                _ => {}
            }
        }
    }

    /// Returns the properties of a layer. Layers without an entry are on and black.
    pub(super) fn layer(&self, key: &str) -> LayerEntry {
        self.layers.get(key).copied().unwrap_or(LayerEntry {
            colour: indexed_colour(7),
            is_on: true,
            is_frozen: false,
        })
    }
}

/// Returns the name of a layer or block in upper case, because names are compared without case.
pub(super) fn key(name: &str) -> String {
    decoded(name.trim()).to_uppercase()
}

/// Replaces the escapes `\U+00FC` of older versions.
pub(super) fn decoded(text: &str) -> String {
    let mut parts = text.split("\\U+");
    let mut result = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let character =
            part.get(..4).and_then(|hex| u32::from_str_radix(hex, 16).ok()).and_then(char::from_u32);
        match character {
            Some(character) => {
                result.push(character);
                result.push_str(&part[4..]);
            }
            None => {
                result.push_str("\\U+");
                result.push_str(part);
            }
        }
    }
    result
}

/// Returns the value of $INSUNITS; 0 if it is missing.
fn unit(header: &Record<'_>) -> i64 {
    let mut pairs = header.pairs.iter().skip_while(|pair| pair.value.trim() != "$INSUNITS").skip(1);
    pairs.next().filter(|pair| pair.code == 70).and_then(|pair| integer(&pair.value)).unwrap_or(0)
}

/// Returns the length in metres of a unit of $INSUNITS; `None` for a drawing without unit.
pub(super) fn metres_of_unit(unit: i64) -> Option<f64> {
    Some(match unit {
        1 => 0.0254,           // inches
        2 => 0.3048,           // feet
        3 => 1609.344,         // miles
        4 => 1e-3,             // millimetres
        5 => 1e-2,             // centimetres
        6 => 1.0,              // metres
        7 => 1e3,              // kilometres
        8 => 2.54e-8,          // microinches
        9 => 2.54e-5,          // mils
        10 => 0.9144,          // yards
        13 => 1e-6,            // micrometres
        14 => 0.1,             // decimetres
        15 => 10.0,            // decametres
        16 => 100.0,           // hectometres
        21 => 1200.0 / 3937.0, // US survey feet
        22 => 100.0 / 3937.0,  // US survey inches
        23 => 3600.0 / 3937.0, // US survey yards
        _ => return None,
    })
}

/// Converts a colour of 24 bits to red, green and blue, darkened if it is too bright on white.
pub(super) fn true_colour(value: i64) -> [u8; 3] {
    let [_, r, g, b] = (value as u32).to_be_bytes();
    readable([r, g, b])
}

/// Returns a colour of the indexed palette. Colours 10 to 249 are 24 hues with five brightnesses, each in full
/// and half saturation.
pub(super) fn indexed_colour(index: i64) -> [u8; 3] {
    /// Brightnesses of a hue.
    const BRIGHTNESS: [f64; 5] = [1.0, 0.65, 0.5, 0.3, 0.15];
    let colour = match index {
        1 => [255, 0, 0],
        2 => [255, 255, 0],
        3 => [0, 255, 0],
        4 => [0, 255, 255],
        5 => [0, 0, 255],
        6 => [255, 0, 255],
        8 => [128; 3],
        9 => [192; 3],
        10..=249 => {
            let hue = ((index - 10) / 10) as f64 * 15.0;
            let value = BRIGHTNESS[(index % 10 / 2) as usize];
            let least = if index % 2 == 1 { 0.5 * value } else { 0.0 };
            let channel = |shift: f64| {
                let distance = ((hue + shift).rem_euclid(360.0) - 180.0).abs() / 60.0;
                let share = (distance - 1.0).clamp(0.0, 1.0);
                (255.0 * (least + share * (value - least))).round() as u8
            };
            [channel(0.0), channel(240.0), channel(120.0)]
        }
        250..=254 => [(50 + 40 * (index - 250)) as u8; 3],
        // 7 is white on black, and black on white.
        _ => [0; 3],
    };
    readable(colour)
}

/// Darkens a colour that is too bright on white.
fn readable(colour: [u8; 3]) -> [u8; 3] {
    /// Largest brightness of lines, from 0 to 255.
    const MAX_BRIGHTNESS: f64 = 140.0;
    let [r, g, b] = colour.map(f64::from);
    let brightness = 0.299 * r + 0.587 * g + 0.114 * b;
    let scale = (MAX_BRIGHTNESS / brightness.max(1.0)).min(1.0);
    colour.map(|channel| (f64::from(channel) * scale).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_the_palette() {
        assert_eq!(indexed_colour(7), [0; 3]);
        assert_eq!(indexed_colour(5), [0, 0, 255]);
        // Index 10 is red, 90 green and 170 blue, as 1, 3 and 5.
        for (hue, pure) in [(10, 1), (90, 3), (170, 5), (50, 2)] {
            assert_eq!(indexed_colour(hue), indexed_colour(pure), "{hue}");
        }
        assert!(indexed_colour(2).iter().all(|&channel| channel < 200), "yellow is darkened");
    }

    #[test]
    fn escapes_are_decoded() {
        assert_eq!(decoded("W\\U+00E4nde"), "Wände");
        assert_eq!(decoded("a\\U+zz"), "a\\U+zz");
        assert_eq!(key("w\u{e4}nde"), key("W\\U+00C4NDE"));
    }
}
