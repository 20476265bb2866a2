//! How far the scene may be from what is drawn: what kind of place it is.

use calib_core::SceneErrors;

use calib_editor::Action;
use calib_report::scene_errors;
use calib_site::{SceneEntry, SceneSigmas};
use egui::{ComboBox, RichText, Ui};

use crate::state::App;
use crate::theme;

/// A kind of place: its name, what it may be off, where it is.
type Place = (&'static str, Option<SceneEntry>, &'static str);

/// The kinds of places that are offered.
const PLACES: [Place; 4] = [
    ("Any place", None, "Where nothing is known"),
    ("Level floors", Some(falls(0.3, 0.0)), "Shops, factories"),
    ("Falling floors", Some(falls(1.5, 2.0)), "Streets, yards"),
    ("As drawn", Some(SceneEntry::EXACT), "Measured: verticals, corners and levels are what lines say"),
];

const fn falls(tilt: f64, crossfall: f64) -> SceneEntry {
    SceneEntry::Sigmas(SceneSigmas {
        floor_tilt_sigma_deg: Some(tilt),
        crossfall_sigma_deg: Some(crossfall),
        angle_sigma_deg: None,
        length_sigma_rel: None,
    })
}

/// The choice for the whole site, and for a camera whose place is of another kind.
pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let session = app.editor.session();
    let site = session.site.scene;
    let Some(own) = session.entry().map(|entry| entry.scene) else { return };
    let chosen = choice(ui, "Scene", site, PLACES[0], errors(None));
    let as_site = ("As the site", None, "Where the site says");
    let own_chosen = choice(ui, "This camera", own, as_site, errors(site));
    if chosen == site && own_chosen == own {
        return;
    }
    let (mut changed, index) = (session.site.clone(), session.camera);
    changed.scene = chosen;
    if let Some(entry) = changed.cameras.get_mut(index) {
        entry.scene = own_chosen;
    }
    app.send(Action::Change { site: Box::new(changed), name: "change what the scene may be off".into() });
}

/// A list of places; `usual` is that of which nothing is said, and `unsaid` what is possible then.
fn choice(
    ui: &mut Ui,
    title: &str,
    now: Option<SceneEntry>,
    usual: Place,
    unsaid: SceneErrors,
) -> Option<SceneEntry> {
    let palette = theme::palette(ui.ctx());
    let possible = |scene: Option<SceneEntry>| scene.map_or(unsaid, |scene| scene.errors());
    let mut chosen = now;
    let places = || std::iter::once(usual).chain(PLACES[1..].iter().copied());
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new(title).color(palette.text2));
        let named = places().find(|(_, scene, _)| *scene == now).map_or("Its own", |(title, ..)| title);
        ComboBox::from_id_salt(title)
            .selected_text(named)
            .show_ui(ui, |ui| {
                for (title, scene, place) in places() {
                    let says = format!("{place}. {}", scene_errors(&possible(scene)));
                    ui.selectable_value(&mut chosen, scene, title).on_hover_text(says);
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text(scene_errors(&possible(now)));
    });
    chosen
}

/// What a scene may be off; of one of which the site says nothing, what the core takes for usual.
fn errors(scene: Option<SceneEntry>) -> SceneErrors {
    scene.unwrap_or(SceneEntry::Sigmas(SceneSigmas::default())).errors()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_of_any_place_is_what_the_core_takes_for_usual() {
        assert_eq!(errors(None), SceneErrors::default());
        let SceneErrors { floor_tilt, crossfall, angle, .. } = SceneErrors::default();
        let said = scene_errors(&errors(None));
        for angle in [floor_tilt, crossfall, angle] {
            assert!(said.contains(&format!("{:.1}\u{b0}", angle.to_degrees())), "{said}");
        }
        let level = errors(Some(falls(0.3, 0.0)));
        assert_eq!(level.angle, angle, "a place that says how floors fall says no more");
        assert!(!scene_errors(&level).contains("side"), "a level floor falls to no side");
    }
}
