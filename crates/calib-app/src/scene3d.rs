//! The site in space: frusta, prisms, plan, marks, uncertainty; orbit, pan, zoom. Painted with egui's painter.

use calib_core::{FloorPoint, WorldPoint, in_front, position_ellipse, prism};
use calib_editor::Session;
use egui::{Align2, Color32, Painter, Pos2, Rect, Vec2};

use crate::floor::{MAGNIFIED, SIGMAS};
use crate::paint::{Pen, chip, handle, line, tag};
use crate::theme::{self, on_image};

/// From where the scene is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// The point in the middle, in metres.
    pub target: [f64; 3],
    /// Distance from it, in metres.
    pub distance: f64,
    /// Turn about the vertical, in radians.
    pub yaw: f64,
    /// Above the floor, in radians.
    pub pitch: f64,
}

/// Nearer than this to the eye nothing is drawn, in metres.
const NEAR: f64 = 0.05;

impl Orbit {
    /// Sees the whole site.
    #[must_use]
    pub fn of(session: &Session) -> Self {
        let count = session.site.cameras.len();
        let points: Vec<FloorPoint> = (0..count)
            .filter_map(|i| session.solved.solution(i))
            .flat_map(|solution| solution.efov_m.iter().copied())
            .chain((0..count).filter_map(|i| session.solved.pose(i)).map(|pose| pose.position.on_floor()))
            .collect();
        let range = |of: fn(&FloorPoint) -> f64| {
            let values = || points.iter().map(of);
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
        };
        let ((x0, x1), (y0, y1)) = (range(|p| p.x), range(|p| p.y));
        if points.is_empty() {
            return Self { target: [0.0, 4.0, 0.0], distance: 15.0, yaw: 0.5, pitch: 0.6 };
        }
        let target = [0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5];
        Self { target, distance: 1.1 * (x1 - x0).hypot(y1 - y0).clamp(3.0, 500.0), yaw: 0.5, pitch: 0.7 }
    }

    fn axes(&self) -> [[f64; 3]; 3] {
        let ((sy, cy), (sp, cp)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        [[cy, sy, 0.0], [sy * sp, -cy * sp, -cp], [-sy * cp, cy * cp, -sp]]
    }

    /// Right, down and forward of a point as the eye has it, in metres.
    fn seen(&self, point: WorldPoint) -> [f64; 3] {
        let by = [point.x - self.target[0], point.y - self.target[1], point.z - self.target[2]];
        let mut seen = self.axes().map(|axis| axis.iter().zip(by).map(|(a, b)| a * b).sum::<f64>());
        seen[2] += self.distance;
        seen
    }

    fn screen(rect: Rect, [x, y, z]: [f64; 3]) -> Pos2 {
        let focal = 0.9 * f64::from(rect.height().min(rect.width()));
        rect.center() + Vec2::new((focal * x / z) as f32, (focal * y / z) as f32)
    }

    /// Where the screen shows a point; `None` behind the eye.
    #[must_use]
    pub fn project(&self, rect: Rect, point: WorldPoint) -> Option<Pos2> {
        let seen = self.seen(point);
        (seen[2] > NEAR).then(|| Self::screen(rect, seen))
    }

    /// Turns by a drag of so many points.
    pub fn turn(&mut self, by: Vec2) {
        self.yaw -= 0.008 * f64::from(by.x);
        self.pitch = (self.pitch + 0.008 * f64::from(by.y)).clamp(-0.2, 1.57);
    }

    /// Moves the point in the middle by a drag of so many points.
    pub fn pan(&mut self, by: Vec2) {
        let [right, down, _] = self.axes();
        let share = self.distance / 700.0;
        for axis in 0..3 {
            self.target[axis] -= share * (f64::from(by.x) * right[axis] + f64::from(by.y) * down[axis]);
        }
    }

    /// Comes nearer or goes farther.
    pub fn zoom(&mut self, factor: f64) {
        self.distance = (self.distance / factor).clamp(0.2, 1e4);
    }

    fn polyline(&self, painter: &Painter, rect: Rect, points: &[WorldPoint], pen: Pen) {
        for pair in points.windows(2) {
            let Some([a, b]) = in_front(self.seen(pair[0]), self.seen(pair[1]), NEAR) else { continue };
            line(painter, &[Self::screen(rect, a), Self::screen(rect, b)], pen);
        }
    }
}

/// Paints the scene; `plan` is its texture with its size in pixels.
pub fn paint(
    painter: &Painter,
    rect: Rect,
    orbit: &Orbit,
    session: &Session,
    plan: Option<(egui::TextureId, [u32; 2])>,
) {
    if let Some((texture, size)) = plan {
        paint_plan(painter, rect, orbit, session, texture, size);
    }
    paint_ground(painter, rect, orbit);
    for mark in session.site.marks.iter().filter(|mark| !mark.off) {
        for part in mark.shape().polylines() {
            orbit.polyline(painter, rect, &part, Pen::new(on_image::WHITE, 1.75));
        }
    }
    for index in 0..session.site.cameras.len() {
        paint_camera(painter, rect, orbit, session, index);
    }
}

fn paint_ground(painter: &Painter, rect: Rect, orbit: &Orbit) {
    const LINES: i32 = 20;
    let step =
        [0.5, 1.0, 2.0, 5.0, 10.0, 50.0].into_iter().find(|s| s * 16.0 > orbit.distance).unwrap_or(100.0);
    let middle = [0, 1].map(|axis| (orbit.target[axis] / step).round() * step);
    let reach = step * f64::from(LINES);
    let pen = Pen::new(Color32::from_white_alpha(26), 1.0).bare();
    for i in -LINES..=LINES {
        let off = step * f64::from(i);
        let (x, y) = (middle[0] + off, middle[1] + off);
        let lines = [
            [WorldPoint::new(x, middle[1] - reach, 0.0), WorldPoint::new(x, middle[1] + reach, 0.0)],
            [WorldPoint::new(middle[0] - reach, y, 0.0), WorldPoint::new(middle[0] + reach, y, 0.0)],
        ];
        for points in lines {
            orbit.polyline(painter, rect, &points, pen);
        }
    }
}

fn paint_plan(
    painter: &Painter,
    rect: Rect,
    orbit: &Orbit,
    session: &Session,
    texture: egui::TextureId,
    size: [u32; 2],
) {
    const CELLS: u32 = 24;
    let scale = calib_editor::plan_scale(&session.site);
    let mut mesh = egui::Mesh::with_texture(texture);
    let mut seen = Vec::new();
    for row in 0..=CELLS {
        for column in 0..=CELLS {
            let (s, t) = (f64::from(column) / f64::from(CELLS), f64::from(row) / f64::from(CELLS));
            let at = calib_core::PlanPixel::new(s * f64::from(size[0]), t * f64::from(size[1]));
            let at = orbit.project(rect, scale.floor_from_plan(at).at_height(0.0));
            seen.push(at.is_some());
            let (pos, uv) = (at.unwrap_or(Pos2::ZERO), Pos2::new(s as f32, t as f32));
            mesh.vertices.push(egui::epaint::Vertex { pos, uv, color: Color32::from_white_alpha(150) });
        }
    }
    for row in 0..CELLS {
        for column in 0..CELLS {
            let i = row * (CELLS + 1) + column;
            let quad = [i, i + 1, i + CELLS + 1, i + CELLS + 2];
            if quad.iter().all(|&k| seen.get(k as usize) == Some(&true)) {
                mesh.add_triangle(quad[0], quad[1], quad[2]);
                mesh.add_triangle(quad[1], quad[3], quad[2]);
            }
        }
    }
    painter.add(egui::Shape::mesh(mesh));
}

fn paint_camera(painter: &Painter, rect: Rect, orbit: &Orbit, session: &Session, index: usize) {
    let (Some(entry), Some(pose), Some(solution)) =
        (session.site.cameras.get(index), session.solved.pose(index), session.solved.solution(index))
    else {
        return;
    };
    let is_own = index == session.camera;
    let colour = theme::camera(index);
    for (i, face) in prism(&solution.efov_m).iter().take(2).enumerate() {
        let pen = Pen::new(colour, if i == 0 { 2.0 } else { 1.25 });
        orbit.polyline(painter, rect, face, if i == 0 { pen.dashed(&[10.0, 5.0]) } else { pen.bare() });
    }
    for edge in session.prism_edges(index) {
        orbit.polyline(painter, rect, &edge, Pen::new(colour, 1.25).bare());
    }
    // The frustum to a plane a little in front of the camera.
    let depth = 0.25 * pose.position.z.abs().clamp(1.0, 6.0);
    let [w, h] = entry.size();
    let ends: Vec<WorldPoint> = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]
        .iter()
        .filter_map(|&corner| {
            let ray = pose.pixel_to_ray(corner.into())?;
            let [x, y, z] = ray.direction.map(|d| depth * d);
            let WorldPoint { x: x0, y: y0, z: z0 } = pose.position;
            Some(WorldPoint::new(x0 + x, y0 + y, z0 + z))
        })
        .collect();
    let pen = Pen::new(colour, if is_own { 2.5 } else { 1.5 });
    for (i, &end) in ends.iter().enumerate() {
        orbit.polyline(painter, rect, &[pose.position, end], pen);
        orbit.polyline(painter, rect, &[end, ends[(i + 1) % ends.len()]], pen);
    }
    let foot = pose.position.on_floor().at_height(0.0);
    orbit.polyline(painter, rect, &[pose.position, foot], Pen::new(colour, 1.0).dashed(&[2.0, 4.0]).bare());
    if let Some(mut outline) = position_ellipse(pose, SIGMAS * MAGNIFIED) {
        outline.extend(outline.first().copied());
        let outline: Vec<WorldPoint> = outline.into_iter().map(|point| point.at_height(0.0)).collect();
        orbit.polyline(painter, rect, &outline, Pen::new(colour, 1.25).bare());
    }
    if let Some(at) = orbit.project(rect, pose.position) {
        handle(painter, at, Color32::WHITE);
        chip(painter, at - Vec2::new(0.0, 16.0), index);
        if is_own {
            tag(painter, at + Vec2::new(12.0, -16.0), Align2::LEFT_CENTER, &entry.id, on_image::WHITE);
        }
    }
}

/// The camera that is shown near a point of the screen.
#[must_use]
pub fn pick(rect: Rect, orbit: &Orbit, session: &Session, at: Pos2) -> Option<usize> {
    let shown = (0..session.site.cameras.len()).filter_map(|index| {
        let far = orbit.project(rect, session.solved.pose(index)?.position)?.distance(at);
        (far < 24.0).then_some((index, far))
    });
    shown.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}
