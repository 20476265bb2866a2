//! Command palette, shortcut sheet and about sheet.

use calib_editor::command::Group;
use egui::{Align2, Context, Key, RichText, ScrollArea, TextEdit, Ui, Vec2, Window};

use crate::command::{self, Command};
use crate::handles::shortcut_text;
use crate::keys;
use crate::platform::{Here, Platform as _};
use crate::state::{App, is_offered};
use crate::theme;

/// Shows the command palette, the shortcut sheet and the about sheet if they are open.
#[inline(never)]
pub fn palette_ui(app: &mut App, ctx: &Context) {
    if app.dialogs.palette.is_open {
        commands(app, ctx);
    }
    if app.dialogs.shortcuts {
        shortcuts(app, ctx);
    }
    if app.dialogs.about {
        about(app, ctx);
    }
}

/// Words that people type, and the words of the commands that they mean.
const SYNONYMS: &[(&str, &[&str])] = &[
    ("delete", &["remove"]),
    ("remove", &["delete"]),
    ("distance", &["known length", "measure", "scale"]),
    ("length", &["measure", "scale"]),
    ("ruler", &["measure"]),
    ("height", &["upright", "measure"]),
    ("person", &["upright"]),
    ("people", &["upright"]),
    ("coverage", &["density"]),
    ("blind", &["density"]),
    ("resolution", &["density"]),
    ("load", &["open", "add"]),
    ("import", &["open"]),
    ("photo", &["image"]),
    ("snapshot", &["image"]),
    ("rtsp", &["address"]),
    ("url", &["address"]),
    ("picture", &["image"]),
    ("map", &["plan"]),
    ("drawing", &["plan"]),
    ("solve", &["refine"]),
    ("optimise", &["refine"]),
    ("optimize", &["refine"]),
    ("place", &["refine", "placement"]),
    ("propose", &["automatically"]),
    ("detect", &["automatically"]),
    ("distortion", &["straight", "lens"]),
    ("polygon", &["field of view", "region", "area"]),
    ("print", &["report"]),
    ("screenshot", &["as an image"]),
    ("dark", &["theme"]),
    ("light", &["theme"]),
    ("imperial", &["feet"]),
    ("metres", &["feet"]),
    ("help", &["tour", "keyboard", "about"]),
];

/// Whether the text contains every word of the query or a synonym of it, in any order and case.
fn is_match(text: &str, query: &str) -> bool {
    let text = text.to_lowercase();
    query.to_lowercase().split_whitespace().all(|word| {
        // The first letters of a word are enough.
        let synonyms = SYNONYMS.iter().filter(|(typed, _)| word.len() > 2 && typed.starts_with(word));
        text.contains(word) || synonyms.flat_map(|(_, meant)| *meant).any(|meant| text.contains(meant))
    })
}

fn commands(app: &mut App, ctx: &Context) {
    let query = app.dialogs.palette.query.clone();
    let rows: Vec<command::Row> = command::all()
        .filter(|row| !matches!(row.command, Command::Palette))
        .filter(|row| is_offered(row.command))
        .filter(|row| is_match(&app.editor.command_text(row.command), &query))
        .collect();
    let (up, down, enter, escape) = ctx.input(|i| {
        let pressed = |key| i.key_pressed(key);
        (pressed(Key::ArrowUp), pressed(Key::ArrowDown), pressed(Key::Enter), pressed(Key::Escape))
    });
    if down {
        app.dialogs.palette.row += 1;
    }
    if up {
        app.dialogs.palette.row = app.dialogs.palette.row.saturating_sub(1);
    }
    app.dialogs.palette.row = app.dialogs.palette.row.min(rows.len().saturating_sub(1));
    let mut chosen = enter.then(|| rows.get(app.dialogs.palette.row).map(|row| row.command)).flatten();
    Window::new("Commands")
        .title_bar(false)
        .resizable(false)
        .anchor(Align2::CENTER_TOP, Vec2::new(0.0, 64.0))
        .fixed_size(Vec2::new(460.0, 360.0))
        .show(ctx, |ui| {
            let field = TextEdit::singleline(&mut app.dialogs.palette.query)
                .hint_text("What would you like to do?")
                .desired_width(f32::INFINITY);
            let field = ui.add(field);
            field.request_focus();
            if field.changed() {
                app.dialogs.palette.row = 0;
            }
            ui.separator();
            ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
                for (i, row) in rows.iter().enumerate() {
                    let keys =
                        row.keys.filter(|_| keys::are_shown(ui.ctx())).map_or_else(String::new, |keys| {
                            shortcut_text(ui, keys::shortcut(row.command, keys))
                        });
                    let lit = i == app.dialogs.palette.row;
                    let button = egui::Button::new(app.editor.command_text(row.command))
                        .selected(lit)
                        .shortcut_text(keys)
                        .min_size(Vec2::new(ui.available_width(), 22.0));
                    let response = ui.add_enabled(app.is_enabled(row.command), button);
                    if lit && (up || down) {
                        response.scroll_to_me(None);
                    }
                    if response.clicked() {
                        chosen = Some(row.command);
                    }
                }
            });
        });
    if chosen.is_some() || escape {
        app.dialogs.palette.close();
    }
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

/// Group of the shortcut sheet: a title, and a test for its commands.
type KeyGroup = (&'static str, fn(Group) -> bool);

/// Groups of the shortcut sheet in their order.
const GROUPS: [KeyGroup; 7] = [
    ("Tools", |group| matches!(group, Group::Tool(_))),
    ("Files", |group| matches!(group, Group::Files(_))),
    ("While drawing", |group| matches!(group, Group::Gesture(_) | Group::Nudge(_))),
    ("Selection", |group| matches!(group, Group::Selection(_))),
    ("Lines", |group| matches!(group, Group::Lines(_) | Group::Proposing(_) | Group::Newer(_))),
    ("Cameras and solving", |group| matches!(group, Group::Cameras(_) | Group::Solving(_))),
    ("View", |group| matches!(group, Group::View(_) | Group::Switch(_))),
];

/// Shows a group of the shortcut sheet.
fn key_group(ui: &mut Ui, (title, is_of): &KeyGroup) {
    let palette = theme::palette(ui.ctx());
    crate::widgets::heading(ui, title, "");
    egui::Grid::new(*title).num_columns(2).striped(true).show(ui, |ui| {
        for row in command::all().filter(|row| is_of(row.command.group())) {
            let Some(keys) = row.keys else { continue };
            let keys = shortcut_text(ui, keys::shortcut(row.command, keys));
            ui.label(RichText::new(keys).font(theme::medium(12.0)).color(palette.accent));
            ui.label(row.text);
            ui.end_row();
        }
    });
    ui.add_space(6.0);
}

fn shortcuts(app: &mut App, ctx: &Context) {
    let mut open = true;
    Window::new("Keyboard")
        .open(&mut open)
        .resizable(false)
        .collapsible(false)
        .anchor(Align2::CENTER_CENTER, Vec2::ZERO)
        .show(ctx, |ui| {
            let palette = theme::palette(ui.ctx());
            ScrollArea::vertical().max_height(0.7 * ui.ctx().content_rect().height()).show(ui, |ui| {
                ui.horizontal_top(|ui| {
                    for groups in [&GROUPS[..2], &GROUPS[2..5], &GROUPS[5..]] {
                        ui.vertical(|ui| {
                            ui.set_max_width(360.0);
                            groups.iter().for_each(|group| key_group(ui, group));
                        });
                    }
                });
            });
            ui.separator();
            for line in [
                "Wheel: zoom at the pointer.   Drag with the middle button or Space: pan.   Tab: next handle.",
                "While dragging: hold Shift to move a tenth as far, press Esc to cancel.   \
                 While dragging or drawing: hold Alt to snap to the edge.",
                "Without a mouse: the arrow keys move a crosshair while a tool is active (Shift: faster), and Enter clicks. \
                 Enter again at the same place finishes a line.",
                "Marks: hold Alt to drag the camera instead of the mark, or Ctrl to change the height of the mark.   \
                 Ctrl+click: select more.",
            ] {
                ui.label(RichText::new(line).color(palette.text2));
            }
        });
    app.dialogs.shortcuts &= open;
}

fn about(app: &mut App, ctx: &Context) {
    let mut open = true;
    Window::new("About")
        .open(&mut open)
        .resizable(false)
        .collapsible(false)
        .default_width(460.0)
        .anchor(Align2::CENTER_CENTER, Vec2::ZERO)
        .show(ctx, |ui| {
            ui.label(RichText::new("calib").font(theme::medium(22.0)));
            ui.label(format!("Version {}. Licensed under MIT or Apache-2.0.", env!("CARGO_PKG_VERSION")));
            ui.label("The method extends A. Abramov, \u{201c}Two-Stage Camera Calibration Method for Multi-Camera Systems Using Scene Geometry\u{201d}.");
            ui.label("Images never leave this machine.");
            ui.separator();
            ui.label("Font: IBM Plex Sans, \u{a9} 2017 IBM Corp., SIL Open Font License 1.1.");
            ui.collapsing("Third-party notices", notices);
            ui.collapsing("Font licence", |ui| {
                ScrollArea::vertical().max_height(240.0).show(ui, |ui| {
                    ui.label(RichText::new(include_str!("../../assets/IBMPlexSans-LICENSE.txt")).small());
                });
            });
        });
    app.dialogs.about &= open;
}

/// Shows the licence notices of third parties; only visible lines are laid out.
fn notices(ui: &mut Ui) {
    static LINES: std::sync::LazyLock<Vec<&str>> =
        std::sync::LazyLock::new(|| Here::NOTICES.lines().collect());
    let height = ui.text_style_height(&egui::TextStyle::Small);
    ScrollArea::both().max_height(280.0).auto_shrink([false, false]).show_rows(
        ui,
        height,
        LINES.len(),
        |ui, rows| {
            for line in &LINES[rows] {
                ui.add(egui::Label::new(RichText::new(*line).small()).extend());
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_found_in_any_order() {
        assert!(is_match("Next unfinished camera", "cam next"));
        assert!(!is_match("Next unfinished camera", "undo"));
    }
}
