//! Panel with the areas of interest and the walls of the site, while the coverage is shown.

use calib_core::floor::DensityLevel;
use calib_editor::{Action, TOOLS};
use calib_site::{Area, Site, WallEntry};
use egui::{ComboBox, RichText, Ui, Vec2};

use crate::icons::{self, Icon, Look};
use crate::state::App;
use crate::theme;
use crate::widgets::{entered_text, heading, length_field};

/// Shows the areas and walls, and the buttons that draw new ones.
pub(crate) fn survey_ui(app: &mut App, ui: &mut Ui) {
    heading(ui, "Areas and walls", "for the coverage");
    for (index, area) in app.editor.site().areas.clone().iter().enumerate() {
        area_row(app, ui, index, area);
    }
    for (index, wall) in app.editor.site().walls.clone().iter().enumerate() {
        wall_row(app, ui, index, wall);
    }
    ui.horizontal(|ui| {
        for (text, icon, tip) in [
            ("Draw an area", calib_editor::Icon::Area, "Floor that the cameras must see"),
            ("Draw a wall", calib_editor::Icon::Wall, "A wall or shelf that blocks the view"),
        ] {
            let tool = TOOLS.iter().position(|tool| tool.icon == icon);
            if ui.button(text).on_hover_text(tip).clicked() {
                tool.into_iter().for_each(|tool| app.send(Action::SelectTool(tool)));
            }
        }
    });
}

/// Sends a change of the site.
fn change(app: &mut App, name: String, edit: impl FnOnce(&mut Site)) {
    let mut site = app.editor.site().clone();
    edit(&mut site);
    app.send(Action::Change { site: Box::new(site), name });
}

/// Shows a button that removes an item. Returns whether it was clicked.
fn is_removed(ui: &mut Ui, name: &str) -> bool {
    let look = Look { size: Vec2::splat(18.0), ..Look::default() };
    icons::button(ui, Icon::Close, &format!("Remove {name}"), "", look).clicked()
}

/// Returns the name of a required level.
const fn level_name(level: Option<DensityLevel>) -> &'static str {
    match level {
        None => "visible",
        Some(level) => level.name(),
    }
}

/// Shows the name, the required level and the result of an area of interest.
fn area_row(app: &mut App, ui: &mut Ui, index: usize, area: &Area) {
    let palette = theme::palette(ui.ctx());
    let name = area.name.clone().unwrap_or_else(|| area.id.clone());
    let results = app.coverage.as_ref().and_then(|shown| shown.result.as_ref().ok());
    let is_met = results.and_then(|found| found.results.get(index)).map(|(_, is_met)| *is_met);
    ui.horizontal(|ui| {
        let (response, typed) = entered_text(ui, ("area", index), &name, 90.0);
        response.on_hover_text("Name of the area");
        if let Some(typed) = typed {
            change(app, format!("rename {}", area.id), |site| site.areas[index].name = Some(typed));
        }
        let mut level = area.level;
        let choice =
            ComboBox::from_id_salt(("area level", index)).width(84.0).selected_text(level_name(level));
        let choice = choice.show_ui(ui, |ui| {
            for choice in std::iter::once(None).chain(DensityLevel::ALL.map(Some)) {
                ui.selectable_value(&mut level, choice, level_name(choice));
            }
        });
        choice.response.on_hover_text("Required level of the pixel density");
        if level != area.level {
            change(app, format!("change the level of {name}"), |site| site.areas[index].level = level);
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if is_removed(ui, &name) {
                change(app, format!("remove {name}"), |site| {
                    site.areas.remove(index);
                });
            }
            let (text, colour) = match is_met {
                Some(true) => ("met", palette.ok),
                Some(false) => ("missed", palette.warn),
                None => ("", palette.text2),
            };
            ui.label(RichText::new(text).color(colour));
        });
    });
}

/// Shows the length and the height of a wall.
fn wall_row(app: &mut App, ui: &mut Ui, index: usize, wall: &WallEntry) {
    /// Height of a wall for which a height is entered, in metres, before it is changed.
    const USUAL_HEIGHT_M: f64 = 2.0;
    let palette = theme::palette(ui.ctx());
    let units = app.editor.site().units;
    let name = format!("wall {}", index + 1);
    ui.horizontal(|ui| {
        let length = units.length(wall.from_m.distance(wall.to_m), 1);
        ui.label(RichText::new(format!("Wall {}", index + 1)).color(palette.text));
        ui.label(RichText::new(length).color(palette.text2));
        let mut height = wall.height_m;
        let mut is_low = height.is_some();
        let tip = "Otherwise the wall is higher than every camera";
        if ui.checkbox(&mut is_low, "height").on_hover_text(tip).changed() {
            height = is_low.then_some(USUAL_HEIGHT_M);
        }
        if let Some(metres) = &mut height {
            ui.add(length_field(units, metres, 0.01));
        }
        if height != wall.height_m {
            change(app, format!("change the height of {name}"), |site| site.walls[index].height_m = height);
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if is_removed(ui, &name) {
                change(app, format!("remove {name}"), |site| {
                    site.walls.remove(index);
                });
            }
        });
    });
}
