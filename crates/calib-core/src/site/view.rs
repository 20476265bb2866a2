//! The calibrated camera that an id, a time and a stream mean.

use std::fmt;

use crate::floor::{CameraView, Stream, StreamError};
use crate::site::document::{Site, SiteCamera};
use crate::site::period::NoCamera;
use crate::site::solution::FailureEntry;

/// Why there is no calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub enum NoView {
    /// The id means no entry.
    Camera(NoCamera),
    /// It is not calibrated, or could not be, and why.
    Uncalibrated(Option<FailureEntry>),
    /// Its lens is known, and nothing else.
    LensOnly,
    /// The stream does not go with its still.
    Stream(StreamError),
}

impl fmt::Display for NoView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera(why) => why.fmt(f),
            Self::Uncalibrated(None) => f.write_str("is not calibrated: solve the site first"),
            Self::Uncalibrated(Some(why)) => write!(f, "could not be calibrated: {why}"),
            Self::LensOnly => f.write_str(
                "is calibrated as far as its lens: draw lines that tell its focal and its lean, and solve the site again",
            ),
            Self::Stream(why) => why.fmt(f),
        }
    }
}

impl std::error::Error for NoView {}

impl Site {
    /// The calibrated camera of this id that holds at a time (RFC 3339), for the pixels of a stream.
    ///
    /// # Errors
    /// Why there is not one: see [`Site::camera_at`] and [`CameraView::with_stream`].
    pub fn view(&self, id: &str, time: Option<&str>, stream: Stream) -> Result<CameraView, NoView> {
        let view = self.view_of(self.camera_at(id, time).map_err(NoView::Camera)?)?;
        view.with_stream(stream).map_err(NoView::Stream)
    }

    /// Ids of the calibrated cameras, in the order of the file; an id of several periods once.
    #[must_use]
    pub fn calibrated(&self) -> Vec<&str> {
        let mut ids = Vec::new();
        for entry in self.cameras.iter().filter(|entry| entry.camera().is_some()) {
            if !ids.contains(&entry.id.as_str()) {
                ids.push(&entry.id);
            }
        }
        ids
    }

    /// A camera of this site with what it covers, for the pixels of its still.
    ///
    /// # Errors
    /// When it is not calibrated.
    pub fn view_of(&self, entry: &SiteCamera) -> Result<CameraView, NoView> {
        let camera = entry.camera().ok_or_else(|| match (&entry.error, &entry.solution) {
            (None, Some(_)) => NoView::LensOnly,
            (error, _) => NoView::Uncalibrated(error.clone()),
        })?;
        let view = CameraView::new(&camera, entry.size(), self.efov_on_floor(entry));
        Ok(view.with_surfaces(self.covering_surfaces()))
    }
}
