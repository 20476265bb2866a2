//! The system's file chooser, asked without holding up the frame, and what is in the files it is closed with.

use std::task::{Context, Poll, Waker};
use std::time::Duration;

use calib_editor::FileResult;
use web_time::Instant;

use crate::choice::{Chosen, Purpose};
use crate::platform::{Answer, Here, Platform as _};

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

    /// A chooser that the system does not have: it is closed as soon as it is opened.
    #[must_use]
    pub fn refused(purpose: Purpose) -> Self {
        Self { opened: Some(Instant::now()), ..Self::answered(purpose, Vec::new()) }
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

impl Chosen {
    /// What is in the file.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn into_bytes(self) -> FileResult<Vec<u8>> {
        match (self.bytes, self.path) {
            (Some(bytes), _) => Ok(bytes),
            (None, Some(path)) => Here::read(&path),
            (None, None) => Err("cannot be read".into()),
        }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// When it cannot be read or is no text.
    pub fn into_text(self) -> FileResult<String> {
        String::from_utf8(self.into_bytes()?).map_err(|_| "not text".into())
    }
}
