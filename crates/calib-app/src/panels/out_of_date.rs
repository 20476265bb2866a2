//! A joint solution that no longer follows from the site says so, with the way out.

use egui::{Frame, Margin, RichText, Ui};

use crate::command::Command;
use crate::state::App;
use crate::theme;

/// The part, while what was solved together is out of date.
pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    if !app.editor.session().solved.is_joint_out_of_date() || !app.editor.tool().is_idle() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let mut again = false;
    Frame::NONE.fill(palette.warn_bg).inner_margin(Margin::symmetric(12, 8)).show(ui, |ui| {
        ui.set_width(ui.available_width());
        let what = "Refined together, out of date: what it follows from was changed.";
        ui.label(RichText::new(what).color(palette.warn));
        again = ui.button("Refine again").clicked();
    });
    if again {
        app.tell(Command::Refine);
    }
}
