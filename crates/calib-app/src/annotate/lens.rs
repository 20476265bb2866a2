//! Panel: name, image and lens of the current camera.

use calib_core::DistortionModel;

use calib_core::camera::Coefficient;

use calib_editor::{Action, ReplacedImage};
use calib_site::{DistortionEntry, PrincipalPointEntry};
use egui::{ComboBox, DragValue, RichText, TextEdit, Ui};

use crate::annotate::{circle, known_values, sigmas};
use crate::state::App;
use crate::theme;
use crate::widgets::heading;

/// Distortion coefficients that the button "Fit k1, k2" and the menu entry "fit k1 and k2" estimate.
const DEFAULT_COEFFICIENTS: [Coefficient; 2] = [Coefficient::K1, Coefficient::K2];

/// Source of the current camera's distortion coefficients.
#[derive(Clone, Debug, PartialEq)]
enum LensSource {
    /// Fit to the straight edges, with as many coefficients as they support.
    Edges,
    /// Fit of these coefficients to the straight edges.
    Fitted(Vec<Coefficient>),
    /// Fit of a fisheye model.
    Fisheye,
    /// Coefficients that the operator entered or imported; they are fixed.
    Given,
    /// Lens of another camera with this id.
    Like(String),
}

impl LensSource {
    /// Returns the lens source of the current camera.
    fn from_app(app: &App) -> Self {
        let lens = app.editor.session().entry().and_then(|entry| entry.lens.as_ref());
        if let Some(like) = lens.and_then(|lens| lens.like.clone()) {
            return Self::Like(like);
        }
        match lens.and_then(|lens| lens.distortion.as_ref()) {
            None => Self::Edges,
            Some(entry) if entry.distortion().is_some() => Self::Given,
            Some(entry) if entry.model.row().is_wide => Self::Fisheye,
            Some(entry) => {
                let row = entry.model.row();
                Self::Fitted(
                    entry.fit.clone().unwrap_or_else(|| row.coefficients[..row.default_count].to_vec()),
                )
            }
        }
    }

    /// Returns the lens source as text for the menu.
    fn text(&self) -> String {
        match self {
            Self::Edges => "from straight edges".into(),
            Self::Fitted(which) => {
                let names: Vec<&str> = which.iter().map(|which| which.title()).collect();
                match &names[..] {
                    [first @ .., last] if !first.is_empty() => format!("fit {} and {last}", first.join(", ")),
                    names => format!("fit {}", names.concat()),
                }
            }
            Self::Fisheye => "fisheye".into(),
            Self::Given => "entered".into(),
            Self::Like(id) => format!("same as {id}"),
        }
    }
}

/// Shows the panel with name, image and lens of the current camera.
pub fn lens_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.session().entry() else { return };
    let [w, h] = entry.size_px;
    heading(ui, "Camera", &format!("{w} \u{d7} {h} px"));
    names(app, ui);
    let own = LensSource::from_app(app);
    let id = app.editor.session().entry().map(|entry| entry.id.clone()).unwrap_or_default();
    let usual = LensSource::Fitted(DEFAULT_COEFFICIENTS.to_vec());
    let own_fit = Some(own.clone()).filter(|own| matches!(own, LensSource::Fitted(_)) && *own != usual);
    let mut choices = vec![LensSource::Edges, usual];
    choices.extend(own_fit);
    choices.extend([LensSource::Fisheye, LensSource::Given]);
    let free = |camera: &&calib_site::SiteCamera| {
        // A camera can share the lens of another camera only if that camera does not share a lens itself.
        camera.id != id && camera.lens.as_ref().is_none_or(|lens| lens.like.is_none())
    };
    choices.extend(
        app.editor
            .session()
            .site
            .cameras
            .iter()
            .filter(free)
            .map(|camera| LensSource::Like(camera.id.clone())),
    );
    let mut chosen = own.clone();
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Lens").color(palette.text2));
        ComboBox::from_id_salt("lens")
            .selected_text(own.text())
            .show_ui(ui, |ui| {
                for choice in choices {
                    let text = choice.text();
                    ui.selectable_value(&mut chosen, choice, text);
                }
            })
            .response
            .labelled_by(label.id);
    });
    if chosen != own {
        set_source(app, chosen);
    } else if own == LensSource::Given {
        coefficients(app, ui);
    }
    circle::circle_ui(app, ui);
    known_values::known_values_ui(app, ui);
    sigmas::sigmas_ui(app, ui);
}

fn names(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.session().entry() else { return };
    let (mut id, mut name) = (entry.id.clone(), entry.name.clone().unwrap_or_default());
    let field = |ui: &mut Ui, title: &str, text: &mut String| -> bool {
        let salt = ui.scope_id().with((title, app.editor.session().camera));
        let mut typed = ui.data(|data| data.get_temp::<String>(salt)).unwrap_or_else(|| text.clone());
        let label = ui.label(RichText::new(title).color(palette.text2));
        let response = ui.add(TextEdit::singleline(&mut typed).desired_width(88.0)).labelled_by(label.id);
        if response.has_focus() {
            ui.data_mut(|data| data.insert_temp(salt, typed.clone()));
            return false;
        }
        ui.data_mut(|data| data.remove::<String>(salt));
        let is_dropped = ui.input(|input| input.key_pressed(egui::Key::Escape));
        let is_new = response.lost_focus() && !is_dropped && typed != *text;
        *text = typed;
        is_new
    };
    let (mut renamed, mut titled) = (false, false);
    ui.horizontal(|ui| {
        renamed = field(ui, "ID", &mut id);
        titled = field(ui, "Name", &mut name);
    });
    if titled {
        app.send(Action::Name(name));
    }
    if renamed {
        app.send(Action::Rename(id.trim().to_owned()));
    }
}

/// Changes the lens source of the current camera.
fn set_source(app: &mut App, to: LensSource) {
    let focal = app.editor.session().solution().map(|solution| solution.focal_px);
    let current = app.editor.session().solution().and_then(|solution| solution.distortion.clone());
    let session = app.editor.session();
    let wide =
        session.solved.pose(session.camera).map(|pose| pose.lens).filter(|lens| lens.distortion.is_wide());
    let is_sought = to == LensSource::Fisheye;
    let circle = if is_sought { circle::found(app) } else { None };
    app.change_lens("change the lens source", |lens| {
        lens.like = None;
        lens.image_circle_px = lens.image_circle_px.or(circle);
        let bare = DistortionEntry::new(DistortionModel::BrownConrady);
        lens.distortion = match to {
            LensSource::Edges => None,
            LensSource::Fitted(which) => Some(DistortionEntry { fit: Some(which), ..bare }),
            LensSource::Fisheye => Some(DistortionEntry::new(DistortionModel::KannalaBrandt)),
            LensSource::Given => {
                let zero = DistortionEntry { k1: Some(0.0), k2: Some(0.0), ..bare };
                // The focal length and the principal point of a fisheye were fitted together with its
                // coefficients.
                lens.principal_point_px = wide
                    .map(|lens| PrincipalPointEntry::known(lens.principal_point))
                    .or(lens.principal_point_px);
                let focal_px = wide.map(|lens| lens.focal).or(focal);
                Some(DistortionEntry { fit: None, focal_px, ..current.unwrap_or(zero) })
            }
            LensSource::Like(id) => {
                lens.like = Some(id);
                None
            }
        };
    });
}

/// Requests a fit of k1 and k2 of the current camera to its straight edges.
pub fn fit(app: &mut App) {
    set_source(app, LensSource::Fitted(DEFAULT_COEFFICIENTS.to_vec()));
}

/// Shows the entered distortion coefficients, and the focal length for which they are valid, in pixels.
fn coefficients(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let lens = app.editor.session().entry().and_then(|entry| entry.lens.as_ref());
    let Some(mut entry) = lens.and_then(|lens| lens.distortion.clone()) else { return };
    let mut changed = false;
    ui.horizontal_wrapped(|ui| {
        for which in Coefficient::ALL {
            let Some(value) = entry.coefficient_mut(which) else { continue };
            let title = which.title();
            let label = ui.label(RichText::new(title).color(palette.text2));
            let field = DragValue::new(value).speed(0.001).max_decimals(6).update_while_editing(false);
            let [least, most] = which.bounds();
            let field = field.range(least..=most);
            changed |= ui.add(field).labelled_by(label.id).changed();
        }
        if let Some(focal) = &mut entry.focal_px {
            let label = ui.label(RichText::new("at focal length").color(palette.text2));
            let field = DragValue::new(focal).speed(1.0).range(1.0..=1e6).max_decimals(2).suffix(" px");
            changed |= ui.add(field.update_while_editing(false)).labelled_by(label.id).changed();
        }
    });
    if changed {
        app.change_lens("change the lens", |lens| lens.distortion = Some(entry));
    }
}

/// Shows the opacity slider of the replaced image, which is painted over the new image to reveal movement.
pub fn old_still(app: &mut App, ui: &mut Ui) {
    let Some(ReplacedImage { of, opacity: mut share, size, .. }) = app.editor.replaced_image().cloned()
    else {
        return;
    };
    let Some(entry) = app.editor.session().entry().filter(|entry| of.matches(entry)) else { return };
    let [w, h] = entry.size_px;
    let palette = theme::palette(ui.ctx());
    let (mut done, shown) = (false, share);
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Old image").color(palette.text2));
        ui.add(egui::Slider::new(&mut share, 0.0..=1.0).show_value(false)).labelled_by(label.id);
        done = ui.button("Done").on_hover_text("Hide the old image").clicked();
    });
    if size.is_some() && ui.button(format!("Rescale the annotations to {w} \u{d7} {h} px")).clicked() {
        app.send(Action::RescaleToImage);
    }
    if done {
        app.send(Action::BlendReplacedImage(None));
    } else if share != shown {
        app.send(Action::BlendReplacedImage(Some(share)));
    }
}
