//! Goods on shelves: slightly untidy runs of packets, tins, jars and bottles.

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;

use crate::material::{Finish, Material, paint};
use crate::stage::Stage;

/// Front edge of a shelf with goods, in metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    /// End of the edge with the lower coordinate: x, y, z.
    pub(crate) start: [f32; 3],
    /// Whether the edge runs along x; otherwise it runs along y.
    pub(crate) along_x: bool,
    /// Whether the front faces the positive side of the other axis.
    pub(crate) faces_positive: bool,
    pub(crate) length: f32,
    pub(crate) depth: f32,
    /// Free height above the shelf.
    pub(crate) clearance: f32,
}

impl Row {
    /// Returns a world point from its distances to the start of the edge, in metres: `along` the edge, `deep`
    /// behind it, `up` above it.
    pub(crate) fn at(&self, along: f32, deep: f32, up: f32) -> [f32; 3] {
        let [x, y, z] = self.start;
        let back = if self.faces_positive { -deep } else { deep };
        if self.along_x { [x + along, y + back, z + up] } else { [x + back, y + along, z + up] }
    }
}

/// Kind of goods on a shelf.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Range {
    /// Packets, tins and jars.
    Dry,
    /// Bottles.
    Drinks,
    /// Cups and small packets of dairy.
    Chilled,
    /// Loaves.
    Bread,
}

/// Body and band colours of packets, tins and jars, as `0xRRGGBB`.
const DRY_COLOURS: [u32; 12] = [
    0xb4_4a3a, 0xd9_a441, 0x3e_6b8a, 0x6d_8f4e, 0xe4_dcc8, 0x8a_4f6d, 0xc9_6f35, 0x35_5e58, 0xe9_e4da,
    0x7a_5b3e, 0xd8_c07a, 0x54_7aa5,
];
/// Body and band colours of bottles.
const DRINK_COLOURS: [u32; 7] = [0x3d_5a34, 0x6b_3f22, 0xc7_8a2c, 0x8f_b4a6, 0x7b_2430, 0xd9_d4b8, 0x49_6f8f];
/// Body and band colours of dairy products.
const CHILLED_COLOURS: [u32; 7] =
    [0xf1_efe9, 0xe7_e9ee, 0xcf_dfe9, 0xe9_cfd2, 0xdf_e6cb, 0x4f_7fae, 0xe8_d9a6];
/// Body and band colours of loaves.
const BREAD_COLOURS: [u32; 4] = [0xa8_713a, 0x8a_5528, 0xc2_9154, 0x6e_4320];

/// Fills a row with goods of one kind from end to end, with gaps for sold-out goods.
pub(crate) fn fill(stage: &mut Stage, random: &mut ChaCha8Rng, row: &Row, range: Range) {
    /// Free length at both ends of the row, in metres.
    const MARGIN: f32 = 0.03;
    let mut along = MARGIN;
    while along < row.length - MARGIN {
        if random.random_bool(0.07) {
            along += random.random_range(0.08..0.3);
            continue;
        }
        along = add_items(stage, random, row, range, along);
    }
}

/// Adds several items of one product side by side. `start` and the returned end of the items are distances
/// from the start of the row, in metres.
fn add_items(stage: &mut Stage, random: &mut ChaCha8Rng, row: &Row, range: Range, start: f32) -> f32 {
    let colours: &[u32] = match range {
        Range::Dry => &DRY_COLOURS,
        Range::Drinks => &DRINK_COLOURS,
        Range::Chilled => &CHILLED_COLOURS,
        Range::Bread => &BREAD_COLOURS,
    };
    let mut pick = || colours[random.random_range(0..colours.len())];
    let (body, band) = (pick(), pick());
    let material = Material::matt(body).with(Finish::Label { band: paint(band) });
    let facings = random.random_range(2..=5);
    let round = range != Range::Bread && random.random_bool(if range == Range::Drinks { 0.85 } else { 0.4 });
    let tall = |random: &mut ChaCha8Rng, low: f32, high: f32| {
        random.random_range(low..high).min(row.clearance - 0.03)
    };
    let (width, height) = match (range, round) {
        (Range::Drinks, _) => (random.random_range(0.075..0.095), tall(random, 0.26, 0.33)),
        (Range::Chilled, _) => (random.random_range(0.08..0.12), tall(random, 0.09, 0.24)),
        (Range::Bread, _) => (random.random_range(0.13..0.18), 0.12),
        (Range::Dry, true) => (random.random_range(0.075..0.11), tall(random, 0.11, 0.2)),
        (Range::Dry, false) => (random.random_range(0.10..0.22), tall(random, 0.16, 0.31)),
    };
    let mut along = start;
    for _ in 0..facings {
        if along + width > row.length - 0.02 {
            return row.length;
        }
        let set_back = random.random_range(0.005..0.035);
        if random.random_bool(0.96) {
            add_item(stage, row, range, round, [along, set_back], [width, height], material);
        }
        along += width + random.random_range(0.004..0.014);
    }
    along + random.random_range(0.0..0.02)
}

fn add_item(
    stage: &mut Stage,
    row: &Row,
    range: Range,
    round: bool,
    [along, set_back]: [f32; 2],
    [width, height]: [f32; 2],
    material: Material,
) {
    let radius = 0.5 * width;
    if range == Range::Bread {
        let (a, b) = (
            row.at(along + radius, 0.08, radius * 0.8),
            row.at(along + radius, row.depth - 0.1, radius * 0.8),
        );
        stage.rod(a, b, radius, material.with(Finish::Plain));
    } else if round && range == Range::Drinks {
        stage.drum(row.at(along + radius, set_back + radius, 0.0), radius, height * 0.62, material);
        let (shoulder, neck) = (
            row.at(along + radius, set_back + radius, height * 0.6),
            row.at(along + radius, set_back + radius, height),
        );
        let radii = [radius * 0.95, 0.014];
        let shape = crate::shape::Shape::Cone { from: shoulder.into(), to: neck.into(), radii };
        stage.add(shape, material.with(Finish::Plain));
    } else if round {
        stage.drum(row.at(along + radius, set_back + radius, 0.0), radius, height, material);
    } else {
        stage.block(row.at(along, set_back, 0.0), row.at(along + width, row.depth - 0.05, height), material);
    }
}
