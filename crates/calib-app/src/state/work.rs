//! Work that goes on beside the frame: images are read, edges looked for, lines proposed, cameras refined.

use std::sync::Arc;

use calib_editor::Action;
use calib_site::SiteCamera;
use egui::Context;

use super::App;
use crate::propose::Proposing;
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
            || self.proposing.is_some()
            || self.is_comparing()
            || self.pictures.loading() > 0
            || self.edges.looking() > 0
    }

    /// Whether something was asked for that changes the site when it comes.
    pub(crate) fn awaits(&self) -> bool {
        self.waiting() > 0
            || self.dialog.is_some()
            || self.refining.is_some()
            || self.proposing.is_some()
            || self.is_comparing()
            || !self.arriving.is_empty()
    }

    /// Waits no longer for images, edges and refined cameras.
    pub fn stop_work(&mut self) {
        if self.refining.take().is_some() {
            self.act(Action::Note("Cancelled: no camera was moved.".into()));
            return;
        }
        if self.proposing.take().is_some() {
            self.act(Action::Note("Cancelled: nothing is proposed.".into()));
            return;
        }
        if self.is_comparing() {
            self.stop_comparing();
            self.act(Action::Note(
                "Cancelled: newer stills were not compared, no camera was recovered.".into(),
            ));
            return;
        }
        let count = self.waiting();
        self.adding.clear();
        (self.replacing, self.planning) = (None, None);
        self.pictures.stop();
        self.edges.stop();
        self.act(Action::Note(match count {
            0 => "Cancelled. \u{201c}Read images again\u{201d} goes on with it.".into(),
            count => {
                let images = calib_site::counted(count, "image", "images");
                format!("Cancelled before {images} could be taken. Add again what is wanted.")
            }
        }));
    }

    /// Begins to improve all cameras together.
    pub(crate) fn refine(&mut self, ctx: &Context) {
        if self.refining.is_none() {
            self.refining = Some(Refining::begin(ctx, self.editor.site()));
        }
    }

    /// Begins to look for what the still of the camera in hand proposes.
    pub(crate) fn propose(&mut self) {
        let session = self.editor.session();
        let Some(entry) = session.entry() else { return };
        let (Some(camera), Some(image)) = (session.undrawn(), entry.image.clone()) else {
            let note = format!(
                "{} has no image: choose \u{201c}Replace the still of this camera\u{201d}.",
                entry.id
            );
            return self.act(Action::Note(note));
        };
        self.act(Action::Drop);
        self.proposing = Some(Proposing::new(camera, image));
    }

    pub(crate) fn poll_proposing(&mut self, ctx: &Context) {
        let Some(mut proposing) = self.proposing.take() else { return };
        let of = proposing.of();
        let camera = of.camera.clone();
        let is_asked =
            |entry: &SiteCamera| of.is_of(entry) && entry.image.as_deref() == Some(proposing.image());
        // A camera that is gone, or has another still by now, is not what was asked about.
        if !self.editor.site().cameras.iter().any(is_asked) {
            return;
        }
        if let Some(error) = self.pictures.error(proposing.image()) {
            let error = format!("{camera}: nothing is proposed without its image: {error}");
            return self.act(Action::Complain(error));
        }
        let picture = self.pictures.ready(proposing.image()).map(|picture| Arc::clone(&picture.image));
        match proposing.poll(ctx, picture.as_ref()) {
            Some(Ok(proposal)) => self.act(Action::Propose(of, Box::new(proposal))),
            Some(Err(error)) => {
                self.act(Action::Complain(format!("{camera}: looking for a proposal stopped: {error}")));
            }
            None => self.proposing = Some(proposing),
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
