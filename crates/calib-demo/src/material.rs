//! Materials, and the colour at a point of a solid.

use crate::texture::{cell, chance, clouds, joint, step};
use crate::vector::{Vec3, vec3};

/// Material of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Material {
    /// Linear reflectance (red, green, blue), from 0 to 1.
    pub(crate) colour: Vec3,
    pub(crate) finish: Finish,
    /// Mirror reflectance at perpendicular incidence, from 0 to 1; 0 is matt.
    pub(crate) gloss: f32,
    /// Emitted light, relative to a well-lit white wall.
    pub(crate) glow: f32,
}

/// Pattern on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Finish {
    Plain,
    /// Square floor tiles with joints at the multiples of the pitch, in metres.
    Tiles {
        pitch: f32,
    },
    /// Cast concrete with saw cuts at multiples of the pitch along x, in metres.
    Concrete {
        pitch: f32,
    },
    Plaster,
    /// Ceiling panels at multiples of the pitch, in metres.
    Panels {
        pitch: f32,
    },
    /// Upright boards of this width, in metres.
    Boards {
        width: f32,
    },
    /// Sawn timber, grain along the longest side.
    Timber,
    Straw,
    /// Corrugated board with a strip of tape.
    Carton,
    /// A wrapper with a band of another colour.
    Label {
        band: Vec3,
    },
    /// Sheets with ribs of this pitch, in metres; the ribs are horizontal on walls.
    Ribs {
        pitch: f32,
    },
    /// Fur with black patches.
    Patches,
    /// Grass or leaves.
    Green,
}

/// Point on a solid, and the area that one pixel covers there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub(crate) point: Vec3,
    pub(crate) normal: Vec3,
    /// Position relative to the lower corner of the solid's bounds, in metres.
    pub(crate) local: Vec3,
    /// Size of the solid's bounds, in metres.
    pub(crate) size: Vec3,
    /// Seed that varies the pattern between solids of the same kind.
    pub(crate) seed: u32,
    /// Extent of one image pixel on the surface along each world axis, in metres.
    pub(crate) footprint: Vec3,
}

/// Converts a display colour `0xRRGGBB` to linear light.
pub(crate) fn paint(rgb: u32) -> Vec3 {
    let linear = |shift: u32| (((rgb >> shift) & 255) as f32 / 255.0).powf(2.2);
    vec3(linear(16), linear(8), linear(0))
}

impl Material {
    /// Returns matt paint of the colour `0xRRGGBB`.
    pub(crate) fn matt(rgb: u32) -> Self {
        Self { colour: paint(rgb), finish: Finish::Plain, gloss: 0.0, glow: 0.0 }
    }

    /// Returns the material with this pattern.
    pub(crate) fn with(self, finish: Finish) -> Self {
        Self { finish, ..self }
    }

    /// Returns the material with this mirror reflectance.
    pub(crate) const fn gloss(self, gloss: f32) -> Self {
        Self { gloss, ..self }
    }

    /// Returns the material with this emitted light.
    pub(crate) const fn glow(self, glow: f32) -> Self {
        Self { glow, ..self }
    }

    /// Returns the reflectance at a point of a solid.
    pub(crate) fn albedo(&self, s: &Surface) -> Vec3 {
        let width = s.footprint.x.max(s.footprint.y).max(s.footprint.z);
        match self.finish {
            Finish::Plain => self.colour,
            Finish::Tiles { pitch } => tiles(self.colour, pitch, s, width),
            Finish::Concrete { pitch } => concrete(self.colour, pitch, s, width),
            Finish::Plaster => self.colour * (1.0 + 0.05 * clouds(s.point, 1.6, width)),
            Finish::Panels { pitch } => {
                let x = joint(s.point.x, pitch, 0.024, s.footprint.x);
                let y = joint(s.point.y, pitch, 0.024, s.footprint.y);
                self.colour * (1.0 - 0.22 * x.max(y) + 0.03 * clouds(s.point, 0.05, width))
            }
            Finish::Boards { width: board } => boards(self.colour, board, s, width),
            Finish::Timber => timber(self.colour, s, width),
            Finish::Straw => straw(self.colour, s.point, width),
            Finish::Carton => carton(self.colour, s),
            Finish::Label { band } => label(self.colour, band, s),
            Finish::Ribs { pitch } => {
                let across = if s.normal.z.abs() > 0.5 {
                    (s.point.x, s.footprint.x)
                } else {
                    (s.point.z, s.footprint.z)
                };
                let groove = joint(across.0, pitch, 0.22 * pitch, across.1);
                let lit = joint(across.0 + 0.25 * pitch, pitch, 0.2 * pitch, across.1);
                self.colour * (1.0 - 0.35 * groove + 0.12 * lit + 0.04 * clouds(s.point, 0.9, width))
            }
            Finish::Patches => {
                let black =
                    step(0.02, 0.1, clouds(s.point + vec3(chance(s.seed) * 40.0, 0.0, 0.0), 0.55, width));
                self.colour.towards(paint(0x1a_1715), black)
            }
            Finish::Green => {
                self.colour * (1.0 + 0.5 * clouds(s.point, 0.09, width) + 0.25 * clouds(s.point, 3.0, width))
            }
        }
    }
}

fn tiles(colour: Vec3, pitch: f32, s: &Surface, width: f32) -> Vec3 {
    /// Width of the joints, in metres.
    const JOINT_WIDTH: f32 = 0.009;
    let each = chance(cell((s.point.x / pitch).floor() as i32, (s.point.y / pitch).floor() as i32, 7));
    let veins = clouds(s.point + Vec3::grey(each * 31.0), 0.5, width);
    let tile = colour * (1.0 + 0.07 * (each - 0.5) + 0.045 * veins);
    let x = joint(s.point.x, pitch, JOINT_WIDTH, s.footprint.x);
    let y = joint(s.point.y, pitch, JOINT_WIDTH, s.footprint.y);
    tile.towards(colour * vec3(0.30, 0.285, 0.27), (x + y - x * y).min(1.0))
}

fn concrete(colour: Vec3, pitch: f32, s: &Surface, width: f32) -> Vec3 {
    /// Width of the saw cuts, in metres.
    const CUT_WIDTH: f32 = 0.014;
    let stains = step(0.1, 0.55, clouds(s.point + vec3(3.1, 7.7, 0.0), 2.6, width));
    let grain = 0.10 * clouds(s.point, 0.8, width) + 0.06 * clouds(s.point, 0.06, width);
    let cut = joint(s.point.x, pitch, CUT_WIDTH, s.footprint.x);
    colour * ((1.0 + grain) * (1.0 - 0.22 * stains) * (1.0 - 0.6 * cut))
}

fn boards(colour: Vec3, board: f32, s: &Surface, width: f32) -> Vec3 {
    let (along, footprint) = if s.normal.y.abs() > s.normal.x.abs() {
        (s.point.x, s.footprint.x)
    } else {
        (s.point.y, s.footprint.y)
    };
    let each = chance(cell((along / board).floor() as i32, s.seed as i32, 3));
    let grain =
        clouds(vec3(s.point.x * 9.0, s.point.y * 9.0, s.point.z * 0.7 + each * 50.0), 0.6, width * 9.0);
    let gap = joint(along, board, 0.012, footprint);
    colour * ((0.86 + 0.28 * each + 0.16 * grain) * (1.0 - 0.7 * gap))
}

fn timber(colour: Vec3, s: &Surface, width: f32) -> Vec3 {
    let long = if s.size.x >= s.size.y && s.size.x >= s.size.z {
        vec3(0.8, 14.0, 14.0)
    } else if s.size.y >= s.size.z {
        vec3(14.0, 0.8, 14.0)
    } else {
        vec3(14.0, 14.0, 0.8)
    };
    let each = chance(s.seed);
    let grain = clouds(s.point * long + Vec3::grey(each * 60.0), 0.8, width * 14.0);
    colour * (0.9 + 0.2 * each + 0.2 * grain)
}

fn straw(colour: Vec3, p: Vec3, width: f32) -> Vec3 {
    let stalks: f32 = [(0.8, 0.6), (-0.5, 0.866), (0.97, -0.26)]
        .iter()
        .map(|&(c, s)| {
            clouds(vec3(p.x * c - p.y * s, (p.x * s + p.y * c) * 4.0, p.z * 3.0), 0.13, width * 2.5)
        })
        .sum();
    let trodden = clouds(p, 1.7, width);
    colour * (1.0 + 0.42 * stalks + 0.38 * trodden).max(0.15)
}

fn carton(colour: Vec3, s: &Surface) -> Vec3 {
    let each = 0.84 + 0.26 * chance(s.seed);
    let (across, level) = if s.normal.x.abs() > 0.5 { (s.local.y, s.size.y) } else { (s.local.x, s.size.x) };
    let tape = (across - 0.5 * level).abs() < 0.028 && (s.normal.z > 0.5 || s.local.z > 0.72 * s.size.z);
    let mark = s.normal.z < 0.5
        && (s.local.z / s.size.z - 0.4).abs() < 0.13
        && (across / level - 0.28).abs() < 0.13
        && chance(s.seed ^ 5) < 0.6;
    let edge = [(across, level), (s.local.z, s.size.z)].iter().any(|&(a, b)| a < 0.006 || b - a < 0.006);
    let tone = if tape {
        1.22
    } else if mark {
        0.55
    } else if edge {
        0.8
    } else {
        1.0
    };
    colour * (each * tone)
}

fn label(colour: Vec3, band: Vec3, s: &Surface) -> Vec3 {
    if s.normal.z.abs() > 0.7 {
        return colour * 0.9;
    }
    let up = s.local.z / s.size.z;
    let (across, level) = if s.normal.x.abs() > 0.7 { (s.local.y, s.size.y) } else { (s.local.x, s.size.x) };
    let low = 0.14 + 0.3 * chance(s.seed ^ 0x51);
    let high = low + 0.2 + 0.25 * chance(s.seed ^ 0x77);
    let in_band = up > low && up < high;
    let logo = (up - 0.8).abs() < 0.07 && (across / level - 0.5).abs() < 0.32;
    let print =
        in_band && (up - low) / (high - low) < 0.45 && ((across / level * 7.0 + up * 3.0).fract() < 0.5);
    if logo {
        band
    } else if print {
        band * 0.7
    } else if in_band {
        band
    } else {
        colour
    }
}
