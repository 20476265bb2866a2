//! Identity of a calibration period of a camera, independent of its index in the list.

use calib_site::{Site, SiteCamera};

/// Calibration period of a camera: an id may occur again with another start time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Period {
    /// Id of the camera.
    pub camera: String,
    /// `valid_from` of the entry.
    pub from: Option<String>,
}

impl Period {
    /// Returns the period of a camera entry.
    #[must_use]
    pub fn from_camera(entry: &SiteCamera) -> Self {
        Self { camera: entry.id.clone(), from: entry.valid_from.clone() }
    }

    /// Whether a camera entry has this period.
    #[must_use]
    pub fn matches(&self, entry: &SiteCamera) -> bool {
        (&self.camera, &self.from) == (&entry.id, &entry.valid_from)
    }

    /// Returns the index of its entry in a site.
    #[must_use]
    pub fn index(&self, site: &Site) -> Option<usize> {
        site.cameras.iter().position(|entry| self.matches(entry))
    }
}
