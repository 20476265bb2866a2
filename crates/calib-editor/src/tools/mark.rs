//! Mark tool. Virtual elements are created on the floor, dragged in any view, and pinned to pixels with Alt. A
//! rectangle is created from its four corners in the image of a camera without a pose.

use calib_core::{ControlPoint, FloorPoint, MarkKind, Pixel, Placement, WorldPoint};

use calib_site::{Mark, MarkObservation, Site, Stage};

use crate::edit;
use crate::hit::Part;
use crate::session::Session;
use crate::tools::place::{SNAP_M, fit_pins, round};
use crate::tools::{Pane, Phase, Pointer, Tool};

/// Returns the dimensions of a new mark of this kind, in metres.
#[must_use]
fn default_size_m(kind: MarkKind) -> Vec<f64> {
    match kind {
        MarkKind::Cross => vec![0.5],
        MarkKind::Post => vec![0.1, 0.1, 2.0],
        MarkKind::Box => vec![1.0, 1.0, 1.0],
        MarkKind::Cylinder => vec![0.3, 1.0],
        MarkKind::Circle => vec![1.0],
        MarkKind::Person => vec![1.75],
        MarkKind::Grid => vec![1.0, 4.0, 4.0],
        MarkKind::Rectangle => vec![2.5, 5.0],
    }
}

/// Adds a mark of this kind at a floor point in metres, and returns its index.
fn add_mark(site: &mut Site, kind: MarkKind, at: [f64; 2]) -> usize {
    let id = Some(edit::free_id(site, 'M'));
    site.marks.push(Mark { id, ..Mark::new(kind, WorldPoint::new(at[0], at[1], 0.0), default_size_m(kind)) });
    site.marks.len() - 1
}

/// Returns the corner names of a rectangle for four pixels in order around it, in either direction. The side between
/// the first two pixels is the width. Returns `None` if the sides cross or a corner points inwards.
fn corner_names(corners: &[Pixel; 4]) -> Option<[&'static str; 4]> {
    let turn = |i: usize| {
        let [a, b, c] = [0, 1, 2].map(|k| corners[(i + k) % 4]);
        (b.u - a.u) * (c.v - b.v) - (b.v - a.v) * (c.u - b.u)
    };
    let turns: [f64; 4] = std::array::from_fn(turn);
    // The names are counter-clockwise seen from above, and the v axis of an image points down.
    if turns.iter().all(|&turn| turn < 0.0) {
        Some(["c0", "c1", "c2", "c3"])
    } else if turns.iter().all(|&turn| turn > 0.0) {
        Some(["c1", "c0", "c3", "c2"])
    } else {
        None
    }
}

/// Returns the floor position (metres) and rotation (degrees) at which a mark fits its pins in the image of an
/// unplaced camera. The origin is below this camera. `None` if the mark is fixed, if a placed camera shows it, or if
/// the pins do not determine the position.
fn pinned_position(session: &Session, index: usize) -> Option<([f64; 2], f64)> {
    let mark = session.site.marks.get(index).filter(|mark| !mark.fixed)?;
    let local = mark.shape_at(WorldPoint { z: mark.at_m.z, ..WorldPoint::default() }, 0.0);
    let pairs = |camera: usize| {
        let own = mark.seen.iter().filter(|seen| seen.camera == session.site.cameras[camera].id);
        let pair = |seen: &MarkObservation| {
            let shown = session.solved.pose(camera)?.pixel_to_floor(seen.px, mark.at_m.z)?;
            let WorldPoint { x, y, .. } = local.point(&seen.point)?;
            Some((FloorPoint::new(x, y), shown))
        };
        own.filter_map(pair).collect::<Vec<(FloorPoint, FloorPoint)>>()
    };
    let is_placed = |&camera: &usize| {
        session.solved.solution(camera).is_some_and(|solution| solution.stage != Stage::Partial)
    };
    let shows = |&camera: &usize| {
        let id = &session.site.cameras[camera].id;
        mark.seen.iter().any(|seen| seen.camera == *id)
    };
    let cameras: Vec<usize> = (0..session.site.cameras.len()).filter(shows).collect();
    if cameras.iter().any(is_placed) {
        return None;
    }
    let pairs = cameras.into_iter().map(pairs).max_by_key(Vec::len)?;
    let placement = Placement::fit(&pairs)?;
    let rounded = |value: f64| (1000.0 * value).round() / 1000.0;
    Some(([placement.by.x, placement.by.y].map(rounded), rounded(placement.turn.to_degrees())))
}

/// Whether a mark is at the position that its pins determine. Also true if the pins determine no position.
pub(crate) fn is_on_pins(session: &Session, index: usize) -> bool {
    /// Largest distance from the pins, in metres: positions are rounded to millimetres.
    const MAX_DISTANCE_M: f64 = 0.005;
    let Some(mark) = session.site.marks.get(index) else { return false };
    pinned_position(session, index)
        .is_none_or(|([x, y], _)| (mark.at_m.x - x).hypot(mark.at_m.y - y) < MAX_DISTANCE_M)
}

/// Moves a mark onto its pins, in the frame of an unplaced camera.
pub(crate) fn move_to_pins(session: &mut Session, index: usize) {
    let Some((at, turn_deg)) = pinned_position(session, index) else { return };
    if let Some(mark) = session.site.marks.get_mut(index).filter(|mark| !mark.has_map_coordinates()) {
        ([mark.at_m.x, mark.at_m.y], mark.turn_deg) = (at, turn_deg);
    }
}

#[derive(Clone, Debug, PartialEq)]
enum DragKind {
    /// The mark follows the pointer on the floor. `offset` is the mark minus the pointer at the start, in
    /// metres.
    Slide { offset: [f64; 2] },
    /// A point of the mark is pinned to a pixel, and the camera moves accordingly. `own` is its placement at
    /// the start.
    Pin { camera: usize, point: String, own: Placement },
}

/// Drag of a mark.
#[derive(Clone, Debug)]
pub(super) struct MarkDrag {
    mark: usize,
    height: f64,
    kind: DragKind,
    started: Pixel,
}

impl MarkDrag {
    /// Returns the index of the mark whose foot is at the pointer on the plan.
    pub(super) fn under(session: &Session, pointer: &Pointer) -> Option<usize> {
        session.site.marks.iter().position(|mark| {
            !mark.off && (mark.at_m.x - pointer.at[0]).hypot(mark.at_m.y - pointer.at[1]) <= pointer.radius
        })
    }

    pub(super) fn start(session: &mut Session, mark: usize, pointer: &Pointer) -> Option<Self> {
        if let (Pane::Image(camera), true) = (pointer.pane, pointer.modifiers.alt)
            && !(session.check_may_share(camera) && session.check_may_move(camera, "pin a mark"))
        {
            return None;
        }
        let drawn = session.site.marks.get(mark)?;
        let at = drawn.at_m;
        let started = Pixel::from(pointer.at);
        if let (Pane::Image(camera), true) = (pointer.pane, pointer.modifiers.alt) {
            let pose = session.solved.pose(camera)?;
            let shape = drawn.shape();
            let shown = |name: &str| Some(pose.world_to_pixel(shape.point(name)?)?.distance(started));
            let names = shape.point_names().filter_map(|name| Some((shown(&name)?, name)));
            let (_, point) = names.min_by(|a, b| a.0.total_cmp(&b.0))?;
            let (point, own) = (point.into_owned(), session.placement(camera)?);
            return Some(Self { mark, height: at.z, kind: DragKind::Pin { camera, point, own }, started });
        }
        let under = pointer.floor(session, at.z)?;
        let offset = [at.x - under.x, at.y - under.y];
        Some(Self { mark, height: at.z, kind: DragKind::Slide { offset }, started })
    }

    pub(super) fn drag(self, session: &mut Session, pointer: &Pointer) -> Self {
        if !pointer.moved {
            return self;
        }
        session.revert();
        match &self.kind {
            DragKind::Slide { offset } => self.move_on_floor(session, pointer, *offset),
            DragKind::Pin { camera, point, own } if pointer.pane == Pane::Image(*camera) => {
                self.pin_to_pixel(session, *camera, point, *own, pointer.at.into());
            }
            DragKind::Pin { .. } => {}
        }
        self
    }

    /// Moves the mark to the pointer on the floor; while Ctrl is pressed, changes its height.
    fn move_on_floor(&self, session: &mut Session, pointer: &Pointer, offset: [f64; 2]) {
        let raised = pointer.modifiers.ctrl.then(|| self.dragged_height(session, pointer)).flatten();
        let under = pointer.floor(session, self.height);
        let snaps = session.tool.snap && pointer.pane == Pane::Plan;
        let Some(mark) = session.site.marks.get_mut(self.mark) else { return };
        mark.remove_map_coordinates();
        if let Some(z) = raised {
            mark.at_m.z = z;
        } else if let Some(under) = under {
            (mark.at_m.x, mark.at_m.y) = (under.x + offset[0], under.y + offset[1]);
            if snaps {
                (mark.at_m.x, mark.at_m.y) = (round(mark.at_m.x, SNAP_M), round(mark.at_m.y, SNAP_M));
            }
        }
    }

    /// Returns the height of the mark's foot above the floor for which it appears in the pixel row of the
    /// pointer, in metres.
    fn dragged_height(&self, session: &Session, pointer: &Pointer) -> Option<f64> {
        let (camera, at) = pointer.pixel()?;
        let pose = session.solved.pose(camera)?;
        let foot = session.site.marks.get(self.mark)?.at_m;
        let (low, high) =
            (pose.world_to_pixel(foot)?, pose.world_to_pixel(WorldPoint { z: foot.z + 1.0, ..foot })?);
        let rise = (low.v - high.v).abs().max(1e-6);
        Some(self.height + (self.started.v - at.v) / rise)
    }

    /// Pins a point of the mark to a pixel of a camera, and moves the camera so that it shows all pins at
    /// their pixels.
    fn pin_to_pixel(&self, session: &mut Session, camera: usize, point: &str, own: Placement, px: Pixel) {
        let Some(id) = session.site.cameras.get(camera).map(|c| c.id.clone()) else { return };
        let Some(mark) = session.site.marks.get_mut(self.mark) else { return };
        match mark.seen.iter_mut().find(|seen| seen.camera == id && seen.point == point) {
            Some(seen) => seen.px = px,
            None => mark.seen.push(MarkObservation { camera: id.clone(), point: point.into(), px }),
        }
        let pins: Vec<ControlPoint> = session
            .site
            .marks
            .iter()
            .filter(|mark| !mark.off)
            .flat_map(|mark| mark.seen.iter().map(move |seen| (mark, seen)))
            .filter(|(_, seen)| seen.camera == id)
            .filter_map(|(mark, seen)| {
                Some(ControlPoint { pixel: seen.px, world: mark.shape().point(&seen.point)? })
            })
            .collect();
        if let Some(placement) = fit_pins(session, camera, &pins, own) {
            session.place(camera, placement);
        }
    }

    pub(super) fn finish(self, session: &mut Session) {
        if let DragKind::Pin { camera, point, own } = &self.kind
            && session.history.is_unchanged(&session.site)
        {
            // A click with Alt, without a drag, pins the point at the clicked pixel.
            self.pin_to_pixel(session, *camera, point, *own, self.started);
        }
        let name = session.part_name(Part::Mark(self.mark));
        match self.kind {
            DragKind::Slide { .. } => session.commit(format!("move {name}")),
            DragKind::Pin { camera, .. } => {
                let id = session.site.cameras.get(camera).map_or_else(String::new, |c| c.id.clone());
                session.commit(format!("pin {name} in {id}"));
            }
        }
    }

    pub(super) const fn hint(&self) -> &'static str {
        match self.kind {
            DragKind::Slide { .. } => {
                "Drag the mark onto the same object in every view.  Alt: move the camera instead, \
                 Ctrl: height"
            }
            DragKind::Pin { .. } => "Release to pin the mark here; the camera moves to match.",
        }
    }
}

/// Corners of a rectangle that are clicked one after the other in the image of a camera without a pose.
#[derive(Clone, Debug)]
struct Corners {
    camera: usize,
    set: Vec<Pixel>,
    /// Position of the pointer.
    end: Pixel,
}

impl Corners {
    /// Whether a click in the image of this camera sets the first corner of a new rectangle. The mark tool must
    /// create rectangles, and the camera must have no pose.
    fn start_at(session: &Session, camera: usize) -> bool {
        session.tool.mark_kind == MarkKind::Rectangle && session.solved.pose(camera).is_none()
    }

    /// Creates the rectangle, and solves its camera.
    fn finish(&self, session: &mut Session, corners: &[Pixel; 4]) {
        let Some(names) = corner_names(corners) else {
            session.note =
                Some("The sides cross, or a corner points inwards. Click the four corners in order.".into());
            return;
        };
        let Some(id) = session.site.cameras.get(self.camera).map(|entry| entry.id.clone()) else { return };
        let mark = add_mark(&mut session.site, MarkKind::Rectangle, [0.0, 0.0]);
        let pins = names.iter().zip(corners);
        session.site.marks[mark].seen =
            pins.map(|(&name, &px)| MarkObservation { camera: id.clone(), point: name.into(), px }).collect();
        session.selection = [Part::Mark(mark)].into();
        session.solve();
        move_to_pins(session, mark);
        let name = session.part_name(Part::Mark(mark));
        session.commit(format!("add {name}"));
        if session.note.is_none() {
            let solved = if session.solved.pose(self.camera).is_some() {
                String::new()
            } else {
                format!("{id} cannot be solved with this size. ")
            };
            let note = format!("{solved}Choose a court, or enter the width and depth, in the Marks panel.");
            session.note = Some(note);
        }
    }

    fn hint(&self) -> &'static str {
        match self.set.len() {
            0 => "Release to set corner 1 of 4.",
            1 => "Click corner 2 of 4, at the other end of the width.",
            2 => "Click corner 3 of 4, the next one around the rectangle.",
            _ => "Click corner 4 of 4.",
        }
    }
}

/// Tool that creates marks; the operator selects their kind in the panel.
#[derive(Debug, Default)]
pub(super) struct Marking {
    drag: Option<MarkDrag>,
    corners: Option<Corners>,
}

impl Marking {
    /// Processes a pointer event of a rectangle that is created from its corners. Returns whether the event was
    /// used.
    fn set_corners(&mut self, session: &mut Session, pointer: &Pointer) -> bool {
        let Some((camera, at)) = pointer.pixel() else { return self.corners.is_some() };
        let is_click = pointer.phase == Phase::Release;
        match &mut self.corners {
            None if pointer.phase == Phase::Press && Corners::start_at(session, camera) => {
                session.select_camera(camera);
                if !session.check_may_share(camera) {
                    return true;
                }
                self.corners = Some(Corners { camera, set: Vec::new(), end: at });
            }
            None => return false,
            Some(corners) if corners.camera == camera => {
                corners.end = at;
                let is_new = corners.set.last().is_none_or(|last| last.distance(at) > 0.5 * pointer.radius);
                if is_click && is_new {
                    corners.set.push(at);
                }
            }
            Some(_) => {}
        }
        if let Some(corners) = self.corners.take_if(|corners| corners.set.len() == 4)
            && let Ok(all) = <[Pixel; 4]>::try_from(&corners.set[..])
        {
            corners.finish(session, &all);
        }
        true
    }
}

impl Tool for Marking {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if self.drag.is_none() && self.set_corners(session, pointer) {
            return;
        }
        match (&self.drag, pointer.phase) {
            (None, Phase::Press) => {
                if let Some((camera, _)) = pointer.pixel() {
                    session.select_camera(camera);
                }
                let Some(at) = pointer.floor(session, 0.0) else {
                    let camera = pointer.pixel().map(|(camera, _)| camera);
                    let unsolved = camera.filter(|&camera| session.solved.pose(camera).is_none());
                    let note = match unsolved.and_then(|camera| session.site.cameras.get(camera)) {
                        None => "This point is not on the floor. Click below the horizon.".into(),
                        Some(entry) => format!(
                            "{} is not calibrated. Draw lines in its image, or choose the rectangle in the \
                             Marks panel and click the four corners.",
                            entry.id
                        ),
                    };
                    session.note = Some(note);
                    return;
                };
                let kind = session.tool.mark_kind;
                let mark = add_mark(&mut session.site, kind, at.into());
                let what = DragKind::Slide { offset: [0.0, 0.0] };
                session.selection = [Part::Mark(mark)].into();
                self.drag = Some(MarkDrag { mark, height: 0.0, kind: what, started: pointer.at.into() });
            }
            (Some(drag), Phase::Release) => {
                let name = session.part_name(Part::Mark(drag.mark));
                self.drag = None;
                session.commit(format!("add {name}"));
            }
            (Some(drag), _) if pointer.moved => {
                // The new mark is moved without reverting the site, because the last finished state does not
                // contain the mark.
                drag.move_on_floor(session, pointer, [0.0, 0.0]);
            }
            _ => {}
        }
    }

    fn cancel(&mut self) {
        (self.drag, self.corners) = (None, None);
    }

    fn step_back(&mut self, _: &mut Session) -> bool {
        let Some(corners) = &mut self.corners else { return false };
        corners.set.pop();
        self.corners.take_if(|corners| corners.set.is_empty());
        true
    }

    fn is_idle(&self) -> bool {
        self.drag.is_none() && self.corners.is_none()
    }

    fn hint(&self, session: &Session) -> String {
        match (&self.drag, &self.corners) {
            (Some(_), _) => "Release to set the mark here.".into(),
            (None, Some(corners)) => corners.hint().into(),
            (None, None) if Corners::start_at(session, session.camera) => {
                "Click the corners of a court or other rectangle. Start with the two ends of its width."
                    .into()
            }
            (None, None) => "Click the floor, in any view or on the plan, to set a mark.".into(),
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        let corners = self.corners.as_ref()?;
        Some((Pane::Image(corners.camera), corners.end.into()))
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        let corners = self.corners.iter().filter(|corners| pane == Pane::Image(corners.camera));
        let line = |Corners { set, end, .. }: &Corners| {
            let first = set.first().filter(|_| set.len() > 1);
            set.iter().chain([end]).chain(first).map(|&pixel| pixel.into()).collect()
        };
        corners.map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_named_counter_clockwise_seen_from_above() {
        let square = [[0.0, 9.0], [9.0, 9.0], [9.0, 0.0], [0.0, 0.0]].map(Pixel::from);
        assert_eq!(corner_names(&square), Some(["c0", "c1", "c2", "c3"]));
        let [a, b, c, d] = square;
        // The first side stays the width in the other order.
        assert_eq!(corner_names(&[b, a, d, c]), Some(["c1", "c0", "c3", "c2"]));
        assert_eq!(corner_names(&[a, c, b, d]), None, "crossing sides");
        assert_eq!(corner_names(&[a, b, c, Pixel::new(8.0, 8.0)]), None, "a corner inwards");
        assert_eq!(corner_names(&[a, a, c, d]), None, "a double corner");
    }
}
