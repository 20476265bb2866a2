//! What the still in hand proposes, as the view shows it.

use calib_editor::Proposed;
use egui::Context;

use super::{App, Mode};

impl App {
    /// What the still of the camera in hand proposes, where its image is what is looked at.
    #[must_use]
    pub fn shown_proposal(&self) -> Option<&Proposed> {
        self.editor.session().proposed().filter(|_| self.mode == Mode::Image)
    }

    /// Whether Enter and Escape mean the proposal: nothing is in the hand, and no button has the focus.
    pub(crate) fn decides_proposal(&self, ctx: &Context) -> bool {
        self.shown_proposal().is_some()
            && self.editor.tool().is_idle()
            && ctx.memory(|memory| memory.focused().is_none())
    }
}
