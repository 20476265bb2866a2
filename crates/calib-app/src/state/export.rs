//! What other programs are to be given: what is asked for, and what has been made of it.

use calib_formats::{Export, FORMATS, Format};

use crate::platform::Task;

/// What is asked for, and from which state of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Asked {
    pub(crate) format: usize,
    pub(crate) extension: usize,
    pub(crate) rectified: bool,
    pub(crate) one: Option<usize>,
    pub(crate) generation: u64,
    pub(crate) has_plan: bool,
}

/// What the making of it ended with.
pub(crate) type Outcome = Result<Export, String>;

/// The sheet: what is asked for, what it gives, and whether its losses are agreed to.
#[derive(Debug, Default)]
pub struct Sheet {
    pub(crate) is_open: bool,
    pub(crate) format: usize,
    pub(crate) extension: usize,
    pub(crate) rectified: bool,
    pub(crate) only_this: bool,
    pub(crate) agreed: bool,
    pub(crate) asked: Option<Asked>,
    pub(crate) making: Option<Task<Outcome>>,
    pub(crate) made: Option<Outcome>,
}

impl Sheet {
    /// Opens it.
    pub fn open(&mut self) {
        *self = Self { is_open: true, format: self.format, ..Self::default() };
    }

    /// Asks for the format of this name.
    pub fn choose(&mut self, name: &str) {
        if let Some(index) = formats().position(|format| format.name == name) {
            (self.format, self.extension) = (index, 0);
        }
    }

    /// Closes it. Whether it was open.
    pub fn close(&mut self) -> bool {
        self.making = None;
        std::mem::take(&mut self.is_open)
    }

    /// The files that may be written: there is nothing that is lost without a word.
    pub(crate) fn files(&self) -> Option<&[calib_formats::File]> {
        let export = self.made.as_ref()?.as_ref().ok()?;
        (self.agreed || export.losses.is_empty()).then_some(export.files.as_slice())
    }
}

/// The formats that can be written.
pub(crate) fn formats() -> impl Iterator<Item = &'static Format> {
    FORMATS.iter().filter(|format| format.can_export())
}
