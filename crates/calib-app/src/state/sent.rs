//! What panels ask for in a frame, to be done at its end.

use std::path::PathBuf;

use calib_editor::{Action, Command};

use crate::state::{Decision, PathField};

/// What panels asked for in this frame.
#[derive(Debug)]
pub(crate) enum Sent {
    Action(Action),
    Command(Command),
    Recover(usize),
    Discard(usize),
    /// A site file is opened.
    OpenPath(PathBuf),
    /// What becomes of a file that is not written without asking.
    Decide(Decision),
    /// Whether images outside the site's folder are read.
    Outside(bool),
    /// A path was typed, or is not to be.
    Typed(Option<PathField>),
}
