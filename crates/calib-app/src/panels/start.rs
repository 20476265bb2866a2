//! What is shown while nothing is open.

use std::path::Path;

use calib_core::counted;
use calib_editor::{Images, Source};
use egui::{Align, Button, Color32, Layout, RichText, Role, ScrollArea, Sense, Stroke, Ui, Vec2, WidgetInfo};

use crate::autosave::Found;
use crate::command::Command;
use crate::panels::step_pictures::{CHECK, DRAW, PLACE, Picture, SIZE, paint};
use crate::picture::cropped;
use crate::platform::{Here, Platform as _};
use crate::recent::{Recent, ago};
use crate::shelf::{Entry, Shelf};
use crate::state::App;
use crate::theme;

/// How wide rows of sites are, in points.
const ROW: f32 = 560.0;

const TITLE: &str = "Calibrate cameras from their still images";

/// What is done, in three pictures.
const STEPS: [(Picture, &str, &str); 3] = [
    (DRAW, "Draw", "Lines that are plumb, parallel or square tell how a camera looks."),
    (PLACE, "Place", "Its field of view is moved, turned and scaled on the plan."),
    (CHECK, "Check", "A mark stands on the same spot in every view."),
];

/// What to begin with.
const CHOICES: [(&str, Command); 4] = [
    ("Open the demonstration site", Command::Demo),
    ("Take the tour: five steps, ten minutes", Command::Tour),
    ("Open a site\u{2026}", Command::Open),
    ("Add images\u{2026}", Command::AddImages),
];

const HINTS: [&str; 2] =
    ["Or drop images, a folder, or a site file here.", "Images never leave this machine."];

/// The start page; `web/index.html` shows the same picture until the program is there.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let mut chosen = None;
    let mut recover = None;
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        ui.vertical_centered(|ui| {
            ui.set_max_width(ui.available_width().min(720.0) - 24.0);
            ui.add_space((0.5 * ui.available_height() - 350.0).max(12.0));
            let card = Card::begin(ui);
            ui.label(RichText::new(TITLE).font(theme::medium(22.0)));
            ui.add_space(4.0);
            ui.add_space(8.0);
            if ui.ctx().content_rect().width() > super::NARROW {
                pictures(ui);
                ui.add_space(12.0);
            }
            recover = found(app, ui);
            for (text, command) in CHOICES {
                let is_first = command == Command::Demo;
                let fill = if is_first { palette.accent } else { palette.raised };
                let colour = if is_first { palette.bg } else { palette.text };
                let label = RichText::new(text).font(theme::medium(13.0)).color(colour);
                if ui.add(Button::new(label).fill(fill).min_size(Vec2::new(320.0, 40.0))).clicked() {
                    chosen = Some(command);
                }
                ui.add_space(4.0);
            }
            recent(app, ui);
            kept(app, ui);
            ui.add_space(12.0);
            for hint in HINTS {
                ui.label(RichText::new(hint).color(palette.text3));
            }
            if let Some(error) = app.editor.error() {
                ui.add_space(12.0);
                ui.label(RichText::new(error).color(palette.bad));
            }
            card.end(ui);
        })
    });
    if let Some((index, goes_on)) = recover {
        app.decide(index, goes_on);
    }
    if let Some(command) = chosen {
        app.tell(command);
    }
}

/// The card that everything lies on: painted below it once its end is known.
struct Card {
    shape: egui::layers::ShapeIdx,
    top: f32,
}

impl Card {
    const MARGIN: f32 = 24.0;

    fn begin(ui: &mut Ui) -> Self {
        let card = Self { shape: ui.painter().add(egui::Shape::Noop), top: ui.cursor().top() };
        ui.add_space(Self::MARGIN);
        card
    }

    fn end(self, ui: &mut Ui) {
        ui.add_space(Self::MARGIN);
        let rect = ui.max_rect().with_min_y(self.top).with_max_y(ui.min_rect().bottom());
        let fill = theme::palette(ui.ctx()).panel;
        ui.painter().set(self.shape, egui::Shape::rect_filled(rect, 12.0, fill));
    }
}

/// Work that a crash left behind: which was chosen, and whether to go on with it.
fn found(app: &mut App, ui: &mut Ui) -> Option<(usize, bool)> {
    let mut recover = None;
    for index in 0..app.found.len() {
        let (slot, found) = &app.found[index];
        let image = found.site.cameras.iter().find_map(|camera| camera.image.clone());
        let image =
            image.map(|name| (format!("{}/{name}", slot.folder().display()), found.images.reader(&name)));
        let words = told(found);
        let fill = theme::palette(ui.ctx()).accent_bg;
        let width = ui.available_width().min(ROW);
        ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
            egui::Frame::NONE.fill(fill).corner_radius(8).inner_margin(12).show(ui, |ui| {
                ui.set_width(width - 24.0);
                ui.horizontal(|ui| {
                    thumbnail(app, ui, image);
                    ui.vertical(|ui| {
                        recover = recover.or_else(|| offer(ui, &words).map(|goes_on| (index, goes_on)));
                    });
                });
            });
        });
        ui.add_space(8.0);
    }
    recover
}

/// The name of work that was not saved, and what else tells it from other work.
fn told(found: &Found) -> [String; 2] {
    let file =
        found.path.as_deref().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
    let name = found.site.name.clone().or_else(|| file.clone()).unwrap_or_else(|| "A new site".into());
    let when = found.at.zip(Here::now()).map(|(at, now)| ago(at, now));
    let count = cameras(found.site.cameras.len());
    let parts = [Some("Not saved".to_owned()), when, Some(count), file];
    [name, parts.into_iter().flatten().collect::<Vec<_>>().join(", ")]
}

/// Whether to go on with it or to discard it, once either was pressed.
fn offer(ui: &mut Ui, [name, words]: &[String; 2]) -> Option<bool> {
    let palette = theme::palette(ui.ctx());
    ui.label(RichText::new(name).font(theme::medium(13.0)));
    ui.label(RichText::new(words).color(palette.text2));
    ui.horizontal(|ui| {
        let goes_on = ui.button("Go on with it").clicked().then_some(true);
        goes_on.or_else(|| ui.button("Discard").clicked().then_some(false))
    })
    .inner
}

/// A still, small; a bare card until it is there.
fn thumbnail(app: &mut App, ui: &mut Ui, image: Option<(String, Source)>) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(84.0, 52.0), Sense::hover());
    ui.painter().rect_filled(rect, 4.0, theme::palette(ui.ctx()).canvas);
    let Some((key, source)) = image else { return };
    if let Some(picture) = app.pictures.get(ui.ctx(), &key, || source) {
        let uv = cropped(picture.overview.size_vec2(), rect);
        ui.painter().image(picture.overview.id(), rect, uv, Color32::WHITE);
    }
}

/// The sites that were opened or saved last.
fn recent(app: &mut App, ui: &mut Ui) {
    /// A screen holds no more.
    const SHOWN: usize = 4;
    let list: Vec<Recent> = app.recent.iter().take(SHOWN).cloned().collect();
    let Some(now) = Here::now().filter(|_| !list.is_empty()) else { return };
    ui.add_space(12.0);
    ui.allocate_ui(Vec2::new(ui.available_width().min(ROW), 0.0), |ui| {
        super::heading(ui, "Recent sites", "");
        for recent in list {
            recent_row(app, ui, &recent, now);
        }
    });
}

fn recent_row(app: &mut App, ui: &mut Ui, recent: &Recent, now: u64) {
    let palette = theme::palette(ui.ctx());
    let image = recent.image.as_ref().map(|path| path.to_string_lossy().into_owned());
    let images = Images::beside(recent.path.parent().map(Path::to_path_buf), None);
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

fn pictures(ui: &mut Ui) {
    const WIDTH: f32 = 190.0;
    let palette = theme::palette(ui.ctx());
    ui.horizontal(|ui| {
        ui.add_space(
            (0.5 * (ui.available_width() - 3.0 * WIDTH - 2.0 * ui.spacing().item_spacing.x)).max(0.0),
        );
        for (picture, title, text) in STEPS {
            ui.allocate_ui_with_layout(Vec2::new(WIDTH, 160.0), Layout::top_down(Align::Min), |ui| {
                egui::Frame::NONE.fill(palette.bg).corner_radius(8).inner_margin(10).show(ui, |ui| {
                    ui.set_width(WIDTH - 20.0);
                    let (rect, _) = ui.allocate_exact_size(SIZE, Sense::hover());
                    paint(ui.painter(), picture, rect.min);
                    ui.label(RichText::new(title).font(theme::medium(13.0)));
                    ui.label(RichText::new(text).small().color(palette.text2));
                });
            });
        }
    });
}

/// The sites that the shelf keeps, each a row.
fn kept(app: &mut App, ui: &mut Ui) {
    let entries = app.shelf.as_ref().map(|shelf| shelf.entries()).unwrap_or_default();
    if entries.is_empty() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    ui.add_space(12.0);
    let width = ui.available_width().min(ROW);
    ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
        let bytes: u64 = entries.iter().map(|entry| entry.bytes).sum();
        super::heading(
            ui,
            "Recent sites in this browser",
            &format!("{}, {}", counted(entries.len(), "site", "sites"), size(bytes)),
        );
        ScrollArea::vertical().max_height(232.0).show(ui, |ui| {
            for entry in &entries {
                ui.horizontal(|ui| {
                    thumbnail(app, ui, still_of(entry));
                    if let Some(shelf) = &mut app.shelf {
                        row(shelf.as_mut(), ui, entry);
                    }
                });
                let rect = ui.min_rect();
                ui.painter().hline(rect.x_range(), rect.bottom(), Stroke::new(1.0, palette.line));
            }
        });
    });
}

/// The still that an entry of the shelf shows, with the name by which it is decoded once.
fn still_of(entry: &Entry) -> Option<(String, Source)> {
    let source = Source::of_data_uri(entry.thumbnail.as_deref()?)?;
    Some((format!("{} {}", entry.id, entry.bytes), source))
}

fn row(shelf: &mut dyn Shelf, ui: &mut Ui, entry: &Entry) {
    let palette = theme::palette(ui.ctx());
    let name = if entry.name.is_empty() { "Unnamed site" } else { &entry.name };
    let open =
        ui.add(Button::new(RichText::new(name).font(theme::medium(12.0))).min_size(Vec2::new(120.0, 28.0)));
    open.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Go on with {name}")));
    if open.on_hover_text(format!("Last: {}", entry.last)).clicked() {
        shelf.open(&entry.id);
    }
    let words = format!("{}, {}, {}", cameras(entry.cameras), entry.when, size(entry.bytes));
    ui.label(RichText::new(words).color(palette.text2));
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        // What is removed is gone: the second press means it.
        let id = ui.scope_id().with(("remove", &entry.id));
        let armed = ui.data(|data| data.get_temp(id).unwrap_or(false));
        let text =
            if armed { RichText::new("Remove for good").color(palette.bad) } else { RichText::new("Remove") };
        let button = ui.button(text);
        button.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Remove {name}")));
        if button.clicked() && armed {
            shelf.remove(&entry.id);
        } else if button.clicked() {
            ui.data_mut(|data| data.insert_temp(id, true));
        }
    });
}

fn cameras(count: usize) -> String {
    counted(count, "camera", "cameras")
}

/// Bytes for the eye.
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
        let picture = |picture: Picture| crate::panels::step_pictures::svg(picture);
        for (picture, title) in STEPS.map(|(drawn, title, _)| (picture(drawn), title)) {
            assert!(page.contains(&format!("{picture}<h2>{title}</h2>")), "{title} should be\n{picture}");
        }
        let words = std::iter::once(TITLE)
            .chain(STEPS.into_iter().flat_map(|(_, title, text)| [title, text]))
            .chain(CHOICES.into_iter().map(|(text, _)| text))
            .chain(HINTS);
        for words in words {
            let found = page[at..].find(&format!(">{words}<"));
            at += found.unwrap_or_else(|| panic!("{words:?} is not on the page, or not in its place"));
        }
    }
}
