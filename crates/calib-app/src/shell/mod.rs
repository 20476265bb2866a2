//! The window around the canvases: bars, lists, sheets, and the panels of every mode.

pub(crate) mod tour;
pub(crate) mod announce;
pub mod above;
pub(crate) mod cameras;
pub(crate) mod warnings;
pub mod palette;
pub(crate) mod status;
pub mod topbar;
pub mod views;

use calib_editor::{Icon, Part};
use egui::{
    Align2, CentralPanel, Frame, Id, LayerId, Margin, Order, Panel, ScrollArea, Stroke, StrokeKind, Ui,
};

use crate::annotate::{annotations, lens, links, measurements, result, steps};
use crate::files::{address, outside, start, video};
use crate::paint::tag;
use crate::plan::{agreement, distances, ground_points, placement, planes, survey};
use crate::state::{App, Mode};
use crate::widgets::{NARROW, PHONE, section};
use crate::{compare, export, propose, theme};

/// Smallest window width at which the right panel has its full width, in points.
const WIDE_WINDOW: f32 = 1280.0;

/// Widths of the panels for the current width of the window, in points.
#[derive(Clone, Copy)]
struct Widths {
    /// Id under which the panel widths are stored; every layout has its own widths.
    kind: &'static str,
    /// Whether a strip of thumbnails replaces the camera list.
    has_rail: bool,
    /// Default width of the right panel.
    right: f32,
    /// Largest width of the right panel.
    right_most: f32,
}

impl Widths {
    fn of(window: f32) -> Self {
        match window {
            w if w >= WIDE_WINDOW => Self { kind: "wide", has_rail: false, right: 296.0, right_most: 480.0 },
            w if w >= NARROW => Self { kind: "middle", has_rail: false, right: 256.0, right_most: 320.0 },
            _ => Self { kind: "narrow", has_rail: true, right: 216.0, right_most: 240.0 },
        }
    }
}

/// Shows the whole window.
pub fn window_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let bar = |fill| Frame::NONE.fill(fill).inner_margin(Margin::symmetric(12, 0));
    Panel::top("top").exact_size(40.0).frame(bar(palette.panel)).show(ui, |ui| topbar::topbar_ui(app, ui));
    Panel::bottom("status")
        .exact_size(28.0)
        .frame(bar(palette.panel))
        .show(ui, |ui| status::status_ui(app, ui));
    if app.tour.step.is_some() {
        tour::tour_ui(app, ui);
    }
    let has_site = !app.editor.session().site.cameras.is_empty() || app.editor.session().site.plan.is_some();
    if has_site {
        let phone = ui.ctx().content_rect().width() < PHONE;
        let widths = Widths::of(ui.ctx().content_rect().width());
        let rail = widths.has_rail || matches!(app.view.mode, Mode::Plan | Mode::All);
        let side = Frame::NONE.fill(palette.panel);
        Panel::left(if rail { "rail" } else { "cameras" })
            .resizable(!rail)
            .default_size(if rail { 64.0 } else { 192.0 })
            .size_range(if rail { 64.0..=64.0 } else { 150.0..=400.0 })
            .frame(side)
            .show(ui, |ui| cameras::cameras_ui(app, ui, rail));
        Panel::left("tools").exact_size(44.0).resizable(false).frame(side).show(ui, |ui| {
            status::toolstrip_ui(app, ui);
        });
        let inset = Frame::NONE.fill(palette.panel);
        if phone {
            let third = ui.ctx().content_rect().height() / 3.0;
            Panel::bottom("below")
                .default_size(third)
                .size_range(48.0..=2.0 * third)
                .resizable(true)
                .frame(inset)
                .show(ui, |ui| right(app, ui));
        }
        if !phone {
            Panel::right(Id::unique(("right", widths.kind)))
                .default_size(widths.right)
                .size_range(200.0..=widths.right_most)
                .frame(inset)
                .show(ui, |ui| right(app, ui));
        }
    }
    CentralPanel::default().frame(Frame::NONE.fill(palette.bg)).show(ui, |ui| {
        if has_site {
            views::views_ui(app, ui);
        } else {
            start::start_ui(app, ui);
        }
    });
    sheets_ui(app, ui);
    highlight_drop(ui);
}

/// Shows the open sheets and dialogs.
fn sheets_ui(app: &mut App, ui: &Ui) {
    // The web build loads these sheets with the second part of the program, so they are called only if they are open.
    let dialogs = &app.dialogs;
    if dialogs.palette.is_open || dialogs.shortcuts || dialogs.about {
        palette::palette_ui(app, ui.ctx());
    }
    if app.dialogs.export.is_open {
        export::export_ui(app, ui.ctx());
    }
    if app.jobs.video.is_some() || !app.jobs.videos.is_empty() {
        video::video_ui(app, ui.ctx());
    }
    if app.dialogs.address.is_some() {
        address::address_ui(app, ui.ctx());
    }
    let dialogs = &app.dialogs;
    if dialogs.conflict.is_some() || dialogs.path_field.is_some() || !dialogs.outside.asked.is_empty() {
        outside::asked_ui(app, ui.ctx());
    }
}

/// Outlines the window while files are dragged over it.
fn highlight_drop(ui: &Ui) {
    if ui.input(|input| input.raw.hovered_files.is_empty()) {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let rect = ui.ctx().content_rect();
    let painter = ui.ctx().layer_painter(LayerId::new(Order::Foreground, Id::unique("drop")));
    painter.rect_stroke(rect.shrink(3.0), 4.0, Stroke::new(3.0, palette.accent), StrokeKind::Inside);
    let text = "Drop images, a plan, a video, a site or calibrations";
    tag(&painter, rect.center(), Align2::CENTER_CENTER, text, palette.accent);
}

/// Whether the mark tool is active, or a mark or one of its pins is selected.
fn are_marks_edited(app: &App) -> bool {
    let is_mark = |part: &Part| matches!(part, Part::Mark(_) | Part::Pin { .. });
    app.editor.has_tool(Icon::Mark) || app.editor.session().selection.iter().any(is_mark)
}

/// Whether the control point tool is active, or a control point is selected.
fn are_points_edited(app: &App) -> bool {
    app.editor.has_tool(Icon::Control)
        || app.editor.session().selection.iter().any(|part| matches!(part, Part::Control(_)))
}

/// Shows the control points of the current camera, and the points that wait for a click.
fn points_ui(app: &mut App, ui: &mut Ui) {
    section(ui, |ui| distances::controls(app, ui));
    section(ui, |ui| ground_points::ground_points_ui(app, ui));
}

fn right(app: &mut App, ui: &mut Ui) {
    warnings::error(app, ui);
    if app.editor.session().entry().is_none() {
        return;
    }
    distances::out_of_date_ui(app, ui);
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        // The web build loads these panels with the second part of the program, so they are called only if shown.
        app.hover.lit_group = None;
        if app.dialogs.automatic.is_some() {
            propose::report_ui(app, ui);
        }
        if app.shown_proposal().is_some() {
            propose::propose_ui(app, ui);
        }
        compare::panel::compare_ui(app, ui);
        section(ui, |ui| steps::steps_ui(app, ui));
        lens::old_still(app, ui);
        if app.editor.compared_site().is_some() {
            section(ui, |ui| distances::compared(app, ui));
        }
        match app.view.mode {
            Mode::Image => {
                if are_marks_edited(app) {
                    section(ui, |ui| links::marks_ui(app, ui));
                }
                if are_points_edited(app) {
                    points_ui(app, ui);
                }
                // Fields come before notices that appear and disappear, so that they stay under the pointer
                // while typing.
                section(ui, |ui| lens::lens_ui(app, ui));
                section(ui, |ui| result::result_ui(app, ui));
                if app.editor.session().solution().is_some() {
                    section(ui, |ui| warnings::warnings_ui(app, ui));
                }
                measured(app, ui);
                section(ui, |ui| {
                    planes::lies_on_ui(app, ui);
                    annotations::annotations_ui(app, ui);
                });
            }
            Mode::Plan => beside_plan(app, ui),
            Mode::All | Mode::Scene => {
                surveyed(app, ui);
                section(ui, |ui| warnings::health_ui(app, ui));
                section(ui, |ui| links::marks_ui(app, ui));
                section(ui, |ui| {
                    links::links_ui(app, ui);
                    planes::lies_on_ui(app, ui);
                });
                section(ui, |ui| distances::distances_ui(app, ui));
                measured(app, ui);
                section(ui, |ui| distances::agreement(app, ui));
                section(ui, |ui| warnings::site(app, ui));
            }
        }
    });
}

/// Shows the panels on the right while the window shows the plan: coverage, measurements, placement and planes.
fn beside_plan(app: &mut App, ui: &mut Ui) {
    surveyed(app, ui);
    measured(app, ui);
    section(ui, |ui| {
        placement::placement_ui(app, ui);
        links::far_apart(app, ui);
    });
    section(ui, |ui| agreement::agreement_ui(app, ui));
    section(ui, |ui| placement::handles(app, ui));
    section(ui, |ui| warnings::warnings_ui(app, ui));
    section(ui, |ui| placement::plan(app, ui));
    section(ui, |ui| planes::planes_ui(app, ui));
    points_ui(app, ui);
}

/// Shows areas of interest, walls and hand-over zones while the coverage is shown.
fn surveyed(app: &mut App, ui: &mut Ui) {
    if app.view.coverage && app.view.mode != Mode::All {
        section(ui, |ui| survey::survey_ui(app, ui));
        let found = app.coverage.as_ref().and_then(|shown| shown.result.as_ref().ok());
        if found.is_some_and(|found| !found.hand_overs.is_empty()) {
            section(ui, |ui| survey::hand_overs_ui(app, ui));
        }
    }
}

/// Shows the measurements, if the site has any or the Measure tool is active.
fn measured(app: &mut App, ui: &mut Ui) {
    if !app.editor.site().measurements.is_empty() || measurements::is_measuring(app) {
        section(ui, |ui| measurements::measurements_ui(app, ui));
    }
}
