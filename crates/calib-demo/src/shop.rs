//! Furniture of the shop: shelves, fridges, counters, checkouts, small objects.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::goods::{Range, Row, fill};
use crate::material::{Finish, Material};
use crate::stage::Stage;

/// Rows of shelves in the middle of the shop: range of x, and y of their back panel, in metres.
pub(crate) const GONDOLAS: [[f32; 3]; 2] = [[4.8, 12.0, 3.6], [4.8, 12.0, 6.6]];
/// Rows of shelves a month later: one has been moved.
pub(crate) const GONDOLAS_LATER: [[f32; 3]; 2] = [[4.8, 12.0, 3.6], [5.3, 12.5, 6.95]];
/// Length of a shelf between its uprights, in metres.
pub(crate) const BAY: f32 = 1.2;
/// Height of the rows of shelves, in metres.
pub(crate) const GONDOLA_HEIGHT: f32 = 1.6;
/// Half the depth of the rows of shelves, in metres.
pub(crate) const GONDOLA_HALF: f32 = 0.45;
/// Range of x of the shelves along the south wall, in metres.
pub(crate) const WALL_SHELVES: [f32; 2] = [4.8, 12.0];
/// Depth and height of the wall shelves, in metres.
pub(crate) const WALL_SHELF: [f32; 2] = [0.5, 2.2];
/// Range of x of the fridges along the south wall, in metres.
pub(crate) const FRIDGES: [f32; 2] = [15.6, 19.2];
/// Depth and height of the fridges, in metres.
pub(crate) const FRIDGE: [f32; 2] = [0.8, 2.1];
/// Service counter along the west wall: range of x, then range of y, in metres.
pub(crate) const COUNTER: [f32; 4] = [1.8, 2.6, 2.4, 7.8];
/// Lower left corners of the checkouts, in metres; they run along y.
pub(crate) const CHECKOUTS: [[f32; 2]; 2] = [[6.6, 10.8], [9.0, 10.8]];
/// Width, length and height of a checkout, in metres.
pub(crate) const CHECKOUT: [f32; 3] = [0.7, 2.1, 0.88];
/// Foot of the pole with the sign, in metres.
pub(crate) const POLE: [f32; 2] = [15.6, 10.8];
/// Height of the pole, in metres.
pub(crate) const POLE_HEIGHT: f32 = 2.0;
/// Lower left corner of the pallet with cartons, in metres.
pub(crate) const PALLET: [f32; 2] = [18.0, 11.4];
/// Width, depth and height of the pallet and its cartons, in metres.
pub(crate) const PALLET_SIZE: [f32; 3] = [1.2, 0.8, 0.944];
/// Centre, radius and height of the barrel, in metres.
pub(crate) const BARREL: [f32; 4] = [14.4, 7.8, 0.35, 0.9];
/// Centre and radius of the round rug, in metres.
pub(crate) const RUG: [f32; 3] = [3.6, 12.0, 0.75];

/// Adds the furniture to the stage.
pub(crate) fn build(stage: &mut Stage, gondolas: [[f32; 3]; 2]) {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    for [from, to, y] in gondolas {
        gondola(stage, &mut random, from, to, y);
    }
    wall_shelves(stage, &mut random);
    fridges(stage, &mut random);
    counter(stage, &mut random);
    for at in CHECKOUTS {
        checkout(stage, at);
    }
    display(stage);
    details(stage);
}

fn white() -> Material {
    Material::matt(0xe2_e0da)
}

fn steel() -> Material {
    Material::matt(0x54_585c).gloss(0.03)
}

fn oak() -> Material {
    Material::matt(0xb8_8d5c).with(Finish::Timber)
}

fn gondola(stage: &mut Stage, random: &mut ChaCha8Rng, from: f32, to: f32, y: f32) {
    let body = Material::matt(0x6b_706f);
    stage.outline(from, y - GONDOLA_HALF, to, y + GONDOLA_HALF);
    stage.block([from, y - GONDOLA_HALF + 0.03, 0.0], [to, y + GONDOLA_HALF - 0.03, 0.14], body);
    stage.block([from + 0.03, y - 0.02, 0.14], [to - 0.03, y + 0.02, GONDOLA_HEIGHT], white());
    for x in [from, to] {
        let inner = if x == from { x + 0.03 } else { x - 0.03 };
        stage.block([x, y - GONDOLA_HALF, 0.0], [inner, y + GONDOLA_HALF, GONDOLA_HEIGHT], oak());
    }
    for (level, z) in [0.16, 0.52, 0.88, 1.24].into_iter().enumerate() {
        let depth = if level == 0 { GONDOLA_HALF - 0.01 } else { 0.38 };
        for side in [-1.0, 1.0] {
            let edge = y + side * depth;
            let (a, b) = (from + 0.03, to - 0.03);
            stage.block([a, y, z - 0.02], [b, edge, z], white());
            stage.block([a, edge, z - 0.035], [b, edge + side * 0.008, z + 0.01], Material::matt(0xc4_c9c6));
            let row = Row {
                start: [from + 0.04, edge, z],
                along_x: true,
                faces_positive: side > 0.0,
                length: to - from - 0.08,
                depth: depth - 0.03,
                clearance: if level == 3 { 0.32 } else { 0.33 },
            };
            fill(stage, random, &row, if level == 0 && side > 0.0 { Range::Drinks } else { Range::Dry });
        }
    }
}

fn wall_shelves(stage: &mut Stage, random: &mut ChaCha8Rng) {
    let [from, to] = WALL_SHELVES;
    let [depth, height] = WALL_SHELF;
    stage.outline(from, 0.0, to, depth);
    stage.block([from, 0.0, 0.0], [to, 0.03, height], oak());
    stage.block([from, 0.0, 0.0], [to, depth - 0.03, 0.1], Material::matt(0x4b_4742));
    stage.block([from, 0.0, height - 0.03], [to, depth, height + 0.12], oak());
    let bays = ((to - from) / BAY).round() as usize;
    for i in 0..=bays {
        let x = from + BAY * i as f32;
        let (a, b) = if i == 0 {
            (x, x + 0.04)
        } else if i == bays {
            (x - 0.04, x)
        } else {
            (x - 0.02, x + 0.02)
        };
        stage.block([a, 0.0, 0.0], [b, depth, height], oak());
    }
    for bay in 0..bays {
        for z in [0.12, 0.54, 0.96, 1.36, 1.74] {
            let x = from + BAY * bay as f32 + 0.03;
            stage.block([x, 0.02, z - 0.025], [x + BAY - 0.06, depth - 0.04, z], oak());
            let row = Row {
                start: [x, depth - 0.05, z],
                along_x: true,
                faces_positive: true,
                length: BAY - 0.06,
                depth: depth - 0.1,
                clearance: 0.36,
            };
            let range = if (2..4).contains(&bay) { Range::Drinks } else { Range::Dry };
            fill(stage, random, &row, range);
        }
    }
}

fn fridges(stage: &mut Stage, random: &mut ChaCha8Rng) {
    let [from, to] = FRIDGES;
    let [depth, height] = FRIDGE;
    let body = Material::matt(0x7a_8083).gloss(0.03);
    let lit = Material::matt(0xf4_f7f8).glow(0.55);
    stage.outline(from, 0.0, to, depth);
    stage.block([from, 0.0, 0.0], [to, depth, 0.22], body);
    stage.block([from, 0.0, height - 0.2], [to, depth, height], body);
    stage.block([from, 0.0, 0.2], [to, 0.06, height], lit);
    stage.block(
        [from + 0.1, depth - 0.2, height - 0.22],
        [to - 0.1, depth - 0.1, height - 0.2],
        lit.glow(2.5),
    );
    let bays = ((to - from) / BAY).round() as usize;
    for i in 0..=bays {
        let x = (from + BAY * i as f32).clamp(from + 0.03, to - 0.03);
        stage.block([x - 0.03, 0.0, 0.0], [x + 0.03, depth, height], body);
    }
    for bay in 0..bays {
        for z in [0.26, 0.66, 1.04, 1.42] {
            let x = from + BAY * bay as f32 + 0.03;
            stage.block([x, 0.05, z - 0.02], [x + BAY - 0.06, depth - 0.12, z], white().glow(0.2));
            let row = Row {
                start: [x, depth - 0.14, z],
                along_x: true,
                faces_positive: true,
                length: BAY - 0.06,
                depth: 0.4,
                clearance: 0.34,
            };
            fill(stage, random, &row, if bay < 1 { Range::Drinks } else { Range::Chilled });
        }
    }
}

/// Adds the baker's counter, and the bread on the wall behind it.
fn counter(stage: &mut Stage, random: &mut ChaCha8Rng) {
    let [x0, x1, y0, y1] = COUNTER;
    stage.outline(x0, y0, x1, y1);
    stage.block([x0, y0, 0.0], [x1, y1, 0.1], steel());
    stage.block([x0, y0, 0.1], [x1, y1, 0.92], Material::matt(0x9c_7448).with(Finish::Boards { width: 0.1 }));
    stage.block(
        [x0 - 0.03, y0 - 0.03, 0.92],
        [x1 + 0.04, y1 + 0.03, 0.97],
        Material::matt(0xd6_d1c6).gloss(0.05),
    );
    stage.block([x0 + 0.1, y0 + 0.8, 1.36], [x1, y1 - 0.8, 1.39], Material::matt(0xb4_bbb8).gloss(0.04));
    for y in [y0 + 0.8, 0.5 * (y0 + y1), y1 - 0.82] {
        stage.block([x0 + 0.1, y, 0.97], [x1 - 0.02, y + 0.02, 1.36], steel());
    }
    let [a, b] = [y0, y1];
    stage.outline(0.0, a, 0.45, b);
    stage.block([0.02, a, 0.0], [0.05, b, 2.3], oak());
    stage.block([0.0, a, 0.0], [0.45, b, 0.85], oak());
    let shelf = |z: f32, start: [f32; 3], length: f32| Row {
        start: [start[0], start[1], z],
        along_x: false,
        faces_positive: true,
        length,
        depth: 0.36,
        clearance: 0.3,
    };
    for z in [0.85, 1.25, 1.65, 2.05] {
        stage.block([0.02, a, z - 0.03], [0.45, b, z], oak());
        fill(stage, random, &shelf(z, [0.43, a, 0.0], b - a), Range::Bread);
    }
    fill(stage, random, &shelf(0.97, [x1 - 0.12, y0 + 0.85, 0.0], y1 - y0 - 1.7), Range::Bread);
}

fn checkout(stage: &mut Stage, [x, y]: [f32; 2]) {
    let [width, length, height] = CHECKOUT;
    stage.outline(x, y, x + width, y + length);
    stage.block([x, y, 0.0], [x + width, y + length, 0.08], steel());
    stage.block([x, y, 0.08], [x + width, y + length, height], oak());
    stage.block([x - 0.02, y - 0.02, height - 0.04], [x + width + 0.02, y + length + 0.02, height], white());
    stage.block(
        [x + 0.1, y + 0.75, height],
        [x + 0.5, y + length - 0.04, height + 0.012],
        Material::matt(0x26_282a),
    );
    stage.block(
        [x + 0.12, y + 0.3, height],
        [x + 0.48, y + 0.65, height + 0.02],
        Material::matt(0x88_8c90).gloss(0.1),
    );
    stage.rod([x + 0.6, y + 0.5, height], [x + 0.6, y + 0.5, height + 0.42], 0.02, steel());
    stage.block(
        [x + 0.56, y + 0.3, height + 0.3],
        [x + 0.6, y + 0.7, height + 0.58],
        Material::matt(0x1d_2023),
    );
    stage.block(
        [x + 0.6, y + 0.33, height + 0.33],
        [x + 0.605, y + 0.67, height + 0.55],
        Material::matt(0x9f_c4d8).glow(0.7),
    );
    stage.block([x + 0.02, y + 0.5, height], [x + 0.09, y + 0.58, height + 0.16], Material::matt(0x2a_2c30));
    for (i, rgb) in [0xb4_4a3a, 0xd9_a441, 0x6d_8f4e, 0xe4_dcc8].into_iter().enumerate() {
        let at = y + 1.0 + 0.25 * i as f32;
        stage.block([x + 0.2, at, height + 0.01], [x + 0.34, at + 0.12, height + 0.13], Material::matt(rgb));
    }
}

/// Adds the pallet of cartons, the pole with its sign, the barrel and the rug.
fn display(stage: &mut Stage) {
    let [x, y] = PALLET;
    let [width, depth, height] = PALLET_SIZE;
    pallet(stage, [x, y, 0.0]);
    stage.outline(x, y, x + width, y + depth);
    let carton = Material::matt(0xb0_8a5e).with(Finish::Carton);
    let layers = 2;
    let tall = (height - 0.144) / layers as f32;
    for layer in 0..layers {
        for i in 0..3 {
            for j in 0..2 {
                let (a, b) = (x + 0.4 * i as f32, y + 0.4 * j as f32);
                let z = 0.144 + tall * layer as f32;
                stage.block([a + 0.002, b + 0.002, z], [a + 0.398, b + 0.398, z + tall - 0.002], carton);
            }
        }
    }
    let [px, py] = POLE;
    stage.drum([px, py, 0.0], 0.16, 0.025, steel());
    stage.drum([px, py, 0.0], 0.025, POLE_HEIGHT, steel());
    stage.block([px - 0.25, py - 0.03, 1.62], [px + 0.25, py - 0.026, 1.98], Material::matt(0xf0_ede4));
    stage.block([px - 0.25, py + 0.026, 1.62], [px + 0.25, py + 0.03, 1.98], Material::matt(0x5f_7f5c));
    let [bx, by, radius, tall] = BARREL;
    stage.outline(bx - radius, by - radius, bx + radius, by + radius);
    stage.drum([bx, by, 0.0], radius, tall, Material::matt(0x8a_623a).with(Finish::Timber));
    for z in [0.1, 0.42, 0.74] {
        stage.drum([bx, by, z], radius + 0.006, 0.05, steel());
    }
    let [rx, ry, r] = RUG;
    stage.drum([rx, ry, 0.0], r, 0.004, Material::matt(0x7c_3b34));
    stage.drum([rx, ry, 0.0], r - 0.12, 0.006, Material::matt(0xc9_b892));
}

/// Adds a pallet of 1.2 m x 0.8 m, 0.144 m high, with its lower left corner at `at`.
pub(crate) fn pallet(stage: &mut Stage, [x, y, z]: [f32; 3]) {
    let wood = Material::matt(0xc0_a070).with(Finish::Timber);
    for b in [0.0, 0.35, 0.7] {
        stage.block([x, y + b, z], [x + 1.2, y + b + 0.1, z + 0.1], wood);
    }
    for i in 0..5 {
        let b = 0.17 * i as f32;
        stage.block([x, y + b, z + 0.12], [x + 1.2, y + b + 0.12, z + 0.144], wood);
    }
    for a in [0.0, 0.53, 1.06] {
        stage.block([x + a, y, z + 0.098], [x + a + 0.14, y + 0.8, z + 0.122], wood);
    }
}

/// Adds a mat, baskets, plants, a bench, signs, an extinguisher and posters.
fn details(stage: &mut Stage) {
    stage.block([2.4, 12.9, 0.0], [4.8, 14.35, 0.008], Material::matt(0x3b_3d3c));
    for i in 0..7 {
        let z = 0.06 + 0.075 * i as f32;
        let rgb = if i % 2 == 0 { 0x4f_7a4a } else { 0x47_6f43 };
        stage.block([5.4, 13.3, z - 0.05], [5.85, 13.6, z + 0.02], Material::matt(rgb));
    }
    for [x, y, tall] in
        [[11.4, 13.9, 1.5], [16.2, 13.9, 1.3], [23.3, 13.7, 1.7], [0.6, 13.7, 1.6], [23.4, 9.0, 1.4]]
    {
        plant(stage, [x, y], tall);
    }
    stage.block([17.4, 13.3, 0.42], [19.8, 13.75, 0.47], oak());
    stage.outline(17.4, 13.3, 19.8, 13.75);
    for x in [17.5, 19.6] {
        stage.block([x, 13.34, 0.0], [x + 0.06, 13.71, 0.42], steel());
    }
    for (x, y, rgb) in [(8.4, 3.6, 0x5f_7f5c), (6.4, 6.6, 0xb0_6b3a), (17.7, 5.7, 0x6d_8f4e)] {
        stage.block([x - 0.8, y - 0.02, 2.75], [x + 0.8, y + 0.02, 3.15], Material::matt(rgb));
        stage.block([x - 0.6, y - 0.025, 2.9], [x + 0.3, y + 0.025, 2.98], Material::matt(0xf2_efe6));
        for side in [-0.7, 0.7] {
            stage.rod([x + side, y, 3.15], [x + side, y, 4.6], 0.008, steel());
        }
    }
    stage.rod([15.0, 0.12, 0.75], [15.0, 0.12, 1.15], 0.075, Material::matt(0xb1_2a22).gloss(0.04));
    stage.block([14.9, 0.0, 1.6], [15.1, 0.02, 1.8], Material::matt(0xc4_3a30));
    for (y, rgb) in [(1.2, 0xc9_a24d), (3.4, 0x7c_9a6a), (9.0, 0xb5_6a4a), (11.2, 0x54_7aa5)] {
        stage.block([23.96, y, 1.4], [23.98, y + 0.9, 2.6], Material::matt(0xf0_ede6));
        stage.block([23.95, y + 0.08, 1.75], [23.97, y + 0.82, 2.52], Material::matt(rgb));
    }
}

fn plant(stage: &mut Stage, [x, y]: [f32; 2], tall: f32) {
    stage.outline(x - 0.2, y - 0.2, x + 0.2, y + 0.2);
    stage.block([x - 0.2, y - 0.2, 0.0], [x + 0.2, y + 0.2, 0.45], Material::matt(0xcf_cac0));
    stage.block([x - 0.17, y - 0.17, 0.44], [x + 0.17, y + 0.17, 0.455], Material::matt(0x4a_3a2c));
    let green = Material::matt(0x56_7547).with(Finish::Green);
    for i in 0..44 {
        let turn = 2.4 * i as f32;
        let t = (i as f32 + 0.5) / 44.0;
        let out = 0.12 + 0.3 * (std::f32::consts::PI * t).sin();
        let tip = [x + out * turn.cos(), y + out * turn.sin(), 0.5 + (tall - 0.5) * t];
        let from: [f32; 3] = [x, y, 0.45 + 0.5 * (tall - 0.5) * t];
        let shape = crate::shape::Shape::Cone { from: from.into(), to: tip.into(), radii: [0.008, 0.034] };
        stage.add(shape, green);
    }
}
