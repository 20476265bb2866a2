//! How the camera in hand agrees with the others about the floor, pair by pair.

use calib_editor::{Action, Agreement, Part, TOOLS, agreements, lines_off};
use calib_site::{LinkKind, counted};
use egui::{Align2, RichText, Role, Sense, Ui, Vec2, WidgetInfo};

use crate::command::Command;
use crate::icons::{self, Icon};
use crate::paint::chip;
use crate::state::App;
use crate::theme;
use crate::widgets::heading;

/// Where columns end, from the right edge, in points.
const APART: f32 = 0.0;
const OVERLAP: f32 = 132.0;

/// The part of the panel.
pub fn agreement_ui(app: &mut App, ui: &mut Ui) {
    let session = app.editor.session();
    let before = app.editor.poses_before(app.view.show_before);
    let all = agreements(session, session.camera, &before);
    heading(ui, "Agreement", "");
    let lines = lines_off(session, session.camera);
    if all.is_empty() && lines.is_none() {
        let text = "No other camera on the plan shares floor or links with this one.";
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
    let is_far = |found: &&Agreement| found.apart.is_some_and(|apart| apart.is_far());
    let metres = |found: &&Agreement| found.apart.map_or(0.0, |apart| apart.metres);
    if let Some(worst) = all.iter().filter(is_far).max_by(|a, b| metres(a).total_cmp(&metres(b))) {
        warn(app, ui, worst);
    } else if all.iter().all(|found| found.apart.is_none()) {
        let text = "K links a corner that two views show: then this says how far they are apart.";
        ui.label(RichText::new(text).small().color(theme::palette(ui.ctx()).text3));
    }
}

fn titles(ui: &mut Ui) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 16.0), Sense::hover());
    for (text, column) in [("overlap", OVERLAP), ("apart", APART)] {
        let at = rect.right_center() - Vec2::new(column, 0.0);
        let colour = theme::palette(ui.ctx()).text3;
        ui.painter().text(at, Align2::RIGHT_CENTER, text, theme::regular(11.0), colour);
    }
}

fn row(app: &App, ui: &mut Ui, found: &Agreement) {
    let palette = theme::palette(ui.ctx());
    let session = app.editor.session();
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 20.0), Sense::hover());
    let id = &session.site.cameras[found.with].id;
    let overlap = format!("{:.0} %", 100.0 * found.overlap);
    let units = session.units;
    let now = found.apart.map_or_else(|| "no link".into(), |apart| units.small(apart.metres));
    // What was not moved has no before.
    let was = found.before.map(|before| units.small(before)).filter(|was| *was != now);
    let apart = was.map_or_else(|| now.clone(), |was| format!("{was} \u{2192} {now}"));
    let colour = match found.apart {
        Some(apart) if apart.is_far() => palette.warn,
        Some(_) => palette.text,
        None => palette.text3,
    };
    let words = format!("{id} overlap {overlap}, apart {apart}");
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, &words));
    let sigma = found.apart.and_then(|apart| apart.sigma);
    if let Some(sigma) = sigma {
        response.on_hover_text(format!("\u{b1} {} by their own uncertainty", units.small(sigma)));
    }
    let name = ui.painter().with_clip_rect(rect.with_max_x(rect.right() - OVERLAP - 36.0));
    chip(&name, rect.left_center() + Vec2::new(8.0, 0.0), found.with);
    let at = rect.left_center() + Vec2::new(22.0, 0.0);
    name.text(at, Align2::LEFT_CENTER, id, theme::regular(12.0), palette.text2);
    for (text, column, colour) in [(overlap, OVERLAP, palette.text2), (apart, APART, colour)] {
        let at = rect.right_center() - Vec2::new(column, 0.0);
        ui.painter().text(at, Align2::RIGHT_CENTER, text, theme::regular(12.0), colour);
    }
}

/// How far lines of the floor are in the image from where the others put them on the plan.
fn lines_row(app: &App, ui: &mut Ui, px: f64, count: usize) {
    let palette = theme::palette(ui.ctx());
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 20.0), Sense::hover());
    let text = format!("{px:.1} px");
    let of = counted(count, "floor line", "floor lines");
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, format!("{of} {text} off")));
    response.on_hover_text("From where the other cameras put them, root mean square in this image");
    let sigma = app.editor.session().entry().and_then(|entry| entry.sigma_px).unwrap_or(1.0);
    let colour = theme::residual(palette, px / sigma);
    for (at, align, text, colour) in [
        (rect.left_center(), Align2::LEFT_CENTER, of, palette.text2),
        (rect.right_center(), Align2::RIGHT_CENTER, text, colour),
    ] {
        ui.painter().text(at, align, text, theme::regular(12.0), colour);
    }
}

/// What to do about two cameras that disagree by more than chance explains.
fn warn(app: &mut App, ui: &mut Ui, worst: &Agreement) {
    let palette = theme::palette(ui.ctx());
    let session = app.editor.session();
    let id = session.site.cameras[worst.with].id.clone();
    let apart = worst.apart.map_or_else(String::new, |apart| session.units.small(apart.metres));
    let (mut shows, mut links) = (false, false);
    ui.add_space(4.0);
    egui::Frame::NONE.fill(palette.warn_bg).corner_radius(4).inner_margin(8).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.horizontal_top(|ui| {
            icons::inline(ui, Icon::Warn, palette.warn);
            ui.vertical(|ui| {
                ui.label(RichText::new(format!("{id} is {apart} apart")).font(theme::medium(12.0)));
                let way = "More than their own uncertainty explains: move one of the two, or link one more corner that both see.";
                ui.label(RichText::new(way).color(palette.text2));
                ui.horizontal(|ui| {
                    shows = ui.button("Show").clicked();
                    links = ui.button("Link   K").clicked();
                });
            });
        });
    });
    if shows {
        show_farthest(app, worst.with);
    }
    if links && let Some(row) = TOOLS.iter().position(|tool| tool.title == "Link") {
        app.tell(Command::ViewAll);
        app.send(Action::TakeTool(row));
    }
}

/// Selects the link that two cameras put farthest apart, where both are seen.
fn show_farthest(app: &mut App, with: usize) {
    let session = app.editor.session();
    let ids = [session.camera, with].map(|camera| &session.site.cameras[camera].id);
    let is_shared = |link: &calib_site::Link| {
        !link.off
            && link.kind == LinkKind::Point
            && ids.iter().all(|id| link.seen.iter().any(|seen| seen.camera == **id))
    };
    let shared = session.site.links.iter().enumerate().filter(|(_, link)| is_shared(link));
    let metres = |link| calib_editor::apart(session, link).map_or(0.0, |apart| apart.metres);
    let farthest = shared.max_by(|a, b| metres(a.1).total_cmp(&metres(b.1)));
    let part = farthest.and_then(|(link, entry)| {
        let seen = entry.seen.iter().position(|seen| seen.camera == *ids[0])?;
        Some(Part::Link { link, seen, point: 0 })
    });
    let camera = session.camera;
    app.send(Action::Drop);
    app.tell(Command::ViewAll);
    if let Some(part) = part {
        app.send(Action::SelectOn(camera, part));
    }
}
