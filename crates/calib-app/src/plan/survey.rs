//! Panels of the coverage: areas of interest, walls, smallest pixel densities of the levels, and hand-over zones.

use calib_core::floor::{DensityLevel, LevelLimits};
use calib_editor::{Action, TOOLS};
use calib_site::{Area, LevelLimitsEntry, Site, WallEntry};
use egui::{ComboBox, RichText, ScrollArea, Ui, Vec2};

use crate::icons::{self, Icon, Look};
use crate::plan::drawing_fields::walls_menu;
use crate::state::{App, Mode};
use crate::theme;
use crate::widgets::{entered_text, heading, length_field};

/// Shows the areas and walls, and the buttons that draw new ones.
pub(crate) fn survey_ui(app: &mut App, ui: &mut Ui) {
    heading(ui, "Areas and walls", "for coverage");
    for (index, area) in app.editor.site().areas.clone().iter().enumerate() {
        area_row(app, ui, index, area);
    }
    for (index, wall) in app.editor.site().walls.clone().iter().enumerate() {
        wall_row(app, ui, index, wall);
    }
    ui.horizontal(|ui| {
        for (text, icon, tip) in [
            ("Draw an area", calib_editor::Icon::Area, "Floor area that the cameras must see"),
            ("Draw a wall", calib_editor::Icon::Wall, "A wall or shelf that blocks the view"),
        ] {
            let tool = TOOLS.iter().position(|tool| tool.icon == icon);
            if ui.button(text).on_hover_text(tip).clicked() {
                if app.view.mode == Mode::Scene {
                    app.view.mode = Mode::Plan;
                }
                tool.into_iter().for_each(|tool| app.send(Action::SelectTool(tool)));
            }
        }
    });
    walls_menu(app, ui);
    limits_ui(app, ui);
}

/// Shows the hand-over zones of the coverage: floor areas that two cameras see.
pub(crate) fn hand_overs_ui(app: &mut App, ui: &mut Ui) {
    /// Largest height of the list, in points.
    const MAX_HEIGHT: f32 = 220.0;
    let palette = theme::palette(ui.ctx());
    let units = app.editor.site().units;
    let Some(shown) = &mut app.coverage else { return };
    let Some(found) = shown.result.as_ref().ok().filter(|found| !found.hand_overs.is_empty()) else { return };
    let mut pointed = None;
    let tip = "Floor area that two cameras see. The expected disagreement is the RMS distance between the \
               two computed positions of a target at the chosen height, without detector errors.";
    heading(ui, "Hand-over zones", "expected disagreement");
    let row_height = 2.0 * ui.text_style_height(&egui::TextStyle::Body) + 6.0;
    ScrollArea::vertical().id_salt("hand-over zones").max_height(MAX_HEIGHT).show_rows(
        ui,
        row_height,
        found.hand_overs.len(),
        |ui, rows| {
            for index in rows {
                let zone = &found.hand_overs[index];
                let row = ui.scope(|ui| {
                    ui.set_height(row_height);
                    ui.spacing_mut().item_spacing.y = 0.0;
                    ui.horizontal(|ui| {
                        ui.label(RichText::new(zone.cameras.join(" \u{2013} ")).color(palette.text));
                        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                            let size = zone.area / units.metres().powi(2);
                            let text = format!("{size:.1} {}\u{b2}", units.symbol());
                            ui.label(RichText::new(text).color(palette.text2));
                        });
                    });
                    ui.add(
                        egui::Label::new(RichText::new(&zone.disagreement).small().color(palette.text2))
                            .truncate(),
                    );
                });
                if row.response.on_hover_text(tip).hovered() {
                    pointed = Some(index);
                }
            }
        },
    );
    shown.pointed = pointed;
}

/// Shows the limits of the levels. A change is sent when the operator has entered a number.
fn limits_ui(app: &mut App, ui: &mut Ui) {
    let limits = app.editor.site().level_limits();
    egui::CollapsingHeader::new("Pixel density limits").id_salt("pixel density limits").show(ui, |ui| {
        let palette = theme::palette(ui.ctx());
        let mut changed = None;
        for (index, level) in DensityLevel::ALL.into_iter().enumerate() {
            let below = index.checked_sub(1).map_or(0.1, |lower| limits.0[lower] + 0.1);
            let above = limits.0.get(index + 1).map_or(10_000.0, |upper| upper - 0.1);
            let mut limit = limits.of(level);
            ui.horizontal(|ui| {
                let label = ui.label(RichText::new(level.name()).color(palette.text2));
                let field = egui::DragValue::new(&mut limit).speed(0.5).range(below..=above).max_decimals(1);
                let field = field.clamp_existing_to_range(false).suffix(" px/m").update_while_editing(false);
                if ui.add(field).labelled_by(label.id).changed() {
                    changed = Some((level, limit));
                }
            });
        }
        if limits != LevelLimits::default() && ui.button("Reset to the EN 62676-4 limits").clicked() {
            change(app, "reset the pixel density limits".into(), |site| site.level_px_per_m = None);
        }
        if let Some((level, limit)) = changed {
            let mut limits = limits;
            limits.0[level as usize] = limit;
            let entry = (limits != LevelLimits::default()).then(|| LevelLimitsEntry::from(limits));
            change(app, format!("change the pixel density limit \"{}\"", level.name()), |site| {
                site.level_px_per_m = entry;
            });
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
        choice.response.on_hover_text("Required level of pixel density");
        if level != area.level {
            change(app, format!("change the required level of {name}"), |site| {
                site.areas[index].level = level;
            });
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
    /// Initial height of a wall when the operator switches its height on, in metres.
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
        let tip = "Without a height, the wall is assumed to be higher than every camera";
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
