//! Why a command ends early, and with which exit code.

use std::fmt;

#[cfg(feature = "archives")]
use calib_table::TableError;

/// The end of a command that is not success.
#[derive(Debug)]
pub(crate) enum Stop {
    /// Something went wrong that is not the input's fault: 1.
    Failed(anyhow::Error),
    /// The command line asks for something that does not exist: 2.
    Usage(String),
    /// The input is invalid: 3.
    Invalid(String),
    /// A camera could not be solved or a gate failed; results are written: 4.
    Unsolved(String),
    /// A format cannot hold the calibration, and nobody agreed to that: 5.
    Lossy(String),
    /// The reader of our output has gone: success, silently.
    ReaderGone,
}

impl Stop {
    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Failed(_) => 1,
            Self::Usage(_) => 2,
            Self::Invalid(_) => 3,
            Self::Unsolved(_) => 4,
            Self::Lossy(_) => 5,
            Self::ReaderGone => 0,
        }
    }

    pub(crate) fn message(&self) -> Option<String> {
        match self {
            Self::Failed(error) => Some(format!("{error:#}")),
            Self::Usage(message)
            | Self::Invalid(message)
            | Self::Unsolved(message)
            | Self::Lossy(message) => Some(message.clone()),
            Self::ReaderGone => None,
        }
    }

    /// Why a table cannot be mapped.
    #[cfg(feature = "archives")]
    pub(crate) fn of_table(error: TableError) -> Self {
        match error {
            TableError::Usage(what) => Self::Usage(what),
            TableError::Invalid(what) => Self::Invalid(what),
            TableError::Unsolved(what) => Self::Unsolved(what),
            TableError::Arrow(error) => error.into(),
        }
    }

    /// A failure with what was being done; ends of other kinds say all that there is.
    pub(crate) fn while_doing(self, what: impl FnOnce() -> String) -> Self {
        match self {
            Self::Failed(error) => Self::Failed(error.context(what())),
            other => other,
        }
    }

    /// Invalid input in a file.
    pub(crate) fn invalid(file: impl fmt::Display, what: impl fmt::Display) -> Self {
        Self::Invalid(format!("{file}: {what}"))
    }
}

impl<E: Into<anyhow::Error>> From<E> for Stop {
    fn from(error: E) -> Self {
        let error = error.into();
        let is_gone = |e: &std::io::Error| e.kind() == std::io::ErrorKind::BrokenPipe;
        if error.chain().any(|cause| cause.downcast_ref().is_some_and(is_gone)) {
            return Self::ReaderGone;
        }
        Self::Failed(error)
    }
}
