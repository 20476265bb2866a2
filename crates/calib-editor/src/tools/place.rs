//! Stage 2 by hand: the operator moves, rotates and scales a camera's polygon on the floor by its handles.

use calib_core::{FloorPoint, Pixel, Placement, WorldPoint};

use calib_core::floor::STAGE_1_HEIGHT;

use crate::session::{Session, corners_of};
use crate::tools::Pointer;

/// Handle of a placed camera on the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PlanHandle {
    /// Foot of the camera: moves the camera.
    Foot,
    /// Ring on the axis of the camera: rotates the camera about its foot.
    Rotate,
    /// Square on the axis of the camera: scales the polygon about the foot, which sets the height of the
    /// camera.
    Scale,
    /// Corner of the polygon, by its index: rotates and scales the polygon about its centre, or about the
    /// pinned pivot.
    Corner(usize),
    /// Inside of the polygon: moves the camera.
    Body,
}

impl PlanHandle {
    /// Returns the verb for the effect of the handle, for the name of the undo step.
    #[must_use]
    pub const fn verb(self) -> &'static str {
        match self {
            Self::Foot | Self::Body => "move",
            Self::Rotate => "rotate",
            Self::Scale => "scale",
            Self::Corner(_) => "rotate and scale",
        }
    }
}

/// Distance of the handle for scaling from the foot, divided by the distance of the farthest corner from the
/// foot.
const SCALE_HANDLE_AT: f64 = 0.55;
/// Distance of the handle for rotation from the foot, divided by the distance of the farthest corner from the
/// foot.
const ROTATE_HANDLE_AT: f64 = 1.12;
/// Grid spacing for the snapping of positions and heights, in metres.
pub(super) const SNAP_M: f64 = 0.1;
/// Step for the snapping of rotations, in radians.
const SNAP_ROTATION_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// Returns the nearest multiple of a step.
pub(super) fn round(value: f64, step: f64) -> f64 {
    (value / step).round() * step
}

/// Ratio of the movement of a handle to the movement of the pointer while Shift is pressed.
const FINE_DRAG: f64 = 0.1;

/// Returns the handles of a camera with their positions in floor metres; empty if the camera has no pose.
#[must_use]
pub fn plan_handles(session: &Session, camera: usize) -> Vec<(PlanHandle, [f64; 2])> {
    let (Some(entry), Some(pose)) = (session.site.cameras.get(camera), session.solved.pose(camera)) else {
        return Vec::new();
    };
    let foot = pose.position.on_floor();
    let plane = session.solved.efov_plane(&session.site, entry);
    let shown = corners_of(entry).into_iter().filter_map(|pixel| pose.pixel_to_plane(pixel, &plane));
    let corners: Vec<FloorPoint> = shown.map(WorldPoint::on_floor).collect();
    let far = corners.iter().map(|corner| corner.distance(foot)).fold(pose.position.z, f64::max);
    let reach = far.min(30.0 * pose.position.z.abs().max(0.1));
    let ahead = [-pose.yaw.sin(), pose.yaw.cos()];
    let along = |share: f64| [foot.x + share * reach * ahead[0], foot.y + share * reach * ahead[1]];
    let mut handles = vec![
        (PlanHandle::Foot, foot.into()),
        (PlanHandle::Rotate, along(ROTATE_HANDLE_AT)),
        (PlanHandle::Scale, along(SCALE_HANDLE_AT)),
    ];
    handles.extend(corners.iter().enumerate().map(|(i, &corner)| (PlanHandle::Corner(i), corner.into())));
    handles
}

/// Whether the plan has no mark, no camera handle and no field of view at a position, so that a press with the
/// selection tool starts no drag. The position and the radius are in floor metres.
#[must_use]
pub fn is_plan_empty_at(session: &Session, at: [f64; 2], radius: f64) -> bool {
    let is_near = |mark: &calib_site::Mark| (mark.at_m.x - at[0]).hypot(mark.at_m.y - at[1]) <= radius;
    let has_mark = session.site.marks.iter().any(|mark| !mark.off && is_near(mark));
    !has_mark && PlaceDrag::handle_under(session, at, radius).is_none()
}

/// Drag of a camera's polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlaceDrag {
    camera: usize,
    handle: PlanHandle,
    /// Position of the pointer at the start of the drag, in floor metres.
    from: [f64; 2],
    /// Placement of the camera at the start of the drag.
    own: Placement,
    /// Centre of rotation and scaling for the drag of a corner, in floor metres.
    pivot: [f64; 2],
}

impl PlaceDrag {
    /// Starts a drag of the handle under the pointer. A double click sets or resets the pivot instead. `None` also if
    /// control points determine the position of the camera.
    pub(super) fn start(session: &mut Session, pointer: &Pointer) -> Option<Self> {
        let (camera, handle) = Self::handle_under(session, pointer.at, pointer.radius)?;
        session.select_camera(camera);
        if pointer.double {
            let is_pinned = session.tool.pivot.take().is_some();
            session.tool.pivot = (!is_pinned).then_some(pointer.at);
            let note = if is_pinned {
                "Pivot reset to the centre."
            } else {
                "Dragging a corner now rotates and scales about this pivot."
            };
            session.note = Some(note.into());
            return None;
        }
        if !session.check_may_move(camera, "move the camera by hand") {
            return None;
        }
        let own = session.placement(camera)?;
        let corners: Vec<[f64; 2]> = plan_handles(session, camera)
            .into_iter()
            .filter_map(|(handle, at)| matches!(handle, PlanHandle::Corner(_)).then_some(at))
            .collect();
        let count = corners.len().max(1) as f64;
        let mean = |axis: usize| corners.iter().map(|corner| corner[axis]).sum::<f64>() / count;
        let pivot = session.tool.pivot.unwrap_or([mean(0), mean(1)]);
        Some(Self { camera, handle, from: pointer.at, own, pivot })
    }

    /// Returns the camera and the handle within a radius of a position, in floor metres. The order of priority is:
    /// handles of the selected camera, feet of other cameras, fields of view.
    fn handle_under(session: &Session, pointer: [f64; 2], radius: f64) -> Option<(usize, PlanHandle)> {
        let near = |camera: usize| {
            let far = |at: &[f64; 2]| (at[0] - pointer[0]).hypot(at[1] - pointer[1]);
            plan_handles(session, camera)
                .into_iter()
                .map(|(handle, at)| (handle, far(&at)))
                .filter(|(_, far)| *far <= radius)
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .map(|(handle, _)| (camera, handle))
        };
        let count = session.site.cameras.len();
        let feet = |camera: &usize| near(*camera).filter(|(_, handle)| *handle == PlanHandle::Foot);
        let inside = |camera: &usize| {
            session.solved.solution(*camera).is_some_and(|solution| is_inside(&solution.efov_m, pointer))
        };
        let body = |camera| (camera, PlanHandle::Body);
        near(session.camera)
            .or_else(|| (0..count).find_map(|camera| feet(&camera)))
            .or_else(|| Some(session.camera).filter(inside).map(body))
            .or_else(|| (0..count).find(inside).map(body))
    }

    pub(super) fn drag(self, session: &mut Session, pointer: &Pointer) -> Self {
        if pointer.moved {
            let share = if pointer.modifiers.shift { FINE_DRAG } else { 1.0 };
            let at =
                std::array::from_fn(|axis| self.from[axis] + share * (pointer.at[axis] - self.from[axis]));
            session.revert();
            let placed = self.moved_placement(at);
            session
                .place(self.camera, if session.tool.snap { self.snapped_placement(placed) } else { placed });
        }
        self
    }

    /// Returns the placement that moves the dragged handle from its start to `at`.
    fn moved_placement(&self, at: [f64; 2]) -> Placement {
        let foot = [self.own.by.x, self.own.by.y];
        match self.handle {
            PlanHandle::Foot | PlanHandle::Body => Placement {
                by: FloorPoint::new(foot[0] + at[0] - self.from[0], foot[1] + at[1] - self.from[1]),
                ..self.own
            },
            PlanHandle::Rotate => rotate_scale_about(self.own, foot, self.from, at, [true, false]),
            PlanHandle::Scale => rotate_scale_about(self.own, foot, self.from, at, [false, true]),
            PlanHandle::Corner(_) => rotate_scale_about(self.own, self.pivot, self.from, at, [true, true]),
        }
    }

    /// Returns a placement with the values that the handle changes rounded to the grid.
    fn snapped_placement(&self, placed: Placement) -> Placement {
        let height = STAGE_1_HEIGHT * placed.scale;
        match self.handle {
            PlanHandle::Foot | PlanHandle::Body => {
                let by = FloorPoint::new(round(placed.by.x, SNAP_M), round(placed.by.y, SNAP_M));
                Placement { by, ..placed }
            }
            PlanHandle::Rotate => Placement { turn: round(placed.turn, SNAP_ROTATION_RAD), ..placed },
            PlanHandle::Scale => {
                Placement { scale: round(height, SNAP_M).max(SNAP_M) / STAGE_1_HEIGHT, ..placed }
            }
            // The pivot is not the foot, so that no value of the placement can be round.
            PlanHandle::Corner(_) => placed,
        }
    }

    pub(super) fn finish(self, session: &mut Session) {
        let name = session.site.cameras.get(self.camera).map_or_else(String::new, |c| c.id.clone());
        session.commit(format!("{} {name}", self.handle.verb()));
    }

    pub(super) fn hint(&self, session: &Session) -> String {
        let name = session.site.cameras.get(self.camera).map_or("", |c| c.id.as_str());
        let now = session.placement(self.camera).unwrap_or(self.own);
        let what = match self.handle {
            PlanHandle::Rotate => format!("rotation {:.1}\u{b0}", now.turn.to_degrees()),
            PlanHandle::Scale => {
                let height = session.site.units.length(STAGE_1_HEIGHT * now.scale, 2);
                format!("scale {:.3}, height {height}", now.scale)
            }
            _ => format!("at {}", session.site.units.point(now.by.into(), 2)),
        };
        format!("{name}: {what}. Release to finish.  Shift: fine, Esc: cancel")
    }
}

/// Rotates and scales a placement about a pivot by the similarity that maps `from` to `to`. All points are
/// floor metres. The flags enable rotation and scaling.
pub(crate) fn rotate_scale_about(
    own: Placement,
    pivot: [f64; 2],
    from: [f64; 2],
    to: [f64; 2],
    [turns, scales]: [bool; 2],
) -> Placement {
    let arm = |point: [f64; 2]| [point[0] - pivot[0], point[1] - pivot[1]];
    let (a, b) = (arm(from), arm(to));
    let (la, lb) = (a[0].hypot(a[1]), b[0].hypot(b[1]));
    // If a point is at the pivot, rotation and scale are undefined.
    if la < 1e-9 || lb < 1e-9 {
        return own;
    }
    let turn = if turns { b[1].atan2(b[0]) - a[1].atan2(a[0]) } else { 0.0 };
    let scale = if scales { lb / la } else { 1.0 };
    let (sin, cos) = turn.sin_cos();
    let foot = arm(own.by.into());
    let by = FloorPoint::new(
        pivot[0] + scale * (cos * foot[0] - sin * foot[1]),
        pivot[1] + scale * (sin * foot[0] + cos * foot[1]),
    );
    let half = std::f64::consts::PI;
    let turned = (own.turn + turn + half).rem_euclid(2.0 * half) - half;
    Placement { by, turn: turned, scale: own.scale * scale }
}

/// Whether a floor polygon contains a point (even-odd rule).
#[must_use]
pub fn is_inside(polygon: &[FloorPoint], [x, y]: [f64; 2]) -> bool {
    let edges = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let crossed =
        edges.filter(|(a, b)| (a.y > y) != (b.y > y) && x < a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
    crossed.count() % 2 == 1
}

/// Returns the placement in which the camera shows the pins nearest to their pixels, starting from `own`. With one
/// pin, only the position changes; with more pins, rotation and scale change too.
pub(super) fn fit_pins(
    session: &Session,
    camera: usize,
    pins: &[calib_core::ControlPoint],
    own: Placement,
) -> Option<Placement> {
    let pose = own.apply(session.solved.pose(camera)?);
    match pins {
        [] => None,
        [pin] => {
            let shown: Pixel = pin.pixel;
            let seen = pose.pixel_to_floor(shown, pin.world.z)?;
            let by = FloorPoint::new(own.by.x + pin.world.x - seen.x, own.by.y + pin.world.y - seen.y);
            Some(Placement { by, ..own })
        }
        _ => calib_core::from_control_points(&pose, pins, None).map(|placed| Placement::from_camera(&placed)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygon_rotated_and_scaled_about_a_pivot_keeps_the_pivot() {
        let own = Placement { by: FloorPoint::new(2.0, 1.0), turn: 0.3, scale: 1.2 };
        let on_floor = FloorPoint::new(0.7, 4.0);
        let pivot = own.map_point(on_floor);
        let new = rotate_scale_about(own, pivot.into(), [5.0, 5.0], [3.0, 9.0], [true, true]);
        assert!(new.map_point(on_floor).distance(pivot) < 1e-12);
        let corner = own.map_point(FloorPoint::new(-1.0, 2.0));
        let moved = rotate_scale_about(own, pivot.into(), corner.into(), [0.0, 0.0], [true, true]);
        assert!(moved.map_point(FloorPoint::new(-1.0, 2.0)).distance(FloorPoint::new(0.0, 0.0)) < 1e-9);
    }
}
