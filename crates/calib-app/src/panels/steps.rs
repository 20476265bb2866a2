//! The steps of the camera in hand, and what each still needs.

use calib_editor::steps::{bent_px, steps};
use egui::{RichText, Ui};

use crate::command::Command;
use crate::icons::{self, Icon};
use crate::panels::{heading, lens};
use crate::state::App;
use crate::theme;

/// The panel.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let session = app.editor.session();
    let id = session.entry().map_or_else(String::new, |entry| entry.id.clone());
    heading(ui, "Steps", &id);
    let list = steps(session, session.camera);
    let first = list.iter().position(|step| !step.is_done && !step.is_optional);
    let bent = bent_px(session, session.camera).is_some();
    for (i, step) in list.into_iter().enumerate() {
        let is_next = first == Some(i);
        let (icon, colour) = match (step.is_done, is_next) {
            (true, _) if step.is_doubted => (Icon::Warn, palette.bad),
            (true, _) => (Icon::Check, palette.ok),
            (false, true) => (Icon::Chevron, palette.accent),
            (false, false) => (Icon::Open, palette.text3),
        };
        ui.horizontal(|ui| {
            icons::inline(ui, icon, colour);
            let title = RichText::new(step.title);
            ui.label(if is_next { title.font(theme::medium(12.0)) } else { title });
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.add(egui::Label::new(RichText::new(step.state).color(palette.text2)).truncate());
            });
        });
    }
    let is_blank = app
        .editor
        .session()
        .entry()
        .is_some_and(|entry| entry.image.is_some() && entry.annotations.is_empty());
    let waits = app.proposing.is_none() && app.editor.session().proposed().is_none();
    if is_blank
        && waits
        && ui.button("Propose lines   Shift+P").on_hover_text("From the edges of the image").clicked()
    {
        app.tell(Command::Propose);
    }
    if bent && ui.button("Fit k1, k2").on_hover_text("Fit the lens to the straight edges").clicked() {
        lens::fit(app);
    }
}
