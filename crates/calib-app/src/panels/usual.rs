//! Things of a usual size, for who has measured nothing.

use calib_core::Annotation;

use calib_core::single::{Known, USUAL_SIZES, UsualSize};
use calib_editor::Units;
use egui::{RichText, Ui};

use crate::theme;

/// What is chosen in the menu.
pub(crate) enum Chosen {
    Like(&'static UsualSize),
    /// The size that it has, as if it was measured.
    Measured(Known),
}

/// The menu of things that an annotation may be like.
pub(crate) fn menu(ui: &mut Ui, units: Units, annotation: &Annotation) -> Option<Chosen> {
    let palette = theme::palette(ui.ctx());
    let constraint = annotation.kind.row().constraint;
    let own = annotation.usual();
    let title = own.map_or("like\u{2026}".to_owned(), |usual| format!("like {}", size(units, usual)));
    let mut chosen = None;
    ui.menu_button(RichText::new(title).small().color(palette.text2), |ui| {
        for usual in USUAL_SIZES.iter().filter(|usual| usual.constraint == constraint) {
            let text = format!("{}: {}", usual.title, size(units, usual));
            if ui.selectable_label(own == Some(usual), text).on_hover_text(usual.source).clicked() {
                chosen = Some(Chosen::Like(usual));
                ui.close();
            }
        }
        if let Some(usual) = own
            && ui.button("Measured").clicked()
        {
            chosen = Some(Chosen::Measured(usual.size));
            ui.close();
        }
    })
    .response
    .on_hover_text("A thing whose size is known about");
    chosen
}

fn size(units: Units, usual: &UsualSize) -> String {
    units.small_and_sigma(usual.size.value, usual.size.sigma.unwrap_or(0.0))
}
