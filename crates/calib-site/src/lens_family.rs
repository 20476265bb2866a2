//! Cameras that share one lens: what one of them shows tells of it for all, so they are calibrated together.

use crate::bundle_step::refine_lenses;
use crate::document::{Site, SiteCamera};
use crate::lens_cache::LensCache;
use crate::options::Options;
use crate::pipeline::Report;
use crate::points_outside::SharedDrawings;

/// The id of the camera whose lens a camera has.
fn owner(camera: &SiteCamera) -> &str {
    camera.lens.as_ref().and_then(|lens| lens.like.as_deref()).unwrap_or(&camera.id)
}

impl Site {
    /// The cameras, those that share a lens together: indices in the order of the site. Most are alone.
    #[must_use]
    pub fn lens_families(&self) -> Vec<Vec<usize>> {
        let mut families: Vec<(&str, Vec<usize>)> = Vec::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            match families.iter_mut().find(|(known, _)| *known == owner(camera)) {
                Some((_, family)) => family.push(index),
                None => families.push((owner(camera), vec![index])),
            }
        }
        families.into_iter().map(|(_, family)| family).collect()
    }

    /// Calibrates the cameras of a family (see [`Self::lens_families`]) as [`Self::calibrate`] does where it
    /// does not refine: their report, which says nothing of the site as a whole, and the lenses that need not
    /// be fitted again.
    ///
    /// It costs no more in a site of many cameras: the others are not looked at.
    #[must_use]
    pub fn calibrate_family(&self, family: &[usize], before: &LensCache) -> (Report, LensCache) {
        let options = Options { refine: false, ..Options::default() };
        let entries: Vec<&SiteCamera> = family.iter().filter_map(|&index| self.cameras.get(index)).collect();
        let lenses = self.lenses(&entries, before);
        let shared = SharedDrawings::of(self, &entries);
        let single_fits = self.single_fits(&entries, &lenses, &shared, &options);
        let refined = refine_lenses(&entries, &single_fits, self.plane_priors()).cameras;
        let mut report = Report::default();
        for (position, (&index, entry)) in family.iter().zip(&entries).enumerate() {
            let refined = refined.get(position).and_then(Option::as_ref);
            let result = self.finish(entry, &single_fits[position], refined, options.method, &shared);
            let (solution, findings) = self.to_document(index, result);
            report.cameras.push((index, solution));
            report.findings.push(findings);
        }
        (report, lenses)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::LensEntry;

    #[test]
    fn cameras_like_one_another_are_a_family() {
        let mut site = Site::new();
        site.cameras = ["a", "b", "c", "d"].map(|id| SiteCamera::new(id, [640, 480])).to_vec();
        for like in [0, 3] {
            site.cameras[like].lens = Some(LensEntry { like: Some("c".into()), ..LensEntry::default() });
        }
        assert_eq!(site.lens_families(), [vec![0, 2, 3], vec![1]]);
    }
}
