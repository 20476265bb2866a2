//! Panels: the table of links, with a column for each camera, and the marks (virtual elements).

use calib_core::floor::COURTS;
use calib_core::single::Known;
use calib_core::{MarkKind, WorldPoint};
use calib_editor::{Action, LinkDistance, Part, Units, inconsistent_links, link_distance, planes};
use calib_site::{Link, LinkKind, Mark, counted};
use egui::{DragValue, RichText, ScrollArea, Ui, Vec2};

use crate::annotate::result::{TAPE, empty_field, known_fields};
use crate::command::Command;
use crate::icons::{self, Icon, Look};
use crate::keys;
use crate::state::App;
use crate::theme;
use crate::widgets::{heading, length_field};

const fn icon(kind: MarkKind) -> Icon {
    match kind {
        MarkKind::Cross => Icon::Cross,
        MarkKind::Post => Icon::Post,
        MarkKind::Box => Icon::Box,
        MarkKind::Cylinder => Icon::Cylinder,
        MarkKind::Circle => Icon::Circle,
        MarkKind::Person => Icon::Person,
        MarkKind::Grid => Icon::Grid,
        MarkKind::Rectangle => Icon::Rectangle,
    }
}

/// Shows the panel of marks: the kind of the next mark, and the list of existing marks.
pub(crate) fn marks_ui(app: &mut App, ui: &mut Ui) {
    heading(ui, "Marks", "M");
    let mut wanted = None;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for kind in MarkKind::ALL {
            let name = format!("{kind:?}").to_lowercase();
            let look = Look {
                chosen: Some(app.editor.session().tool.mark_kind == kind),
                size: Vec2::splat(28.0),
                ..Look::default()
            };
            if icons::button(ui, icon(kind), &format!("Mark kind {name}"), &name, look).clicked() {
                wanted = Some(kind);
            }
        }
    });
    if let Some(kind) = wanted {
        app.send(Action::MarkKind(kind));
    }
    for index in 0..app.editor.session().site.marks.len() {
        mark_row(app, ui, index);
    }
}

fn mark_row(app: &mut App, ui: &mut Ui, index: usize) {
    let palette = theme::palette(ui.ctx());
    let Some(mark) = app.editor.session().site.marks.get(index).cloned() else { return };
    let part = Part::Mark(index);
    let selected = app.editor.session().selection.contains(&part);
    let name = app.editor.session().part_name(part);
    let WorldPoint { x, y, .. } = mark.at_m;
    let units = app.editor.session().site.units;
    let mut on = !mark.off;
    ui.horizontal(|ui| {
        ui.checkbox(&mut on, "").on_hover_text(format!("Use {name}"));
        icons::inline(ui, icon(mark.kind), palette.text);
        if ui.selectable_label(selected, RichText::new(&name).font(theme::medium(12.0))).clicked() {
            app.send(Action::Select(part));
        }
        let sizes: Vec<String> = mark.size_m.iter().map(|size| units.number(*size, 2)).collect();
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(units.point([x, y], 2));
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                let text = RichText::new(sizes.join(" \u{d7} ")).color(palette.text2);
                ui.add(egui::Label::new(text).truncate());
            });
        });
    });
    if on == mark.off {
        let name = format!("switch {name} {}", if on { "on" } else { "off" });
        app.send(Action::SetMark { index, mark: Box::new(Mark { off: !on, ..mark }), name });
        return;
    }
    if selected {
        mark_fields(app, ui, index, mark);
    }
}

/// Shows the menu of known courts. Writes the chosen court size to `size_m`; returns whether a court was chosen.
fn court_menu(ui: &mut Ui, units: Units, size_m: &mut Vec<f64>) -> bool {
    let mut is_chosen = false;
    ui.menu_button("Known courts\u{2026}", |ui| {
        for court in &COURTS {
            let size = court.size.map(|side| units.number(side, 2)).join(" \u{d7} ");
            let text = format!("{}: {size} {}", court.title, units.symbol());
            let is_own = size_m[..] == court.size;
            if ui.selectable_label(is_own, text).on_hover_text(court.source).clicked() {
                *size_m = court.size.to_vec();
                is_chosen = true;
                ui.close();
            }
        }
    });
    is_chosen
}

/// Shows the fields for size, rotation and height of the selected mark.
fn mark_fields(app: &mut App, ui: &mut Ui, index: usize, mut mark: Mark) {
    let palette = theme::palette(ui.ctx());
    let units = app.editor.session().site.units;
    let mut changed = false;
    let mut field = |ui: &mut Ui, title: &str, edit: DragValue<'_>| {
        let label = ui.label(RichText::new(title).small().color(palette.text2));
        changed |= ui.add(edit).labelled_by(label.id).changed();
    };
    ui.horizontal_wrapped(|ui| {
        for (title, value) in mark.kind.size_names().iter().zip(mark.size_m.iter_mut()) {
            let is_count = ["columns", "rows"].contains(title);
            let edit = if is_count {
                DragValue::new(value).range(1.0..=1e3).max_decimals(0).update_while_editing(false)
            } else {
                length_field(units, value, 1e-3)
            };
            field(ui, title, edit);
        }
        let turn = DragValue::new(&mut mark.turn_deg)
            .speed(0.1)
            .range(-360.0..=360.0)
            .suffix("\u{b0}")
            .max_decimals(3);
        field(ui, "rotation", turn.update_while_editing(false));
        field(ui, "above the floor", length_field(units, &mut mark.at_m.z, -1e5));
    });
    if mark.kind == MarkKind::Rectangle {
        changed |= court_menu(ui, units, &mut mark.size_m);
    }
    let was_fixed = mark.fixed;
    ui.checkbox(&mut mark.fixed, "keep fixed when all cameras are refined");
    if changed || was_fixed != mark.fixed {
        for size in &mut mark.size_m {
            *size = size.clamp(1e-3, 1e4);
        }
        for (title, count) in mark.kind.size_names().iter().zip(&mut mark.size_m) {
            if ["columns", "rows"].contains(title) {
                *count = count.round();
            }
        }
        let name = format!("change {}", app.editor.session().part_name(Part::Mark(index)));
        app.send(Action::SetMark { index, mark: Box::new(mark), name });
    }
}

/// Shows the table of links: the residual of every camera in pixels, and the disagreement on the floor.
pub(crate) fn links_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    heading(ui, "Links", "residual in px per camera; gap on the floor");
    if app.editor.session().site.links.is_empty() {
        let text = if keys::are_shown(ui.ctx()) {
            "Press K, then click a point that is visible in two views."
        } else {
            "Choose the Link tool, then click a point that is visible in two views."
        };
        ui.label(RichText::new(text).color(palette.text2));
        return;
    }
    let cameras = linked_cameras(app);
    let mut requests = Vec::new();
    ScrollArea::horizontal().id_salt("links").show(ui, |ui| {
        egui::Grid::new("links").num_columns(cameras.len() + 3).spacing([4.0, 2.0]).show(ui, |ui| {
            column_titles(app, ui, &cameras);
            for index in 0..app.editor.session().site.links.len() {
                link_row(app, ui, index, &cameras, &mut requests);
                ui.end_row();
            }
        });
    });
    for index in 0..app.editor.session().site.links.len() {
        let is_own = |part: &Part| matches!(part, Part::Link { link, .. } if *link == index);
        if app.editor.session().selection.iter().any(is_own) {
            let changed = ui.horizontal_wrapped(|ui| link_fields(app, ui, index)).inner;
            requests.extend(changed.map(|(index, link)| RowRequest::Change(index, Box::new(link))));
        }
    }
    requests.into_iter().for_each(|request| apply_request(app, request));
}

/// Request of the operator in a row of the table. The number is the index of the link.
enum RowRequest {
    Change(usize, Box<Link>),
    Select(usize),
}

/// Sends the actions of a request to the editor.
fn apply_request(app: &mut App, request: RowRequest) {
    match request {
        RowRequest::Change(index, link) => app.send(Action::SetLink(index, link)),
        RowRequest::Select(link) => {
            let site = app.editor.site();
            let seen = site.links.get(link).and_then(|link| link.seen.first());
            let camera = seen.and_then(|seen| site.cameras.iter().position(|c| c.id == seen.camera));
            if let Some(camera) = camera {
                app.send(Action::CancelGesture);
                app.send(Action::SelectOn(camera, Part::Link { link, seen: 0, point: 0 }));
            }
        }
    }
}

/// Returns the indices of the cameras that observe at least one link, in the order of the site. A camera with several
/// periods is listed once.
fn linked_cameras(app: &App) -> Vec<usize> {
    let site = app.editor.site();
    let is_linked = |id: &str| site.links.iter().any(|link| link.seen.iter().any(|seen| seen.camera == id));
    let is_asked = |&camera: &usize| site.owns_links(camera) && is_linked(&site.cameras[camera].id);
    (0..site.cameras.len()).filter(is_asked).collect()
}

fn column_titles(app: &App, ui: &mut Ui, cameras: &[usize]) {
    ui.label("");
    ui.label("");
    for &camera in cameras {
        let (rect, _) = ui.allocate_exact_size(Vec2::new(24.0, 16.0), egui::Sense::hover());
        let slot = app.editor.session().camera_slot(camera);
        crate::paint::chip(ui.painter(), rect.right_center() - Vec2::new(8.0, 0.0), slot);
    }
    ui.end_row();
}

fn link_row(app: &App, ui: &mut Ui, index: usize, cameras: &[usize], requests: &mut Vec<RowRequest>) {
    let palette = theme::palette(ui.ctx());
    let Some(link) = app.editor.session().site.links.get(index) else { return };
    let waits = link.seen.len() < 2;
    let name = link.id.clone().unwrap_or_else(|| format!("link {}", index + 1));
    let mut on = !link.off;
    if ui.checkbox(&mut on, "").on_hover_text(format!("Use {name}")).changed() {
        requests.push(RowRequest::Change(index, Box::new(Link { off: !on, ..link.clone() })));
    }
    let colour = if waits { palette.warn } else { palette.text };
    let text = RichText::new(&name).font(theme::medium(12.0)).color(colour);
    let button = egui::Button::new(text).frame(false).truncate();
    if ui.add_sized([80.0, 16.0], button).on_hover_text(&name).clicked() {
        requests.push(RowRequest::Select(index));
    }
    for &camera in cameras {
        let id = &app.editor.site().cameras[camera].id;
        let is_seen = link.seen.iter().any(|seen| seen.camera == *id);
        right_cell(ui, 24.0, |ui| {
            if is_seen {
                joint_residual(app, ui, index, id);
            }
        });
    }
    let (text, colour) = match (waits, link_distance(app.editor.session(), link)) {
        (true, _) => ("1 view".into(), palette.text2),
        (false, Some(apart)) => {
            (distance_text(app, apart), if apart.is_significant() { palette.bad } else { palette.text2 })
        }
        (false, None) => ("\u{2014}".into(), palette.text2),
    };
    right_cell(ui, 84.0, |ui| {
        ui.label(RichText::new(text).color(colour));
    });
}

/// Shows a right-aligned cell; `width` is in points.
fn right_cell(ui: &mut Ui, width: f32, contents: impl FnOnce(&mut Ui)) {
    let layout = egui::Layout::right_to_left(egui::Align::Center);
    ui.allocate_ui_with_layout(Vec2::new(width, 16.0), layout, |ui| {
        ui.set_min_width(width);
        contents(ui);
    });
}

/// Shows the residual of an observation after the joint solve, in pixels; a dot while the residual is
/// unknown.
fn joint_residual(app: &App, ui: &mut Ui, link: usize, camera: &str) {
    let palette = theme::palette(ui.ctx());
    let site = app.editor.site();
    let own =
        site.links.get(link).and_then(|link| link.seen.iter().find(|seen| seen.camera == camera)?.sigma_px);
    let of_camera = site.camera(camera).and_then(|camera| camera.sigma_px).unwrap_or(1.0);
    let drawn = own.map_or(String::new(), |sigma| {
        let advice =
            if sigma > of_camera { ". Zoom in and drag the point to improve the accuracy" } else { "" };
        format!("Click accuracy \u{b1} {} px{advice}", (100.0 * sigma).round() / 100.0)
    });
    let found = app.editor.session().solved.joint_link(site, link);
    let Some(residual) = found.and_then(|found| found.residuals.iter().find(|r| r.camera == camera)) else {
        let dot = ui.label(RichText::new("\u{b7}").color(palette.text3));
        if !drawn.is_empty() {
            dot.on_hover_text(drawn);
        }
        return;
    };
    let sigma = own.unwrap_or(of_camera);
    let colour = if residual.outlier { palette.bad } else { theme::residual(palette, residual.px / sigma) };
    let residual_text = "Residual, in pixels";
    let mut said =
        if drawn.is_empty() { residual_text.to_owned() } else { format!("{residual_text}. {drawn}") };
    let view = site.cameras.iter().position(|entry| entry.id == camera);
    if view.is_some_and(|view| app.editor.session().solved.is_link_unchecked(site, link, view)) {
        said += ". A wrong click here cannot be detected. Link one more point that this camera sees.";
    }
    ui.label(RichText::new(format!("{:.1}", residual.px)).small().color(colour)).on_hover_text(said);
}

/// Shows the fields for the kind, height or length of a link. Returns the index and the changed link; `None` without a
/// change.
fn link_fields(app: &App, ui: &mut Ui, index: usize) -> Option<(usize, Link)> {
    let link = app.editor.session().site.links.get(index)?;
    let mut new = link.clone();
    match link.kind {
        LinkKind::Point => {
            let mut height = link.height_m.unwrap_or(0.0);
            let label = ui.label("above the floor");
            if ui
                .add(length_field(app.editor.session().site.units, &mut height, -1e5))
                .labelled_by(label.id)
                .changed()
            {
                new.height_m = Some(height).filter(|height| *height != 0.0);
            }
        }
        LinkKind::Line
            if ui
                .button("Change to a post")
                .on_hover_text("The first end becomes the foot, and the other end becomes the head")
                .clicked() =>
        {
            new.kind = LinkKind::Post;
            for seen in &mut new.seen {
                let ends = seen.segment.take().unwrap_or_default();
                (seen.foot, seen.head) = (ends.first().copied(), ends.last().copied());
            }
        }
        LinkKind::Post => {
            post_fields(app, ui, link, &mut new);
            let tip = "The line lies on the floor. Its ends need not be the same in every view";
            if ui.button("Change to a floor line").on_hover_text(tip).clicked() {
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

/// Shows the field for the length of a post: the measured length, or an empty field with the estimate as a
/// hint.
fn post_fields(app: &App, ui: &mut Ui, link: &Link, new: &mut Link) {
    let session = app.editor.session();
    let label = ui.label("length");
    let Some(known) = &mut new.length_m else {
        let estimate = planes::estimated_post_height(session, link);
        let metres = empty_field(ui, ("post", &link.id), label.id, session.site.units, estimate, None);
        new.length_m = metres.map(|metres| Known::prior(metres, TAPE));
        return;
    };
    known_fields(ui, label.id, session.site.units, known);
    if ui.button("Not measured").on_hover_text("Estimate the length instead").clicked() {
        new.length_m = None;
    }
}

/// Returns the disagreement of two views on the floor as text, with its standard deviation if it is known.
fn distance_text(app: &App, apart: LinkDistance) -> String {
    let units = app.editor.session().site.units;
    apart.sigma.map_or_else(
        || units.short_length(apart.metres),
        |sigma| units.short_length_and_sigma(apart.metres, sigma),
    )
}

/// Shows the number of links of the current camera whose views disagree on the floor by more than three standard
/// deviations. A button shows all cameras.
pub(crate) fn far_apart(app: &mut App, ui: &mut Ui) {
    let (far, all) = inconsistent_links(app.editor.session(), app.editor.session().camera);
    if all == 0 {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let all = counted(all, "link", "links");
    let text = format!("Disagreement above 3 \u{3c3}: {far} of {all}");
    let shows = ui.horizontal(|ui| {
        ui.label(RichText::new(text).color(if far > 0 { palette.bad } else { palette.text2 }));
        far > 0 && ui.button("Show").on_hover_text("Show the links in all cameras").clicked()
    });
    if shows.inner {
        app.send_command(Command::ViewAll);
    }
}
