//! A person as a camera shows them.

use calib_core::camera::Pixel;

/// A person as a camera shows them, in pixels of its still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Nanoseconds since 1970.
    pub at: i64,
    /// Index of the camera.
    pub camera: usize,
    /// The middle of the lower edge of the box.
    pub foot: Pixel,
    /// The middle of its upper edge; `None` where only the foot is known.
    pub head: Option<Pixel>,
    /// Width of the box; 0 where only the foot is known.
    pub width: f64,
    /// By what a tracker calls them, where it does: one number, one person, for as long as they are in view.
    pub person: Option<u64>,
}

impl Sighting {
    /// Height of the box; without a box that of a person at a middle distance.
    pub(crate) fn tall(&self) -> f64 {
        /// Pixels.
        const USUAL: f64 = 150.0;
        self.head.map_or(USUAL, |head| (self.foot.v - head.v).max(1.0))
    }

    /// Standard deviation of the foot, in pixels: boxes are drawn the worse the larger they are.
    pub(crate) fn foot_sigma(&self) -> f64 {
        /// Share of the height of a box.
        const OF_BOX: f64 = 0.03;
        /// Pixels.
        const LEAST: f64 = 1.5;
        LEAST + OF_BOX * self.tall()
    }

    /// Whether the box ends at the border of an image of this size, and so may not hold the whole person.
    pub(crate) fn is_cut(&self, [w, h]: [f64; 2]) -> bool {
        /// Pixels.
        const MARGIN: f64 = 2.0;
        let Some(head) = self.head else { return false };
        let half = 0.5 * self.width;
        let (left, right) = (head.u.min(self.foot.u) - half, head.u.max(self.foot.u) + half);
        left < MARGIN || right > w - MARGIN || head.v < MARGIN || self.foot.v > h - MARGIN
    }
}
