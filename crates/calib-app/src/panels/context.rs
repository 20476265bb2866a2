//! What a right click or a long press on a canvas offers: first what can be done to what is under it.

use egui::{Modifiers, Popup, Response, RichText, Ui};

use crate::app::App;
use crate::canvas::Mapping;
use crate::command::{self, Command};
use crate::hit;
use crate::pane::Place;
use crate::panels::topbar;
use crate::theme;
use crate::tools::Pane;

const MENU: [&[Command]; 4] = [
    &[Command::Accept, Command::StepBack, Command::Cancel],
    &[Command::UseAnyway, Command::OnOff, Command::PullOntoEdge, Command::Duplicate, Command::Delete],
    &[Command::TakeSuggestion, Command::NewGroup, Command::PasteLines, Command::SelectAll],
    &[Command::Fit, Command::SavePicture],
];

/// The menu of a canvas, while it is open.
pub fn show(app: &mut App, ui: &Ui, response: &Response, key: (Place, Pane), mapping: &Mapping) {
    if response.long_touched() && app.panes.was_idle {
        // The finger that is held draws nothing.
        app.cancel();
        app.panes.forget_pointer();
    }
    if response.secondary_clicked() {
        app.panes.active = Some(key);
    }
    if response.secondary_clicked() && app.tool.is_idle() {
        let at = response.interact_pointer_pos().map(|at| mapping.document(at));
        if let (Pane::Image(camera), Some(at)) = (key.1, at) {
            select(app, camera, at, mapping.units(theme::HIT));
        }
    }
    let mut chosen = None;
    Popup::context_menu(response).show(|ui| {
        if !app.session.selection.is_empty() {
            ui.label(RichText::new(app.session.selection_name()).font(theme::medium(12.0)));
        }
        let mut is_first = true;
        for group in MENU {
            let offered: Vec<Command> =
                group.iter().copied().filter(|&command| is_offered(app, command)).collect();
            if offered.is_empty() {
                continue;
            }
            if !std::mem::take(&mut is_first) {
                ui.separator();
            }
            topbar::rows(app, ui, &offered, &mut chosen);
        }
    });
    if let Some(command) = chosen {
        command::run(app, ui.ctx(), command, Modifiers::NONE);
    }
}

/// What is under the pointer is meant, unless it is part of what is selected.
fn select(app: &mut App, camera: usize, at: [f64; 2], near: f64) {
    let session = &mut app.session;
    session.choose(camera);
    let pose = session.solved.pose(camera);
    match hit::pick(&session.site, camera, pose, at.into(), near, &session.selection) {
        Some(hit) if session.selection.contains(&hit.part) => {}
        Some(hit) => session.select_only(camera, hit.part),
        None => session.selection.clear(),
    }
}

fn is_offered(app: &App, command: Command) -> bool {
    let ends = matches!(command, Command::Accept | Command::StepBack | Command::Cancel);
    command::is_enabled(app, command) && (!ends || !app.tool.is_idle())
}
