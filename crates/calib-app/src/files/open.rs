//! Opening of files: sites, images, floor plans, calibrations of other programs and tables of points. The kind of a
//! file follows from its content, so one command opens all of them, and so does dropping.

use std::path::{Path, PathBuf};

use calib_editor::images::{file_name, has_ending, is_image, mime};
use calib_editor::{Action, image_names, parse};
use egui::Context;

use crate::choice::Chosen;
use crate::drawing::is_drawing;
use crate::files::images::is_world_file;
use crate::platform::{Here, Platform as _};
use crate::state::{App, Mode};

/// Kind of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FileKind {
    /// Site file.
    Site,
    /// Floor plan as a drawing (PDF, DXF, SVG).
    Drawing,
    /// Image, or a video, for which the decoder names a way out.
    Image,
    /// File of another program, or a table of points.
    Other,
}

impl FileKind {
    /// Determines the kind of a file from its first bytes and its name.
    fn of(file: &Chosen) -> Self {
        const SITE_FORMAT: &[u8] = b"\"calib-site\"";
        let name = Path::new(&file.name);
        let head = file.head();
        if has_ending(name, "json") && head.windows(SITE_FORMAT.len()).any(|part| part == SITE_FORMAT) {
            Self::Site
        } else if is_drawing(name) || head.starts_with(b"%PDF-") {
            Self::Drawing
        } else if is_image(name) || calib_input::is_image_or_video(&head) {
            Self::Image
        } else {
            Self::Other
        }
    }
}

impl Chosen {
    /// Returns the first bytes of the file; empty if it cannot be read.
    fn head(&self) -> Vec<u8> {
        /// Number of bytes that determine the kind of a file.
        const HEAD: usize = 1 << 16;
        match (&self.bytes, &self.path) {
            (Some(bytes), _) => bytes[..bytes.len().min(HEAD)].to_vec(),
            (None, Some(path)) => Here::head(path, HEAD),
            (None, None) => Vec::new(),
        }
    }
}

impl App {
    /// Opens files and folders on disk.
    pub fn open_paths(&mut self, ctx: &Context, paths: impl IntoIterator<Item = PathBuf>) {
        self.open_files(ctx, paths.into_iter().map(Chosen::of_path).collect());
    }

    /// Opens chosen or dropped files and folders.
    ///
    /// A site is opened with its images. Without a site, images become cameras, or the plan if the plan is shown
    /// and the site has none. Images with a world file and drawings become the plan. Other files are imported.
    pub fn open_files(&mut self, ctx: &Context, files: Vec<Chosen>) {
        let mut files = self.without_folders(files);
        if let Some(site) = files.iter().position(|file| FileKind::of(file) == FileKind::Site) {
            let site = files.remove(site);
            self.open_with_images(site, files);
            return;
        }
        self.attach(&mut files);
        self.take_plans(ctx, &mut files);
        self.take_newer(ctx, &mut files);
        let is_plan = self.view.mode == Mode::Plan && self.editor.site().plan.is_none() && files.len() == 1;
        let mut others = Vec::new();
        for file in files {
            match FileKind::of(&file) {
                FileKind::Drawing => self.load_plan(ctx, vec![file]),
                FileKind::Image if is_plan => self.load_plan(ctx, vec![file]),
                FileKind::Image => self.add_still(ctx, file),
                FileKind::Site | FileKind::Other => others.push(file),
            }
        }
        self.import(others);
    }

    /// Replaces folders by their images. A note names the files in folders that are not images.
    fn without_folders(&mut self, files: Vec<Chosen>) -> Vec<Chosen> {
        let (mut kept, mut skipped) = (Vec::new(), Vec::new());
        for file in files {
            let Some(inside) = file.path.as_deref().and_then(Here::files_in) else {
                kept.push(file);
                continue;
            };
            let inside = inside.into_iter().map(Chosen::of_path);
            let (images, others): (Vec<_>, Vec<_>) =
                inside.partition(|file| FileKind::of(file) == FileKind::Image);
            if images.is_empty() {
                self.act(Action::AddError(format!("The folder {} contains no images.", file.name)));
            } else {
                skipped.extend(others.into_iter().map(|file| file.name));
            }
            kept.extend(images);
        }
        if !skipped.is_empty() {
            self.act(Action::Note(format!("Skipped, because they are not images: {}.", skipped.join(", "))));
        }
        kept
    }

    /// Opens a site. Files that are images of this site belong to it; a note names the others.
    fn open_with_images(&mut self, site: Chosen, mut files: Vec<Chosen>) {
        match site.path.clone() {
            Some(path) => self.open_path(&path),
            None => {
                let name = site.name.clone();
                match site.into_text().and_then(|text| parse(&text, None)) {
                    Ok((site, images)) => self.open_site(site, images, Some(name.into())),
                    Err(error) => {
                        self.act(Action::SetError(format!("{name}: {error}")));
                        return;
                    }
                }
            }
        }
        self.attach(&mut files);
        // The site file contains the georeference of its plan.
        files.retain(|file| !is_world_file(file));
        let own: Vec<String> = image_names(self.editor.site());
        files.retain(|file| {
            file.path.is_none() || !own.iter().any(|name| file_name(name) == file_name(&file.name))
        });
        if !files.is_empty() {
            let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
            self.act(Action::Note(format!("Not part of this site: {}.", names.join(", "))));
        }
    }

    /// Starts comparing the files that are newer images of cameras, and removes them from `files`.
    fn take_newer(&mut self, ctx: &Context, files: &mut Vec<Chosen>) {
        let (newer, others) = std::mem::take(files).into_iter().partition(|file| self.is_newer(file));
        *files = others;
        self.add_newer(ctx, newer);
    }

    /// Adds the files that are missing images of the site to it, and removes them from `files`.
    fn attach(&mut self, files: &mut Vec<Chosen>) {
        let made = self.editor.session().images.missing.is_some();
        let mut used = vec![false; files.len()];
        let mut ids = Vec::new();
        for name in image_names(self.editor.site()) {
            if made || self.editor.session().images.is_stored(&name) {
                continue;
            }
            let Some(index) = files.iter().position(|file| file_name(&file.name) == file_name(&name)) else {
                continue;
            };
            let Some(bytes) = files[index].bytes.clone() else { continue };
            let id = self.editor.store_image(bytes.into(), mime(&name), Some(&name));
            self.pictures.forget(&name);
            used[index] = true;
            ids.push((name, id));
        }
        if ids.is_empty() {
            return;
        }
        self.act(Action::Attach(ids));
        let mut used = used.into_iter();
        files.retain(|_| !used.next().unwrap_or_default());
    }

    /// Opens the dropped files once they are read.
    pub(crate) fn poll_arrivals(&mut self, ctx: &Context) {
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
}
