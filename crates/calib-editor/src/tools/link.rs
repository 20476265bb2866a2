//! Link tool: one object of the scene, clicked in every view that shows it.

use calib_core::Pixel;

use calib_site::{Link, LinkKind, LinkObservation};

use crate::edit;
use crate::epipolar::search_line;
use crate::hit::Part;
use crate::session::Session;
use crate::tools::{MAX_CLICK_SIGMA_PX, Pane, Phase, Pointer, Tool, imprecise_note};

/// Instruction after the first click of a link.
const NEXT_CLICK: &str = "Now click the same point in another camera";

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Gesture {
    #[default]
    Idle,
    /// The button is down; a drag makes a floor line, a click a point.
    Pressed { camera: usize, start: Pixel, end: Pixel },
}

/// Tool that adds links. An observation in another view extends the link that was started last or is
/// selected, until Enter or Esc.
#[derive(Debug, Default)]
pub(super) struct Linking {
    gesture: Gesture,
    /// Id of the link that an observation in another view extends.
    open_id: Option<String>,
}

/// Creates an observation of a link of this kind from a drag.
fn observation(
    camera: &str,
    [start, end]: [Pixel; 2],
    kind: LinkKind,
    sigma_px: Option<f64>,
) -> LinkObservation {
    let seen = LinkObservation { sigma_px, ..LinkObservation::new(camera) };
    match kind {
        LinkKind::Point => LinkObservation { px: Some(end), ..seen },
        LinkKind::Post => LinkObservation { foot: Some(start), head: Some(end), ..seen },
        LinkKind::Line => LinkObservation { segment: Some(vec![start, end]), ..seen },
    }
}

/// Returns the index of the selected link.
fn selected(session: &Session) -> Option<usize> {
    session.selection.iter().find_map(|part| match part {
        Part::Link { link, .. } => Some(*link),
        _ => None,
    })
}

impl Linking {
    /// Lets the next click in another view extend the clicked link `drawn`. If the earlier link `begun` is a point
    /// link and no camera shows both, it is merged into `drawn`.
    fn continue_link(&mut self, session: &mut Session, drawn: usize, begun: Option<usize>) {
        let free = edit::free_id(&session.site, 'L');
        let links = &mut session.site.links;
        let is_named = links[drawn].id.is_some();
        let name = links[drawn].id.get_or_insert(free).clone();
        let begun = begun.filter(|index| *index != drawn);
        let waited = begun.and_then(|index| links.get(index)).cloned();
        let is_apart = |link: &Link| {
            let shown =
                |seen: &LinkObservation| links[drawn].seen.iter().any(|own| own.camera == seen.camera);
            link.kind == LinkKind::Point && !link.seen.iter().any(shown)
        };
        if let (Some(index), Some(link)) = (begun, waited.filter(is_apart)) {
            links[drawn].seen.extend(link.seen);
            links.remove(index);
            let joined = link.id.unwrap_or_default();
            session.commit(format!("join {joined} and {name}"));
        } else if !is_named {
            session.commit(format!("name the link {name}"));
        }
        session.selection.retain(|part| !matches!(part, Part::Link { .. }));
        self.open_id = Some(name);
    }

    /// Stores the id of the selected link as the link to continue, because selecting another camera clears
    /// the selection.
    fn continue_selected(&mut self, session: &Session) {
        let link = selected(session).and_then(|index| session.site.links.get(index));
        if let Some(id) = link.and_then(|link| link.id.clone()) {
            self.open_id = Some(id);
        }
    }

    fn finish(&mut self, session: &mut Session, camera: usize, start: Pixel, pointer: &Pointer) {
        if !session.check_may_share(camera) {
            return;
        }
        let Some(id) = session.site.cameras.get(camera).map(|camera| camera.id.clone()) else { return };
        let sigma = pointer.sigma_px(session, camera);
        let ends = [start, pointer.at.into()];
        let begun = self.open_link(session);
        session.select_camera(camera);
        if let Some(drawn) = link_at(session, &id, pointer) {
            return self.continue_link(session, drawn, begun);
        }
        let free = edit::free_id(&session.site, 'L');
        let begun = begun.and_then(|index| session.site.links.get_mut(index));
        let open = begun.filter(|link| {
            (link.kind != LinkKind::Point) == pointer.moved
                && link.seen.iter().all(|known| known.camera != id)
        });
        let name = if let Some(link) = open {
            link.seen.push(observation(&id, ends, link.kind, sigma));
            link.id.get_or_insert(free).clone()
        } else {
            let kind = if pointer.moved { LinkKind::Line } else { LinkKind::Point };
            let seen = vec![observation(&id, ends, kind, sigma)];
            session.site.links.push(Link::new(Some(free.clone()), kind, seen));
            free
        };
        // The link is continued by its id, so its parts are removed from the selection.
        session.selection.retain(|part| !matches!(part, Part::Link { .. }));
        session.commit(format!("link {name} in {id}"));
        if let (Some(sigma), None) = (sigma.filter(|sigma| *sigma > MAX_CLICK_SIGMA_PX), &session.note) {
            let note = imprecise_note(&name, sigma);
            let is_first = session.site.links.last().is_some_and(|link| link.seen.len() == 1);
            session.note = Some(if is_first { format!("{NEXT_CLICK}. {note}") } else { note });
        }
        self.open_id = Some(name);
    }
}

/// Returns the index of the point link at the pointer in the camera with this id.
fn link_at(session: &Session, camera: &str, pointer: &Pointer) -> Option<usize> {
    let at = Pixel::from(pointer.at);
    let is_there = |seen: &LinkObservation| {
        seen.camera == camera && seen.px.is_some_and(|px| px.distance(at) <= pointer.radius)
    };
    let is_drawn = |link: &Link| link.kind == LinkKind::Point && link.seen.iter().any(is_there);
    (!pointer.moved).then(|| session.site.links.iter().position(is_drawn)).flatten()
}

impl Tool for Linking {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        let Some((camera, at)) = pointer.pixel() else { return };
        self.continue_selected(session);
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

    fn open_link(&self, session: &Session) -> Option<usize> {
        let waits = |link: &Link| self.open_id.is_some() && link.id == self.open_id;
        selected(session).or_else(|| session.site.links.iter().position(waits))
    }

    fn accept(&mut self, session: &mut Session) {
        self.open_id = None;
        session.selection.retain(|part| !matches!(part, Part::Link { .. }));
    }

    fn cancel(&mut self) {
        // The open link stays open: the operator may have to select the next view first.
        self.gesture = Gesture::Idle;
    }

    fn is_idle(&self) -> bool {
        // A link that another view can extend is not an unfinished gesture.
        self.gesture == Gesture::Idle
    }

    fn hint(&self, session: &Session) -> String {
        if let Gesture::Pressed { .. } = self.gesture {
            return "Release to link this point; drag along a floor line to link the line.".into();
        }
        let Some(link) = self.open_link(session).and_then(|index| session.site.links.get(index)) else {
            return "Click a point that another camera also shows, or drag along a floor line.".into();
        };
        let id = link.id.as_deref().unwrap_or("the link");
        let is_traced = link.seen.iter().any(|seen| search_line(session, link, seen).is_some());
        let at = |place: &'static str| if is_traced { place } else { "" };
        let text = match link.kind {
            LinkKind::Point => format!("{NEXT_CLICK}{}: {id}.", at(", on the yellow line")),
            LinkKind::Post => {
                format!("Now drag {id} from foot to head in another camera{}.", at(", at the yellow line"))
            }
            LinkKind::Line => {
                format!("Now drag along {id} in another camera{}.", at(", following the yellow line"))
            }
        };
        format!("{text}  Enter: next link")
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        match self.gesture {
            Gesture::Pressed { camera, end, .. } => Some((Pane::Image(camera), end.into())),
            Gesture::Idle => None,
        }
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        match self.gesture {
            Gesture::Pressed { camera, start, end } if pane == Pane::Image(camera) => {
                vec![vec![start.into(), end.into()]]
            }
            _ => Vec::new(),
        }
    }
}
