//! Start page, shown while no site is open.

use std::path::Path;

use calib_editor::{Images, Source};
use calib_site::counted;
use egui::{
    Align, Button, Color32, Layout, Rect, RichText, Role, ScrollArea, Sense, Stroke, StrokeKind, Ui, Vec2,
    WidgetInfo,
};

use crate::annotate::steps::{CHECK, DRAW, PLACE, Picture, SIZE, paint};
use crate::command::Command;
use crate::picture::cropped;
use crate::platform::{Here, Platform as _};
use crate::state::App;
use crate::storage::autosave::Found;
use crate::storage::autosave::{Entry, Shelf};
use crate::storage::autosave::{Recent, ago};
use crate::theme;

/// Width of the card of the start page, in points.
const CARD_WIDTH: f32 = 696.0;
/// Inner margin of the card, in points.
const CARD_MARGIN: f32 = 24.0;
/// Distance of the card's upper edge above the middle of the window, in points.
const CARD_RISE: f32 = 240.0;
/// Width of the left column, in points; `web/page.css` contains the same number.
const LEFT_WIDTH: f32 = 320.0;
/// Height of both columns, in points; `web/page.css` contains the same number.
const COLUMN_HEIGHT: f32 = 304.0;
/// Size of a step with its picture, in points.
const STEP_SIZE: Vec2 = Vec2::new(312.0, 96.0);

const TITLE: &str = "Calibrate cameras from one image each";
const SUBTITLE: &str =
    "Draw along visible edges. Every floor pixel gets metric coordinates and their uncertainty.";

/// Steps of a calibration: picture, title and text.
const STEPS: [(Picture, &str, &str); 3] = [
    (DRAW, "Draw", "Vertical, parallel and perpendicular lines show how the camera is tilted."),
    (PLACE, "Place", "Move, rotate and scale the field of view on the plan."),
    (CHECK, "Check", "Drag a mark: it must be at the same spot on the floor in every view."),
];

/// Commands of the start page: label, command and note.
const CHOICES: [(&str, Command, &str); 4] = [
    ("Add images\u{2026}", Command::AddImages, "one per camera"),
    ("Open\u{2026}", Command::Open, "a site, images, a plan, a calibration"),
    ("Open the demonstration site", Command::Demo, "six cameras"),
    ("Start the tour", Command::Tour, "nine steps, ten minutes"),
];

const HINT: &str = "Or drop files here.";
const PRIVACY_NOTES: [&str; 2] =
    ["Images never leave this machine.", "Nothing is uploaded; calib works offline."];

/// Shows the start page; `web/index.html` shows the same content while the program loads.
pub(crate) fn start_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let (mut chosen, mut recover) = (None, None);
    let window = ui.max_rect().shrink(16.0);
    let corners = [window.left_top(), window.right_top(), window.right_bottom(), window.left_bottom()];
    let outline: Vec<_> = corners.into_iter().chain([window.left_top()]).collect();
    ui.painter().extend(egui::Shape::dashed_line(&outline, Stroke::new(1.5, palette.line), 9.0, 6.0));
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        let width = (ui.available_width() - 2.0 * CARD_MARGIN).min(CARD_WIDTH);
        ui.add_space((0.5 * ui.available_height() - CARD_RISE).max(2.0 * CARD_MARGIN));
        let corner = egui::pos2(ui.max_rect().center().x - 0.5 * width, ui.cursor().top());
        let card = ui.painter().add(egui::Shape::Noop);
        let inner = Rect::from_min_size(corner, Vec2::new(width, f32::MAX.sqrt())).shrink(CARD_MARGIN);
        let content = ui.scope_builder(egui::UiBuilder::new().max_rect(inner), |ui| {
            (chosen, recover) = content(app, ui);
        });
        let rect =
            content.response.rect.expand(CARD_MARGIN).with_min_x(corner.x).with_max_x(corner.x + width);
        let shape = egui::epaint::RectShape::new(
            rect,
            12.0,
            palette.panel,
            Stroke::new(1.0, palette.line),
            StrokeKind::Inside,
        );
        ui.painter().set(card, shape);
        ui.add_space(2.0 * CARD_MARGIN);
    });
    if let Some((index, goes_on)) = recover {
        app.decide(index, goes_on);
    }
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

/// Shows the card of the start page. Returns the chosen command, and the decision about an autosave: its
/// index, and whether to restore it.
fn content(app: &mut App, ui: &mut Ui) -> (Option<Command>, Option<(usize, bool)>) {
    let palette = theme::palette(ui.ctx());
    let is_narrow = ui.ctx().content_rect().width() <= crate::widgets::NARROW;
    ui.spacing_mut().item_spacing = Vec2::ZERO;
    let size = if is_narrow { 16.0 } else { 22.0 };
    line(ui, 28.0, RichText::new(TITLE).font(theme::medium(size)));
    if !is_narrow {
        line(ui, 22.0, RichText::new(SUBTITLE).color(palette.text2));
    }
    ui.add_space(16.0);
    let (columns, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), COLUMN_HEIGHT), Sense::hover());
    let left = if is_narrow { columns } else { columns.with_max_x(columns.left() + LEFT_WIDTH) };
    let chosen = choices(&mut ui.new_child(egui::UiBuilder::new().max_rect(left)));
    if !is_narrow {
        let right = columns.with_min_x(columns.right() - STEP_SIZE.x);
        pictures(&mut ui.new_child(egui::UiBuilder::new().max_rect(right)));
    }
    ui.spacing_mut().item_spacing = Vec2::new(8.0, 4.0);
    if let Some(error) = app.editor.error() {
        ui.add_space(12.0);
        ui.label(RichText::new(error).color(palette.bad));
    }
    let recover = autosaves_ui(app, ui);
    recent_sites_ui(app, ui);
    stored_sites_ui(app, ui);
    (chosen, recover)
}

/// Shows a line of text in a row of `height` points, independent of the font.
fn line(ui: &mut Ui, height: f32, text: RichText) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), height), Sense::hover());
    let layout = Layout::left_to_right(Align::Center);
    let mut row = ui.new_child(egui::UiBuilder::new().max_rect(rect).layout(layout));
    row.add(egui::Label::new(text).extend());
}

/// Shows the commands of the start page as buttons of full width; returns the chosen command.
fn choices(ui: &mut Ui) -> Option<Command> {
    let palette = theme::palette(ui.ctx());
    let mut chosen = None;
    let width = ui.available_width();
    for (index, (text, command, more)) in CHOICES.into_iter().enumerate() {
        let (fill, colour, faint) = if index == 0 {
            (palette.accent, palette.bg, palette.bg)
        } else {
            (palette.raised, palette.text, palette.text2)
        };
        let label = RichText::new(text).font(theme::medium(13.0)).color(colour);
        let more = RichText::new(more).font(theme::regular(12.0)).color(faint);
        let button = Button::new(label).right_text(more).fill(fill).min_size(Vec2::new(width, 40.0));
        let response = ui.scope(|ui| {
            ui.spacing_mut().button_padding.x = 14.0;
            ui.add(button)
        });
        response.inner.widget_info(|| WidgetInfo::labeled(Role::Button, true, text));
        if response.inner.clicked() {
            chosen = Some(command);
        }
        ui.add_space(8.0);
    }
    ui.add_space(4.0);
    line(ui, 28.0, RichText::new(HINT).color(palette.text3));
    ui.add_space(24.0);
    let (rect, _) = ui.allocate_exact_size(Vec2::new(width, 56.0), Sense::hover());
    ui.painter().rect_filled(rect, 6.0, palette.accent_bg);
    let mut told = ui.new_child(egui::UiBuilder::new().max_rect(rect.shrink2(Vec2::new(14.0, 11.5))));
    line(&mut told, 17.0, RichText::new(PRIVACY_NOTES[0]).font(theme::medium(12.0)));
    line(&mut told, 17.0, RichText::new(PRIVACY_NOTES[1]).color(palette.text2));
    chosen
}

/// Shows the autosaves of unsaved sites. Returns the index of the chosen autosave, and whether to restore (true) or
/// discard it (false).
fn autosaves_ui(app: &mut App, ui: &mut Ui) -> Option<(usize, bool)> {
    let mut recover = None;
    for index in 0..app.storage.found.len() {
        let (slot, found) = &app.storage.found[index];
        let image = found.site.cameras.iter().find_map(|camera| camera.image.clone());
        let image =
            image.map(|name| (format!("{}/{name}", slot.folder().display()), found.images.reader(&name)));
        let words = autosave_text(found);
        let folder = slot.folder().display().to_string();
        let fill = theme::palette(ui.ctx()).accent_bg;
        let width = ui.available_width();
        ui.add_space(12.0);
        ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
            egui::Frame::NONE.fill(fill).corner_radius(8).inner_margin(12).show(ui, |ui| {
                ui.set_width(width - 24.0);
                ui.horizontal(|ui| {
                    thumbnail(app, ui, image);
                    ui.vertical(|ui| {
                        recover = recover.or_else(|| {
                            autosave_buttons(ui, &folder, &words).map(|goes_on| (index, goes_on))
                        });
                    });
                });
            });
        });
    }
    recover
}

/// Returns the name of an autosave, and details that distinguish it from other autosaves.
fn autosave_text(found: &Found) -> [String; 2] {
    let file =
        found.path.as_deref().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
    let name = found.site.name.clone().or_else(|| file.clone()).unwrap_or_else(|| "Unnamed site".into());
    let when = found.at.zip(Here::now()).map(|(at, now)| ago(at, now));
    let count = cameras(found.site.cameras.len());
    let parts = [Some("Not saved".to_owned()), when, Some(count), file];
    [name, parts.into_iter().flatten().collect::<Vec<_>>().join(", ")]
}

/// Shows the buttons to restore (true) or discard (false) the autosave in a folder; returns the choice.
fn autosave_buttons(ui: &mut Ui, folder: &str, [name, words]: &[String; 2]) -> Option<bool> {
    let palette = theme::palette(ui.ctx());
    ui.label(RichText::new(name).font(theme::medium(13.0)));
    ui.label(RichText::new(words).color(palette.text2));
    ui.horizontal(|ui| {
        let goes_on = ui.button("Continue").clicked().then_some(true);
        let discards = confirmed(ui, folder, ["Discard", "Discard permanently"], name);
        goes_on.or_else(|| discards.then_some(false))
    })
    .inner
}

/// Shows a button for an action on the site `name` that cannot be undone; returns true at the second click. `texts`
/// are the texts before the first and before the second click. A click elsewhere cancels the first click.
fn confirmed(ui: &mut Ui, key: &str, texts: [&str; 2], name: &str) -> bool {
    let id = ui.scope_id().with(("confirmed", key));
    let is_armed = ui.data(|data| data.get_temp(id).unwrap_or(false));
    let text = texts[usize::from(is_armed)];
    let shown = match is_armed {
        true => RichText::new(text).color(theme::palette(ui.ctx()).bad),
        false => RichText::new(text),
    };
    let button = ui.button(shown);
    button.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("{text} {name}")));
    if button.clicked() || button.clicked_elsewhere() {
        ui.data_mut(|data| data.insert_temp(id, button.clicked() && !is_armed));
    }
    button.clicked() && is_armed
}

/// Shows a thumbnail, or an empty frame until the image is decoded.
fn thumbnail(app: &mut App, ui: &mut Ui, image: Option<(String, Source)>) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(84.0, 52.0), Sense::hover());
    ui.painter().rect_filled(rect, 4.0, theme::palette(ui.ctx()).canvas);
    let Some((key, source)) = image else { return };
    if let Some(picture) = app.pictures.get(ui.ctx(), &key, || source) {
        let uv = cropped(picture.overview.size_vec2(), rect);
        ui.painter().image(picture.overview.id(), rect, uv, Color32::WHITE);
    }
}

/// Shows the recent sites.
fn recent_sites_ui(app: &mut App, ui: &mut Ui) {
    /// Largest number of recent sites that are shown.
    const SHOWN: usize = 4;
    let list: Vec<Recent> = app.storage.recent.iter().take(SHOWN).cloned().collect();
    let Some(now) = Here::now().filter(|_| !list.is_empty()) else { return };
    ui.add_space(12.0);
    ui.allocate_ui(Vec2::new(ui.available_width(), 0.0), |ui| {
        crate::widgets::heading(ui, "Recent sites", "");
        for recent in list {
            recent_row(app, ui, &recent, now);
        }
    });
}

/// Shows a recent site; a click opens the site.
fn recent_row(app: &mut App, ui: &mut Ui, recent: &Recent, now: u64) {
    let palette = theme::palette(ui.ctx());
    let image = recent.image.as_ref().map(|path| path.to_string_lossy().into_owned());
    let images = Images::in_folder(recent.path.parent().map(Path::to_path_buf), None);
    let image = image.map(|path| (path.clone(), images.reader(&path)));
    ui.horizontal(|ui| {
        thumbnail(app, ui, image);
        ui.vertical(|ui| {
            let name = RichText::new(&recent.name).font(theme::medium(12.0));
            let open = ui.add(Button::new(name).min_size(Vec2::new(120.0, 24.0)));
            open.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Open {}", recent.name)));
            if open.on_hover_text(recent.path.display().to_string()).clicked() {
                app.open_later(recent.path.clone());
            }
            let words = format!("{}, {}", cameras(recent.cameras), ago(recent.at, now));
            ui.label(RichText::new(words).color(palette.text2));
        });
    });
}

/// Shows the three steps with their pictures.
fn pictures(ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    for (picture, title, text) in STEPS {
        let (rect, _) = ui.allocate_exact_size(STEP_SIZE, Sense::hover());
        ui.painter().rect_filled(rect, 8.0, palette.bg);
        paint(ui.painter(), picture, rect.left_top() + Vec2::new(8.0, 6.0));
        let at = rect.left_top() + Vec2::new(SIZE.x + 20.0, 10.0);
        let words = Rect::from_min_max(at, rect.max - Vec2::new(8.0, 4.0));
        // The text stays inside the step.
        let mut told = ui.new_child(egui::UiBuilder::new().max_rect(words));
        told.label(RichText::new(title).font(theme::medium(13.0)));
        told.add_space(3.0);
        told.label(RichText::new(text).small().color(palette.text2));
        ui.add_space(8.0);
    }
}

/// Shows the sites in the browser's storage.
fn stored_sites_ui(app: &mut App, ui: &mut Ui) {
    /// Height of the list, which shows four rows, in points.
    const SHOWN: f32 = 232.0;
    let entries = app.storage.shelf.as_ref().map(|shelf| shelf.entries()).unwrap_or_default();
    if entries.is_empty() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    ui.add_space(12.0);
    let width = ui.available_width();
    ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
        let bytes: u64 = entries.iter().map(|entry| entry.bytes).sum();
        crate::widgets::heading(
            ui,
            "Recent sites in this browser",
            &format!("{}, {}", counted(entries.len(), "site", "sites"), size(bytes)),
        );
        ScrollArea::vertical().max_height(SHOWN).min_scrolled_height(SHOWN).show(ui, |ui| {
            for entry in &entries {
                ui.horizontal(|ui| {
                    thumbnail(app, ui, still_of(entry));
                    if let Some(shelf) = &mut app.storage.shelf {
                        row(shelf.as_mut(), ui, entry);
                    }
                });
                let rect = ui.min_rect();
                ui.painter().hline(rect.x_range(), rect.bottom(), Stroke::new(1.0, palette.line));
            }
        });
    });
}

/// Returns the thumbnail of a stored site, with the name of its texture.
fn still_of(entry: &Entry) -> Option<(String, Source)> {
    let source = Source::from_data_uri(entry.thumbnail.as_deref()?)?;
    Some((format!("{} {}", entry.id, entry.bytes), source))
}

/// Shows a stored site with buttons to open and to remove it.
fn row(shelf: &mut dyn Shelf, ui: &mut Ui, entry: &Entry) {
    let palette = theme::palette(ui.ctx());
    let name = if entry.name.is_empty() { "Unnamed site" } else { &entry.name };
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        if confirmed(ui, &entry.id, ["Remove", "Remove permanently"], name) {
            shelf.remove(&entry.id);
        }
        ui.with_layout(Layout::top_down(Align::Min), |ui| {
            ui.add_space(4.0);
            let title = Button::new(RichText::new(name).font(theme::medium(13.0))).truncate();
            let open = ui.add(title.min_size(Vec2::new(120.0, 26.0)));
            open.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Continue {name}")));
            if open.on_hover_text(format!("Last change: {}", entry.last)).clicked() {
                shelf.open(&entry.id);
            }
            let words = format!("{}, {}, {}", cameras(entry.cameras), entry.when, size(entry.bytes));
            ui.add(egui::Label::new(RichText::new(words).color(palette.text2)).truncate());
        });
    });
}

fn cameras(count: usize) -> String {
    counted(count, "camera", "cameras")
}

/// Returns a number of bytes as text.
fn size(bytes: u64) -> String {
    match bytes as f64 {
        few if few < 1e5 => "under 0.1 MB".into(),
        bytes => format!("{:.1} MB", bytes / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_the_same_before_the_program_is_there() {
        let page = include_str!("../../web/index.html");
        let mut at = 0;
        let picture = |picture: Picture| crate::annotate::steps::svg(picture);
        for (picture, title) in STEPS.map(|(drawn, title, _)| (picture(drawn), title)) {
            assert!(
                page.contains(&format!("{picture}<div><h2>{title}</h2>")),
                "{title} should be\n{picture}"
            );
        }
        let words = [TITLE, SUBTITLE]
            .into_iter()
            .chain(CHOICES.into_iter().flat_map(|(text, _, more)| [text, more]))
            .chain(std::iter::once(HINT).chain(PRIVACY_NOTES))
            .chain(STEPS.into_iter().flat_map(|(_, title, text)| [title, text]));
        for words in words {
            let found = page[at..].find(&format!(">{words}<"));
            at += found.unwrap_or_else(|| panic!("{words:?} is not on the page, or not in its place"));
        }
    }
}
