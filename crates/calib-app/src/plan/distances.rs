//! Distances that were measured: they give the scale where no plan does.
//!
//! What cameras share: control points, and how well views agree.
//!
//! A joint solution that no longer follows from the site says so, with the way out.

use calib_core::ResidualOf;
use calib_core::single::Known;
use calib_editor::{Action, Part, pair_apart, planes};
use calib_site::Distance;
use egui::{ComboBox, Frame, Margin, RichText, Ui, Vec2};

use crate::annotate::result::{TAPE, empty_field, known_fields};
use crate::command::Command;
use crate::icons::{self, Icon, Look};
use crate::state::App;
use crate::theme;
use crate::widgets::{heading, length_field};

/// How a saved version differs from this one.
pub(crate) fn compared(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(saved) = app.editor.compared() else { return };
    heading(ui, "Against the saved version", "position, turn");
    for (index, camera) in app.editor.session().site.cameras.iter().enumerate() {
        let old = saved.camera(&camera.id).and_then(calib_site::SiteCamera::camera);
        let text = match (old, app.editor.session().solved.pose(index)) {
            (Some(old), Some(new)) => {
                let turned = turned(&old, new);
                let moved = app.editor.session().units.small(old.position.distance(new.position));
                format!("{moved}, {turned:.2}\u{b0}")
            }
            (None, _) => "not in it, or not solved".into(),
            (_, None) => "not solved now".into(),
        };
        ui.horizontal(|ui| {
            ui.label(&camera.id);
            ui.label(RichText::new(text).color(palette.text2));
        });
    }
    if ui.button("Done").clicked() {
        app.send(Action::Compare(None));
    }
}

/// By how much two poses are turned against each other about the vertical, in degrees.
fn turned(a: &calib_core::Camera, b: &calib_core::Camera) -> f64 {
    let by = (a.yaw - b.yaw).to_degrees().rem_euclid(360.0);
    by.min(360.0 - by)
}

/// For every pair of cameras that see the same floor: how far they are apart there, before and after.
fn pairs(app: &App, ui: &mut Ui) {
    let session = app.editor.session();
    let Some(report) = session.solved.joint_report() else { return };
    let units = session.units;
    let index = |id: &String| session.site.cameras.iter().position(|camera| camera.id == *id);
    egui::Grid::new("pairs").num_columns(3).show(ui, |ui| {
        for overlap in &report.site.overlaps {
            let [a, b] = &overlap.cameras;
            ui.label(format!("{a} and {b}"));
            let before = session.before_refine.as_ref().zip(index(a).zip(index(b)));
            let was = before.and_then(|(poses, (a, b))| pair_apart(session, poses, [a, b]));
            let now = overlap.floor_rms_m.map_or_else(|| "no link".into(), |rms| units.small(rms));
            let change =
                was.map_or_else(|| now.clone(), |was| format!("{} \u{2192} {now}", units.small(was)));
            ui.label(change);
            // Links that leave nothing to spare agree by themselves: what they say is in the \u{b1}.
            let sure =
                overlap.floor_sigma_m.map_or_else(String::new, |s| format!("\u{b1} {}", units.small(s)));
            ui.label(sure);
            ui.end_row();
        }
    });
}

/// Refine, and what it changed.
pub(crate) fn agreement(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    heading(ui, "All cameras together", "");
    let mut chosen = None;
    ui.horizontal(|ui| {
        let text = RichText::new("Refine").color(palette.bg).font(theme::medium(12.0));
        if ui.add(egui::Button::new(text).fill(palette.accent)).clicked() {
            chosen = Some(Command::Refine);
        }
        if app.editor.session().before_refine.is_some() && ui.button("Compare with before").clicked() {
            chosen = Some(Command::CompareBefore);
        }
    });
    if let Some(before) = &app.editor.session().before_refine {
        for (index, camera) in app.editor.session().site.cameras.iter().enumerate() {
            let (Some(Some(old)), Some(new)) = (before.get(index), app.editor.session().solved.pose(index))
            else {
                continue;
            };
            let moved = old.position.distance(new.position);
            let turned = turned(old, new);
            ui.horizontal(|ui| {
                ui.label(&camera.id);
                let moved = app.editor.session().units.small(moved);
                let text = format!("moved {moved}, turned {turned:.2}\u{b0}");
                ui.label(RichText::new(text).color(palette.text2));
            });
        }
        ui.label(RichText::new("Undo brings the old cameras back.").small().color(palette.text3));
    }
    pairs(app, ui);
    if let Some(command) = chosen {
        app.tell(command);
    }
}

/// The control points of the camera in hand.
pub(crate) fn controls(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    heading(ui, "Control points", "residual, px");
    let Some(entry) = app.editor.session().entry() else { return };
    let points = entry.control_points.clone();
    if points.is_empty() {
        ui.label(RichText::new("C sets a point whose place you know.").color(palette.text2));
    }
    let plan = app.editor.session().site.plan.clone();
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
        if selected && let Some(control) = point.control_point(plan.as_ref()) {
            let mut world = control.world;
            ui.horizontal(|ui| {
                for (title, value) in [("x", &mut world.x), ("y", &mut world.y), ("z", &mut world.z)] {
                    let label = ui.label(RichText::new(title).color(palette.text2));
                    changed |= ui
                        .add(length_field(app.editor.session().units, value, -1e5))
                        .labelled_by(label.id)
                        .changed();
                }
            });
            if world != control.world {
                (new.world_m, new.plan_px, new.height_m) = (Some(world), None, None);
            }
        }
        if changed {
            change = Some((index, new));
        }
    }
    if let Some((index, new)) = change {
        app.send(Action::SetControl(index, Box::new(new)));
    }
}

/// The panel.
pub(crate) fn distances_ui(app: &mut App, ui: &mut Ui) {
    heading(ui, "Distances", "measured");
    let mut list = app.editor.session().site.distances.clone();
    list_fields(app, ui, &mut list);
    let links = app.editor.session().site.links.iter().filter_map(|link| link.id.clone());
    let marks = app.editor.session().site.marks.iter().filter_map(|mark| mark.id.clone());
    let ids: Vec<String> = links.chain(marks).collect();
    if ids.len() >= 2 {
        ui.horizontal(|ui| list.extend(entered(app, ui, &ids)));
    } else {
        let palette = theme::palette(ui.ctx());
        ui.label(RichText::new("Needs two links or marks.").color(palette.text2));
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
            known_fields(ui, label.id, app.editor.session().units, &mut distance.length_m);
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

/// Two ids to choose, and a field for what was measured between them; the distance, once it was entered.
fn entered(app: &mut App, ui: &mut Ui, ids: &[String]) -> Option<Distance> {
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
    let metres = empty_field(ui, ("distance", &app.pair), label.id, session.units, estimate)?;
    let between = app.pair.clone();
    let length_m = Known::prior(metres, TAPE);
    Some(Distance { id: None, name: None, off: false, keep: false, between, length_m })
}

/// The part, while what was solved together is out of date.
pub(crate) fn out_of_date_ui(app: &mut App, ui: &mut Ui) {
    if !app.editor.session().solved.is_joint_out_of_date() || !app.editor.tool().is_idle() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let mut again = false;
    Frame::NONE.fill(palette.warn_bg).inner_margin(Margin::symmetric(12, 8)).show(ui, |ui| {
        ui.set_width(ui.available_width());
        let what = "Refined together, out of date: what it follows from was changed.";
        ui.label(RichText::new(what).color(palette.warn));
        again = ui.button("Refine again").clicked();
    });
    if again {
        app.tell(Command::Refine);
    }
}
