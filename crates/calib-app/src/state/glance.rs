//! How a newer still is looked at.

/// Which of two stills is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Showing {
    /// The old one on the left of a line, the newer one on its right.
    #[default]
    Wipe,
    /// Both by turns.
    Blink,
    /// The newer one.
    New,
    /// The old one.
    Old,
}

impl Showing {
    /// Every way, with its word.
    pub const ALL: [(Self, &str); 4] =
        [(Self::Wipe, "Wipe"), (Self::Blink, "Blink"), (Self::New, "New"), (Self::Old, "Old")];

    /// The next way.
    #[must_use]
    pub fn next(self) -> Self {
        let at = Self::ALL.iter().position(|(way, _)| *way == self).unwrap_or_default();
        Self::ALL[(at + 1) % Self::ALL.len()].0
    }
}

/// How a newer still is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glance {
    /// Which of the two is shown.
    pub showing: Showing,
    /// Where the line of a wipe stands, as a share of the width of the image.
    pub share: f32,
}

impl Default for Glance {
    fn default() -> Self {
        Self { showing: Showing::default(), share: 0.5 }
    }
}
