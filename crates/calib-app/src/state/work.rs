//! Work that goes on beside the frame: images are read, edges looked for, cameras refined.

use calib_editor::Action;
use egui::Context;

use super::App;
use crate::refine::Refining;

impl App {
    /// How many files were chosen and are not taken yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.adding.len() + usize::from(self.replacing.is_some()) + usize::from(self.planning.is_some())
    }

    /// Whether images are being read, edges looked for, cameras refined.
    #[must_use]
    pub fn is_working(&self) -> bool {
        self.waiting() > 0
            || self.refining.is_some()
            || self.pictures.loading() > 0
            || self.edges.looking() > 0
    }

    /// Whether something was asked for that changes the site when it comes.
    pub(crate) fn awaits(&self) -> bool {
        self.waiting() > 0 || self.dialog.is_some() || self.refining.is_some() || !self.arriving.is_empty()
    }

    /// Waits no longer for images, edges and refined cameras.
    pub fn stop_work(&mut self) {
        if self.refining.take().is_some() {
            self.act(Action::Note("Cancelled: no camera was moved.".into()));
            return;
        }
        let count = self.waiting();
        self.adding.clear();
        (self.replacing, self.planning) = (None, None);
        self.pictures.stop();
        self.edges.stop();
        self.act(Action::Note(match count {
            0 => "Cancelled. \u{201c}Read images again\u{201d} goes on with it.".into(),
            count => format!("Cancelled: {count} images were not taken. Add them again if they are wanted."),
        }));
    }

    /// Begins to improve all cameras together.
    pub(crate) fn refine(&mut self, ctx: &Context) {
        if self.refining.is_none() {
            self.refining = Some(Refining::begin(ctx, self.editor.site()));
        }
    }

    pub(crate) fn poll_refining(&mut self) {
        let Some(refining) = self.refining.take() else { return };
        match refining.poll() {
            Some(Ok(refined)) => self.act(Action::Refined(Box::new((refining.from.clone(), refined)))),
            Some(Err(error)) => self.act(Action::Complain(format!("Refining stopped: {error}"))),
            None => self.refining = Some(refining),
        }
    }
}
