//! Conversion between the key types of `calib_editor` and of egui.

use calib_editor::{Key, Modifiers, Shortcut};
use egui::{Context, KeyboardShortcut};

use crate::command::{self, Command};
use crate::focus;
use crate::platform::{Here, Platform as _};
use crate::widgets::PHONE;

/// Converts modifier keys from egui to `calib_editor`.
pub(crate) const fn held(modifiers: egui::Modifiers) -> Modifiers {
    let egui::Modifiers { alt, ctrl, shift, mac_cmd: _, command } = modifiers;
    Modifiers { shift, ctrl, alt, command }
}

/// Converts a key from `calib_editor` to egui.
#[must_use]
pub fn key(key: Key) -> egui::Key {
    // A test checks that every key has a counterpart.
    egui::Key::from_name(key.name()).unwrap_or(egui::Key::F35)
}

/// Converts the shortcut of a command from `calib_editor` to egui. If the system reserves Ctrl+N, Alt is added to the
/// shortcut that creates a site.
#[must_use]
pub fn shortcut(command: Command, keys: Shortcut) -> KeyboardShortcut {
    let Modifiers { shift, ctrl, alt, command: cmd } = keys.modifiers;
    let alt = alt || command == Command::NewSite && Here::KEEPS_CTRL_N;
    let modifiers = egui::Modifiers { alt, ctrl, shift, mac_cmd: false, command: cmd };
    KeyboardShortcut::new(modifiers, key(keys.key))
}

/// Returns the commands whose keys were pressed, except while a text field has the focus. While an empty length field
/// has the focus, only the keys of a length go to the field, and other keys run commands. While a sheet needs the
/// other keys (`has_sheet`), only Escape has a command.
///
/// `was_typing` is true if a text field had the focus in the last frame. The Escape key that left the field then runs
/// no command. An Escape key that closes a menu runs no command either.
pub fn pressed(ctx: &Context, was_typing: bool, has_sheet: bool) -> Vec<(Command, egui::Modifiers)> {
    let blank = focus::blank_field(ctx);
    if ctx.text_edit_focused() && blank.is_none() {
        return Vec::new();
    }
    let is_others = was_typing || egui::Popup::is_any_open(ctx);
    let mut found = Vec::new();
    ctx.input_mut(|input| {
        input.events.retain(|event| {
            let egui::Event::Key { key, pressed: true, modifiers, .. } = event else { return true };
            let matches = |row: &command::Row| {
                row.keys.is_some_and(|keys| is_pressed(shortcut(row.command, keys), *key, *modifiers))
                    || row.command == Command::Redo && is_pressed(OTHER_REDO, *key, *modifiers)
            };
            if blank.is_some() && focus::is_for_field(*key, *modifiers) {
                return true;
            }
            let Some(row) = command::all().find(matches) else { return true };
            if has_sheet && row.command != Command::Cancel {
                return true;
            }
            if !(is_others && *key == egui::Key::Escape) {
                found.push((row.command, *modifiers));
            }
            // These two events remain: Enter presses a focused button, and Escape closes a menu.
            matches!(row.command, Command::Accept | Command::Cancel)
        });
    });
    if let Some(field) = blank.filter(|_| !found.is_empty()) {
        // The letter of a shortcut is not entered into the field.
        ctx.input_mut(|input| input.events.retain(|event| !matches!(event, egui::Event::Text(_))));
        ctx.memory_mut(|memory| memory.surrender_focus(field));
    }
    found
}

/// Id under which the device of the last input is stored: whether it was a touch screen.
fn touch_id() -> egui::Id {
    egui::Id::unique("last input was a touch")
}

/// Detects whether the operator uses a touch screen or a keyboard.
pub(crate) fn watch_touch(ctx: &Context) {
    let is_touch = ctx.input(|input| {
        let is_key = |event: &egui::Event| matches!(event, egui::Event::Key { pressed: true, .. });
        input.any_touches().then_some(true).or_else(|| input.events.iter().any(is_key).then_some(false))
    });
    if let Some(is_touch) = is_touch {
        ctx.data_mut(|data| data.insert_temp(touch_id(), is_touch));
    }
}

/// Whether key hints are shown. They are hidden on phones and after a touch.
#[must_use]
pub(crate) fn are_shown(ctx: &Context) -> bool {
    let is_touch = ctx.data(|data| data.get_temp(touch_id())).unwrap_or(false);
    !is_touch && ctx.content_rect().width() >= PHONE
}

/// Returns a sentence without its keys, which follow two spaces, if key hints are hidden.
#[must_use]
pub(crate) fn shown_hint<'a>(ctx: &Context, text: &'a str) -> &'a str {
    let bare = text.split_once("  ").map_or(text, |(text, _)| text);
    if are_shown(ctx) { text } else { bare }
}

/// Returns a label or a text for this device: with Cmd instead of Ctrl on a Mac, and without its keys if key hints are
/// hidden. Keys are in parentheses, or follow spaces.
#[must_use]
pub(crate) fn shown(ctx: &Context, text: &str) -> String {
    use egui::os::OperatingSystem::{IOS, Mac};
    let text = if are_shown(ctx) { text.to_owned() } else { without_keys(shown_hint(ctx, text)) };
    if matches!(ctx.os(), Mac | IOS) { text.replace("Ctrl+", "Cmd+") } else { text }
}

/// Returns a text without keys in parentheses, such as "(K)", "(F9)" or "(Ctrl+Z)".
fn without_keys(text: &str) -> String {
    let mut kept = String::new();
    let mut rest = text;
    while let Some((before, (inside, after))) =
        rest.split_once(" (").and_then(|(before, after)| Some((before, after.split_once(')')?)))
    {
        kept.push_str(before);
        let is_function = inside.strip_prefix('F').is_some_and(|number| number.parse::<u8>().is_ok());
        let is_key =
            inside.chars().count() == 1 || is_function || inside.contains('+') && !inside.contains(' ');
        if !is_key {
            kept.push_str(&format!(" ({inside})"));
        }
        rest = after;
    }
    kept + rest
}

/// Second shortcut for redo, as in other programs.
const OTHER_REDO: KeyboardShortcut = KeyboardShortcut::new(egui::Modifiers::COMMAND, egui::Key::Y);

/// Whether a pressed key with its modifiers is the shortcut `keys`.
fn is_pressed(keys: KeyboardShortcut, key: egui::Key, modifiers: egui::Modifiers) -> bool {
    use egui::Key;
    let is_nudge = matches!(key, Key::ArrowLeft | Key::ArrowRight | Key::ArrowUp | Key::ArrowDown);
    // The keyboard layout determines whether a sign needs Shift.
    let is_sign = matches!(key, Key::Questionmark | Key::Plus);
    let same_key = keys.logical_key == key
        || keys.logical_key == Key::Plus && key == Key::Equals
        || keys.logical_key == Key::CloseBracket && key == Key::CloseCurlyBracket
        || keys.logical_key == Key::OpenBracket && key == Key::OpenCurlyBracket;
    // With Enter, Alt snaps the line to an edge.
    let is_end = key == Key::Enter && keys.logical_key == Key::Enter;
    same_key
        && modifiers.command == keys.modifiers.command
        && (is_end || modifiers.alt == keys.modifiers.alt)
        && (is_nudge || is_sign || modifiers.shift == keys.modifiers.shift)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_in_parentheses_are_left_out() {
        for (text, expected) in [
            ("Undo it (Ctrl+Z), and draw it again.", "Undo it, and draw it again."),
            ("Link them (K), then refine (F9).", "Link them, then refine."),
            ("Lines (two or more) are needed.", "Lines (two or more) are needed."),
            ("Without an end (K", "Without an end (K"),
        ] {
            assert_eq!(without_keys(text), expected);
        }
    }

    #[test]
    fn the_window_knows_every_key() {
        for row in command::all() {
            let Some(keys) = row.keys else { continue };
            let name = keys.key.name();
            let known = egui::Key::from_name(name);
            assert!(known.is_some(), "{name} of {:?}", row.command);
            assert_eq!(key(keys.key), known.unwrap());
        }
    }
}
