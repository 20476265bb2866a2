//! Requests of panels, carried out at the end of the frame.

use std::path::PathBuf;

use calib_editor::{Action, Command};

use crate::state::{Decision, PathField};

/// Request of a panel for the end of the frame.
#[derive(Debug)]
pub(crate) enum Sent {
    Action(Action),
    Command(Command),
    Recover(usize),
    Discard(usize),
    /// Opens a site file.
    OpenPath(PathBuf),
    /// Carries out the decision about a file that would be overwritten.
    Decide(Decision),
    /// Reads (true) or skips (false) the images outside the site's folder.
    Outside(bool),
    /// Handles a typed path; `None` closes the field.
    Typed(Option<PathField>),
}
