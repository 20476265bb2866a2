//! On which plane what is selected lies.

use calib_editor::Action;
use calib_editor::planes::{Planes, planes_under};
use egui::{ComboBox, RichText, Ui};

use crate::state::App;
use crate::theme;

/// The choice, where there are planes and something is selected that can lie on one.
pub fn show(app: &mut App, ui: &mut Ui) {
    let session = app.editor.session();
    let under = planes_under(&session.site, session.camera, &session.selection);
    if session.site.planes.is_empty() || under.is_empty() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let ids: Vec<Option<String>> =
        std::iter::once(None).chain(session.site.planes.iter().map(|plane| Some(plane.id.clone()))).collect();
    let title = |plane: &Option<String>| plane.clone().unwrap_or_else(|| "Floor".into());
    let now = match under.iter().collect::<Vec<_>>()[..] {
        [one] => title(one),
        _ => "several".into(),
    };
    let mut chosen = None;
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Lies on").color(palette.text2));
        ComboBox::from_id_salt("lies on")
            .selected_text(now)
            .show_ui(ui, |ui| {
                for id in ids {
                    let is_own = under.len() == 1 && under.contains(&id);
                    if ui.selectable_label(is_own, title(&id)).clicked() && !is_own {
                        chosen = Some(id);
                    }
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text(session.selection_name());
    });
    chosen.into_iter().for_each(|plane| app.send(Action::Planes(Planes::Lay(plane))));
}
