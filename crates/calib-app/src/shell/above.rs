//! Floor view of one camera: its image projected onto the floor, seen from above with the camera facing up.

use calib_core::{Camera, FloorPoint, Plane};

use calib_core::floor::ellipse;

use calib_editor::{Units, corners_of};
use calib_site::SiteCamera;
use egui::{Align2, Color32, Painter, Rect, Role, Sense, Ui, Vec2, WidgetInfo};

use crate::canvas::{Mapping, View};
use crate::command::Command;
use crate::icons::{self, Icon, Look};
use crate::keys;
use crate::paint::{Pen, line};
use crate::picture::Picture;
use crate::plan::floor::paint_grid;
use crate::plan::mesh::paint_projected;
use crate::state::{App, EllipseSize};
use crate::theme;

/// Height of the floor view, in points.
pub const HEIGHT: f32 = 220.0;

/// Shows the floor view of the current camera below the camera list.
pub fn above_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let mut hide = false;
    ui.horizontal(|ui| {
        ui.add_space(10.0);
        ui.label(egui::RichText::new("Top view").font(theme::medium(12.0)));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let look = Look { size: Vec2::splat(20.0), ..Look::default() };
            hide =
                icons::button(ui, Icon::Close, "Hide the top view", &keys::shown(ui.ctx(), "Hide (Y)"), look)
                    .clicked();
        });
    });
    let rect = ui.available_rect_before_wrap().with_max_y(ui.max_rect().bottom() - 20.0);
    let response = ui.allocate_rect(rect, Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Top view"));
    let painter = ui.painter().with_clip_rect(rect.intersect(ui.clip_rect()));
    painter.rect_filled(rect, 0.0, theme::DARK.canvas);
    let below = egui::pos2(rect.left() + 10.0, rect.bottom() + 10.0);
    let words = |text: String| {
        ui.painter().text(below, Align2::LEFT_CENTER, text, theme::regular(11.0), palette.text3);
    };
    match (app.editor.session().entry(), app.editor.session().pose()) {
        (Some(entry), Some(pose)) => {
            let picture = entry.image.as_ref().and_then(|name| app.pictures.ready(name));
            let units = app.editor.session().site.units;
            let ellipses = app.ellipse_size();
            let step = paint(&painter, rect, entry, pose, picture, (units, ellipses));
            let step = units.length(step, 0);
            let is_scaled = app.editor.session().solved.scale_is_known(app.editor.session().camera);
            let assumed = if is_scaled { "" } else { " (scale assumed)" };
            words(format!("{step} grid{assumed}. {}", ellipses.label()));
        }
        _ => words("Draw lines first".into()),
    }
    if hide {
        app.send_command(Command::Above);
    }
}

/// Returns the pose moved to x = y = 0 with yaw 0. The camera then faces up, and left and right are as in the
/// image.
fn facing_up(pose: &Camera) -> Camera {
    let mut camera = *pose;
    (camera.position.x, camera.position.y, camera.yaw) = (0.0, 0.0, 0.0);
    camera
}

/// Returns the points of a circle on the floor, around the foot of a camera, that are visible in its image.
fn visible_circle(camera: &Camera, [w, h]: [f64; 2]) -> Vec<FloorPoint> {
    /// Radius of the circle, in camera heights.
    const RADIUS_IN_HEIGHTS: f64 = 4.0;
    /// Number of points on the complete circle.
    const CIRCLE_POINTS: u32 = 48;
    let radius = RADIUS_IN_HEIGHTS * camera.position.z.abs();
    let is_seen = |at: &FloorPoint| {
        let shown = camera.world_to_pixel(at.at_height(0.0));
        shown.is_some_and(|at| (0.0..=w).contains(&at.u) && (0.0..=h).contains(&at.v))
    };
    let at = |index: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(index) / f64::from(CIRCLE_POINTS)).sin_cos();
        FloorPoint::new(radius * cos, radius * sin)
    };
    (0..CIRCLE_POINTS).map(at).filter(is_seen).collect()
}

/// Paints the floor view of a camera into a rectangle; returns the grid step, in metres.
pub fn paint(
    painter: &Painter,
    rect: Rect,
    entry: &SiteCamera,
    pose: &Camera,
    picture: Option<&Picture>,
    (units, ellipses): (Units, EllipseSize),
) -> f64 {
    /// Largest distance of floor points that are shown, in camera heights. Beyond it, the projected image is too
    /// blurred.
    const MAX_DISTANCE_IN_HEIGHTS: f64 = 12.0;
    let camera = facing_up(pose);
    let near =
        |at: &FloorPoint| at.x.hypot(at.y) < MAX_DISTANCE_IN_HEIGHTS * camera.position.z.abs().max(0.1);
    let on_floor = |pixel| camera.pixel_to_floor(pixel, 0.0);
    let corners = corners_of(entry);
    let field: Vec<FloorPoint> = corners.iter().filter_map(|&pixel| on_floor(pixel)).filter(near).collect();
    // The corners of a fisheye image are black.
    let field = if field.len() < 3 { visible_circle(&camera, entry.size()) } else { field };
    let range = |of: fn(&FloorPoint) -> f64| {
        let values = || field.iter().map(of);
        [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]
    };
    let ([x0, x1], [y0, y1]) = (range(|p| p.x), range(|p| p.y));
    if field.len() < 3 || !(x0 < x1 && y0 < y1) {
        return units.metres();
    }
    let mapping = Mapping::new(View::of([x0, y0], [x1, y1], rect.shrink(8.0), true, false), rect);
    let step = units.step(1.0 / mapping.view.zoom, 1.0 / 12.0).max(units.metres());
    if let Some(picture) = picture {
        let on = (&camera, &Plane::FLOOR);
        paint_projected(painter, &mapping, picture, on, &field, entry.size(), Color32::WHITE);
    }
    paint_grid(painter, &mapping, step, Color32::from_white_alpha(60));
    let path = |points: &[FloorPoint]| -> Vec<egui::Pos2> {
        points.iter().map(|&point| mapping.screen(point.into())).collect()
    };
    let mut outline = field.clone();
    outline.extend(field.first().copied());
    line(painter, &path(&outline), Pen::new(Color32::WHITE, 1.25).dashed(&[5.0, 4.0]).faint());
    for drawn in entry.annotations.iter().filter(|drawn| drawn.kind.row().is_level() && !drawn.off) {
        for pixels in drawn.polylines() {
            let points: Vec<FloorPoint> = pixels.iter().filter_map(|&pixel| on_floor(pixel)).collect();
            line(painter, &path(&points), Pen::new(theme::kind(drawn.kind), 1.75));
        }
    }
    for &corner in &corners {
        let known = camera.floor_covariance(corner, 1.0).and_then(|covariance| covariance.calibration);
        let (Some(at), Some(known)) = (on_floor(corner), known) else {
            continue;
        };
        // A very large ellipse would cover the whole view.
        let is_small = |outline: &Vec<FloorPoint>| {
            outline
                .iter()
                .all(|point| mapping.view.zoom * point.distance(at) < 0.25 * f64::from(rect.width()))
        };
        let outline = ellipse(at, &known, ellipses.sigmas()).filter(is_small);
        if let Some(mut outline) = outline.filter(|_| near(&at)) {
            outline.extend(outline.first().copied());
            line(painter, &path(&outline), Pen::new(Color32::WHITE, 1.0).faint());
        }
    }
    step
}
