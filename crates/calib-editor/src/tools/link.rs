//! Links from view to view: one thing of the scene, clicked in every view that shows it.

use calib_core::Pixel;

use calib_site::{Link, LinkKind, LinkSeen};

use crate::edit;
use crate::hit::Part;
use crate::session::Session;
use crate::tools::{COARSE, Pane, Phase, Pointer, Tool, coarse};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Gesture {
    #[default]
    Idle,
    /// The button is down; a drag makes a line of the floor, a click a point.
    Pressed { camera: usize, start: Pixel, end: Pixel },
}

/// The tool of links. The one begun last waits for another view until Enter or Esc, and so does one that is
/// selected.
#[derive(Debug, Default)]
pub(super) struct Linking {
    gesture: Gesture,
    /// The id of the link that waits.
    waiting: Option<String>,
}

fn sighting(camera: &str, [start, end]: [Pixel; 2], kind: LinkKind, sigma_px: Option<f64>) -> LinkSeen {
    let seen = LinkSeen { sigma_px, ..LinkSeen::new(camera) };
    match kind {
        LinkKind::Point => LinkSeen { px: Some(end), ..seen },
        LinkKind::Post => LinkSeen { foot: Some(start), head: Some(end), ..seen },
        LinkKind::Line => LinkSeen { segment: Some(vec![start, end]), ..seen },
    }
}

/// The link that is selected.
fn selected(session: &Session) -> Option<usize> {
    session.selection.iter().find_map(|part| match part {
        Part::Link { link, .. } => Some(*link),
        _ => None,
    })
}

impl Linking {
    /// A link that is clicked waits for more views, and what waited for this one becomes a part of it.
    fn take_up(&mut self, session: &mut Session, drawn: usize, begun: Option<usize>) {
        let free = edit::free_id(&session.site, 'L');
        let links = &mut session.site.links;
        let is_named = links[drawn].id.is_some();
        let name = links[drawn].id.get_or_insert(free).clone();
        let begun = begun.filter(|index| *index != drawn);
        let waited = begun.and_then(|index| links.get(index)).cloned();
        let is_apart = |link: &Link| {
            let shown = |seen: &LinkSeen| links[drawn].seen.iter().any(|own| own.camera == seen.camera);
            link.kind == LinkKind::Point && !link.seen.iter().any(shown)
        };
        if let (Some(index), Some(link)) = (begun, waited.filter(is_apart)) {
            links[drawn].seen.extend(link.seen);
            links.remove(index);
            let joined = link.id.unwrap_or_default();
            session.commit(format!("join {joined} and {name}"));
        } else if !is_named {
            session.commit(format!("name {name}"));
        }
        session.selection.retain(|part| !matches!(part, Part::Link { .. }));
        self.waiting = Some(name);
    }

    /// What is selected waits from now on: another camera is chosen without it.
    fn take_selected(&mut self, session: &Session) {
        let link = selected(session).and_then(|index| session.site.links.get(index));
        if let Some(id) = link.and_then(|link| link.id.clone()) {
            self.waiting = Some(id);
        }
    }

    fn finish(&mut self, session: &mut Session, camera: usize, start: Pixel, pointer: &Pointer) {
        if !session.may_share(camera) {
            return;
        }
        let Some(id) = session.site.cameras.get(camera).map(|camera| camera.id.clone()) else { return };
        let sigma = pointer.sigma_px(session, camera);
        let ends = [start, pointer.at.into()];
        let begun = self.begun(session);
        session.choose(camera);
        if let Some(drawn) = drawn_at(session, &id, pointer) {
            return self.take_up(session, drawn, begun);
        }
        let free = edit::free_id(&session.site, 'L');
        let begun = begun.and_then(|index| session.site.links.get_mut(index));
        let open = begun.filter(|link| {
            (link.kind != LinkKind::Point) == pointer.moved
                && link.seen.iter().all(|known| known.camera != id)
        });
        let name = if let Some(link) = open {
            link.seen.push(sighting(&id, ends, link.kind, sigma));
            link.id.get_or_insert(free).clone()
        } else {
            let kind = if pointer.moved { LinkKind::Line } else { LinkKind::Point };
            let seen = vec![sighting(&id, ends, kind, sigma)];
            session.site.links.push(Link::new(Some(free.clone()), kind, seen));
            free
        };
        // It is this one that waits, whatever was selected.
        session.selection.retain(|part| !matches!(part, Part::Link { .. }));
        session.commit(format!("link {name} in {id}"));
        if let (Some(sigma), None) = (sigma.filter(|sigma| *sigma > COARSE), &session.note) {
            session.note = Some(coarse(&name, sigma));
        }
        self.waiting = Some(name);
    }
}

/// The point that a click is on in this camera, by its link.
fn drawn_at(session: &Session, camera: &str, pointer: &Pointer) -> Option<usize> {
    let at = Pixel::from(pointer.at);
    let is_there = |seen: &LinkSeen| {
        seen.camera == camera && seen.px.is_some_and(|px| px.distance(at) <= pointer.radius)
    };
    let is_drawn = |link: &Link| link.kind == LinkKind::Point && link.seen.iter().any(is_there);
    (!pointer.moved).then(|| session.site.links.iter().position(is_drawn)).flatten()
}

impl Tool for Linking {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        let Some((camera, at)) = pointer.pixel() else { return };
        self.take_selected(session);
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

    fn begun(&self, session: &Session) -> Option<usize> {
        let waits = |link: &Link| self.waiting.is_some() && link.id == self.waiting;
        selected(session).or_else(|| session.site.links.iter().position(waits))
    }

    fn accept(&mut self, session: &mut Session) {
        self.waiting = None;
        session.selection.retain(|part| !matches!(part, Part::Link { .. }));
    }

    fn cancel(&mut self) {
        // A link that waits goes on waiting: the next view may have to be chosen first.
        self.gesture = Gesture::Idle;
    }

    fn is_idle(&self) -> bool {
        // A link that waits for another view is a finished gesture all the same.
        self.gesture == Gesture::Idle
    }

    fn hint(&self, session: &Session) -> String {
        if let Gesture::Pressed { .. } = self.gesture {
            return "Release to link this point; drag along a floor line to link the line.".into();
        }
        let Some(link) = self.begun(session).and_then(|index| session.site.links.get(index)) else {
            return "Click something that another view shows too; drag along a line of the floor.".into();
        };
        let id = link.id.as_deref().unwrap_or("it");
        let says = match link.kind {
            LinkKind::Point => format!("Click {id} in another view: it lies on the yellow line."),
            LinkKind::Post => {
                format!("Drag {id} from foot to head in another view: it stands at the yellow line.")
            }
            LinkKind::Line => format!("Drag along {id} in another view: it lies along the yellow line."),
        };
        format!("{says}  Enter: next link")
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
