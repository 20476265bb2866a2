//! Newer images of the cameras, and the results of comparing them with the calibrated images.
//!
//! Newer images are stored outside the site and its undo history. Recovering a camera replaces its image by
//! the newer one. Undo restores the old image, with which the newer one was compared.

use std::collections::BTreeSet;
use std::path::Path;

use calib_core::Camera;

use calib_image::{CameraChange, Comparison};
use calib_input::{second_in_name, time_in_name};
use calib_site::{Recovered, Site, SiteCamera};

use crate::images::camera_name;
use crate::session::Session;

/// Newer image of a camera, with the result of the comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct NewerImage {
    /// Id of the camera, and every id that it had since the comparison, because a rename may be undone.
    pub ids: BTreeSet<String>,
    /// `valid_from` and `valid_to` of the camera entry that was compared.
    pub period: [Option<String>; 2],
    /// Name in the site of the calibrated image with which the newer one was compared.
    pub old: Option<String>,
    /// Name of the newer image in the site.
    pub image: String,
    /// Name of the newer image for the operator.
    pub title: String,
    /// Time from which the camera has its new pose (RFC 3339): the capture time of the image, or as entered
    /// by the operator; empty if unknown.
    pub since: String,
    /// Capture times in the EXIF data of the calibrated image and of the newer one (RFC 3339).
    pub captured: [Option<String>; 2],
    /// Calibrated pose and lens of the camera, the reference of the comparison.
    pub pose: Camera,
    /// Result of the comparison.
    pub comparison: Comparison,
}

impl NewerImage {
    /// Whether the comparison belongs to this camera entry: same calibration period and same image.
    #[must_use]
    pub fn is_of(&self, entry: &SiteCamera) -> bool {
        let is_period = self.period.each_ref().map(Option::as_ref)
            == [entry.valid_from.as_ref(), entry.valid_to.as_ref()];
        self.ids.contains(&entry.id) && self.old == entry.image && entry.image.is_some() && is_period
    }

    /// Whether two newer images were compared with the same camera entry.
    #[must_use]
    pub fn is_same_camera(&self, other: &Self) -> bool {
        (&self.old, &self.period) == (&other.old, &other.period) && !self.ids.is_disjoint(&other.ids)
    }

    /// Whether the image was taken before another newer image; false if a time is unknown.
    #[must_use]
    pub fn is_before(&self, other: &Self) -> bool {
        let [own, other] = [&self.since, &other.since].map(|time| nanoseconds(time.trim()));
        own.zip(other).is_some_and(|(own, other)| own < other)
    }

    /// Whether the camera was rotated or zoomed at an unchanged position, or its image shows a part of the old
    /// one. Its calibration can then be recovered.
    #[must_use]
    pub fn has_moved(&self) -> bool {
        matches!(self.comparison.change, CameraChange::Moved | CameraChange::Windowed)
    }
}

/// Returns the start of the validity of a calibration, in seconds since 1970: its `valid_from`, otherwise the
/// capture time in the name of its image.
#[must_use]
pub fn valid_since(session: &Session, camera: usize) -> Option<u64> {
    let entry = session.site.cameras.get(camera)?;
    let of_still = || {
        let name = session.images.shown_name(entry.image.as_deref()?);
        time_in_name(&camera_name(Path::new(&name)))
    };
    let valid_from = entry.valid_from.clone().or_else(of_still)?;
    u64::try_from(nanoseconds(&valid_from)? / 1_000_000_000).ok()
}

/// Returns the time (RFC 3339) in the name of an image of the session, if the name contains the time to the second.
pub(crate) fn image_time(session: &Session, image: &str) -> Option<String> {
    second_in_name(&session.images.shown_name(image))
}

impl From<&NewerImage> for NewerUnderPointer {
    fn from(newer: &NewerImage) -> Self {
        Self { image: newer.image.clone(), change: newer.comparison.change }
    }
}

/// Converts a time (RFC 3339) to nanoseconds since 1970; `None` if it is invalid.
pub(crate) fn nanoseconds(time: &str) -> Option<i64> {
    let entry = SiteCamera { valid_from: Some(time.to_owned()), ..SiteCamera::new("", [1, 1]) };
    entry.period_ns().ok().map(|[from, _]| from)
}

/// Newer image of a camera, if the canvas shows it under the pointer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewerUnderPointer {
    /// Name under which the session stores the newer image.
    pub image: String,
    /// Change of the camera since its calibration.
    pub change: CameraChange,
}

/// Action on newer images of cameras.
#[derive(Clone, Debug)]
pub enum NewerAction {
    /// Stores the result of a comparison; it replaces an older result of the same camera.
    Compared(Box<NewerImage>),
    /// Sets the time from which the newer image of the selected camera applies.
    SetSince(String),
    /// Removes the newer image of the selected camera.
    Dismiss,
    /// Applies the recovery of the camera with this id. The pair contains the site from which it was
    /// computed, and the result.
    Recovered(String, Box<(Site, Recovered)>),
}
