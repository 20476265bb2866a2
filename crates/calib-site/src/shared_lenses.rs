//! Index of the cameras that share the lens of another camera.

use std::collections::BTreeMap;

use crate::document::{Site, SiteCamera};

/// Cameras that share the lens of another camera, by the id of the lens owner.
#[derive(Debug)]
pub(crate) struct SharedLenses<'a>(BTreeMap<&'a str, Vec<&'a SiteCamera>>);

impl<'a> SharedLenses<'a> {
    /// Builds the index for all cameras of a site.
    pub(crate) fn new(site: &'a Site) -> Self {
        let mut sharing: BTreeMap<&str, Vec<&SiteCamera>> = BTreeMap::new();
        for camera in &site.cameras {
            if let Some(owner) = camera.lens.as_ref().and_then(|lens| lens.like.as_deref()) {
                sharing.entry(owner).or_default().push(camera);
            }
        }
        Self(sharing)
    }

    /// Returns the cameras that share the lens of the camera with this id.
    pub(crate) fn sharing(&self, id: &str) -> impl Iterator<Item = &'a SiteCamera> {
        self.0.get(id).into_iter().flatten().copied()
    }
}
