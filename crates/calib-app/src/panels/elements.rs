//! What cameras share: marks, links, control points, and how well views agree.

use calib_core::{Known, Link, LinkKind, ResidualOf};
use calib_editor::{Action, Apart, Part, apart, far_links, places};
use egui::{RichText, Ui, Vec2};

use crate::command::Command;
use crate::panels::measured::{TAPE, empty_field, known_fields};
use crate::panels::{heading, length_field};
use crate::state::App;
use crate::theme;

/// Links: who sees each, how far the views are apart on the floor.
pub fn links(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    heading(ui, "Links", "apart on the floor");
    if app.editor.session().site.links.is_empty() {
        ui.label(RichText::new("K links what two views show.").color(palette.text2));
    }
    let mut chosen = None;
    let mut change = None;
    for (index, link) in app.editor.session().site.links.iter().enumerate() {
        let waits = link.seen.len() < 2;
        let name = link.id.clone().unwrap_or_else(|| format!("link {}", index + 1));
        ui.horizontal(|ui| {
            let mut on = !link.off;
            if ui.checkbox(&mut on, "").on_hover_text(format!("Use {name}")).changed() {
                change = Some((index, Link { off: !on, ..link.clone() }));
            }
            let colour = if waits { palette.warn } else { palette.text };
            let text = RichText::new(&name).font(theme::medium(12.0)).color(colour);
            let response = ui.add(egui::Button::new(text).frame(false));
            if response.clicked() {
                chosen = Some(index);
            }
            for seen in &link.seen {
                let camera =
                    app.editor.session().site.cameras.iter().position(|camera| camera.id == seen.camera);
                if let Some(camera) = camera {
                    let (rect, _) = ui.allocate_exact_size(Vec2::splat(16.0), egui::Sense::hover());
                    crate::paint::chip(ui.painter(), rect.center(), camera);
                    joint_residual(app, ui, index, &seen.camera);
                }
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let (text, colour) = match (waits, apart(app.editor.session(), link)) {
                    (true, _) => ("1 view".into(), palette.text2),
                    (false, Some(apart)) => {
                        (how_far(app, apart), if apart.is_far() { palette.bad } else { palette.text2 })
                    }
                    (false, None) => ("\u{2014}".into(), palette.text2),
                };
                ui.label(RichText::new(text).color(colour));
            });
        });
        let is_own = |part: &Part| matches!(part, Part::Link { link, .. } if *link == index);
        if app.editor.session().selection.iter().any(is_own) {
            ui.horizontal(|ui| change = change.take().or_else(|| link_fields(app, ui, index)));
        }
    }
    if let Some((index, link)) = change {
        app.send(Action::SetLink(index, Box::new(link)));
    }
    if let Some(link) = chosen {
        let seen = app.editor.session().site.links.get(link).and_then(|link| link.seen.first()).cloned();
        let camera =
            seen.and_then(|seen| app.editor.session().site.cameras.iter().position(|c| c.id == seen.camera));
        if let Some(camera) = camera {
            app.send(Action::Drop);
            app.send(Action::SelectOn(camera, Part::Link { link, seen: 0, point: 0 }));
        }
    }
}

/// How many pixels off a view is after a joint solve.
fn joint_residual(app: &App, ui: &mut Ui, link: usize, camera: &str) {
    let palette = theme::palette(ui.ctx());
    let found = app.editor.session().solved.joint_link(app.editor.site(), link);
    let Some(residual) = found.and_then(|found| found.residuals.iter().find(|r| r.camera == camera)) else {
        return;
    };
    let sigma = app.editor.session().site.camera(camera).and_then(|camera| camera.sigma_px).unwrap_or(1.0);
    let colour = if residual.outlier { palette.bad } else { theme::residual(palette, residual.px / sigma) };
    ui.label(RichText::new(format!("{:.1}", residual.px)).small().color(colour)).on_hover_text("px");
}

/// How a saved version differs from this one.
pub fn compared(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some(saved) = app.editor.compared() else { return };
    heading(ui, "Against the saved version", "position, turn");
    for (index, camera) in app.editor.session().site.cameras.iter().enumerate() {
        let old = saved.camera(&camera.id).and_then(calib_core::SiteCamera::camera);
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

/// What a link is and how high it is; the link as it is to become.
fn link_fields(app: &App, ui: &mut Ui, index: usize) -> Option<(usize, Link)> {
    let link = app.editor.session().site.links.get(index)?;
    let mut new = link.clone();
    match link.kind {
        LinkKind::Point => {
            let mut height = link.height_m.unwrap_or(0.0);
            let label = ui.label("above the floor");
            if ui
                .add(length_field(app.editor.session().units, &mut height, -1e5))
                .labelled_by(label.id)
                .changed()
            {
                new.height_m = Some(height).filter(|height| *height != 0.0);
            }
        }
        LinkKind::Line if ui.button("It is a post").on_hover_text("Foot first, then head").clicked() => {
            new.kind = LinkKind::Post;
            for seen in &mut new.seen {
                let ends = seen.segment.take().unwrap_or_default();
                (seen.foot, seen.head) = (ends.first().copied(), ends.last().copied());
            }
        }
        LinkKind::Post => {
            post_fields(app, ui, link, &mut new);
            if ui.button("It is a floor line").clicked() {
                (new.kind, new.length_m) = (LinkKind::Line, None);
                for seen in &mut new.seen {
                    seen.segment =
                        seen.foot.take().zip(seen.head.take()).map(|(foot, head)| vec![foot, head]);
                }
            }
        }
        LinkKind::Line => {}
    }
    (new != *link).then_some((index, new))
}

/// The length of a post: measured, or empty with what it looks like as a hint.
fn post_fields(app: &App, ui: &mut Ui, link: &Link, new: &mut Link) {
    let session = app.editor.session();
    let label = ui.label("long");
    let Some(known) = &mut new.length_m else {
        let estimate = places::estimated_post(session, link);
        let metres = empty_field(ui, ("post", &link.id), label.id, session.units, estimate);
        new.length_m = metres.map(|metres| Known::prior(metres, TAPE));
        return;
    };
    known_fields(ui, label.id, session.units, known);
    if ui.button("Not measured").clicked() {
        new.length_m = None;
    }
}

/// A distance between views, with how far they may be apart by their own uncertainty.
fn how_far(app: &App, apart: Apart) -> String {
    let units = app.editor.session().units;
    format!("{} \u{b1} {}", units.small(apart.metres), units.small(apart.sigma))
}

/// Links of the camera in hand that are farther apart than chance explains.
pub fn far_apart(app: &mut App, ui: &mut Ui) {
    let (far, all) = far_links(app.editor.session(), app.editor.session().camera);
    if all == 0 {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let text = format!("{far} of {all} links apart by more than 3 \u{3c3}");
    let shows = ui.horizontal(|ui| {
        ui.label(RichText::new(text).color(if far > 0 { palette.bad } else { palette.text2 }));
        far > 0 && ui.button("Show").clicked()
    });
    if shows.inner {
        app.tell(Command::ViewAll);
    }
}

/// Refine, and what it changed.
pub fn agreement(app: &mut App, ui: &mut Ui) {
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
    if let Some(overlaps) =
        app.editor.session().solved.joint_report().map(|report| report.site.overlaps.clone())
    {
        for overlap in overlaps {
            let units = app.editor.session().units;
            let apart = overlap.floor_rms_m.map_or_else(|| "\u{2014}".into(), |rms| units.small(rms));
            // Links that leave nothing to spare agree by themselves: what they say is in the \u{b1}.
            let sure =
                overlap.floor_sigma_m.map_or_else(String::new, |s| format!(" \u{b1} {}", units.small(s)));
            ui.label(format!("{} and {}: {apart}{sure}", overlap.cameras[0], overlap.cameras[1]));
        }
    }
    if let Some(command) = chosen {
        app.tell(command);
    }
}

/// The control points of the camera in hand.
pub fn controls(app: &mut App, ui: &mut Ui) {
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
