//! Actions on the placements of cameras, on the floor plan, and on planes other than the floor.
//!
//! Planes are added, renamed, changed and deleted, and annotations are assigned to them.

use calib_core::floor::STAGE_1_HEIGHT;
use calib_core::single::Known;
use calib_core::{Placement, PlanPixel, WorldPoint};
use calib_site::{FixedEntry, Plan, PlaneEntry};

use crate::action::{NewImage, PlacementNumber};
use crate::editor::Editor;
use crate::planes::{PlaneAction, add_plane, assign_plane, delete_plane, rename_plane, set_region};
use crate::tools::tool_index;

/// Inverts a flag and returns its new value.
fn toggle(is_held: &mut bool) -> bool {
    *is_held = !*is_held;
    *is_held
}

impl Editor {
    pub(super) fn place(&mut self, camera: usize, placement: Placement, name: String) {
        self.cancel();
        self.session.place(camera, placement);
        self.session.commit(name);
    }

    /// Rotates or scales the selected camera about its foot. `verb` names the undo step.
    pub(super) fn rotate_or_scale(&mut self, verb: &str, change: impl FnOnce(&mut Placement)) {
        self.cancel();
        let session = &mut self.session;
        let camera = session.camera;
        if !session.check_may_move(camera, "move the camera by hand") {
            return;
        }
        let Some(mut placement) = session.placement(camera) else { return };
        change(&mut placement);
        let name = format!("{verb} {}", session.site.cameras[camera].id);
        session.place(camera, placement);
        session.commit(name);
    }

    /// Moves the selected camera on the floor by 0.1 m times `by`. As on the screen, the second component of `by`
    /// points down, to −y.
    pub(super) fn nudge_camera(&mut self, by: [f64; 2]) {
        let session = &mut self.session;
        let camera = session.camera;
        let Some(mut placement) = session.placement(camera) else { return };
        placement.by.x += 0.1 * by[0];
        placement.by.y -= 0.1 * by[1];
        let name = format!("nudge {}", session.site.cameras[camera].id);
        session.place(camera, placement);
        session.commit(name);
    }

    pub(super) fn toggle_placement_fixed(&mut self) {
        self.cancel();
        let session = &mut self.session;
        let camera = session.camera;
        let Some(placement) = session.placement(camera) else { return };
        session.place(camera, placement);
        let Some(entry) = session.entry_mut() else { return };
        let id = entry.id.clone();
        let Some(placement) = &mut entry.placement else { return };
        placement.fixed = !placement.fixed;
        let verb = if placement.fixed { "fix" } else { "unfix" };
        session.commit(format!("{verb} the placement of {id}"));
    }

    /// Fixes or unfixes one component of the placement. If the whole placement was fixed, the other
    /// components stay fixed.
    pub(super) fn toggle_number_fixed(&mut self, number: PlacementNumber) {
        self.cancel();
        let session = &mut self.session;
        let camera = session.camera;
        let Some(now) = session.placement(camera) else { return };
        if session.entry().is_some_and(|entry| entry.placement.is_none()) {
            session.place(camera, now);
        }
        let Some(entry) = session.entry_mut() else { return };
        let Some(placement) = &mut entry.placement else { return };
        // The height is rounded to 1 mm, because no height is known more accurately.
        let height = (1e3 * STAGE_1_HEIGHT * now.scale).round() / 1e3;
        let was_whole = std::mem::take(&mut placement.fixed);
        if was_whole {
            placement.held = FixedEntry { x: true, y: true, turn: true };
        }
        if was_whole && number != PlacementNumber::Height {
            // A measured height is not overwritten.
            entry.height_m.get_or_insert(Known::fixed(height));
        }
        let (is_held, name) = match number {
            PlacementNumber::X => (toggle(&mut placement.held.x), "x"),
            PlacementNumber::Y => (toggle(&mut placement.held.y), "y"),
            PlacementNumber::Rotation => (toggle(&mut placement.held.turn), "the rotation"),
            PlacementNumber::Height => {
                let is_held = !was_whole && !entry.height_m.is_some_and(|height| height.fixed);
                let measured = entry.height_m.filter(|height| !height.fixed);
                entry.height_m = if is_held { Some(Known::fixed(height)) } else { measured };
                (is_held, "the height")
            }
        };
        let verb = if is_held { "fix" } else { "unfix" };
        let name = format!("{verb} {name} of {}", entry.id);
        session.commit(name);
    }

    pub(super) fn remove_placement(&mut self) {
        self.cancel();
        let Some(entry) = self.session.entry_mut() else { return };
        entry.placement = None;
        let name = format!("remove the placement of {}", entry.id);
        self.session.commit(name);
    }

    pub(super) fn load_plan(&mut self, new: NewImage, scaled: Option<Box<(Plan, String)>>) {
        let NewImage { image, size, .. } = new;
        let metres_per_px = self.session.site.plan.as_ref().map_or(0.02, |plan| plan.metres_per_px);
        let bare = Plan {
            image: None,
            page: None,
            layers: None,
            metres_per_px,
            origin_px: PlanPixel::new(0.0, f64::from(size[1])),
            x_axis_deg: 0.0,
            georeference: None,
        };
        let is_scaled = scaled.is_some();
        let (plan, note) = scaled.map_or((bare, None), |scaled| (scaled.0, Some(scaled.1)));
        self.session.site.replace_plan(Plan { image: Some(image), ..plan });
        self.session.note = note;
        self.session.commit("load a plan");
        if !is_scaled {
            self.select_tool(tool_index("Measure"));
        }
    }

    pub(super) fn apply_world_file(&mut self, world_file: &Plan, name: &str) {
        let Some(plan) = &mut self.session.site.plan else {
            self.add_error(format!(
                "{name}: no floor plan is loaded. Load the plan's image together with this file."
            ));
            return;
        };
        (plan.metres_per_px, plan.origin_px, plan.x_axis_deg) =
            (world_file.metres_per_px, world_file.origin_px, world_file.x_axis_deg);
        self.session.note = Some(format!("Position and scale of the plan read from {name}."));
        self.session.commit(format!("position the plan with {name}"));
    }

    pub(super) fn set_plan(&mut self, plan: Plan, name: String) {
        self.cancel();
        self.session.site.plan = Some(plan);
        self.session.commit(name);
    }
}

impl Editor {
    pub(super) fn on_planes(&mut self, planes: PlaneAction) {
        self.cancel();
        match planes {
            PlaneAction::Choose(index) => self.session.tool.plane = index,
            PlaneAction::Add => self.add_plane(),
            PlaneAction::Delete(index) => self.delete_plane(index),
            PlaneAction::Rename(index, id) => self.rename_plane(index, id.trim()),
            PlaneAction::Set { index, plane, name } => self.set_plane_entry(index, *plane, name),
            PlaneAction::SetRegionFromField(index) => self.set_region_from_field(index),
            PlaneAction::Assign(plane) => self.assign_plane(plane),
        }
    }

    fn add_plane(&mut self) {
        let index = add_plane(&mut self.session.site);
        let name = format!("add {}", self.session.site.planes[index].id);
        self.session.commit(name);
        self.session.tool.plane = Some(index);
    }

    fn delete_plane(&mut self, index: usize) {
        let Some(id) = self.session.site.planes.get(index).map(|plane| plane.id.clone()) else { return };
        delete_plane(&mut self.session.site, index);
        self.session.tool.plane = None;
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
            let why = if id.is_empty() { "the name is empty" } else { "another plane has this name" };
            self.session.note = Some(format!("{old} was not renamed: {why}. Enter another name."));
        }
    }

    /// Replaces the entry of a plane and discards the solution of the plane.
    fn set_plane_entry(&mut self, index: usize, plane: PlaneEntry, name: String) {
        if let Some(own) = self.session.site.planes.get_mut(index) {
            *own = PlaneEntry { solution: None, ..plane };
        }
        self.session.commit(name);
    }

    /// Sets the region of a plane to the camera's field of view, projected onto the plane.
    fn set_region_from_field(&mut self, index: usize) {
        let session = &mut self.session;
        let Some(id) = session.site.planes.get(index).map(|plane| plane.id.clone()) else { return };
        let plane = session.solved.plane(&session.site, Some(&id));
        let drawn = session.entry().and_then(|entry| entry.efov_px.clone()).unwrap_or_default();
        let shown = session.pose().map(|pose| drawn.iter().filter_map(|&px| pose.pixel_to_plane(px, &plane)));
        let region: Vec<_> = shown.into_iter().flatten().map(WorldPoint::on_floor).collect();
        if region.len() < 3 {
            session.note = Some(format!(
                "First draw this camera's field of view on {id} (F), with three or more corners."
            ));
            return;
        }
        set_region(&mut session.site.planes[index], region);
        session.commit(format!("set the region of {id} to the field of view"));
    }

    fn assign_plane(&mut self, plane: Option<String>) {
        let session = &mut self.session;
        let (what, parts) = (session.selection_name(), session.selection.clone());
        assign_plane(&mut session.site, session.camera, &parts, plane.as_ref());
        let on = plane.unwrap_or_else(|| "the floor".into());
        session.commit(format!("assign {what} to {on}"));
    }
}
