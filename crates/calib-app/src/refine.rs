//! The joint solve of a whole site, off the frame's path.

use calib_core::{Options, Placement, Site, Solution, Stage};
use egui::Context;

use crate::session::rounded;
use crate::task::Task;

/// A joint solve that is under way.
#[derive(Debug)]
pub struct Refining {
    /// What is refined.
    pub from: Site,
    task: Task<Result<Site, String>>,
}

impl Refining {
    /// Begins to refine a site.
    #[must_use]
    pub fn begin(ctx: &Context, site: &Site) -> Self {
        let (from, site) = (site.clone(), site.clone());
        #[cfg(not(target_arch = "wasm32"))]
        let task = Task::spawn_apart(ctx, move || Ok(refined(site)));
        #[cfg(target_arch = "wasm32")]
        let task = Task::wait(ctx, async move { crate::web::worker::refine(&site).await });
        Self { from, task }
    }

    /// The refined site, once.
    #[must_use]
    pub fn poll(&self) -> Option<Result<Site, String>> {
        let lost = |_| "the solve ended without a result".to_owned();
        Some(self.task.outcome()?.map_err(lost).flatten())
    }
}

#[cfg(target_arch = "wasm32")]
impl Drop for Refining {
    fn drop(&mut self) {
        // It computes for nobody any more.
        crate::web::worker::stop_refining();
    }
}

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
