//! Sheet that takes an image from a video: one frame, or the scene without the objects that move.

use std::time::Duration;

use calib_editor::Action;
use calib_image::EmptyScene;
use egui::{
    Align2, Color32, Context, DragValue, Frame, ProgressBar, RichText, ScrollArea, Sense, Ui, Vec2, Window,
};

use crate::choice::Chosen;
use crate::platform::{FrameRequest, Here, Platform as _, Task};
use crate::state::{App, Reading, SCENE_FRAMES, Still, VideoSheet};
use crate::theme;

/// Width of the sheet's contents, in points.
const WIDTH: f32 = 640.0;

impl App {
    /// Opens the sheet for videos, one after the other.
    pub(crate) fn open_videos(&mut self, ctx: &Context, files: Vec<Chosen>) {
        self.jobs.videos.extend(files);
        self.next_video(ctx);
    }

    /// Opens the sheet for the next video if no sheet is open.
    fn next_video(&mut self, ctx: &Context) {
        if self.jobs.video.is_none()
            && let Some(file) = self.jobs.videos.pop_front()
        {
            self.jobs.video = Some(Box::new(VideoSheet::new(ctx, file)));
        }
    }

    /// Reports an image that could not be written to the folder of the site or of the video.
    pub(crate) fn report_unwritten(&mut self, file: &Chosen, folder_of: &str) {
        self.act(Action::AddError(format!(
            "{} could not be written to the folder of the {folder_of}. The site contains the image instead.",
            file.name
        )));
    }

    /// Adds the saved image of a video as a camera, or compares it if its name identifies it as a newer image.
    fn add_frame(&mut self, ctx: &Context, sheet: &VideoSheet, image: Chosen) {
        let mut files = vec![image];
        self.take_newer(ctx, &mut files);
        for file in files {
            if Here::HAS_FOLDERS && file.path.is_none() {
                self.report_unwritten(&file, "video");
            }
            self.add_video_still(ctx, file, sheet.pixel_aspect);
        }
    }
}

/// Shows the sheet that takes an image from the current video. Opens the sheet of the next waiting video when the
/// current sheet is closed.
pub(crate) fn video_ui(app: &mut App, ctx: &Context) {
    let Some(mut sheet) = app.jobs.video.take() else { return app.next_video(ctx) };
    sheet.poll(ctx);
    if let Some(result) = sheet.saving.as_ref().and_then(Task::poll) {
        sheet.saving = None;
        match result {
            Ok(image) => {
                app.add_frame(ctx, &sheet, image);
                drop(sheet);
                return app.next_video(ctx);
            }
            Err(error) => sheet.error = Some(error),
        }
    }
    let mut is_open = true;
    let room = ctx.content_rect().size() - Vec2::new(48.0, 88.0);
    let window = Window::new("Image from a video").title_bar(false).resizable(false).default_width(WIDTH);
    window.anchor(Align2::CENTER_TOP, Vec2::new(0.0, 56.0)).show(ctx, |ui| {
        ui.set_width(WIDTH.min(room.x));
        // Without a minimum, the previous height of the sheet would limit its new height.
        let height = room.y.max(200.0);
        let area = ScrollArea::vertical().max_height(height).min_scrolled_height(height);
        area.show(ui, |ui| is_open = sheet_ui(&mut sheet, ui));
    });
    if is_open {
        app.jobs.video = Some(sheet);
    } else {
        drop(sheet);
        app.next_video(ctx);
    }
}

/// Shows the contents of the sheet. Returns whether it stays open.
fn sheet_ui(sheet: &mut VideoSheet, ui: &mut Ui) -> bool {
    ui.label(RichText::new(format!("Image from {}", sheet.file.name)).font(theme::medium(13.0)));
    image_ui(sheet, ui);
    strip_ui(sheet, ui);
    if !sheet.strip.is_empty() {
        choice_ui(sheet, ui);
    }
    status_ui(sheet, ui);
    let mut is_open = true;
    ui.horizontal(|ui| {
        let is_ready = sheet.saving.is_none() && sheet.chosen().is_some();
        if ui.add_enabled(is_ready, egui::Button::new("Use this image")).clicked() {
            sheet.save(ui.ctx());
        }
        is_open = !ui.add_enabled(sheet.saving.is_none(), egui::Button::new("Cancel")).clicked();
    });
    if let Some(still) = sheet.chosen().filter(|_| Here::HAS_FOLDERS) {
        let text =
            format!("The image will be saved as {}.png in the folder of the video.", sheet.name_of(still));
        ui.label(RichText::new(text).small().color(theme::palette(ui.ctx()).text2));
    } else if !Here::HAS_FOLDERS {
        let text = "The browser scales frames to square pixels.";
        ui.label(RichText::new(text).small().color(theme::palette(ui.ctx()).text2));
    }
    is_open
}

/// Shows the chosen image, or a small frame until it is read.
fn image_ui(sheet: &VideoSheet, ui: &mut Ui) {
    let width = ui.available_width();
    let still = sheet.chosen().or(sheet.frame.as_ref());
    let shown = still.map(|still| match &still.changed {
        Some((marked, _)) if sheet.marks_changed => marked,
        _ => &still.texture,
    });
    let first = sheet.strip.first().map(|(_, small)| small);
    // The height of the image is limited, so that a low window has room for the whole sheet.
    let most = Vec2::new(width, (ui.ctx().content_rect().height() - 320.0).min(0.6 * width).max(120.0));
    match shown.or(first) {
        Some(texture) => {
            let size = texture.size_vec2();
            let scale = (most / size).min_elem();
            ui.vertical_centered(|ui| ui.image((texture.id(), size * scale)));
        }
        None => {
            ui.allocate_space(Vec2::new(width, most.y.min(9.0 / 16.0 * width)));
        }
    }
}

/// Shows the small frames; a click chooses the time of one.
fn strip_ui(sheet: &mut VideoSheet, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let gap = 4.0;
    let count = sheet.strip.len().max(1) as f32;
    let width = (ui.available_width() - gap * (count - 1.0)) / count - 2.0;
    let mut chosen = None;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = gap;
        for (time, small) in &sheet.strip {
            let is_chosen = !sheet.removes_moving && (time - sheet.time_s).abs() < 1e-9;
            let size = small.size_vec2();
            let image = egui::Image::new((small.id(), size * (width / size.x))).sense(Sense::click());
            let frame = Frame::NONE.stroke((1.0, Color32::TRANSPARENT)).show(ui, |ui| ui.add(image)).inner;
            if is_chosen || frame.has_focus() {
                let stroke = (if frame.has_focus() { 2.0 } else { 1.0 }, palette.accent);
                ui.painter().rect_stroke(frame.rect.expand(1.0), 2.0, stroke, egui::StrokeKind::Middle);
            }
            let name = format!("Frame at {}", clock(*time));
            frame.widget_info(|| egui::WidgetInfo::selected(egui::Role::Button, true, is_chosen, &name));
            if frame.on_hover_text(clock(*time)).clicked() {
                chosen = Some(*time);
            }
        }
    });
    if let Some(time) = chosen {
        (sheet.time_s, sheet.removes_moving, sheet.error) = (time, false, None);
    }
}

/// Shows the time of the frame, and the choice of the scene without moving objects.
fn choice_ui(sheet: &mut VideoSheet, ui: &mut Ui) {
    // At the duration itself, the video has no frame.
    let most = (sheet.duration_s - 1e-3).max(0.0);
    ui.add_enabled_ui(!sheet.removes_moving, |ui| {
        ui.horizontal(|ui| {
            let label = ui.label("Time");
            let mut time = sheet.time_s;
            ui.spacing_mut().slider_width = ui.available_width() - 190.0;
            let slider =
                ui.add(egui::Slider::new(&mut time, 0.0..=most).show_value(false)).labelled_by(label.id);
            let field =
                DragValue::new(&mut time).range(0.0..=most).speed(0.04).fixed_decimals(2).suffix(" s");
            let field = ui.add(field.update_while_editing(false)).labelled_by(label.id);
            ui.label(format!("of {}", clock(sheet.duration_s)));
            // A field that loses the focus rounds the time to its decimals.
            let is_changed = slider.changed() || field.changed() && (time - sheet.time_s).abs() >= 0.005;
            if is_changed {
                (sheet.time_s, sheet.error) = (time, None);
            }
        });
    });
    ui.horizontal(|ui| {
        let choice = ui.checkbox(&mut sheet.removes_moving, "Remove moving objects").on_hover_text(format!(
            "Median of up to {SCENE_FRAMES} frames. People and vehicles that move disappear, and hidden edges \
             become visible."
        ));
        if choice.changed() {
            sheet.error = None;
        }
        if sheet.removes_moving && sheet.scene.is_some() {
            ui.checkbox(&mut sheet.marks_changed, "Mark changed pixels");
        }
    });
}

/// Shows progress, an error, or notes about the chosen image.
fn status_ui(sheet: &VideoSheet, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    if let Some(error) = &sheet.error {
        let shown = ui.label(RichText::new(error).color(palette.bad));
        shown.ctx.accesskit_node_builder(shown.id, |node| node.set_live(egui::accesskit::Live::Polite));
    } else if sheet.saving.is_some() {
        ui.label(RichText::new("Saving the image\u{2026}").color(palette.text2));
    } else if let Some(Reading { request, progress, .. }) = &sheet.reading {
        let text = match request {
            FrameRequest::Strip(_) => "Reading the video\u{2026}",
            FrameRequest::At(_) => "Reading the frame\u{2026}",
            FrameRequest::Scene(_) => "Removing moving objects\u{2026}",
        };
        ui.add(ProgressBar::new(progress.share()).desired_height(14.0).text(RichText::new(text).small()));
        ui.ctx().request_repaint_after(Duration::from_millis(100));
    } else if let Some(Still { changed: Some((_, [changed, busy])), .. }) = sheet.chosen() {
        let mut text = format!("Moving objects covered {:.1} % of the image.", 100.0 * changed);
        if *busy > EmptyScene::MAX_BUSY_SHARE {
            text += &format!(
                " Objects that hardly moved may be visible in {:.1} % of the image. Use a longer video.",
                100.0 * busy
            );
        }
        ui.label(RichText::new(text).color(palette.text2));
    } else {
        // An empty label keeps the height of the sheet constant.
        ui.label("");
    }
}

/// Formats a time as seconds, or as minutes and seconds from one minute.
fn clock(seconds: f64) -> String {
    let seconds = (100.0 * seconds).round() / 100.0;
    if seconds < 60.0 {
        return format!("{seconds:.2} s");
    }
    let minutes = (seconds / 60.0).floor();
    format!("{minutes:.0}:{:05.2} min", seconds - 60.0 * minutes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_minutes_from_one_minute() {
        assert_eq!(clock(12.345), "12.35 s");
        assert_eq!(clock(125.5), "2:05.50 min");
        assert_eq!(clock(119.999), "2:00.00 min");
    }
}
