//! Planes besides the floor: added, named, known, drawn, and laid under what is selected.

use calib_core::WorldPoint;

use calib_site::PlaneEntry;

use crate::editor::Editor;
use crate::planes::{Planes, add_plane, delete_plane, lay, rename_plane, set_region};

impl Editor {
    pub(super) fn on_planes(&mut self, planes: Planes) {
        self.cancel();
        match planes {
            Planes::Choose(index) => self.session.plane = index,
            Planes::Add => self.add_plane(),
            Planes::Delete(index) => self.delete_plane(index),
            Planes::Rename(index, id) => self.rename_plane(index, id.trim()),
            Planes::Set { index, plane, name } => self.set_plane_entry(index, *plane, name),
            Planes::TakeField(index) => self.take_field(index),
            Planes::Lay(plane) => self.lay(plane),
        }
    }

    fn add_plane(&mut self) {
        let index = add_plane(&mut self.session.site);
        let name = format!("add {}", self.session.site.planes[index].id);
        self.session.commit(name);
        self.session.plane = Some(index);
    }

    fn delete_plane(&mut self, index: usize) {
        let Some(id) = self.session.site.planes.get(index).map(|plane| plane.id.clone()) else { return };
        delete_plane(&mut self.session.site, index);
        self.session.plane = None;
        self.session.commit(format!("remove {id}"));
    }

    fn rename_plane(&mut self, index: usize, id: &str) {
        let Some(old) = self.session.site.planes.get(index).map(|plane| plane.id.clone()) else { return };
        if old == id {
            return;
        }
        if rename_plane(&mut self.session.site, index, id) {
            self.session.commit(format!("rename {old} to {id}"));
        } else {
            let why = if id.is_empty() { "a plane needs a name" } else { "another plane has this name" };
            self.session.note = Some(format!("{old} keeps its name: {why}."));
        }
    }

    /// What was solved of it no longer holds.
    fn set_plane_entry(&mut self, index: usize, plane: PlaneEntry, name: String) {
        if let Some(own) = self.session.site.planes.get_mut(index) {
            *own = PlaneEntry { solution: None, ..plane };
        }
        self.session.commit(name);
    }

    /// The corners that were drawn, where the camera shows them on the plane.
    fn take_field(&mut self, index: usize) {
        let session = &mut self.session;
        let Some(id) = session.site.planes.get(index).map(|plane| plane.id.clone()) else { return };
        let plane = session.solved.plane(&session.site, Some(&id));
        let drawn = session.entry().and_then(|entry| entry.efov_px.clone()).unwrap_or_default();
        let shown = session.pose().map(|pose| drawn.iter().filter_map(|&px| pose.pixel_to_plane(px, &plane)));
        let region: Vec<_> = shown.into_iter().flatten().map(WorldPoint::on_floor).collect();
        if region.len() < 3 {
            let note =
                "Needs a solved camera with a field of view of three corners or more on this plane (F).";
            session.note = Some(note.into());
            return;
        }
        set_region(&mut session.site.planes[index], region);
        session.commit(format!("take the field for the region of {id}"));
    }

    fn lay(&mut self, plane: Option<String>) {
        let session = &mut self.session;
        let (what, parts) = (session.selection_name(), session.selection.clone());
        lay(&mut session.site, session.camera, &parts, plane.as_ref());
        let on = plane.unwrap_or_else(|| "the floor".into());
        session.commit(format!("lay {what} on {on}"));
    }
}
