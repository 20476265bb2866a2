//! Files that come in: by dialog, by drop, by name; and pictures that go out.

use std::path::{Path, PathBuf};

use calib_editor::file_name::{has_ending, is_image, mime};
use calib_editor::{Action, NewStill, parse};
use egui::Context;

use crate::app::{App, Mode};
use crate::dialog::{Chosen, Purpose};
use crate::files;
use crate::platform::{Here, Platform as _, Task};

/// A picture that was read, to become a still or the plan.
#[derive(Debug)]
pub(crate) struct Picture {
    still: NewStill,
    /// A drawing as the picture that stands for it.
    drawn: Option<Vec<u8>>,
}

/// What reading gives.
pub(crate) type Read = Result<Picture, String>;

impl App {
    /// What was chosen goes where it was asked for: every purpose has its arm.
    fn take_chosen(&mut self, ctx: &Context, purpose: Purpose, chosen: Vec<Chosen>) {
        match purpose {
            Purpose::OpenSite => self.open_chosen(ctx, chosen),
            Purpose::SaveSite => each_path(chosen, |path| self.save_to(path)),
            Purpose::SavePlain => each_path(chosen, |path| self.save_plain(&path)),
            Purpose::AddImages => chosen.into_iter().for_each(|file| self.add_still(ctx, file)),
            Purpose::LoadPlan => self.load_plan(ctx, chosen),
            Purpose::ReplaceStill => {
                chosen.into_iter().for_each(|file| self.replacing = Some(self.read_still(ctx, file)));
            }
            Purpose::Compare => chosen.into_iter().for_each(|file| self.compare_with(file)),
            Purpose::Import => self.import(chosen),
            Purpose::Export => each_path(chosen, |folder| self.write_export(&folder)),
            Purpose::SavePicture => {
                for file in chosen {
                    self.save_picture(&file.path.unwrap_or_else(|| PathBuf::from(&file.name)));
                }
            }
        }
    }

    /// Opens what was chosen: from a disk by its path, else together with its images.
    fn open_chosen(&mut self, ctx: &Context, chosen: Vec<Chosen>) {
        if chosen.iter().all(|file| file.path.is_none()) {
            self.take_together(ctx, chosen);
            return;
        }
        for file in chosen {
            match &file.path {
                Some(path) => self.open_path(path),
                None => self.take_together(ctx, vec![file]),
            }
        }
    }

    fn compare_with(&mut self, file: Chosen) {
        let name = file.name.clone();
        self.act(match file.into_text().and_then(|text| parse(&text, None)) {
            Ok((site, _)) => Action::Compare(Some(Box::new(site))),
            Err(error) => Action::Fail(format!("{name}: {error}")),
        });
    }

    /// Begins to read a still that becomes a camera.
    pub fn add_still(&mut self, ctx: &Context, file: Chosen) {
        let task = self.read_still(ctx, file);
        self.adding.push(task);
    }

    pub(crate) fn read_still(&mut self, ctx: &Context, file: Chosen) -> Task<Read> {
        let title = Path::new(&file.name)
            .file_stem()
            .map_or_else(|| file.name.clone(), |stem| stem.to_string_lossy().into_owned());
        let name = match (&file.path, file.bytes) {
            (Some(path), _) => path.to_string_lossy().into_owned(),
            (None, Some(bytes)) => self.editor.store_image(bytes.into(), mime(&file.name), Some(&file.name)),
            (None, None) => file.name.clone(),
        };
        let read = self.editor.session().images.reader(&name);
        Here::size_of(ctx, file.name, read, |size, drawn| Picture {
            still: NewStill { image: name, title, size },
            drawn,
        })
    }

    pub(crate) fn poll_stills(&mut self) {
        let was_empty = self.editor.site().cameras.is_empty();
        // Threads finish in any order; cameras come in that of their files.
        while let Some(still) = self.adding.first().and_then(Task::outcome) {
            self.adding.remove(0);
            match still.map_err(|_| "An image could not be read.".to_owned()).flatten() {
                Ok(picture) => {
                    let still = self.stored(picture);
                    self.act(Action::AddCamera(still));
                }
                Err(error) => self.act(Action::Complain(error)),
            }
        }
        if was_empty && !self.editor.site().cameras.is_empty() {
            self.act(Action::Choose(0));
        }
        if let Some(task) = self.replacing.take() {
            match task.poll() {
                None => self.replacing = Some(task),
                Some(Ok(picture)) => {
                    let still = self.stored(picture);
                    self.act(Action::ReplaceStill(self.replaced.clone(), still));
                }
                Some(Err(error)) => self.act(Action::Complain(error)),
            }
        }
        self.poll_plan();
    }

    /// The still of a picture; one that was drawn is stored.
    pub(crate) fn stored(&mut self, picture: Picture) -> NewStill {
        let Picture { still, drawn } = picture;
        let Some(png) = drawn else { return still };
        let name = format!("{}.png", still.title);
        let image = self.editor.store_image(png.into(), "image/png", Some(&name));
        NewStill { image, ..still }
    }

    /// How many files were chosen and are not taken yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.adding.len() + usize::from(self.replacing.is_some()) + usize::from(self.planning.is_some())
    }

    /// Whether images are being read, edges looked for, cameras refined.
    #[must_use]
    pub fn is_working(&self) -> bool {
        self.waiting() > 0
            || self.refining.is_some()
            || self.pictures.loading() > 0
            || self.edges.looking() > 0
    }

    /// Waits no longer for images, edges and refined cameras.
    pub fn stop_work(&mut self) {
        if self.refining.take().is_some() {
            self.act(Action::Note("Cancelled: no camera was moved.".into()));
            return;
        }
        let count = self.waiting();
        self.adding.clear();
        (self.replacing, self.planning) = (None, None);
        self.pictures.stop();
        self.edges.stop();
        self.act(Action::Note(match count {
            0 => "Cancelled. \u{201c}Read images again\u{201d} goes on with it.".into(),
            count => format!("Cancelled: {count} images were not taken. Add them again if they are wanted."),
        }));
    }

    /// Takes what was dropped or named: a site, an image, or a folder of images.
    pub fn take_path(&mut self, ctx: &Context, path: PathBuf) {
        if has_ending(&path, "json") {
            self.open_path(&path);
            return;
        }
        if has_ending(&path, "svg") {
            let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            self.load_plan(ctx, vec![Chosen { name, path: Some(path), bytes: None }]);
            return;
        }
        let images = if is_image(&path) { vec![path.clone()] } else { Here::images_in(&path) };
        if images.is_empty() {
            self.act(Action::Complain(format!(
                "{}: neither a site (.json) nor an image (.png, .jpg), nor a folder of images",
                path.display()
            )));
        }
        for path in images {
            let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            self.add_still(ctx, Chosen { name, path: Some(path), bytes: None });
        }
    }

    /// Asks for a picture of the view that was used last.
    pub fn take_picture(&mut self, ctx: &Context) {
        let (sender, picture) = std::sync::mpsc::channel();
        let again = ctx.clone();
        ctx.request_screenshot(move |image| {
            // Nobody waits any more when the receiver is gone.
            let _ = sender.send(image);
            again.request_repaint();
        });
        self.picture = Some(picture);
    }

    pub(crate) fn poll_picture(&mut self, ctx: &Context) {
        let Some(image) = self.picture.as_ref().and_then(|picture| picture.try_recv().ok()) else { return };
        self.picture = None;
        let key = self.zoom_key();
        let shown = self.panes.rects.get(&key).copied().filter(|_| self.mode != Mode::Scene);
        let points = ctx.pixels_per_point();
        let [w, h] = image.size.map(|side| side as f32 / points);
        let whole = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::Vec2::new(w, h));
        let rect = shown.or(self.panes.middle).unwrap_or(whole).intersect(whole);
        let image = image.region(&rect, Some(points));
        let [w, h] = image.size.map(|side| side as u32);
        let rgba: Vec<u8> = image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
        let mut png = std::io::Cursor::new(Vec::new());
        let written = image::RgbaImage::from_raw(w, h, rgba)
            .ok_or_else(|| "The view has no size.".to_owned())
            .and_then(|image| {
                image.write_to(&mut png, image::ImageFormat::Png).map_err(|error| error.to_string())
            });
        match written {
            Ok(()) => {
                self.pictured = Some(png.into_inner());
                self.ask(Purpose::SavePicture);
            }
            Err(error) => self.act(Action::Fail(error)),
        }
    }

    fn save_picture(&mut self, path: &Path) {
        let Some(png) = self.pictured.take() else { return };
        match Here::write(path, &png) {
            Ok(()) => self.act(Action::Note(format!("Saved {}.", path.display()))),
            Err(error) => self.act(Action::Fail(error)),
        }
    }

    pub(crate) fn poll_dialog(&mut self, ctx: &Context) {
        let Some(dialog) = &mut self.dialog else { return };
        let Some(chosen) = dialog.poll() else {
            ctx.request_repaint_after(std::time::Duration::from_millis(100));
            return;
        };
        let (purpose, is_just_opened) = (dialog.purpose, dialog.is_just_opened());
        self.dialog = None;
        if chosen.is_empty() && is_just_opened {
            self.act(Action::Fail(
                "The system's file chooser did not open: install xdg-desktop-portal or zenity. Files can also be \
                 dropped on this window, or named when it is started."
                    .into(),
            ));
        }
        self.take_chosen(ctx, purpose, chosen);
    }

    /// Opens a site file; what is wrong with it is shown.
    pub fn open_path(&mut self, path: &Path) {
        match files::open(path) {
            Ok((site, images)) => self.open_site(site, images, Some(path.to_path_buf())),
            Err(error) => self.act(Action::Fail(error)),
        }
    }
}

fn each_path(chosen: Vec<Chosen>, act: impl FnMut(PathBuf)) {
    chosen.into_iter().filter_map(|file| file.path).for_each(act);
}
