//! Fields of a plan from a drawing: page and paper scale of a PDF, unit and layers of a DXF. Also snapping of clicks
//! on the plan to corners of the drawing.

use calib_core::PlanPixel;
use calib_editor::{Action, TOOLS, plan_scale};
use calib_plan::{DrawingFacts, DrawingKind, Layer};
use calib_report::added_walls_text;
use calib_site::{Plan, WallEntry, counted};
use egui::{ComboBox, DragValue, RichText, ScrollArea, Ui};

use crate::state::App;
use crate::theme;

/// Units of length of a DXF: name, and length in metres.
const UNITS: [(&str, f64); 5] =
    [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("inches", 0.0254), ("feet", 0.3048)];

/// Titles of the tools whose clicks on the plan snap to corners of the drawing.
const SNAPPING_TOOLS: [&str; 4] = ["Control point", "Measure", "Area of interest", "Wall"];

/// Shows the fields of a drawing. Returns the name of the undo step if a field was changed. The function is not
/// inlined, so that the web build can load it later, in the second part of the program.
#[inline(never)]
pub(super) fn fields(ui: &mut Ui, drawing: &DrawingFacts, plan: &mut Plan) -> Option<&'static str> {
    let mut changed = None;
    if let (Some(metres), Some(units_per_px)) = (drawing.metres_per_px, drawing.units_per_px) {
        let is_other = (plan.metres_per_px / metres - 1.0).abs() > 1e-6;
        let is_whole_unit =
            UNITS.iter().any(|(_, one)| (plan.metres_per_px / (units_per_px * one) - 1.0).abs() < 1e-6);
        if is_other && !is_whole_unit {
            let text = "The scale in the drawing differs from the scale of the plan. If the drawing was replaced, \
                        load the plan again.";
            ui.label(RichText::new(text).color(theme::palette(ui.ctx()).warn));
        }
    }
    if drawing.pages > 1 {
        let mut page = plan.page.unwrap_or(1);
        let last = u32::try_from(drawing.pages).unwrap_or(u32::MAX);
        let field = DragValue::new(&mut page).speed(0.05).range(1..=last).suffix(format!(" of {last}"));
        if labelled(ui, "Page", field.update_while_editing(false)) {
            (plan.page, changed) = (Some(page), Some("choose a page of the plan"));
        }
    }
    if let Some(paper) = drawing.paper_metres_per_px {
        let mut ratio = plan.metres_per_px / paper;
        let field = DragValue::new(&mut ratio).speed(1.0).range(0.1..=1e6).prefix("1 : ").max_decimals(2);
        let mut is_changed = labelled(ui, "Paper scale", field.update_while_editing(false));
        for stated in drawing.scales_in_text.iter().copied().map(f64::from) {
            let is_other = (ratio / stated - 1.0).abs() >= 1e-3;
            if is_other && ui.button(format!("Use 1 : {stated} from the page")).clicked() {
                (ratio, is_changed) = (stated, true);
            }
        }
        if is_changed {
            (plan.metres_per_px, changed) = (paper * ratio, Some("change the scale of the plan"));
        }
    }
    if let Some(units_per_px) = drawing.units_per_px {
        changed = unit(ui, units_per_px, plan).or(changed);
    }
    if drawing.kind == DrawingKind::Dxf {
        changed = layers(ui, drawing, plan).or(changed);
    }
    changed
}

fn labelled(ui: &mut Ui, title: &str, field: DragValue<'_>) -> bool {
    let palette = theme::palette(ui.ctx());
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new(title).color(palette.text2));
        ui.add(field).labelled_by(label.id).changed()
    })
    .inner
}

/// Shows the choice of the unit of a DXF. Returns the name of the undo step if the unit was changed.
fn unit(ui: &mut Ui, units_per_px: f64, plan: &mut Plan) -> Option<&'static str> {
    let palette = theme::palette(ui.ctx());
    let own = plan.metres_per_px / units_per_px;
    let current = UNITS.iter().find(|(_, metres)| (own / metres - 1.0).abs() < 1e-6);
    let mut changed = None;
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Unit").color(palette.text2));
        let shown = current.map_or("other", |(name, _)| name);
        let list = ComboBox::from_id_salt("unit of the drawing").selected_text(shown).width(80.0);
        let list = list.show_ui(ui, |ui| {
            for (name, metres) in UNITS {
                if ui.selectable_label(shown == name, name).clicked() {
                    (plan.metres_per_px, changed) =
                        (metres * units_per_px, Some("change the unit of the plan"));
                }
            }
        });
        list.response.labelled_by(label.id);
    });
    changed
}

/// Shows the layers of a DXF as check boxes. Returns the name of the undo step if a layer was switched.
fn layers(ui: &mut Ui, drawing: &DrawingFacts, plan: &mut Plan) -> Option<&'static str> {
    /// Largest height of the list, in points.
    const MAX_HEIGHT: f32 = 180.0;
    let used: Vec<_> = drawing.layers.iter().filter(|layer| layer.count > 0).collect();
    let mut changed = None;
    let title = format!("Layers ({})", used.len());
    egui::CollapsingHeader::new(title).id_salt("layers of the drawing").show(ui, |ui| {
        ScrollArea::vertical().max_height(MAX_HEIGHT).min_scrolled_height(MAX_HEIGHT).show(ui, |ui| {
            for layer in &used {
                let mut is_shown = layer.is_shown;
                if ui.checkbox(&mut is_shown, &layer.name).changed() {
                    let shown = used
                        .iter()
                        .filter(|other| if other.name == layer.name { is_shown } else { other.is_shown });
                    let shown: Vec<String> = shown.map(|layer| layer.name.clone()).collect();
                    // At least one layer stays visible, because a plan without layers is empty.
                    if !shown.is_empty() {
                        (plan.layers, changed) = (Some(shown), Some("choose layers of the plan"));
                    }
                }
            }
        });
    });
    changed
}

/// Shows a menu with the visible layers of a DXF. The straight lines of the chosen layer become walls for the coverage.
#[inline(never)]
pub(crate) fn walls_menu(app: &mut App, ui: &mut Ui) {
    let drawing = app.plan_picture().and_then(|picture| picture.drawing.as_ref());
    let layers: Vec<&Layer> = drawing
        .into_iter()
        .flat_map(|drawing| &drawing.layers)
        .filter(|layer| !layer.lines_px.is_empty())
        .collect();
    let states_unit = drawing.is_none_or(|drawing| drawing.metres_per_px.is_some());
    if layers.is_empty() {
        return;
    }
    let mut chosen = None;
    let menu = ui.menu_button("Add walls from a layer", |ui| {
        for layer in layers {
            let lines = counted(layer.lines_px.len(), "line", "lines");
            if ui.button(format!("{} ({lines})", layer.name)).clicked() {
                chosen = Some(layer.clone());
            }
        }
    });
    menu.response.on_hover_text("Add the straight lines of a visible layer as walls, which block the view.");
    if let Some(layer) = chosen {
        add_walls(app, &layer, states_unit);
    }
}

/// Adds the straight lines of a layer as walls. `states_unit` is true if the drawing contains its unit.
fn add_walls(app: &mut App, layer: &Layer, states_unit: bool) {
    let mut site = app.editor.site().clone();
    let scale = plan_scale(&site);
    let floor = |end: [f32; 2]| scale.floor_from_plan(PlanPixel::from(end.map(f64::from)));
    let walls = layer.lines_px.iter().map(|line| line.map(floor));
    let [added, short] =
        site.add_walls(walls.map(|[from_m, to_m]| WallEntry { from_m, to_m, height_m: None }));
    if let Err(error) = site.check() {
        app.send(Action::AddError(format!("The walls of the layer {} were not added: {error}.", layer.name)));
        return;
    }
    let mut note = format!("{}.", added_walls_text(&layer.name, added, layer.other_lines, short));
    if !states_unit {
        note.push_str(" The drawing contains no unit. Check the scale of the plan.");
    }
    if added > 0 {
        let name = format!("add the walls of {}", layer.name);
        app.send(Action::Change { site: Box::new(site), name });
    }
    app.send(Action::Note(note));
}

/// Returns the corner of the drawing nearest to a floor point; all values are in metres. `None` without a corner
/// within `radius`, or if the current tool does not snap to corners.
#[inline(never)]
pub(crate) fn snapped(app: &App, at: [f64; 2], radius: f64) -> Option<[f64; 2]> {
    let title = TOOLS.get(app.editor.tool_row())?.title;
    let drawing = app.plan_picture()?.drawing.as_ref().filter(|_| SNAPPING_TOOLS.contains(&title))?;
    let scale = plan_scale(app.editor.site());
    let pixel = scale.plan_from_floor(at.into());
    let radius_px = radius / scale.metres_per_px;
    let corners = drawing.corners_px.iter().map(|&[x, y]| PlanPixel::new(f64::from(x), f64::from(y)));
    let near = corners.filter(|corner| corner.distance(pixel) < radius_px);
    let nearest = near.min_by(|a, b| a.distance(pixel).total_cmp(&b.distance(pixel)))?;
    let floor = scale.floor_from_plan(nearest);
    Some([floor.x, floor.y])
}
