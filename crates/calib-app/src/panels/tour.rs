//! Five steps through the demonstration for a newcomer: each is done by doing it.

use calib_core::{Kind, Stage};
use egui::{Align2, RichText, Ui, Vec2, Window};

use crate::state::{App, Mode};
use crate::theme;

/// One step of the tour.
struct Step {
    title: &'static str,
    text: &'static str,
    /// Whether the operator has done it.
    is_done: fn(&App) -> bool,
}

fn drawn(app: &App, kind: Kind) -> usize {
    let entry = app.editor.session().entry();
    let of_kind = entry.into_iter().flat_map(|entry| &entry.annotations).filter(|a| a.kind == kind);
    of_kind.map(|annotation| annotation.polylines().count()).sum()
}

const STEPS: [Step; 5] = [
    Step {
        title: "Draw two plumb lines",
        text: "Press V. Drag along two edges that stand upright: a column, a shelf. A click on an edge that lights up takes it whole.",
        is_done: |app| drawn(app, Kind::Vertical) >= 2,
    },
    Step {
        title: "Draw two pairs of floor lines",
        text: "Press P. Draw two joints of the tiles that run away from you, press W, and draw two that run across.",
        is_done: |app| drawn(app, Kind::Parallel) >= 4,
    },
    Step {
        title: "Draw the field of view",
        text: "Press F. Click the corners of the floor that matters, and Enter. The grid should lie on the tiles: look along it.",
        is_done: |app| app.editor.session().entry().is_some_and(|entry| entry.efov_px.is_some()),
    },
    Step {
        title: "Place the camera on the plan",
        text: "Press 2. Drag the polygon until its image fits the plan; the ring turns it, the square scales it.",
        is_done: |app| {
            app.editor.session().solution().is_some_and(|solution| solution.stage >= Stage::Placed)
        },
    },
    Step {
        title: "Check it in every view",
        text: "Press 3. Drag a mark: it should stand on the same spot in all views.",
        is_done: |app| app.mode == Mode::All,
    },
];

/// The card of the step one is at.
pub fn show(app: &mut App, ui: &Ui) {
    let Some(index) = app.tour.step else { return };
    let Some(step) = STEPS.get(index) else { return };
    if (step.is_done)(app) && app.editor.tool().is_idle() {
        app.tour.step = Some(index + 1);
    }
    let palette = theme::palette(ui.ctx());
    let mut close = false;
    Window::new("Tour")
        .title_bar(false)
        .resizable(false)
        .anchor(Align2::LEFT_BOTTOM, Vec2::new(260.0, -44.0))
        .default_width(340.0)
        .show(ui.ctx(), |ui| {
            ui.set_width(320.0);
            ui.label(
                RichText::new(format!("Step {} of {}", index + 1, STEPS.len())).small().color(palette.accent),
            );
            ui.label(RichText::new(step.title).font(theme::medium(13.0)));
            ui.label(RichText::new(step.text).color(palette.text2));
            ui.horizontal(|ui| {
                if ui.button("Skip").clicked() {
                    app.tour.step = Some(index + 1);
                }
                close = ui.button("End the tour").clicked();
            });
        });
    if close {
        app.tour.step = None;
    }
}
