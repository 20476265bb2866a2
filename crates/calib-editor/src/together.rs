//! What was solved together, as the document changes under it: solved again on the way, or left as it is.

use calib_site::{Site, SiteCamera};

use crate::joint::{Joint, report_of};
use crate::refine::refined;
use crate::session::Session;

impl Session {
    /// Solves together again what was solved together, where that takes no longer than a blink. A place that a
    /// hand has just given is not taken back: then the joint result is out of date until the operator says so.
    pub(crate) fn refine_on_the_way(&mut self) {
        let may = self.was_joint_current && self.solved.is_joint_out_of_date() && !self.solved.paused;
        if !may || self.joint_took > self.joint_may_take || self.is_placed_by_hand() {
            return;
        }
        let start = web_time::Instant::now();
        let refined = refined(self.site.clone());
        self.joint_took = start.elapsed().as_secs_f64() * 1e3;
        self.put_refined(&refined);
        // Polygons lie where the joint result has them, not where they lay.
        self.solved.update(&self.site);
    }

    /// Whether the gesture under way moves a camera on the floor and draws nothing on its image.
    fn is_placed_by_hand(&self) -> bool {
        let moved = |(index, camera): (usize, &SiteCamera)| {
            let before = self.settled_cameras.get(index).filter(|before| before.id == camera.id);
            before.is_some_and(|before| {
                before.placement != camera.placement
                    && (&before.annotations, &before.lens) == (&camera.annotations, &camera.lens)
            })
        };
        self.site.cameras.iter().enumerate().any(moved)
    }

    /// Puts cameras and marks where a joint solve has them, and keeps its results.
    fn put_refined(&mut self, refined: &Site) {
        for (camera, refined) in self.site.cameras.iter_mut().zip(&refined.cameras) {
            camera.placement.clone_from(&refined.placement);
        }
        for (mark, refined) in self.site.marks.iter_mut().zip(&refined.marks) {
            (mark.at_m, mark.turn_deg) = (refined.at_m, refined.turn_deg);
        }
        self.solved.keep_joint(Joint::new(&self.site, report_of(refined)));
    }

    /// The site as the last finished gesture left it, with what was solved together.
    #[must_use]
    pub fn kept(&self) -> Site {
        self.solved.write_joint_into(&self.history.site())
    }

    /// Takes over what refining `from` gave, as one step that undo takes back. Whatever was changed meanwhile
    /// is worth more than a result that does not know of it.
    pub fn take_refined(&mut self, from: &Site, refined: &Site) {
        if self.site != *from {
            self.note = Some("The site was changed while it was refined: refine again.".into());
            return;
        }
        let before = (0..self.site.cameras.len()).map(|index| self.solved.pose(index).copied()).collect();
        self.put_refined(refined);
        self.commit("refine all cameras");
        self.before_refine = Some(before);
    }
}
