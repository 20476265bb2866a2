//! Top bar: menu, name of the site, views, undo, refine, commands.

use egui::{Align, Button, Layout, RichText, Ui, Vec2};

use crate::command::Command;
use crate::handles::grouped_rows;
use crate::icons::{self, Icon, Look};
use crate::keys;
use crate::state::{App, Mode};
use crate::theme;

/// Commands of the main menu, in groups.
const MENU: &[&[Command]] = &[
    &[
        Command::NewSite,
        Command::Demo,
        Command::Tour,
        Command::Open,
        Command::Save,
        Command::SaveAs,
        Command::SavePlain,
    ],
    &[
        Command::AddImages,
        Command::AddFromAddress,
        Command::LoadPlan,
        Command::ReplaceStill,
        Command::Compare,
    ],
    &[Command::Propose, Command::CalibrateAll, Command::CompareStill],
    &[Command::Import, Command::Export, Command::Report],
    &[Command::SavePicture, Command::Theme, Command::Feet],
    &[Command::Shortcuts, Command::About],
];

/// Buttons of the views: mode, command, icon, label and tooltip.
const VIEWS: [(Mode, Command, Icon, &str, &str); 4] = [
    (Mode::Image, Command::ViewImage, Icon::Image, "Image", "Show the image of one camera"),
    (Mode::Plan, Command::ViewPlan, Icon::Plan, "Plan", "Show the floor plan, to place cameras"),
    (Mode::All, Command::ViewAll, Icon::All, "All cameras", "Show the images of all cameras and the plan"),
    (Mode::Scene, Command::ViewScene, Icon::Scene, "Scene", "Show all cameras in 3-D"),
];

/// Shows the top bar.
pub fn topbar_ui(app: &mut App, ui: &mut Ui) {
    let mut chosen = None;
    ui.horizontal_centered(|ui| {
        menu(app, ui, &mut chosen);
        if ui.ctx().content_rect().width() < crate::widgets::NARROW {
            views(app, ui, &mut chosen);
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| right(app, ui, &mut chosen));
            return;
        }
        title(app, ui);
        // The views are in the middle of the window.
        let width = 4.0 * 112.0;
        let middle = ui.ctx().content_rect().center().x;
        let rect = egui::Rect::from_center_size(
            egui::pos2(middle, ui.max_rect().center().y),
            Vec2::new(width, 28.0),
        );
        ui.scope_builder(egui::UiBuilder::new().max_rect(rect), |ui| {
            ui.horizontal_centered(|ui| views(app, ui, &mut chosen));
        });
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| right(app, ui, &mut chosen));
    });
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

fn menu(app: &App, ui: &mut Ui, chosen: &mut Option<Command>) {
    let response = icons::button(ui, Icon::Menu, "Menu", "Menu", Look::default());
    egui::Popup::menu(&response).show(|ui| {
        let height = ui.ctx().content_rect().bottom() - response.rect.bottom() - 24.0;
        egui::ScrollArea::vertical().max_height(height).show(ui, |ui| {
            grouped_rows(app, ui, MENU, chosen);
        });
    });
}

fn title(app: &App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let file = app.editor.session().path.as_deref().and_then(|path| path.file_stem());
    let name = app
        .editor
        .session()
        .site
        .name
        .clone()
        .or_else(|| file.map(|stem| stem.to_string_lossy().into_owned()));
    let name = name.unwrap_or_else(|| "New site".into());
    ui.label(RichText::new(name).font(theme::medium(13.0)).color(palette.text));
    let saved = match (app.editor.session().is_saved(), app.editor.session().path.is_some()) {
        (true, true) => "saved",
        (true, false) => "",
        (false, _) => "not saved",
    };
    ui.label(RichText::new(saved).color(palette.text3));
}

fn views(app: &App, ui: &mut Ui, chosen: &mut Option<Command>) {
    let palette = theme::palette(ui.ctx());
    ui.spacing_mut().item_spacing.x = 4.0;
    for (i, (mode, command, icon, title, tip)) in VIEWS.into_iter().enumerate() {
        let is_on = app.view.mode == mode;
        // In a narrow window the buttons have icons only.
        let phone = ui.ctx().content_rect().width() < crate::widgets::NARROW;
        let key = if keys::are_shown(ui.ctx()) { (i + 1).to_string() } else { String::new() };
        let text = if phone { "     ".into() } else { format!("      {title}   {key}") };
        let text = RichText::new(text);
        let text = text.color(if is_on { palette.text } else { palette.text2 });
        let fill = if is_on { palette.raised } else { palette.panel };
        let response = ui.add(Button::new(text).fill(fill).min_size(Vec2::new(0.0, 26.0)).selected(false));
        let at = egui::Rect::from_center_size(
            response.rect.left_center() + Vec2::new(15.0, 0.0),
            Vec2::splat(16.0),
        );
        icons::paint(ui.painter(), icon, at, 14.0, if is_on { palette.accent } else { palette.text2 });
        if response.has_focus() {
            let ring = egui::Stroke::new(1.5, palette.accent);
            ui.painter().rect_stroke(response.rect, 4.0, ring, egui::StrokeKind::Inside);
        }
        response.widget_info(|| {
            egui::WidgetInfo::selected(egui::Role::Button, true, is_on, format!("View {title}"))
        });
        let tip = format!("{tip} ({})", i + 1);
        if response.on_hover_text(keys::shown(ui.ctx(), &tip)).clicked() {
            *chosen = Some(command);
        }
    }
}

/// Shows the buttons in the right part of the bar, from the right edge inwards.
fn right(app: &App, ui: &mut Ui, chosen: &mut Option<Command>) {
    let palette = theme::palette(ui.ctx());
    let mut button = |ui: &mut Ui, icon, label: &str, command, on: Option<bool>| {
        let look = Look { enabled: app.is_enabled(command), chosen: on, ..Look::default() };
        // The name of a switch does not change, so its tooltip states both directions.
        let tip = on.map_or_else(String::new, |_| app.editor.command_text(command));
        if icons::button(ui, icon, label, &tip, look).clicked() {
            *chosen = Some(command);
        }
    };
    button(ui, Icon::Sun, "Switch between light and dark theme", Command::Theme, None);
    button(ui, Icon::Search, &keys::shown(ui.ctx(), "Commands (Ctrl+K)"), Command::Palette, None);
    let paused = app.editor.session().solved.paused;
    let icon = if paused { Icon::Play } else { Icon::Pause };
    button(ui, icon, "Pause solving", Command::Pause, Some(paused));
    let redo = app.editor.command_text(Command::Redo);
    button(ui, Icon::Redo, &redo, Command::Redo, None);
    let undo = app.editor.command_text(Command::Undo);
    button(ui, Icon::Undo, &undo, Command::Undo, None);
    // If the bar is short of space, the undo label is hidden first.
    let room = ui.available_width() - 4.0;
    if app.editor.session().history.undo_name().is_some() && room > 60.0 {
        // Painted only: the button next to it has the same name for screen readers.
        let galley = ui.painter().layout_no_wrap(undo, theme::regular(12.0), palette.text2);
        let size = Vec2::new(galley.size().x.min(room), galley.size().y);
        let (rect, _) = ui.allocate_exact_size(size, egui::Sense::hover());
        ui.painter().with_clip_rect(rect).galley(rect.min, galley, palette.text2);
    }
}
