//! Actions on selected parts: select, delete, duplicate, switch on or off, move onto edges, nudge.
//!
//! The file also contains the actions on the current tool and the current gesture.

use std::collections::BTreeSet;

use calib_core::{MarkKind, Pixel};
use calib_site::counted;
use image::RgbImage;

use crate::command::{Gesture, Nudge, Selection};
use crate::editor::Editor;
use crate::hit::{self, Part};
use crate::proposed::CalibrationDecision;
use crate::session::RulerSettings;
use crate::tools::{Pane, Phase, Pointer, TOOLS, ToolRow, tool_index};
use crate::{edit, snap};

impl Editor {
    pub(super) fn pointer(&mut self, pointer: &Pointer) {
        if pointer.phase == Phase::Press {
            self.session.note = None;
        }
        if self.picks_calibration_line(pointer) {
            return;
        }
        let acts = pointer.pane != Pane::Plan || TOOLS.get(self.tool_row).is_none_or(ToolRow::acts_on_plan);
        let is_plans = !self.plan_tool.is_idle() || (!acts && self.tool.is_idle());
        let tool = if is_plans { &mut self.plan_tool } else { &mut self.tool };
        tool.pointer(&mut self.session, pointer);
        self.finish_event();
    }

    /// Selects the line of the automatic calibration under a press, and returns whether there is one. Annotations and
    /// drawing tools take precedence.
    fn picks_calibration_line(&mut self, pointer: &Pointer) -> bool {
        let is_free = self.tool_row == 0 && self.tool.is_idle() && pointer.phase == Phase::Press;
        let session = &mut self.session;
        let at = pointer.pixel().filter(|(camera, _)| is_free && *camera == session.camera);
        let Some((camera, at)) = at else { return false };
        let pose = session.solved.pose(camera);
        let is_drawn =
            hit::pick(&session.site, camera, pose, at, pointer.radius, &session.selection).is_some();
        let lens = hit::lens_of(&session.site, camera, pose);
        let proposed = session.proposed().zip(lens);
        let under = proposed.and_then(|(own, lens)| own.line_at(&lens, at, pointer.radius));
        session.pending.picked_line = under.filter(|_| !is_drawn);
        if session.pending.picked_line.is_some() {
            session.selection.clear();
        }
        session.pending.picked_line.is_some()
    }

    /// Finishes a pointer event or a gesture command: replaces a tool that is done by the selection tool, and solves
    /// the site.
    fn finish_event(&mut self) {
        if self.tool.is_done() {
            self.select_tool(0);
        }
        self.session.solve_in_frame();
    }

    pub(super) fn cancel(&mut self) {
        self.tool.cancel();
        self.plan_tool.cancel();
        self.session.revert();
        // A line that was being drawn no longer exists.
        let mut selection = std::mem::take(&mut self.session.selection);
        selection.retain(|part| self.session.has_line(*part));
        self.session.selection = selection;
        self.session.solve();
    }

    pub(super) fn select_tool(&mut self, index: usize) {
        self.cancel();
        self.session.tool.ground_point = None;
        if let Some(row) = TOOLS.get(index) {
            (self.tool, self.tool_row) = ((row.make)(), index);
        }
    }

    pub(super) fn set_ruler(&mut self, settings: RulerSettings) {
        if settings.kind != self.session.tool.ruler.kind {
            self.cancel();
        }
        self.session.tool.ruler = settings;
    }

    pub(super) fn choose_mark(&mut self, kind: MarkKind) {
        self.session.tool.mark_kind = kind;
        self.select_tool(tool_index("Mark"));
    }

    pub(super) fn gesture(&mut self, command: Gesture) {
        match command {
            // An unfinished gesture is cancelled first.
            Gesture::Undo | Gesture::Redo if !self.tool().is_idle() => self.cancel(),
            Gesture::Undo => self.session.undo(),
            Gesture::Redo => self.session.redo(),
            Gesture::Accept => self.tool.accept(&mut self.session),
            Gesture::StepBack => {
                if !self.tool.step_back(&mut self.session) {
                    self.on_selection(Selection::Delete, None);
                }
            }
            Gesture::Cancel if self.tool().is_idle() => {
                self.session.selection.clear();
                self.select_tool(0);
            }
            Gesture::Cancel => self.cancel(),
        }
        self.finish_event();
    }

    pub(super) fn pause(&mut self) {
        self.cancel();
        self.session.solved.paused = !self.session.solved.paused;
        self.session.solve();
    }
}

impl Editor {
    pub(super) fn select_more(&mut self, part: Part) {
        if !self.session.selection.remove(&part) {
            self.session.selection.insert(part);
        }
    }

    pub(super) fn select_at(&mut self, camera: usize, at: Pixel, near: f64) {
        let session = &mut self.session;
        session.select_camera(camera);
        let pose = session.solved.pose(camera);
        match hit::pick(&session.site, camera, pose, at, near, &session.selection) {
            Some(hit) if session.selection.contains(&hit.part) => {}
            Some(hit) => session.select_only(camera, hit.part),
            None => session.selection.clear(),
        }
    }

    pub(super) fn on_selection(&mut self, command: Selection, image: Option<&RgbImage>) {
        self.cancel();
        let name = self.session.selection_name();
        let parts = self.session.selection.clone();
        match command {
            Selection::Delete => match self.session.pending.picked_line.filter(|_| parts.is_empty()) {
                Some((group, line)) => self.decide_calibration(CalibrationDecision::RejectLine(group, line)),
                None => self.delete(&parts, &name),
            },
            Selection::Duplicate => self.duplicate(&parts, &name),
            Selection::OnOff => {
                self.change_flags(&parts, &format!("switch {name} on or off"), |off, _| *off = !*off);
            }
            Selection::UseAnyway => {
                self.change_flags(&parts, &format!("use {name} anyway"), |off, keep| {
                    (*off, *keep) = (false, true);
                });
            }
            Selection::SelectAll => {
                let handles = hit::handles(&self.session.site, self.session.camera);
                self.session.selection = handles.into_iter().map(|(part, _)| part).collect();
            }
            Selection::Deselect => self.session.selection.clear(),
            Selection::PullOntoEdge => self.move_onto_edges(&parts, &name, image),
        }
    }

    fn delete(&mut self, parts: &BTreeSet<Part>, name: &str) {
        if parts.is_empty() {
            return;
        }
        let session = &mut self.session;
        edit::delete(&mut session.site, session.camera, parts);
        session.selection.clear();
        session.commit(format!("delete {name}"));
    }

    fn duplicate(&mut self, parts: &BTreeSet<Part>, name: &str) {
        let session = &mut self.session;
        let Some(entry) = session.site.cameras.get_mut(session.camera) else { return };
        let aside = 0.02 * entry.size()[0];
        session.selection = edit::duplicate(entry, parts, [aside, 0.0]);
        session.commit(format!("duplicate {name}"));
    }

    /// Applies `change` to the flags `off` and `keep` of every selected annotation, control point, link and mark,
    /// once for each. Uprights without an entered height stay unchanged. `name` is the name of the undo step.
    fn change_flags(&mut self, parts: &BTreeSet<Part>, name: &str, change: impl Fn(&mut bool, &mut bool)) {
        let (mut seen, mut waits) = (BTreeSet::new(), false);
        let site = &mut self.session.site;
        for &part in parts {
            let key = match part {
                Part::Vertex { annotation, .. } | Part::Line { annotation, .. } => (0, annotation),
                Part::Control(index) => (1, index),
                Part::Link { link, .. } => (2, link),
                Part::Pin { mark, .. } | Part::Mark(mark) => (3, mark),
                Part::Corner(_) | Part::Field => continue,
            };
            if !seen.insert(key) {
                continue;
            }
            let entry = site.cameras.get_mut(self.session.camera);
            let drawn = entry.as_ref().and_then(|entry| entry.annotations.get(key.1));
            if key.0 == 0 && drawn.is_some_and(edit::waits_for_height) {
                waits = true;
                continue;
            }
            let pair = match key.0 {
                0 => entry.and_then(|e| e.annotations.get_mut(key.1)).map(|a| (&mut a.off, &mut a.keep)),
                1 => entry.and_then(|e| e.control_points.get_mut(key.1)).map(|p| (&mut p.off, &mut p.keep)),
                2 => site.links.get_mut(key.1).map(|l| (&mut l.off, &mut l.keep)),
                _ => site.marks.get_mut(key.1).map(|m| (&mut m.off, &mut m.keep)),
            };
            if let Some((off, keep)) = pair {
                change(off, keep);
            }
        }
        self.session.commit(name);
        if waits {
            let note = "The upright has no height yet. Enter its height before you switch it on.";
            self.session.note = Some(note.into());
        }
    }

    fn move_onto_edges(&mut self, parts: &BTreeSet<Part>, name: &str, image: Option<&RgbImage>) {
        let session = &mut self.session;
        let Some(image) = image else {
            session.note = Some("The image is still loading. Try again in a moment.".into());
            return;
        };
        let (camera, pose) = (session.camera, session.solved.pose(session.camera));
        let lens = hit::lens_of(&session.site, camera, pose);
        let pulled = snap::pull_parts(&mut session.site, camera, parts, lens, image);
        session.commit(format!("snap {name} to the edge"));
        session.note = Some(match pulled {
            0 => "No edge was found along the selection. Drag its points closer to the edge, and try again."
                .into(),
            count => format!("Snapped to edges: {}.", counted(count, "line", "lines")),
        });
    }

    pub(super) fn nudge(&mut self, step: Nudge, coarse: bool, pane: Option<Pane>) {
        let by = if coarse { 1.0 } else { 0.1 };
        match step {
            Nudge::NudgeLeft => self.nudge_by([-by, 0.0], pane),
            Nudge::NudgeRight => self.nudge_by([by, 0.0], pane),
            Nudge::NudgeUp => self.nudge_by([0.0, -by], pane),
            Nudge::NudgeDown => self.nudge_by([0.0, by], pane),
            Nudge::TurnLeft => self.rotate_or_scale("rotate", |placement| placement.turn += by.to_radians()),
            Nudge::TurnRight => self.rotate_or_scale("rotate", |placement| placement.turn -= by.to_radians()),
            Nudge::Grow => self.rotate_or_scale("scale", |placement| placement.scale *= 1.0 + 0.01 * by),
            Nudge::Shrink => self.rotate_or_scale("scale", |placement| placement.scale /= 1.0 + 0.01 * by),
        }
    }

    /// Moves the selected parts by `by` raw pixels. Selected marks move instead on the floor, by 0.1 m for each unit
    /// of `by`. Without a selection, the camera moves in the same way if `pane` is the plan.
    fn nudge_by(&mut self, by: [f64; 2], pane: Option<Pane>) {
        if !self.tool().is_idle() {
            self.cancel();
        }
        let session = &mut self.session;
        let name = session.selection_name();
        let marks: Vec<usize> = session
            .selection
            .iter()
            .filter_map(|part| if let Part::Mark(mark) = part { Some(*mark) } else { None })
            .collect();
        if !marks.is_empty() {
            for index in marks {
                let Some(mark) = session.site.marks.get_mut(index) else { continue };
                mark.remove_map_coordinates();
                mark.at_m.x += 0.1 * by[0];
                mark.at_m.y -= 0.1 * by[1];
            }
            session.commit(format!("nudge {name}"));
        } else if !session.selection.is_empty() {
            let (camera, parts) = (session.camera, session.selection.clone());
            edit::shift(&mut session.site, camera, &parts, by);
            session.commit(format!("nudge {name}"));
        } else if pane == Some(Pane::Plan) && !session.is_fixed_by_control_points(session.camera) {
            self.nudge_camera(by);
        }
    }
}
