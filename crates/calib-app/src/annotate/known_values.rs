//! Panel: known values of the lens: data sheet, pixel aspect and principal point.

use calib_core::Pixel;
use calib_core::single::PrincipalPointPrior;
use calib_editor::Period;
use calib_site::{DataSheet, LensEntry, PixelAspectEntry, PrincipalPointEntry, usual_pixel_aspect};
use egui::{CollapsingHeader, ComboBox, DragValue, RichText, TextEdit, Ui};

use crate::state::App;
use crate::theme;

/// Shows the known values of the current camera's lens, if the camera has its own lens.
pub(crate) fn known_values_ui(app: &mut App, ui: &mut Ui) {
    let Some(entry) = app.editor.session().entry() else { return };
    let (of, size) = (Period::from_camera(entry), entry.size_px);
    let lens = entry.lens.clone().unwrap_or_default();
    // A camera with the lens of another camera uses the values of that camera. With a window, the lens refers to an
    // image of another size.
    if lens.like.is_some() || lens.window_px.is_some() {
        return;
    }
    let is_entered = lens.data_sheet() != DataSheet::default()
        || lens.pixel_aspect.is_some()
        || lens.principal_point_px.is_some();
    let section = CollapsingHeader::new("Known values").id_salt("known values").default_open(is_entered);
    section.show(ui, |ui| contents(app, ui, (&of, size), &lens));
}

/// Shows the fields of the known values. The function is not inlined, so that the web build can load it later, in the
/// second part of the program.
#[inline(never)]
fn contents(app: &mut App, ui: &mut Ui, (of, size): (&Period, [u32; 2]), lens: &LensEntry) {
    data_sheet(app, ui, (of, size), lens);
    pixel_aspect(app, ui, size, lens);
    principal_point(app, ui, size, lens);
}

/// Shows the field for the data sheet. Invalid text stays in the field, with a message below it.
fn data_sheet(app: &mut App, ui: &mut Ui, (of, size): (&Period, [u32; 2]), lens: &LensEntry) {
    let palette = theme::palette(ui.ctx());
    let salt = ui.scope_id().with(("data sheet", &of.camera, &of.from));
    let entered = lens.data_sheet().to_string();
    let mut text = ui.data(|data| data.get_temp::<String>(salt)).unwrap_or_else(|| entered.clone());
    let (mut has_focus, mut changed) = (false, None);
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Data sheet").color(palette.text2));
        let field = TextEdit::singleline(&mut text).hint_text("2.8 mm 1/2.7").desired_width(132.0);
        let response = ui.add(field.char_limit(100)).labelled_by(label.id).on_hover_text(
            "Focal length and sensor, such as 2.8 mm 1/2.7, or fields of view, such as horizontal 98\u{b0}. \
             A value without \u{b1} gets a standard deviation of 3 %.",
        );
        has_focus = response.has_focus();
        if response.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Escape)) {
            text.clone_from(&entered);
        } else if response.lost_focus() && text != entered {
            changed = DataSheet::parse(&text, size).ok();
        }
    });
    let is_open = text != entered && changed.is_none();
    ui.data_mut(|data| {
        if is_open {
            data.insert_temp(salt, text.clone());
        } else {
            data.remove::<String>(salt);
        }
    });
    if is_open
        && !has_focus
        && let Err(error) = DataSheet::parse(&text, size)
    {
        ui.label(RichText::new(error.to_string()).color(palette.bad));
    }
    if let Some(sheet) = changed.filter(|sheet| *sheet != lens.data_sheet()) {
        app.change_lens("change the data sheet", |lens| lens.set_data_sheet(sheet));
    }
}

/// Shows the choice of the pixel aspect, and a field for an entered value.
fn pixel_aspect(app: &mut App, ui: &mut Ui, size: [u32; 2], lens: &LensEntry) {
    let palette = theme::palette(ui.ctx());
    let own = lens.pixel_aspect;
    let entered = match own {
        Some(PixelAspectEntry::Known(value)) => value,
        _ => usual_pixel_aspect(size).unwrap_or(1.0),
    };
    let fitted =
        own.filter(|own| !matches!(own, PixelAspectEntry::Known(_))).unwrap_or(PixelAspectEntry::Fit);
    let choices = [
        (None, "square pixels"),
        (Some(PixelAspectEntry::Known(entered)), "entered"),
        (Some(fitted), "from the lines"),
    ];
    let mut chosen = own;
    ui.horizontal(|ui| {
        let tip = "Width of a pixel divided by its height. Some recorders save stretched images.";
        choose(ui, "Pixel aspect", tip, &choices, &mut chosen);
        if let Some(PixelAspectEntry::Known(value)) = &mut chosen {
            let field = DragValue::new(value).speed(0.001).range(0.1..=10.0).max_decimals(4);
            let field = field.clamp_existing_to_range(false);
            let label = ui.label(RichText::new("width / height =").color(palette.text3));
            ui.add(field.update_while_editing(false)).labelled_by(label.id);
        }
    });
    if chosen != own {
        app.change_lens("change the pixel aspect", |lens| lens.pixel_aspect = chosen);
    }
}

/// Shows the principal point: near the image centre, or entered with or without a standard deviation.
fn principal_point(app: &mut App, ui: &mut Ui, size: [u32; 2], lens: &LensEntry) {
    let palette = theme::palette(ui.ctx());
    let own = lens.principal_point_px;
    let [w, h] = size.map(f64::from);
    let value = own.map_or(Pixel::new(0.5 * w, 0.5 * h), |own| own.value);
    let sigma = own.and_then(|own| own.sigma).unwrap_or(PrincipalPointPrior::of_image([w, h]).sigma);
    let choices = [
        (None, "near the centre"),
        (Some(PrincipalPointEntry::known(value)), "entered"),
        (Some(PrincipalPointEntry { value, sigma: Some(sigma) }), "entered with \u{b1}"),
    ];
    let mut chosen = own;
    ui.horizontal(|ui| {
        let tip = "Image point on the optical axis, from a calibration of the lens. It is estimated near the \
                    centre if it is not entered.";
        choose(ui, "Principal point", tip, &choices, &mut chosen);
    });
    if let Some(PrincipalPointEntry { value: Pixel { u, v }, sigma }) = &mut chosen {
        ui.horizontal(|ui| {
            ui.add_space(24.0);
            let sigma = sigma.as_mut().map(|sigma| ("\u{b1}", sigma, 0.01));
            for (title, value, low) in [("u", u, -1e6), ("v", v, -1e6)].into_iter().chain(sigma) {
                let label = ui.label(RichText::new(title).color(palette.text3));
                let field = DragValue::new(value)
                    .speed(0.2)
                    .range(low..=1e6)
                    .max_decimals(2)
                    .clamp_existing_to_range(false);
                ui.add(field.update_while_editing(false)).labelled_by(label.id);
            }
            ui.label(RichText::new("px").color(palette.text3));
        });
    }
    if chosen != own {
        app.change_lens("change the principal point", |lens| lens.principal_point_px = chosen);
    }
}

/// Shows a list of choices with a title and a tooltip.
fn choose<T: Clone + PartialEq>(ui: &mut Ui, title: &str, tip: &str, choices: &[(T, &str)], chosen: &mut T) {
    let label = ui.label(RichText::new(title).color(theme::palette(ui.ctx()).text2));
    let text = choices.iter().find(|(choice, _)| choice == chosen).map_or("", |(_, text)| *text);
    ComboBox::from_id_salt(title)
        .selected_text(text)
        .show_ui(ui, |ui| {
            for (choice, text) in choices {
                ui.selectable_value(chosen, choice.clone(), *text);
            }
        })
        .response
        .labelled_by(label.id)
        .on_hover_text(tip);
}
