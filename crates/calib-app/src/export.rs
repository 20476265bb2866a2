//! Export sheet: formats, and the losses of a format before anything is written.

use calib_formats::{Export, ExportOptions, PlanImage};
use egui::{Align2, ComboBox, Context, RichText, ScrollArea, Ui, Vec2, Window};

use crate::choice::Purpose;
use crate::plan::distances;
use crate::platform::Task;
use crate::state::{App, Asked, formats};
use crate::theme::{self, Palette};

/// Shows the open export sheet.
#[inline(never)]
pub fn export_ui(app: &mut App, ctx: &Context) {
    update_export(app, ctx);
    let mut open = true;
    Window::new("Export")
        .open(&mut open)
        .resizable(false)
        .collapsible(false)
        .anchor(Align2::CENTER_TOP, Vec2::new(0.0, 64.0))
        .default_width(460.0)
        .show(ctx, |ui| {
            ui.set_width(460.0);
            choices(app, ui);
            ui.separator();
            outcome(app, ui);
        });
    if !open {
        app.dialogs.export.close();
    }
}

/// Starts the export in the background if the site or an option changed, and collects the result.
fn update_export(app: &mut App, ctx: &Context) {
    let Some(format) = formats().nth(app.dialogs.export.format) else { return };
    if format.shows_plan {
        app.ask_for_plan(ctx);
    }
    let plan = app.plan_picture().filter(|_| format.shows_plan).map(|picture| picture.image.clone());
    let sheet = &mut app.dialogs.export;
    let asked = Asked {
        format: sheet.format,
        extension: sheet.extension,
        rectified: sheet.rectified,
        one: sheet.only_this.then_some(app.editor.session().camera),
        generation: app.editor.session().revision.generation,
        has_plan: plan.is_some(),
    };
    if sheet.asked != Some(asked) {
        (sheet.asked, sheet.made, sheet.agreed) = (Some(asked), None, false);
        let site = app.editor.session().solved.write_into(&app.editor.session().site);
        let one = asked.one.and_then(|index| site.cameras.get(index)).map(|camera| camera.id.clone());
        let extension = format.extensions.get(asked.extension).map(|extension| (*extension).to_owned());
        sheet.making = Some(Task::spawn(ctx, move || {
            let plan = plan.map(|image| plan_image(&image)).transpose()?;
            let options = ExportOptions {
                rectified: asked.rectified,
                rescale: None,
                extension,
                camera: one,
                plan,
                embeds: false,
            };
            calib_formats::export(format, &site, &options).map_err(|error| error.to_string())
        }));
    }
    if let Some(done) = sheet.making.as_ref().and_then(Task::poll) {
        (sheet.making, sheet.made) = (None, Some(done));
    }
}

/// Encodes the image of the floor plan as PNG for the export.
fn plan_image(image: &image::RgbImage) -> Result<PlanImage, String> {
    Ok(PlanImage { png: calib_editor::images::png(image)?, size: image.dimensions().into() })
}

fn choices(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let camera = app.editor.session().entry().map(|entry| entry.id.clone()).unwrap_or_default();
    let sheet = &mut app.dialogs.export;
    let chosen = sheet.format;
    let Some(format) = formats().nth(chosen) else { return };
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Format").color(palette.text2));
        let shown = ComboBox::from_id_salt("format").width(240.0).selected_text(format.name);
        let shown = shown.show_ui(ui, |ui| {
            for (index, format) in formats().enumerate() {
                ui.selectable_value(&mut sheet.format, index, format!("{}: {}", format.name, format.about));
            }
        });
        shown.response.labelled_by(label.id);
        if format.extensions.len() > 1 {
            let label = ui.label(RichText::new("as").color(palette.text2));
            let written = format.extensions.get(sheet.extension).copied().unwrap_or_default();
            let shown = ComboBox::from_id_salt("extension").width(70.0).selected_text(format!(".{written}"));
            let shown = shown.show_ui(ui, |ui| {
                for (index, extension) in format.extensions.iter().enumerate() {
                    ui.selectable_value(&mut sheet.extension, index, format!(".{extension}"));
                }
            });
            shown.response.labelled_by(label.id);
        }
    });
    if sheet.format != chosen {
        sheet.extension = 0;
    }
    ui.label(RichText::new(format.about).color(palette.text2));
    ui.horizontal(|ui| {
        ui.checkbox(&mut sheet.rectified, "undistorted camera and undistortion map");
        ui.checkbox(&mut sheet.only_this, format!("only {camera}"));
    });
    let about = format!("Contains: {}. Does not contain: {}.", format.contains, format.lacks);
    ui.label(RichText::new(about).small().color(palette.text3));
}

fn outcome(app: &mut App, ui: &mut Ui) {
    distances::out_of_date_ui(app, ui);
    let palette = theme::palette(ui.ctx());
    let sheet = &mut app.dialogs.export;
    let export = match &sheet.made {
        None => {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.label(RichText::new("Preparing the export\u{2026}").color(palette.text2));
            });
            return;
        }
        Some(Err(error)) => {
            ui.label(RichText::new(error).color(palette.bad));
            return;
        }
        Some(Ok(export)) => export,
    };
    ScrollArea::vertical().max_height(260.0).show(ui, |ui| export_contents(ui, palette, export));
    if !export.losses.is_empty() {
        ui.checkbox(&mut sheet.agreed, "Export anyway; the lost data is not needed");
    }
    let count = export.files.len();
    let text = format!("Write {}\u{2026}", calib_site::counted(count, "file", "files"));
    let text = RichText::new(text).font(theme::medium(12.0)).color(palette.bg);
    let is_free = app.dialogs.export.files().is_some();
    if ui.add_enabled(is_free, egui::Button::new(text).fill(palette.accent)).clicked() {
        app.open_dialog(Purpose::Export);
    }
}

/// Shows losses, notes, omitted cameras and the files to write.
fn export_contents(ui: &mut Ui, palette: &Palette, export: &Export) {
    if !export.losses.is_empty() {
        egui::Frame::NONE.fill(palette.warn_bg).corner_radius(4).inner_margin(8).show(ui, |ui| {
            ui.set_width(ui.available_width());
            ui.label(RichText::new("This format loses:").font(theme::medium(12.0)).color(palette.warn));
            for loss in &export.losses {
                ui.label(loss.to_string());
            }
        });
    }
    for note in &export.notes {
        ui.label(RichText::new(note).color(palette.text2));
    }
    if !export.unsolved.is_empty() {
        let text = format!("Not calibrated, therefore not exported: {}", export.unsolved.join(", "));
        ui.label(RichText::new(text).color(palette.warn));
    }
    for file in &export.files {
        ui.horizontal(|ui| {
            ui.label(&file.name);
            let kilobytes = (file.bytes.len() as f64 / 1000.0).ceil();
            ui.label(RichText::new(format!("{kilobytes} kB")).color(palette.text3));
        });
    }
}
