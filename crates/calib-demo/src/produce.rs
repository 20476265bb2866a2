//! Fruit and vegetables in crates on low tables.

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::material::{Finish, Material};
use crate::stage::Stage;

/// Lower left corners of the tables, in metres.
pub(crate) const TABLES: [[f32; 2]; 4] = [[15.6, 3.6], [18.6, 3.6], [15.6, 6.6], [18.6, 6.6]];
/// Width, depth and height of a table without its crates, in metres.
pub(crate) const TABLE: [f32; 3] = [1.8, 1.2, 0.72];

/// Kinds of fruit: colour of the skin as `0xRRGGBB`, and radius in metres.
const KINDS: [(u32, f32); 9] = [
    (0xb5_2f26, 0.040),
    (0xe0_8a1e, 0.042),
    (0x9d_b53c, 0.040),
    (0xd8_c13a, 0.036),
    (0x9a_7a4e, 0.035),
    (0x86_a85a, 0.075),
    (0xc8_3a2a, 0.032),
    (0x5b_2f52, 0.036),
    (0xd9_6b25, 0.030),
];

/// Adds the tables to the stage.
pub(crate) fn build(stage: &mut Stage) {
    let mut random = ChaCha8Rng::seed_from_u64(23);
    let wood = Material::matt(0x7d_5c3c).with(Finish::Timber);
    let [width, depth, height] = TABLE;
    for (t, [x, y]) in TABLES.into_iter().enumerate() {
        stage.outline(x, y, x + width, y + depth);
        stage.block([x, y, height - 0.08], [x + width, y + depth, height], wood);
        stage.block([x + 0.05, y + 0.05, 0.12], [x + width - 0.05, y + depth - 0.05, height - 0.08], wood);
        stage.block(
            [x + 0.1, y + 0.1, 0.0],
            [x + width - 0.1, y + depth - 0.1, 0.12],
            Material::matt(0x33_302c),
        );
        for i in 0..3 {
            for j in 0..2 {
                let (colour, radius) = KINDS[(2 * t + 3 * i + 5 * j) % KINDS.len()];
                let corner = [x + 0.6 * i as f32, y + 0.6 * j as f32, height];
                add_crate(stage, &mut random, corner, Material::matt(colour).gloss(0.015), radius);
            }
        }
        let (px, py) = (x + 0.5 * width, y + 0.5 * depth);
        stage.rod([px, py, height], [px, py, height + 0.5], 0.008, Material::matt(0x55_5555));
        stage.block(
            [px - 0.14, py - 0.006, height + 0.42],
            [px + 0.14, py + 0.006, height + 0.62],
            Material::matt(0x2c_332e),
        );
    }
}

/// Adds a crate of 0.6 m x 0.6 m with a heap of fruit.
fn add_crate(stage: &mut Stage, random: &mut ChaCha8Rng, [x, y, z]: [f32; 3], fruit: Material, radius: f32) {
    /// Outer side of the crate, in metres.
    const SIDE: f32 = 0.575;
    /// Height of the crate, in metres.
    const HEIGHT: f32 = 0.2;
    /// Thickness of the crate's walls, in metres.
    const WALL: f32 = 0.015;
    let wood = Material::matt(0xc9_a877).with(Finish::Timber);
    let (a, b) = (x + 0.0125, y + 0.0125);
    for (low, high) in [(0.0, 0.09), (0.11, HEIGHT)] {
        stage.block([a, b, z + low], [a + SIDE, b + WALL, z + high], wood);
        stage.block([a, b + SIDE - WALL, z + low], [a + SIDE, b + SIDE, z + high], wood);
        stage.block([a, b, z + low], [a + WALL, b + SIDE, z + high], wood);
        stage.block([a + SIDE - WALL, b, z + low], [a + SIDE, b + SIDE, z + high], wood);
    }
    stage.block(
        [a + WALL, b + WALL, z],
        [a + SIDE - WALL, b + SIDE - WALL, z + HEIGHT - 1.6 * radius],
        Material::matt(0x4a_3a2c),
    );
    let free = SIDE - 2.0 * WALL;
    for layer in 0..2 {
        let inset = radius * (1.0 + 1.1 * layer as f32);
        let count = ((free - 2.0 * inset) / (1.98 * radius)).floor() as usize;
        let gap = (free - 2.0 * inset) / count.max(1) as f32;
        for i in 0..=count {
            for j in 0..=count {
                let mut off = || random.random_range(-0.18..0.18) * radius;
                let centre = [
                    a + WALL + inset + gap * i as f32 + off(),
                    b + WALL + inset + gap * j as f32 + off(),
                    z + HEIGHT - radius * 0.75 + 1.25 * radius * layer as f32 + off(),
                ];
                let ripe = random.random_range(0.8..1.12);
                stage.ball(
                    centre,
                    radius * random.random_range(0.93..1.05),
                    Material { colour: fruit.colour * ripe, ..fruit },
                );
            }
        }
    }
}
