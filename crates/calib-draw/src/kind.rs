//! How lines of every kind look. A new kind has its row here; no painter changes.

use calib_core::Kind;

use crate::colour::Rgb;
use crate::sign::{self, SQUARE, Sign};

/// A row of the table.
#[derive(Clone, Copy, Debug)]
pub struct KindLook {
    /// Which kind.
    pub kind: Kind,
    /// On images, and on dark grounds.
    pub colour: Rgb,
    /// The same hue on a light ground.
    pub on_light: Rgb,
    /// Lengths of strokes and gaps; solid if empty.
    pub dash: &'static [f64],
    /// What tells the kind without its colour.
    pub sign: Sign,
}

/// The look of every kind, in the order of `calib_core::single::KINDS`.
pub const KIND_LOOKS: [KindLook; calib_core::single::KINDS.len()] = {
    const fn row(kind: Kind, [colour, on_light]: [u32; 2], sign: Sign) -> KindLook {
        KindLook { kind, colour: Rgb::hex(colour), on_light: Rgb::hex(on_light), dash: &[], sign }
    }
    [
        row(Kind::Vertical, [0x5BB8F5, 0x0B76B8], sign::ARROW),
        row(Kind::Parallel, [0xFFB020, 0xA86B00], sign::CHEVRONS),
        row(Kind::Perpendicular, [0x38D391, 0x0B8A55], SQUARE),
        row(Kind::EqualLength, [0xF48FC3, 0xB83A80], sign::TICKS),
        row(Kind::KnownLength, [0xF2DF4A, 0x857300], sign::ENDS),
        row(Kind::Straight, [0xEEF1F4, 0x3C444C], sign::NONE),
        row(Kind::Upright, [0xFF7F57, 0xC4401B], sign::FOOT_AND_HEAD),
    ]
};

impl KindLook {
    /// The row of a kind.
    #[must_use]
    pub fn of(kind: Kind) -> &'static Self {
        &KIND_LOOKS[kind as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_its_row_and_a_colour_of_its_own() {
        let mut colours = std::collections::HashSet::new();
        for row in &calib_core::single::KINDS {
            let look = KindLook::of(row.kind);
            assert_eq!(look.kind, row.kind);
            assert!(colours.insert(look.colour), "{} looks like another kind", row.name);
        }
    }
}
