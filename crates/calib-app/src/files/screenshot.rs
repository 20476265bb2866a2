//! Screenshots of a view, and the report of `calib report`.

use std::path::Path;

use calib_editor::images::{data_uri, png};
use calib_editor::{Action, Session};
use calib_report::{EmbeddedImage, ImageRequest, page};
use calib_site::Plan;
use egui::Context;
use image::{ImageFormat, RgbImage};

use crate::choice::Purpose;
use crate::drawing::is_drawing;
use crate::platform::{Here, Platform as _};
use crate::state::{App, Mode};

impl App {
    /// Requests a screenshot of the canvas that was used last.
    pub fn take_picture(&mut self, ctx: &Context) {
        let (sender, picture) = std::sync::mpsc::channel();
        let again = ctx.clone();
        ctx.request_screenshot(move |image| {
            // An error means that the receiver no longer exists.
            let _ = sender.send(image);
            again.request_repaint();
        });
        self.jobs.picture = Some(picture);
    }

    /// Receives the requested screenshot, and asks the operator for the name of its file.
    pub(crate) fn poll_picture(&mut self, ctx: &Context) {
        let Some(image) = self.jobs.picture.as_ref().and_then(|picture| picture.try_recv().ok()) else {
            return;
        };
        self.jobs.picture = None;
        let key = self.zoom_key();
        let shown = self.view.panes.rects.get(&key).copied().filter(|_| self.view.mode != Mode::Scene);
        let points = ctx.pixels_per_point();
        let [w, h] = image.size.map(|side| side as f32 / points);
        let whole = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::Vec2::new(w, h));
        let rect = shown.or(self.view.panes.middle).unwrap_or(whole).intersect(whole);
        let image = image.region(&rect, Some(points));
        let [w, h] = image.size.map(|side| side as u32);
        let rgba: Vec<u8> = image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
        let mut png = std::io::Cursor::new(Vec::new());
        let written = image::RgbaImage::from_raw(w, h, rgba)
            .ok_or_else(|| "The view is too small. Enlarge the window and try again.".to_owned())
            .and_then(|image| image.write_to(&mut png, ImageFormat::Png).map_err(|error| error.to_string()));
        match written {
            Ok(()) => {
                self.jobs.pictured = Some(png.into_inner());
                self.open_dialog(Purpose::SavePicture);
            }
            Err(error) => self.act(Action::SetError(error)),
        }
    }

    /// Writes the received screenshot to a file.
    pub(crate) fn save_picture(&mut self, path: &Path) {
        let Some(png) = self.jobs.pictured.take() else { return };
        match Here::write(path, &png) {
            Ok(()) => self.act(Action::Note(format!("Saved {}.", path.display()))),
            Err(error) => self.act(Action::SetError(error)),
        }
    }
}

impl App {
    /// Writes the report of the current results to a file.
    pub(crate) fn save_report(&mut self, path: &Path) {
        let is_drawing = |plan: &Plan| plan.image.as_ref().is_some_and(|name| is_drawing(Path::new(name)));
        if self.plan_picture().is_none() && self.editor.site().plan.as_ref().is_some_and(is_drawing) {
            let text = "The plan is not loaded yet. Press 2 to show it, then save the report again.";
            self.act(Action::AddError(text.into()));
            return;
        }
        let session = self.editor.session();
        let site = session.solved.write_into(&session.site);
        let plan = self.plan_picture().filter(|plan| plan.drawing.is_some());
        let html = page(&site, (self.clock)(), None, &mut |shown| match (shown, plan) {
            // Browsers do not show a PDF or DXF as an image.
            (ImageRequest::Plan, Some(plan)) => embedded_pixels(&plan.image),
            _ => picture(session, shown),
        });
        match Here::write(path, html.as_bytes()) {
            Ok(()) => self.act(Action::Note(format!("Saved {}.", path.display()))),
            Err(error) => self.act(Action::SetError(error)),
        }
    }
}

/// Encodes an image as a PNG data URI for embedding in the report.
fn embedded_pixels(image: &RgbImage) -> Result<EmbeddedImage, String> {
    let href = data_uri("image/png", &png(image)?);
    Ok(EmbeddedImage { href, size: image.dimensions().into() })
}

/// Returns an image for embedding in the report.
fn picture(session: &Session, shown: ImageRequest<'_>) -> Result<EmbeddedImage, String> {
    let name = match shown {
        ImageRequest::Camera(camera) => camera.image.as_deref(),
        ImageRequest::Plan => session.site.plan.as_ref().and_then(|plan| plan.image.as_deref()),
    };
    let name = name.ok_or("The image is missing.")?;
    let said = |why: String| format!("{}: {why}", session.images.shown_name(name));
    // The report does not wait for images that a worker of the page renders.
    if !Here::HAS_FOLDERS && session.images.reader(name).name_to_render().is_some() {
        return Err(said("The image is not rendered yet. Save the report again when it is visible.".into()));
    }
    let (href, bytes) = session.images.embedded(name, Here::read_within).map_err(said)?;
    let size = match shown {
        ImageRequest::Camera(camera) => camera.size_px,
        ImageRequest::Plan => calib_input::image_size(&bytes).map_err(|error| said(error.to_string()))?,
    };
    Ok(EmbeddedImage { href, size })
}
