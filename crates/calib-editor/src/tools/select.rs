//! Selection tool. It selects and moves parts of an image. On the plan, it moves, rotates and scales cameras.

use std::collections::BTreeSet;

use calib_core::Pixel;

use crate::edit;
use crate::hit::{self, Part};
use crate::session::Session;
use crate::snap;
use crate::tools::grab::{FINE_DRAG, drag_selection};
use crate::tools::mark::MarkDrag;
use crate::tools::place::PlaceDrag;
use crate::tools::{Pane, Phase, Pointer, Tool, annotation_sigma_px};

#[derive(Clone, Debug, Default)]
enum Gesture {
    #[default]
    Idle,
    /// Drag of selected parts of an image.
    Parts {
        camera: usize,
        from: Pixel,
        at: Pixel,
    },
    /// Drag of a selection box between two raw pixels.
    SelectionBox {
        camera: usize,
        from: Pixel,
        to: Pixel,
    },
    Mark(MarkDrag),
    Place(PlaceDrag),
}

/// Tool that selects and moves parts; it is active by default.
#[derive(Debug, Default)]
pub(super) struct Select {
    gesture: Gesture,
}

impl Select {
    /// Starts the gesture of a press on an image or on the plan.
    fn press(session: &mut Session, pointer: &Pointer) -> Gesture {
        let Some((camera, at)) = pointer.pixel() else { return Self::press_plan(session, pointer) };
        session.select_camera(camera);
        let pose = session.solved.pose(camera).copied();
        // While Alt is pressed, marks have priority over other parts.
        let mark = pose.filter(|_| pointer.modifiers.alt);
        let mark = mark.and_then(|pose| hit::mark_at(&session.site, &pose, at, pointer.radius));
        let hit = mark.or_else(|| {
            hit::pick(&session.site, camera, pose.as_ref(), at, pointer.radius, &session.selection)
        });
        let Some(hit) = hit else {
            if !pointer.modifiers.command {
                session.selection.clear();
            }
            return Gesture::SelectionBox { camera, from: at, to: at };
        };
        if pointer.modifiers.command {
            // With Ctrl or Cmd, a click adds the part to the selection or removes it.
            if !session.selection.remove(&hit.part) {
                session.selection.insert(hit.part);
            }
            return Gesture::Idle;
        }
        if !session.selection.contains(&hit.part) {
            session.selection = BTreeSet::from([hit.part]);
        }
        if pointer.double && matches!(hit.part, Part::Line { .. } | Part::Field) {
            if let Some(part) = edit::insert(&mut session.site, camera, hit.part, hit.edge, at) {
                session.selection = BTreeSet::from([part]);
                let name = session.part_name(part);
                session.commit(format!("insert a point into {name}"));
            }
            return Gesture::Idle;
        }
        match hit.part {
            Part::Mark(mark) => MarkDrag::start(session, mark, pointer).map_or(Gesture::Idle, Gesture::Mark),
            _ => Gesture::Parts { camera, from: at, at },
        }
    }

    /// Starts the gesture of a press on the plan: a drag of a mark or of a camera.
    fn press_plan(session: &mut Session, pointer: &Pointer) -> Gesture {
        if let Some(mark) = MarkDrag::under(session, pointer) {
            session.selection = BTreeSet::from([Part::Mark(mark)]);
            return MarkDrag::start(session, mark, pointer).map_or(Gesture::Idle, Gesture::Mark);
        }
        PlaceDrag::start(session, pointer).map_or(Gesture::Idle, Gesture::Place)
    }

    /// Adds all points inside a box to the selection; `from` and `to` are opposite corners of the box, in raw pixels.
    fn select_in_box(session: &mut Session, camera: usize, from: Pixel, to: Pixel) {
        let inside = |p: Pixel| (p.u - from.u) * (p.u - to.u) <= 0.0 && (p.v - from.v) * (p.v - to.v) <= 0.0;
        let found = hit::handles(&session.site, camera).into_iter().filter(|&(_, pixel)| inside(pixel));
        session.selection.extend(found.map(|(part, _)| part));
    }
}

/// Sets the standard deviation of a moved link point or control point to the accuracy of the drag. Points
/// that were moved together keep their standard deviations. A point that is more accurate than a click also
/// keeps its value.
fn set_click_sigma(session: &mut Session, camera: usize, pointer: &Pointer) {
    let mut parts = session.selection.iter().copied();
    let (Some(part), None) = (parts.next(), parts.next()) else { return };
    let drawn = annotation_sigma_px(session, camera);
    let fine = if pointer.modifiers.shift { FINE_DRAG } else { 1.0 };
    let seen_now =
        Pointer { point_size: fine * pointer.point_size, ..pointer.clone() }.sigma_px(session, camera);
    let is_click = |sigma: Option<f64>| sigma.is_none_or(|sigma| sigma > drawn);
    match part {
        Part::Link { link, seen, .. } => {
            let seen = session.site.links.get_mut(link).and_then(|link| link.seen.get_mut(seen));
            let Some(seen) = seen.filter(|seen| is_click(seen.sigma_px)) else { return };
            // The other end of a post or a line keeps its position and accuracy.
            let other = seen.sigma_px.filter(|_| seen.px.is_none());
            seen.sigma_px = seen_now.into_iter().chain(other).reduce(f64::max);
        }
        Part::Control(index) => {
            let entry = session.site.cameras.get_mut(camera);
            let point = entry.and_then(|entry| entry.control_points.get_mut(index));
            let Some(point) = point.filter(|point| is_click(point.sigma_px)) else { return };
            point.sigma_px = seen_now;
        }
        _ => {}
    }
}

impl Tool for Select {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        let gesture = std::mem::take(&mut self.gesture);
        self.gesture = match (gesture, pointer.phase) {
            (Gesture::Idle, Phase::Press) => Self::press(session, pointer),
            (Gesture::Parts { camera, from, at }, phase) if pointer.pane == Pane::Image(camera) => {
                let at = if pointer.moved { drag_selection(session, camera, from, pointer) } else { at };
                if phase != Phase::Release {
                    Gesture::Parts { camera, from, at }
                } else {
                    if pointer.moved {
                        // A single point is already on the edge under the pointer.
                        let is_line = !matches!(session.selection.first(), Some(Part::Vertex { .. }))
                            || session.selection.len() > 1;
                        let pulls = pointer.modifiers.alt && is_line;
                        if let Some(image) = pointer.image.as_deref().filter(|_| pulls) {
                            let parts = session.selection.clone();
                            let moved = edit::points_of(&session.site, camera, &parts);
                            let lens = hit::lens_of(&session.site, camera, session.solved.pose(camera));
                            snap::pull_points(&mut session.site, camera, &moved, lens, image);
                        }
                        set_click_sigma(session, camera, pointer);
                        let name = session.selection_name();
                        session.commit(format!("move {name}"));
                    }
                    Gesture::Idle
                }
            }
            (Gesture::SelectionBox { camera, from, to }, phase) if pointer.pane == Pane::Image(camera) => {
                if phase == Phase::Release {
                    Self::select_in_box(session, camera, from, to);
                    Gesture::Idle
                } else {
                    Gesture::SelectionBox { camera, from, to: pointer.at.into() }
                }
            }
            (Gesture::Mark(drag), Phase::Release) => {
                drag.finish(session);
                Gesture::Idle
            }
            (Gesture::Mark(drag), _) => Gesture::Mark(drag.drag(session, pointer)),
            (Gesture::Place(drag), Phase::Release) => {
                drag.finish(session);
                Gesture::Idle
            }
            (Gesture::Place(drag), _) => Gesture::Place(drag.drag(session, pointer)),
            (other, _) => other,
        };
    }

    fn cancel(&mut self) {
        self.gesture = Gesture::Idle;
    }

    fn is_idle(&self) -> bool {
        matches!(self.gesture, Gesture::Idle)
    }

    fn hint(&self, session: &Session) -> String {
        match &self.gesture {
            Gesture::Idle if session.selection.is_empty() => {
                "Click a line or handle to select it; drag to move it.".into()
            }
            Gesture::Idle => format!(
                "Drag {}, or nudge with the arrow keys by 0.1 px (Shift: 1 px).  D: duplicate, Del: delete",
                session.selection_name()
            ),
            Gesture::Parts { .. } => {
                let alt =
                    if edit::lines_of(&session.selection).is_empty() { "" } else { " Alt: snap to edge," };
                format!("Release to place {}.  Shift: fine,{alt} Esc: cancel", session.selection_name())
            }
            Gesture::SelectionBox { .. } => "Release to select everything inside the box.".into(),
            Gesture::Mark(drag) => drag.hint().into(),
            Gesture::Place(drag) => drag.hint(session),
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        match self.gesture {
            Gesture::Parts { camera, at, .. } => Some((Pane::Image(camera), at.into())),
            _ => None,
        }
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        match self.gesture {
            Gesture::SelectionBox { camera, from, to } if pane == Pane::Image(camera) => {
                vec![vec![from.into(), [to.u, from.v], to.into(), [from.u, to.v], from.into()]]
            }
            _ => Vec::new(),
        }
    }
}
