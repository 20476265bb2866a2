//! Which cameras have the lens of another one: looked up once for all of them.

use std::collections::BTreeMap;

use crate::document::{Site, SiteCamera};

/// The cameras that have the lens of another one, by the id of that one.
#[derive(Debug)]
pub(crate) struct SharedLenses<'a>(BTreeMap<&'a str, Vec<&'a SiteCamera>>);

impl<'a> SharedLenses<'a> {
    /// Of a site.
    pub(crate) fn of(site: &'a Site) -> Self {
        let mut sharing: BTreeMap<&str, Vec<&SiteCamera>> = BTreeMap::new();
        for camera in &site.cameras {
            if let Some(owner) = camera.lens.as_ref().and_then(|lens| lens.like.as_deref()) {
                sharing.entry(owner).or_default().push(camera);
            }
        }
        Self(sharing)
    }

    /// The cameras that have the lens of the one of this id.
    pub(crate) fn sharing(&self, id: &str) -> impl Iterator<Item = &'a SiteCamera> {
        self.0.get(id).into_iter().flatten().copied()
    }
}
