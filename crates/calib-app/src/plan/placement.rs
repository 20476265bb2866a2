//! Panel of stage 2: the numbers of the placement, the scale of the plan, and the opacity of projected images.

use calib_core::Placement;
use calib_core::floor::STAGE_1_HEIGHT;
use calib_core::single::Known;
use calib_editor::{Action, PlacementNumber, Units};
use calib_site::{Sigmas, Solution};
use egui::{Align, DragValue, Layout, RichText, Ui};

use crate::annotate::result::{Number, TOP, held_at, lock, orientation_row};
use crate::command::Command;
use crate::focus::{self, RequestedField};
use crate::keys;
use crate::plan::drawing_fields;
use crate::state::App;
use crate::theme;
use crate::widgets::{cells, decimals, heading, length_field, number};

/// Shows the placement of the current camera as numbers.
pub fn placement_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let camera = app.editor.session().camera;
    let Some(entry) = app.editor.session().entry() else { return };
    let (id, fixed) = (entry.id.clone(), entry.placement.as_ref().is_some_and(|p| p.fixed));
    heading(ui, &format!("{id} on the plan"), if fixed { "fixed" } else { "" });
    if app.editor.session().is_fixed_by_control_points(camera) {
        let text = "Placed by control points. Switch them off to move the camera by hand.";
        ui.label(RichText::new(text).color(palette.text2));
        pose_rows(app, ui);
        from_stage_1(app, ui);
        return;
    }
    let Some(placement) = app.editor.session().placement(camera) else {
        ui.label(RichText::new("Draw lines on the image first.").color(palette.text2));
        return;
    };
    numbers(app, ui, &id, placement, fixed);
    buttons(app, ui, fixed);
    from_stage_1(app, ui);
}

/// Yaw that the panel shows for a camera: its title, and its value and sigma in degrees.
struct ShownYaw {
    title: &'static str,
    degrees: f64,
    sigma: Option<f64>,
}

impl ShownYaw {
    /// Returns the shown yaw; `degrees` is the rotation of the placement. For a camera that looks straight
    /// down, yaw and roll are one rotation. The direction of the top of its image replaces them.
    fn from_solution(solution: Option<&Solution>, degrees: f64) -> Self {
        let camera = solution.and_then(Solution::camera);
        let Some((yaw, down)) = camera.and_then(|camera| Some((camera.yaw, camera.straight_down()?))) else {
            let sigma = solution.and_then(|solution| solution.sigma.as_ref()?.yaw_deg);
            return Self { title: "Rotation", degrees, sigma };
        };
        let heading = degrees + (down.heading - yaw).to_degrees();
        let degrees = 180.0 - (180.0 - heading).rem_euclid(360.0);
        Self { title: TOP, degrees, sigma: down.heading_sigma.map(f64::to_degrees) }
    }
}

/// Shows the numbers of the placement (position, yaw and height), with fields and locks.
fn numbers(app: &mut App, ui: &mut Ui, id: &str, mut placement: Placement, fixed: bool) {
    let (palette, camera) = (theme::palette(ui.ctx()), app.editor.session().camera);
    let told = ShownYaw::from_solution(app.editor.session().solution(), placement.turn.to_degrees());
    let mut turn = told.degrees;
    let mut height = placement.scale * STAGE_1_HEIGHT;
    let units = app.editor.session().site.units;
    let sigmas = app.editor.session().solution().and_then(|solution| solution.sigma.clone());
    let of = |value: fn(&Sigmas) -> Option<f64>, unit: f64| Some(value(sigmas.as_ref()?)? / unit);
    let degrees = DragValue::new(&mut turn).speed(0.1).range(-360.0..=360.0).suffix("\u{b0}").max_decimals(3);
    let known = Number::Height.known(app);
    let held = app.editor.session().entry().and_then(|entry| entry.placement.as_ref().map(|own| own.held));
    let held = held.unwrap_or_default();
    let place = |is_held: bool| (fixed || is_held).then_some(true);
    let of_height = fixed.then_some(true).or(known.map(|known| known.fixed));
    let [by_x, by_y] = [&mut placement.by.x, &mut placement.by.y].map(|by| length_field(units, by, -1e5));
    let rows = [
        ("x", by_x, of(|s| s.x_m, units.metres()), place(held.x)),
        ("y", by_y, of(|s| s.y_m, units.metres()), place(held.y)),
        (told.title, degrees.update_while_editing(false), told.sigma, place(held.turn)),
        ("Height", length_field(units, &mut height, 1e-3), of(|s| s.z_m, units.metres()), of_height),
    ];
    let (mut changed, mut locked) = (None, None);
    for (title, edit, sigma, is_held) in rows {
        let asked = field(ui, title, edit, sigma, is_held);
        changed = changed.or(asked.0.then_some(title));
        locked = locked.or(asked.1.then_some(title));
    }
    let scale = height / STAGE_1_HEIGHT;
    let text = format!("Height = {} \u{d7} scale {scale:.3}", units.length(STAGE_1_HEIGHT, 2));
    ui.label(RichText::new(text).small().color(palette.text3));
    match locked {
        // The lock of the height belongs to the camera entry, not to the placement.
        Some("Height") if !fixed => {
            let held = known.is_none().then(|| Known::fixed(held_at(height, 2)));
            Number::Height.set(app, held);
        }
        Some("Height") => app.send(Action::ToggleNumberFixed(PlacementNumber::Height)),
        Some("x") => app.send(Action::ToggleNumberFixed(PlacementNumber::X)),
        Some("y") => app.send(Action::ToggleNumberFixed(PlacementNumber::Y)),
        Some(_) => app.send(Action::ToggleNumberFixed(PlacementNumber::Rotation)),
        None => {}
    }
    if changed == Some("Height")
        && let Some(known) = known.filter(|known| known.fixed && !fixed)
    {
        // A fixed height of the camera entry replaces the height of the placement.
        Number::Height.set(app, Some(Known { value: height, ..known }));
    } else if let Some(what) = changed.filter(|_| height > 0.0) {
        (placement.turn, placement.scale) = (placement.turn + (turn - told.degrees).to_radians(), scale);
        let the = if what.len() == 1 { "" } else { "the " };
        let name = format!("set {the}{} of {id}", what.to_lowercase());
        app.send(Action::Place { camera, placement, name });
    }
}

/// Shows a number with field, sigma and lock. Returns whether the number was changed, and whether the lock
/// was clicked.
fn field(
    ui: &mut Ui,
    title: &str,
    edit: DragValue<'_>,
    sigma: Option<f64>,
    is_held: Option<bool>,
) -> (bool, bool) {
    let palette = theme::palette(ui.ctx());
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new(title).color(palette.text2));
        ui.add_space((56.0 - label.rect.width()).max(0.0));
        let changed = ui.add_sized([84.0, 20.0], edit).labelled_by(label.id).changed();
        let clicked = ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let tip = match (is_held, title) {
                (Some(_), _) => "Let the refinement estimate this value",
                (None, "Height") => "Fix the height",
                (None, _) => "Fix this value in the refinement; the other values stay free",
            };
            // Fixing the yaw of a camera that looks straight down has no effect: its roll can compensate.
            let clicked =
                (title != TOP || is_held.is_some()) && lock(ui, &title.to_lowercase(), is_held, tip);
            let (sure, why) = match sigma {
                Some(sigma) => (number(sigma, decimals(sigma)), "Standard deviation (\u{b1})"),
                None if is_held == Some(true) => ("0".into(), "Fixed as entered"),
                // The uncertainty of a manual placement is unknown, not zero.
                None => ("?".into(), "Unknown: add links or control points"),
            };
            ui.label(RichText::new(format!("\u{b1} {sure}")).color(palette.text2)).on_hover_text(why);
            clicked
        });
        (changed, clicked.inner)
    })
    .inner
}

/// Shows pitch, roll and focal length. They are results of stage 1 and do not depend on the placement.
fn from_stage_1(app: &mut App, ui: &mut Ui) {
    let Some(solution) = app.editor.session().solution().cloned() else { return };
    ui.add_space(4.0);
    heading(ui, "Orientation and focal length", "");
    for which in [Number::Pitch, Number::Roll, Number::Focal] {
        orientation_row(app, ui, &solution, which);
    }
}

/// Tooltip of the buttons that refine all cameras.
pub(crate) const REFINE_TIP: &str = "Solve all cameras together, from their lines, links and points";

fn buttons(app: &mut App, ui: &mut Ui, fixed: bool) {
    let mut chosen = None;
    ui.horizontal(|ui| {
        let (text, tip) = if fixed {
            ("Unfix", "Let the refinement move this camera")
        } else {
            ("Fix here", "Keep this position and direction in the refinement")
        };
        if ui.button(text).on_hover_text(tip).clicked() {
            chosen = Some(Command::FixPlacement);
        }
        if ui.button("Remove").on_hover_text("Remove the placement; the lines stay").clicked() {
            chosen = Some(Command::ResetPlacement);
        }
        if ui.button("Refine all").on_hover_text(REFINE_TIP).clicked() {
            chosen = Some(Command::Refine);
        }
    });
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

/// Shows the meaning of the handles of the current camera.
pub fn handles(app: &App, ui: &mut Ui) {
    let (palette, session) = (theme::palette(ui.ctx()), app.editor.session());
    if session.placement(session.camera).is_none() || session.is_fixed_by_control_points(session.camera) {
        return;
    }
    heading(ui, "Handles", "");
    for (title, what) in [
        ("Foot, polygon", "move"),
        ("Ring", "rotate about the camera"),
        ("Square", "scale and set the height"),
        ("Corners", "rotate and scale about the centre"),
        ("Double-click", "set a pivot for the corners"),
    ] {
        ui.horizontal(|ui| {
            ui.label(RichText::new(title).small().color(palette.text2));
            ui.label(RichText::new(what).small().color(palette.text3));
        });
    }
}

fn pose_rows(app: &App, ui: &mut Ui) {
    let Some(solution) = app.editor.session().solution() else { return };
    let (Some(at), sigma) = (solution.position_m, solution.sigma.as_ref()) else { return };
    let units = app.editor.session().site.units;
    let turn = ShownYaw::from_solution(Some(solution), solution.yaw_deg.unwrap_or_default());
    let rows = [
        ("x", at.x, sigma.and_then(|s| s.x_m), units.metres(), units.symbol()),
        ("y", at.y, sigma.and_then(|s| s.y_m), units.metres(), units.symbol()),
        (turn.title, turn.degrees, turn.sigma, 1.0, "\u{b0}"),
        ("Height", at.z, sigma.and_then(|s| s.z_m), units.metres(), units.symbol()),
    ];
    for (title, value, sigma, one, unit) in rows {
        let (value, sigma) = (value / one, sigma.map(|sigma| sigma / one));
        let shown = sigma.map_or(2, decimals).min(3);
        ui.horizontal(|ui| {
            cells(ui, title, &number(value, shown), sigma.map(|s| number(s, shown)), unit);
        });
    }
}

/// Shows the scale of the plan image, and the opacity of projected images.
pub fn plan(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let name = app.editor.session().site.plan.as_ref().and_then(|plan| plan.image.clone());
    let name = name.map(|name| app.editor.session().images.shown_name(&name));
    heading(ui, "Plan", name.as_deref().unwrap_or("none"));
    if let Some(error) = app.plan_error() {
        ui.label(RichText::new(error).color(palette.bad));
        if ui.button("Load a floor plan\u{2026}").clicked() {
            app.open_dialog(crate::choice::Purpose::LoadPlan);
        }
    }
    if app.editor.session().site.plan.is_none() {
        ui.label(RichText::new("No floor plan is loaded. You can work without one.").color(palette.text2));
        if ui.button("Load a floor plan\u{2026}").clicked() {
            app.open_dialog(crate::choice::Purpose::LoadPlan);
        }
    } else {
        scale_fields(app, ui);
    }
    let label = ui.label(RichText::new("Opacity of images on the plan").color(palette.text2));
    ui.horizontal(|ui| {
        let mut opacity = app.opacity(ui.ctx());
        let slider = egui::Slider::new(&mut opacity, 0.0..=1.0).show_value(false);
        if ui.add(slider).labelled_by(label.id).changed() {
            app.set_opacity(ui.ctx(), opacity);
        }
        ui.label(format!("{:.0} %", 100.0 * opacity));
    });
    ui.horizontal(|ui| {
        ui.checkbox(&mut app.view.blend, "all cameras");
        ui.checkbox(&mut app.view.coverage, "coverage");
    });
}

fn scale_fields(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(mut plan) = app.editor.session().site.plan.clone() else { return };
    let drawing = app.plan_picture().and_then(|picture| picture.drawing.as_ref());
    let mut changed = drawing.and_then(|drawing| drawing_fields::fields(ui, drawing, &mut plan));
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Scale").color(palette.text2));
        let (unit, suffix) = match app.editor.session().site.units {
            Units::Metres => (1e-3, " mm per pixel"),
            Units::Feet => (0.0254, " in per pixel"),
        };
        let mut value = plan.metres_per_px / unit;
        let field = DragValue::new(&mut value).speed(0.05).range(1e-6 / unit..=100.0 / unit).max_decimals(4);
        if ui.add(field.suffix(suffix).update_while_editing(false)).labelled_by(label.id).changed() {
            plan.metres_per_px = unit * value;
            changed = Some("change the scale of the plan");
        }
    });
    if let Some([a, b]) = app.editor.session().tool.measured {
        let px = a.distance(b);
        let mut metres = px * plan.metres_per_px;
        ui.horizontal(|ui| {
            let label = ui.label(format!("{px:.0} px are"));
            let field = length_field(app.editor.session().site.units, &mut metres, 1e-3);
            let response = ui.add(field).labelled_by(label.id);
            focus::focus_if_requested(&response, RequestedField::PlanLength);
            if response.changed() && px > 0.0 {
                plan.metres_per_px = metres / px;
                changed = Some("set the scale of the plan");
            }
            if ui.button("Done").on_hover_text("Clear the two points").clicked() {
                app.send(Action::ClearMeasurement);
            }
        });
    } else {
        let text = "To set the scale, click two points with the Measure tool (A) and enter their distance.";
        ui.label(RichText::new(keys::shown(ui.ctx(), text)).small().color(palette.text3));
    }
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Angle of the x axis").color(palette.text2));
        let field = DragValue::new(&mut plan.x_axis_deg)
            .speed(0.1)
            .range(-360.0..=360.0)
            .suffix("\u{b0}")
            .max_decimals(3);
        if ui.add(field.update_while_editing(false)).labelled_by(label.id).changed() {
            changed = Some("rotate the plan's axes");
        }
    });
    if let Some(name) = changed {
        app.send(Action::SetPlan { plan, name: name.to_owned() });
    }
}
