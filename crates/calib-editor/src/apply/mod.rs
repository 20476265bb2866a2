//! Effects of the actions: the only code that changes the document.
//!
//! - `selection`: pointer, tools, gestures and selected parts.
//! - `lines`: annotations and lens of the selected camera.
//! - `proposing`: automatic calibrations.
//! - `cameras`: the camera list, images and newer images.
//! - `places`: placements, the floor plan and planes.
//! - `whole`: open, save and import; links, marks and control points.

mod selection;
mod lines;
mod proposing;
mod cameras;
mod places;
mod whole;

use crate::action::Action;
use crate::editor::Editor;

impl Editor {
    /// Applies an action. If the action changes the site, the change is one undo step.
    pub fn apply(&mut self, action: Action) {
        match action {
            Action::Open(opened) => self.open(*opened),
            Action::Saved { path, folder } => self.saved(path, folder),
            Action::Change { site, name } => self.change(*site, name),
            Action::Attach(names) => self.attach(&names),
            Action::Note(note) => self.session.note = Some(note),
            Action::AddError(error) => self.add_error(error),
            Action::SetError(error) => self.error = Some(error),
            Action::CloseError => self.error = None,
            Action::Pointer(pointer) => self.pointer(&pointer),
            Action::CancelGesture => self.cancel(),
            Action::Gesture(command) => self.gesture(command),
            Action::SelectTool(index) => self.select_tool(index),
            Action::MarkKind(kind) => self.choose_mark(kind),
            Action::Ruler(settings) => self.set_ruler(settings),
            Action::ClearMeasurement => self.session.tool.measured = None,
            Action::SelectCamera(camera) => self.session.select_camera(camera),
            Action::SelectOn(camera, part) => self.session.select_only(camera, part),
            Action::Select(part) => self.session.selection = [part].into(),
            Action::SelectMore(part) => self.select_more(part),
            Action::SelectAt { camera, at, near } => self.select_at(camera, at.into(), near),
            Action::Selection(command, image) => self.on_selection(command, image.as_deref()),
            Action::Nudge { step, coarse, pane } => self.nudge(step, coarse, pane),
            Action::Lines(command) => self.on_lines(command),
            Action::Automatic(result) => self.apply_automatic(result),
            Action::DecideCalibration(action) => self.decide_calibration(action),
            Action::Newer(action) => self.on_newer(action),
            Action::Proposing(command) => self.proposing(command),
            Action::Cameras(command) => self.on_cameras(command),
            Action::AddCamera { image, joins_last } => self.add_camera(image, joins_last),
            Action::ReplaceImage(of, image) => self.replace_image(of, image),
            Action::BlendReplacedImage(share) => self.blend_replaced(share),
            Action::RescaleToImage => self.rescale_to_image(),
            Action::Rename(id) => self.rename_camera(&id),
            Action::Name(name) => self.name_camera(name),
            Action::Annotate { index, annotation, name } => self.annotate(index, *annotation, name),
            Action::Lens { lens, name } => self.set_lens(*lens, name),
            Action::Height { known, name } => self.set_height(known, name),
            Action::ShowView(which, view) => self.show_view(which, view),
            Action::SetFocalPrior(focal) => self.set_focal_prior(focal, "use another field of view"),
            Action::Place { camera, placement, name } => self.place(camera, placement, name),
            Action::TogglePlacementFixed => self.toggle_placement_fixed(),
            Action::ToggleNumberFixed(number) => self.toggle_number_fixed(number),
            Action::RemovePlacement => self.remove_placement(),
            Action::LoadPlan(image, scaled) => self.load_plan(image, scaled),
            Action::ApplyWorldFile(world_file, name) => self.apply_world_file(&world_file, &name),
            Action::SetPlan { plan, name } => self.set_plan(plan, name),
            Action::Points(action) => self.apply_to_points(action),
            Action::SetLink(index, link) => self.set_link(index, *link),
            Action::SetMark { index, mark, name } => self.set_mark(index, *mark, name),
            Action::Planes(planes) => self.on_planes(planes),
            Action::SetDistances(distances) => self.set_distances(distances),
            Action::Import(site, notes) => self.import(*site, &notes),
            Action::Refined(refined) => self.session.commit_refined(&refined.0, &refined.1),
            Action::SetMaxJointSolveMs(milliseconds) => self.session.live.max_joint_solve_ms = milliseconds,
            Action::Compare(site) => self.compared_site = site.map(|site| *site),
            Action::TogglePause => self.pause(),
            Action::ToggleSnap => self.session.tool.snap = !self.session.tool.snap,
            Action::ToggleUnits => self.toggle_units(),
        }
    }

    /// Changes the unit of lengths as one undo step.
    fn toggle_units(&mut self) {
        self.session.site.units = self.session.site.units.other();
        self.session.commit("change the unit of length");
    }
}
