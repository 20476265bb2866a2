//! What an operator should know of a result, with what to do about it as a button.

use calib_core::{Code, Finding, Severity, Subject, Warning};
use calib_editor::{Action, Part};
use egui::{RichText, Ui};

use crate::command::Command;
use crate::icons::{self, Icon};
use crate::state::App;
use crate::theme;

/// The warnings of the camera in hand.
pub fn show(app: &mut App, ui: &mut Ui) {
    let warnings =
        app.editor.session().solution().map(|solution| solution.warnings.clone()).unwrap_or_default();
    let mut wish = None;
    for (index, warning) in warnings.iter().enumerate() {
        // The first is met first; the others keep their words until they are asked for.
        let is_first = index == 0 || warning.code == Code::Outlier;
        let message = app.editor.session().as_on_screen(app.editor.session().camera, warning);
        let shown = Warning { message, ..warning.clone() };
        card(ui, &shown, is_first, |ui| buttons(app, ui, warning, &mut wish));
    }
    if warnings.is_empty() && app.editor.session().solution().is_some() {
        let palette = theme::palette(ui.ctx());
        ui.horizontal(|ui| {
            icons::inline(ui, Icon::Check, palette.ok);
            ui.label(RichText::new("No warnings").color(palette.text2));
        });
    }
    if let Some((command, select)) = wish {
        app.send(Action::Drop);
        if let Some(part) = select {
            app.send(Action::Select(part));
            if command.is_none() {
                app.reveal(part);
            }
        }
        if let Some(command) = command {
            app.tell(command);
        }
    }
}

/// The warnings of the site as a whole.
pub fn site(app: &App, ui: &mut Ui) {
    let warnings = app.editor.session().solved.joint_report().map(|report| report.site.warnings.clone());
    for warning in warnings.unwrap_or_default() {
        card(ui, &warning, true, |_| {});
    }
}

fn card(ui: &mut Ui, warning: &Warning, is_whole: bool, more: impl FnOnce(&mut Ui)) {
    let palette = theme::palette(ui.ctx());
    let (fill, colour) = match warning.code.severity() {
        Severity::Error => (palette.bad_bg, palette.bad),
        Severity::Warning => (palette.warn_bg, palette.warn),
        Severity::Note => (palette.raised, palette.warn),
    };
    egui::Frame::NONE.fill(fill).corner_radius(4).inner_margin(8).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.horizontal_top(|ui| {
            icons::inline(ui, Icon::Warn, colour);
            ui.vertical(|ui| {
                if !is_whole {
                    let text = RichText::new(&warning.message);
                    ui.add(egui::Label::new(text).truncate())
                        .on_hover_text(format!("{}\n{}", warning.message, warning.advice));
                    return;
                }
                ui.label(RichText::new(&warning.message).font(theme::medium(12.0)));
                ui.label(RichText::new(&warning.advice).color(palette.text2));
                more(ui);
            });
        });
    });
    ui.add_space(4.0);
}

type Deed = (Option<Command>, Option<Part>);

fn buttons(app: &App, ui: &mut Ui, warning: &Warning, wish: &mut Option<Deed>) {
    match warning.code {
        Code::Outlier => {
            let session = app.editor.session();
            let finding = session.solved.finding(&session.site, session.camera, warning);
            let part = match finding.map(Finding::subject) {
                Some(Subject::Line(line)) => {
                    Some(Part::Line { annotation: line.annotation, segment: line.segment })
                }
                _ => None,
            };
            let part = part.or_else(|| first_outlier(app));
            ui.horizontal(|ui| {
                for (text, command) in [
                    ("Show", None),
                    ("Use anyway", Some(Command::UseAnyway)),
                    ("Delete", Some(Command::Delete)),
                ] {
                    if ui.button(text).clicked() {
                        *wish = Some((command, part));
                    }
                }
            });
        }
        Code::FocalUnobservable | Code::Weak | Code::Unusable | Code::TwoSolutions
            if app.is_enabled(Command::TakeSuggestion) && ui.button("Draw what helps   N").clicked() =>
        {
            *wish = Some((Some(Command::TakeSuggestion), None));
        }
        _ => {}
    }
}

fn first_outlier(app: &App) -> Option<Part> {
    let residual = app.editor.session().solution()?.residuals.iter().find(|r| r.outlier)?;
    Some(Part::Line { annotation: residual.annotation?, segment: residual.segment? })
}

/// An error that concerns the document.
pub fn error(app: &mut App, ui: &mut Ui) {
    let Some(error) = app.editor.error().map(str::to_owned) else { return };
    let palette = theme::palette(ui.ctx());
    let (mut close, mut save) = (false, false);
    egui::Frame::NONE.fill(palette.bad_bg).inner_margin(12).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.label(RichText::new(error).color(palette.bad));
        ui.horizontal(|ui| {
            close = ui.button("Close").clicked();
            save = !app.editor.session().is_saved() && ui.button("Save the site").clicked();
        });
    });
    if save {
        app.tell(Command::Save);
    }
    if close {
        app.send(Action::CloseError);
    }
}
