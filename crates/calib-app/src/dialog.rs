//! The system's file chooser, asked without holding up the frame.

use std::path::PathBuf;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use web_time::Instant;

use crate::platform::{Answer, Here, Platform as _};

/// What the chosen files are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A site to open.
    OpenSite,
    /// Where to save the site.
    SaveSite,
    /// Where to save the site without its images.
    SavePlain,
    /// Stills of new cameras.
    AddImages,
    /// The floor plan.
    LoadPlan,
    /// Another still of the camera in hand.
    ReplaceStill,
    /// A saved version to compare with.
    Compare,
    /// Lenses or cameras of another program.
    Import,
    /// The folder for what other programs take.
    Export,
    /// Where to save a picture of a view.
    SavePicture,
}

/// A file that was chosen.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Its name without folders.
    pub name: String,
    /// Where it is; not in the browser.
    pub path: Option<PathBuf>,
    /// What is in it; only in the browser.
    pub bytes: Option<Vec<u8>>,
}

/// Nobody closes a chooser faster.
const UNSEEN: Duration = Duration::from_millis(400);

/// A chooser that is open.
pub struct Dialog {
    /// What for.
    pub purpose: Purpose,
    opened: Option<Instant>,
    answer: Answer,
}

impl std::fmt::Debug for Dialog {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dialog").field("purpose", &self.purpose).finish_non_exhaustive()
    }
}

impl Dialog {
    /// Opens a chooser.
    #[must_use]
    pub fn open(purpose: Purpose) -> Self {
        Self { purpose, opened: Some(Instant::now()), answer: Here::ask(purpose) }
    }

    /// A chooser that was answered before it was opened: for tests and scripts.
    #[must_use]
    pub fn answered(purpose: Purpose, chosen: Vec<Chosen>) -> Self {
        Self { purpose, opened: None, answer: Box::pin(std::future::ready(chosen)) }
    }

    /// Whether it has been open for so short a time that nobody can have seen it.
    #[must_use]
    pub fn is_just_opened(&self) -> bool {
        self.opened.is_some_and(|opened| opened.elapsed() < UNSEEN)
    }

    /// What was chosen, once the operator is done; nothing if the chooser was closed.
    pub fn poll(&mut self) -> Option<Vec<Chosen>> {
        let mut context = Context::from_waker(Waker::noop());
        match self.answer.as_mut().poll(&mut context) {
            Poll::Ready(chosen) => Some(chosen),
            Poll::Pending => None,
        }
    }
}

/// Endings of stills.
pub(crate) const IMAGES: &[&str] = &["png", "jpg", "jpeg"];
/// Endings of plans.
pub(crate) const PLANS: &[&str] = &["png", "jpg", "jpeg", "svg"];
/// Endings of sites.
pub(crate) const SITE: &[&str] = &["json"];
