//! Links, a table: a row for each, a column for every camera that shows any.

use calib_core::single::Known;

use calib_editor::{Action, Apart, Part, apart, far_links, planes};
use calib_site::{Link, LinkKind, counted};
use egui::{RichText, ScrollArea, Ui, Vec2};

use crate::command::Command;
use crate::panels::result::{TAPE, empty_field, known_fields};
use crate::panels::{heading, length_field};
use crate::state::App;
use crate::theme;

/// Links: who sees each and how far off each is, how far the views are apart on the floor; a column for each.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    heading(ui, "Links", "px by camera, apart on the floor");
    if app.editor.session().site.links.is_empty() {
        ui.label(RichText::new("K links what two views show.").color(palette.text2));
        return;
    }
    let cameras = linked(app);
    let mut wishes = Vec::new();
    ScrollArea::horizontal().id_salt("links").show(ui, |ui| {
        egui::Grid::new("links").num_columns(cameras.len() + 3).spacing([4.0, 2.0]).show(ui, |ui| {
            titles(ui, &cameras);
            for index in 0..app.editor.session().site.links.len() {
                link_row(app, ui, index, &cameras, &mut wishes);
                ui.end_row();
            }
        });
    });
    for index in 0..app.editor.session().site.links.len() {
        let is_own = |part: &Part| matches!(part, Part::Link { link, .. } if *link == index);
        if app.editor.session().selection.iter().any(is_own) {
            let changed = ui.horizontal_wrapped(|ui| link_fields(app, ui, index)).inner;
            wishes.extend(changed.map(|(index, link)| Wish::Change(index, Box::new(link))));
        }
    }
    wishes.into_iter().for_each(|wish| grant(app, wish));
}

/// What a row of the table asks for.
enum Wish {
    Change(usize, Box<Link>),
    Select(usize),
}

fn grant(app: &mut App, wish: Wish) {
    match wish {
        Wish::Change(index, link) => app.send(Action::SetLink(index, link)),
        Wish::Select(link) => {
            let site = app.editor.site();
            let seen = site.links.get(link).and_then(|link| link.seen.first());
            let camera = seen.and_then(|seen| site.cameras.iter().position(|c| c.id == seen.camera));
            if let Some(camera) = camera {
                app.send(Action::Drop);
                app.send(Action::SelectOn(camera, Part::Link { link, seen: 0, point: 0 }));
            }
        }
    }
}

/// The cameras that any link shows, in the order of the site.
fn linked(app: &App) -> Vec<usize> {
    let site = app.editor.site();
    let is_linked = |id: &str| site.links.iter().any(|link| link.seen.iter().any(|seen| seen.camera == id));
    let is_asked = |&camera: &usize| site.has_shared(camera) && is_linked(&site.cameras[camera].id);
    (0..site.cameras.len()).filter(is_asked).collect()
}

fn titles(ui: &mut Ui, cameras: &[usize]) {
    ui.label("");
    ui.label("");
    for &camera in cameras {
        let (rect, _) = ui.allocate_exact_size(Vec2::new(24.0, 16.0), egui::Sense::hover());
        crate::paint::chip(ui.painter(), rect.right_center() - Vec2::new(8.0, 0.0), camera);
    }
    ui.end_row();
}

fn link_row(app: &App, ui: &mut Ui, index: usize, cameras: &[usize], wishes: &mut Vec<Wish>) {
    let palette = theme::palette(ui.ctx());
    let Some(link) = app.editor.session().site.links.get(index) else { return };
    let waits = link.seen.len() < 2;
    let name = link.id.clone().unwrap_or_else(|| format!("link {}", index + 1));
    let mut on = !link.off;
    if ui.checkbox(&mut on, "").on_hover_text(format!("Use {name}")).changed() {
        wishes.push(Wish::Change(index, Box::new(Link { off: !on, ..link.clone() })));
    }
    let colour = if waits { palette.warn } else { palette.text };
    let text = RichText::new(&name).font(theme::medium(12.0)).color(colour);
    let button = egui::Button::new(text).frame(false).truncate();
    if ui.add_sized([80.0, 16.0], button).on_hover_text(&name).clicked() {
        wishes.push(Wish::Select(index));
    }
    for &camera in cameras {
        let id = &app.editor.site().cameras[camera].id;
        let is_seen = link.seen.iter().any(|seen| seen.camera == *id);
        right(ui, 24.0, |ui| {
            if is_seen {
                joint_residual(app, ui, index, id);
            }
        });
    }
    let (text, colour) = match (waits, apart(app.editor.session(), link)) {
        (true, _) => ("1 view".into(), palette.text2),
        (false, Some(apart)) => {
            (how_far(app, apart), if apart.is_far() { palette.bad } else { palette.text2 })
        }
        (false, None) => ("\u{2014}".into(), palette.text2),
    };
    right(ui, 84.0, |ui| {
        ui.label(RichText::new(text).color(colour));
    });
}

/// A cell of this width, what is in it at its right.
fn right(ui: &mut Ui, width: f32, contents: impl FnOnce(&mut Ui)) {
    let layout = egui::Layout::right_to_left(egui::Align::Center);
    ui.allocate_ui_with_layout(Vec2::new(width, 16.0), layout, |ui| {
        ui.set_min_width(width);
        contents(ui);
    });
}

/// How many pixels off a view is after a joint solve; a dot where that is not known.
fn joint_residual(app: &App, ui: &mut Ui, link: usize, camera: &str) {
    let palette = theme::palette(ui.ctx());
    let site = app.editor.site();
    let own =
        site.links.get(link).and_then(|link| link.seen.iter().find(|seen| seen.camera == camera)?.sigma_px);
    let of_camera = site.camera(camera).and_then(|camera| camera.sigma_px).unwrap_or(1.0);
    let drawn = own.map_or(String::new(), |sigma| {
        let advice = if sigma > of_camera { ": zoom in and drag it to place it finer" } else { "" };
        format!("Clicked to \u{b1} {} px{advice}", (100.0 * sigma).round() / 100.0)
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
    let said = if drawn.is_empty() { "px".to_owned() } else { format!("px off. {drawn}") };
    ui.label(RichText::new(format!("{:.1}", residual.px)).small().color(colour)).on_hover_text(said);
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
        let estimate = planes::estimated_post(session, link);
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
    apart.sigma.map_or_else(|| units.small(apart.metres), |sigma| units.small_and_sigma(apart.metres, sigma))
}

/// Links of the camera in hand that are farther apart than chance explains.
pub fn far_apart(app: &mut App, ui: &mut Ui) {
    let (far, all) = far_links(app.editor.session(), app.editor.session().camera);
    if all == 0 {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let all = counted(all, "link", "links");
    let text = format!("{far} of {all} apart by more than 3 \u{3c3}");
    let shows = ui.horizontal(|ui| {
        ui.label(RichText::new(text).color(if far > 0 { palette.bad } else { palette.text2 }));
        far > 0 && ui.button("Show").clicked()
    });
    if shows.inner {
        app.tell(Command::ViewAll);
    }
}
