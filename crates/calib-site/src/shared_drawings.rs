//! Which links and marks cameras show: looked up once for all of them.

use std::collections::BTreeMap;

use crate::document::{Site, SiteCamera};

/// What cameras share, by the ids of the cameras that show it.
#[derive(Debug)]
pub(crate) struct SharedDrawings<'a>(BTreeMap<&'a str, OfCamera>);

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
    pub(crate) fn of(site: &Site, cameras: &[&'a SiteCamera]) -> Self {
        // Few ids are found fast among few: one camera is solved by itself while an operator draws.
        let mut of: BTreeMap<&str, OfCamera> =
            cameras.iter().map(|camera| (camera.id.as_str(), OfCamera::default())).collect();
        for (index, camera) in site.cameras.iter().enumerate() {
            if let Some(own) = of.get_mut(camera.id.as_str()) {
                own.first.get_or_insert(index);
            }
        }
        for (index, link) in site.links.iter().enumerate().filter(|(_, link)| !link.off) {
            for seen in &link.seen {
                of.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push(&mut own.links, index));
            }
        }
        for (index, mark) in site.marks.iter().enumerate().filter(|(_, mark)| !mark.off) {
            for seen in &mark.seen {
                of.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push(&mut own.marks, index));
            }
        }
        Self(of)
    }

    /// The first entry of this id in the site, whatever its period.
    pub(crate) fn first<'b>(&self, site: &'b Site, id: &str) -> Option<&'b SiteCamera> {
        self.0.get(id)?.first.map(|index| &site.cameras[index])
    }

    /// Links that cameras of this id show, by their indices.
    pub(crate) fn links(&self, id: &str) -> &[usize] {
        self.0.get(id).map_or(&[], |own| &own.links)
    }

    /// Marks that cameras of this id show, by their indices.
    pub(crate) fn marks(&self, id: &str) -> &[usize] {
        self.0.get(id).map_or(&[], |own| &own.marks)
    }
}

/// Adds an index that is not the last already.
fn push(to: &mut Vec<usize>, index: usize) {
    if to.last() != Some(&index) {
        to.push(index);
    }
}
