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
    /// Applies an action. A change of the site ends as one undo step.
    pub fn apply(&mut self, action: Action) {
        match action {
            Action::Open(opened) => self.open(*opened),
            Action::Saved { path, folder } => self.saved(path, folder),
            Action::Change { site, name } => self.change(*site, name),
            Action::Attach(names) => self.attach(&names),
            Action::Note(note) => self.session.note = Some(note),
            Action::Complain(error) => self.complain(error),
            Action::Fail(error) => self.error = Some(error),
            Action::CloseError => self.error = None,
            Action::Pointer(pointer) => self.pointer(&pointer),
            Action::Drop => self.cancel(),
            Action::Gesture(command) => self.gesture(command),
            Action::TakeTool(index) => self.take_tool(index),
            Action::MarkKind(kind) => self.choose_mark(kind),
            Action::MeasuredDone => self.session.measured = None,
            Action::Choose(camera) => self.session.choose(camera),
            Action::SelectOn(camera, part) => self.session.select_only(camera, part),
            Action::Select(part) => self.session.selection = [part].into(),
            Action::SelectMore(part) => self.select_more(part),
            Action::SelectAt { camera, at, near } => self.select_at(camera, at.into(), near),
            Action::Selection(command, still) => self.on_selection(command, still.as_deref()),
            Action::Nudge { step, coarse, pane } => self.nudge(step, coarse, pane),
            Action::Lines(command) => self.on_lines(command),
            Action::Propose(of, proposal) => self.propose(&of, &proposal),
            Action::OnProposed(action) => self.on_proposed(action),
            Action::Newer(action) => self.on_newer(action),
            Action::Proposing(command) => self.proposing(command),
            Action::Cameras(command) => self.on_cameras(command),
            Action::AddCamera(still) => self.add_camera(still),
            Action::ReplaceStill(of, still) => self.replace_still(of, still),
            Action::BlendOldStill(share) => self.blend_old(share),
            Action::ForgetOldStill => self.old_still = None,
            Action::RescaleToStill => self.rescale_to_still(),
            Action::Rename(id) => self.rename_camera(&id),
            Action::Name(name) => self.name_camera(name),
            Action::Annotate { index, annotation, name } => self.annotate(index, *annotation, name),
            Action::Lens { lens, name } => self.set_lens(*lens, name),
            Action::Height { known, name } => self.set_height(known, name),
            Action::ShowView(which, view) => self.show_view(which, view),
            Action::UseFocal(focal) => self.believe_focal(focal, "use another field of view"),
            Action::Place { camera, placement, name } => self.place(camera, placement, name),
            Action::HoldPlace => self.hold_place(),
            Action::HoldNumber(number) => self.hold_number(number),
            Action::ForgetPlace => self.forget_place(),
            Action::LoadPlan(still, told) => self.load_plan(still, told),
            Action::LayPlan(told, name) => self.lay_plan(&told, &name),
            Action::SetPlan { plan, name } => self.set_plan(plan, name),
            Action::SetControl(index, point) => self.set_control(index, *point),
            Action::SetLink(index, link) => self.set_link(index, *link),
            Action::SetMark { index, mark, name } => self.set_mark(index, *mark, name),
            Action::Planes(planes) => self.on_planes(planes),
            Action::SetDistances(distances) => self.set_distances(distances),
            Action::Import(site, notes) => self.import(*site, &notes),
            Action::Refined(refined) => self.session.take_refined(&refined.0, &refined.1),
            Action::JointMayTake(milliseconds) => self.session.joint_may_take = milliseconds,
            Action::Compare(site) => self.compared = site.map(|site| *site),
            Action::Pause => self.pause(),
            Action::Snap => self.session.snap = !self.session.snap,
            Action::Feet => self.session.units = self.session.units.other(),
        }
    }
}
