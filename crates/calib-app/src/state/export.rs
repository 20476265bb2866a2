//! State of the export sheet: the request and its result.

use calib_formats::{Export, FORMATS, Format};

use crate::platform::Task;

/// Requested format and options, with the generation of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Asked {
    pub(crate) format: usize,
    pub(crate) extension: usize,
    pub(crate) rectified: bool,
    pub(crate) one: Option<usize>,
    pub(crate) generation: u64,
    pub(crate) has_plan: bool,
}

/// Result of an export.
pub(crate) type Outcome = Result<Export, String>;

/// Export sheet: the request, its result, and the consent to losses.
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
    /// Opens the sheet.
    pub fn open(&mut self) {
        *self = Self { is_open: true, format: self.format, ..Self::default() };
    }

    /// Selects a format by its name.
    pub fn choose(&mut self, name: &str) {
        if let Some(index) = formats().position(|format| format.name == name) {
            (self.format, self.extension) = (index, 0);
        }
    }

    /// Closes the sheet; returns whether it was open.
    pub fn close(&mut self) -> bool {
        self.making = None;
        std::mem::take(&mut self.is_open)
    }

    /// Returns the files to write, if nothing is lost or the operator accepted the losses.
    pub(crate) fn files(&self) -> Option<&[calib_formats::File]> {
        let export = self.made.as_ref()?.as_ref().ok()?;
        (self.agreed || export.losses.is_empty()).then_some(export.files.as_slice())
    }
}

/// Returns the formats that can be exported.
pub(crate) fn formats() -> impl Iterator<Item = &'static Format> {
    FORMATS.iter().filter(|format| format.can_export())
}
