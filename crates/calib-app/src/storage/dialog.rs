//! File chooser of the system, polled so that the frame continues, and the chosen files.

use std::task::{Context, Poll, Waker};
use std::time::Duration;

use calib_editor::FileResult;
use web_time::Instant;

use crate::choice::{Chosen, Purpose};
use crate::platform::{Answer, Here, Platform as _};
use crate::storage::files::site_text;

/// Smallest plausible time between opening a file chooser and closing it by hand. If a chooser closes earlier without
/// a file, the system is assumed to have no file chooser.
const MIN_OPEN_TIME: Duration = Duration::from_millis(400);

/// Open file chooser.
pub struct Dialog {
    /// Purpose of the files to choose.
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
    /// Opens the file chooser of the system.
    #[must_use]
    pub fn open(purpose: Purpose) -> Self {
        Self { purpose, opened: Some(Instant::now()), answer: Here::ask(purpose) }
    }

    /// Creates a chooser that is already answered, for tests and scripts.
    #[must_use]
    pub fn answered(purpose: Purpose, chosen: Vec<Chosen>) -> Self {
        Self { purpose, opened: None, answer: Box::pin(std::future::ready(chosen)) }
    }

    /// Creates a chooser that is closed at once, as on a system without a file chooser.
    #[must_use]
    pub fn refused(purpose: Purpose) -> Self {
        Self { opened: Some(Instant::now()), ..Self::answered(purpose, Vec::new()) }
    }

    /// Whether the chooser was opened so recently that no person can have closed it.
    #[must_use]
    pub fn is_just_opened(&self) -> bool {
        self.opened.is_some_and(|opened| opened.elapsed() < MIN_OPEN_TIME)
    }

    /// Returns the chosen files once the chooser is closed, an empty list if it was cancelled. `None` while it is
    /// open.
    pub fn poll(&mut self) -> Option<Vec<Chosen>> {
        let mut context = Context::from_waker(Waker::noop());
        match self.answer.as_mut().poll(&mut context) {
            Poll::Ready(chosen) => Some(chosen),
            Poll::Pending => None,
        }
    }
}

impl Chosen {
    /// Returns the content of the file.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn into_bytes(self) -> FileResult<Vec<u8>> {
        match (self.bytes, self.path) {
            (Some(bytes), _) => Ok(bytes),
            (None, Some(path)) => Here::read(&path),
            (None, None) => Err("the file cannot be read".into()),
        }
    }

    /// Returns the text of the file.
    ///
    /// # Errors
    /// When the file cannot be read or is not UTF-8.
    pub fn into_text(self) -> FileResult<String> {
        site_text(self.into_bytes()?)
    }
}
