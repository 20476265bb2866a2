//! The scale of the plan: two clicks, and a length in the panel.
//!
//! Draws where a plane besides the floor holds, corner by corner on the plan.

use calib_core::FloorPoint;

use crate::planes::{add_plane, set_region};
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

/// The tool of regions: of the plane in hand, or of a new one.
#[derive(Debug, Default)]
pub(super) struct Region {
    /// Corners so far; the last one follows the pointer. None while no gesture is under way.
    corners: Vec<FloorPoint>,
    is_over: bool,
}

impl Region {
    /// The site with the region as far as it is drawn; the index of its plane.
    fn show(session: &mut Session, corners: &[FloorPoint]) -> Option<usize> {
        session.revert();
        if corners.len() < 3 {
            return None;
        }
        let chosen = session.plane.filter(|&plane| plane < session.site.planes.len());
        let index = chosen.unwrap_or_else(|| add_plane(&mut session.site));
        set_region(&mut session.site.planes[index], corners.to_vec());
        Some(index)
    }

    /// Ends with the corners that were set; too few are none.
    fn finish(&mut self, session: &mut Session) {
        let mut corners = std::mem::take(&mut self.corners);
        corners.pop();
        let Some(index) = Self::show(session, &corners) else {
            session.note = Some("Needs three corners.".into());
            return;
        };
        let name = format!("draw the region of {}", session.site.planes[index].id);
        session.plane = Some(index);
        session.commit(name);
        self.is_over = true;
    }
}

impl Tool for Region {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if pointer.pane != Pane::Plan {
            return;
        }
        let at = FloorPoint::from(pointer.at);
        let Some(last) = self.corners.last_mut() else {
            if pointer.phase == Phase::Press {
                self.corners = vec![at, at];
            }
            return;
        };
        *last = at;
        let set = self.corners.len() - 1;
        let closes = set >= 3 && self.corners[0].distance(at) <= pointer.radius;
        // The first press made the first corner; its release is not the second one.
        let is_new = self.corners[set - 1].distance(at) > 0.5 * pointer.radius;
        if pointer.phase == Phase::Release && (closes || pointer.double && set >= 3) {
            self.finish(session);
            return;
        }
        if pointer.phase == Phase::Release && is_new {
            self.corners.push(at);
        }
        Self::show(session, &self.corners);
    }

    fn accept(&mut self, session: &mut Session) {
        if !self.corners.is_empty() {
            self.finish(session);
        }
    }

    fn step_back(&mut self, session: &mut Session) -> bool {
        let Some(end) = self.corners.pop() else { return false };
        self.corners.pop();
        if !self.corners.is_empty() {
            self.corners.push(end);
        }
        Self::show(session, &self.corners);
        true
    }

    fn cancel(&mut self) {
        self.corners.clear();
    }

    fn is_idle(&self) -> bool {
        self.corners.is_empty()
    }

    fn is_over(&self) -> bool {
        self.is_over
    }

    fn hint(&self, session: &Session) -> String {
        let plane = session.plane.and_then(|plane| session.site.planes.get(plane));
        let of = plane.map_or("a new plane", |plane| plane.id.as_str());
        match 4_usize.saturating_sub(self.corners.len()) {
            _ if self.corners.is_empty() => format!("Click the corners of {of} on the plan."),
            0 => "Click the next corner, or the first one to close.  Enter: close".into(),
            left => format!("Click the next corner; {left} more needed."),
        }
    }

    fn held(&self) -> Option<(Pane, [f64; 2])> {
        self.corners.last().map(|&at| (Pane::Plan, at.into()))
    }

    fn rubber(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        if pane != Pane::Plan || self.corners.is_empty() {
            return Vec::new();
        }
        vec![self.corners.iter().map(|&at| at.into()).collect()]
    }
}
