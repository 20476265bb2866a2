//! Which links and marks cameras show, and which have the lens of another: looked up once for all of them.

use std::collections::BTreeMap;

use crate::site::document::{Site, SiteCamera};

/// What cameras share, by the ids of the cameras that show it.
#[derive(Debug)]
pub(crate) struct SharedDrawings<'a> {
    by_id: BTreeMap<&'a str, OfCamera>,
    /// Cameras that have the lens of another one, by its id.
    alike: BTreeMap<&'a str, Vec<usize>>,
}

/// What cameras of one id show; what is switched off does not count.
#[derive(Clone, Debug, Default)]
struct OfCamera {
    /// The first entry of this id, whatever its period.
    first: Option<usize>,
    links: Vec<usize>,
    marks: Vec<usize>,
}

impl<'a> SharedDrawings<'a> {
    /// Of these cameras of a site.
    pub(crate) fn of(site: &'a Site, cameras: &[&'a SiteCamera]) -> Self {
        // Few ids are found fast among few: one camera is solved by itself while an operator draws.
        let mut by_id: BTreeMap<&str, OfCamera> =
            cameras.iter().map(|camera| (camera.id.as_str(), OfCamera::default())).collect();
        let mut alike: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (index, camera) in site.cameras.iter().enumerate() {
            if let Some(own) = by_id.get_mut(camera.id.as_str()) {
                own.first.get_or_insert(index);
            }
            if let Some(owner) = camera.lens.as_ref().and_then(|lens| lens.like.as_deref()) {
                alike.entry(owner).or_default().push(index);
            }
        }
        for (index, link) in site.links.iter().enumerate().filter(|(_, link)| !link.off) {
            for seen in &link.seen {
                by_id.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push(&mut own.links, index));
            }
        }
        for (index, mark) in site.marks.iter().enumerate().filter(|(_, mark)| !mark.off) {
            for seen in &mark.seen {
                by_id.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push(&mut own.marks, index));
            }
        }
        Self { by_id, alike }
    }

    /// The first entry of this id in the site, whatever its period.
    pub(crate) fn first<'b>(&self, site: &'b Site, id: &str) -> Option<&'b SiteCamera> {
        self.by_id.get(id)?.first.map(|index| &site.cameras[index])
    }

    /// The cameras that have the lens of the one of this id.
    pub(crate) fn alike<'b>(&self, site: &'b Site, id: &str) -> impl Iterator<Item = &'b SiteCamera> {
        self.alike.get(id).into_iter().flatten().map(|&index| &site.cameras[index])
    }

    /// Links that cameras of this id show, by their indices.
    pub(crate) fn links(&self, id: &str) -> &[usize] {
        self.by_id.get(id).map_or(&[], |own| &own.links)
    }

    /// Marks that cameras of this id show, by their indices.
    pub(crate) fn marks(&self, id: &str) -> &[usize] {
        self.by_id.get(id).map_or(&[], |own| &own.marks)
    }
}

/// Adds an index that is not the last already.
fn push(to: &mut Vec<usize>, index: usize) {
    if to.last() != Some(&index) {
        to.push(index);
    }
}
