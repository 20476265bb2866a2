//! Sheet that adds an image from the address of a camera.

use egui::{Align2, Button, Context, Grid, Key, RichText, TextEdit, Ui, Vec2, Window};

use crate::platform::Task;
use crate::state::{AddressSheet, App};
use crate::theme;

/// Shows the sheet, and adds the image once it is read.
pub(crate) fn address_ui(app: &mut App, ctx: &Context) {
    let Some(mut sheet) = app.dialogs.address.take() else { return };
    match sheet.reading.as_ref().and_then(Task::outcome) {
        Some(Ok(Ok(found))) => {
            let pixel_aspect = found.pixel_aspect;
            let file = sheet.save(found, app.editor.session().path.as_deref());
            app.add_video_still(ctx, file, pixel_aspect);
            return;
        }
        Some(Ok(Err(error))) => (sheet.reading, sheet.error) = (None, Some(error)),
        Some(Err(_)) => {
            (sheet.reading, sheet.error) = (None, Some("Internal error; please report this.".into()));
        }
        None => {}
    }
    let mut is_open = true;
    Window::new("Image from the address of a camera")
        .title_bar(false)
        .resizable(false)
        .anchor(Align2::CENTER_TOP, Vec2::new(0.0, 64.0))
        .default_width(460.0)
        .show(ctx, |ui| is_open = sheet_ui(&mut sheet, app, ui));
    if is_open {
        app.dialogs.address = Some(sheet);
    }
}

/// Shows the contents of the sheet. Returns whether it stays open.
fn sheet_ui(sheet: &mut AddressSheet, app: &App, ui: &mut Ui) -> bool {
    let palette = theme::palette(ui.ctx());
    let is_reading = sheet.reading.is_some();
    ui.label(RichText::new("Image from the address of a camera").font(theme::medium(13.0)));
    let mut is_entered = false;
    ui.add_enabled_ui(!is_reading, |ui| {
        Grid::new("address").num_columns(2).spacing([12.0, 6.0]).show(ui, |ui| {
            let hint = "http://192.168.1.10/snapshot.jpg, or rtsp://\u{2026}";
            let address = field(ui, "Address", TextEdit::singleline(&mut sheet.address).hint_text(hint));
            if sheet.address.is_empty() && ui.memory(|memory| memory.focused().is_none()) {
                address.request_focus();
            }
            let user = field(ui, "User name", TextEdit::singleline(&mut sheet.user));
            let password = field(ui, "Password", TextEdit::singleline(&mut sheet.password).password(true));
            let camera = TextEdit::singleline(&mut sheet.camera).hint_text("the host of the address");
            let camera = field(ui, "Camera", camera);
            let fields = [address, user, password, camera];
            is_entered = fields.iter().any(egui::Response::lost_focus)
                && ui.input(|input| input.key_pressed(Key::Enter));
        });
        if sheet.address.trim_start().starts_with("https") {
            let text = "Accept a certificate that no authority has signed";
            ui.checkbox(&mut sheet.accepts_any_certificate, text).on_hover_text(
                "Usual for cameras in a local network. Anyone in this network could pose as the camera.",
            );
        }
    });
    let saved = match app.editor.session().path {
        Some(_) => "The image is saved in the folder of the site.",
        None => "The image is kept in the site.",
    };
    let text = format!("Name and password are sent only to this host and are not saved. {saved}");
    ui.label(RichText::new(text).small().color(palette.text2));
    if let Some(error) = &sheet.error {
        ui.label(RichText::new(error).color(palette.bad));
    }
    let mut is_open = true;
    ui.horizontal(|ui| {
        let is_ready = !is_reading && sheet.address.contains("://");
        let button = ui.add_enabled(is_ready, Button::new("Get the image"));
        let button =
            button.on_disabled_hover_text("Enter an address that begins with http://, https:// or rtsp://");
        if button.clicked() || is_ready && is_entered {
            sheet.read(ui.ctx());
        }
        is_open = !ui.button("Cancel").clicked();
        if sheet.reading.is_some() {
            ui.spinner();
            ui.label("Waiting for the camera\u{2026}");
        }
    });
    is_open
}

/// Shows a field with its label as a row of the grid.
fn field(ui: &mut Ui, name: &str, edit: TextEdit<'_>) -> egui::Response {
    let label = ui.label(name);
    let response = ui.add(edit.desired_width(340.0)).labelled_by(label.id);
    ui.end_row();
    response
}
