//! Which period of which camera something is of, whatever is done to the list of cameras meanwhile.

use calib_site::{Site, SiteCamera};

/// A period of a camera: an id may repeat, with another time from which it holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Period {
    /// The id of the camera.
    pub camera: String,
    /// Its `valid_from`.
    pub from: Option<String>,
}

impl Period {
    /// That of an entry.
    #[must_use]
    pub fn of(entry: &SiteCamera) -> Self {
        Self { camera: entry.id.clone(), from: entry.valid_from.clone() }
    }

    /// Whether an entry is of it.
    #[must_use]
    pub fn is_of(&self, entry: &SiteCamera) -> bool {
        (&self.camera, &self.from) == (&entry.id, &entry.valid_from)
    }

    /// The index of its entry.
    #[must_use]
    pub fn index(&self, site: &Site) -> Option<usize> {
        site.cameras.iter().position(|entry| self.is_of(entry))
    }
}
