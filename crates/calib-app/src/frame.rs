//! Sequence of the work in a frame.

use egui::{Context, InputOptions, InputState, Ui};

use crate::command;
use crate::crosshair::Crosshair;
use crate::focus;
use crate::keys;
use crate::paint::paint_crosshair;
use crate::platform::{Here, Platform as _};
use crate::shell;
use crate::state::{App, Mode, Sent};

impl App {
    /// Runs and paints one frame.
    pub fn show_ui(&mut self, ui: &mut Ui) {
        self.logic(&ui.ctx().clone());
        self.editor.solve();
        self.editor.begin_frame();
        self.watch_suspect(ui);
        self.view.panes.begin_frame();
        shell::window_ui(self, ui);
        self.update_crosshair(ui.ctx());
        self.hover.was_typing = ui.ctx().text_edit_focused();
        if ui.memory(|memory| memory.focused()) != self.hover.focus.focused {
            // The next frame scrolls to the focused widget.
            ui.ctx().request_repaint();
        }
        self.apply_requests(&ui.ctx().clone());
        self.remember();
    }

    /// Handles finished work, dropped files and keys, before anything is painted.
    pub fn logic(&mut self, ctx: &Context) {
        set_click_duration(ctx);
        keys::watch_touch(ctx);
        focus::scroll_to_focused(ctx, &mut self.hover.focus);
        self.pictures.begin_frame(ctx);
        self.edges.begin_frame();
        // Files and results of background work wait until the current gesture ends.
        if self.editor.tool().is_idle() && (!self.awaits() || self.editor.is_settled()) {
            self.poll_dialog(ctx);
            self.poll_stills();
            self.poll_plan();
            self.poll_imports();
            self.poll_refining();
            self.poll_proposing(ctx);
            // The web build loads this code with the second part of the program, so it is called only if needed.
            if self.jobs.automatic.is_some() {
                self.poll_automatic(ctx);
            }
            self.poll_comparing(ctx);
            self.poll_recovering();
            self.poll_arrivals(ctx);
            self.poll_shelf();
        }
        self.poll_picture(ctx);
        self.watch_outside();
        let has_sheet = self.jobs.video.is_some() || self.dialogs.address.is_some();
        for (command, modifiers) in keys::pressed(ctx, self.hover.was_typing, has_sheet) {
            command::run(self, ctx, command, modifiers);
        }
        if let Some(field) = self.view.requested_field.take() {
            focus::request(ctx, field);
        }
    }

    /// Decides whether the arrow keys move the crosshair, and paints it. With the selection tool, they move it only in
    /// the image view, without a selection and without an automatic calibration.
    fn update_crosshair(&self, ctx: &Context) {
        let draws = match self.view.mode {
            Mode::Scene => false,
            mode if self.editor.tool_row() == 0 => {
                mode == Mode::Image
                    && self.editor.session().selection.is_empty()
                    && self.shown_proposal().is_none()
            }
            _ => true,
        };
        let is_free = ctx.memory(|memory| memory.focused().is_none()) && !egui::Popup::is_any_open(ctx);
        let canvas = self.view.panes.rects.get(&self.zoom_key()).copied();
        let at = Crosshair::with(ctx, |crosshair| {
            crosshair.canvas = canvas.filter(|_| draws && is_free && !self.has_sheet());
            crosshair.at.filter(|_| crosshair.canvas.is_some())
        });
        if let Some(at) = at {
            paint_crosshair(ctx, at);
        }
    }

    /// Opens the dropped files once they are read.
    fn poll_arrivals(&mut self, ctx: &Context) {
        let dropped = ctx.input_mut(|input| std::mem::take(&mut input.raw.dropped_files));
        if !dropped.is_empty() {
            self.jobs.arriving.push(Here::dropped(ctx, dropped));
        }
        let mut arrived = Vec::new();
        self.jobs.arriving.retain(|task| task.poll().map(|files| arrived.push(files)).is_none());
        for files in arrived {
            self.open_files(ctx, files);
        }
    }

    /// Carries out the requests that the panels queued in this frame.
    fn apply_requests(&mut self, ctx: &Context) {
        let sent = std::mem::take(&mut self.sent);
        if !sent.is_empty() {
            ctx.request_repaint();
        }
        for one in sent {
            match one {
                Sent::Action(action) => self.act(action),
                Sent::Recover(index) => self.recover(index),
                Sent::Discard(index) => self.discard_found(index),
                Sent::OpenPath(path) => {
                    self.open_path(&path);
                }
                Sent::Decide(decision) => self.decide_on_file(decision),
                Sent::Outside(allows) => self.settle_outside(allows),
                Sent::Typed(typed) => self.typed(ctx, typed),
                Sent::Command(command) => command::run(self, ctx, command, egui::Modifiers::NONE),
            }
        }
    }

    /// Restarts the blinking when the first rejected line (outlier) of the current camera changes.
    fn watch_suspect(&mut self, ui: &Ui) {
        let camera = self.editor.session().camera;
        let suspect = self.editor.session().solution().and_then(|solution| {
            let residual = solution.residuals.iter().find(|residual| residual.outlier)?;
            Some((camera, residual.annotation?, residual.segment?))
        });
        if suspect != self.hover.suspect {
            self.hover.suspect = suspect;
            self.hover.suspect_since = ui.input(|i| i.time);
        }
    }
}

/// Allows mouse clicks of any duration, because a frame can take long. A long touch is not a click: it opens a menu.
fn set_click_duration(ctx: &Context) {
    let is_touch = ctx.input(InputState::any_touches);
    let longest = if is_touch { InputOptions::default().max_click_duration } else { f64::INFINITY };
    ctx.options_mut(|options| options.input_options.max_click_duration = longest);
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        self.show_ui(ui);
    }
}
