//! Draws a line of one kind: drag, or click and click.

use calib_core::{Kind, Pixel};

use calib_core::single::Shape;

use calib_image::pull_drawn;
use calib_site::SiteCamera;

use crate::edit;
use crate::hit::{self, Part};
use crate::session::Session;
use crate::tools::{Pane, Phase, Pointer, Tool};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Gesture {
    #[default]
    Idle,
    /// The button is down where the line begins.
    Pressed { camera: usize, start: Pixel, end: Pixel },
    /// A click set the beginning; the end follows the pointer.
    Placed { camera: usize, start: Pixel, end: Pixel },
}

/// The tool of the kinds that are drawn as segments, or from foot to head.
#[derive(Debug)]
pub(super) struct Segment {
    kind: Kind,
    gesture: Gesture,
    /// The line in the hand as it is shown.
    shown: [Pixel; 2],
}

/// A line shorter than this is a slip, in pixels.
const LEAST: f64 = 2.0;

impl Segment {
    pub(super) const fn new(kind: Kind) -> Self {
        Self { kind, gesture: Gesture::Idle, shown: [Pixel::new(0.0, 0.0); 2] }
    }

    fn show(&self, session: &mut Session, camera: usize, line: [Pixel; 2]) -> Option<Part> {
        session.revert();
        if line[0].distance(line[1]) < LEAST {
            return None;
        }
        let fresh = session.fresh_group;
        let entry = session.site.cameras.get_mut(camera)?;
        let part = edit::add_line(entry, self.kind, line.to_vec(), fresh);
        session.select_only(camera, part);
        Some(part)
    }

    /// Whether the next line is added to those of its kind that were drawn last.
    fn goes_on(&self, session: &Session) -> bool {
        let is_drawn = |entry: &SiteCamera| entry.annotations.iter().any(|drawn| drawn.kind == self.kind);
        !session.fresh_group && session.entry().is_some_and(is_drawn)
    }

    fn finish(&self, session: &mut Session, camera: usize, line: [Pixel; 2], pointer: &Pointer) -> Gesture {
        self.end(session, camera, pulled(session, camera, line, pointer));
        Gesture::Idle
    }

    fn end(&self, session: &mut Session, camera: usize, line: [Pixel; 2]) {
        if let Some(part) = self.show(session, camera, line) {
            let name = format!("add {}", session.part_name(part));
            session.fresh_group = false;
            session.commit(name);
            if self.kind.row().has_length {
                session.note = Some("Enter its length in the list: until then it says nothing.".into());
            }
        }
    }
}

/// The line on the edge that it runs along, while Alt asks for that and there is one.
fn pulled(session: &Session, camera: usize, line: [Pixel; 2], pointer: &Pointer) -> [Pixel; 2] {
    let still = pointer.still.as_deref().filter(|_| pointer.modifiers.alt);
    let lens = hit::lens_of(&session.site, camera, session.solved.pose(camera));
    still.zip(lens).and_then(|(still, lens)| pull_drawn(still, &lens, line)).unwrap_or(line)
}

/// Foot first for what stands upright.
fn upright(kind: Kind, [a, b]: [Pixel; 2]) -> [Pixel; 2] {
    if kind.row().shape == Shape::FootAndHead && a.v < b.v { [b, a] } else { [a, b] }
}

impl Tool for Segment {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        let Some((camera, at)) = pointer.pixel() else { return };
        self.gesture = match (std::mem::take(&mut self.gesture), pointer.phase) {
            (Gesture::Idle, Phase::Press) => {
                session.choose(camera);
                Gesture::Pressed { camera, start: at, end: at }
            }
            // Another view is not where this line ends.
            (held @ (Gesture::Pressed { camera: own, .. } | Gesture::Placed { camera: own, .. }), _)
                if own != camera =>
            {
                held
            }
            (Gesture::Pressed { start, .. }, Phase::Release) if pointer.moved => {
                self.finish(session, camera, [start, at], pointer)
            }
            // A click on an edge that was found takes the edge.
            (Gesture::Pressed { start, .. }, Phase::Release) => match pointer.offer {
                Some(edge) => self.finish(session, camera, upright(self.kind, edge), pointer),
                None => Gesture::Placed { camera, start, end: at },
            },
            (Gesture::Pressed { start, .. }, _) => {
                // The edge that it would be pulled onto is seen before it is taken.
                self.shown = pulled(session, camera, [start, at], pointer);
                self.show(session, camera, self.shown);
                Gesture::Pressed { camera, start, end: at }
            }
            (Gesture::Placed { start, .. }, Phase::Release) => {
                self.finish(session, camera, [start, at], pointer)
            }
            (Gesture::Placed { start, .. }, _) => {
                self.shown = pulled(session, camera, [start, at], pointer);
                self.show(session, camera, self.shown);
                Gesture::Placed { camera, start, end: at }
            }
            (Gesture::Idle, _) => Gesture::Idle,
        };
    }

    fn accept(&mut self, session: &mut Session) {
        // The line ends as it is shown, on its edge if Alt is held.
        if let Gesture::Placed { camera, .. } = std::mem::take(&mut self.gesture) {
            self.end(session, camera, self.shown);
        }
    }

    fn cancel(&mut self) {
        self.gesture = Gesture::Idle;
    }

    fn is_idle(&self) -> bool {
        self.gesture == Gesture::Idle
    }

    fn hint(&self, session: &Session) -> String {
        let title = self.kind.row().title.to_lowercase();
        match (self.gesture, self.kind) {
            (Gesture::Idle, Kind::Upright) => {
                "Press on the foot of a person or post, drag to the head.".into()
            }
            (Gesture::Idle, Kind::Perpendicular) => {
                let open = session.entry().and_then(|e| e.annotations.iter().rfind(|a| a.kind == self.kind));
                match open.and_then(|a| a.segments.as_ref()).map_or(0, Vec::len) {
                    1 => "Draw the second line, at right angles to the first.".into(),
                    _ => "Draw the first of two floor lines at right angles.".into(),
                }
            }
            (Gesture::Idle, Kind::Vertical) => "Draw along something plumb: drag, or click both ends.".into(),
            (Gesture::Idle, Kind::Parallel) if self.goes_on(session) => {
                "Draw a line parallel to those just drawn.  W: begin another direction".into()
            }
            (Gesture::Idle, _) => format!("Draw a {title} line on the floor: drag, or click both ends."),
            (Gesture::Pressed { .. }, _) => "Release to set the end.  Alt: pull onto the edge".into(),
            (Gesture::Placed { .. }, _) => "Click or Enter to set the end.  Alt: pull onto the edge".into(),
        }
    }

    fn held(&self) -> Option<(Pane, [f64; 2])> {
        match self.gesture {
            Gesture::Idle => None,
            Gesture::Pressed { camera, end, .. } | Gesture::Placed { camera, end, .. } => {
                Some((Pane::Image(camera), end.into()))
            }
        }
    }
}
