//! What a right click or a long press on a canvas offers: first what can be done to what is under it.

use calib_editor::{Action, Pane};
use egui::{Popup, Response, RichText};

use crate::canvas::Mapping;
use crate::command::Command;
use crate::menu;
use crate::state::{App, Place};
use crate::theme;

const ON_PLAN: [&[Command]; 3] = [
    &[Command::FixPlacement, Command::ResetPlacement, Command::Refine],
    &[Command::Coverage, Command::Blend, Command::Snap, Command::Beside],
    &[Command::Fit, Command::SavePicture],
];
const ON_IMAGE: [&[Command]; 5] = [
    &[Command::Accept, Command::StepBack, Command::Cancel],
    &[Command::UseAnyway, Command::OnOff, Command::PullOntoEdge, Command::Duplicate, Command::Delete],
    &[Command::AcceptGroup, Command::FlipGroup, Command::DeleteGroup, Command::AcceptProposed],
    &[Command::Propose, Command::TakeSuggestion, Command::NewGroup, Command::PasteLines, Command::SelectAll],
    &[Command::Fit, Command::SavePicture],
];

/// The menu of a canvas, while it is open.
pub(crate) fn show(app: &mut App, response: &Response, key: (Place, Pane), mapping: &Mapping) {
    if response.long_touched() && app.panes.was_idle {
        // The finger that is held draws nothing.
        app.send(Action::Drop);
        app.panes.forget_pointer();
    }
    if response.secondary_clicked() {
        app.panes.active = Some(key);
    }
    if response.secondary_clicked() && app.editor.tool().is_idle() {
        let at = response.interact_pointer_pos().map(|at| mapping.document(at));
        if let (Pane::Image(camera), Some(at)) = (key.1, at) {
            app.send(Action::SelectAt { camera, at, near: mapping.units(theme::HIT) });
        }
    }
    let mut chosen = None;
    let on_plan = key.1 == Pane::Plan;
    Popup::context_menu(response).show(|ui| {
        let title = match (on_plan, app.editor.session().entry()) {
            (true, entry) => entry.map(|entry| entry.id.clone()),
            (false, _) => Some(app.editor.session().selection_name())
                .filter(|_| !app.editor.session().selection.is_empty()),
        };
        if let Some(title) = title {
            ui.label(RichText::new(title).font(theme::medium(12.0)));
        }
        let mut is_first = true;
        for group in if on_plan { &ON_PLAN[..] } else { &ON_IMAGE[..] } {
            let offered: Vec<Command> =
                group.iter().copied().filter(|&command| is_offered(app, command)).collect();
            if offered.is_empty() {
                continue;
            }
            if !std::mem::take(&mut is_first) {
                ui.separator();
            }
            menu::rows(app, ui, &offered, &mut chosen);
        }
    });
    if let Some(command) = chosen {
        app.tell(command);
    }
}

fn is_offered(app: &App, command: Command) -> bool {
    let makes_sense = match command {
        Command::Accept | Command::StepBack | Command::Cancel => !app.editor.tool().is_idle(),
        Command::UseAnyway => is_suspected(app),
        _ => true,
    };
    makes_sense && app.is_enabled(command)
}

/// Whether a selected line was set aside.
fn is_suspected(app: &App) -> bool {
    let residuals = app.editor.session().solution().map_or(&[][..], |solution| &solution.residuals);
    let lines = calib_editor::edit::lines_of(&app.editor.session().selection);
    residuals
        .iter()
        .filter(|residual| residual.outlier)
        .any(|residual| residual.annotation.zip(residual.segment).is_some_and(|line| lines.contains(&line)))
}
