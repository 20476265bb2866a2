//! Strip of the tour above the canvas. A step ends when its task is done correctly.

use egui::{Frame, Margin, Panel, RichText, Ui};

use crate::command::Command;
use crate::keys;
use crate::state::{App, STEPS};
use crate::theme;

/// Shows the current step of the tour; after the last step, the instructions for one's own images.
pub(super) fn tour_ui(app: &mut App, ui: &mut Ui) {
    let Some(index) = app.tour.step else { return };
    let has_exported = app.dialogs.export.made.as_ref().is_some_and(Result::is_ok);
    let open = app.tour.open(app.editor.session(), app.view.mode, has_exported);
    if open.is_none() && index < STEPS.len() && app.editor.tool().is_idle() {
        app.tour.step = Some(index + 1);
        ui.ctx().request_repaint();
    }
    let palette = theme::palette(ui.ctx());
    let frame = Frame::NONE.fill(palette.accent_bg).inner_margin(Margin::symmetric(12, 8));
    let request = Panel::top("tour").frame(frame).show(ui, |ui| match STEPS.get(index) {
        Some(_) => step(app, ui, index, open.as_deref().unwrap_or_default()),
        None => end(ui),
    });
    match request.inner {
        Some(StripRequest::Run(command)) => app.send_command(command),
        Some(StripRequest::Skip) => app.tour.step = Some(index + 1),
        Some(StripRequest::End) => app.tour.step = None,
        None => {}
    }
}

/// Request of the operator with a button of the strip.
enum StripRequest {
    Run(Command),
    Skip,
    End,
}

fn step(app: &App, ui: &mut Ui, index: usize, open: &str) -> Option<StripRequest> {
    let palette = theme::palette(ui.ctx());
    let step = app.tour.step()?;
    let mut request = None;
    ui.horizontal_wrapped(|ui| {
        let count = format!("Step {} of {}", index + 1, STEPS.len());
        ui.label(RichText::new(count).small().color(palette.accent));
        ui.label(RichText::new(step.title).font(theme::medium(13.0)));
        ui.label(RichText::new(keys::shown(ui.ctx(), open)).color(palette.warn));
    });
    ui.add(egui::Label::new(RichText::new(keys::shown(ui.ctx(), step.text)).color(palette.text2)).wrap());
    ui.horizontal_wrapped(|ui| {
        for (text, button) in step.buttons {
            let text = keys::shown(ui.ctx(), text);
            let text = RichText::new(text).font(theme::medium(12.0)).color(palette.bg);
            if ui.add(egui::Button::new(text).fill(palette.accent)).clicked() {
                request = Some(StripRequest::Run(button.command()));
            }
        }
        if ui.button("Skip this step").on_hover_text("Continue without this task").clicked() {
            request = Some(StripRequest::Skip);
        }
        if ui.button("End the tour").on_hover_text("Close the tour and keep the demonstration").clicked() {
            request = Some(StripRequest::End);
        }
    });
    request
}

fn end(ui: &mut Ui) -> Option<StripRequest> {
    let palette = theme::palette(ui.ctx());
    let mut request = None;
    ui.label(RichText::new("The tour is complete").font(theme::medium(13.0)));
    let text = "To calibrate your own cameras, add one image of each, and a floor plan if you have one. \
                Draw the same kinds of lines on each image, and place each camera on the plan. \
                Link points that two views share (K), then refine (F9) and save (Ctrl+S).";
    ui.add(egui::Label::new(RichText::new(keys::shown(ui.ctx(), text)).color(palette.text2)).wrap());
    ui.horizontal_wrapped(|ui| {
        let text = RichText::new("New site").font(theme::medium(12.0)).color(palette.bg);
        if ui.add(egui::Button::new(text).fill(palette.accent)).clicked() {
            request = Some(StripRequest::Run(Command::NewSite));
        }
        if ui.button("Close").clicked() {
            request = Some(StripRequest::End);
        }
    });
    request
}
