//! What is shown while nothing is open.

use egui::{RichText, Ui, Vec2};

use crate::app::App;
use crate::command::{self, Command};
use crate::theme;

/// The start page.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let mut chosen = None;
    let mut recover = None;
    ui.vertical_centered(|ui| {
        ui.add_space((0.5 * ui.available_height() - 190.0).max(12.0));
        ui.label(RichText::new("Calibrate cameras from their still images").font(theme::medium(22.0)));
        ui.add_space(4.0);
        let what = "Draw lines that are plumb, parallel or square; place each camera on the plan; check in every view.";
        ui.label(RichText::new(what).color(palette.text2));
        ui.add_space(20.0);
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
            if ui.add(egui::Button::new(label).fill(fill).min_size(Vec2::new(320.0, 40.0))).clicked() {
                chosen = Some(command);
            }
            ui.add_space(4.0);
        }
        ui.add_space(12.0);
        ui.label(RichText::new("Or drop images, a folder, or a site file here.").color(palette.text3));
        ui.label(RichText::new("Images never leave this machine.").color(palette.text3));
        if let Some(error) = &app.error {
            ui.add_space(12.0);
            ui.label(RichText::new(error).color(palette.bad));
        }
    });
    match recover {
        Some((index, true)) => app.recover(index),
        Some((index, false)) => app.discard_found(index),
        None => {}
    }
    if let Some(command) = chosen {
        let ctx = ui.ctx().clone();
        command::run(app, &ctx, command, egui::Modifiers::NONE);
    }
}
