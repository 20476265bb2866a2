//! What is painted on the floor from above: plan, images laid on it, polygons, cameras, marks. Reads only.

use calib_core::{Camera, FloorPoint, Pixel, position_ellipse};
use calib_editor::{Part, PlanHandle, Session, plan_handles, plan_scale};
use egui::{Align2, Color32, Mesh, Painter, Pos2, Rect, Shape, Stroke, Vec2};

use crate::canvas::Mapping;
use crate::paint::{Pen, chip, handle, line, ring, tag};
use crate::picture::{Picture, Pictures, Piece};
use crate::theme::{self, on_image};

/// What the floor's canvas needs to know.
#[derive(Debug)]
pub struct Floor<'a> {
    /// The site and its results.
    pub session: &'a Session,
    /// Where the floor is on the screen.
    pub mapping: Mapping,
    /// Opacity of the images laid on the plan, 0 to 1.
    pub opacity: f32,
    /// Whether images of all cameras are laid on it, not only of the one in hand.
    pub blend: bool,
    /// Whether fields are filled, so that overlap shows.
    pub coverage: bool,
    /// Poses before the gesture under way or the last joint solve, to be shown as ghosts.
    pub before: &'a [Option<Camera>],
}

/// Cells of the mesh on which an image is laid on the floor.
const CELLS: usize = 12;
/// How many standard deviations an ellipse spans.
pub const SIGMAS: f64 = 2.0;
/// How much larger than life an ellipse is drawn.
pub const MAGNIFIED: f64 = 10.0;

impl Floor<'_> {
    fn at(&self, point: FloorPoint) -> Pos2 {
        self.mapping.screen(point.into())
    }

    fn path(&self, points: &[FloorPoint]) -> Vec<Pos2> {
        points.iter().map(|&point| self.at(point)).collect()
    }

    /// The plan's picture under everything, turned as the plan is.
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

    /// The grid, where there is no plan or where it ends.
    pub fn paint_grid(&self, painter: &Painter, colour: Color32) {
        // No lines nearer to each other than 24 points.
        let step = self.session.units.step(1.0 / self.mapping.view.zoom, 1.0 / 24.0);
        paint_grid(painter, &self.mapping, step, colour);
    }

    /// The images laid on the floor.
    pub fn paint_images(&self, painter: &Painter, pictures: &Pictures) {
        for index in 0..self.session.site.cameras.len() {
            if !(self.blend || index == self.session.camera) || self.opacity <= 0.0 {
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
            lay(painter, &self.mapping, picture, pose, &solution.efov_m, entry.size(), tint);
        }
    }

    /// Every camera with its field; the one in hand last and with handles.
    pub fn paint_cameras(&self, painter: &Painter, cursor: Option<[f64; 2]>) {
        let count = self.session.site.cameras.len();
        let own = self.session.camera;
        for index in (0..count).filter(|&index| index != own).chain((own < count).then_some(own)) {
            self.paint_camera(painter, index);
        }
        self.paint_handles(painter, cursor);
    }

    fn paint_camera(&self, painter: &Painter, index: usize) {
        let (Some(pose), Some(solution)) =
            (self.session.solved.pose(index), self.session.solved.solution(index))
        else {
            return;
        };
        let is_own = index == self.session.camera;
        let colour = theme::camera(index);
        if let Some(Some(before)) = self.before.get(index)
            && (before.position != pose.position || before.yaw != pose.yaw)
        {
            self.paint_ghost(painter, index, before);
        }
        let outline: Vec<FloorPoint> =
            solution.efov_m.iter().chain(solution.efov_m.first()).copied().collect();
        let points = self.path(&outline);
        if self.coverage {
            fill(painter, &points, colour.gamma_multiply(0.10));
        }
        let pen = Pen::new(colour, if is_own { 2.5 } else { 2.0 });
        line(painter, &points, if is_own { pen } else { pen.dashed(&[10.0, 5.0]) });
        let foot = self.at(pose.position.on_floor());
        self.paint_cone(painter, pose, foot, colour);
        self.paint_ellipse(painter, pose, colour);
        painter.circle(foot, 5.0, Color32::WHITE, Stroke::new(1.5, Color32::BLACK));
        let rect = painter.clip_rect().shrink(18.0);
        if rect.contains(foot) {
            chip(painter, foot + Vec2::new(-18.0, 0.0), index);
        } else {
            self.paint_far(painter, index, pose, rect, foot);
        }
    }

    /// A camera that is off the screen: its letter at the border, and how far it is.
    fn paint_far(&self, painter: &Painter, index: usize, pose: &Camera, rect: Rect, foot: Pos2) {
        let at = rect.clamp(foot);
        chip(painter, at, index);
        let middle = self.mapping.document(rect.center());
        let far = (pose.position.x - middle[0]).hypot(pose.position.y - middle[1]);
        let far = self.session.units.length(far, 0);
        let text = format!("{}, {far}", self.session.site.cameras[index].id);
        let align = if at.x > rect.center().x { Align2::RIGHT_CENTER } else { Align2::LEFT_CENTER };
        let side = if at.x > rect.center().x { -12.0 } else { 12.0 };
        tag(painter, at + Vec2::new(side, 0.0), align, &text, on_image::WHITE);
    }

    fn paint_cone(&self, painter: &Painter, pose: &Camera, foot: Pos2, colour: Color32) {
        const LENGTH: f32 = 44.0;
        let half = (0.5 * pose.lens.principal_point.u.max(1.0) * 2.0 / pose.focal).atan();
        let ray = |off: f64| {
            let angle = pose.yaw + off;
            foot + LENGTH * Vec2::new(-angle.sin() as f32, -angle.cos() as f32)
        };
        let points = vec![foot, ray(half), ray(-half)];
        painter.add(Shape::convex_polygon(points, colour.gamma_multiply(0.25), Stroke::new(1.5, colour)));
    }

    fn paint_ellipse(&self, painter: &Painter, pose: &Camera, colour: Color32) {
        let Some(mut outline) = position_ellipse(pose, SIGMAS * MAGNIFIED) else { return };
        outline.extend(outline.first().copied());
        line(painter, &self.path(&outline), Pen::new(colour, 1.25).bare());
    }

    fn paint_ghost(&self, painter: &Painter, index: usize, before: &Camera) {
        let Some(entry) = self.session.site.cameras.get(index) else { return };
        let corners = calib_editor::corners_of(entry);
        let outline: Vec<Pos2> = corners
            .iter()
            .chain(corners.first())
            .filter_map(|&pixel| before.pixel_to_floor(pixel, 0.0))
            .map(|point| self.at(point))
            .collect();
        line(painter, &outline, Pen::new(Color32::from_gray(200), 1.0).dashed(&[3.0, 4.0]).bare());
    }

    fn paint_handles(&self, painter: &Painter, cursor: Option<[f64; 2]>) {
        let handles = plan_handles(self.session, self.session.camera);
        let screen: Vec<(PlanHandle, Pos2)> =
            handles.into_iter().map(|(handle, at)| (handle, self.mapping.screen(at))).collect();
        let find = |wanted: PlanHandle| screen.iter().find(|(h, _)| *h == wanted).map(|(_, at)| *at);
        if let (Some(foot), Some(turn)) = (find(PlanHandle::Foot), find(PlanHandle::Turn)) {
            painter.line_segment([foot, turn], Stroke::new(1.0, Color32::WHITE));
        }
        let over = cursor.map(|at| self.mapping.screen(at));
        for (which, at) in screen {
            let colour = theme::camera(self.session.camera);
            match which {
                PlanHandle::Turn => ring(painter, at, on_image::ACCENT, true),
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
        if let Some(pivot) = self.session.pivot {
            let at = self.mapping.screen(pivot);
            painter.circle_stroke(at, 6.0, Stroke::new(1.5, on_image::WAITING));
            painter.circle_filled(at, 2.0, on_image::WAITING);
        }
    }

    /// Marks, links that were solved, control points with a rubber band to where the camera shows them.
    pub fn paint_elements(&self, painter: &Painter, cursor: Option<[f64; 2]>) {
        let over = cursor.map(|at| self.mapping.screen(at));
        let is_near = |at: Pos2| over.is_some_and(|over| over.distance(at) < 48.0);
        for (index, mark) in self.session.site.marks.iter().enumerate().filter(|(_, mark)| !mark.off) {
            let shape = mark.shape();
            let is_held = self.session.selection.contains(&Part::Mark(index));
            let colour = if is_held { on_image::ACCENT } else { on_image::WHITE };
            for part in shape.polylines() {
                let points: Vec<Pos2> = part.iter().map(|p| self.at(p.on_floor())).collect();
                line(painter, &points, Pen::new(colour, 1.75));
            }
            let at = self.at(shape.at.on_floor());
            handle(painter, at, colour);
            let name = mark.name.as_ref().or(mark.id.as_ref());
            if let Some(name) = name.filter(|_| is_held || is_near(at)) {
                tag(painter, at + Vec2::new(8.0, 4.0), Align2::LEFT_TOP, name, on_image::WHITE);
            }
        }
        self.paint_links(painter, is_near);
        let plan = self.session.site.plan.as_ref();
        for (index, camera) in self.session.site.cameras.iter().enumerate() {
            let colour = theme::camera(index);
            for point in camera.control_points.iter().filter(|point| !point.off) {
                let Some(world) = point.control_point(plan).map(|point| point.world) else { continue };
                let at = self.at(world.on_floor());
                let pen = Pen::new(colour, 1.5);
                line(painter, &[at - Vec2::new(7.0, 0.0), at + Vec2::new(7.0, 0.0)], pen);
                line(painter, &[at - Vec2::new(0.0, 7.0), at + Vec2::new(0.0, 7.0)], pen);
                let pose = self.session.solved.pose(index);
                if let Some(seen) = pose.and_then(|pose| pose.pixel_to_floor(point.px, world.z)) {
                    line(painter, &[at, self.at(seen)], Pen::new(on_image::BAD, 1.5));
                }
            }
        }
        if let Some([a, b]) = self.session.measured {
            let scale = plan_scale(&self.session.site);
            let ends = [a, b].map(|p| self.at(scale.floor_from_plan(p)));
            line(painter, &ends, Pen::new(on_image::WAITING, 2.0));
            for at in ends {
                handle(painter, at, on_image::WAITING);
            }
        }
    }

    /// Where every view says a link is: apart by as much as the views disagree.
    fn paint_links(&self, painter: &Painter, is_near: impl Fn(Pos2) -> bool) {
        for link in &self.session.site.links {
            let height = link.height_m.unwrap_or(0.0);
            let seen = link.seen.iter().filter_map(|seen| {
                let index = self.session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
                let px = seen.px.or(seen.foot)?;
                let floor = self.session.solved.placed(index)?.pixel_to_floor(px, height)?;
                Some((index, self.at(floor)))
            });
            let seen: Vec<(usize, Pos2)> = seen.collect();
            for pair in seen.windows(2) {
                line(painter, &[pair[0].1, pair[1].1], Pen::new(on_image::WAITING, 1.25));
            }
            for &(index, at) in &seen {
                handle(painter, at, theme::camera(index));
            }
            if let (Some(id), Some((_, at))) = (&link.id, seen.first())
                && is_near(*at)
            {
                tag(painter, *at + Vec2::new(6.0, -4.0), Align2::LEFT_BOTTOM, id, on_image::WHITE);
            }
        }
    }

    /// A bar of a round length, and how ellipses are drawn.
    pub fn paint_scale(&self, painter: &Painter) {
        let rect = painter.clip_rect();
        let units = self.session.units;
        let metres = units.step(1.0 / self.mapping.view.zoom, 1.0 / 80.0);
        let (length, left) =
            ((metres * self.mapping.view.zoom) as f32, rect.left_bottom() + Vec2::new(16.0, -16.0));
        let right = left + Vec2::new(length, 0.0);
        let tick = Vec2::new(0.0, 5.0);
        line(painter, &[left - tick, left, right, right - tick], Pen::new(on_image::WHITE, 1.5));
        let at = left + Vec2::new(0.5 * length, -8.0);
        let text = format!("{} {}", metres / units.metres(), units.sign());
        tag(painter, at, Align2::CENTER_BOTTOM, &text, on_image::WHITE);
        let at = rect.right_bottom() + Vec2::new(-16.0, -16.0);
        let text = format!("ellipses: {SIGMAS}\u{3c3}, \u{d7}{MAGNIFIED}");
        if rect.width() > 300.0 {
            tag(painter, at, Align2::RIGHT_BOTTOM, &text, on_image::WHITE);
        }
    }
}

/// Lines of a grid over all that is shown.
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

/// The image inside its field: the field cut into small triangles, each corner looked up in the image.
pub fn lay(
    painter: &Painter,
    mapping: &Mapping,
    picture: &Picture,
    pose: &Camera,
    field: &[FloorPoint],
    [w, h]: [f64; 2],
    tint: Color32,
) {
    let mut mesh = Mesh::with_texture(picture.overview.id());
    let corners: Vec<[f64; 2]> = field.iter().map(|&point| point.into()).collect();
    for triangle in triangles(&corners) {
        let base = mesh.vertices.len() as u32;
        let at = |s: f64, t: f64| -> [f64; 2] {
            let [a, b, c] = triangle;
            std::array::from_fn(|i| a[i] + s * (b[i] - a[i]) + t * (c[i] - a[i]))
        };
        let mut is_whole = true;
        for i in 0..=CELLS {
            for j in 0..=CELLS - i {
                let point = at(i as f64 / CELLS as f64, j as f64 / CELLS as f64);
                let seen = pose.world_to_pixel(FloorPoint::from(point).at_height(0.0));
                is_whole &= seen.is_some();
                let Pixel { u, v } = seen.unwrap_or_default();
                let uv = Pos2::new((u / w) as f32, (v / h) as f32);
                let pos = mapping.screen(point);
                mesh.vertices.push(egui::epaint::Vertex { pos, uv, color: tint });
            }
        }
        if !is_whole {
            mesh.vertices.truncate(base as usize);
            continue;
        }
        let index = |i: usize, j: usize| base + (i * (CELLS + 1) - i * i.saturating_sub(1) / 2 + j) as u32;
        for i in 0..CELLS {
            for j in 0..CELLS - i {
                mesh.add_triangle(index(i, j), index(i + 1, j), index(i, j + 1));
                if j + 1 < CELLS - i {
                    mesh.add_triangle(index(i + 1, j), index(i + 1, j + 1), index(i, j + 1));
                }
            }
        }
    }
    painter.add(Shape::mesh(mesh));
}

/// Fills a polygon that need not be convex.
fn fill(painter: &Painter, points: &[Pos2], colour: Color32) {
    let corners: Vec<[f64; 2]> = points.iter().map(|p| [f64::from(p.x), f64::from(p.y)]).collect();
    let mut mesh = Mesh::default();
    for triangle in triangles(&corners) {
        let base = mesh.vertices.len() as u32;
        for [x, y] in triangle {
            mesh.colored_vertex(Pos2::new(x as f32, y as f32), colour);
        }
        mesh.add_triangle(base, base + 1, base + 2);
    }
    painter.add(Shape::mesh(mesh));
}

/// A simple polygon as triangles, cut off at its ears (Meisters 1975).
fn triangles(polygon: &[[f64; 2]]) -> Vec<[[f64; 2]; 3]> {
    let mut ring = polygon.to_vec();
    if ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    let cross =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let sign: f64 =
        ring.iter().zip(ring.iter().cycle().skip(1)).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
    let mut found = Vec::new();
    while ring.len() >= 3 {
        let count = ring.len();
        let around = |i: usize| [ring[(i + count - 1) % count], ring[i], ring[(i + 1) % count]];
        let is_ear = |i: &usize| {
            let [a, b, c] = around(*i);
            let holds = |p: &&[f64; 2]| {
                **p != a
                    && **p != b
                    && **p != c
                    && [(a, b), (b, c), (c, a)].iter().all(|(p0, p1)| cross(*p0, *p1, **p) * sign >= 0.0)
            };
            cross(a, b, c) * sign > 0.0 && !ring.iter().any(|p| holds(&p))
        };
        // A polygon that crosses itself has no ear at some point: then any corner goes.
        let i = (0..count).find(is_ear).unwrap_or(0);
        found.push(around(i));
        ring.remove(i);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_cover_a_polygon_with_a_dent() {
        let polygon = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]];
        let area = |[a, b, c]: [[f64; 2]; 3]| {
            0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
        };
        let total: f64 = triangles(&polygon).into_iter().map(area).sum();
        assert!((total - 10.0).abs() < 1e-12, "{total}");
    }
}
