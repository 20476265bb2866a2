//! Measurements in the images: lines with their values, and the panel that lists them.

use calib_core::{Kind, Pixel};
use calib_editor::Action;
use calib_editor::edit::add_line;
use calib_report::measurement_name;
use calib_site::{Measurement, MeasurementKind, MeasurementPoint};
use egui::{Align2, Painter, RichText, Ui, Vec2};

use crate::icons::{self, Icon, Look};
use crate::overlay::Overlay;
use crate::paint::{Pen, handle, line, tag};
use crate::state::App;
use crate::theme::{self, on_image};
use crate::widgets::{entered_text, heading, length_field};

/// Computes the values of the measurements again if their inputs have changed.
pub(crate) fn update_measurements(app: &mut App) {
    let mut shown = app.measurements.take().unwrap_or_default();
    shown.update(app.editor.session());
    app.measurements = Some(shown);
}

/// Paints the measurements on the image of a camera, each with its value.
pub(crate) fn paint_on_image(app: &App, camera: usize, overlay: &Overlay, painter: &Painter) {
    let session = app.editor.session();
    let (Some(entry), Some(shown)) = (session.site.cameras.get(camera), &app.measurements) else { return };
    let units = session.site.units;
    for (index, measurement) in session.site.measurements.iter().enumerate() {
        let points = &measurement.points;
        let is_own = |point: &&MeasurementPoint| point.camera == entry.id;
        let own: Vec<Pixel> = points.iter().filter(is_own).map(|point| point.px).collect();
        let Some(&last) = own.last() else { continue };
        let is_area = measurement.kind == MeasurementKind::Area;
        let closing = points.last().zip(points.first()).filter(|_| is_area);
        // Points of other cameras interrupt the line.
        for (a, b) in points.iter().zip(points.iter().skip(1)).chain(closing) {
            if is_own(&a) && is_own(&b) {
                line(painter, &overlay.curve(&[a.px, b.px]), Pen::new(on_image::WAITING, 2.0));
            }
        }
        for at in overlay.path(&own) {
            handle(painter, at, on_image::WAITING);
        }
        // The panel shows the reason for a missing value.
        let is_valid = matches!(shown.values.get(index), Some(Ok(_)));
        let text = if is_valid { shown.text(index, measurement, units) } else { "not measured".into() };
        let at = overlay.path(&[last]).first().copied().unwrap_or_default();
        tag(painter, at + Vec2::new(8.0, 8.0), Align2::LEFT_TOP, &text, on_image::WHITE);
    }
}

/// Whether the Measure tool is active.
pub(crate) fn is_measuring(app: &App) -> bool {
    app.editor.has_tool(calib_editor::Icon::Measure)
}

/// Shows the settings of the Measure tool while it is active, and the list of measurements.
pub(crate) fn measurements_ui(app: &mut App, ui: &mut Ui) {
    update_measurements(app);
    heading(ui, "Measurements", "no effect on the calibration");
    if is_measuring(app) {
        settings_ui(app, ui);
    }
    let measurements = app.editor.site().measurements.clone();
    for (index, measurement) in measurements.iter().enumerate() {
        row(app, ui, index, measurement);
    }
}

/// Shows the choice of the quantity that the Measure tool measures, and the height of the measured points.
fn settings_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let before = app.editor.session().tool.ruler;
    let mut ruler = before;
    ui.horizontal(|ui| {
        for (kind, name, tip) in [
            (MeasurementKind::Length, "Length", "Distance between two points"),
            (MeasurementKind::Height, "Height", "From the lower end of an upright object to its upper end"),
            (MeasurementKind::Area, "Area", "Floor area enclosed by three or more corners"),
            (
                MeasurementKind::Speed,
                "Speed",
                "Distance between two points divided by the time between them. Open a newer image of the \
                 camera for the second point",
            ),
        ] {
            if ui.selectable_label(ruler.kind == kind, name).on_hover_text(tip).clicked() {
                ruler.kind = kind;
            }
        }
    });
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Height above the floor").color(palette.text2));
        let field = length_field(app.editor.site().units, &mut ruler.height, -100.0);
        let tip = "0 for points on the floor, 0.8 m for a table top, the height of the hub for a wheel";
        ui.add(field).labelled_by(label.id).on_hover_text(tip);
    });
    if ruler != before {
        app.send(Action::Ruler(ruler));
    }
}

/// Shows the field for the time between the points of a speed.
fn duration_ui(app: &mut App, ui: &mut Ui, index: usize, measurement: &Measurement) {
    let palette = theme::palette(ui.ctx());
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Seconds between the points").small().color(palette.text2));
        let known = measurement.duration_s.map_or_else(String::new, |seconds| seconds.to_string());
        let (response, typed) = entered_text(ui, ("duration", index), &known, 60.0);
        response.labelled_by(label.id);
        let Some(typed) = typed else { return };
        match typed.replace(',', ".").trim_end_matches('s').trim().parse::<f64>() {
            Ok(seconds) if seconds.is_finite() && seconds > 0.0 => {
                let mut site = app.editor.site().clone();
                site.measurements[index].duration_s = Some(seconds);
                let name = "enter the time between two points".into();
                app.send(Action::Change { site: Box::new(site), name });
            }
            _ => app.send(Action::Note(
                "The time is invalid. Enter a number of seconds above 0, such as 0.48.".into(),
            )),
        }
    });
}

/// Shows a measurement with its value, and buttons to copy, to use and to remove it.
fn row(app: &mut App, ui: &mut Ui, index: usize, measurement: &Measurement) {
    let palette = theme::palette(ui.ctx());
    let name = measurement_name(index, measurement);
    let units = app.editor.site().units;
    let Some(shown) = &app.measurements else { return };
    let text = shown.text(index, measurement, units);
    let remark = shown.remark(index, measurement, units);
    let is_valid = matches!(shown.values.get(index), Some(Ok(_)));
    let mut action = None;
    ui.horizontal(|ui| {
        ui.label(RichText::new(&name).font(theme::medium(12.0)).color(palette.text));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let look = Look { size: Vec2::splat(18.0), ..Look::default() };
            if icons::button(ui, Icon::Close, &format!("Remove {name}"), "", look).clicked() {
                action = Some(removed(app, index, &name));
            }
            if let Some(length) = line_of(app, measurement)
                && icons::button(ui, Icon::Known, &format!("Use {name} as a known length"), "", look)
                    .clicked()
            {
                action = Some(known_length(app, length));
            }
        });
    });
    let colour = if is_valid { palette.text } else { palette.warn };
    let value = ui.selectable_label(false, RichText::new(&text).color(colour));
    if value
        .on_hover_text(
            "Click to copy. The ± is one standard deviation. It includes the errors of the clicks and of \
             the calibration",
        )
        .clicked()
    {
        ui.ctx().copy_text(text);
        action = Some(Action::Note(format!("Copied {name}.")));
    }
    if let Some(remark) = remark {
        ui.label(RichText::new(remark).small().color(palette.warn));
    }
    if measurement.kind == MeasurementKind::Speed {
        duration_ui(app, ui, index, measurement);
    }
    if let Some(action) = action {
        app.send(action);
    }
}

/// Returns the action that removes a measurement.
fn removed(app: &App, index: usize, name: &str) -> Action {
    let mut site = app.editor.site().clone();
    site.measurements.remove(index);
    Action::Change { site: Box::new(site), name: format!("remove {name}") }
}

/// Returns the camera and the end points of a floor length that was measured in one image; `None` for other
/// measurements.
fn line_of(app: &App, measurement: &Measurement) -> Option<(usize, [Pixel; 2])> {
    let [a, b] = &measurement.points[..] else { return None };
    let is_line = measurement.kind == MeasurementKind::Length
        && a.camera == b.camera
        && a.height_m.or(b.height_m).is_none();
    let session = app.editor.session();
    // A camera may have several periods. The selected one is preferred.
    let is_own = |index: &usize| session.site.cameras.get(*index).is_some_and(|entry| entry.id == a.camera);
    let camera = std::iter::once(session.camera).chain(0..session.site.cameras.len()).find(is_own)?;
    is_line.then_some((camera, [a.px, b.px]))
}

/// Returns the action that adds an annotation of known length, whose length the operator enters.
fn known_length(app: &App, (camera, ends): (usize, [Pixel; 2])) -> Action {
    let mut site = app.editor.site().clone();
    add_line(&mut site.cameras[camera], Kind::KnownLength, ends.to_vec(), true);
    Action::Change { site: Box::new(site), name: "add a known length".into() }
}
