//! Appearance of every kind of line. A new kind that is drawn as lines needs only an entry in [`KIND_LOOKS`].
//! Another shape also needs items in `image/annotation.rs`.
//!
//! Small signs distinguish the kinds without colour. They have constant screen size; a painter places them on
//! its line with [`place_sign`].

use calib_core::Kind;

use crate::colour::Rgb;

/// Shape of a part of a sign. Points are (along, across) the line in screen points; radii are in screen
/// points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SignShape {
    /// Line through these points.
    Stroke(&'static [[f64; 2]]),
    /// Convex area with these corners.
    Fill(&'static [[f64; 2]]),
    /// Ring with this radius.
    Ring(f64),
    /// Disc with this radius.
    Disc(f64),
}

/// Position of a part of a sign on its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignPosition {
    /// First point of the line.
    First,
    /// Middle of the line.
    Middle,
    /// Middle of the line. The part is reversed if needed, so that it points down the image.
    MiddleDown,
    /// Last point of the line.
    Last,
}

/// Sign as a list of parts. Coordinates are in screen points: along the line, and across it to the right of
/// its direction.
pub type Sign = &'static [(SignPosition, SignShape)];

/// Empty sign, for kinds that are distinguished by their shape.
pub(crate) const NONE: Sign = &[];
/// Arrow that points down the image, for verticals.
pub(crate) const ARROW: Sign =
    &[(SignPosition::MiddleDown, SignShape::Fill(&[[4.0, 0.0], [-4.0, 4.0], [-4.0, -4.0]]))];
/// Two chevrons along the line, for parallels.
pub(crate) const CHEVRONS: Sign = &[
    (SignPosition::Middle, SignShape::Stroke(&[[-7.0, 4.0], [-3.0, 0.0], [-7.0, -4.0]])),
    (SignPosition::Middle, SignShape::Stroke(&[[-2.0, 4.0], [2.0, 0.0], [-2.0, -4.0]])),
];
/// Right-angle sign, for perpendiculars.
pub(crate) const SQUARE: Sign =
    &[(SignPosition::Middle, SignShape::Stroke(&[[0.0, 0.0], [0.0, -10.0], [10.0, -10.0], [10.0, 0.0]]))];
/// Right-angle sign next to the chevrons, for a direction at right angles to another one.
pub(crate) const SQUARE_OFFSET: Sign =
    &[(SignPosition::Middle, SignShape::Stroke(&[[6.0, 0.0], [6.0, -8.0], [14.0, -8.0], [14.0, 0.0]]))];
/// Two ticks across the line, for lines of equal length.
pub(crate) const TICKS: Sign = &[
    (SignPosition::Middle, SignShape::Stroke(&[[-2.0, 5.0], [-2.0, -5.0]])),
    (SignPosition::Middle, SignShape::Stroke(&[[2.0, 5.0], [2.0, -5.0]])),
];
/// Ticks at both ends, for lines of known length.
pub(crate) const ENDS: Sign = &[
    (SignPosition::First, SignShape::Stroke(&[[0.0, 6.0], [0.0, -6.0]])),
    (SignPosition::Last, SignShape::Stroke(&[[0.0, 6.0], [0.0, -6.0]])),
];
/// Ring at the foot and disc at the head, for uprights.
pub(crate) const FOOT_AND_HEAD: Sign =
    &[(SignPosition::First, SignShape::Ring(7.0)), (SignPosition::Last, SignShape::Disc(5.0))];

/// Part of a sign placed on a line, in canvas units.
#[derive(Clone, Debug, PartialEq)]
pub enum PlacedShape {
    /// Line through these points.
    Stroke(Vec<[f64; 2]>),
    /// Convex area with these corners.
    Fill(Vec<[f64; 2]>),
    /// Ring: centre and radius.
    Ring([f64; 2], f64),
    /// Disc: centre and radius.
    Disc([f64; 2], f64),
}

/// Places a sign on the line from `a` to `b`, in canvas units; `scale` is the length of a screen point in
/// these units.
#[must_use]
pub fn place_sign(sign: Sign, [a, b]: [[f64; 2]; 2], scale: f64) -> Vec<PlacedShape> {
    let by = [b[0] - a[0], b[1] - a[1]];
    let size = scale / by[0].hypot(by[1]).max(1.0);
    sign.iter().map(|&(position, shape)| place_shape(position, shape, [a, b], size, scale)).collect()
}

/// Places a part of a sign on the line from `a` to `b`. `size` is the length of a screen point divided by the
/// length of the line; `scale` is the length of a screen point on the canvas.
fn place_shape(
    position: SignPosition,
    shape: SignShape,
    [a, b]: [[f64; 2]; 2],
    size: f64,
    scale: f64,
) -> PlacedShape {
    let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    let turn = if position == SignPosition::MiddleDown && dy < 0.0 { -1.0 } else { 1.0 };
    let about = match position {
        SignPosition::First => a,
        SignPosition::Middle | SignPosition::MiddleDown => [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])],
        SignPosition::Last => b,
    };
    let at = |[along, across]: [f64; 2]| {
        let (along, across) = (turn * along, turn * across);
        [about[0] + size * (along * dx - across * dy), about[1] + size * (along * dy + across * dx)]
    };
    match shape {
        SignShape::Stroke(points) => PlacedShape::Stroke(points.iter().map(|&point| at(point)).collect()),
        SignShape::Fill(points) => PlacedShape::Fill(points.iter().map(|&point| at(point)).collect()),
        SignShape::Ring(radius) => PlacedShape::Ring(about, scale * radius),
        SignShape::Disc(radius) => PlacedShape::Disc(about, scale * radius),
    }
}

/// Appearance of the annotations of one kind.
#[derive(Clone, Copy, Debug)]
pub struct KindLook {
    /// Kind of the annotations.
    pub kind: Kind,
    /// Colour on images and dark backgrounds.
    pub colour: Rgb,
    /// Colour on light backgrounds: the same hue, darker.
    pub on_light: Rgb,
    /// Lengths of dashes and gaps, in screen points; empty for a solid line.
    pub dash: &'static [f64],
    /// Sign that identifies the kind without colour.
    pub sign: Sign,
}

/// Appearance of every kind, in the order of `calib_core::single::KINDS`.
pub const KIND_LOOKS: [KindLook; calib_core::single::KINDS.len()] = {
    /// Creates the table entry of a kind from its colours (`0xRRGGBB`, for dark and light backgrounds) and
    /// its sign.
    const fn row(kind: Kind, [colour, on_light]: [u32; 2], sign: Sign) -> KindLook {
        KindLook { kind, colour: Rgb::hex(colour), on_light: Rgb::hex(on_light), dash: &[], sign }
    }
    [
        row(Kind::Vertical, [0x5BB8F5, 0x0B76B8], ARROW),
        row(Kind::Parallel, [0xFFB020, 0xA86B00], CHEVRONS),
        row(Kind::Perpendicular, [0x38D391, 0x0B8A55], SQUARE),
        row(Kind::EqualLength, [0xF48FC3, 0xB83A80], TICKS),
        row(Kind::KnownLength, [0xF2DF4A, 0x857300], ENDS),
        row(Kind::Straight, [0xEEF1F4, 0x3C444C], NONE),
        row(Kind::Upright, [0xFF7F57, 0xC4401B], FOOT_AND_HEAD),
    ]
};

impl KindLook {
    /// Returns the appearance of a kind.
    #[must_use]
    pub fn of(kind: Kind) -> &'static Self {
        &KIND_LOOKS[kind as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sign_stays_near_its_line_and_scales_with_the_canvas() {
        let (a, b) = ([100.0, 50.0], [160.0, 130.0]);
        for look in &KIND_LOOKS {
            for scale in [1.0, 3.0] {
                for part in place_sign(look.sign, [a, b], scale) {
                    let (PlacedShape::Stroke(points) | PlacedShape::Fill(points)) = part else { continue };
                    for [x, y] in points {
                        let beside = [a, b, [130.0, 90.0]].map(|[u, v]| (x - u).hypot(y - v));
                        assert!(beside.iter().any(|&far| far < 15.0 * scale), "{:?}", look.kind);
                    }
                }
            }
        }
    }

    #[test]
    fn the_arrow_of_a_vertical_points_down_for_both_orders_of_its_ends() {
        let ends = [[10.0, 90.0], [12.0, 10.0]];
        for [a, b] in [ends, [ends[1], ends[0]]] {
            let [PlacedShape::Fill(points)] = &place_sign(ARROW, [a, b], 1.0)[..] else { panic!("one area") };
            let tip = points[0];
            assert!(points.iter().all(|point| point[1] <= tip[1]));
        }
    }

    #[test]
    fn every_kind_has_a_row_and_a_unique_colour() {
        let mut colours = std::collections::HashSet::new();
        for row in &calib_core::single::KINDS {
            let look = KindLook::of(row.kind);
            assert_eq!(look.kind, row.kind);
            assert!(colours.insert(look.colour), "{} looks like another kind", row.name);
        }
    }
}
