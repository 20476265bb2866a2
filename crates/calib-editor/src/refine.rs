//! The joint solve of a whole site, written back as placements.

use calib_core::{Options, Placement, Site, Solution, Stage};

use crate::session::rounded;

/// The site with cameras and marks where all evidence together puts them, and with its results.
#[must_use]
pub fn refined(mut site: Site) -> Site {
    let report = site.calibrate(&Options::default());
    for (index, result) in &report.cameras {
        let pose = result.as_ref().ok().filter(|s| s.stage == Stage::Refined);
        if let Some(pose) = pose.and_then(Solution::camera) {
            let entry = &mut site.cameras[*index];
            let fixed = entry.placement.as_ref().is_some_and(|placement| placement.fixed);
            entry.placement = Some(calib_core::PlacementEntry { fixed, ..rounded(Placement::of(&pose)) });
        }
    }
    for (mark, found) in site.marks.iter_mut().zip(&report.marks) {
        if let Some(found) = found.as_ref().filter(|_| !mark.fixed) {
            (mark.at_m, mark.turn_deg) = (found.at_m, found.turn_deg.unwrap_or(mark.turn_deg));
        }
    }
    // From where they stand now, as whoever opens the file will find it.
    site.calibrate(&Options::default()).write_into(&site)
}
