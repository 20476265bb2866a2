//! Named handles on canvases for screen readers, the Tab key and tests; and the context menu of a canvas.

use calib_editor::{Action, Pane, Part, PlanHandle, TOOLS, ToolRow, hit, plan_handles};
use egui::{
    Button, EventFilter, Key, KeyboardShortcut, Popup, Rect, Response, RichText, Role, Sense, Ui, Vec2,
    WidgetInfo,
};

use crate::canvas::Mapping;
use crate::command::{COMMANDS, Command};
use crate::state::{App, Place, is_offered};
use crate::{keys, theme};

/// Registers the handles of a camera's image as widgets with names.
pub(crate) fn on_image(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping) {
    let list = hit::handles(&app.editor.session().site, camera);
    let mut chosen = None;
    for (part, pixel) in list {
        let at = mapping.screen(pixel.into());
        if !mapping.rect.contains(at) {
            continue;
        }
        let rect = Rect::from_center_size(at, Vec2::splat(2.0 * theme::HIT));
        let id = ui.scope_id().with(("handle", camera, part));
        let response = ui.interact(rect, id, Sense::focusable_noninteractive());
        let name = handle_name(app, part);
        let selected = app.editor.session().selection.contains(&part);
        response.widget_info(|| WidgetInfo::selected(Role::Button, true, selected, &name));
        if response.has_focus() {
            let arrows =
                EventFilter { horizontal_arrows: true, vertical_arrows: true, ..EventFilter::default() };
            ui.memory_mut(|memory| memory.set_focus_lock_filter(id, arrows));
        }
        if response.gained_focus() {
            chosen = Some(part);
        }
    }
    if let Some(part) = chosen {
        app.act(Action::SelectOn(camera, part));
    }
}

/// Returns the name of a handle for screen readers.
fn handle_name(app: &App, part: Part) -> String {
    let name = app.editor.session().part_name(part);
    match part {
        Part::Vertex { vertex, .. } => format!("{name} point {}", vertex + 1),
        Part::Link { point, .. } if point > 0 => format!("{name} point {}", point + 1),
        _ => name,
    }
}

/// Registers the handles of the current camera on the plan as widgets with names.
pub(crate) fn on_plan(app: &App, ui: &Ui, mapping: &Mapping) {
    let Some(entry) = app.editor.session().entry() else { return };
    for (handle, at) in plan_handles(app.editor.session(), app.editor.session().camera) {
        let at = mapping.screen(at);
        if !mapping.rect.contains(at) {
            continue;
        }
        let rect = Rect::from_center_size(at, Vec2::splat(2.0 * theme::HIT));
        let id = ui.scope_id().with(("plan handle", handle));
        let response = ui.interact(rect, id, Sense::focusable_noninteractive());
        let name = match handle {
            PlanHandle::Corner(corner) => {
                format!("corner {} of {} on the plan", corner + 1, entry.id)
            }
            other => format!("{} {} on the plan", other.verb(), entry.id),
        };
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &name));
    }
}

/// Shows groups of commands in a menu, with separators between them; a click sets `chosen`.
pub(crate) fn grouped_rows(app: &App, ui: &mut Ui, groups: &[&[Command]], chosen: &mut Option<Command>) {
    for (index, group) in groups.iter().enumerate() {
        if index > 0 {
            ui.separator();
        }
        rows(app, ui, group, chosen);
    }
}

/// Shows a group of commands in a menu, one per row; a click sets `chosen`.
fn rows(app: &App, ui: &mut Ui, group: &[Command], chosen: &mut Option<Command>) {
    ui.set_min_width(260.0);
    let rows = group.iter().filter_map(|command| COMMANDS.iter().find(|row| row.command == *command));
    for row in rows.filter(|row| is_offered(row.command)) {
        let keys = row
            .keys
            .filter(|_| keys::are_shown(ui.ctx()))
            .map_or_else(String::new, |keys| shortcut_text(ui, keys::shortcut(row.command, keys)));
        let button = Button::new(row.text).shortcut_text(keys).min_size(Vec2::new(250.0, 22.0));
        if ui.add_enabled(app.is_enabled(row.command), button).clicked() {
            *chosen = Some(row.command);
            ui.close();
        }
    }
}

/// Returns the keys of a shortcut as text for this platform.
#[must_use]
pub(crate) fn shortcut_text(ui: &Ui, keys: KeyboardShortcut) -> String {
    match keys.logical_key {
        Key::Questionmark => "?".into(),
        Key::OpenBracket => {
            if keys.modifiers.shift {
                "{".into()
            } else {
                "[".into()
            }
        }
        Key::CloseBracket => {
            if keys.modifiers.shift {
                "}".into()
            } else {
                "]".into()
            }
        }
        _ => ui.ctx().format_shortcut(&keys),
    }
}

/// Commands of the context menu of the plan, in groups.
const PLAN_MENU: [&[Command]; 3] = [
    &[Command::FixPlacement, Command::ResetPlacement, Command::Refine],
    &[Command::Coverage, Command::Magnify, Command::Blend, Command::Snap, Command::Beside],
    &[Command::Fit, Command::SavePicture],
];
/// Commands of the context menu of an image, in groups.
const IMAGE_MENU: [&[Command]; 5] = [
    &[Command::Accept, Command::StepBack, Command::Cancel],
    &[Command::UseAnyway, Command::OnOff, Command::PullOntoEdge, Command::Duplicate, Command::Delete],
    &[Command::AcceptGroup, Command::FlipGroup, Command::DeleteGroup, Command::AcceptProposed],
    &[Command::Propose, Command::TakeSuggestion, Command::NewGroup, Command::PasteLines, Command::SelectAll],
    &[Command::Fit, Command::SavePicture],
];

/// Shows the context menu of a canvas while the menu is open.
pub(crate) fn show(app: &mut App, response: &Response, key: (Place, Pane), mapping: &Mapping) {
    // With a drawing tool, a resting finger continues to draw.
    let acts_here =
        key.1 != Pane::Plan || TOOLS.get(app.editor.tool_row()).is_some_and(ToolRow::acts_on_plan);
    let draws = app.editor.tool_row() != 0 && acts_here && app.view.panes.captured == Some(key);
    if response.long_touched() && draws {
        return;
    }
    if response.long_touched() && app.view.panes.was_idle {
        // A long press with the selection tool opens the menu.
        app.send(Action::CancelGesture);
        app.view.panes.forget_pointer();
    }
    if response.secondary_clicked() {
        app.view.panes.active = Some(key);
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
        for group in if on_plan { &PLAN_MENU[..] } else { &IMAGE_MENU[..] } {
            let offered: Vec<Command> =
                group.iter().copied().filter(|&command| is_in_menu(app, command)).collect();
            if offered.is_empty() {
                continue;
            }
            if !std::mem::take(&mut is_first) {
                ui.separator();
            }
            rows(app, ui, &offered, &mut chosen);
        }
    });
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

/// Whether the context menu shows a command now.
fn is_in_menu(app: &App, command: Command) -> bool {
    let makes_sense = match command {
        Command::Accept | Command::StepBack | Command::Cancel => !app.editor.tool().is_idle(),
        Command::UseAnyway => is_suspected(app),
        _ => true,
    };
    makes_sense && app.is_enabled(command)
}

/// Whether a selected line was rejected as an outlier.
fn is_suspected(app: &App) -> bool {
    let residuals = app.editor.session().solution().map_or(&[][..], |solution| &solution.residuals);
    let lines = calib_editor::edit::lines_of(&app.editor.session().selection);
    residuals
        .iter()
        .filter(|residual| residual.outlier)
        .any(|residual| residual.annotation.zip(residual.segment).is_some_and(|line| lines.contains(&line)))
}
