//! The joint solve of a whole site, off the frame's path.

use calib_site::Site;
use egui::Context;

use crate::platform::{Here, Platform as _, Task};

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
        Self { from: site.clone(), task: Here::refine(ctx, site.clone()) }
    }

    /// The refined site, once.
    #[must_use]
    pub fn poll(&self) -> Option<Result<Site, String>> {
        let lost = |_| "the solve ended without a result".to_owned();
        Some(self.task.outcome()?.map_err(lost).flatten())
    }
}

impl Drop for Refining {
    fn drop(&mut self) {
        Here::stop_refining();
    }
}
