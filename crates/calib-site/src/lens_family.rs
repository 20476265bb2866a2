//! Lens families: cameras that share one lens. They are calibrated together, because edges in each image
//! constrain the same lens.

use crate::document::{Site, SiteCamera};
use crate::lens_cache::LensCache;
use crate::options::Options;
use crate::pipeline::Report;
use crate::points_outside::SharedObservations;
use crate::reliability::add_to_annotations;
use crate::solution::Stage;

/// Returns the id of the camera that owns the lens of this camera.
fn owner(camera: &SiteCamera) -> &str {
    camera.lens.as_ref().and_then(|lens| lens.like.as_deref()).unwrap_or(&camera.id)
}

impl Site {
    /// Groups the cameras by shared lens. Each group has camera indices in the order of the site; most groups
    /// have one camera.
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

    /// Calibrates the cameras of one family (see [`Self::lens_families`]) like [`Self::calibrate`] without
    /// joint refinement. Returns a report without results for the site as a whole, and the cache of lens fits
    /// for the next call.
    ///
    /// The cost does not depend on the number of other cameras of the site.
    #[must_use]
    pub fn calibrate_family(&self, family: &[usize], before: &LensCache) -> (Report, LensCache) {
        let options = Options { refine: false, ..Options::default() };
        let entries: Vec<&SiteCamera> = family.iter().filter_map(|&index| self.cameras.get(index)).collect();
        let lenses = self.lenses(&entries, before);
        let shared = SharedObservations::new(self, &entries);
        let single_fits = self.single_fits(&entries, &lenses, &shared, &options);
        let refined = self.refine_separately(&entries, &single_fits);
        let how = (options.method, Stage::Placed);
        let mut report = Report::default();
        for (position, (&index, entry)) in family.iter().zip(&entries).enumerate() {
            let estimate = refined.cameras.get(position).and_then(Option::as_ref);
            let mut result = self.finish(entry, &single_fits[position], estimate, how, &shared);
            if let (Ok(result), Some(found)) = (&mut result, refined.annotation_reliabilities.get(position)) {
                add_to_annotations(result, found);
            }
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
    fn cameras_with_a_shared_lens_form_a_family() {
        let mut site = Site::new();
        site.cameras = ["a", "b", "c", "d"].map(|id| SiteCamera::new(id, [640, 480])).to_vec();
        for like in [0, 3] {
            site.cameras[like].lens = Some(LensEntry { like: Some("c".into()), ..LensEntry::default() });
        }
        assert_eq!(site.lens_families(), [vec![0, 2, 3], vec![1]]);
    }
}
