//! Requests of panels, carried out at the end of the frame.

use std::path::PathBuf;

use calib_editor::{Action, Command};

use crate::state::{Decision, PathField};

/// Request of a panel.
#[derive(Debug)]
pub(crate) enum Sent {
    Action(Action),
    Command(Command),
    Recover(usize),
    Discard(usize),
    /// Opens a site file.
    OpenPath(PathBuf),
    /// Decides about a file that would be overwritten.
    Decide(Decision),
    /// Decides whether images outside the site's folder are read.
    Outside(bool),
    /// Takes a typed path, or cancels.
    Typed(Option<PathField>),
}
