//! Panels: measured distances, agreement of cameras, control points, and the notice of an outdated joint
//! solution.

use calib_core::ResidualOf;
use calib_core::single::Known;
use calib_editor::{Action, Part, PointAction, pair_rms_distance, planes};
use calib_site::Distance;
use egui::{ComboBox, Frame, Margin, RichText, Ui, Vec2};

use crate::annotate::result::{TAPE, empty_field, known_fields};
use crate::command::Command;
use crate::icons::{self, Icon, Look};
use crate::plan::placement::REFINE_TIP;
use crate::state::App;
use crate::theme;
use crate::widgets::{heading, length_field};

/// Shows the differences between a saved version and the current site.
pub(crate) fn compared(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(saved) = app.editor.compared_site() else { return };
    heading(ui, "Compared with the saved version", "position, rotation");
    for (index, camera) in app.editor.session().site.cameras.iter().enumerate() {
        let old = saved.camera(&camera.id).and_then(calib_site::SiteCamera::camera);
        let text = match (old, app.editor.session().solved.pose(index)) {
            (Some(old), Some(new)) => {
                let turned = yaw_difference_deg(&old, new);
                let moved = app.editor.session().site.units.short_length(old.position.distance(new.position));
                format!("{moved}, {turned:.2}\u{b0}")
            }
            (None, _) => "missing or not solved in the saved version".into(),
            (_, None) => "not solved now".into(),
        };
        ui.horizontal(|ui| {
            ui.label(&camera.id);
            ui.label(RichText::new(text).color(palette.text2));
        });
    }
    if ui.button("Done").on_hover_text("End the comparison").clicked() {
        app.send(Action::Compare(None));
    }
}

/// Returns the absolute difference of the yaws of two poses, in degrees, 0 to 180.
fn yaw_difference_deg(a: &calib_core::Camera, b: &calib_core::Camera) -> f64 {
    let by = (a.yaw - b.yaw).to_degrees().rem_euclid(360.0);
    by.min(360.0 - by)
}

/// Shows the disagreement of every pair of cameras with a common floor area, before and after the refinement.
fn pairs_ui(app: &App, ui: &mut Ui) {
    let session = app.editor.session();
    let Some(report) = session.solved.joint_report() else { return };
    let units = session.site.units;
    let index = |id: &String| session.site.cameras.iter().position(|camera| camera.id == *id);
    egui::Grid::new("pairs").num_columns(3).show(ui, |ui| {
        for overlap in &report.site.overlaps {
            let [a, b] = &overlap.cameras;
            ui.label(format!("{a} and {b}"));
            let before = session.live.before_refine.as_ref().zip(index(a).zip(index(b)));
            let was = before.and_then(|(poses, (a, b))| pair_rms_distance(session, poses, [a, b]));
            let now = overlap.floor_rms_m.map_or_else(|| "no link".into(), |rms| units.short_length(rms));
            let change =
                was.map_or_else(|| now.clone(), |was| format!("{} \u{2192} {now}", units.short_length(was)));
            ui.label(change);
            // Links without redundancy agree by construction; their uncertainty is in the \u{b1}.
            let sure = overlap
                .floor_sigma_m
                .map_or_else(String::new, |s| format!("\u{b1} {}", units.short_length(s)));
            ui.label(sure);
            ui.end_row();
        }
    });
}

/// Shows the Refine button and the effect of the last refinement.
pub(crate) fn agreement(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    heading(ui, "All cameras together", "");
    let mut chosen = None;
    ui.horizontal(|ui| {
        let text = RichText::new("Refine all").color(palette.bg).font(theme::medium(12.0));
        if ui.add(egui::Button::new(text).fill(palette.accent)).on_hover_text(REFINE_TIP).clicked() {
            chosen = Some(Command::Refine);
        }
        if app.editor.session().live.before_refine.is_some()
            && ui
                .button("Show the earlier poses")
                .on_hover_text("Show or hide the poses before the last refinement")
                .clicked()
        {
            chosen = Some(Command::CompareBefore);
        }
    });
    if let Some(before) = &app.editor.session().live.before_refine {
        for (index, camera) in app.editor.session().site.cameras.iter().enumerate() {
            let (Some(Some(old)), Some(new)) = (before.get(index), app.editor.session().solved.pose(index))
            else {
                continue;
            };
            let moved = old.position.distance(new.position);
            let turned = yaw_difference_deg(old, new);
            ui.horizontal(|ui| {
                ui.label(&camera.id);
                let moved = app.editor.session().site.units.short_length(moved);
                let text = format!("moved {moved}, rotated {turned:.2}\u{b0}");
                ui.label(RichText::new(text).color(palette.text2));
            });
        }
        ui.label(RichText::new("Undo reverts the refinement.").small().color(palette.text3));
    }
    pairs_ui(app, ui);
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

/// Shows the control points of the current camera.
pub(crate) fn controls(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    heading(ui, "Control points", "residual, px");
    let Some(entry) = app.editor.session().entry() else { return };
    let points = entry.control_points.clone();
    if points.is_empty() {
        ui.label(RichText::new("Press C to add a point with known coordinates.").color(palette.text2));
    }
    let mut change = None;
    for (index, point) in points.iter().enumerate() {
        let name = point.label(index);
        let residual = app.editor.session().solution().and_then(|solution| {
            let own =
                |r: &&calib_core::Residual| r.of == ResidualOf::ControlPoint && r.id.as_ref() == Some(&name);
            solution.residuals.iter().find(own).map(|r| r.px)
        });
        let part = Part::Control(index);
        let selected = app.editor.session().selection.contains(&part);
        let mut new = point.clone();
        let mut changed = false;
        ui.horizontal(|ui| {
            let mut on = !point.off;
            if ui.checkbox(&mut on, "").on_hover_text(format!("Use {name}")).changed() {
                (new.off, changed) = (!on, true);
            }
            if ui.selectable_label(selected, RichText::new(&name).font(theme::medium(12.0))).clicked() {
                app.send(Action::Select(part));
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let text = residual.map_or_else(|| "\u{2014}".into(), |px| format!("{px:.1}"));
                ui.label(text);
            });
        });
        if selected && let Some(control) = point.control_point(&app.editor.session().site) {
            let mut world = control.world;
            ui.horizontal(|ui| {
                for (title, value) in [("x", &mut world.x), ("y", &mut world.y), ("z", &mut world.z)] {
                    let label = ui.label(RichText::new(title).color(palette.text2));
                    changed |= ui
                        .add(length_field(app.editor.session().site.units, value, -1e5))
                        .labelled_by(label.id)
                        .changed();
                }
            });
            if world != control.world {
                (new.world_m, new.plan_px, new.height_m) = (Some(world), None, None);
                (new.lat_deg, new.lon_deg, new.alt_m, new.crs_m) = (None, None, None, None);
            }
        }
        if changed {
            change = Some((index, new));
        }
    }
    if let Some((index, new)) = change {
        app.send(Action::Points(PointAction::SetControl(index, Box::new(new))));
    }
}

/// Shows the panel of measured distances between links or marks.
pub(crate) fn distances_ui(app: &mut App, ui: &mut Ui) {
    heading(ui, "Distances", "measured");
    let mut list = app.editor.session().site.distances.clone();
    list_fields(app, ui, &mut list);
    let links = app.editor.session().site.links.iter().filter_map(|link| link.id.clone());
    let marks = app.editor.session().site.marks.iter().filter_map(|mark| mark.id.clone());
    let ids: Vec<String> = links.chain(marks).collect();
    if ids.len() >= 2 {
        ui.horizontal(|ui| list.extend(new_distance(app, ui, &ids)));
    } else {
        let palette = theme::palette(ui.ctx());
        ui.label(RichText::new("Add two links or marks first.").color(palette.text2));
    }
    if list != app.editor.session().site.distances {
        app.send(Action::SetDistances(list));
    }
}

fn list_fields(app: &App, ui: &mut Ui, list: &mut Vec<Distance>) {
    let mut removed = None;
    for (index, distance) in list.iter_mut().enumerate() {
        ui.horizontal(|ui| {
            let label = ui.label(format!("{} to {}", distance.between[0], distance.between[1]));
            known_fields(ui, label.id, app.editor.session().site.units, &mut distance.length_m);
            let look = Look { size: Vec2::splat(18.0), ..Look::default() };
            if icons::button(ui, Icon::Close, &format!("Remove distance {}", index + 1), "", look).clicked() {
                removed = Some(index);
            }
        });
    }
    if let Some(index) = removed {
        list.remove(index);
    }
}

/// Shows the choice of two links or marks and the field for their distance; returns the entered distance.
fn new_distance(app: &mut App, ui: &mut Ui, ids: &[String]) -> Option<Distance> {
    let [a, b] = &mut app.pair;
    for (salt, chosen) in [("from", a), ("to", b)] {
        ComboBox::from_id_salt(salt).width(64.0).selected_text(chosen.as_str()).show_ui(ui, |ui| {
            for id in ids {
                ui.selectable_value(chosen, id.clone(), id);
            }
        });
    }
    if app.pair[0] == app.pair[1] || !app.pair.iter().all(|id| ids.contains(id)) {
        ui.label(RichText::new("choose two").color(theme::palette(ui.ctx()).text3));
        return None;
    }
    let session = app.editor.session();
    let estimate = planes::estimated_distance(session, &app.pair);
    let label = ui.label(RichText::new("measured").color(theme::palette(ui.ctx()).text2));
    let metres = empty_field(ui, ("distance", &app.pair), label.id, session.site.units, estimate, None)?;
    let between = app.pair.clone();
    let length_m = Known::prior(metres, TAPE);
    Some(Distance { id: None, name: None, off: false, keep: false, between, length_m })
}

/// Shows the notice that the joint solution is out of date, with a button that starts a new joint solve.
pub(crate) fn out_of_date_ui(app: &mut App, ui: &mut Ui) {
    if !app.editor.session().solved.is_joint_out_of_date() || !app.editor.tool().is_idle() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let mut again = false;
    Frame::NONE.fill(palette.warn_bg).inner_margin(Margin::symmetric(12, 8)).show(ui, |ui| {
        ui.set_width(ui.available_width());
        let what = "The site has changed since the cameras were refined.";
        ui.label(RichText::new(what).color(palette.warn));
        again = ui.button("Refine all again").on_hover_text(REFINE_TIP).clicked();
    });
    if again {
        app.send_command(Command::Refine);
    }
}
