//! Panel with the automatic calibration of an image: its confidence, and its groups of lines to accept, flip
//! or delete.

use calib_core::Kind;
use calib_editor::{Action, CalibrationDecision, Hypothesis, PendingCalibration, PendingGroup, TOOLS};
use calib_image::{Confidence, EdgeClass};
use calib_site::counted;
use egui::{Color32, ComboBox, RichText, Ui, WidgetInfo};

use crate::command::Command;
use crate::icons::{self, Icon};
use crate::keys;
use crate::state::{App, AutomaticRow, Mode, RowPlacement};
use crate::theme;
use crate::widgets::{heading, section};

/// Shows the panel while an automatic calibration waits for a decision.
pub fn propose_ui(app: &mut App, ui: &mut Ui) {
    app.editor.find_preview();
    let Some(proposed) = app.shown_proposal().cloned() else { return };
    let mut wish = None;
    section(ui, |ui| {
        heading(ui, "Automatic calibration", &counted(proposed.count(), "line", "lines"));
        judgement(app, ui, &proposed);
        hypotheses(app, ui, &proposed, &mut wish);
        whole(app, ui, &proposed);
        let next = app.editor.preview().and_then(|preview| preview.next);
        let picked = app.editor.session().picked_line().map(|(group, _)| group);
        for (index, group) in proposed.groups.iter().enumerate() {
            let row = Row {
                index,
                group,
                directions: &proposed.directions(),
                is_next: next == Some(index) && proposed.groups.len() > 1,
                is_picked: picked == Some(index),
            };
            if row.show(ui, &mut wish) {
                app.hover.lit_group = Some(index);
            }
        }
    });
    if let Some(wish) = wish {
        app.send(Action::DecideCalibration(wish));
    }
}

/// Shows the result of the automatic calibration and placement of all cameras.
pub(crate) fn report_ui(app: &mut App, ui: &mut Ui) {
    let Some(report) = app.dialogs.automatic.take() else { return };
    let (mut is_closed, mut chosen, mut shows_plan) = (false, None, false);
    section(ui, |ui| {
        let rows = report.rows.iter().filter(|row| row.calibration.is_some() || row.placement.is_some());
        heading(ui, "All cameras", &counted(rows.clone().count(), "camera", "cameras"));
        for row in rows {
            if report_row(ui, row) {
                chosen = row.of.index(app.editor.site());
            }
        }
        if !report.summary.is_empty() {
            ui.label(format!("Positions: {}.", report.summary));
        }
        ui.horizontal_wrapped(|ui| {
            let is_placed = |row: &AutomaticRow| matches!(row.placement, Some((RowPlacement::Placed, _)));
            if report.rows.iter().any(is_placed) && app.view.mode != Mode::Plan {
                shows_plan = ui.button("Show on the plan").clicked();
            }
            is_closed = ui.button("Close").clicked();
        });
    });
    if !is_closed {
        app.dialogs.automatic = Some(report);
    }
    if let Some(camera) = chosen {
        app.send(Action::CancelGesture);
        app.send(Action::SelectCamera(camera));
        app.show(Mode::Image);
    }
    if shows_plan {
        app.show(Mode::Plan);
    }
}

/// Shows the result of one camera; returns whether its name was clicked.
fn report_row(ui: &mut Ui, row: &AutomaticRow) -> bool {
    let palette = theme::palette(ui.ctx());
    let confidence = row.calibration.as_ref().map(|(confidence, _)| *confidence);
    let is_calibrated = confidence.is_none_or(|confidence| confidence != Confidence::None);
    let calibrated = confidence.map(|confidence| match confidence {
        Confidence::Sure => "calibrated",
        Confidence::Check => "probably calibrated",
        Confidence::None => "not calibrated",
    });
    let placement = row.placement.as_ref().filter(|_| is_calibrated);
    let placed = placement.map(|(placement, _)| match placement {
        RowPlacement::Placed => "probably placed",
        RowPlacement::Kept => "already placed",
        RowPlacement::Unknown => "not placed",
    });
    let is_certain = confidence.is_none_or(|confidence| confidence == Confidence::Sure)
        && placement.is_none_or(|(placement, _)| *placement == RowPlacement::Kept);
    let (icon, colour) = if is_certain { (Icon::Check, palette.ok) } else { (Icon::Warn, palette.warn) };
    let name = ui
        .horizontal_wrapped(|ui| {
            icons::inline(ui, icon, colour);
            let name = ui.link(RichText::new(&row.of.camera).font(theme::medium(12.0)));
            let words: Vec<&str> = calibrated.into_iter().chain(placed).collect();
            ui.label(RichText::new(words.join(", ")).color(palette.text2));
            name
        })
        .inner;
    let reasons = [row.calibration.as_ref().map(|(_, why)| why), placement.map(|(_, why)| why)];
    for why in reasons.into_iter().flatten().filter(|why| !why.is_empty()) {
        ui.label(RichText::new(sentence(why)).small().color(palette.text2));
    }
    name.on_hover_text("Show this camera").clicked()
}

/// Shows the confidence of the automatic calibration and its reason.
fn judgement(app: &App, ui: &mut Ui, proposed: &PendingCalibration) {
    let palette = theme::palette(ui.ctx());
    let solution = app.editor.preview().and_then(|preview| preview.solution.as_ref());
    let focal = solution.map(|solution| {
        let sigma = solution.sigma.as_ref().and_then(|sigma| sigma.focal_px);
        let sure = sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {sigma:.0}"));
        format!("focal {:.0}{sure} px", solution.focal_px)
    });
    let (fill, colour, icon, words) = match proposed.confidence {
        Confidence::Sure => (palette.raised, palette.ok, Icon::Check, "Sure"),
        Confidence::Check => (palette.warn_bg, palette.warn, Icon::Warn, "Check this result"),
        Confidence::None if proposed.alternative.is_some() => {
            (palette.warn_bg, palette.warn, Icon::Warn, "Two possible solutions")
        }
        Confidence::None => (palette.bad_bg, palette.bad, Icon::Warn, "The camera could not be calibrated"),
    };
    let words = match focal.filter(|_| proposed.confidence != Confidence::None) {
        Some(focal) => format!("{words}: {focal}"),
        None => words.to_owned(),
    };
    egui::Frame::NONE.fill(fill).corner_radius(4).inner_margin(8).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.horizontal_top(|ui| {
            icons::inline(ui, icon, colour);
            ui.vertical(|ui| {
                ui.label(RichText::new(words).font(theme::medium(12.0)));
                for reason in &proposed.reasons {
                    ui.label(RichText::new(sentence(&reason.to_string())).color(palette.text2));
                }
            });
        });
    });
    ui.add_space(4.0);
}

/// Shows the choice between two solutions that explain the edges equally well. The operator compares them with the
/// image.
fn hypotheses(app: &App, ui: &mut Ui, proposed: &PendingCalibration, wish: &mut Option<CalibrationDecision>) {
    let entry = app.editor.session().entry();
    let (Some(own), Some(other), Some(entry)) = (&proposed.orientation, &proposed.alternative, entry) else {
        return;
    };
    ui.label("Which solution is correct?");
    ui.horizontal_wrapped(|ui| {
        for (orientation, other) in [(own, false), (&other.orientation, true)] {
            let words = Hypothesis::description(orientation, entry.size()[0]);
            let tip = format!("Use this solution (focal length {:.0} px)", orientation.focal);
            if ui.button(words).on_hover_text(tip).clicked() {
                *wish = Some(CalibrationDecision::Decide { other });
            }
        }
    });
    ui.add_space(4.0);
}

/// Returns a text with a capital first letter and a full stop.
fn sentence(words: &str) -> String {
    let mut letters = words.chars();
    let first = letters.next().map(|first| first.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

/// Table row of a group of lines with the same direction.
struct Row<'a> {
    index: usize,
    group: &'a PendingGroup,
    directions: &'a [String],
    is_next: bool,
    is_picked: bool,
}

impl Row<'_> {
    /// Shows the row; returns whether the pointer is over the row.
    fn show(&self, ui: &mut Ui, wish: &mut Option<CalibrationDecision>) -> bool {
        let palette = theme::palette(ui.ctx());
        let fill = if self.is_picked { palette.accent_bg } else { Color32::TRANSPARENT };
        let frame = egui::Frame::NONE.fill(fill).corner_radius(4).inner_margin(egui::Margin::symmetric(4, 3));
        let shown = frame.show(ui, |ui| {
            ui.set_width(ui.available_width());
            self.title(ui);
            ui.horizontal_wrapped(|ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                self.buttons(ui, wish);
            });
        });
        ui.rect_contains_pointer(shown.response.rect)
    }

    fn title(&self, ui: &mut Ui) {
        let palette = theme::palette(ui.ctx());
        let tool = TOOLS.iter().find(|tool| tool.kind == Some(self.group.kind));
        let icon = tool.map_or(Icon::Vertical, |tool| tool.icon.into());
        let is_narrow = ui.available_width() < 220.0;
        ui.horizontal(|ui| {
            icons::inline(ui, icon, theme::kind_icon(self.group.kind, ui.visuals().dark_mode));
            let name = RichText::new(capital(self.group.title())).font(theme::medium(12.0));
            ui.label(name);
            if self.is_next {
                ui.label(RichText::new("matters most").small().color(palette.accent))
                    .on_hover_text("Accepting this group reduces the floor error the most");
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let count = self.group.lines.len();
                // A narrow panel shows the number without its noun.
                let noun = match (is_narrow, count) {
                    (true, _) => "",
                    (false, 1) => " line",
                    (false, _) => " lines",
                };
                let label = ui.label(RichText::new(format!("{count}{noun}")).color(palette.text2));
                if self.group.kind != Kind::Straight {
                    let share = 100.0 * self.group.probability();
                    let lying = |so: EdgeClass, words: &str| match self.group.count_of_class(so) {
                        0 => String::new(),
                        count => format!("; {} {words}", counted(count, "line", "lines")),
                    };
                    label.on_hover_text(format!(
                        "Mean probability that a line belongs to this group: {share:.0} %{}{}",
                        lying(EdgeClass::Floor, "probably on the floor"),
                        lying(EdgeClass::Above, "above the floor")
                    ));
                }
            });
        });
    }

    fn buttons(&self, ui: &mut Ui, wish: &mut Option<CalibrationDecision>) {
        let title = self.group.title();
        let mut button = |ui: &mut Ui, word: &str, tip: &str, action: CalibrationDecision| {
            let response = ui.small_button(word);
            let name = format!("{word}: {title}");
            response.widget_info(|| WidgetInfo::labeled(egui::Role::Button, true, &name));
            if response.on_hover_text(tip).clicked() {
                *wish = Some(action);
            }
        };
        button(ui, "Accept", "Add these lines", CalibrationDecision::Accept(self.index));
        match self.group.kind {
            Kind::Vertical => {
                let tip = "Change these lines to floor lines";
                button(ui, "To floor lines", tip, CalibrationDecision::Flip(self.index));
            }
            Kind::Parallel => {
                let tip = "Change these lines to verticals";
                button(ui, "To verticals", tip, CalibrationDecision::Flip(self.index));
            }
            _ => {}
        }
        button(ui, "Delete", "Remove these lines", CalibrationDecision::Delete(self.index));
        // Only the selected row shows the choice of directions.
        if self.group.kind == Kind::Parallel && self.is_picked {
            self.direction(ui, wish);
        }
    }

    /// Shows the choice of the floor direction of the group.
    fn direction(&self, ui: &mut Ui, wish: &mut Option<CalibrationDecision>) {
        let mut chosen = self.group.direction.clone();
        let salt = ui.scope_id().with(("direction", self.index));
        let menu = ComboBox::from_id_salt(salt).width(64.0).selected_text(self.group.direction.as_str());
        let response = menu.show_ui(ui, |ui| {
            for direction in self.directions {
                ui.selectable_value(&mut chosen, direction.clone(), direction);
            }
        });
        response.response.on_hover_text("Floor direction of these lines");
        if chosen != self.group.direction {
            *wish = Some(CalibrationDecision::SetDirection(self.index, chosen));
        }
    }
}

fn capital(words: &str) -> String {
    sentence(words).trim_end_matches('.').to_owned()
}

/// Shows the buttons that accept or discard the whole automatic calibration.
fn whole(app: &mut App, ui: &mut Ui, proposed: &PendingCalibration) {
    ui.horizontal_wrapped(|ui| {
        let is_offered = proposed.confidence != Confidence::None && !proposed.groups.is_empty();
        if is_offered
            && ui
                .button(keys::shown(ui.ctx(), "Accept all   Enter"))
                .on_hover_text("Add all detected lines")
                .clicked()
        {
            app.send_command(Command::AcceptProposed);
        }
        if ui
            .button(keys::shown(ui.ctx(), "Discard   Esc"))
            .on_hover_text("Remove all detected lines")
            .clicked()
        {
            app.send_command(Command::DismissProposed);
        }
    });
}
