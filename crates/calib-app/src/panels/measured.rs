//! A length that was measured: an empty field with today's estimate as a hint, and nothing until it is entered.

use calib_core::single::Known;
use calib_editor::Units;
use egui::{RichText, TextEdit, Ui};

use crate::panels::{length_field, number};
use crate::theme;

/// How sure a tape is unless the operator says otherwise, in metres.
pub(crate) const TAPE: f64 = 0.01;

/// A field for a length that is not known yet; the length in metres, once it was entered.
pub(crate) fn empty_field(
    ui: &mut Ui,
    salt: impl std::hash::Hash + std::fmt::Debug,
    label: egui::Id,
    units: Units,
    estimate: Option<f64>,
) -> Option<f64> {
    let id = ui.scope_id().with(salt);
    let mut typed: String = ui.data(|data| data.get_temp(id)).unwrap_or_default();
    let hint = estimate.map_or_else(
        || units.sign().to_owned(),
        |metres| format!("about {} {}", number(metres / units.metres(), 2), units.sign()),
    );
    let field = TextEdit::singleline(&mut typed).hint_text(hint).desired_width(92.0);
    let response = ui.add(field).labelled_by(label);
    let is_dropped = ui.input(|input| input.key_pressed(egui::Key::Escape));
    let entered = if response.lost_focus() && !is_dropped { metres_in(&typed, units) } else { None };
    if entered.is_some() || is_dropped {
        typed.clear();
    }
    ui.data_mut(|data| data.insert_temp(id, typed));
    entered
}

/// The metres that a text tells of; none of what is no length.
fn metres_in(text: &str, units: Units) -> Option<f64> {
    let text = text.trim().trim_end_matches(units.sign()).trim().replace(',', ".");
    let metres = text.parse::<f64>().ok()? * units.metres();
    (metres.is_finite() && (1e-3..1e5).contains(&metres)).then_some(metres)
}

/// Fields for a length that was measured and how sure it is. Whether it was changed.
pub(crate) fn known_fields(ui: &mut Ui, label: egui::Id, units: Units, known: &mut Known) -> bool {
    let mut changed = ui.add(length_field(units, &mut known.value, 1e-3)).labelled_by(label).changed();
    if known.fixed {
        return changed;
    }
    let sure = ui.label(RichText::new("\u{b1}").color(theme::palette(ui.ctx()).text3));
    let mut sigma = known.sigma.unwrap_or(TAPE);
    let field = length_field(units, &mut sigma, 1e-4);
    if ui.add(field).labelled_by(sure.id).on_hover_text("How sure: one sigma").changed() {
        (known.sigma, changed) = (Some(sigma), true);
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_read_as_it_is_written() {
        assert_eq!(metres_in(" 2,5 m", Units::Metres), Some(2.5));
        assert_eq!(metres_in("10", Units::Feet), Some(3.048));
        for text in ["", "about", "0", "-3", "nan"] {
            assert_eq!(metres_in(text, Units::Metres), None, "{text}");
        }
    }
}
