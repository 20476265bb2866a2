//! Files that come in: by dialog, by drop, by name; and pictures that go out.

use std::path::{Path, PathBuf};

use calib_core::SiteCamera;
use egui::Context;

use crate::app::{App, Mode};
use crate::arrivals::mime;
use crate::dialog::{Chosen, Purpose};
use crate::document::scale;
use crate::files;
use crate::task::Task;

/// A picture that was read, to become a still or the plan.
#[derive(Debug)]
pub(crate) struct Still {
    /// What the site calls it.
    name: String,
    /// What the operator calls it.
    title: String,
    /// In pixels.
    pub(crate) size: [u32; 2],
    /// A drawing as the picture that stands for it.
    drawn: Option<Vec<u8>>,
}

/// The still that a camera had before the one it has.
#[derive(Clone, Debug, PartialEq)]
pub struct OldStill {
    /// Id of the camera.
    pub camera: String,
    /// What the site called it.
    pub image: String,
    /// How much of it shows.
    pub share: f32,
    /// Its size, where that is another and nothing was rescaled yet.
    pub size: Option<[u32; 2]>,
}

/// What reading gives.
pub(crate) type NewStill = Result<Still, String>;

impl App {
    pub(crate) fn take_file(&mut self, ctx: &Context, purpose: Purpose, file: Chosen) {
        match (purpose, file.path.clone()) {
            (Purpose::OpenSite, Some(path)) => self.open_path(&path),
            (Purpose::OpenSite, None) => self.take_together(ctx, vec![file]),
            (Purpose::SaveSite, Some(path)) => {
                self.session.path = Some(path);
                self.save();
            }
            (Purpose::SavePlain, Some(path)) => self.save_plain(&path),
            (Purpose::Compare, _) => {
                let name = file.name.clone();
                match file.into_text().and_then(|text| files::parse(&text, None)) {
                    Ok((site, _)) => self.compared = Some(site),
                    Err(error) => self.error = Some(format!("{name}: {error}")),
                }
            }
            (Purpose::AddImages, _) => self.add_still(ctx, file),
            (Purpose::ReplaceStill, _) => self.replacing = Some(self.read_still(ctx, file)),
            (Purpose::Export, Some(folder)) => self.write_export(&folder),
            (Purpose::SavePicture, path) => {
                self.save_picture(&path.unwrap_or_else(|| PathBuf::from(&file.name)));
            }
            // What belongs together is taken together.
            (Purpose::Import | Purpose::LoadPlan, _)
            | (Purpose::SaveSite | Purpose::SavePlain | Purpose::Export, None) => {}
        }
    }

    /// Begins to read a still that becomes a camera.
    pub fn add_still(&mut self, ctx: &Context, file: Chosen) {
        let task = self.read_still(ctx, file);
        self.adding.push(task);
    }

    pub(crate) fn read_still(&mut self, ctx: &Context, file: Chosen) -> Task<NewStill> {
        let title = Path::new(&file.name)
            .file_stem()
            .map_or_else(|| file.name.clone(), |stem| stem.to_string_lossy().into_owned());
        let name = match (&file.path, file.bytes) {
            (Some(path), _) => path.to_string_lossy().into_owned(),
            (None, Some(bytes)) => {
                self.session.images.store(bytes.into(), mime(&file.name), Some(&file.name))
            }
            (None, None) => file.name.clone(),
        };
        let read = self.session.images.reader(&name);
        crate::work::read(ctx, file.name, read, |size, drawn| Still { name, title, size, drawn })
    }

    pub(crate) fn poll_stills(&mut self) {
        let was_empty = self.session.site.cameras.is_empty();
        // Threads finish in any order; cameras come in that of their files.
        while let Some(still) = self.adding.first().and_then(Task::outcome) {
            self.adding.remove(0);
            match still.map_err(|_| "An image could not be read.".to_owned()).flatten() {
                Ok(still) => {
                    let name = self.stored(&still);
                    self.add_camera(name, &still.title, still.size);
                }
                Err(error) => self.complain(error),
            }
        }
        if was_empty && !self.session.site.cameras.is_empty() {
            self.session.camera = 0;
        }
        if let Some(task) = self.replacing.take() {
            match task.poll() {
                None => self.replacing = Some(task),
                Some(Ok(still)) => {
                    let name = self.stored(&still);
                    self.replace_still(name, still.size);
                }
                Some(Err(error)) => self.complain(error),
            }
        }
        self.poll_plan();
    }

    /// Shows one more thing that went wrong: one error does not hide another.
    pub(crate) fn complain(&mut self, error: String) {
        match &mut self.error {
            Some(told) if !told.contains(&error) => *told = format!("{told}\n{error}"),
            Some(_) => {}
            none => *none = Some(error),
        }
    }

    /// What the site calls a picture; one that was drawn is stored.
    pub(crate) fn stored(&mut self, still: &Still) -> String {
        let drawn = still.drawn.as_ref();
        drawn.map_or_else(
            || still.name.clone(),
            |png| {
                let name = format!("{}.png", still.title);
                self.session.images.store(png.as_slice().into(), "image/png", Some(&name))
            },
        )
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
            self.session.note = Some("Cancelled: no camera was moved.".into());
            return;
        }
        let count = self.waiting();
        self.adding.clear();
        (self.replacing, self.planning) = (None, None);
        self.pictures.stop();
        self.edges.stop();
        self.session.note = Some(match count {
            0 => "Cancelled. \u{201c}Read images again\u{201d} goes on with it.".into(),
            count => format!("Cancelled: {count} images were not taken. Add them again if they are wanted."),
        });
    }

    pub(crate) fn add_camera(&mut self, image: String, title: &str, size: [u32; 2]) {
        let site = &mut self.session.site;
        let taken = |id: &str| site.cameras.iter().any(|camera| camera.id == id);
        let id = std::iter::once(title.to_owned())
            .chain((2..).map(|number| format!("{title}-{number}")))
            .find(|id| !taken(id))
            .unwrap_or_default();
        site.cameras.push(SiteCamera { image: Some(image), ..SiteCamera::new(id.clone(), size) });
        self.session.commit(format!("add {id}"));
    }

    /// Another still of the camera that it was asked for: what is drawn stays where it is, in pixels.
    pub(crate) fn replace_still(&mut self, image: String, size: [u32; 2]) {
        let id = self.replaced.clone();
        let Some(entry) = self.session.site.cameras.iter_mut().find(|camera| camera.id == id) else { return };
        let (old, from) = (entry.image.replace(image), std::mem::replace(&mut entry.size_px, size));
        let size = Some(from).filter(|from| *from != size);
        self.old_still = old.map(|image| OldStill { camera: id.clone(), image, share: 0.5, size });
        self.session.commit(format!("replace the still of {id}"));
        if let Some([w, h]) = size {
            self.session.note = Some(format!(
                "The old still was {w} \u{d7} {h} px: what is drawn can be rescaled in the panel."
            ));
        }
    }

    /// Brings everything that is drawn on the replaced still to the size of the new one.
    pub(crate) fn rescale_to_still(&mut self) {
        let Some(OldStill { camera: id, size, .. }) = &mut self.old_still else { return };
        let (id, Some(from)) = (id.clone(), size.take()) else { return };
        let site = &mut self.session.site;
        let Some(entry) = site.cameras.iter_mut().find(|camera| camera.id == id) else { return };
        let ratio = [0, 1].map(|axis| f64::from(entry.size_px[axis]) / f64::from(from[axis].max(1)));
        for annotation in &mut entry.annotations {
            scale(annotation, ratio);
        }
        if let Some(lens) = &mut entry.lens {
            crate::import::scale_lens(lens, ratio[0]);
        }
        let points = entry.efov_px.iter_mut().flatten();
        let points = points.chain(entry.control_points.iter_mut().map(|point| &mut point.px));
        let pins = site.marks.iter_mut().flat_map(|mark| &mut mark.seen);
        let pins = pins.filter(|seen| seen.camera == id).map(|seen| &mut seen.px);
        let sightings =
            site.links.iter_mut().flat_map(|link| &mut link.seen).filter(|seen| seen.camera == id);
        let sightings = sightings.flat_map(|seen| {
            let ends = seen.px.iter_mut().chain(&mut seen.foot).chain(&mut seen.head);
            ends.chain(seen.segment.iter_mut().flatten())
        });
        for pixel in points.chain(pins).chain(sightings) {
            (pixel.u, pixel.v) = (pixel.u * ratio[0], pixel.v * ratio[1]);
        }
        self.session.commit(format!("rescale what is drawn on {id}"));
    }

    /// Takes what was dropped or named: a site, an image, or a folder of images.
    pub fn take_path(&mut self, ctx: &Context, path: PathBuf) {
        if files::has_ending(&path, "json") {
            self.open_path(&path);
            return;
        }
        if files::has_ending(&path, "svg") {
            let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            self.load_plan(ctx, vec![Chosen { name, path: Some(path), bytes: None }]);
            return;
        }
        let images = if files::is_image(&path) { vec![path.clone()] } else { files::images_in(&path) };
        if images.is_empty() {
            self.complain(format!(
                "{}: neither a site (.json) nor an image (.png, .jpg), nor a folder of images",
                path.display()
            ));
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
            Err(error) => self.error = Some(error),
        }
    }

    fn save_picture(&mut self, path: &Path) {
        let Some(png) = self.pictured.take() else { return };
        match files::write(path, &png) {
            Ok(()) => self.session.note = Some(format!("Saved {}.", path.display())),
            Err(error) => self.error = Some(error),
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
            self.error = Some(
                "The system's file chooser did not open: install xdg-desktop-portal or zenity. Files can also be \
                 dropped on this window, or named when it is started."
                    .into(),
            );
        }
        match purpose {
            Purpose::Import => self.import(chosen),
            Purpose::LoadPlan => self.load_plan(ctx, chosen),
            Purpose::OpenSite if chosen.iter().all(|file| file.path.is_none()) => {
                self.take_together(ctx, chosen);
            }
            _ => chosen.into_iter().for_each(|file| self.take_file(ctx, purpose, file)),
        }
    }

    /// Opens a site file; what is wrong with it is shown.
    pub fn open_path(&mut self, path: &Path) {
        match files::open(path) {
            Ok((site, images)) => self.open_site(site, images, Some(path.to_path_buf())),
            Err(error) => self.error = Some(error),
        }
    }
}
