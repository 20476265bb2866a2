//! The scale of the plan: two clicks, and a length in the panel.

use crate::session::Session;
use crate::tools::{Pane, Phase, Pointer, Tool, plan_scale};

/// The tool that measures the plan.
#[derive(Debug, Default)]
pub(super) struct Measure {
    from: Option<[f64; 2]>,
    to: Option<[f64; 2]>,
}

impl Tool for Measure {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if pointer.pane != Pane::Plan {
            return;
        }
        match (self.from, pointer.phase) {
            (None, Phase::Press) => (self.from, self.to) = (Some(pointer.at), Some(pointer.at)),
            (Some(from), Phase::Release) => {
                let far = (from[0] - pointer.at[0]).hypot(from[1] - pointer.at[1]);
                if far > pointer.radius {
                    let scale = plan_scale(&session.site);
                    session.measured = Some([from, pointer.at].map(|at| scale.plan_from_floor(at.into())));
                    session.note = Some("Enter the length between the two points, on the right.".into());
                    self.cancel();
                }
            }
            (Some(_), _) => self.to = Some(pointer.at),
            _ => {}
        }
    }

    fn cancel(&mut self) {
        *self = Self::default();
    }

    fn is_idle(&self) -> bool {
        self.from.is_none()
    }

    fn hint(&self, session: &Session) -> String {
        match (self.from, session.measured) {
            (Some(_), _) => "Click the other end of a length that you know.".into(),
            (None, Some(_)) => "Enter the length on the right, or measure again.".into(),
            (None, None) => "Click two points of the plan whose distance you know.".into(),
        }
    }

    fn held(&self) -> Option<(Pane, [f64; 2])> {
        self.to.map(|to| (Pane::Plan, to))
    }

    fn rubber(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        match (pane, self.from, self.to) {
            (Pane::Plan, Some(from), Some(to)) => vec![vec![from, to]],
            _ => Vec::new(),
        }
    }
}
