//! What panels ask for in a frame, to be done at its end.

use calib_editor::{Action, Command};

/// What panels asked for in this frame.
#[derive(Debug)]
pub(crate) enum Sent {
    Action(Action),
    Command(Command),
    Recover(usize),
    Discard(usize),
}
