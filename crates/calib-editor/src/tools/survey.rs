//! Tools that draw on the plan, corner by corner: walls that block the view, and areas of interest.

use std::collections::HashSet;

use calib_core::FloorPoint;
use calib_site::{Area, Site, WallEntry};

use crate::session::Session;
use crate::tools::corners::Corners;
use crate::tools::place::{SNAP_M, round};
use crate::tools::{Pane, Pointer, Tool};

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
    corners: Corners,
}

impl Survey {
    pub(super) fn walls() -> Self {
        Self { shape: Shape::Walls, corners: Corners::default() }
    }

    pub(super) fn area() -> Self {
        Self { shape: Shape::Area, corners: Corners::default() }
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
        let mut corners = self.corners.take();
        if corners.len() < self.min_corners() {
            let least = if self.min_corners() == 2 { "two" } else { "three" };
            session.note = Some(format!("Click at least {least} corners."));
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
        if let Some(is_closed) = self.corners.follow(at, pointer, self.min_corners()) {
            self.finish(session, is_closed);
        }
    }

    fn accept(&mut self, session: &mut Session) {
        if !self.corners.is_empty() {
            self.finish(session, false);
        }
    }

    fn step_back(&mut self, _session: &mut Session) -> bool {
        self.corners.step_back()
    }

    fn cancel(&mut self) {
        self.corners.clear();
    }

    fn is_idle(&self) -> bool {
        self.corners.is_empty()
    }

    fn hint(&self, _session: &Session) -> String {
        match (self.shape, self.corners.set()) {
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
        self.corners.dragged_point()
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        self.corners.preview_lines(pane)
    }
}
