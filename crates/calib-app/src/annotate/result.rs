//! Panel: the result with its uncertainty and a lock for every number, and fields for measured lengths.

use calib_core::Kind;
use calib_core::camera::{Coefficient, Pixel};
use calib_core::floor::view_angle;
use calib_core::single::Known;
use calib_editor::{Action, TOOLS, Units};
use calib_site::{LensEntry, Sigmas, Solution, Stage};
use egui::{Align2, DragValue, Rect, RichText, Sense, TextEdit, Ui, Vec2};

use crate::focus::{self, RequestedField};
use crate::icons::{self, Icon, Look};
use crate::state::App;
use crate::theme;
use crate::widgets::{cells, decimals, heading, length_field, number};

/// Default standard deviation of a tape measurement, in metres.
pub(crate) const TAPE: f64 = 0.01;

/// Shows an empty field for a length, with an estimate as a hint. Returns the length in metres once the operator has
/// entered it. The field gets the focus if it is the field `requested` and its focus was requested.
pub(crate) fn empty_field(
    ui: &mut Ui,
    salt: impl std::hash::Hash + std::fmt::Debug,
    label: egui::Id,
    units: Units,
    estimate: Option<f64>,
    requested: Option<RequestedField>,
) -> Option<f64> {
    let id = ui.scope_id().with(salt);
    let mut typed: String = ui.data(|data| data.get_temp(id)).unwrap_or_default();
    let hint = estimate.map_or_else(
        || units.symbol().to_owned(),
        |metres| format!("about {} {}", number(metres / units.metres(), 2), units.symbol()),
    );
    let field = TextEdit::singleline(&mut typed).hint_text(hint).desired_width(92.0);
    let response = ui.add(field).labelled_by(label);
    if let Some(requested) = requested {
        focus::focus_if_requested(&response, requested);
    }
    focus::set_blank(&response, typed.trim().is_empty());
    let is_dropped = ui.input(|input| input.key_pressed(egui::Key::Escape));
    let entered = if response.lost_focus() && !is_dropped { metres_in(&typed, units) } else { None };
    if entered.is_some() || is_dropped {
        typed.clear();
    }
    ui.data_mut(|data| data.insert_temp(id, typed));
    entered
}

/// Parses a length in the units of the site, or with its unit; returns metres, or `None` for invalid text.
fn metres_in(text: &str, units: Units) -> Option<f64> {
    units.parse_length(text).filter(|metres| (1e-3..1e5).contains(metres))
}

/// Shows fields for a measured length and its standard deviation; returns whether one of them was changed.
pub(crate) fn known_fields(ui: &mut Ui, label: egui::Id, units: Units, known: &mut Known) -> bool {
    let mut changed = ui.add(length_field(units, &mut known.value, 1e-3)).labelled_by(label).changed();
    if known.fixed {
        return changed;
    }
    let sure = ui.label(RichText::new("\u{b1}").color(theme::palette(ui.ctx()).text3));
    let mut sigma = known.sigma.unwrap_or(TAPE);
    let field = length_field(units, &mut sigma, 1e-4);
    if ui.add(field).labelled_by(sure.id).on_hover_text("Standard deviation (\u{b1})").changed() {
        (known.sigma, changed) = (Some(sigma), true);
    }
    changed
}

/// Quantity of the result that the operator can fix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Number {
    Focal,
    Pitch,
    Roll,
    Height,
}

/// Quantities in the order of the panel.
const NUMBERS: [Number; 4] = [Number::Focal, Number::Pitch, Number::Roll, Number::Height];

impl Number {
    const fn title(self) -> &'static str {
        match self {
            Self::Focal => "Focal",
            Self::Pitch => "Pitch",
            Self::Roll => "Roll",
            Self::Height => "Height",
        }
    }

    /// Returns the name of the quantity within a sentence.
    const fn noun(self) -> &'static str {
        match self {
            Self::Focal => "focal length",
            Self::Pitch => "pitch",
            Self::Roll => "roll",
            Self::Height => "height",
        }
    }

    /// Returns the symbol of the display unit, and its size in the unit of the site file.
    const fn unit(self, units: Units) -> (&'static str, f64) {
        match self {
            Self::Focal => ("px", 1.0),
            Self::Pitch | Self::Roll => ("\u{b0}", 1.0),
            Self::Height => (units.symbol(), units.metres()),
        }
    }

    /// Returns the value of the quantity and its sigma, both in the unit of the site file. Returns `None` if the
    /// solution does not contain the quantity. The sigma is `None` if it is unknown.
    fn value_and_sigma(self, solution: &Solution) -> Option<(f64, Option<f64>)> {
        let sigma = solution.sigma.as_ref();
        Some(match self {
            Self::Focal => (solution.focal_px, sigma.and_then(|s| s.focal_px)),
            Self::Pitch => (solution.pitch_deg?, sigma.and_then(|s| s.pitch_deg)),
            Self::Roll => (solution.roll_deg?, sigma.and_then(|s| s.roll_deg)),
            Self::Height => (solution.position_m?.z, sigma.and_then(|s| s.z_m)),
        })
    }

    /// Returns the entry of the current camera for this quantity: fixed, a prior, or `None`.
    pub(crate) fn known(self, app: &App) -> Option<Known> {
        let entry = app.editor.session().entry()?;
        let lens = entry.lens.as_ref();
        match self {
            Self::Focal => lens?.focal_px,
            Self::Pitch => lens?.pitch_deg,
            Self::Roll => lens?.roll_deg,
            Self::Height => entry.height_m,
        }
    }

    /// Changes the entry of the current camera for this quantity; `None` removes the entry.
    pub(crate) fn set(self, app: &mut App, known: Option<Known>) {
        let verb = match known {
            Some(known) if known.fixed => "fix",
            Some(_) => "set a prior for",
            None => "unfix",
        };
        let name = format!("{verb} the {}", self.noun());
        let change = |lens: &mut LensEntry| match self {
            Self::Focal => lens.focal_px = known,
            Self::Pitch => lens.pitch_deg = known,
            Self::Roll | Self::Height => lens.roll_deg = known,
        };
        if self == Self::Height {
            app.send(Action::Height { known, name });
        } else {
            app.change_lens(&name, change);
        }
    }
}

/// Shows the panel of results.
pub(crate) fn result_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let solution = app.editor.session().solution().cloned();
    let Some(solution) = solution else {
        heading(ui, "Result", "");
        if let Some(Err(failure)) = app.editor.session().solved.result(app.editor.session().camera) {
            ui.label(RichText::new(&failure.message).color(palette.text));
            ui.label(RichText::new(&failure.advice).color(palette.text2));
        }
        return;
    };
    let lines = calib_site::counted(solution.residuals.len(), "line", "lines");
    let rms = solution.rms_px.map_or_else(String::new, |rms| format!("RMS {rms:.1} px, {lines}"));
    heading(ui, "Result", &rms);
    for which in NUMBERS {
        orientation_row(app, ui, &solution, which);
        if which == Number::Focal {
            view_row(app, ui, &solution);
        }
    }
    lens_row(ui, &solution);
    centre_row(ui, &solution);
    let is_scaled = app.editor.session().solved.scale_is_known(app.editor.session().camera);
    floor_row(ui, &solution, is_scaled);
    if !is_scaled && let Some(tool) = scale_menu(ui) {
        app.send(Action::SelectTool(tool));
    }
}

/// Shows a menu of annotations that determine the scale; returns the index of the tool for the chosen annotation.
fn scale_menu(ui: &mut Ui) -> Option<usize> {
    let mut chosen = None;
    ui.menu_button("Draw a person, a door or a known length\u{2026}", |ui| {
        let rows = [
            ("Person or door, from bottom to top", Kind::Upright),
            ("Known length on the floor", Kind::KnownLength),
        ];
        for (text, kind) in rows {
            if ui.button(text).clicked() {
                chosen = TOOLS.iter().position(|tool| tool.kind == Some(kind));
                ui.close();
            }
        }
    })
    .response
    .on_hover_text(
        "The scale is not determined yet. Lengths are known only as multiples of the camera height.",
    );
    chosen
}

/// Shows the principal point if it was estimated.
fn centre_row(ui: &mut Ui, solution: &Solution) {
    let Some(Sigmas { cx_px: Some(cx), cy_px: Some(cy), .. }) = solution.sigma else { return };
    let Pixel { u, v } = solution.principal_point_px;
    let row = ui.horizontal(|ui| {
        let at = format!("{}, {}", number(u, 0), number(v, 0));
        let sigma = number(cx.max(cy), 0);
        cells(ui, "Principal point", &at, Some(sigma), "px");
    });
    row.response.on_hover_text(
        "The \u{b1} values of focal length, pitch and heights include the uncertainty of the principal \
         point. To reduce them, draw lines in a third direction, or enter the principal point in Known \
         values.",
    );
}

/// Shows a quantity of the result. For a camera that looks straight down, pitch and roll are undetermined. The angle
/// from the vertical and the direction of the image top replace them.
pub(crate) fn orientation_row(app: &mut App, ui: &mut Ui, solution: &Solution, which: Number) {
    let down = solution.camera().and_then(|camera| camera.straight_down());
    // A quantity with an entry keeps its row, so that the operator can remove the entry.
    let Some(down) = down.filter(|_| which.known(app).is_none()) else {
        return number_row(app, ui, solution, which);
    };
    match which {
        Number::Focal | Number::Height => number_row(app, ui, solution, which),
        Number::Pitch => down_cells(ui, "Off vertical", down.tilt, down.tilt_sigma),
        Number::Roll if solution.stage >= Stage::Placed => {
            down_cells(ui, TOP, down.heading, down.heading_sigma);
        }
        // The rotation about the vertical is shown with the placement.
        Number::Roll => {}
    }
}

/// Label for the direction of the image top on the plan.
pub(crate) const TOP: &str = "Image top";

fn down_cells(ui: &mut Ui, title: &str, angle: f64, sigma: Option<f64>) {
    let sigma = sigma.map(f64::to_degrees);
    let shown = sigma.map_or(2, decimals).min(3);
    ui.horizontal(|ui| {
        cells(ui, title, &number(angle.to_degrees(), shown), sigma.map(|s| number(s, shown)), "\u{b0}");
    });
}

/// Shows a quantity with its sigma and its lock.
fn number_row(app: &mut App, ui: &mut Ui, solution: &Solution, which: Number) {
    let Some((value, sigma)) = which.value_and_sigma(solution) else { return };
    let known = which.known(app);
    let unit = which.unit(app.editor.session().site.units);
    let [to, from] = [1.0 / unit.1, unit.1];
    let shown = (to * value, sigma.map(|sigma| to * sigma));
    let is_assumed = !app.editor.session().solved.scale_is_known(app.editor.session().camera);
    let title = if which == Number::Height && is_assumed { "Height, assumed" } else { which.title() };
    if let Some(new) = row(ui, (which, title), shown, unit.0, known.map(|known| scaled(known, to))) {
        which.set(app, new.map(|known| scaled(known, from)));
    }
}

/// Rounds a number that the operator fixes. `digits` is the number of displayed decimals; one more decimal is kept.
pub(crate) fn held_at(value: f64, digits: usize) -> f64 {
    let digits = 10_f64.powi(digits as i32 + 1);
    (value * digits).round() / digits
}

/// Shows the lock of a quantity; returns whether the lock was clicked. `is_held` is true for a fixed
/// quantity, false for a prior, otherwise `None`.
pub(crate) fn lock(ui: &mut Ui, title: &str, is_held: Option<bool>, tip: &str) -> bool {
    let palette = theme::palette(ui.ctx());
    let (icon, colour, verb) = match is_held {
        Some(true) => (Icon::Locked, palette.accent, "Unfix"),
        Some(false) => (Icon::Locked, palette.warn, "Unfix"),
        None => (Icon::Unlocked, palette.text3, "Fix"),
    };
    let look = Look { size: Vec2::splat(18.0), colour: Some(colour), ..Look::default() };
    icons::button(ui, icon, &format!("{verb} the {title}"), tip, look).clicked()
}

/// Multiplies value and sigma by a factor, to convert their unit.
fn scaled(known: Known, by: f64) -> Known {
    Known { value: by * known.value, sigma: known.sigma.map(|sigma| by * sigma), ..known }
}

/// Shows value, sigma, unit and lock; returns the new entry if the lock was clicked or a field changed.
fn row(
    ui: &mut Ui,
    (which, title): (Number, &str),
    (value, sigma): (f64, Option<f64>),
    unit: &str,
    known: Option<Known>,
) -> Option<Option<Known>> {
    let shown = sigma.map_or(2, decimals).min(3);
    let mut change = None;
    ui.horizontal(|ui| {
        cells(ui, title, &number(value, shown), sigma.map(|s| number(s, shown)), unit);
        let title = which.noun();
        let tip = match known {
            None if unit == "\u{b0}" => format!("Fix the {title} at {}{unit}", number(value, shown)),
            None => format!("Fix the {title} at {} {unit}", number(value, shown)),
            Some(_) => format!("Estimate the {title} from the lines"),
        };
        if lock(ui, title, known.map(|known| known.fixed), &tip) {
            change = Some(known.is_none().then(|| Known::fixed(held_at(value, shown))));
        }
    });
    if let Some(known) = known {
        fields(ui, which, unit, known, &mut change);
    }
    change
}

/// Shows fields for value and sigma of a fixed number or a prior.
fn fields(ui: &mut Ui, which: Number, unit: &str, known: Known, change: &mut Option<Option<Known>>) {
    let palette = theme::palette(ui.ctx());
    ui.horizontal(|ui| {
        ui.add_space(12.0);
        let speed = if which == Number::Focal { 1.0 } else { 0.05 };
        let mut value = known.value;
        let response =
            ui.add(DragValue::new(&mut value).speed(speed).max_decimals(4).update_while_editing(false));
        let label = format!("Value of the {}", which.noun());
        response.widget_info(|| egui::WidgetInfo::drag_value(true, value));
        let response = response.on_hover_text(&label);
        ui.label(RichText::new(unit).color(palette.text3));
        let mut fixed = known.fixed;
        let held = ui.checkbox(&mut fixed, "fixed");
        let mut sigma = known.sigma.unwrap_or(0.05 * known.value.abs().max(1.0));
        let mut typed = false;
        if !fixed {
            ui.label(RichText::new("\u{b1}").color(palette.text3));
            let field = DragValue::new(&mut sigma).speed(0.1 * speed).range(1e-6..=1e6).max_decimals(4);
            typed = ui
                .add(field.update_while_editing(false))
                .on_hover_text("Standard deviation (\u{b1})")
                .changed();
        }
        if response.changed() || held.changed() || typed {
            let new = if fixed { Known::fixed(value) } else { Known::prior(value, sigma) };
            *change = Some(Some(new));
        }
    });
}

fn view_row(app: &App, ui: &mut Ui, solution: &Solution) {
    let Some(entry) = app.editor.session().entry() else { return };
    let (lens, size) = (solution.lens(), entry.size());
    let view = |focal: f64| view_angle(&lens, focal, size).to_degrees();
    let hfov = view(solution.focal_px);
    // The field of view of a fisheye depends on more than its focal length.
    let is_wide = lens.distortion.is_wide();
    let sigma = solution.sigma.as_ref().and_then(|s| s.focal_px).filter(|_| !is_wide);
    let spread = sigma.map(|s| 0.5 * (view(solution.focal_px - s) - view(solution.focal_px + s)).abs());
    let shown = spread.map_or(1, decimals).min(2);
    ui.horizontal(|ui| {
        cells(ui, "Horizontal FOV", &number(hfov, shown), spread.map(|s| number(s, shown)), "\u{b0}");
    });
}

fn lens_row(ui: &mut Ui, solution: &Solution) {
    let Some(distortion) = &solution.distortion else { return };
    // Tangential coefficients are too small for the three decimals of the row.
    let is_shown = |which: &Coefficient| !matches!(which, Coefficient::P1 | Coefficient::P2);
    let value = |which| distortion.coefficient(which).filter(|value| *value != 0.0);
    let used: Vec<(&str, f64)> = Coefficient::ALL
        .into_iter()
        .filter(is_shown)
        .filter_map(|which| Some((which.title(), value(which)?)))
        .collect();
    // Each row has as many coefficients as the column has room for.
    for row in used.chunks(2) {
        let names: Vec<&str> = row.iter().map(|(name, _)| *name).collect();
        let values: Vec<String> = row.iter().map(|(_, value)| number(*value, 3)).collect();
        ui.horizontal(|ui| cells(ui, &names.join(", "), &values.join(", "), None, ""));
    }
}

/// Shows the relative standard deviation of lengths on the floor, in percent. While the scale is unknown, it applies
/// only to the ratio of two lengths.
fn floor_row(ui: &mut Ui, solution: &Solution, is_scaled: bool) {
    let palette = theme::palette(ui.ctx());
    let Some(rel) = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel) else { return };
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 26.0), Sense::hover());
    // An error of 100 % or more counts as unknown.
    let text = if rel < 1.0 { format!("\u{b1} {:.1} %", 100.0 * rel) } else { "unknown".into() };
    let title = if is_scaled { "Length on the floor" } else { "Ratio of floor lengths" };
    let words = format!("{title} {text}");
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, &words));
    ui.painter().rect_filled(rect, 4.0, palette.raised);
    let inner: Rect = rect.shrink2(Vec2::new(8.0, 0.0));
    let colour = if rel > 0.03 { palette.warn } else { palette.text };
    let painter = ui.painter();
    painter.text(inner.left_center(), Align2::LEFT_CENTER, title, theme::regular(12.0), palette.text);
    painter.text(inner.right_center(), Align2::RIGHT_CENTER, text, theme::medium(12.0), colour);
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
