//! Panel: standard deviations of the scene and of single annotations.

use calib_core::single::ConstraintKind;
use calib_core::{Annotation, SceneErrors};
use calib_editor::Action;
use calib_report::scene_errors_text;
use calib_site::{SceneEntry, SceneSigmas};
use egui::{ComboBox, DragValue, RichText, Ui};

use crate::state::App;
use crate::theme;

/// Kind of scene: name, scene errors (`None` for the default), and typical places.
pub(crate) type SceneKind = (&'static str, Option<SceneEntry>, &'static str);

/// Kinds of scenes to choose from.
const SCENE_KINDS: [SceneKind; 5] = [
    ("Unknown slope", None, "The default: floors may slope a little"),
    ("Level floor", Some(with_slopes(0.3, 0.0)), "Shops, factories"),
    ("Sloping floor", Some(with_slopes(1.5, 2.0)), "Streets, yards"),
    ("Steep ground", Some(with_slopes(3.4, 3.4)), "Ramps, hills: the ground rises by about 6 %"),
    (
        "Exact",
        Some(SceneEntry::EXACT),
        "Measured scenes: lines are exactly vertical, level and at right angles",
    ),
];

/// Kinds of scenes that are offered as answers to the question whether the ground rises.
pub(crate) const GROUND_ANSWERS: [SceneKind; 3] = [SCENE_KINDS[1], SCENE_KINDS[2], SCENE_KINDS[3]];

/// Returns a scene with these standard deviations of the floor slope along and across markings, in degrees.
const fn with_slopes(tilt: f64, crossfall: f64) -> SceneEntry {
    SceneEntry::Sigmas(SceneSigmas {
        floor_tilt_sigma_deg: Some(tilt),
        crossfall_sigma_deg: Some(crossfall),
        angle_sigma_deg: None,
        length_sigma_rel: None,
    })
}

/// Shows the choice of the scene for the whole site and for the current camera.
pub(crate) fn sigmas_ui(app: &mut App, ui: &mut Ui) {
    let session = app.editor.session();
    let site = session.site.scene;
    let Some(own) = session.entry().map(|entry| entry.scene) else { return };
    let chosen = scene_choice(ui, "Scene type (site)", site, SCENE_KINDS[0], errors(None));
    let as_site = ("Same as the site", None, "Uses the scene type of the site");
    let own_chosen = scene_choice(ui, "Scene type (camera)", own, as_site, errors(site));
    if chosen != site || own_chosen != own {
        set_scenes(app, chosen, own_chosen);
    }
}

/// Changes the scene of the site and of the current camera.
fn set_scenes(app: &mut App, of_site: Option<SceneEntry>, of_camera: Option<SceneEntry>) {
    let session = app.editor.session();
    let (mut changed, index) = (session.site.clone(), session.camera);
    changed.scene = of_site;
    if let Some(entry) = changed.cameras.get_mut(index) {
        entry.scene = of_camera;
    }
    app.send(Action::Change { site: Box::new(changed), name: "change the accuracy of the scene".into() });
}

/// Changes the scene of the current camera.
pub(crate) fn set_scene(app: &mut App, scene: Option<SceneEntry>) {
    let of_site = app.editor.session().site.scene;
    set_scenes(app, of_site, scene);
}

/// Shows a list of scene kinds; returns the chosen scene, `None` for the first entry of the list. `usual` is this
/// first entry, and `unsaid` contains the errors that apply while it is chosen.
fn scene_choice(
    ui: &mut Ui,
    title: &str,
    now: Option<SceneEntry>,
    usual: SceneKind,
    unsaid: SceneErrors,
) -> Option<SceneEntry> {
    let palette = theme::palette(ui.ctx());
    let possible = |scene: Option<SceneEntry>| scene.map_or(unsaid, |scene| scene.errors());
    let mut chosen = now;
    let kinds = || std::iter::once(usual).chain(SCENE_KINDS[1..].iter().copied());
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new(title).color(palette.text2));
        let named = kinds().find(|(_, scene, _)| *scene == now).map_or("Custom values", |(title, ..)| title);
        ComboBox::from_id_salt(title)
            .selected_text(named)
            .show_ui(ui, |ui| {
                for (title, scene, place) in kinds() {
                    let says = format!("{place}. {}", scene_errors_text(&possible(scene)));
                    ui.selectable_value(&mut chosen, scene, title).on_hover_text(says);
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text(scene_errors_text(&possible(now)));
    });
    chosen
}

/// Returns the errors of a scene; the default errors for `None`.
fn errors(scene: Option<SceneEntry>) -> SceneErrors {
    scene.unwrap_or(SceneEntry::Sigmas(SceneSigmas::default())).errors()
}

/// Default standard deviations of annotations without their own values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Usual {
    /// Standard deviation of a click, in pixels.
    pub(crate) click: f64,
    pub(crate) scene: SceneErrors,
}

/// Shows fields for the sigmas of a selected annotation; returns the changed annotation.
pub(crate) fn fields(ui: &mut Ui, drawn: &Annotation, usual: Usual) -> Option<Annotation> {
    let mut annotation = drawn.clone();
    let constraint = drawn.kind.row().constraint;
    let has_angle = matches!(constraint, ConstraintKind::Parallel | ConstraintKind::RightAngle);
    let has_scene = has_angle || constraint == ConstraintKind::Length;
    ui.horizontal_wrapped(|ui| {
        ui.add_space(24.0);
        let click =
            Field { tip: "Standard deviation of a click", unit: " px", usual: usual.click, scale: 1.0 };
        click.show(ui, &mut annotation.sigma_px);
        if has_angle && !annotation.exact {
            let angle = usual.scene.angle.to_degrees();
            let tip = "Standard deviation of the angle. A quarter of this value is used for the slope \
                       relative to the floor";
            Field { tip, unit: "\u{b0}", usual: angle, scale: 1.0 }.show(ui, &mut annotation.angle_sigma_deg);
        }
        if constraint == ConstraintKind::Length && !annotation.exact {
            let tip = "Standard deviation of the length";
            let length = Field { tip, unit: " %", usual: 100.0 * usual.scene.length, scale: 100.0 };
            length.show(ui, &mut annotation.length_sigma_rel);
        }
        if has_scene {
            let says = "Treat as exact: the angle, slope or length was measured";
            ui.checkbox(&mut annotation.exact, "Exact").on_hover_text(says);
        }
        let own = Annotation {
            sigma_px: None,
            angle_sigma_deg: None,
            length_sigma_rel: None,
            exact: false,
            ..annotation.clone()
        };
        if own != annotation && ui.small_button("Reset").on_hover_text("Use the default accuracy").clicked() {
            annotation = own;
        }
    });
    (annotation != *drawn).then_some(annotation)
}

/// Field for a sigma that an annotation can override.
struct Field {
    tip: &'static str,
    unit: &'static str,
    /// Default value, in the display unit.
    usual: f64,
    /// Value in the display unit divided by the value in the site file.
    scale: f64,
}

impl Field {
    fn show(&self, ui: &mut Ui, own: &mut Option<f64>) {
        let palette = theme::palette(ui.ctx());
        let mut shown = own.map_or(self.usual, |own| own * self.scale);
        let colour = if own.is_some() { palette.text } else { palette.text3 };
        let label = ui.label(RichText::new("\u{b1}").color(colour));
        let field =
            DragValue::new(&mut shown).range(0.01..=100.0).speed(0.02).max_decimals(2).suffix(self.unit);
        if ui.add(field).labelled_by(label.id).on_hover_text(self.tip).changed() {
            *own = Some(shown / self.scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_of_any_place_is_what_the_core_takes_for_usual() {
        assert_eq!(errors(None), SceneErrors::default());
        let SceneErrors { floor_tilt, crossfall, angle, .. } = SceneErrors::default();
        let said = scene_errors_text(&errors(None));
        for angle in [floor_tilt, crossfall, angle] {
            assert!(said.contains(&format!("{:.1}\u{b0}", angle.to_degrees())), "{said}");
        }
        let level = errors(Some(with_slopes(0.3, 0.0)));
        assert_eq!(level.angle, angle, "a place that says how floors fall says no more");
        assert!(!scene_errors_text(&level).contains("across"), "a level floor has no slope across markings");
    }
}
