//! Panel: the image circle of a fisheye, detected, entered or removed.

use calib_core::{DistortionModel, ImageCircle};
use calib_editor::Action;
use egui::{DragValue, RichText, Ui};

use crate::state::App;
use crate::theme;

/// Shows the image circle of the current camera, if the camera has a fisheye lens or an image circle.
pub(crate) fn circle_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.session().entry() else { return };
    let (circle, [width, height]) = (entry.image_circle(), entry.size());
    if circle.is_none() && !is_fisheye(app) {
        return;
    }
    let mut chosen = circle;
    ui.horizontal(|ui| {
        ui.label(RichText::new("Image circle").color(palette.text2))
            .on_hover_text("The round area of a fisheye image, surrounded by black");
        if ui.button("Find").on_hover_text("Detect the circle in the image").clicked() {
            match found(app) {
                Some(circle) => chosen = Some(circle),
                None => app.send(Action::AddError(not_found(app))),
            }
        }
        let inscribed = ImageCircle { u: 0.5 * width, v: 0.5 * height, radius: 0.5 * width.min(height) };
        if circle.is_none() {
            let tip = "Start with the largest circle that fits in the image";
            if ui.button("Enter").on_hover_text(tip).clicked() {
                chosen = Some(inscribed);
            }
        } else if ui.button("Remove").on_hover_text("Remove the image circle").clicked() {
            chosen = None;
        }
    });
    if let Some(circle) = &mut chosen {
        fields(ui, circle);
    }
    if chosen != circle {
        let name = match (circle, chosen) {
            (None, _) => "enter the image circle",
            (_, None) => "remove the image circle",
            _ => "change the image circle",
        };
        app.change_lens(name, |lens| lens.image_circle_px = chosen);
    }
}

/// Detects the image circle in the current image, in pixels; `None` without a circle or until the image is
/// read.
pub(crate) fn found(app: &App) -> Option<ImageCircle> {
    let name = app.editor.session().entry()?.image.as_deref()?;
    calib_image::image_circle(&app.pictures.ready(name)?.image)
}

/// Returns the message that no image circle was detected.
fn not_found(app: &App) -> String {
    let Some(entry) = app.editor.session().entry() else { return String::new() };
    let is_loaded = entry.image.as_deref().is_some_and(|name| app.pictures.ready(name).is_some());
    let why = if is_loaded { "no image circle was detected" } else { "its image is not loaded" };
    format!("{}: {why}. Enter the centre and radius of the image circle.", entry.id)
}

/// Whether the current camera has a fisheye lens. The entered lens model decides; without one, the solution decides.
fn is_fisheye(app: &App) -> bool {
    let session = app.editor.session();
    let lens = session.entry().and_then(|entry| entry.lens.as_ref());
    let asked = lens.and_then(|lens| lens.distortion.as_ref()).map(|distortion| distortion.model);
    let solved = session.solution().and_then(|solution| solution.distortion.as_ref()).map(|own| own.model);
    asked.or(solved).is_some_and(|model: DistortionModel| model.row().is_wide)
}

fn fields(ui: &mut Ui, circle: &mut ImageCircle) {
    let palette = theme::palette(ui.ctx());
    let ImageCircle { u, v, radius } = circle;
    ui.horizontal(|ui| {
        for (title, value, low) in [("u", u, -1e6), ("v", v, -1e6), ("radius", radius, 1.0)] {
            let label = ui.label(RichText::new(title).color(palette.text3));
            let field = DragValue::new(value).speed(0.2).range(low..=1e6).max_decimals(1);
            ui.add(field.update_while_editing(false)).labelled_by(label.id);
        }
        ui.label(RichText::new("px").color(palette.text3));
    });
}
