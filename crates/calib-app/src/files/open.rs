//! Opening of files: sites, images, floor plans, calibrations of other programs and tables of points. The kind of a
//! file follows from its name and content, so one command opens all kinds. Dropped files are opened in the same way.

use std::path::{Path, PathBuf};

use calib_editor::images::{file_name, has_ending, is_image, mime};
use calib_editor::{Action, image_names, parse};
use calib_report::shortened_list;
use egui::Context;

use crate::choice::Chosen;
use crate::drawing::is_drawing;
use crate::files::images::is_world_file;
use crate::platform::{Here, Platform as _};
use crate::state::{App, Mode};

/// Kind of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
enum FileKind {
    /// Site file.
    Site,
    /// Floor plan as a drawing (PDF, DXF, SVG).
    Drawing,
    /// Image.
    Image,
    /// Video.
    Video,
    /// Image that cannot be read; contains the reason, with advice for the operator.
    Refused(String),
    /// File of another program, or a table of points.
    Other,
}

/// Text that the content of every site file contains.
const SITE_FORMAT: &[u8] = b"\"calib-site\"";

impl FileKind {
    /// Determines the kind of a file from its name and its content.
    fn of(file: &Chosen) -> Self {
        let name = Path::new(&file.name);
        if is_drawing(name) {
            return Self::Drawing;
        }
        if is_image(name) {
            return Self::Image;
        }
        let head = file.head();
        let is_site = |text: &[u8]| text.windows(SITE_FORMAT.len()).any(|part| part == SITE_FORMAT);
        let is_json = has_ending(name, "json") || head.trim_ascii_start().starts_with(b"{");
        // In a site file with sorted keys, the format is after the cameras, possibly beyond the first bytes.
        let is_whole_site = || match &file.bytes {
            Some(text) => is_site(text),
            None => file.clone().into_bytes().is_ok_and(|text| is_site(&text)),
        };
        if is_json && (is_site(&head) || is_whole_site()) {
            Self::Site
        } else if head.starts_with(b"%PDF-") {
            Self::Drawing
        } else if calib_input::is_video(&head) {
            Self::Video
        } else if calib_input::is_image_or_video(&head) {
            let refusal = calib_input::refusal(&head).filter(|_| !Here::HAS_OTHER_DECODERS);
            refusal.map_or(Self::Image, |reason| Self::Refused(reason.to_string()))
        } else {
            Self::Other
        }
    }
}

impl Chosen {
    /// Returns the first bytes of the file; empty if it cannot be read.
    fn head(&self) -> Vec<u8> {
        /// Number of bytes that determine the kind of most files.
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
    /// A site is opened with its images. Without a site, images become cameras. A single image becomes the plan if
    /// the plan view is shown and the site has no plan. Images with a world file and drawings become the plan. Other
    /// files are imported after the images and the plan are read.
    pub fn open_files(&mut self, ctx: &Context, files: Vec<Chosen>) {
        let files = self.without_folders(files);
        let mut kinds: Vec<(FileKind, Chosen)> =
            files.into_iter().map(|file| (FileKind::of(&file), file)).collect();
        if let Some(site) = kinds.iter().position(|(kind, _)| *kind == FileKind::Site) {
            let (_, site) = kinds.remove(site);
            self.open_with_images(site, kinds.into_iter().map(|(_, file)| file).collect());
            return;
        }
        let is_plan = self.view.mode == Mode::Plan && self.editor.site().plan.is_none() && kinds.len() == 1;
        let (mut readable, mut others, mut videos) = (Vec::new(), Vec::new(), Vec::new());
        for (kind, file) in kinds {
            match kind {
                FileKind::Refused(reason) => {
                    self.act(Action::AddError(format!("Cannot open {}: {reason}.", file.name)));
                }
                FileKind::Video => videos.push(file),
                FileKind::Other if !is_world_file(&file) => others.push(file),
                _ => readable.push(file),
            }
        }
        self.attach(&mut readable);
        self.take_plans(ctx, &mut readable);
        self.take_newer(ctx, &mut readable);
        let (drawings, images): (Vec<_>, Vec<_>) =
            readable.into_iter().partition(|file| is_plan || FileKind::of(file) == FileKind::Drawing);
        if !drawings.is_empty() {
            self.load_plan(ctx, drawings);
        }
        images.into_iter().for_each(|file| self.add_still(ctx, file));
        self.open_videos(ctx, videos);
        self.jobs.importing.extend(others);
        self.poll_imports();
    }

    /// Opens images, videos and folders of images as cameras.
    pub(crate) fn open_images(&mut self, ctx: &Context, files: Vec<Chosen>) {
        let mut files = self.without_folders(files);
        self.take_newer(ctx, &mut files);
        self.add_images(ctx, files);
    }

    /// Adds a camera for every image. For a video, the operator chooses the image first.
    pub(crate) fn add_images(&mut self, ctx: &Context, files: Vec<Chosen>) {
        let (videos, images) = files.into_iter().partition(|file| FileKind::of(file) == FileKind::Video);
        self.open_videos(ctx, videos);
        images.into_iter().for_each(|file| self.add_still(ctx, file));
    }

    /// Imports the waiting files once all images and the plan are read, and no video waits for the operator. The
    /// cameras of these images then exist, so that imported lenses can be assigned to them.
    pub(crate) fn poll_imports(&mut self) {
        let has_video = self.jobs.video.is_some() || !self.jobs.videos.is_empty();
        let is_ready = self.jobs.adding.is_empty() && self.jobs.planning.is_none() && !has_video;
        if is_ready && !self.jobs.importing.is_empty() {
            let files = std::mem::take(&mut self.jobs.importing);
            self.import(files);
        }
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
            let names = shortened_list(skipped.iter().map(String::as_str));
            self.act(Action::Note(format!("Skipped files that are not images: {names}.")));
        }
        kept
    }

    /// Opens a site. Files that are images of this site belong to it; a note names the others.
    fn open_with_images(&mut self, site: Chosen, mut files: Vec<Chosen>) {
        let name = site.name.clone();
        match site.path.clone() {
            Some(path) if !self.open_path(&path) => return,
            Some(_) => {}
            None => match site.into_text().and_then(|text| parse(&text, None)) {
                Ok((site, images)) => self.open_site(site, images, Some(name.into())),
                Err(error) => {
                    self.act(Action::SetError(format!("{name}: {error}")));
                    return;
                }
            },
        }
        self.attach(&mut files);
        // The site file contains the georeference of its plan.
        files.retain(|file| !is_world_file(file));
        let own: Vec<String> = image_names(self.editor.site());
        files.retain(|file| {
            file.path.is_none() || !own.iter().any(|name| file_name(name) == file_name(&file.name))
        });
        if !files.is_empty() {
            let names = shortened_list(files.iter().map(|file| file.name.as_str()));
            self.act(Action::Note(format!("Skipped files that are not part of this site: {names}.")));
        }
    }

    /// Starts comparing the files that are newer images of cameras, and removes them from `files`.
    pub(crate) fn take_newer(&mut self, ctx: &Context, files: &mut Vec<Chosen>) {
        let (newer, others) = std::mem::take(files).into_iter().partition(|file| self.is_newer(file));
        *files = others;
        self.add_newer(ctx, newer);
    }

    /// Stores the files that are missing images of the site in the site, and removes these files from `files`.
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
}
