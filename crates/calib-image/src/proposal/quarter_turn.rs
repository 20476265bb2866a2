//! Rotation of the edges of an image by quarter turns, so that cameras that hang upside down or on their side are
//! searched as upright cameras.
//!
//! With the roll r, the nadir is in the direction (sin r, cos r) of the image (right, down). A rotation by r, with the
//! matrix `[cos r, -sin r; sin r, cos r]`, moves it to the bottom.

use calib_core::{Annotation, BrownConrady, Distortion, Lens, Pixel};
use calib_site::PrincipalPointEntry;

use super::strokes::Group;
use crate::bars::Bars;
use crate::line_segment::LineSegment;

/// Rotation by quarter turns about the centre of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct QuarterTurn {
    /// Number of quarter turns, 0 to 3.
    turns: u8,
    /// Width and height before the rotation, in pixels.
    size: [u32; 2],
}

impl QuarterTurn {
    /// Returns the rotation that is nearest to a roll, in degrees.
    pub(super) fn of_roll(roll_deg: f64, size: [u32; 2]) -> Self {
        Self { turns: (roll_deg / 90.0).round().rem_euclid(4.0) as u8 % 4, size }
    }

    pub(super) const fn is_none(&self) -> bool {
        self.turns == 0
    }

    /// Whether width and height change places.
    pub(super) const fn is_on_side(&self) -> bool {
        self.turns % 2 == 1
    }

    /// Returns the angle, in radians.
    pub(super) fn angle(&self) -> f64 {
        f64::from(self.turns) * std::f64::consts::FRAC_PI_2
    }

    /// Returns the rotation back.
    pub(super) const fn inverse(&self) -> Self {
        Self { turns: (4 - self.turns) % 4, size: self.turned_size() }
    }

    /// Returns width and height after the rotation, in pixels.
    pub(super) const fn turned_size(&self) -> [u32; 2] {
        let [width, height] = self.size;
        if self.is_on_side() { [height, width] } else { [width, height] }
    }

    /// Rotates a pixel.
    pub(super) fn pixel(&self, at: Pixel) -> Pixel {
        let ([w, h], [to_w, to_h]) = (self.size.map(f64::from), self.turned_size().map(f64::from));
        let (x, y) = (at.u - 0.5 * w, at.v - 0.5 * h);
        let (x, y) = match self.turns {
            1 => (-y, x),
            2 => (-x, -y),
            3 => (y, -x),
            _ => (x, y),
        };
        Pixel::new(0.5 * to_w + x, 0.5 * to_h + y)
    }

    /// Rotates an edge; its rise keeps its sign.
    pub(super) fn segment(&self, segment: &LineSegment) -> LineSegment {
        LineSegment { ends: segment.ends.map(|end| self.pixel(end)), ..*segment }
    }

    /// Rotates the bars at the sides.
    pub(super) const fn bars(&self, bars: Bars) -> Bars {
        let Bars { left, right, top, bottom } = bars;
        match self.turns {
            1 => Bars { top: left, right: top, bottom: right, left: bottom },
            2 => Bars { right: left, bottom: top, left: right, top: bottom },
            3 => Bars { bottom: left, left: top, top: right, right: bottom },
            _ => bars,
        }
    }

    pub(super) fn principal_point(&self, entry: PrincipalPointEntry) -> PrincipalPointEntry {
        PrincipalPointEntry { value: self.pixel(entry.value), ..entry }
    }

    /// Rotates a lens; `None` if its distortion is not symmetric about the axis, or if its pixels are not square.
    pub(super) fn lens(&self, lens: &Lens) -> Option<Lens> {
        let is_symmetric = match lens.distortion {
            Distortion::BrownConrady(BrownConrady { p1, p2, .. }) => [p1, p2] == [0.0; 2],
            Distortion::Unified(unified) => unified.tangential == [0.0; 2],
            Distortion::None
            | Distortion::Division { .. }
            | Distortion::KannalaBrandt { .. }
            | Distortion::Eucm { .. }
            | Distortion::DoubleSphere { .. } => true,
            Distortion::Rational(_) => false,
        };
        let is_square = lens.pixel_aspect == 1.0 || !self.is_on_side();
        (is_symmetric && is_square).then(|| Lens {
            principal_point: self.pixel(lens.principal_point),
            image_circle: None,
            ..*lens
        })
    }

    /// Rotates the segments of an annotation.
    fn annotation(&self, annotation: &mut Annotation) {
        annotation.segments.iter_mut().flatten().flatten().for_each(|at| *at = self.pixel(*at));
    }

    /// Rotates suggested annotations.
    pub(super) fn groups(&self, groups: &mut [Group]) {
        groups.iter_mut().for_each(|group| self.annotation(&mut group.annotation));
    }

    /// Rotates polylines.
    pub(super) fn polylines(&self, lines: &mut [Vec<Pixel>]) {
        lines.iter_mut().flatten().for_each(|at| *at = self.pixel(*at));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nadir_of_a_roll_moves_to_the_bottom() {
        for roll_deg in [0.0, 88.0, 90.0, 180.0, -90.0, 270.0, -181.0, 1e9] {
            let turn = QuarterTurn::of_roll(roll_deg, [640, 480]);
            let (sin, cos) = (90.0 * (roll_deg / 90.0).round()).to_radians().sin_cos();
            let to = turn.pixel(Pixel::new(320.0 + 10.0 * sin, 240.0 + 10.0 * cos));
            let [w, h] = turn.turned_size().map(f64::from);
            assert!(to.distance(Pixel::new(0.5 * w, 0.5 * h + 10.0)) < 1e-4, "{roll_deg}: {to:?}");
            let back = turn.inverse().pixel(turn.pixel(Pixel::new(3.0, 5.0)));
            assert!(back.distance(Pixel::new(3.0, 5.0)) < 1e-9);
        }
    }

    #[test]
    fn bars_move_with_the_picture() {
        let bars = Bars { left: 1, top: 2, right: 3, bottom: 4 };
        for turns in 0..4 {
            let turn = QuarterTurn { turns, size: [100, 80] };
            let turned = turn.bars(bars);
            let [w, h] = turn.turned_size().map(f64::from);
            // The middle of the picture between the bars is the same point.
            let middle = |bars: Bars, w: f64, h: f64| {
                let [l, r, t, b] = [bars.left, bars.right, bars.top, bars.bottom].map(f64::from);
                Pixel::new(0.5 * (l + w - r), 0.5 * (t + h - b))
            };
            let moved = turn.pixel(middle(bars, 100.0, 80.0));
            assert!(moved.distance(middle(turned, w, h)) < 1e-9, "{turns}: {turned:?}");
        }
    }
}
