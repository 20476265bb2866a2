//! Line tools: each adds lines of one kind, by a drag or by two clicks.

use calib_core::{Kind, Pixel};

use calib_core::single::Shape;

use calib_site::SiteCamera;

use crate::edit;
use crate::hit::{self, Part};
use crate::session::Session;
use crate::snap::snap_end;
use crate::tools::grab::Grab;
use crate::tools::{Pane, Phase, Pointer, Tool};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Gesture {
    #[default]
    Idle,
    /// The button is down; `start` is the first end of the line.
    Pressed { camera: usize, start: Pixel, end: Pixel },
    /// The first end was set by a click; the second end follows the pointer.
    Placed { camera: usize, start: Pixel, end: Pixel },
    /// The button is down on an existing point.
    Grabbed(Grab),
}

/// Tool that adds lines with two ends to an annotation, or uprights from foot to head.
#[derive(Debug)]
pub(super) struct Segment {
    kind: Kind,
    gesture: Gesture,
    /// Line of the current gesture as displayed, in raw pixels.
    shown: [Pixel; 2],
    /// Whether the first end moves onto the edge under it, because Alt was pressed when it was set.
    snaps_start: bool,
}

/// Smallest length of a line, in raw pixels; shorter lines are discarded.
const MIN_LINE_LENGTH_PX: f64 = 2.0;

impl Segment {
    pub(super) const fn new(kind: Kind) -> Self {
        Self { kind, gesture: Gesture::Idle, shown: [Pixel::new(0.0, 0.0); 2], snaps_start: false }
    }

    /// Writes the line into the site without an undo step, and selects it. `None` if the line is too short.
    fn show(&self, session: &mut Session, camera: usize, line: [Pixel; 2]) -> Option<Part> {
        session.revert();
        if line[0].distance(line[1]) < MIN_LINE_LENGTH_PX {
            return None;
        }
        let fresh = session.tool.fresh_group;
        let entry = session.site.cameras.get_mut(camera)?;
        let part = edit::add_line(entry, self.kind, line.to_vec(), fresh);
        session.select_only(camera, part);
        Some(part)
    }

    /// Whether the next line is added to the last annotation of its kind.
    fn joins_last(&self, session: &Session) -> bool {
        let is_drawn = |entry: &SiteCamera| entry.annotations.iter().any(|drawn| drawn.kind == self.kind);
        !session.tool.fresh_group && session.entry().is_some_and(is_drawn)
    }

    /// Adds the line and ends the gesture. An end that is set with Alt is moved onto the image edge under it.
    fn finish(&self, session: &mut Session, camera: usize, line: [Pixel; 2], pointer: &Pointer) -> Gesture {
        self.add_line(session, camera, self.on_edges(session, camera, line, pointer));
        Gesture::Idle
    }

    /// Returns the line with each end on the image edge under it, if Alt is pressed at that end.
    fn on_edges(
        &self,
        session: &Session,
        camera: usize,
        [start, end]: [Pixel; 2],
        pointer: &Pointer,
    ) -> [Pixel; 2] {
        let lens = hit::lens_of(&session.site, camera, session.solved.pose(camera));
        let (Some(image), Some(lens)) = (pointer.image.as_deref(), lens) else { return [start, end] };
        let snapped = |snaps: bool, other: Pixel, at: Pixel| {
            snaps.then(|| snap_end(image, &lens, other, at)).flatten().unwrap_or(at)
        };
        [snapped(self.snaps_start, end, start), snapped(pointer.modifiers.alt, start, end)]
    }

    /// Shows the unfinished line, with each end on the image edge under it if Alt is pressed at that end.
    fn follow(&mut self, session: &mut Session, camera: usize, line: [Pixel; 2], pointer: &Pointer) {
        self.shown = self.on_edges(session, camera, line, pointer);
        self.show(session, camera, self.shown);
    }

    /// Processes a click, which accepts a detected edge or sets the first end of a line. Returns the next gesture.
    fn click(
        &mut self,
        session: &mut Session,
        (camera, start): (usize, Pixel),
        pointer: &Pointer,
    ) -> Gesture {
        match pointer.edge {
            Some(edge) => {
                self.add_line(session, camera, from_foot_to_head(self.kind, edge));
                Gesture::Idle
            }
            None => {
                self.shown = [start, start];
                Gesture::Placed { camera, start, end: pointer.at.into() }
            }
        }
    }

    /// Adds the line to the site as an undo step.
    fn add_line(&self, session: &mut Session, camera: usize, line: [Pixel; 2]) {
        if let Some(part) = self.show(session, camera, line) {
            let name = format!("add {}", session.part_name(part));
            session.tool.fresh_group = false;
            session.commit(name);
            let is_upright = self.kind.row().shape == Shape::FootAndHead;
            let is_open =
                session.entry().and_then(|entry| entry.annotations.last()).is_some_and(|drawn| drawn.off);
            let note = match (self.kind.row().has_length, is_upright, is_open) {
                (true, ..) => "Enter the length of the line in the list. The line is not used until then.",
                (_, true, true) => {
                    "Choose person or door in the list, or enter a height. The upright is not used until \
                     then."
                }
                (_, true, false) => {
                    "This upright has the height of the previous one. Change the height in the list if it \
                     differs."
                }
                _ => return,
            };
            session.note = Some(note.into());
        }
    }
}

/// Orders the ends of an upright as foot and head: the foot is lower in the image. Other lines stay
/// unchanged.
fn from_foot_to_head(kind: Kind, [a, b]: [Pixel; 2]) -> [Pixel; 2] {
    if kind.row().shape == Shape::FootAndHead && a.v < b.v { [b, a] } else { [a, b] }
}

impl Tool for Segment {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        let Some((camera, at)) = pointer.pixel() else { return };
        self.gesture = match (std::mem::take(&mut self.gesture), pointer.phase) {
            (Gesture::Idle, Phase::Press) => {
                session.select_camera(camera);
                self.snaps_start = pointer.modifiers.alt;
                let pressed = Gesture::Pressed { camera, start: at, end: at };
                Grab::start(session, pointer).map_or(pressed, Gesture::Grabbed)
            }
            // An event in another view does not end the current line.
            (
                gesture @ (Gesture::Pressed { camera: own, .. }
                | Gesture::Placed { camera: own, .. }
                | Gesture::Grabbed(Grab { camera: own, .. })),
                _,
            ) if own != camera => gesture,
            (Gesture::Grabbed(grab), Phase::Release) if !pointer.moved && !grab.has_moved => {
                self.click(session, (camera, grab.from), pointer)
            }
            (Gesture::Grabbed(grab), _) => {
                grab.follow(session, pointer).map_or(Gesture::Idle, Gesture::Grabbed)
            }
            (Gesture::Pressed { start, .. }, Phase::Release) if pointer.moved => {
                self.finish(session, camera, [start, at], pointer)
            }
            // A click on a detected edge accepts that edge.
            (Gesture::Pressed { start, .. }, Phase::Release) => self.click(session, (camera, start), pointer),
            (Gesture::Pressed { start, .. }, _) => {
                self.follow(session, camera, [start, at], pointer);
                Gesture::Pressed { camera, start, end: at }
            }
            (Gesture::Placed { start, .. }, Phase::Release) => {
                self.finish(session, camera, [start, at], pointer)
            }
            (Gesture::Placed { start, .. }, _) => {
                self.follow(session, camera, [start, at], pointer);
                Gesture::Placed { camera, start, end: at }
            }
            (Gesture::Idle, _) => Gesture::Idle,
        };
    }

    fn accept(&mut self, session: &mut Session) {
        // The line is added as displayed, with its end on an edge while Alt is pressed.
        if let Gesture::Placed { camera, .. } = self.gesture {
            self.gesture = Gesture::Idle;
            self.add_line(session, camera, self.shown);
        }
    }

    fn cancel(&mut self) {
        self.gesture = Gesture::Idle;
    }

    fn is_idle(&self) -> bool {
        self.gesture == Gesture::Idle
    }

    fn hint(&self, session: &Session) -> String {
        match (self.gesture, self.kind) {
            (Gesture::Idle, Kind::Upright) => "Drag from the foot of a person or post to the head.".into(),
            (Gesture::Idle, Kind::Perpendicular) => {
                let open = session.entry().and_then(|e| e.annotations.iter().rfind(|a| a.kind == self.kind));
                match open.and_then(|a| a.segments.as_ref()).map_or(0, Vec::len) {
                    1 => "Draw the second line, at right angles to the first.".into(),
                    _ => "Draw the first of two floor lines at right angles.".into(),
                }
            }
            (Gesture::Idle, Kind::Vertical) => "Draw along a vertical edge: drag, or click both ends.".into(),
            (Gesture::Idle, Kind::Parallel) if self.joins_last(session) => {
                "Draw a line parallel to the previous ones.  W: new direction".into()
            }
            (Gesture::Idle, Kind::EqualLength) => {
                "Draw one of the lines of equal length on the floor: drag, or click both ends.".into()
            }
            (Gesture::Idle, Kind::KnownLength) => {
                "Draw a line of known length on the floor: drag, or click both ends.".into()
            }
            (Gesture::Idle, _) => {
                "Draw one of the parallel lines on the floor: drag, or click both ends.".into()
            }
            (Gesture::Pressed { .. }, _) => "Release to end the line.  Alt: snap to edge".into(),
            (Gesture::Grabbed(grab), _) => grab.hint(session),
            (Gesture::Placed { .. }, _) => "Click or press Enter to end the line.  Alt: snap to edge".into(),
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        match self.gesture {
            Gesture::Idle => None,
            Gesture::Grabbed(grab) => Some((Pane::Image(grab.camera), grab.at.into())),
            Gesture::Pressed { camera, end, .. } | Gesture::Placed { camera, end, .. } => {
                Some((Pane::Image(camera), end.into()))
            }
        }
    }
}
