//! The building: walls with doors and windows, floors, ceilings, columns, roof. The plan uses the same lists.

use crate::material::{Finish, Material};
use crate::shape::Shape;
use crate::stage::{Lamp, Stage};
use crate::vector::vec3;

/// Filling of a hole in a wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Filling {
    /// Closed door leaf, hinged at the end with the lower coordinate. If `positive`, it opens toward the
    /// positive side of the wall, otherwise toward the negative side.
    Door { positive: bool },
    /// Closed shutter.
    Shutter,
    /// Glass, or an open hole.
    Open,
}

/// Hole in a wall, in metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Opening {
    /// Range of the opening along the wall.
    pub(crate) span: [f32; 2],
    /// Height of the lower edge of the opening above the floor.
    pub(crate) sill: f32,
    pub(crate) head: f32,
    pub(crate) filling: Filling,
}

/// Wall with its longer side along x or y, in metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wall {
    /// Footprint: x0, y0, x1, y1.
    pub(crate) foot: [f32; 4],
    pub(crate) height: f32,
    pub(crate) openings: &'static [Opening],
}

impl Wall {
    /// Whether the wall runs along x.
    pub(crate) fn is_along_x(&self) -> bool {
        let [x0, y0, x1, y1] = self.foot;
        x1 - x0 > y1 - y0
    }

    /// Returns the footprint (x0, y0, x1, y1) of the part of the wall between two coordinates along it.
    pub(crate) fn stretch(&self, from: f32, to: f32) -> [f32; 4] {
        let [x0, y0, x1, y1] = self.foot;
        if self.is_along_x() { [from, y0, to, y1] } else { [x0, from, x1, to] }
    }
}

const fn hole(from: f32, to: f32, sill: f32, head: f32, filling: Filling) -> Opening {
    Opening { span: [from, to], sill, head, filling }
}

const fn window(from: f32, to: f32) -> Opening {
    hole(from, to, 0.9, 3.3, Filling::Open)
}

const fn vent(from: f32) -> Opening {
    hole(from, from + 3.0, 1.9, 2.9, Filling::Open)
}

/// All walls of the building.
pub(crate) static WALLS: [Wall; 9] = [
    Wall {
        foot: [-0.3, 14.4, 30.3, 14.7],
        height: 4.9,
        openings: &[
            hole(2.4, 4.8, 0.0, 2.7, Filling::Open),
            window(7.2, 10.8),
            window(12.0, 15.6),
            window(16.8, 20.4),
            window(26.0, 28.4),
        ],
    },
    Wall { foot: [-0.3, -0.3, 0.0, 14.4], height: 4.9, openings: &[] },
    Wall {
        foot: [0.0, -0.3, 30.0, 0.0],
        height: 4.9,
        openings: &[hole(13.2, 14.4, 0.0, 2.1, Filling::Door { positive: true })],
    },
    Wall {
        foot: [24.0, 0.0, 24.2, 14.4],
        height: 4.9,
        openings: &[hole(6.0, 7.2, 0.0, 2.1, Filling::Door { positive: false })],
    },
    Wall {
        foot: [24.2, 8.4, 30.0, 8.6],
        height: 4.9,
        openings: &[hole(27.6, 28.6, 0.0, 2.1, Filling::Door { positive: true })],
    },
    Wall {
        foot: [30.0, -0.3, 30.3, 14.4],
        height: 4.9,
        openings: &[hole(2.4, 5.4, 0.0, 3.0, Filling::Shutter)],
    },
    Wall {
        foot: [30.0, -12.5, 30.3, -0.3],
        height: 6.2,
        openings: &[hole(-7.9, -4.6, 0.0, 3.3, Filling::Open)],
    },
    Wall {
        foot: [-0.3, -12.5, 30.0, -12.2],
        height: 3.6,
        openings: &[vent(2.0), vent(7.0), vent(12.0), vent(17.0), vent(22.0), vent(26.4)],
    },
    Wall {
        foot: [-0.3, -12.2, 0.0, -0.3],
        height: 6.2,
        openings: &[hole(-7.9, -4.6, 0.0, 3.3, Filling::Shutter)],
    },
];

/// Half the width of a column, in metres.
pub(crate) const COLUMN: f32 = 0.2;
/// Centres of the columns of the shop, in metres.
pub(crate) const COLUMNS: [[f32; 2]; 4] = [[4.2, 9.6], [13.2, 9.6], [13.2, 4.8], [20.4, 9.6]];
/// Height of the shop's ceiling, in metres.
pub(crate) const CEILING: f32 = 4.6;
/// Pitch of the shop's tiles, in metres; a joint runs through world (0, 0).
pub(crate) const TILE: f32 = 0.6;
/// Ridge of the barn: y and z, in metres.
pub(crate) const RIDGE: [f32; 2] = [-6.25, 6.0];
/// Height of the barn's eaves, in metres.
const EAVES: f32 = 3.4;

/// Adds the building to the stage.
pub(crate) fn build(stage: &mut Stage) {
    add_floors(stage);
    for wall in &WALLS {
        build_wall(stage, wall);
    }
    add_linings(stage);
    add_columns(stage);
    add_ceilings(stage);
    add_roof(stage);
    add_surroundings(stage);
}

fn plaster() -> Material {
    Material::matt(0xe9_e5dc).with(Finish::Plaster)
}

fn steel() -> Material {
    Material::matt(0x4a_4f54).gloss(0.03)
}

fn add_floors(stage: &mut Stage) {
    let tiles = Material::matt(0xc9_c3b8).with(Finish::Tiles { pitch: TILE }).gloss(0.05);
    stage.block([0.0, 0.0, -0.2], [24.0, 14.4, 0.0], tiles);
    let store = Material::matt(0xa3_a19b).with(Finish::Concrete { pitch: 2.8 }).gloss(0.02);
    stage.block([24.2, 0.0, -0.2], [30.0, 14.4, 0.0], store);
    let barn = Material::matt(0x9c_978c).with(Finish::Concrete { pitch: 2.5 });
    stage.block([0.0, -12.2, -0.2], [30.0, -0.3, 0.0], barn);
}

fn build_wall(stage: &mut Stage, wall: &Wall) {
    let paint = plaster();
    let [x0, y0, x1, y1] = wall.foot;
    let (mut here, end) = if wall.is_along_x() { (x0, x1) } else { (y0, y1) };
    let mut part = |from: f32, to: f32, low: f32, high: f32| {
        let [x0, y0, x1, y1] = wall.stretch(from, to);
        if to > from && high > low {
            stage.block([x0, y0, low], [x1, y1, high], paint);
        }
    };
    for opening in wall.openings {
        let [from, to] = opening.span;
        part(here, from, -0.2, wall.height);
        part(from, to, -0.2, opening.sill);
        part(from, to, opening.head, wall.height);
        here = to;
    }
    part(here, end, -0.2, wall.height);
    for opening in wall.openings {
        add_opening(stage, wall, opening);
    }
}

/// Adds the frame of an opening to the stage, and its leaf, shutter or bars. The frame projects from both
/// faces of the wall.
fn add_opening(stage: &mut Stage, wall: &Wall, opening: &Opening) {
    /// Width of the frame in the plane of the wall, in metres.
    const FRAME_WIDTH: f32 = 0.07;
    /// Distance by which the frame projects from each face of the wall, in metres.
    const FRAME_PROJECTION: f32 = 0.02;
    let [from, to] = opening.span;
    let frame = if opening.filling == Filling::Open { steel() } else { Material::matt(0x6c_7378) };
    let mut piece = |a: f32, b: f32, low: f32, high: f32, proud: f32, material: Material| {
        let [x0, y0, x1, y1] = wall.stretch(a, b);
        let (px, py) = if wall.is_along_x() { (0.0, proud) } else { (proud, 0.0) };
        stage.block([x0 - px, y0 - py, low], [x1 + px, y1 + py, high], material);
    };
    piece(from, from + FRAME_WIDTH, opening.sill, opening.head, FRAME_PROJECTION, frame);
    piece(to - FRAME_WIDTH, to, opening.sill, opening.head, FRAME_PROJECTION, frame);
    piece(from, to, opening.head - FRAME_WIDTH, opening.head, FRAME_PROJECTION, frame);
    let (a, b) = (from + FRAME_WIDTH, to - FRAME_WIDTH);
    match opening.filling {
        Filling::Door { .. } => {
            let leaf = Material::matt(0x8f_a3a0).gloss(0.02);
            piece(a, b, 0.01, opening.head - FRAME_WIDTH, -0.03, leaf);
            piece(b - 0.16, b - 0.06, 1.0, 1.06, 0.03, steel());
        }
        Filling::Shutter => {
            let sheet = Material::matt(0xb9_bfc2).with(Finish::Ribs { pitch: 0.12 });
            piece(a, b, 0.0, opening.head - FRAME_WIDTH, -0.06, sheet);
        }
        Filling::Open if opening.sill > 0.0 => {
            piece(from, to, opening.sill, opening.sill + 0.05, 0.06, Material::matt(0xd8_d5ce));
            let bars = ((to - from) / 1.2).round().max(1.0) as usize;
            for i in 1..bars {
                let middle = from + (to - from) * i as f32 / bars as f32;
                piece(middle - 0.03, middle + 0.03, opening.sill, opening.head, -0.1, steel());
            }
        }
        Filling::Open => {}
    }
}

/// Adds the linings of the walls: the skirting and the coloured band of the shop, and the boards of the barn.
fn add_linings(stage: &mut Stage) {
    /// Thickness of the skirting, in metres.
    const THICKNESS: f32 = 0.02;
    let skirting = Material::matt(0x7d_7a75);
    let [w, d] = [24.0, 14.4];
    for (a, b) in [(0.0, 13.2), (14.4, w)] {
        stage.block([a, 0.0, 0.0], [b, THICKNESS, 0.12], skirting);
    }
    for (a, b) in [(0.0, 2.4), (4.8, w)] {
        stage.block([a, d - THICKNESS, 0.0], [b, d, 0.12], skirting);
    }
    stage.block([0.0, 0.0, 0.0], [THICKNESS, d, 0.12], skirting);
    for (a, b) in [(0.0, 6.0), (7.2, d)] {
        stage.block([w - THICKNESS, a, 0.0], [w, b, 0.12], skirting);
    }
    let band = Material::matt(0x5f_7f5c);
    stage.block([0.0, 0.0, 3.55], [w, 0.015, 4.1], band);
    stage.block([0.0, 0.0, 3.55], [0.015, d, 4.1], band);
    stage.block([w - 0.015, 0.0, 3.55], [w, d, 4.1], band);
    let boards = Material::matt(0x9a_7b57).with(Finish::Boards { width: 0.2 });
    stage.block([0.0, -0.34, 0.9], [30.0, -0.3, 3.7], boards);
    for (a, b) in
        [(0.0, 2.0), (5.0, 7.0), (10.0, 12.0), (15.0, 17.0), (20.0, 22.0), (25.0, 26.4), (29.4, 30.0)]
    {
        stage.block([a, -12.2, 0.9], [b, -12.16, 3.6], boards);
    }
    for (a, b) in [(-12.2, -8.0), (-4.5, -0.3)] {
        stage.block([29.96, a, 0.9], [30.0, b, 6.2], boards);
    }
    stage.block([29.96, -8.0, 3.4], [30.0, -4.5, 6.2], boards);
}

fn add_columns(stage: &mut Stage) {
    let paint = Material::matt(0xdd_d9d0);
    for [x, y] in COLUMNS {
        stage.block([x - COLUMN, y - COLUMN, 0.0], [x + COLUMN, y + COLUMN, CEILING], paint);
        for (half, low, high, rgb) in
            [(COLUMN + 0.012, 0.0, 0.12, 0x7d_7a75), (COLUMN + 0.006, 2.5, 2.75, 0x5f_7f5c)]
        {
            stage.block([x - half, y - half, low], [x + half, y + half, high], Material::matt(rgb));
        }
    }
}

fn add_ceilings(stage: &mut Stage) {
    let panels = Material::matt(0xe6_e5e1).with(Finish::Panels { pitch: 0.6 });
    stage.block([0.0, 0.0, CEILING], [24.0, 14.4, 4.9], panels);
    stage.block([24.2, 0.0, 4.0], [30.0, 14.4, 4.9], Material::matt(0xd9_d7d2));
    for y in [2.7, 7.2, 11.7] {
        for x in [2.4, 7.2, 12.0, 16.8, 21.6] {
            add_lamp(stage, [x, y, CEILING], [0.9, 0.15], 16.0);
        }
    }
    for y in [2.2, 6.2] {
        add_lamp(stage, [27.1, y, 4.0], [0.9, 0.15], 13.0);
    }
    for x in [7.5, 12.5, 17.5, 22.5] {
        add_lamp(stage, [x, RIDGE[0], 4.1], [0.7, 0.12], 12.0);
        stage.rod([x, RIDGE[0], 4.2], [x, RIDGE[0], 5.9], 0.012, steel());
    }
}

/// Adds a luminaire. `top` is the centre of its upper side, and `hx` and `hy` are its half lengths, in
/// metres.
fn add_lamp(stage: &mut Stage, top: [f32; 3], [hx, hy]: [f32; 2], radiance: f32) {
    /// Thickness of the housing, in metres.
    const THICKNESS: f32 = 0.06;
    let [x, y, z] = top;
    stage.block(
        [x - hx - 0.03, y - hy - 0.03, z - THICKNESS],
        [x + hx + 0.03, y + hy + 0.03, z],
        Material::matt(0xee_eeee),
    );
    let low = z - THICKNESS - 0.01;
    stage.block([x - hx, y - hy, low], [x + hx, y + hy, z - THICKNESS], Material::matt(0xff_ffff).glow(4.0));
    let colour = vec3(1.0, 0.965, 0.91);
    stage.lamps.push(Lamp { centre: vec3(x, y, low - 0.005), half: [hx, hy], radiance: colour * radiance });
}

/// Adds the two slopes of the roof. The slope toward the shop has gaps for daylight.
fn add_roof(stage: &mut Stage) {
    let sheet = Material::matt(0x8d_9094).with(Finish::Ribs { pitch: 0.3 });
    let [ridge_y, ridge_z] = RIDGE;
    for (eaves_y, gaps) in [(-0.15, true), (-12.35, false)] {
        let mut strip = |x0: f32, x1: f32, from: f32, to: f32| {
            let (run, rise) = (ridge_y - eaves_y, ridge_z - EAVES);
            let slope = run.hypot(rise);
            let (down, up) = (
                vec3(0.0, run / slope, rise / slope),
                vec3(0.0, -rise / slope * run.signum(), run.abs() / slope),
            );
            let middle =
                vec3(0.5 * (x0 + x1), eaves_y, EAVES) + down * (0.5 * (from + to) * slope) + up * 0.05;
            let half = vec3(0.5 * (x1 - x0), 0.5 * (to - from) * slope, 0.04);
            stage.add(
                Shape::RotatedBox { centre: middle, axes: [vec3(1.0, 0.0, 0.0), down, up], half },
                sheet,
            );
        };
        strip(-0.4, 30.4, 0.0, if gaps { 0.22 } else { 1.01 });
        if gaps {
            strip(-0.4, 30.4, 0.8, 1.01);
            for i in 0..6 {
                let x = 5.0 * i as f32;
                let x0 = if i == 0 { -0.4 } else { x - 1.8 };
                strip(x0, if i == 5 { 30.4 } else { x + 1.8 }, 0.22, 0.8);
            }
        }
    }
}

/// Adds the surroundings in view of windows and gate: paving, a lawn, hedges, trees.
fn add_surroundings(stage: &mut Stage) {
    let paving = Material::matt(0xa8_a49c).with(Finish::Concrete { pitch: 1.0 });
    let lawn = Material::matt(0xa3_b088).with(Finish::Green);
    stage.block([-0.3, 14.7, -0.3], [30.3, 22.0, -0.02], paving);
    stage.block([30.3, -12.5, -0.3], [36.0, 14.7, -0.02], paving);
    stage.block([-90.0, -90.0, -0.6], [120.0, 120.0, -0.3], lawn);
    stage.block([-20.0, 26.0, -0.3], [40.0, 27.2, 1.6], Material::matt(0x74_8563).with(Finish::Green));
    stage.block([48.0, -30.0, -0.3], [49.5, 6.0, 1.8], Material::matt(0x74_8563).with(Finish::Green));
    for (x, y, s) in [
        (3.0, 38.0, 3.2),
        (14.0, 41.0, 3.8),
        (27.0, 37.0, 3.0),
        (62.0, -9.0, 4.0),
        (70.0, 2.0, 4.5),
        (58.0, -2.0, 3.0),
    ] {
        stage.ball([x, y, 1.2 * s], s, Material::matt(0x82_9272).with(Finish::Green));
        stage.rod([x, y, -0.3], [x, y, s], 0.12 * s, Material::matt(0x5b_4a3a));
    }
}
