//! 3-D view of the site: frusta, walls of the fields of view, plan, marks, uncertainty; orbit, pan and zoom.

use calib_core::{Camera, ImageCircle, Pixel, WorldPoint};

use calib_core::floor::{in_front, position_ellipse, prism};

use calib_editor::Session;
use calib_site::SiteCamera;
use egui::{Align2, Color32, Painter, Pos2, Rect, Vec2};

use crate::paint::{Pen, chip, handle, line, tag};
use crate::state::{EllipseSize, NEAR, Orbit, ShownCoverage};
use crate::theme::{self, on_image};

/// Paints the 3-D scene; `plan` is the texture of the plan with its size in pixels, `coverage` the coverage
/// if it is shown.
pub fn paint(
    painter: &Painter,
    rect: Rect,
    (orbit, is_dark): (&Orbit, bool),
    (session, ellipses): (&Session, EllipseSize),
    plan: Option<(egui::TextureId, [u32; 2])>,
    coverage: Option<&ShownCoverage>,
) {
    if let Some((texture, size)) = plan {
        paint_plan(painter, rect, orbit, session, texture, size);
    }
    paint_ground(painter, rect, orbit, is_dark);
    if let Some(shown) = coverage {
        paint_coverage(painter, rect, orbit, (session, shown));
    }
    for mark in session.site.marks.iter().filter(|mark| !mark.off) {
        for part in mark.shape().polylines() {
            polyline(painter, rect, orbit, &part, Pen::new(on_image::WHITE, 1.75));
        }
    }
    for index in 0..session.site.cameras.len() {
        paint_camera(painter, rect, (orbit, is_dark), (session, ellipses), index);
    }
}

/// Paints the part of a polyline that is in front of the eye.
fn polyline(painter: &Painter, rect: Rect, orbit: &Orbit, points: &[WorldPoint], pen: Pen) {
    for pair in points.windows(2) {
        let Some([a, b]) = in_front(orbit.seen(pair[0]), orbit.seen(pair[1]), NEAR) else { continue };
        line(painter, &[Orbit::screen(rect, a), Orbit::screen(rect, b)], pen);
    }
}

/// Paints the grid of the floor.
fn paint_ground(painter: &Painter, rect: Rect, orbit: &Orbit, is_dark: bool) {
    /// Number of grid lines on each side of the middle.
    const LINES_PER_SIDE: i32 = 20;
    let step =
        [0.5, 1.0, 2.0, 5.0, 10.0, 50.0].into_iter().find(|s| s * 16.0 > orbit.distance).unwrap_or(100.0);
    let middle = [0, 1].map(|axis| (orbit.target[axis] / step).round() * step);
    let reach = step * f64::from(LINES_PER_SIDE);
    let faint = if is_dark { Color32::from_white_alpha(26) } else { Color32::from_black_alpha(30) };
    let pen = Pen::new(faint, 1.0).bare();
    for i in -LINES_PER_SIDE..=LINES_PER_SIDE {
        let off = step * f64::from(i);
        let (x, y) = (middle[0] + off, middle[1] + off);
        let lines = [
            [WorldPoint::new(x, middle[1] - reach, 0.0), WorldPoint::new(x, middle[1] + reach, 0.0)],
            [WorldPoint::new(middle[0] - reach, y, 0.0), WorldPoint::new(middle[0] + reach, y, 0.0)],
        ];
        for points in lines {
            polyline(painter, rect, orbit, &points, pen);
        }
    }
}

/// Paints the coloured floor of the coverage at the height of its targets, the walls, and the areas of interest.
fn paint_coverage(
    painter: &Painter,
    rect: Rect,
    orbit: &Orbit,
    (session, shown): (&Session, &ShownCoverage),
) {
    /// Opacity of the colours.
    const OPACITY: f32 = 0.5;
    /// Painted height of a wall whose height is unknown, in metres.
    const USUAL_WALL_HEIGHT: f64 = 2.5;
    let mut mesh = egui::Mesh::default();
    for rectangle in shown.result.iter().flat_map(|found| &found.rectangles) {
        let corners = rectangle.corners().map(|corner| orbit.project(rect, corner.at_height(shown.height)));
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { continue };
        let (base, fill) =
            (mesh.vertices.len() as u32, theme::colour(rectangle.value).gamma_multiply(OPACITY));
        [a, b, c, d].into_iter().for_each(|at| mesh.colored_vertex(at, fill));
        mesh.add_triangle(base, base + 1, base + 2);
        mesh.add_triangle(base, base + 2, base + 3);
    }
    painter.add(egui::Shape::mesh(mesh));
    for wall in &session.site.walls {
        let top = wall.height_m.unwrap_or(USUAL_WALL_HEIGHT);
        let [from, to] = [wall.from_m, wall.to_m];
        let outline = [from.at_height(0.0), to.at_height(0.0), to.at_height(top), from.at_height(top)];
        let closed: Vec<WorldPoint> = outline.into_iter().chain([outline[0]]).collect();
        polyline(painter, rect, orbit, &closed, Pen::new(on_image::WHITE, 1.5));
    }
    let zones = shown.result.as_ref().ok().map(|found| &found.hand_overs);
    let pointed = shown.pointed.zip(zones).and_then(|(index, zones)| zones.get(index));
    if let Some(at) = pointed.and_then(|zone| orbit.project(rect, zone.middle.at_height(shown.height))) {
        handle(painter, at, on_image::WAITING);
    }
    for area in &session.site.areas {
        let corners = area.polygon_m.iter().chain(area.polygon_m.first());
        let closed: Vec<WorldPoint> = corners.map(|corner| corner.at_height(0.0)).collect();
        polyline(painter, rect, orbit, &closed, Pen::new(on_image::WAITING, 2.0));
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
    /// Number of mesh cells along each side of the plan.
    const CELLS_PER_SIDE: u32 = 24;
    let scale = calib_editor::plan_scale(&session.site);
    let mut mesh = egui::Mesh::with_texture(texture);
    let mut seen = Vec::new();
    for row in 0..=CELLS_PER_SIDE {
        for column in 0..=CELLS_PER_SIDE {
            let (s, t) =
                (f64::from(column) / f64::from(CELLS_PER_SIDE), f64::from(row) / f64::from(CELLS_PER_SIDE));
            let at = calib_core::PlanPixel::new(s * f64::from(size[0]), t * f64::from(size[1]));
            let at = orbit.project(rect, scale.floor_from_plan(at).at_height(0.0));
            seen.push(at.is_some());
            let (pos, uv) = (at.unwrap_or(Pos2::ZERO), Pos2::new(s as f32, t as f32));
            mesh.vertices.push(egui::epaint::Vertex { pos, uv, color: Color32::from_white_alpha(150) });
        }
    }
    for row in 0..CELLS_PER_SIDE {
        for column in 0..CELLS_PER_SIDE {
            let i = row * (CELLS_PER_SIDE + 1) + column;
            let quad = [i, i + 1, i + CELLS_PER_SIDE + 1, i + CELLS_PER_SIDE + 2];
            if quad.iter().all(|&k| seen.get(k as usize) == Some(&true)) {
                mesh.add_triangle(quad[0], quad[1], quad[2]);
                mesh.add_triangle(quad[1], quad[3], quad[2]);
            }
        }
    }
    painter.add(egui::Shape::mesh(mesh));
}

fn paint_camera(
    painter: &Painter,
    rect: Rect,
    (orbit, is_dark): (&Orbit, bool),
    (session, ellipses): (&Session, EllipseSize),
    index: usize,
) {
    let (Some(entry), Some(pose), Some(solution)) =
        (session.site.cameras.get(index), session.solved.pose(index), session.solved.solution(index))
    else {
        return;
    };
    let is_own = index == session.camera;
    let colour = theme::camera(session.camera_slot(index));
    // In the light theme, outlines separate the camera colours from the background.
    let thin = |width: f32| {
        let pen = Pen::new(colour, width);
        if is_dark { pen.bare() } else { pen }
    };
    for (i, face) in prism(&solution.efov_m).iter().take(2).enumerate() {
        let pen = if i == 0 { Pen::new(colour, 2.0).dashed(&[10.0, 5.0]) } else { thin(1.25) };
        polyline(painter, rect, orbit, face, pen);
    }
    for edge in session.prism_edges(index) {
        polyline(painter, rect, orbit, &edge, thin(1.25));
    }
    // The length of the frustum is a quarter of the camera height, limited to 0.25 to 1.5 m.
    let depth = 0.25 * pose.position.z.abs().clamp(1.0, 6.0);
    let ends = frustum(entry, pose, depth);
    let pen = Pen::new(colour, if is_own { 2.5 } else { 1.5 });
    for (i, &end) in ends.iter().enumerate() {
        // Four lines connect the camera with the outline, also if the outline is a circle.
        if i % (ends.len() / 4).max(1) == 0 {
            polyline(painter, rect, orbit, &[pose.position, end], pen);
        }
        polyline(painter, rect, orbit, &[end, ends[(i + 1) % ends.len()]], pen);
    }
    let foot = pose.position.on_floor().at_height(0.0);
    polyline(painter, rect, orbit, &[pose.position, foot], thin(1.0).dashed(&[2.0, 4.0]));
    if let Some(mut outline) = position_ellipse(pose, ellipses.sigmas()) {
        outline.extend(outline.first().copied());
        let outline: Vec<WorldPoint> = outline.into_iter().map(|point| point.at_height(0.0)).collect();
        polyline(painter, rect, orbit, &outline, thin(1.25));
    }
    if let Some(at) = orbit.project(rect, pose.position) {
        handle(painter, at, Color32::WHITE);
        chip(painter, at - Vec2::new(0.0, 16.0), session.camera_slot(index));
        if is_own {
            tag(painter, at + Vec2::new(12.0, -16.0), Align2::LEFT_CENTER, &entry.id, on_image::WHITE);
        }
    }
}

/// Returns the outline of the image at a distance from the camera, in metres: its four corners. If the lens does not
/// map a corner, the outline is the rim of the image circle.
fn frustum(entry: &SiteCamera, pose: &Camera, distance: f64) -> Vec<WorldPoint> {
    /// Number of points on the rim of an image circle.
    const RIM_POINTS: u32 = 48;
    let end = |pixel: Pixel| {
        let [x, y, z] = pose.pixel_to_ray(pixel)?.direction.map(|d| distance * d);
        let WorldPoint { x: x0, y: y0, z: z0 } = pose.position;
        Some(WorldPoint::new(x0 + x, y0 + y, z0 + z))
    };
    let [w, h] = entry.size();
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|corner| end(corner.into()));
    if let [Some(a), Some(b), Some(c), Some(d)] = corners {
        return vec![a, b, c, d];
    }
    let Pixel { u, v } = pose.lens.principal_point;
    let inscribed = ImageCircle { u, v, radius: 0.5 * w.min(h) };
    let ImageCircle { u, v, radius } = entry.image_circle().unwrap_or(inscribed);
    let on_rim = |step: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / f64::from(RIM_POINTS)).sin_cos();
        // The lens may not map the rim; the search goes inwards to the first radius that it maps.
        (90..=99).rev().find_map(|share| {
            let radius = 0.01 * f64::from(share) * radius;
            end(Pixel::new(u + radius * cos, v + radius * sin))
        })
    };
    (0..RIM_POINTS).filter_map(on_rim).collect()
}

/// Returns the index of the camera nearest to a screen point of the 3-D scene; `None` if it is 24 points away or
/// farther.
#[must_use]
pub fn pick(rect: Rect, orbit: &Orbit, session: &Session, at: Pos2) -> Option<usize> {
    let shown = (0..session.site.cameras.len()).filter_map(|index| {
        let far = orbit.project(rect, session.solved.pose(index)?.position)?.distance(at);
        (far < 24.0).then_some((index, far))
    });
    shown.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}
