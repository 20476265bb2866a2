//! Control point tool: a click on an image, then a click on the corresponding position on the plan.

use calib_core::{FloorPoint, Pixel};
use calib_site::{ControlPointEntry, GroundPoint};

use crate::hit::Part;
use crate::session::Session;
use crate::tools::{MAX_CLICK_SIGMA_PX, Pane, Phase, Pointer, Tool, imprecise_note, plan_scale};

/// Tool that adds control points.
#[derive(Debug, Default)]
pub(super) struct Control {
    /// Clicked pixel that has no plan position yet: index of the camera, raw pixel, and standard deviation in
    /// pixels.
    pending: Option<(usize, Pixel, Option<f64>)>,
    /// Floor position of the pointer in metres, for the preview.
    pointer_m: Option<[f64; 2]>,
}

impl Control {
    fn finish(&mut self, session: &mut Session, at: FloorPoint) {
        let Some((camera, px, sigma_px)) = self.pending.take() else { return };
        let plan_px = session.site.plan.as_ref().map(|_| plan_scale(&session.site).plan_from_floor(at));
        let world_m = plan_px.is_none().then(|| at.at_height(0.0));
        let Some(entry) = session.site.cameras.get_mut(camera) else { return };
        let surveyed: Vec<&String> = session.site.ground_points.iter().map(|point| &point.id).collect();
        let is_used = |id: &String| {
            surveyed.contains(&id) || entry.control_points.iter().any(|point| point.id.as_ref() == Some(id))
        };
        let id = (1..).map(|number| format!("C{number}")).find(|id| !is_used(id));
        let name = id.clone().unwrap_or_default();
        entry.control_points.push(ControlPointEntry {
            id,
            world_m,
            plan_px,
            sigma_px,
            ..ControlPointEntry::new(px)
        });
        let part = Part::Control(entry.control_points.len() - 1);
        session.select_only(camera, part);
        session.commit(format!("add {name}"));
        if let (Some(sigma), None) = (sigma_px.filter(|sigma| *sigma > MAX_CLICK_SIGMA_PX), &session.note) {
            session.note = Some(imprecise_note(&name, sigma));
        }
        self.pointer_m = None;
    }
}

/// Returns the ground point that the next click marks.
fn chosen_ground_point(session: &Session) -> Option<&GroundPoint> {
    let id = session.tool.ground_point.as_ref()?;
    session.site.ground_points.iter().find(|point| point.id == *id)
}

/// Adds the click on a ground point to a camera, or moves the earlier click on this point.
fn add_ground_point(session: &mut Session, camera: usize, clicked: ControlPointEntry) {
    let name = clicked.id.clone().unwrap_or_default();
    let Some(entry) = session.site.cameras.get_mut(camera) else { return };
    let points = &mut entry.control_points;
    let index = points.iter().position(|own| own.id == clicked.id).unwrap_or(points.len());
    match points.get_mut(index) {
        Some(own) => *own = clicked,
        None => points.push(clicked),
    }
    session.select_only(camera, Part::Control(index));
    session.commit(format!("click {name}"));
}

impl Tool for Control {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        match (pointer.pane, pointer.phase) {
            (Pane::Image(camera), Phase::Press | Phase::Drag | Phase::Release) => {
                session.select_camera(camera);
                let sigma = pointer.sigma_px(session, camera);
                if let Some(point) = chosen_ground_point(session).cloned() {
                    if pointer.phase == Phase::Release {
                        let clicked = ControlPointEntry::at_ground_point(&point, pointer.at.into());
                        add_ground_point(session, camera, ControlPointEntry { sigma_px: sigma, ..clicked });
                    }
                    return;
                }
                self.pending = Some((camera, pointer.at.into(), sigma));
            }
            (Pane::Plan, Phase::Release) => self.finish(session, pointer.at.into()),
            (Pane::Plan, _) => self.pointer_m = Some(pointer.at),
            _ => {}
        }
    }

    fn accept(&mut self, session: &mut Session) {
        // The point starts at its estimated floor position; the operator then enters its coordinates in the
        // table.
        let at =
            self.pending.and_then(|(camera, px, _)| session.solved.pose(camera)?.pixel_to_floor(px, 0.0));
        if let Some(at) = at {
            self.finish(session, at);
        }
    }

    fn cancel(&mut self) {
        *self = Self::default();
    }

    fn is_idle(&self) -> bool {
        self.pending.is_none()
    }

    fn hint(&self, session: &Session) -> String {
        if let Some(point) = chosen_ground_point(session) {
            return format!("Click {} in each image that shows it.", point.id);
        }
        match self.pending {
            None => "Click a point whose position you know.".into(),
            Some(_) => "Click the same point on the plan.  Enter: type its coordinates instead".into(),
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        self.pending.map(|(camera, px, _)| (Pane::Image(camera), px.into()))
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        let cross = |[x, y]: [f64; 2], arm: f64| {
            vec![vec![[x - arm, y], [x + arm, y]], vec![[x, y - arm], [x, y + arm]]]
        };
        match (pane, self.pending, self.pointer_m) {
            (Pane::Image(camera), Some((own, px, _)), _) if camera == own => cross(px.into(), 12.0),
            (Pane::Plan, Some(_), Some(over)) => cross(over, 0.3),
            _ => Vec::new(),
        }
    }
}
