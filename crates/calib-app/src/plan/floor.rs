//! Painting of the floor seen from above: plan, projected images, fields of view, cameras, marks.

use calib_core::{Camera, FloorPoint};
use calib_draw::{Geometry, Item, Meaning, PlanLayer, PlanView, cone_corners, on_plan};
use calib_editor::{Part, PlanHandle, Session, number, plan_handles, plan_scale};
use egui::{Align2, Color32, Mesh, Painter, Pos2, Rect, Shape, Stroke, Vec2};

use crate::canvas::Mapping;
use crate::overlay::Shown;
use crate::paint::{Pen, chip, handle, line, ring, tag};
use crate::picture::{Pictures, Piece};
use crate::plan::mesh::{fill, paint_projected};
use crate::state::EllipseSize;
use crate::theme::{self, on_image};

/// Input of the plan canvas.
#[derive(Debug)]
pub struct Floor<'a> {
    /// Open site with its results.
    pub session: &'a Session,
    /// Mapping between floor positions in metres and the screen.
    pub mapping: Mapping,
    /// Opacity of the projected images, 0 to 1.
    pub opacity: f32,
    /// Whether the images of all cameras are projected, not only the current one.
    pub blend: bool,
    /// Whether fields of view are filled, so that overlaps are visible.
    pub fills_fields: bool,
    /// Size of the position ellipses.
    pub ellipses: EllipseSize,
    /// Poses of the cameras before the current gesture or the last joint solve, painted as ghosts.
    pub before: &'a [Option<Camera>],
}

impl Floor<'_> {
    fn at(&self, point: FloorPoint) -> Pos2 {
        self.mapping.screen(point.into())
    }

    fn path(&self, points: &[FloorPoint]) -> Vec<Pos2> {
        points.iter().map(|&point| self.at(point)).collect()
    }

    /// Paints the plan image, rotated by the angle of the plan.
    pub fn paint_plan(&self, painter: &Painter, pieces: &[Piece]) {
        let scale = plan_scale(&self.session.site);
        for piece in pieces {
            let mut mesh = Mesh::with_texture(piece.texture);
            for [s, t] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                let at = calib_core::PlanPixel::new(
                    piece.low[0] + s * piece.size[0],
                    piece.low[1] + t * piece.size[1],
                );
                let (pos, uv) = (self.at(scale.floor_from_plan(at)), Pos2::new(s as f32, t as f32));
                mesh.vertices.push(egui::epaint::Vertex { pos, uv, color: Color32::WHITE });
            }
            mesh.add_triangle(0, 1, 2);
            mesh.add_triangle(0, 2, 3);
            painter.add(Shape::mesh(mesh));
        }
    }

    /// Paints the floor grid over the plan image.
    pub fn paint_grid(&self, painter: &Painter, colour: Color32) {
        // Lines are at least 24 points apart.
        let step = self.session.site.units.step(1.0 / self.mapping.view.zoom, 1.0 / 24.0);
        paint_grid(painter, &self.mapping, step, colour);
    }

    /// Paints the images of the cameras, projected onto the floor.
    pub fn paint_images(&self, painter: &Painter, pictures: &Pictures) {
        for index in 0..self.session.site.cameras.len() {
            let is_asked =
                self.blend && !self.session.site.is_superseded(index) || index == self.session.camera;
            if !is_asked || self.opacity <= 0.0 {
                continue;
            }
            let Some(entry) = self.session.site.cameras.get(index) else { continue };
            let Some(picture) = entry.image.as_ref().and_then(|name| pictures.ready(name)) else { continue };
            let (Some(pose), Some(solution)) =
                (self.session.solved.pose(index), self.session.solved.solution(index))
            else {
                continue;
            };
            let tint = Color32::from_white_alpha((255.0 * self.opacity) as u8);
            let plane = self.session.solved.efov_plane(&self.session.site, entry);
            let on = (pose, &plane);
            paint_projected(painter, &self.mapping, picture, on, &solution.efov_m, entry.size(), tint);
        }
    }

    /// Paints every camera with its field of view; the current camera is last and has handles.
    pub fn paint_cameras(&self, painter: &Painter, cursor: Option<[f64; 2]>) {
        for index in 0..self.session.site.cameras.len() {
            self.paint_ghost(painter, index);
        }
        let shown = Shown(self.session);
        let view = PlanView::new(&shown).with_uppermost(self.session.camera);
        let layers =
            [PlanLayer::Efovs, PlanLayer::PositionEllipses(self.ellipses.sigmas()), PlanLayer::Cameras];
        for item in on_plan(&view, &layers) {
            self.paint_camera(painter, &item);
        }
        self.paint_handles(painter, cursor);
    }

    fn paint_camera(&self, painter: &Painter, item: &Item<FloorPoint>) {
        let pen = Pen::of(Shown(self.session).look(item.meaning));
        match (&item.geometry, item.meaning) {
            (Geometry::Polygon(corners), meaning) => {
                let closed: Vec<FloorPoint> = corners.iter().chain(corners.first()).copied().collect();
                let points = self.path(&closed);
                let pen = match meaning {
                    Meaning::Efov(index) => {
                        if self.fills_fields {
                            fill(painter, &closed, &points, pen.colour.gamma_multiply(0.10));
                        }
                        self.field_pen(index, pen)
                    }
                    _ => pen,
                };
                line(painter, &points, pen);
            }
            (&Geometry::Cone { foot, ahead, half_angle }, Meaning::Camera(index)) => {
                self.paint_symbol(painter, index, [self.at(foot), self.at(ahead)], half_angle);
            }
            _ => {}
        }
    }

    /// Returns the pen for the field of view of a camera; the current camera has a bold solid outline.
    fn field_pen(&self, index: usize, pen: Pen) -> Pen {
        if index == self.session.camera { Pen { width: 2.5, ..pen }.dashed(&[]) } else { pen }
    }

    fn paint_symbol(&self, painter: &Painter, index: usize, [foot, ahead]: [Pos2; 2], half_angle: f64) {
        /// Length of the cone of a camera symbol, in points.
        const SYMBOL_LENGTH: f64 = 44.0;
        let pen = Pen::of(Shown(self.session).look(Meaning::Camera(index)));
        let [at, to] = [foot, ahead].map(|at| [f64::from(at.x), f64::from(at.y)]);
        let cone = cone_corners(at, to, half_angle, SYMBOL_LENGTH).into_iter();
        let cone = cone.map(|[x, y]| Pos2::new(x as f32, y as f32)).collect();
        let stroke = Stroke::new(pen.width, pen.colour);
        painter.add(Shape::convex_polygon(cone, pen.colour.gamma_multiply(0.25), stroke));
        painter.circle(foot, 5.0, Color32::WHITE, Stroke::new(1.5, Color32::BLACK));
        let rect = painter.clip_rect().shrink(18.0);
        if rect.contains(foot) {
            chip(painter, foot + Vec2::new(-18.0, 0.0), self.session.camera_slot(index));
        } else if let Some(pose) = self.session.solved.pose(index) {
            self.paint_offscreen_camera(painter, index, pose, rect, foot);
        }
    }

    /// Paints a marker at the border of the canvas for a camera outside it, with letter, id and distance.
    fn paint_offscreen_camera(&self, painter: &Painter, index: usize, pose: &Camera, rect: Rect, foot: Pos2) {
        let at = rect.clamp(foot);
        chip(painter, at, self.session.camera_slot(index));
        let middle = self.mapping.document(rect.center());
        let far = (pose.position.x - middle[0]).hypot(pose.position.y - middle[1]);
        let far = self.session.site.units.length(far, 0);
        let text = format!("{}, {far}", self.session.site.cameras[index].id);
        let align = if at.x > rect.center().x { Align2::RIGHT_CENTER } else { Align2::LEFT_CENTER };
        let side = if at.x > rect.center().x { -12.0 } else { 12.0 };
        tag(painter, at + Vec2::new(side, 0.0), align, &text, on_image::WHITE);
    }

    /// Paints the earlier field of view of a camera whose position or yaw has changed.
    fn paint_ghost(&self, painter: &Painter, index: usize) {
        let Some(Some(before)) = self.before.get(index) else { return };
        let solved = &self.session.solved;
        let (Some(pose), Some(_)) = (solved.pose(index), solved.solution(index)) else { return };
        if before.position == pose.position && before.yaw == pose.yaw {
            return;
        }
        let Some(entry) = self.session.site.cameras.get(index) else { return };
        let (corners, plane) =
            (calib_editor::corners_of(entry), solved.efov_plane(&self.session.site, entry));
        let outline: Vec<Pos2> = corners
            .iter()
            .chain(corners.first())
            .filter_map(|&pixel| before.pixel_to_plane(pixel, &plane))
            .map(|point| self.at(point.on_floor()))
            .collect();
        line(painter, &outline, Pen::new(Color32::from_gray(200), 1.0).dashed(&[3.0, 4.0]).bare());
    }

    fn paint_handles(&self, painter: &Painter, cursor: Option<[f64; 2]>) {
        let handles = plan_handles(self.session, self.session.camera);
        let screen: Vec<(PlanHandle, Pos2)> =
            handles.into_iter().map(|(handle, at)| (handle, self.mapping.screen(at))).collect();
        let find = |wanted: PlanHandle| screen.iter().find(|(h, _)| *h == wanted).map(|(_, at)| *at);
        if let (Some(foot), Some(turn)) = (find(PlanHandle::Foot), find(PlanHandle::Rotate)) {
            painter.line_segment([foot, turn], Stroke::new(1.0, Color32::WHITE));
        }
        let over = cursor.map(|at| self.mapping.screen(at));
        for (which, at) in screen {
            let colour = theme::camera(self.session.camera_slot(self.session.camera));
            match which {
                PlanHandle::Rotate => ring(painter, at, on_image::ACCENT, true),
                PlanHandle::Scale => {
                    let rect = Rect::from_center_size(at, Vec2::splat(9.0));
                    painter.rect_filled(rect, 0.0, Color32::WHITE);
                    painter.rect_stroke(
                        rect,
                        0.0,
                        Stroke::new(1.0, Color32::BLACK),
                        egui::StrokeKind::Outside,
                    );
                }
                PlanHandle::Foot | PlanHandle::Body => {}
                PlanHandle::Corner(_) => handle(painter, at, colour),
            }
            if over.is_some_and(|over| over.distance(at) < theme::HIT) {
                painter.circle_stroke(at, 8.0, Stroke::new(1.5, on_image::ACCENT));
            }
        }
        self.paint_pose_changes(painter);
        if let Some(pivot) = self.session.tool.pivot {
            let at = self.mapping.screen(pivot);
            painter.circle_stroke(at, 6.0, Stroke::new(1.5, on_image::WAITING));
            painter.circle_filled(at, 2.0, on_image::WAITING);
        }
    }

    /// Paints the changes of yaw, height and position next to the current camera, compared with the earlier
    /// pose.
    fn paint_pose_changes(&self, painter: &Painter) {
        let camera = self.session.camera;
        let (Some(Some(before)), Some(now)) = (self.before.get(camera), self.session.solved.pose(camera))
        else {
            return;
        };
        let turn = |pose: &Camera| number(pose.yaw.to_degrees(), 1);
        let height = |pose: &Camera| self.session.site.units.length(pose.position.z, 2);
        let moved = now.position.on_floor().distance(before.position.on_floor());
        let told = [
            (turn(now) != turn(before), format!("yaw {}\u{b0}, was {}\u{b0}", turn(now), turn(before))),
            (height(now) != height(before), format!("height {}, was {}", height(now), height(before))),
            (moved > 0.005, format!("moved {}", self.session.site.units.short_length(moved))),
        ];
        let told: Vec<String> =
            told.into_iter().filter(|(differs, _)| *differs).map(|(_, text)| text).collect();
        let at = self.at(now.position.on_floor()) + Vec2::new(14.0, 10.0);
        for (row, text) in told.iter().enumerate() {
            tag(painter, at + Vec2::new(0.0, 20.0 * row as f32), Align2::LEFT_TOP, text, on_image::WHITE);
        }
    }

    /// Paints plane regions, marks, solved links, and control points with a line to their projected position.
    pub fn paint_elements(&self, painter: &Painter, cursor: Option<[f64; 2]>) {
        let over = cursor.map(|at| self.mapping.screen(at));
        let shown = Shown(self.session);
        let layers = [PlanLayer::Planes, PlanLayer::Marks, PlanLayer::Links, PlanLayer::ControlPoints];
        for item in on_plan(&PlanView::new(&shown), &layers) {
            self.paint_element(painter, &item, over);
        }
        if let Some([a, b]) = self.session.tool.measured {
            let scale = plan_scale(&self.session.site);
            let ends = [a, b].map(|p| self.at(scale.floor_from_plan(p)));
            line(painter, &ends, Pen::new(on_image::WAITING, 2.0));
            for at in ends {
                handle(painter, at, on_image::WAITING);
            }
        }
    }

    fn paint_element(&self, painter: &Painter, item: &Item<FloorPoint>, over: Option<Pos2>) {
        let pen = self.pen(item.meaning);
        match (&item.geometry, item.meaning) {
            (Geometry::Polyline(points), _) => line(painter, &self.path(points), pen),
            (Geometry::Polygon(corners), _) => {
                let closed: Vec<FloorPoint> = corners.iter().chain(corners.first()).copied().collect();
                line(painter, &self.path(&closed), pen);
            }
            (Geometry::Label(at, text), Meaning::Plane(_)) => {
                tag(painter, self.at(*at), Align2::CENTER_CENTER, text, pen.colour);
            }
            (Geometry::Point(at), Meaning::ControlPoint { .. }) => {
                let at = self.at(*at);
                for arm in [Vec2::new(7.0, 0.0), Vec2::new(0.0, 7.0)] {
                    line(painter, &[at - arm, at + arm], pen);
                }
            }
            (Geometry::Point(at), _) => handle(painter, self.at(*at), pen.colour),
            (Geometry::Label(at, text), meaning) => {
                let at = self.at(*at);
                let is_near = over.is_some_and(|over| over.distance(at) < 48.0);
                let (by, align) = match meaning {
                    Meaning::Mark(_) => (Vec2::new(8.0, 4.0), Align2::LEFT_TOP),
                    _ => (Vec2::new(6.0, -4.0), Align2::LEFT_BOTTOM),
                };
                if is_near || self.is_selected(meaning) {
                    tag(painter, at + by, align, text, on_image::WHITE);
                }
            }
            _ => {}
        }
    }

    fn is_selected(&self, meaning: Meaning) -> bool {
        match meaning {
            Meaning::Mark(index) => self.session.selection.contains(&Part::Mark(index)),
            Meaning::Plane(index) => self.session.tool.plane == Some(index),
            _ => false,
        }
    }

    fn pen(&self, meaning: Meaning) -> Pen {
        let pen = Pen::of(Shown(self.session).look(meaning));
        match meaning {
            _ if self.is_selected(meaning) => pen.coloured(on_image::ACCENT),
            // The plan shows the control points of all cameras, so each point has the colour of its camera.
            Meaning::ControlPoint { camera, .. } => {
                pen.coloured(theme::camera(self.session.camera_slot(camera)))
            }
            _ => pen,
        }
    }

    /// Paints the scale bar, and the note about size and magnification of the ellipses.
    pub fn paint_scale(&self, painter: &Painter) {
        let rect = painter.clip_rect();
        let units = self.session.site.units;
        let metres = units.step(1.0 / self.mapping.view.zoom, 1.0 / 80.0);
        let (length, left) =
            ((metres * self.mapping.view.zoom) as f32, rect.left_bottom() + Vec2::new(16.0, -16.0));
        let right = left + Vec2::new(length, 0.0);
        let tick = Vec2::new(0.0, 5.0);
        line(painter, &[left - tick, left, right, right - tick], Pen::new(on_image::WHITE, 1.5));
        let at = left + Vec2::new(0.5 * length, -8.0);
        tag(painter, at, Align2::CENTER_BOTTOM, &units.trimmed_length(metres), on_image::WHITE);
        let at = rect.right_bottom() + Vec2::new(-16.0, -16.0);
        if rect.width() > 300.0 {
            tag(painter, at, Align2::RIGHT_BOTTOM, &self.ellipses.label(), on_image::WHITE);
        }
    }
}

/// Paints grid lines over the visible area; `step` is in metres.
pub fn paint_grid(painter: &Painter, mapping: &Mapping, step: f64, colour: Color32) {
    let rect = painter.clip_rect();
    let (a, b) = (mapping.document(rect.left_bottom()), mapping.document(rect.right_top()));
    for axis in 0..2 {
        let (low, high) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
        let (first, count) = ((low / step).ceil(), ((high - low) / step).floor().min(200.0) as i32);
        for i in 0..=count {
            let value = (first + f64::from(i)) * step;
            let end = |other: f64| if axis == 0 { [value, other] } else { [other, value] };
            let (p, q) = (mapping.screen(end(a[1 - axis])), mapping.screen(end(b[1 - axis])));
            painter.line_segment([p, q], Stroke::new(1.0, colour));
        }
    }
}
