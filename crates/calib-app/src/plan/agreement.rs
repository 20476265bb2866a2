//! Panel: agreement of the current camera with every other camera on the floor.

use calib_editor::{Action, Agreement, Part, TOOLS, agreements, line_distance_rms};
use calib_site::{LinkKind, counted};
use egui::{Align2, RichText, Role, Sense, Ui, Vec2, WidgetInfo};

use crate::command::Command;
use crate::icons::{self, Icon};
use crate::keys;
use crate::paint::chip;
use crate::state::App;
use crate::theme;
use crate::widgets::heading;

/// Distance of the column "gap" from the right border, in points.
const APART_FROM_RIGHT: f32 = 0.0;
/// Distance of the column "overlap" from the right border, in points.
const OVERLAP_FROM_RIGHT: f32 = 132.0;

/// Shows the panel of agreement between cameras.
pub fn agreement_ui(app: &mut App, ui: &mut Ui) {
    let session = app.editor.session();
    let before = app.editor.ghost_poses(app.view.show_before);
    let all = agreements(session, session.camera, &before);
    heading(ui, "Agreement", "");
    let lines = line_distance_rms(session, session.camera);
    if all.is_empty() && lines.is_none() {
        let text = "No other camera on the plan shares floor area or links with this one.";
        ui.label(RichText::new(text).color(theme::palette(ui.ctx()).text2));
        return;
    }
    if !all.is_empty() {
        titles(ui);
    }
    for agreement in &all {
        row(app, ui, agreement);
    }
    if let Some((px, count)) = lines {
        lines_row(app, ui, px, count);
    }
    let is_far = |found: &&Agreement| found.distance.is_some_and(|apart| apart.is_significant());
    let metres = |found: &&Agreement| found.distance.map_or(0.0, |apart| apart.metres);
    if let Some(worst) = all.iter().filter(is_far).max_by(|a, b| metres(a).total_cmp(&metres(b))) {
        disagreement_ui(app, ui, worst);
    } else if all.iter().all(|found| found.distance.is_none()) {
        let text = "Press K and click the same corner in two views to measure their agreement.";
        ui.label(RichText::new(text).small().color(theme::palette(ui.ctx()).text3));
    }
}

fn titles(ui: &mut Ui) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 16.0), Sense::hover());
    for (text, column) in [("overlap", OVERLAP_FROM_RIGHT), ("gap", APART_FROM_RIGHT)] {
        let at = rect.right_center() - Vec2::new(column, 0.0);
        let colour = theme::palette(ui.ctx()).text3;
        ui.painter().text(at, Align2::RIGHT_CENTER, text, theme::regular(11.0), colour);
    }
}

/// Shows overlap and disagreement of the current camera with one other camera.
fn row(app: &App, ui: &mut Ui, found: &Agreement) {
    let palette = theme::palette(ui.ctx());
    let session = app.editor.session();
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 20.0), Sense::hover());
    let id = &session.site.cameras[found.other].id;
    let overlap = format!("{:.0} %", 100.0 * found.overlap);
    let units = session.site.units;
    let now = found.distance.map_or_else(|| "no link".into(), |apart| units.short_length(apart.metres));
    // A camera that was not moved has no earlier value.
    let was = found.distance_before_m.map(|before| units.short_length(before)).filter(|was| *was != now);
    let apart = was.map_or_else(|| now.clone(), |was| format!("{was} \u{2192} {now}"));
    let colour = match found.distance {
        Some(apart) if apart.is_significant() => palette.warn,
        Some(_) => palette.text,
        None => palette.text3,
    };
    let words = format!("{id}: overlap {overlap}, gap {apart}");
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, &words));
    let sigma = found.distance.and_then(|apart| apart.sigma);
    if let Some(sigma) = sigma {
        response.on_hover_text(format!(
            "\u{b1} {} due to the uncertainty of both cameras",
            units.short_length(sigma)
        ));
    }
    let name = ui.painter().with_clip_rect(rect.with_max_x(rect.right() - OVERLAP_FROM_RIGHT - 36.0));
    chip(&name, rect.left_center() + Vec2::new(8.0, 0.0), session.camera_slot(found.other));
    let at = rect.left_center() + Vec2::new(22.0, 0.0);
    name.text(at, Align2::LEFT_CENTER, id, theme::regular(12.0), palette.text2);
    for (text, column, colour) in
        [(overlap, OVERLAP_FROM_RIGHT, palette.text2), (apart, APART_FROM_RIGHT, colour)]
    {
        let at = rect.right_center() - Vec2::new(column, 0.0);
        ui.painter().text(at, Align2::RIGHT_CENTER, text, theme::regular(12.0), colour);
    }
}

/// Shows the RMS distance, in pixels, between the floor lines of this camera and their positions from the other
/// cameras. `count` is the number of lines.
fn lines_row(app: &App, ui: &mut Ui, px: f64, count: usize) {
    let palette = theme::palette(ui.ctx());
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 20.0), Sense::hover());
    let text = format!("{px:.1} px");
    let of = counted(count, "floor line", "floor lines");
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, format!("{of} {text} off")));
    response.on_hover_text(
        "RMS distance in this image between the lines and their positions according to the other cameras",
    );
    let sigma = app.editor.session().entry().and_then(|entry| entry.sigma_px).unwrap_or(1.0);
    let colour = theme::residual(palette, px / sigma);
    for (at, align, text, colour) in [
        (rect.left_center(), Align2::LEFT_CENTER, of, palette.text2),
        (rect.right_center(), Align2::RIGHT_CENTER, text, colour),
    ] {
        ui.painter().text(at, align, text, theme::regular(12.0), colour);
    }
}

/// Shows advice for two cameras whose disagreement is larger than their uncertainty explains.
fn disagreement_ui(app: &mut App, ui: &mut Ui, worst: &Agreement) {
    let palette = theme::palette(ui.ctx());
    let session = app.editor.session();
    let id = session.site.cameras[worst.other].id.clone();
    let apart =
        worst.distance.map_or_else(String::new, |apart| session.site.units.short_length(apart.metres));
    let (mut shows, mut links) = (false, false);
    ui.add_space(4.0);
    egui::Frame::NONE.fill(palette.warn_bg).corner_radius(4).inner_margin(8).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.horizontal_top(|ui| {
            icons::inline(ui, Icon::Warn, palette.warn);
            ui.vertical(|ui| {
                ui.label(RichText::new(format!("{id} disagrees by {apart}")).font(theme::medium(12.0)));
                let way = "The difference is larger than the uncertainty of the cameras. Move one of them on the plan, \
                           or link another corner that both see.";
                ui.label(RichText::new(way).color(palette.text2));
                ui.horizontal(|ui| {
                    shows = ui.button("Show").on_hover_text("Select the link with the largest gap").clicked();
                    let button = ui.button(keys::shown(ui.ctx(), "Link   K"));
                    links = button.on_hover_text("Link a point that both cameras see").clicked();
                });
            });
        });
    });
    if shows {
        select_worst_link(app, worst.other);
    }
    if links && let Some(row) = TOOLS.iter().position(|tool| tool.title == "Link") {
        app.send_command(Command::ViewAll);
        app.send(Action::SelectTool(row));
    }
}

/// Selects the link with the largest gap on the floor between the current camera and the camera `with`.
fn select_worst_link(app: &mut App, with: usize) {
    let session = app.editor.session();
    let ids = [session.camera, with].map(|camera| &session.site.cameras[camera].id);
    let is_shared = |link: &calib_site::Link| {
        !link.off
            && link.kind == LinkKind::Point
            && ids.iter().all(|id| link.seen.iter().any(|seen| seen.camera == **id))
    };
    let shared = session.site.links.iter().enumerate().filter(|(_, link)| is_shared(link));
    let metres = |link| calib_editor::link_distance(session, link).map_or(0.0, |apart| apart.metres);
    let farthest = shared.max_by(|a, b| metres(a.1).total_cmp(&metres(b.1)));
    let part = farthest.and_then(|(link, entry)| {
        let seen = entry.seen.iter().position(|seen| seen.camera == *ids[0])?;
        Some(Part::Link { link, seen, point: 0 })
    });
    let camera = session.camera;
    app.send(Action::CancelGesture);
    app.send_command(Command::ViewAll);
    if let Some(part) = part {
        app.send(Action::SelectOn(camera, part));
    }
}
