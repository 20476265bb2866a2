//! The step of the tour that a newcomer has come to.

/// How far a newcomer has come.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tour {
    pub(crate) step: Option<usize>,
}

impl Tour {
    /// Begins at the first step.
    #[must_use]
    pub const fn begun() -> Self {
        Self { step: Some(0) }
    }
}
