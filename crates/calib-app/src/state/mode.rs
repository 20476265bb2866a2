//! What the middle of the window shows.

/// What the middle of the window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The image of the camera in hand.
    #[default]
    Image,
    /// Image and plan.
    Plan,
    /// Every camera at once.
    All,
    /// The site in space.
    Scene,
}
