//! Polyline tools: a straight edge or the field of view, point by point.

use calib_core::{Kind, Pixel};

use crate::edit;
use crate::hit::Part;
use crate::session::Session;
use crate::tools::grab::Grab;
use crate::tools::{Pane, Phase, Pointer, Tool};

#[derive(Clone, Debug, Default, PartialEq)]
enum Gesture {
    #[default]
    Idle,
    /// The polyline is being drawn. The last of its points follows the pointer.
    Drawing { camera: usize, points: Vec<Pixel> },
    /// The button is down on an existing point.
    Grabbed(Grab),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PolylineKind {
    StraightEdge,
    Field,
}

/// Tool that draws polylines with more than two points.
#[derive(Debug)]
pub(super) struct Polyline {
    kind: PolylineKind,
    gesture: Gesture,
    is_done: bool,
}

impl Polyline {
    pub(super) const fn straight() -> Self {
        Self { kind: PolylineKind::StraightEdge, gesture: Gesture::Idle, is_done: false }
    }

    pub(super) const fn field() -> Self {
        Self { kind: PolylineKind::Field, gesture: Gesture::Idle, is_done: false }
    }

    /// Writes the unfinished polyline into the site and selects it.
    fn show(&self, session: &mut Session, camera: usize, points: &[Pixel]) {
        session.revert();
        if points.len() < 3 {
            return;
        }
        let Some(entry) = session.site.cameras.get_mut(camera) else { return };
        let part = match self.kind {
            PolylineKind::StraightEdge => edit::add_line(entry, Kind::Straight, points.to_vec(), true),
            PolylineKind::Field => {
                entry.efov_px = Some(points.to_vec());
                Part::Field
            }
        };
        session.select_only(camera, part);
    }

    /// Finishes the polyline with these points; fewer than three points are discarded.
    fn finish(&mut self, session: &mut Session, camera: usize, points: &[Pixel]) {
        self.show(session, camera, points);
        if points.len() < 3 {
            let note = match self.kind {
                PolylineKind::Field => "Click at least three corners.",
                PolylineKind::StraightEdge => "Click at least three points.",
            };
            session.note = Some(note.into());
            return;
        }
        match self.kind {
            PolylineKind::Field => {
                session.commit("draw the field of view");
                self.is_done = true;
            }
            PolylineKind::StraightEdge => {
                let part = session.selection.first().copied();
                let name = part.map_or_else(String::new, |part| session.part_name(part));
                session.commit(format!("add {name}"));
            }
        }
    }
}

impl Tool for Polyline {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        let Some((camera, at)) = pointer.pixel() else { return };
        self.gesture = match std::mem::take(&mut self.gesture) {
            Gesture::Idle if pointer.phase == Phase::Press => {
                session.select_camera(camera);
                let grab = Grab::start(session, pointer).filter(|_| self.kind == PolylineKind::StraightEdge);
                grab.map_or_else(|| Gesture::Drawing { camera, points: vec![at, at] }, Gesture::Grabbed)
            }
            Gesture::Grabbed(grab) if grab.camera != camera => Gesture::Grabbed(grab),
            Gesture::Grabbed(grab)
                if pointer.phase == Phase::Release && !pointer.moved && !grab.has_moved =>
            {
                Gesture::Drawing { camera, points: vec![grab.from, at] }
            }
            Gesture::Grabbed(grab) => grab.follow(session, pointer).map_or(Gesture::Idle, Gesture::Grabbed),
            Gesture::Drawing { camera: own, mut points } if own == camera => {
                if let Some(last) = points.last_mut() {
                    *last = at;
                }
                let set = points.len() - 1;
                let closes = set >= 3
                    && self.kind == PolylineKind::Field
                    && points.first().is_some_and(|first| first.distance(at) <= pointer.radius);
                // The first press adds the first point; its release does not add the second one.
                let is_new =
                    points.get(set.wrapping_sub(1)).is_some_and(|p| p.distance(at) > 0.5 * pointer.radius);
                match pointer.phase {
                    Phase::Release if closes || (pointer.double && set >= 3) => {
                        self.finish(session, camera, &points[..set]);
                        Gesture::Idle
                    }
                    Phase::Release if is_new => {
                        points.push(at);
                        self.show(session, camera, &points);
                        Gesture::Drawing { camera, points }
                    }
                    _ => {
                        self.show(session, camera, &points);
                        Gesture::Drawing { camera, points }
                    }
                }
            }
            other => other,
        };
    }

    fn accept(&mut self, session: &mut Session) {
        let Gesture::Drawing { camera, points } = &mut self.gesture else { return };
        let (camera, points) = (*camera, std::mem::take(points));
        self.gesture = Gesture::Idle;
        self.finish(session, camera, &points[..points.len() - 1]);
    }

    fn step_back(&mut self, session: &mut Session) -> bool {
        let Gesture::Drawing { camera, points } = &mut self.gesture else { return false };
        let (camera, end) = (*camera, points.pop());
        points.pop();
        if points.is_empty() {
            self.cancel();
            session.revert();
            return true;
        }
        points.extend(end);
        let points = points.clone();
        self.show(session, camera, &points);
        true
    }

    fn cancel(&mut self) {
        self.gesture = Gesture::Idle;
    }

    fn is_idle(&self) -> bool {
        self.gesture == Gesture::Idle
    }

    fn is_done(&self) -> bool {
        self.is_done
    }

    fn hint(&self, session: &Session) -> String {
        match (&self.gesture, self.kind) {
            (Gesture::Grabbed(grab), _) => grab.hint(session),
            (Gesture::Idle, PolylineKind::StraightEdge) => {
                "Click three or more points along an edge that is straight in reality.".into()
            }
            (Gesture::Idle, PolylineKind::Field) => {
                "Click the corners of the floor area that this camera should cover.".into()
            }
            (Gesture::Drawing { points, .. }, makes) => {
                let left = 4_usize.saturating_sub(points.len());
                match (left, makes) {
                    (0, PolylineKind::Field) => {
                        "Click the next corner, or the first one to close.  Enter: close".into()
                    }
                    (0, PolylineKind::StraightEdge) => {
                        "Click the next point.  Enter or double-click: finish, then J: snap to edge".into()
                    }
                    (_, PolylineKind::Field) => format!("Click the next corner; {left} more needed."),
                    (_, PolylineKind::StraightEdge) => format!("Click the next point; {left} more needed."),
                }
            }
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        match &self.gesture {
            Gesture::Drawing { camera, points } => {
                points.last().map(|&end| (Pane::Image(*camera), end.into()))
            }
            Gesture::Grabbed(grab) => Some((Pane::Image(grab.camera), grab.at.into())),
            Gesture::Idle => None,
        }
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        match &self.gesture {
            Gesture::Drawing { camera, points } if pane == Pane::Image(*camera) => {
                vec![points.iter().map(|&point| point.into()).collect()]
            }
            _ => Vec::new(),
        }
    }
}
