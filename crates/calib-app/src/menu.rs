//! Commands of a menu, with their keys.

use egui::{Button, Key, KeyboardShortcut, Ui, Vec2};

use crate::command::{COMMANDS, Command};
use crate::keys;
use crate::state::App;

/// Commands of a menu, a row each.
pub(crate) fn rows(app: &App, ui: &mut Ui, group: &[Command], chosen: &mut Option<Command>) {
    ui.set_min_width(260.0);
    let rows = group.iter().filter_map(|command| COMMANDS.iter().find(|row| row.command == *command));
    for row in rows {
        let keys =
            row.keys.map_or_else(String::new, |keys| shortcut_text(ui, keys::shortcut(row.command, keys)));
        let button = Button::new(row.text).shortcut_text(keys).min_size(Vec2::new(250.0, 22.0));
        if ui.add_enabled(app.is_enabled(row.command), button).clicked() {
            *chosen = Some(row.command);
            ui.close();
        }
    }
}

/// Keys in the words of this platform.
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
