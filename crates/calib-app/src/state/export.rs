//! State of the export sheet: the request and its result.

use calib_formats::{Export, FORMATS, Format};

use crate::platform::Task;

/// Request for an export: format, options, and generation of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Asked {
    pub(crate) format: usize,
    pub(crate) extension: usize,
    pub(crate) rectified: bool,
    /// Index of the only camera to export; `None` for all cameras.
    pub(crate) one: Option<usize>,
    pub(crate) generation: u64,
    pub(crate) has_plan: bool,
}

/// Exported files, or the reason why the export failed.
pub(crate) type Outcome = Result<Export, String>;

/// Export sheet: the request, its result, and the consent to losses.
#[derive(Debug, Default)]
pub struct Sheet {
    pub(crate) is_open: bool,
    pub(crate) format: usize,
    pub(crate) extension: usize,
    pub(crate) rectified: bool,
    pub(crate) only_this: bool,
    /// Whether the operator accepted that the export loses data.
    pub(crate) agreed: bool,
    /// Request of the running or finished export.
    pub(crate) asked: Option<Asked>,
    /// Export that is running.
    pub(crate) making: Option<Task<Outcome>>,
    /// Result of the last export.
    pub(crate) made: Option<Outcome>,
}

impl Sheet {
    /// Opens the export sheet with the last format and default options.
    pub fn open(&mut self) {
        *self = Self { is_open: true, format: self.format, ..Self::default() };
    }

    /// Selects the export format with this name.
    pub fn choose(&mut self, name: &str) {
        if let Some(index) = formats().position(|format| format.name == name) {
            (self.format, self.extension) = (index, 0);
        }
    }

    /// Closes the export sheet; returns whether the sheet was open.
    pub fn close(&mut self) -> bool {
        self.making = None;
        std::mem::take(&mut self.is_open)
    }

    /// Returns the files to write, if the export loses nothing or the operator accepted the losses.
    pub(crate) fn files(&self) -> Option<&[calib_formats::File]> {
        let export = self.made.as_ref()?.as_ref().ok()?;
        (self.agreed || export.losses.is_empty()).then_some(export.files.as_slice())
    }
}

/// Returns the formats that can be exported.
pub(crate) fn formats() -> impl Iterator<Item = &'static Format> {
    FORMATS.iter().filter(|format| format.can_export())
}
