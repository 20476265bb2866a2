//! Widgets that several panels share: sections, headings and length fields. Also the window widths at which
//! the layout changes.

use calib_editor::Units;
use egui::accesskit::Live;
use egui::{Align2, DragValue, Frame, Margin, Response, RichText, Sense, Stroke, TextEdit, Ui, Vec2};

pub use calib_editor::number;
pub use calib_report::decimals;

use crate::theme;

/// Window width below which the panels are stacked, as on a phone, in points.
pub(crate) const PHONE: f32 = 640.0;

/// Window width below which the camera list is a rail and icons replace labels, in points.
pub(crate) const NARROW: f32 = 1000.0;

/// Gives a widget a description for screen readers, which is read after its name.
pub(crate) fn describe(response: &Response, text: &str) {
    response.ctx.accesskit_node_builder(response.id, |node| node.set_description(text));
}

/// Shows a section of a panel with a separator line below the section.
pub fn section(ui: &mut Ui, contents: impl FnOnce(&mut Ui)) {
    let palette = theme::palette(ui.ctx());
    Frame::NONE.inner_margin(Margin::symmetric(12, 8)).show(ui, |ui| {
        ui.set_width(ui.available_width());
        contents(ui);
    });
    let rect = ui.min_rect();
    ui.painter().hline(rect.x_range(), rect.bottom(), Stroke::new(1.0, palette.line));
}

/// Shows the heading of a section with a note on its right.
pub fn heading(ui: &mut Ui, text: &str, right: &str) {
    let palette = theme::palette(ui.ctx());
    ui.horizontal(|ui| {
        let title = ui.label(RichText::new(text).font(theme::medium(13.0)).color(palette.text));
        title.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Heading, true, text));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new(right).small().color(palette.text3));
        });
    });
}

/// Shows a field for a text. Returns the new text once the operator has entered it, without spaces at its ends. An
/// empty text and Escape keep the old text.
pub(crate) fn entered_text(
    ui: &mut Ui,
    salt: impl std::hash::Hash + std::fmt::Debug,
    text: &str,
    width: f32,
) -> (Response, Option<String>) {
    let salt = ui.scope_id().with(salt);
    let mut typed = ui.data(|data| data.get_temp::<String>(salt)).unwrap_or_else(|| text.to_owned());
    let response = ui.add(TextEdit::singleline(&mut typed).desired_width(width).char_limit(100));
    if response.has_focus() {
        ui.data_mut(|data| data.insert_temp(salt, typed));
        return (response, None);
    }
    ui.data_mut(|data| data.remove::<String>(salt));
    let is_dropped = ui.input(|input| input.key_pressed(egui::Key::Escape));
    let typed = typed.trim();
    let is_new = response.lost_focus() && !is_dropped && typed != text && !typed.is_empty();
    (response, is_new.then(|| typed.to_owned()))
}

/// Creates a field that shows a length in metres in the units of the site; `low` is the smallest length, in
/// metres.
pub fn length_field(units: Units, metres: &mut f64, low: f64) -> DragValue<'_> {
    /// Largest length, in the units of the site.
    const MAX_LENGTH: f64 = 1e5;
    let unit = units.metres();
    let parse = move |text: &str| Some(units.parse_length(text)? / unit);
    let exchange = move |typed: Option<f64>| {
        if let Some(typed) = typed {
            *metres = typed * unit;
        }
        *metres / unit
    };
    DragValue::from_get_set(exchange)
        .speed(0.01)
        .range(low / unit..=MAX_LENGTH)
        .suffix(format!(" {}", units.symbol()))
        .custom_parser(parse)
        .max_decimals(3)
        .update_while_editing(false)
}

/// Shows a row with the columns title, value, ± (one sigma) and unit.
pub(crate) fn cells(ui: &mut Ui, title: &str, value: &str, sigma: Option<String>, unit: &str) {
    let palette = theme::palette(ui.ctx());
    let width = (ui.available_width() - 26.0).max(120.0);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(width, 18.0), Sense::hover());
    let sure = sigma.as_ref().map_or_else(String::new, |sigma| format!(" \u{b1} {sigma}"));
    let words = format!("{title} {value}{sure} {unit}");
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, words.trim_end()));
    let painter = ui.painter();
    let middle = rect.center().y;
    let at = |x: f32| egui::pos2(x, middle);
    painter.text(at(rect.left()), Align2::LEFT_CENTER, title, theme::regular(12.0), palette.text2);
    let column = rect.right() - 76.0;
    painter.text(at(column), Align2::RIGHT_CENTER, value, theme::medium(12.0), palette.text);
    if let Some(sigma) = sigma {
        let text = format!("\u{b1} {sigma}");
        painter.text(
            at(rect.right() - 22.0),
            Align2::RIGHT_CENTER,
            text,
            theme::regular(12.0),
            palette.text2,
        );
    }
    painter.text(at(rect.right() - 18.0), Align2::LEFT_CENTER, unit, theme::regular(12.0), palette.text2);
}

/// Makes a widget a live region: screen readers read its text when it changes. An urgent text interrupts.
pub(crate) fn announce(response: &Response, is_urgent: bool) {
    let live = if is_urgent { Live::Assertive } else { Live::Polite };
    response.ctx.accesskit_node_builder(response.id, |node| node.set_live(live));
}
