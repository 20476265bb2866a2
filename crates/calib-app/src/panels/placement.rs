//! Stage 2: numbers of the place, and the scale of the plan.

use calib_core::STAGE_1_HEIGHT;
use egui::{DragValue, RichText, Ui};

use crate::app::App;
use crate::command::{self, Command};
use crate::panels::result::cells;
use crate::panels::{digits, heading, number};
use crate::theme;

/// Where the camera in hand stands, by numbers.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let camera = app.session.camera;
    let Some(entry) = app.session.entry() else { return };
    let (id, fixed) = (entry.id.clone(), entry.placement.as_ref().is_some_and(|p| p.fixed));
    heading(ui, &format!("{id} on the plan"), if fixed { "held" } else { "" });
    if app.session.is_held_by_points(camera) {
        let text = "Placed by control points. Switch them off to move it by hand.";
        ui.label(RichText::new(text).color(palette.text2));
        pose_rows(app, ui);
        return;
    }
    let Some(mut placement) = app.session.placement(camera) else {
        ui.label(RichText::new("Complete stage 1 first: lines on the image.").color(palette.text2));
        return;
    };
    let mut turn = placement.turn.to_degrees();
    let mut height = placement.scale * STAGE_1_HEIGHT;
    let sigma = app.session.solution().and_then(|solution| solution.sigma.clone());
    let sigma = sigma.as_ref();
    let mut changed = None;
    let mut field =
        |ui: &mut Ui, title: &str, value: &mut f64, unit: &str, speed: f64, sigma: Option<f64>| {
            ui.horizontal(|ui| {
                let label = ui.label(RichText::new(title).color(palette.text2));
                ui.add_space((90.0 - label.rect.width()).max(0.0));
                let edit = DragValue::new(value).speed(speed).max_decimals(3).update_while_editing(false);
                let response = ui.add_sized([84.0, 20.0], edit).labelled_by(label.id);
                ui.label(RichText::new(unit).color(palette.text2));
                if let Some(sigma) = sigma {
                    ui.label(
                        RichText::new(format!("\u{b1} {}", number(sigma, digits(sigma))))
                            .color(palette.text3),
                    );
                }
                if response.changed() {
                    changed = Some(title.to_lowercase());
                }
            });
        };
    field(ui, "x", &mut placement.by.x, "m", 0.01, sigma.and_then(|s| s.x_m));
    field(ui, "y", &mut placement.by.y, "m", 0.01, sigma.and_then(|s| s.y_m));
    field(ui, "Turn", &mut turn, "\u{b0}", 0.1, sigma.and_then(|s| s.yaw_deg));
    field(ui, "Height", &mut height, "m", 0.005, sigma.and_then(|s| s.z_m));
    let scale = height / STAGE_1_HEIGHT;
    ui.label(RichText::new(format!("Height = 3 m \u{d7} scale {scale:.3}")).small().color(palette.text3));
    if let Some(what) = changed.filter(|_| height > 0.0) {
        (placement.turn, placement.scale) = (turn.to_radians(), scale);
        app.cancel();
        app.session.place(camera, placement);
        app.session.commit(format!("set {what} of {id}"));
    }
    buttons(app, ui, fixed);
    handles(ui);
}

fn buttons(app: &mut App, ui: &mut Ui, fixed: bool) {
    let mut chosen = None;
    ui.horizontal(|ui| {
        if ui.button(if fixed { "Release" } else { "Hold here" }).clicked() {
            chosen = Some(Command::FixPlacement);
        }
        if ui.button("Forget").clicked() {
            chosen = Some(Command::ResetPlacement);
        }
        if ui.button("Refine all").clicked() {
            chosen = Some(Command::Refine);
        }
    });
    if let Some(command) = chosen {
        let ctx = ui.ctx().clone();
        command::run(app, &ctx, command, egui::Modifiers::NONE);
    }
}

fn handles(ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    ui.add_space(4.0);
    for (title, what) in [
        ("Foot, polygon", "move"),
        ("Ring", "turn about the camera"),
        ("Square", "scale, sets the height"),
        ("Corners", "turn and scale about the centre"),
        ("Double click", "pin a pivot for the corners"),
    ] {
        ui.horizontal(|ui| {
            ui.label(RichText::new(title).small().color(palette.text2));
            ui.label(RichText::new(what).small().color(palette.text3));
        });
    }
}

fn pose_rows(app: &App, ui: &mut Ui) {
    let Some(solution) = app.session.solution() else { return };
    let (Some(at), sigma) = (solution.position_m, solution.sigma.as_ref()) else { return };
    let rows = [
        ("x", at.x, sigma.and_then(|s| s.x_m), "m"),
        ("y", at.y, sigma.and_then(|s| s.y_m), "m"),
        ("Turn", solution.yaw_deg.unwrap_or_default(), sigma.and_then(|s| s.yaw_deg), "\u{b0}"),
        ("Height", at.z, sigma.and_then(|s| s.z_m), "m"),
    ];
    for (title, value, sigma, unit) in rows {
        let shown = sigma.map_or(2, digits).min(3);
        ui.horizontal(|ui| {
            cells(ui, title, &number(value, shown), sigma.map(|s| number(s, shown)), unit);
        });
    }
}

/// The plan: its scale, and how images lie on it.
pub fn plan(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let name = app.session.site.plan.as_ref().and_then(|plan| plan.image.clone());
    let name = name.map(|name| name.rsplit(['/', '\\']).next().unwrap_or_default().to_owned());
    heading(ui, "Plan", name.as_deref().unwrap_or("none"));
    if app.session.site.plan.is_none() {
        ui.label(RichText::new("A floor is shown without one.").color(palette.text2));
        if ui.button("Load a floor plan\u{2026}").clicked() {
            app.ask(crate::dialog::Purpose::LoadPlan);
        }
    } else {
        scale_fields(app, ui);
    }
    let label = ui.label(RichText::new("Image on plan").color(palette.text2));
    ui.horizontal(|ui| {
        ui.add(egui::Slider::new(&mut app.opacity, 0.0..=1.0).show_value(false)).labelled_by(label.id);
        ui.label(format!("{:.0} %", 100.0 * app.opacity));
    });
    ui.horizontal(|ui| {
        ui.checkbox(&mut app.blend, "all cameras");
        ui.checkbox(&mut app.coverage, "coverage");
    });
}

fn scale_fields(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(mut plan) = app.session.site.plan.clone() else { return };
    let mut changed = None;
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Scale").color(palette.text2));
        let mut mm = 1e3 * plan.metres_per_px;
        let field = DragValue::new(&mut mm).speed(0.05).range(0.001..=1e5).max_decimals(4);
        if ui.add(field.suffix(" mm a pixel").update_while_editing(false)).labelled_by(label.id).changed() {
            plan.metres_per_px = 1e-3 * mm;
            changed = Some("change the scale of the plan");
        }
    });
    if let Some([a, b]) = app.session.measured {
        let px = a.distance(b);
        let mut metres = px * plan.metres_per_px;
        ui.horizontal(|ui| {
            let label = ui.label(format!("{px:.0} px are"));
            let field =
                DragValue::new(&mut metres).speed(0.01).range(1e-3..=1e5).suffix(" m").max_decimals(4);
            if ui.add(field.update_while_editing(false)).labelled_by(label.id).changed() && px > 0.0 {
                plan.metres_per_px = metres / px;
                changed = Some("set the scale of the plan");
            }
            if ui.button("Done").clicked() {
                app.session.measured = None;
            }
        });
    } else {
        let text = "A measures it: two clicks and a length.";
        ui.label(RichText::new(text).small().color(palette.text3));
    }
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Turn of x axis").color(palette.text2));
        let field = DragValue::new(&mut plan.x_axis_deg).speed(0.1).suffix(" \u{b0}").max_decimals(3);
        if ui.add(field.update_while_editing(false)).labelled_by(label.id).changed() {
            changed = Some("turn the plan's axes");
        }
    });
    if let Some(name) = changed {
        app.cancel();
        app.session.site.plan = Some(plan);
        app.session.commit(name);
    }
}
