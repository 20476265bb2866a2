//! Store room: racks with pallets and cartons, marked lanes, a pallet truck.

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::material::{Finish, Material};
use crate::shop::pallet;
use crate::stage::Stage;

/// Racks: x0, y0, x1, y1, in metres.
pub(crate) const RACKS: [[f32; 4]; 2] = [[24.3, 0.1, 28.5, 1.2], [28.8, 6.0, 29.9, 8.3]];
/// Height of the racks, in metres.
pub(crate) const RACK_HEIGHT: f32 = 2.8;
/// Lane marked on the floor: x0, y0, x1, y1 of the centres of its lines, in metres.
pub(crate) const LANE: [f32; 4] = [25.6, 2.4, 29.8, 5.4];
/// Lower left corners of the pallets on the floor, in metres.
pub(crate) const PALLETS: [[f32; 2]; 2] = [[26.0, 6.6], [27.4, 6.6]];

/// Adds the store to the stage.
pub(crate) fn build(stage: &mut Stage) {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for rack in RACKS {
        build_rack(stage, &mut random, rack);
    }
    add_lane_lines(stage);
    for (i, [x, y]) in PALLETS.into_iter().enumerate() {
        pallet(stage, [x, y, 0.0]);
        stage.outline(x, y, x + 1.2, y + 0.8);
        add_carton_layers(stage, &mut random, [x, y, 0.144], 2 - i);
    }
    add_pallet_truck(stage, [26.5, 3.2]);
    let bar = Material::matt(0xc9_ccce);
    for i in 0..9 {
        stage.rod([24.25, 3.2, 0.3 * i as f32 + 0.2], [24.25, 3.6, 0.3 * i as f32 + 0.2], 0.014, bar);
    }
    for y in [3.2, 3.6] {
        stage.rod([24.25, y, 0.02], [24.25, y, 2.8], 0.02, bar);
    }
    stage.block([24.2, 1.6, 1.3], [24.34, 2.4, 2.1], Material::matt(0x8c_9296));
    stage.drum([29.5, 1.7, 0.0], 0.26, 0.8, Material::matt(0x3f_6a8c));
    stage.drum([29.0, 1.3, 0.0], 0.26, 0.8, Material::matt(0x3f_6a8c));
}

fn build_rack(stage: &mut Stage, random: &mut ChaCha8Rng, [x0, y0, x1, y1]: [f32; 4]) {
    /// Side of a post of the rack, in metres.
    const POST: f32 = 0.08;
    let (blue, orange) = (Material::matt(0x2c_4f86), Material::matt(0xd9_6a1e));
    stage.outline(x0, y0, x1, y1);
    let along_x = x1 - x0 > y1 - y0;
    let frames = if along_x { 3 } else { 2 };
    for i in 0..frames {
        let t = i as f32 / (frames - 1) as f32;
        for back in [false, true] {
            let (x, y) = if along_x {
                (x0 + (x1 - x0 - POST) * t, if back { y0 } else { y1 - POST })
            } else {
                (if back { x1 - POST } else { x0 }, y0 + (y1 - y0 - POST) * t)
            };
            stage.block([x, y, 0.0], [x + POST, y + POST, RACK_HEIGHT], blue);
        }
    }
    for z in [0.9, 1.9] {
        let beam = |stage: &mut Stage, a: [f32; 2], b: [f32; 2]| {
            stage.block([a[0], a[1], z - 0.12], [b[0], b[1], z], orange);
        };
        if along_x {
            beam(stage, [x0, y1 - 0.05], [x1, y1 + 0.005]);
            beam(stage, [x0, y0], [x1, y0 + 0.05]);
        } else {
            beam(stage, [x0 - 0.005, y0], [x0 + 0.05, y1]);
            beam(stage, [x1 - 0.05, y0], [x1, y1]);
        }
        stage.block(
            [x0 + 0.06, y0 + 0.06, z - 0.03],
            [x1 - 0.06, y1 - 0.06, z],
            Material::matt(0xb9_9a6c).with(Finish::Timber),
        );
    }
    for z in [0.0, 0.9, 1.9] {
        add_shelf_cartons(stage, random, [x0 + 0.1, y0 + 0.1, x1 - 0.1, y1 - 0.1], z);
    }
}

/// Adds cartons side by side on a level of a rack: x0, y0, x1, y1 of the level, and its height, in metres.
fn add_shelf_cartons(stage: &mut Stage, random: &mut ChaCha8Rng, [x0, y0, x1, y1]: [f32; 4], z: f32) {
    let along_x = x1 - x0 > y1 - y0;
    let (mut here, end) = if along_x { (x0, x1) } else { (y0, y1) };
    while here < end - 0.4 {
        let wide = random.random_range(0.34..0.62_f32).min(end - here);
        let tall = random.random_range(0.28..0.72_f32);
        let material = match random.random_range(0..6) {
            0 => Material::matt(0x3f_5f7a),
            1 => Material::matt(0xd8_d5cc),
            _ => Material::matt(0xac_8658).with(Finish::Carton),
        };
        let inset = random.random_range(0.0..0.12);
        if random.random_bool(0.9) {
            if along_x {
                stage.block([here, y0 + 0.05, z], [here + wide, y1 - inset, z + tall], material);
            } else {
                stage.block([x0 + inset, here, z], [x1 - 0.05, here + wide, z + tall], material);
            }
        }
        here += wide + random.random_range(0.02..0.09);
    }
}

/// Adds layers of four cartons each on a pallet, from its lower left corner.
fn add_carton_layers(stage: &mut Stage, random: &mut ChaCha8Rng, [x, y, z]: [f32; 3], layers: usize) {
    let carton = Material::matt(0xa9_8255).with(Finish::Carton);
    for layer in 0..layers {
        for i in 0..2 {
            for j in 0..2 {
                let off = random.random_range(0.0..0.02);
                let (a, b, c) = (x + 0.6 * i as f32 + off, y + 0.4 * j as f32, z + 0.42 * layer as f32);
                stage.block([a, b, c], [a + 0.575, b + 0.385, c + 0.42], carton);
            }
        }
    }
}

/// Adds the yellow lines of the lane.
fn add_lane_lines(stage: &mut Stage) {
    /// Half the width of a line, in metres.
    const HALF_LINE: f32 = 0.04;
    /// Thickness of the paint, in metres.
    const THICKNESS: f32 = 0.002;
    let yellow = Material::matt(0xd9_b127);
    let [x0, y0, x1, y1] = LANE;
    for y in [y0, y1] {
        stage.block([x0 - HALF_LINE, y - HALF_LINE, 0.0], [x1, y + HALF_LINE, THICKNESS], yellow);
    }
    stage.block([x0 - HALF_LINE, y0 - HALF_LINE, 0.0], [x0 + HALF_LINE, y1 + HALF_LINE, THICKNESS], yellow);
}

fn add_pallet_truck(stage: &mut Stage, [x, y]: [f32; 2]) {
    let red = Material::matt(0xb8_3527).gloss(0.03);
    for side in [-0.27, 0.11] {
        stage.block([x + 0.2, y + side, 0.06], [x + 1.35, y + side + 0.16, 0.11], red);
    }
    stage.block([x, y - 0.2, 0.05], [x + 0.22, y + 0.2, 0.4], red);
    stage.rod([x + 0.06, y, 0.4], [x - 0.16, y, 1.15], 0.022, Material::matt(0x2a_2b2d));
    stage.rod([x - 0.16, y - 0.14, 1.15], [x - 0.16, y + 0.14, 1.15], 0.022, Material::matt(0x2a_2b2d));
}
