//! What is shown while nothing is open.

use egui::{Align, Button, Layout, RichText, Role, ScrollArea, Stroke, Ui, Vec2, WidgetInfo};

use crate::command::Command;
use crate::shelf::{Entry, Shelf};
use crate::state::App;
use crate::theme;

/// The start page.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let mut chosen = None;
    let mut recover = None;
    ui.vertical_centered(|ui| {
        ui.set_max_width(ui.available_width().min(720.0) - 24.0);
        ui.add_space((0.5 * ui.available_height() - 190.0).max(12.0));
        ui.label(RichText::new("Calibrate cameras from their still images").font(theme::medium(22.0)));
        ui.add_space(4.0);
        let what = "Draw lines that are plumb, parallel or square; place each camera on the plan; check in every view.";
        ui.label(RichText::new(what).color(palette.text2));
        ui.add_space(20.0);
        recover = found(app, ui);
        for (text, command) in [
            ("Open the demonstration site", Command::Demo),
            ("Take the tour: five steps, ten minutes", Command::Tour),
            ("Open a site\u{2026}", Command::Open),
            ("Add images\u{2026}", Command::AddImages),
        ] {
            let is_first = command == Command::Demo;
            let fill = if is_first { palette.accent } else { palette.raised };
            let colour = if is_first { palette.bg } else { palette.text };
            let label = RichText::new(text).font(theme::medium(13.0)).color(colour);
            if ui.add(Button::new(label).fill(fill).min_size(Vec2::new(320.0, 40.0))).clicked() {
                chosen = Some(command);
            }
            ui.add_space(4.0);
        }
        kept(app, ui);
        ui.add_space(12.0);
        ui.label(RichText::new("Or drop images, a folder, or a site file here.").color(palette.text3));
        ui.label(RichText::new("Images never leave this machine.").color(palette.text3));
        if let Some(error) = app.editor.error() {
            ui.add_space(12.0);
            ui.label(RichText::new(error).color(palette.bad));
        }
    });
    if let Some((index, goes_on)) = recover {
        app.decide(index, goes_on);
    }
    if let Some(command) = chosen {
        app.tell(command);
    }
}

/// Work that a crash left behind: which was chosen, and whether to go on with it.
fn found(app: &App, ui: &mut Ui) -> Option<(usize, bool)> {
    let palette = theme::palette(ui.ctx());
    let mut recover = None;
    for (index, (_, found)) in app.found.iter().enumerate() {
        let count = found.site.cameras.len();
        let file = found.path.as_deref().map_or_else(|| "a new site".into(), |p| p.display().to_string());
        egui::Frame::NONE.fill(palette.accent_bg).corner_radius(8).inner_margin(16).show(ui, |ui| {
            ui.set_max_width(400.0);
            ui.label(RichText::new("Work that was not saved").font(theme::medium(13.0)));
            ui.label(RichText::new(format!("{count} cameras, {file}")).color(palette.text2));
            ui.horizontal(|ui| {
                if ui.button("Go on with it").clicked() {
                    recover = Some((index, true));
                }
                if ui.button("Discard").clicked() {
                    recover = Some((index, false));
                }
            });
        });
        ui.add_space(12.0);
    }
    recover
}

/// The sites that the shelf keeps, each a row.
fn kept(app: &mut App, ui: &mut Ui) {
    let entries = app.shelf.as_ref().map(|shelf| shelf.entries()).unwrap_or_default();
    let Some(shelf) = app.shelf.as_mut().filter(|_| !entries.is_empty()) else { return };
    let palette = theme::palette(ui.ctx());
    ui.add_space(12.0);
    let width = ui.available_width().min(560.0);
    ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
        let bytes: u64 = entries.iter().map(|entry| entry.bytes).sum();
        super::heading(
            ui,
            "Recent sites in this browser",
            &format!("{} sites, {}", entries.len(), size(bytes)),
        );
        ScrollArea::vertical().max_height(160.0).show(ui, |ui| {
            for entry in &entries {
                ui.horizontal(|ui| {
                    row(shelf.as_mut(), ui, entry);
                });
                let rect = ui.min_rect();
                ui.painter().hline(rect.x_range(), rect.bottom(), Stroke::new(1.0, palette.line));
            }
        });
    });
}

fn row(shelf: &mut dyn Shelf, ui: &mut Ui, entry: &Entry) {
    let palette = theme::palette(ui.ctx());
    let name = if entry.name.is_empty() { "Unnamed site" } else { &entry.name };
    let open =
        ui.add(Button::new(RichText::new(name).font(theme::medium(12.0))).min_size(Vec2::new(120.0, 28.0)));
    open.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Go on with {name}")));
    if open.on_hover_text(format!("Last: {}", entry.last)).clicked() {
        shelf.open(&entry.id);
    }
    let words = format!("{} cameras, {}, {}", entry.cameras, entry.when, size(entry.bytes));
    ui.label(RichText::new(words).color(palette.text2));
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        // What is removed is gone: the second press means it.
        let id = ui.scope_id().with(("remove", &entry.id));
        let armed = ui.data(|data| data.get_temp(id).unwrap_or(false));
        let text =
            if armed { RichText::new("Remove for good").color(palette.bad) } else { RichText::new("Remove") };
        let button = ui.button(text);
        button.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Remove {name}")));
        if button.clicked() && armed {
            shelf.remove(&entry.id);
        } else if button.clicked() {
            ui.data_mut(|data| data.insert_temp(id, true));
        }
    });
}

/// Bytes for the eye.
fn size(bytes: u64) -> String {
    match bytes as f64 {
        few if few < 1e5 => "under 0.1 MB".into(),
        bytes => format!("{:.1} MB", bytes / 1e6),
    }
}
