//! What cameras share, and control points: changed in their tables.

use calib_site::{ControlPointEntry, Distance, Link, Mark};

use crate::editor::Editor;

impl Editor {
    pub(super) fn set_control(&mut self, index: usize, point: ControlPointEntry) {
        self.cancel();
        let name = point.label(index);
        if let Some(own) = self.session.entry_mut().and_then(|entry| entry.control_points.get_mut(index)) {
            *own = point;
        }
        self.session.commit(format!("change {name}"));
    }

    pub(super) fn set_link(&mut self, index: usize, link: Link) {
        self.cancel();
        let name = link.id.clone().unwrap_or_default();
        if let Some(own) = self.session.site.links.get_mut(index) {
            *own = link;
        }
        self.session.commit(format!("change {name}"));
    }

    pub(super) fn set_mark(&mut self, index: usize, mark: Mark, name: String) {
        self.cancel();
        if let Some(own) = self.session.site.marks.get_mut(index) {
            *own = mark;
        }
        self.session.commit(name);
    }

    pub(super) fn set_distances(&mut self, distances: Vec<Distance>) {
        self.cancel();
        self.session.site.distances = distances;
        self.session.commit("change a measured distance");
    }
}
