//! How far the scene may be from what is drawn: what kind of place it is.

use calib_core::{SceneEntry, SceneErrors, SceneSigmas};
use calib_editor::Action;
use egui::{ComboBox, RichText, Ui};

use crate::state::App;
use crate::theme;

/// The kinds of places that are offered, with where they are.
const PLACES: [(&str, Option<SceneEntry>, &str); 4] = [
    ("Any place", None, "Where nothing is known"),
    ("Level floors", Some(tilt(0.3)), "Shops, factories"),
    ("Falling floors", Some(tilt(1.5)), "Streets, yards"),
    ("As drawn", Some(SceneEntry::EXACT), "Measured: verticals, corners and levels are what lines say"),
];

const fn tilt(degrees: f64) -> SceneEntry {
    SceneEntry::Sigmas(SceneSigmas {
        floor_tilt_sigma_deg: Some(degrees),
        crossfall_sigma_deg: None,
        angle_sigma_deg: None,
        length_sigma_rel: None,
    })
}

/// The choice for the whole site.
pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let now = app.editor.session().site.scene;
    let mut chosen = now;
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Scene").color(palette.text2));
        let title = PLACES.iter().find(|(_, scene, _)| *scene == now).map_or("Its own", |(title, ..)| *title);
        ComboBox::from_id_salt("scene")
            .selected_text(title)
            .show_ui(ui, |ui| {
                for (title, scene, place) in PLACES {
                    let says = format!("{place}. {}", summary(errors(scene)));
                    ui.selectable_value(&mut chosen, scene, title).on_hover_text(says);
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text(summary(errors(now)));
    });
    if chosen != now {
        let mut site = app.editor.session().site.clone();
        site.scene = chosen;
        app.send(Action::Change { site: Box::new(site), name: "change what the scene may be off".into() });
    }
}

/// What a scene may be off; of one of which the site says nothing, what the core takes for usual.
fn errors(scene: Option<SceneEntry>) -> SceneErrors {
    scene.unwrap_or(SceneEntry::Sigmas(SceneSigmas::default())).errors()
}

/// What is taken for possible, in words.
fn summary(errors: SceneErrors) -> String {
    format!(
        "One sigma: floor falls {:.1}\u{b0}{}, corners {:.1}\u{b0} off square, equal lengths {:.1} %",
        errors.floor_tilt.to_degrees(),
        to_the_side(errors.crossfall.to_degrees()),
        errors.angle.to_degrees(),
        100.0 * errors.length,
    )
}

/// What more marked ground may fall, if it may.
fn to_the_side(degrees: f64) -> String {
    if degrees > 0.0 {
        format!(" and {degrees:.1}\u{b0} to the side of marks of equal length")
    } else {
        String::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_of_any_place_is_what_the_core_takes_for_usual() {
        assert_eq!(errors(None), SceneErrors::default());
        let SceneErrors { floor_tilt, crossfall, angle, .. } = SceneErrors::default();
        let said = summary(errors(None));
        for angle in [floor_tilt, crossfall, angle] {
            assert!(said.contains(&format!("{:.1}\u{b0}", angle.to_degrees())), "{said}");
        }
        let falling = errors(Some(tilt(1.5)));
        assert_eq!(falling.angle, angle, "a place that says how floors fall says no more");
        assert!(!summary(falling).contains("side"), "which way they fall is said with it");
    }
}
