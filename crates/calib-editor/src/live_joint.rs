//! Joint results while the site is edited. They are solved again after a gesture if this is fast enough;
//! otherwise they are out of date.

use calib_site::{Site, SiteCamera};

use crate::joint::{Joint, stored_report};
use crate::refine::refined;
use crate::session::Session;

impl Session {
    /// Repeats the joint solve after a gesture if it is fast enough. After a placement by hand it is not repeated, so
    /// that the placement is kept. The joint result is then out of date until the operator runs the joint solve.
    pub(crate) fn refine_if_fast(&mut self) {
        let may = self.live.was_joint_current && self.solved.is_joint_out_of_date() && !self.solved.paused;
        if !may || self.live.last_joint_solve_ms > self.live.max_joint_solve_ms || self.is_placed_by_hand() {
            return;
        }
        let start = web_time::Instant::now();
        let refined = refined(self.site.clone());
        self.live.last_joint_solve_ms = start.elapsed().as_secs_f64() * 1e3;
        self.apply_refined(&refined);
        // The field-of-view polygons are not kept in place, because the joint solve determines the camera positions.
        self.solved.update(&self.site);
    }

    /// Whether the current gesture moves a camera on the floor without changing its annotations or its lens.
    fn is_placed_by_hand(&self) -> bool {
        let moved = |(index, camera): (usize, &SiteCamera)| {
            let before = self.live.settled_cameras.get(index).filter(|before| before.id == camera.id);
            before.is_some_and(|before| {
                before.placement != camera.placement
                    && (&before.annotations, &before.lens) == (&camera.annotations, &camera.lens)
            })
        };
        self.site.cameras.iter().enumerate().any(moved)
    }

    /// Applies the poses of cameras and marks from a joint solve, and stores its results.
    fn apply_refined(&mut self, refined: &Site) {
        for (camera, refined) in self.site.cameras.iter_mut().zip(&refined.cameras) {
            camera.placement.clone_from(&refined.placement);
        }
        for (mark, refined) in self.site.marks.iter_mut().zip(&refined.marks) {
            (mark.at_m, mark.turn_deg) = (refined.at_m, refined.turn_deg);
        }
        self.solved.add_joint(Joint::new(&self.site, stored_report(refined)));
    }

    /// Returns the site after the last finished gesture, with its joint results.
    #[must_use]
    pub fn site_with_joint_results(&self) -> Site {
        self.solved.write_joint_into(&self.history.site())
    }

    /// Applies the joint result `refined` of the site `from` as one undo step. If the site has changed since,
    /// the result is discarded.
    pub fn commit_refined(&mut self, from: &Site, refined: &Site) {
        if self.site != *from {
            let note = "The result was discarded, because the site was changed during the refinement. Press F9 again.";
            self.note = Some(note.into());
            return;
        }
        let before = (0..self.site.cameras.len()).map(|index| self.solved.pose(index).copied()).collect();
        self.apply_refined(refined);
        self.commit("refine all cameras");
        self.live.before_refine = Some(before);
    }
}
