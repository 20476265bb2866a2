//! The command palette: whether it is open, what was typed, and which row is lit.

/// The palette: what was typed, and which row is lit.
#[derive(Clone, Debug, Default)]
pub struct Palette {
    pub(crate) is_open: bool,
    pub(crate) query: String,
    pub(crate) row: usize,
}

impl Palette {
    /// Opens it empty, or closes it.
    pub fn toggle(&mut self) {
        *self = Self { is_open: !self.is_open, ..Self::default() };
    }

    /// Closes it.
    pub const fn close(&mut self) {
        self.is_open = false;
    }

    /// Whether it is open.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }
}
