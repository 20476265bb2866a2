//! Distances that were measured: they give the scale where no plan does.

use calib_core::single::Known;

use calib_editor::{Action, places};
use calib_site::Distance;
use egui::{ComboBox, RichText, Ui, Vec2};

use crate::icons::{self, Icon, Look};
use crate::panels::heading;
use crate::panels::measured::{TAPE, empty_field, known_fields};
use crate::state::App;
use crate::theme;

/// The panel.
pub fn show(app: &mut App, ui: &mut Ui) {
    heading(ui, "Distances", "measured");
    let mut list = app.editor.session().site.distances.clone();
    list_fields(app, ui, &mut list);
    let links = app.editor.session().site.links.iter().filter_map(|link| link.id.clone());
    let marks = app.editor.session().site.marks.iter().filter_map(|mark| mark.id.clone());
    let ids: Vec<String> = links.chain(marks).collect();
    if ids.len() >= 2 {
        ui.horizontal(|ui| list.extend(entered(app, ui, &ids)));
    } else {
        let palette = theme::palette(ui.ctx());
        ui.label(RichText::new("Needs two links or marks.").color(palette.text2));
    }
    if list != app.editor.session().site.distances {
        app.send(Action::SetDistances(list));
    }
}

fn list_fields(app: &App, ui: &mut Ui, list: &mut Vec<Distance>) {
    let mut removed = None;
    for (index, distance) in list.iter_mut().enumerate() {
        ui.horizontal(|ui| {
            let label = ui.label(format!("{} to {}", distance.between[0], distance.between[1]));
            known_fields(ui, label.id, app.editor.session().units, &mut distance.length_m);
            let look = Look { size: Vec2::splat(18.0), ..Look::default() };
            if icons::button(ui, Icon::Close, &format!("Remove distance {}", index + 1), "", look).clicked() {
                removed = Some(index);
            }
        });
    }
    if let Some(index) = removed {
        list.remove(index);
    }
}

/// Two ids to choose, and a field for what was measured between them; the distance, once it was entered.
fn entered(app: &mut App, ui: &mut Ui, ids: &[String]) -> Option<Distance> {
    let [a, b] = &mut app.pair;
    for (salt, chosen) in [("from", a), ("to", b)] {
        ComboBox::from_id_salt(salt).width(64.0).selected_text(chosen.as_str()).show_ui(ui, |ui| {
            for id in ids {
                ui.selectable_value(chosen, id.clone(), id);
            }
        });
    }
    if app.pair[0] == app.pair[1] || !app.pair.iter().all(|id| ids.contains(id)) {
        ui.label(RichText::new("choose two").color(theme::palette(ui.ctx()).text3));
        return None;
    }
    let session = app.editor.session();
    let estimate = places::estimated_distance(session, &app.pair);
    let label = ui.label(RichText::new("measured").color(theme::palette(ui.ctx()).text2));
    let metres = empty_field(ui, ("distance", &app.pair), label.id, session.units, estimate)?;
    let between = app.pair.clone();
    let length_m = Known::prior(metres, TAPE);
    Some(Distance { id: None, name: None, off: false, keep: false, between, length_m })
}
