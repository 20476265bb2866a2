//! How often is solved: once in a frame where it takes long, so that there is always a frame.

use crate::session::Session;

/// So many milliseconds are nothing, even many times in a frame.
const NOTHING: f64 = 2.0;

impl Session {
    /// A frame begins: from now on what takes long is solved once in every frame, whatever comes in.
    pub(crate) fn begin_frame(&mut self) {
        self.solves_left = Some(1);
    }

    /// Solves, unless that took long and was done in this frame already. Whether it was not put off.
    pub(crate) fn solve_in_frame(&mut self) -> bool {
        if self.solves_left == Some(0) && self.solved.milliseconds > NOTHING {
            return false;
        }
        if self.solve() {
            self.solves_left = self.solves_left.map(|left| left.saturating_sub(1));
        }
        true
    }

    /// Solves what was put off when a gesture ended; what follows from it becomes a part of that gesture.
    pub(crate) fn catch_up(&mut self) {
        // While the next gesture is under way, its end catches up with both.
        if !self.is_put_off || !self.history.is_at(&self.site) {
            return;
        }
        self.is_put_off = false;
        self.solve();
        self.refine_on_the_way();
        self.history.amend(&self.site);
        self.settle();
    }
}
