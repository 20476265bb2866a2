//! Files that arrive together, by a drop or a choice of several: a site with its images, or images.

use std::path::Path;

use egui::Context;

use crate::app::App;
use crate::dialog::Chosen;
use crate::files;
use crate::plan::is_world_file;
use crate::task::Task;

impl Chosen {
    /// What is in the file.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn into_bytes(self) -> files::FileResult<Vec<u8>> {
        match (self.bytes, self.path) {
            (Some(bytes), _) => Ok(bytes),
            (None, Some(path)) => files::read(&path),
            (None, None) => Err("cannot be read".into()),
        }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// When it cannot be read or is no text.
    pub fn into_text(self) -> files::FileResult<String> {
        String::from_utf8(self.into_bytes()?).map_err(|_| "not text".into())
    }

    fn is_site(&self) -> bool {
        files::has_ending(Path::new(&self.name), "json")
    }
}

/// The part of a path after its last separator, whichever system wrote it.
fn base(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

pub(crate) fn mime(name: &str) -> &'static str {
    if name.to_lowercase().ends_with(".png") { "image/png" } else { "image/jpeg" }
}

impl App {
    pub(crate) fn poll_arrivals(&mut self, ctx: &Context) {
        let dropped = ctx.input_mut(|input| std::mem::take(&mut input.raw.dropped_files));
        if !dropped.is_empty() {
            self.arriving.push(self::dropped(ctx, dropped));
        }
        let mut arrived = Vec::new();
        self.arriving.retain(|task| task.poll().map(|files| arrived.push(files)).is_none());
        for files in arrived {
            let (on_disk, loose): (Vec<_>, Vec<_>) = files.into_iter().partition(|file| file.path.is_some());
            let (sites, mut others): (Vec<_>, Vec<_>) = on_disk.into_iter().partition(Chosen::is_site);
            let has_site = !sites.is_empty();
            for path in sites.into_iter().filter_map(|file| file.path) {
                self.take_path(ctx, path);
            }
            if has_site {
                // Its plan lies as the site says.
                others.retain(|file| !is_world_file(file));
            } else {
                self.take_plans(ctx, &mut others);
            }
            // The images of a site that came with it are no further cameras.
            let own: Vec<String> = files::image_names(&self.session.site);
            let is_own = |file: &Chosen| has_site && own.iter().any(|name| base(name) == base(&file.name));
            for path in others.into_iter().filter(|file| !is_own(file)).filter_map(|file| file.path) {
                self.take_path(ctx, path);
            }
            if !loose.is_empty() {
                self.take_together(ctx, loose);
            }
        }
    }

    /// Takes files that are not on a disk: a site with the images it names, or images.
    pub fn take_together(&mut self, ctx: &Context, mut files: Vec<Chosen>) {
        if let Some(site) = files.iter().position(Chosen::is_site) {
            let file = files.remove(site);
            let name = file.name.clone();
            match file.into_text().and_then(|text| files::parse(&text, None)) {
                Ok((site, images)) => self.open_site(site, images, Some(name.into())),
                Err(error) => {
                    self.error = Some(format!("{name}: {error}"));
                    return;
                }
            }
            self.attach(&mut files);
            if !files.is_empty() {
                let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
                self.session.note = Some(format!("Not of this site: {}.", names.join(", ")));
            }
            return;
        }
        self.attach(&mut files);
        self.take_plans(ctx, &mut files);
        for file in files {
            let name = Path::new(&file.name);
            if file.bytes.is_some() && files::has_ending(name, "svg") {
                self.load_plan(ctx, vec![file]);
            } else if file.bytes.is_none() || !files::is_image(name) {
                self.complain(format!("{}: neither a site (.json) nor an image (.png, .jpg)", file.name));
            } else {
                self.add_still(ctx, file);
            }
        }
    }

    /// Gives the site those of its images that are not there yet, and takes them from `files`.
    fn attach(&mut self, files: &mut Vec<Chosen>) {
        let session = &mut self.session;
        let made = session.images.missing.is_some();
        let mut used = vec![false; files.len()];
        let mut ids = Vec::new();
        for name in files::image_names(&session.site) {
            if made || session.images.is_stored(&name) {
                continue;
            }
            let Some(index) = files.iter().position(|file| base(&file.name) == base(&name)) else { continue };
            let Some(bytes) = files[index].bytes.clone() else { continue };
            let id = session.images.store(bytes.into(), mime(&name), Some(&name));
            self.pictures.forget(&name);
            (used[index], ids) = (true, [ids, vec![(name, id)]].concat());
        }
        if ids.is_empty() {
            return;
        }
        let rename = |site: &calib_core::Site| {
            let mut site = site.clone();
            for image in files::images_mut(&mut site) {
                if let Some((_, id)) = ids.iter().find(|(name, _)| name == image) {
                    image.clone_from(id);
                }
            }
            site
        };
        let renamed = rename(&session.site);
        session.site = renamed;
        session.history.map(rename);
        let mut used = used.into_iter();
        files.retain(|_| !used.next().unwrap_or_default());
        // The shelf gets them with the next gesture, and what was kept before is complete again.
        session.generation += u64::from(session.generation > 0);
    }
}

#[cfg(not(target_arch = "wasm32"))]
fn dropped(_: &Context, files: Vec<egui::DroppedFileHandle>) -> Task<Vec<Chosen>> {
    let one = |file: egui::DroppedFileHandle| Chosen {
        name: file.path().to_string_lossy().into_owned(),
        path: Some(file.path().to_path_buf()),
        bytes: None,
    };
    Task::done(files.into_iter().map(one).collect())
}

#[cfg(target_arch = "wasm32")]
fn dropped(ctx: &Context, files: Vec<egui::DroppedFileHandle>) -> Task<Vec<Chosen>> {
    Task::wait(ctx, async move {
        let mut chosen = Vec::new();
        for file in files {
            let name = file.path().to_string_lossy().into_owned();
            // A folder has none; whoever takes it says so.
            let bytes = file.bytes_async().await.ok();
            chosen.push(Chosen { name, path: None, bytes });
        }
        chosen
    })
}
