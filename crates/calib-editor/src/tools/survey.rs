//! Tools that draw on the plan, corner by corner: walls that block the view, and areas of interest.

use std::collections::HashSet;

use calib_core::FloorPoint;
use calib_site::{Area, Site, WallEntry};

use crate::session::Session;
use crate::tools::place::{SNAP_M, round};
use crate::tools::{Pane, Phase, Pointer, Tool};

/// Shape that the tool draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    /// Walls between consecutive corners.
    Walls,
    /// Polygon of an area of interest.
    Area,
}

/// Tool that draws walls or an area of interest.
#[derive(Debug)]
pub(super) struct Survey {
    shape: Shape,
    /// Corners of the unfinished shape, in floor metres; the last one follows the pointer. Empty if no gesture is
    /// in progress.
    corners: Vec<FloorPoint>,
}

impl Survey {
    pub(super) const fn walls() -> Self {
        Self { shape: Shape::Walls, corners: Vec::new() }
    }

    pub(super) const fn area() -> Self {
        Self { shape: Shape::Area, corners: Vec::new() }
    }

    /// Returns the smallest number of corners.
    const fn min_corners(&self) -> usize {
        match self.shape {
            Shape::Walls => 2,
            Shape::Area => 3,
        }
    }

    /// Adds the shape without the corner that follows the pointer. `is_closed`: the last wall ends at the first
    /// corner. Too few corners are discarded.
    fn finish(&mut self, session: &mut Session, is_closed: bool) {
        let mut corners = std::mem::take(&mut self.corners);
        corners.pop();
        if corners.len() < self.min_corners() {
            session.note = Some(format!("Click at least {} corners.", self.min_corners()));
            return;
        }
        match self.shape {
            Shape::Area => {
                let id = free_area_id(&session.site);
                let name = format!("draw {id}");
                session.site.areas.push(Area { id, name: None, polygon_m: corners, level: None });
                session.commit(name);
            }
            Shape::Walls => {
                let first = corners[0];
                corners.extend(is_closed.then_some(first));
                let ends = |ends: &[FloorPoint]| WallEntry { from_m: ends[0], to_m: ends[1], height_m: None };
                session.site.walls.extend(corners.windows(2).map(ends));
                let count = corners.len() - 1;
                session.commit(if count == 1 { "draw a wall".into() } else { format!("draw {count} walls") });
            }
        }
    }
}

/// Returns the first unused id of an area.
fn free_area_id(site: &Site) -> String {
    let used: HashSet<&str> = site.areas.iter().map(|area| area.id.as_str()).collect();
    let ids = (1..).map(|number| format!("area-{number}"));
    ids.into_iter().find(|id| !used.contains(id.as_str())).unwrap_or_default()
}

impl Tool for Survey {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if pointer.pane != Pane::Plan {
            return;
        }
        let snapped = |value: f64| if session.tool.snap { round(value, SNAP_M) } else { value };
        let at = FloorPoint::from(pointer.at.map(snapped));
        let Some(last) = self.corners.last_mut() else {
            if pointer.phase == Phase::Press {
                self.corners = vec![at, at];
            }
            return;
        };
        *last = at;
        if pointer.phase != Phase::Release {
            return;
        }
        let set = self.corners.len() - 1;
        let closes = set >= 3 && self.corners[0].distance(at) <= pointer.radius;
        // The first press adds the first corner; its release does not add the second one.
        let is_new = self.corners[set - 1].distance(at) > 0.5 * pointer.radius;
        if closes || pointer.double && set >= self.min_corners() {
            self.finish(session, closes);
        } else if is_new {
            self.corners.push(at);
        }
    }

    fn accept(&mut self, session: &mut Session) {
        if !self.corners.is_empty() {
            self.finish(session, false);
        }
    }

    fn step_back(&mut self, _session: &mut Session) -> bool {
        let Some(end) = self.corners.pop() else { return false };
        self.corners.pop();
        if !self.corners.is_empty() {
            self.corners.push(end);
        }
        true
    }

    fn cancel(&mut self) {
        self.corners.clear();
    }

    fn is_idle(&self) -> bool {
        self.corners.is_empty()
    }

    fn hint(&self, _session: &Session) -> String {
        let set = self.corners.len().saturating_sub(1);
        match (self.shape, set) {
            (Shape::Walls, 0) => "Click the corners of a wall on the plan.".into(),
            (Shape::Area, 0) => "Click the corners of an area of interest on the plan.".into(),
            (_, 3..) => {
                "Click the next corner, or the first one to close.  Enter: finish  Backspace: remove the last corner"
                    .into()
            }
            (Shape::Walls, 2) => {
                "Click the next corner.  Enter: finish  Backspace: remove the last corner".into()
            }
            _ => "Click the next corner.".into(),
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        self.corners.last().map(|&at| (Pane::Plan, at.into()))
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        if pane != Pane::Plan || self.corners.is_empty() {
            return Vec::new();
        }
        vec![self.corners.iter().map(|&at| at.into()).collect()]
    }
}
