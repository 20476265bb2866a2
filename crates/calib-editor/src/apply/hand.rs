//! What is in the hand: the tool, and the gesture that is under way.

use calib_core::MarkKind;

use crate::command::{Gesture, Selection};
use crate::editor::Editor;
use crate::hit;
use crate::tools::{Pane, Phase, Pointer, TOOLS, ToolRow, tool_called};

impl Editor {
    pub(super) fn pointer(&mut self, pointer: &Pointer) {
        if pointer.phase == Phase::Press {
            self.session.note = None;
        }
        if self.picks(pointer) {
            return;
        }
        let acts = pointer.pane != Pane::Plan || TOOLS.get(self.tool_row).is_none_or(ToolRow::acts_on_plan);
        let is_plans = !self.on_plan.is_idle() || (!acts && self.tool.is_idle());
        let tool = if is_plans { &mut self.on_plan } else { &mut self.tool };
        tool.pointer(&mut self.session, pointer);
        self.rest();
    }

    /// Whether the press chooses a proposed line: what is drawn comes first, as does a tool that draws.
    fn picks(&mut self, pointer: &Pointer) -> bool {
        let is_free = self.tool_row == 0 && self.tool.is_idle() && pointer.phase == Phase::Press;
        let session = &mut self.session;
        let at = pointer.pixel().filter(|(camera, _)| is_free && *camera == session.camera);
        let Some((camera, at)) = at else { return false };
        let pose = session.solved.pose(camera);
        let is_drawn =
            hit::pick(&session.site, camera, pose, at, pointer.radius, &session.selection).is_some();
        let lens = hit::lens_of(&session.site, camera, pose);
        let proposed = session.proposed().zip(lens);
        let under = proposed.and_then(|(own, lens)| own.under(&lens, at, pointer.radius));
        session.picked = under.filter(|_| !is_drawn);
        if session.picked.is_some() {
            session.selection.clear();
        }
        session.picked.is_some()
    }

    /// After what the hand did: a tool that has made what it makes is laid down.
    fn rest(&mut self) {
        if self.tool.is_over() {
            self.take_tool(0);
        }
        self.session.solve_in_frame();
    }

    pub(super) fn cancel(&mut self) {
        self.tool.cancel();
        self.on_plan.cancel();
        self.session.revert();
        self.session.solve();
    }

    pub(super) fn take_tool(&mut self, index: usize) {
        self.cancel();
        if let Some(row) = TOOLS.get(index) {
            (self.tool, self.tool_row) = ((row.make)(), index);
        }
    }

    pub(super) fn choose_mark(&mut self, kind: MarkKind) {
        self.session.mark_kind = kind;
        self.take_tool(tool_called("Mark"));
    }

    pub(super) fn gesture(&mut self, command: Gesture) {
        match command {
            // What is in the hand is taken back first.
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
                self.take_tool(0);
            }
            Gesture::Cancel => self.cancel(),
        }
        self.rest();
    }

    pub(super) fn pause(&mut self) {
        self.cancel();
        self.session.solved.paused = !self.session.solved.paused;
        self.session.solve();
    }
}
