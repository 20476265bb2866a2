//! The panels about the canvas, one a file.

mod out_of_date;
mod sigmas;
mod asked;
mod circle;
pub mod lens;
mod tour;
pub mod above;
mod result;
pub mod annotations;
pub mod newer;
pub mod cameras;
pub mod dock;
pub mod lies_on;
pub mod links;
pub mod agreement;
mod distances;
pub mod export;
pub mod marks;
pub mod health;
pub mod palette;
pub mod proposed;
pub mod planes;
pub mod placement;
mod step_pictures;
pub mod start;
pub mod status;
pub mod steps;
pub mod toolstrip;
pub mod topbar;
pub mod views;
pub mod warnings;

use calib_editor::Units;
use egui::{CentralPanel, DragValue, Frame, Margin, Panel, RichText, ScrollArea, Stroke, Ui};

pub use calib_editor::number;
pub use calib_report::decimals;

use crate::state::{App, Mode};
use crate::theme;

/// In a window narrower than this, a phone's, panels lie below each other.
pub(crate) const PHONE: f32 = 640.0;

/// In a window narrower than this the list of cameras is a rail, and words give way to icons.
pub(crate) const NARROW: f32 = 1000.0;

/// In a window at least this wide the right panel has its full width.
const WIDE: f32 = 1280.0;

/// How wide the panels beside the canvas are: by the window as it is now, not as it was when they were shown first.
#[derive(Clone, Copy)]
struct Widths {
    /// What the panels are remembered by: in a window of another kind they begin anew.
    kind: &'static str,
    has_rail: bool,
    right: f32,
    right_most: f32,
}

impl Widths {
    fn of(window: f32) -> Self {
        match window {
            w if w >= WIDE => Self { kind: "wide", has_rail: false, right: 296.0, right_most: 480.0 },
            w if w >= NARROW => Self { kind: "middle", has_rail: false, right: 256.0, right_most: 320.0 },
            _ => Self { kind: "narrow", has_rail: true, right: 216.0, right_most: 240.0 },
        }
    }
}

/// The whole window.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let bar = |fill| Frame::NONE.fill(fill).inner_margin(Margin::symmetric(12, 0));
    Panel::top("top").exact_size(40.0).frame(bar(palette.panel)).show(ui, |ui| topbar::show(app, ui));
    Panel::bottom("status").exact_size(28.0).frame(bar(palette.panel)).show(ui, |ui| status::show(app, ui));
    tour::show(app, ui);
    let has_site = !app.editor.session().site.cameras.is_empty() || app.editor.session().site.plan.is_some();
    if has_site {
        let phone = ui.ctx().content_rect().width() < PHONE;
        let widths = Widths::of(ui.ctx().content_rect().width());
        let rail = widths.has_rail || matches!(app.mode, Mode::Plan | Mode::All);
        let side = Frame::NONE.fill(palette.panel);
        Panel::left(if rail { "rail" } else { "cameras" })
            .resizable(!rail)
            .default_size(if rail { 64.0 } else { 192.0 })
            .size_range(if rail { 64.0..=64.0 } else { 150.0..=400.0 })
            .frame(side)
            .show(ui, |ui| cameras::show(app, ui, rail));
        Panel::left("tools").exact_size(44.0).resizable(false).frame(side).show(ui, |ui| {
            toolstrip::show(app, ui);
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
            Panel::right(egui::Id::unique(("right", widths.kind)))
                .default_size(widths.right)
                .size_range(200.0..=widths.right_most)
                .frame(inset)
                .show(ui, |ui| right(app, ui));
        }
    }
    CentralPanel::default().frame(Frame::NONE.fill(palette.bg)).show(ui, |ui| {
        if has_site {
            views::show(app, ui);
        } else {
            start::show(app, ui);
        }
    });
    palette::show(app, ui.ctx());
    export::show(app, ui.ctx());
    asked::show(app, ui.ctx());
}

fn right(app: &mut App, ui: &mut Ui) {
    warnings::error(app, ui);
    if app.editor.session().entry().is_none() {
        return;
    }
    out_of_date::show(app, ui);
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        proposed::show(app, ui);
        newer::show(app, ui);
        section(ui, |ui| steps::show(app, ui));
        lens::old_still(app, ui);
        if app.editor.compared().is_some() {
            section(ui, |ui| distances::compared(app, ui));
        }
        match app.mode {
            Mode::Image => {
                // Fields above what comes and goes: they stay under the pointer while one types.
                section(ui, |ui| lens::show(app, ui));
                section(ui, |ui| result::show(app, ui));
                section(ui, |ui| warnings::show(app, ui));
                section(ui, |ui| {
                    lies_on::show(app, ui);
                    annotations::show(app, ui);
                });
            }
            Mode::Plan => {
                section(ui, |ui| {
                    placement::show(app, ui);
                    links::far_apart(app, ui);
                });
                section(ui, |ui| agreement::show(app, ui));
                section(ui, |ui| placement::handles(app, ui));
                section(ui, |ui| warnings::show(app, ui));
                section(ui, |ui| placement::plan(app, ui));
                section(ui, |ui| planes::show(app, ui));
                section(ui, |ui| distances::controls(app, ui));
            }
            Mode::All | Mode::Scene => {
                section(ui, |ui| health::show(app, ui));
                section(ui, |ui| marks::show(app, ui));
                section(ui, |ui| {
                    links::show(app, ui);
                    lies_on::show(app, ui);
                });
                section(ui, |ui| distances::show(app, ui));
                section(ui, |ui| distances::agreement(app, ui));
                section(ui, |ui| warnings::site(app, ui));
            }
        }
    });
}

/// A part of a panel with a line below it.
pub fn section(ui: &mut Ui, contents: impl FnOnce(&mut Ui)) {
    let palette = theme::palette(ui.ctx());
    Frame::NONE.inner_margin(Margin::symmetric(12, 8)).show(ui, |ui| {
        ui.set_width(ui.available_width());
        contents(ui);
    });
    let rect = ui.min_rect();
    ui.painter().hline(rect.x_range(), rect.bottom(), Stroke::new(1.0, palette.line));
}

/// The heading of a section, with a word on its right.
pub fn heading(ui: &mut Ui, text: &str, right: &str) {
    let palette = theme::palette(ui.ctx());
    ui.horizontal(|ui| {
        let title = ui.label(RichText::new(text).font(theme::medium(13.0)).color(palette.text));
        title.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Heading, true, text));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new(right).small().color(palette.text3));
        });
    });
}

/// A field for a length in metres from `low` up, shown and typed in these units.
pub fn length_field(units: Units, metres: &mut f64, low: f64) -> DragValue<'_> {
    const MOST: f64 = 1e5;
    let unit = units.metres();
    let exchange = move |typed: Option<f64>| {
        if let Some(typed) = typed {
            *metres = typed * unit;
        }
        *metres / unit
    };
    DragValue::from_get_set(exchange)
        .speed(0.01)
        .range(low / unit..=MOST)
        .suffix(format!(" {}", units.sign()))
        .max_decimals(3)
        .update_while_editing(false)
}
