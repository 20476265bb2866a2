//! Mark tool. Virtual elements are created on the floor, dragged in any view, and pinned to pixels with Alt.

use calib_core::{ControlPoint, MarkKind, Pixel, Placement, WorldPoint};

use calib_site::{Mark, MarkObservation, Site};

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
    site.marks.push(Mark {
        id: Some(edit::free_id(site, 'M')),
        name: None,
        off: false,
        keep: false,
        kind,
        at_m: WorldPoint::new(at[0], at[1], 0.0),
        turn_deg: 0.0,
        size_m: default_size_m(kind),
        fixed: false,
        seen: Vec::new(),
        solution: None,
    });
    site.marks.len() - 1
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
            && !session.check_may_share(camera)
        {
            return None;
        }
        let drawn = session.site.marks.get(mark)?;
        let at = drawn.at_m;
        let started = Pixel::from(pointer.at);
        if let (Pane::Image(camera), true) = (pointer.pane, pointer.modifiers.alt) {
            if session.is_fixed_by_control_points(camera) {
                session.note = Some(
                    "Control points determine this camera's position. Switch them off to pin a mark.".into(),
                );
                return None;
            }
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
                "Drag it onto the same object in every view.  Alt: move the camera instead, Ctrl: height"
            }
            DragKind::Pin { .. } => "Release to pin the mark here; the camera moves to match.",
        }
    }
}

/// Tool that creates marks; the operator selects their kind in the panel.
#[derive(Debug, Default)]
pub(super) struct Marking {
    drag: Option<MarkDrag>,
}

impl Tool for Marking {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        match (&self.drag, pointer.phase) {
            (None, Phase::Press) => {
                if let Some((camera, _)) = pointer.pixel() {
                    session.select_camera(camera);
                }
                let Some(at) = pointer.floor(session, 0.0) else {
                    session.note =
                        Some("No floor there. Click below the horizon of a calibrated camera.".into());
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
        self.drag = None;
    }

    fn is_idle(&self) -> bool {
        self.drag.is_none()
    }

    fn hint(&self, _: &Session) -> String {
        match &self.drag {
            None => "Click the floor, in any view or on the plan, to set a mark.".into(),
            Some(_) => "Release to set the mark here.".into(),
        }
    }
}
