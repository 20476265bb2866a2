//! Sheet that adds an image from the address of a camera.

use egui::text_edit::TextEditState;
use egui::{Align2, Button, Context, Grid, Id, Key, RichText, ScrollArea, TextEdit, Ui, Vec2, Window};

use crate::state::{AddressSheet, App};
use crate::theme;
use crate::widgets::announce;

/// Shows the sheet, and adds the image once it is read.
pub(crate) fn address_ui(app: &mut App, ctx: &Context) {
    let Some(mut sheet) = app.dialogs.address.take() else { return };
    if let Some((file, pixel_aspect)) = sheet.poll(app, ctx) {
        if app.editor.session().path.is_some() && file.path.is_none() {
            app.report_unwritten(&file, "site");
        }
        app.add_named_still(ctx, file, sheet.name(), pixel_aspect);
        return;
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

/// Fields of the sheet, in their order.
const FIELDS: [&str; 4] = ["Address", "User name", "Password", "Camera"];

/// Returns the id of a field.
fn field_id(name: &str) -> Id {
    Id::unique(("address of a camera", name))
}

/// Shows the contents of the sheet. Returns whether it stays open.
fn sheet_ui(sheet: &mut AddressSheet, app: &App, ui: &mut Ui) -> bool {
    let palette = theme::palette(ui.ctx());
    // The first pass of a window only measures it, and its widgets cannot have the focus.
    if !ui.is_sizing_pass() && !std::mem::replace(&mut sheet.is_shown, true) {
        // The undo history of a field would contain the password of an earlier sheet.
        FIELDS.iter().for_each(|name| TextEditState::default().store(ui.ctx(), field_id(name)));
        ui.memory_mut(|memory| memory.request_focus(field_id(FIELDS[0])));
    }
    ui.label(RichText::new("Image from the address of a camera").font(theme::medium(13.0)));
    let mut is_entered = false;
    let is_waiting = sheet.request.is_some();
    ui.add_enabled_ui(!is_waiting, |ui| {
        let hints =
            ["http://192.168.1.10/snapshot.jpg, or rtsp://\u{2026}", "", "", "default: host of the address"];
        Grid::new("address").num_columns(2).spacing([12.0, 6.0]).show(ui, |ui| {
            let texts = [&mut sheet.address, &mut sheet.user, &mut sheet.password, &mut sheet.camera];
            for ((name, text), hint) in FIELDS.into_iter().zip(texts).zip(hints) {
                let edit = TextEdit::singleline(text).hint_text(hint).password(name == "Password");
                let has_left = field(ui, name, edit).lost_focus();
                is_entered |= has_left && ui.input(|input| input.key_pressed(Key::Enter));
            }
        });
        if sheet.address.trim_start().to_ascii_lowercase().starts_with("https") {
            let text = "Accept any certificate";
            ui.checkbox(&mut sheet.accepts_any_certificate, text).on_hover_text(
                "Cameras often have certificates that no authority has signed. With this option, anyone on the network can pose as the camera.",
            );
        }
    });
    let saved = match app.editor.session().path {
        Some(_) => "The image is saved in the folder of the site.",
        None => "The image is kept in the site.",
    };
    let text = format!("The user name and password are sent only to this host and are not saved. {saved}");
    ui.label(RichText::new(text).small().color(palette.text2));
    if let Some(error) = &sheet.error {
        ScrollArea::vertical().max_height(120.0).show(ui, |ui| {
            announce(&ui.label(RichText::new(error).color(palette.bad)), true);
        });
    }
    let mut is_open = true;
    ui.horizontal(|ui| {
        let has_address = sheet.address.contains("://");
        let button = ui.add_enabled(has_address && !is_waiting, Button::new("Get the image"));
        let hint = match is_waiting {
            true => "Waiting for the camera",
            false => "Enter an address that begins with http://, https:// or rtsp://",
        };
        if button.on_disabled_hover_text(hint).clicked() || has_address && is_entered {
            sheet.read(ui.ctx());
        }
        is_open = !ui.button("Cancel").clicked();
        if is_waiting {
            ui.spinner();
            ui.label("Waiting for the camera\u{2026}");
        }
    });
    is_open
}

/// Shows a field with its label as a row of the grid.
fn field(ui: &mut Ui, name: &str, edit: TextEdit<'_>) -> egui::Response {
    let label = ui.label(name);
    let response = ui.add(edit.desired_width(340.0).id(field_id(name))).labelled_by(label.id);
    ui.end_row();
    response
}
