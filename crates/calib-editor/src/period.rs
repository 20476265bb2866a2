//! Identity of a calibration period of a camera, independent of the index of the camera entry in the site.

use calib_site::{Site, SiteCamera};

/// Identity of a calibration period: several camera entries may have the same id, with different start times.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Period {
    /// Id of the camera.
    pub camera: String,
    /// Start of the period: `valid_from` of the camera entry.
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

    /// Returns the index of the camera entry with this period in a site.
    #[must_use]
    pub fn index(&self, site: &Site) -> Option<usize> {
        site.cameras.iter().position(|entry| self.matches(entry))
    }
}
