//! The barn: a long aisle between pens, posts and rails, straw, bales, cows.

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::building::RIDGE;
use crate::material::{Finish, Material};
use crate::shape::Shape;
use crate::stage::Stage;
use crate::vector::{Vec3, vec3};

/// Range of y of the aisle between the kerbs, in metres.
pub(crate) const AISLE: [f32; 2] = [-8.25, -4.25];
/// Width and height of the cross section of a kerb, in metres.
pub(crate) const KERB: [f32; 2] = [0.18, 0.16];
/// Distance between the timber posts along the aisle, in metres. The first post is at x = `BAY`.
pub(crate) const BAY: f32 = 5.0;
/// Side of a timber post, in metres.
pub(crate) const POST: f32 = 0.2;
/// Height of the rails above the floor, in metres.
pub(crate) const RAILS: [f32; 3] = [0.5, 0.82, 1.14];
/// y of the inner walls of the barn, in metres.
const WALLS: [f32; 2] = [-12.2, -0.34];
/// Range of x of the pens, in metres.
pub(crate) const PENS: [f32; 2] = [2.5, 29.0];

/// The two sides of the aisle: y of the kerb's face, direction away from the aisle, y of the wall.
const SIDES: [(f32, f32, f32); 2] = [(AISLE[0], -1.0, WALLS[0]), (AISLE[1], 1.0, WALLS[1])];

/// Adds the fittings of the barn to the stage.
pub(crate) fn build(stage: &mut Stage) {
    let mut random = ChaCha8Rng::seed_from_u64(77);
    kerbs(stage);
    add_frames(stage);
    for (y, side, wall) in SIDES {
        add_fence(stage, y + side * 0.09, [y, wall]);
        bedding(stage, &mut random, y, side, wall);
        add_hay(stage, &mut random, y, side);
    }
    bales(stage);
    for (x, y, turn) in [
        (9.0, -9.9, 0.3),
        (13.4, -2.6, 2.9),
        (17.6, -10.4, 1.3),
        (20.8, -2.2, -0.4),
        (6.6, -2.4, 1.9),
        (24.6, -9.8, 3.5),
    ] {
        add_cow(stage, [x, y], turn, x as u32 * 31 + 7);
    }
    add_tools(stage);
}

fn steel() -> Material {
    Material::matt(0x9a_a0a3).gloss(0.04)
}

fn timber() -> Material {
    Material::matt(0x9d_7a50).with(Finish::Timber)
}

fn kerbs(stage: &mut Stage) {
    let concrete = Material::matt(0xb2_ada2).with(Finish::Concrete { pitch: 2.5 });
    let gutter = Material::matt(0x5d_5a54);
    for (y, side, wall) in SIDES {
        stage.block([0.0, y, 0.0], [30.0, y + side * KERB[0], KERB[1]], concrete);
        stage.block([0.0, y - side * 0.35, 0.0], [30.0, y - side * 0.22, 0.003], gutter);
        let (a, b) = (y.min(wall), y.max(wall));
        stage.outline(PENS[0], a, PENS[1], b);
        stage.block([0.0, wall, 0.0], [30.0, wall - side * 0.1, 0.9], concrete);
    }
}

/// Adds the timber frame: posts along the aisle, ties across it, purlins and rafters under the roof.
fn add_frames(stage: &mut Stage) {
    let wood = timber();
    let [ridge_y, ridge_z] = RIDGE;
    let underside = |y: f32| {
        let eaves = if y > ridge_y { -0.15 } else { -12.35 };
        3.4 + (ridge_z - 3.4) * (y - eaves) / (ridge_y - eaves)
    };
    for i in 1..6 {
        let x = BAY * i as f32;
        for (y, side, wall) in SIDES {
            let (a, b) = (y + side * 0.04, y + side * (0.04 + POST));
            stage.block([x - 0.5 * POST, a, 0.0], [x + 0.5 * POST, b, underside(a) - 0.1], wood);
            stage.block(
                [x - 0.55 * POST, y, 0.0],
                [x + 0.55 * POST, b + side * 0.01, 0.5],
                Material::matt(0xa9_a59b),
            );
            let foot = [x, b - side * 0.1, 2.5];
            stage.rod(foot, [x, y - side * 0.9, 3.42], 0.06, wood);
            stage.block([x - 0.08, a, 3.1], [x + 0.08, wall, 3.3], wood);
            rafter(stage, [x, wall, underside(wall) - 0.22], [x, ridge_y, ridge_z - 0.2], wood);
        }
        stage.block([x - 0.08, AISLE[0] - 0.3, 3.42], [x + 0.08, AISLE[1] + 0.3, 3.64], wood);
        stage.block([x - 0.07, ridge_y - 0.07, 3.64], [x + 0.07, ridge_y + 0.07, ridge_z - 0.15], wood);
    }
    for y in [-11.0, -9.6, -8.2, -4.3, -2.9, -1.5] {
        stage.block([0.0, y - 0.05, underside(y) - 0.18], [30.0, y + 0.05, underside(y) - 0.02], wood);
    }
    stage.block([0.0, ridge_y - 0.07, ridge_z - 0.2], [30.0, ridge_y + 0.07, ridge_z], wood);
}

fn rafter(stage: &mut Stage, from: [f32; 3], to: [f32; 3], wood: Material) {
    let (a, b) = (Vec3::from(from), Vec3::from(to));
    let along = (b - a).unit();
    let across = vec3(1.0, 0.0, 0.0);
    let half = vec3(0.06, 0.5 * (b - a).length(), 0.1);
    stage.add(
        Shape::RotatedBox { centre: (a + b) * 0.5, axes: [across, along, across.cross(along)], half },
        wood,
    );
}

/// Adds the fence at `y`, in metres: posts and rails along the pens. Also adds rails from `kerb` to `wall` (y
/// in metres) between neighbouring pens.
fn add_fence(stage: &mut Stage, y: f32, [kerb, wall]: [f32; 2]) {
    let [from, to] = PENS;
    let count = ((to - from) / 2.65).round() as usize;
    for i in 0..=count {
        let x = from + (to - from) * i as f32 / count as f32;
        stage.drum([x, y, 0.0], 0.035, 1.25, steel());
    }
    for z in RAILS {
        stage.rod([from, y, z], [to, y, z], 0.024, steel());
    }
    for i in 1..6 {
        let x = BAY * i as f32 + 0.25;
        for z in RAILS {
            stage.rod([x, y, z], [x, wall, z], 0.022, steel());
        }
        stage.drum([x, 0.5 * (kerb + wall), 0.0], 0.03, 1.25, steel());
    }
    for x in [from, to] {
        for z in RAILS {
            stage.rod([x, y, z], [x, wall, z], 0.022, steel());
        }
    }
}

fn bedding(stage: &mut Stage, random: &mut ChaCha8Rng, y: f32, side: f32, wall: f32) {
    let straw = Material::matt(0xcf_ae68).with(Finish::Straw);
    let near = y + side * KERB[0];
    stage.block([PENS[0], near, 0.0], [PENS[1], wall, 0.11], straw);
    for _ in 0..80 {
        let x = random.random_range(PENS[0] + 0.4..PENS[1] - 0.4);
        let at = random.random_range((near.min(wall) + 0.4)..(near.max(wall) - 0.4));
        let radius = random.random_range(0.5..1.5_f32);
        let rise = random.random_range(0.02..0.09);
        stage.ball([x, at, 0.11 + rise - radius], radius, straw);
    }
}

/// Adds a windrow of hay along the kerb, on the aisle's side, and scattered stalks.
fn add_hay(stage: &mut Stage, random: &mut ChaCha8Rng, y: f32, side: f32) {
    let hay = Material::matt(0xb9_a568).with(Finish::Straw);
    let mut x = PENS[0] + 0.2;
    while x < PENS[1] - 0.3 {
        // A thick rod deep in the floor looks like a flat heap.
        let (radius, rise) = (random.random_range(0.18..0.34_f32), random.random_range(0.05..0.12_f32));
        let off = random.random_range(0.04..0.12);
        let shift = random.random_range(-0.09..0.09);
        stage.rod(
            [x, y - side * off, rise - radius],
            [x + 0.5, y - side * (off + shift), rise - radius],
            radius,
            hay,
        );
        let (turn, tilt) = (random.random_range(0.0..3.1_f32), random.random_range(0.0..0.05));
        let (a, b) = (0.12 * turn.cos(), 0.12 * turn.sin());
        let at = y - side * (off + random.random_range(-0.05..0.2));
        stage.rod([x - a, at - b, 0.02], [x + a, at + b, 0.04 + tilt], 0.006, hay);
        x += random.random_range(0.1..0.3);
    }
    let stalk = Material::matt(0xc4_a660);
    for _ in 0..260 {
        let x = random.random_range(1.0..29.0);
        let out = 0.2 + 1.7 * random.random_range(0.0..1.0_f32).powi(2);
        let (turn, length) = (random.random_range(0.0..3.1_f32), random.random_range(0.03..0.11));
        let (a, b) = (length * turn.cos(), length * turn.sin());
        let at = y - side * out;
        stage.rod([x - a, at - b, 0.004], [x + a, at + b, 0.006], 0.003, stalk);
    }
}

fn bales(stage: &mut Stage) {
    let straw = Material::matt(0xc8_a55a).with(Finish::Straw);
    for (i, [x, y, z, turn]) in [
        [1.1, -9.2, 0.0, 0.0],
        [1.1, -9.75, 0.0, 0.02],
        [1.1, -10.3, 0.0, -0.02],
        [1.1, -9.5, 0.46, 0.03],
        [1.15, -10.05, 0.46, -0.03],
        [28.0, -3.6, 0.0, 1.5],
        [28.6, -3.6, 0.0, 1.55],
        [28.3, -3.6, 0.46, 1.6],
    ]
    .into_iter()
    .enumerate()
    {
        let shade = 0.9 + 0.05 * (i % 4) as f32;
        stage.rotated_block(
            [x, y, z],
            turn,
            [1.0, 0.5, 0.45],
            Material { colour: straw.colour * shade, ..straw },
        );
        for side in [-0.22, 0.22] {
            let (sin, cos) = turn.sin_cos();
            stage.rotated_block(
                [x + side * cos, y + side * sin, z],
                turn,
                [0.012, 0.508, 0.456],
                Material::matt(0x3f_6a8c),
            );
        }
    }
    for [x, y] in [[12.0, -11.2], [22.4, -1.4]] {
        let shape = Shape::Drum { from: vec3(x - 0.6, y, 0.7), to: vec3(x + 0.6, y, 0.7), radius: 0.62 };
        stage.add(shape, straw);
    }
}

/// Adds a cow with its feet around `[x, y]`. Its head points `turn` radians counter-clockwise from +x.
fn add_cow(stage: &mut Stage, [x, y]: [f32; 2], turn: f32, seed: u32) {
    let (sin, cos) = turn.sin_cos();
    let at =
        |ahead: f32, left: f32, up: f32| vec3(x + cos * ahead - sin * left, y + sin * ahead + cos * left, up);
    let coat = if seed.is_multiple_of(3) { Material::matt(0x8a_5a36) } else { Material::matt(0xe6_e0d6) };
    let fur = if seed.is_multiple_of(3) { coat } else { coat.with(Finish::Patches) };
    let dark = Material::matt(0x2c_2623);
    let pink = Material::matt(0xc9_9a8c);
    let mut limb = |from: Vec3, to: Vec3, radii: [f32; 2], material: Material| {
        stage.add(Shape::Cone { from, to, radii }, material);
    };
    for left in [-0.1, 0.1] {
        limb(at(-0.62, left, 1.06), at(0.55, left, 1.02), [0.31, 0.29], fur);
    }
    limb(at(-0.5, 0.0, 0.92), at(0.45, 0.0, 0.9), [0.33, 0.31], fur);
    limb(at(0.55, 0.0, 1.1), at(1.0, 0.0, 1.26), [0.24, 0.15], fur);
    limb(at(1.0, 0.0, 1.3), at(1.34, 0.0, 1.06), [0.145, 0.095], fur);
    limb(at(1.33, 0.0, 1.07), at(1.38, 0.0, 1.04), [0.1, 0.085], pink);
    for left in [-1.0, 1.0] {
        limb(at(0.98, 0.12 * left, 1.36), at(0.94, 0.27 * left, 1.35), [0.03, 0.05], fur);
        for ahead in [-0.66, 0.52] {
            limb(at(ahead, 0.2 * left, 0.85), at(ahead - 0.03, 0.2 * left, 0.45), [0.13, 0.07], fur);
            limb(at(ahead - 0.03, 0.2 * left, 0.45), at(ahead, 0.2 * left, 0.16), [0.065, 0.055], coat);
            limb(at(ahead, 0.2 * left, 0.16), at(ahead + 0.03, 0.2 * left, 0.12), [0.06, 0.07], dark);
        }
    }
    limb(at(-0.35, 0.0, 0.62), at(-0.42, 0.0, 0.56), [0.14, 0.1], pink);
    limb(at(-0.9, 0.0, 1.15), at(-0.98, 0.02, 0.55), [0.03, 0.035], coat);
}

/// Adds three buckets by the aisle, and two steel troughs by the walls.
fn add_tools(stage: &mut Stage) {
    for ([x, y], rgb) in [([3.2, -5.0], 0x3f_6a8c), ([3.6, -4.8], 0x9c_3a30), ([15.3, -7.7], 0x55_5a5e)] {
        let foot = vec3(x, y, 0.0);
        stage.add(
            Shape::Cone { from: foot + Vec3::UP * 0.13, to: foot + Vec3::UP * 0.2, radii: [0.12, 0.15] },
            Material::matt(rgb),
        );
        stage.drum([x, y, 0.0], 0.13, 0.28, Material::matt(rgb));
    }
    let steel = steel();
    stage.block([18.4, -0.9, 0.35], [20.0, -0.5, 0.65], steel);
    stage.block([7.0, -12.0, 0.35], [8.6, -11.6, 0.65], steel);
}
