//! Links from view to view: one thing of the scene, clicked in every view that shows it.

use calib_core::{Link, LinkKind, LinkSeen, Pixel};

use crate::edit;
use crate::session::Session;
use crate::tools::{Pane, Phase, Pointer, Tool};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Gesture {
    #[default]
    Idle,
    /// The button is down; a drag makes a line of the floor, a click a point.
    Pressed { camera: usize, start: Pixel, end: Pixel },
}

/// The tool of links. The one begun last waits for another view until Enter or Esc.
#[derive(Debug, Default)]
pub(super) struct Linking {
    gesture: Gesture,
    /// The id of the link that waits.
    waiting: Option<String>,
}

fn sighting(camera: &str, start: Pixel, end: Pixel, is_line: bool) -> LinkSeen {
    LinkSeen {
        px: (!is_line).then_some(end),
        segment: is_line.then(|| vec![start, end]),
        ..LinkSeen::new(camera)
    }
}

impl Linking {
    fn finish(&mut self, session: &mut Session, camera: usize, start: Pixel, pointer: &Pointer) {
        let Some(id) = session.site.cameras.get(camera).map(|camera| camera.id.clone()) else { return };
        let seen = sighting(&id, start, pointer.at.into(), pointer.moved);
        let kind = if pointer.moved { LinkKind::Line } else { LinkKind::Point };
        session.choose(camera);
        let open = self.waiting.as_ref().and_then(|waiting| {
            session.site.links.iter_mut().find(|link| {
                link.id.as_ref() == Some(waiting)
                    && link.kind == kind
                    && link.seen.iter().all(|known| known.camera != id)
            })
        });
        let name = if let Some(link) = open {
            link.seen.push(seen);
            link.id.clone().unwrap_or_default()
        } else {
            let name = edit::free_id(&session.site, 'L');
            session.site.links.push(Link::new(Some(name.clone()), kind, vec![seen]));
            name
        };
        session.commit(format!("link {name} in {id}"));
        self.waiting = Some(name);
    }
}

impl Tool for Linking {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        let Some((camera, at)) = pointer.pixel() else { return };
        self.gesture = match (self.gesture, pointer.phase) {
            (Gesture::Idle, Phase::Press) => Gesture::Pressed { camera, start: at, end: at },
            (Gesture::Pressed { camera: own, start, .. }, Phase::Release) if own == camera => {
                self.finish(session, camera, start, pointer);
                Gesture::Idle
            }
            (Gesture::Pressed { camera: own, start, .. }, _) if own == camera => {
                Gesture::Pressed { camera, start, end: at }
            }
            (other, _) => other,
        };
    }

    fn accept(&mut self, _: &mut Session) {
        self.waiting = None;
    }

    fn cancel(&mut self) {
        self.gesture = Gesture::Idle;
        self.waiting = None;
    }

    fn is_idle(&self) -> bool {
        // A link that waits for another view is a finished gesture all the same.
        self.gesture == Gesture::Idle
    }

    fn hint(&self, _: &Session) -> String {
        match (&self.gesture, &self.waiting) {
            (Gesture::Pressed { .. }, _) => {
                "Release to link this point; drag along a floor line to link the line.".into()
            }
            (_, None) => {
                "Click something that another view shows too; drag along a line of the floor.".into()
            }
            (_, Some(id)) => {
                format!("Click {id} in another view: it lies on the yellow line.  Enter: next link")
            }
        }
    }

    fn held(&self) -> Option<(Pane, [f64; 2])> {
        match self.gesture {
            Gesture::Pressed { camera, end, .. } => Some((Pane::Image(camera), end.into())),
            Gesture::Idle => None,
        }
    }

    fn rubber(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        match self.gesture {
            Gesture::Pressed { camera, start, end } if pane == Pane::Image(camera) => {
                vec![vec![start.into(), end.into()]]
            }
            _ => Vec::new(),
        }
    }
}
