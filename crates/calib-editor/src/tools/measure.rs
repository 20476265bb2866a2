//! Tool that measures: a length on the floor, or a height above it, in the images. On the plan, the scale
//! follows from two clicks and their distance, which is entered in the panel.
//!
//! Also the tool that draws the region of a plane other than the floor, corner by corner.

use calib_core::{FloorPoint, Pixel};
use calib_site::{Measurement, MeasurementKind, MeasurementPoint};

use crate::planes::{add_plane, set_region};
use crate::session::Session;
use crate::tools::corners::Corners;
use crate::tools::{Pane, Phase, Pointer, Tool, plan_scale};

/// Tool that measures between two points of the images, or selects two points of the plan, whose distance the
/// operator enters.
#[derive(Debug, Default)]
pub(super) struct Measure {
    from: Option<[f64; 2]>,
    to: Option<[f64; 2]>,
    ruler: Option<RulerGesture>,
}

/// Measurement in progress in the images.
#[derive(Clone, Copy, Debug)]
struct RulerGesture {
    /// Camera and pixel of the first point.
    from: (usize, Pixel),
    /// Camera and pixel under the pointer.
    to: (usize, Pixel),
    /// Whether the first button press has ended without a drag, so that the next click sets the second point.
    is_clicked: bool,
}

impl Measure {
    /// Processes an event in an image. The two points may be in different images.
    fn measure(&mut self, session: &mut Session, (camera, at): (usize, Pixel), pointer: &Pointer) {
        /// Smallest distance of the two points in one image, in raw pixels.
        const MIN_DISTANCE_PX: f64 = 2.0;
        let Some(mut ruler) = self.ruler else {
            if pointer.phase == Phase::Press {
                (self.from, self.to) = (None, None);
                session.select_camera(camera);
                self.ruler = Some(RulerGesture { from: (camera, at), to: (camera, at), is_clicked: false });
            }
            return;
        };
        ruler.to = (camera, at);
        self.ruler = Some(ruler);
        if pointer.phase != Phase::Release {
            return;
        }
        if !ruler.is_clicked && !pointer.moved {
            self.ruler = Some(RulerGesture { is_clicked: true, ..ruler });
            return;
        }
        self.ruler = None;
        let (first, start) = ruler.from;
        if first == camera && start.distance(at) < MIN_DISTANCE_PX {
            return;
        }
        let is_height = pointer.modifiers.shift && first == camera;
        let kind = if is_height { MeasurementKind::Height } else { MeasurementKind::Length };
        let point = |(camera, px): (usize, Pixel)| {
            let entry = session.site.cameras.get(camera)?;
            let is_period = session.site.cameras.iter().filter(|other| other.id == entry.id).count() > 1;
            let at = entry.valid_from.clone().filter(|_| is_period);
            Some(MeasurementPoint { at, ..MeasurementPoint::new(entry.id.clone(), px) })
        };
        let (Some(a), Some(b)) = (point(ruler.from), point(ruler.to)) else { return };
        let points = vec![a, b];
        session.site.measurements.push(Measurement { id: None, name: None, kind, points });
        session.commit(format!("measure a {}", kind.name()));
        if pointer.modifiers.shift && !is_height {
            session.note = Some("A height needs both points in one image. A length was measured.".into());
        }
    }
}

impl Tool for Measure {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if let Some(pixel) = pointer.pixel() {
            self.measure(session, pixel, pointer);
            return;
        }
        match (self.from, pointer.phase) {
            (None, Phase::Press) => {
                self.ruler = None;
                (self.from, self.to) = (Some(pointer.at), Some(pointer.at));
            }
            (Some(from), Phase::Release) => {
                let far = (from[0] - pointer.at[0]).hypot(from[1] - pointer.at[1]);
                if far > pointer.radius {
                    let scale = plan_scale(&session.site);
                    session.tool.measured =
                        Some([from, pointer.at].map(|at| scale.plan_from_floor(at.into())));
                    session.note = Some("Enter the distance between the two points on the right.".into());
                    self.cancel();
                }
            }
            (Some(_), _) => self.to = Some(pointer.at),
            _ => {}
        }
    }

    fn cancel(&mut self) {
        *self = Self::default();
    }

    fn is_idle(&self) -> bool {
        self.from.is_none() && self.ruler.is_none()
    }

    fn hint(&self, session: &Session) -> String {
        match (self.from, session.tool.measured) {
            _ if self.ruler.is_some() => {
                "Click the other end, in this or another image.  Shift: height".into()
            }
            (Some(_), _) => "Click the other end of the known length.".into(),
            (None, Some(_)) => "Enter the length on the right, or measure again.".into(),
            (None, None) => {
                "Click two floor points in the images to measure, or two points of the plan whose \
                             distance you know."
                    .into()
            }
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        let in_image = self.ruler.map(|ruler| (Pane::Image(ruler.to.0), ruler.to.1.into()));
        in_image.or_else(|| self.to.map(|to| (Pane::Plan, to)))
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        match (pane, self.from, self.to, self.ruler) {
            (Pane::Plan, Some(from), Some(to), _) => vec![vec![from, to]],
            (Pane::Image(camera), _, _, Some(RulerGesture { from, to, .. }))
                if from.0 == camera && to.0 == camera =>
            {
                vec![vec![from.1.into(), to.1.into()]]
            }
            _ => Vec::new(),
        }
    }
}

/// Tool that draws the region of the selected plane, or of a new one.
#[derive(Debug, Default)]
pub(super) struct Region {
    corners: Corners,
    is_done: bool,
}

impl Region {
    /// Writes the unfinished region into the site, and returns the index of its plane. `None` with fewer than
    /// three corners.
    fn show(session: &mut Session, corners: &[FloorPoint]) -> Option<usize> {
        session.revert();
        if corners.len() < 3 {
            return None;
        }
        let chosen = session.tool.plane.filter(|&plane| plane < session.site.planes.len());
        let index = chosen.unwrap_or_else(|| add_plane(&mut session.site));
        set_region(&mut session.site.planes[index], corners.to_vec());
        Some(index)
    }

    /// Finishes the region without the corner that follows the pointer. Fewer than three corners are
    /// discarded.
    fn finish(&mut self, session: &mut Session) {
        let corners = self.corners.take();
        let Some(index) = Self::show(session, &corners) else {
            session.note = Some("Click at least three corners.".into());
            return;
        };
        let name = format!("draw the region of {}", session.site.planes[index].id);
        session.tool.plane = Some(index);
        session.commit(name);
        self.is_done = true;
    }
}

impl Tool for Region {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if pointer.pane != Pane::Plan {
            return;
        }
        if self.corners.follow(pointer.at.into(), pointer, 3).is_some() {
            self.finish(session);
        } else if !self.corners.is_empty() {
            Self::show(session, self.corners.all());
        }
    }

    fn accept(&mut self, session: &mut Session) {
        if !self.corners.is_empty() {
            self.finish(session);
        }
    }

    fn step_back(&mut self, session: &mut Session) -> bool {
        let has_gesture = self.corners.step_back();
        if has_gesture {
            Self::show(session, self.corners.all());
        }
        has_gesture
    }

    fn cancel(&mut self) {
        self.corners.clear();
    }

    fn is_idle(&self) -> bool {
        self.corners.is_empty()
    }

    fn is_done(&self) -> bool {
        self.is_done
    }

    fn hint(&self, session: &Session) -> String {
        let plane = session.tool.plane.and_then(|plane| session.site.planes.get(plane));
        let of = plane.map_or("a new plane", |plane| plane.id.as_str());
        match 3_usize.saturating_sub(self.corners.set()) {
            _ if self.corners.is_empty() => format!("Click the corners of {of} on the plan."),
            0 => "Click the next corner, or the first one to close.  Enter: close".into(),
            left => format!("Click the next corner; {left} more needed."),
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        self.corners.dragged_point()
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        self.corners.preview_lines(pane)
    }
}
