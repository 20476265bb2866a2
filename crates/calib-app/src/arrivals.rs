//! Files that arrive together, by a drop or a choice of several: a site with its images, or images.

use std::path::{Path, PathBuf};

use calib_editor::images::{base, has_ending, is_image, mime};
use calib_editor::{Action, image_names, parse};
use egui::Context;

use crate::choice::Chosen;
use crate::plan::is_world_file;
use crate::platform::{Here, Platform as _};
use crate::state::App;

impl App {
    /// Takes what was dropped or named: a site, an image, or a folder of images.
    pub fn take_path(&mut self, ctx: &Context, path: PathBuf) {
        if has_ending(&path, "json") {
            self.open_path(&path);
            return;
        }
        if has_ending(&path, "svg") {
            self.load_plan(ctx, vec![Chosen::of_path(path)]);
            return;
        }
        let images = if is_image(&path) { vec![path.clone()] } else { Here::images_in(&path) };
        if images.is_empty() {
            self.act(Action::Complain(format!(
                "{}: neither a site (.json) nor an image (.png, .jpg), nor a folder of images",
                path.display()
            )));
        }
        let mut files: Vec<Chosen> = images.into_iter().map(Chosen::of_path).collect();
        self.take_newer(ctx, &mut files);
        files.into_iter().for_each(|file| self.add_still(ctx, file));
    }

    pub(crate) fn poll_arrivals(&mut self, ctx: &Context) {
        let dropped = ctx.input_mut(|input| std::mem::take(&mut input.raw.dropped_files));
        if !dropped.is_empty() {
            self.arriving.push(Here::dropped(ctx, dropped));
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
            let own: Vec<String> = image_names(self.editor.site());
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
            match file.into_text().and_then(|text| parse(&text, None)) {
                Ok((site, images)) => self.open_site(site, images, Some(name.into())),
                Err(error) => {
                    self.act(Action::Fail(format!("{name}: {error}")));
                    return;
                }
            }
            self.attach(&mut files);
            if !files.is_empty() {
                let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
                let note = format!("Not of this site: {}.", names.join(", "));
                self.act(Action::Note(note));
            }
            return;
        }
        self.attach(&mut files);
        self.take_plans(ctx, &mut files);
        self.take_newer(ctx, &mut files);
        for file in files {
            let name = Path::new(&file.name);
            if file.bytes.is_some() && has_ending(name, "svg") {
                self.load_plan(ctx, vec![file]);
            } else if file.bytes.is_none() || !is_image(name) {
                self.act(Action::Complain(format!(
                    "{}: neither a site (.json) nor an image (.png, .jpg)",
                    file.name
                )));
            } else {
                self.add_still(ctx, file);
            }
        }
    }

    /// Compares those files that are newer stills of cameras, and takes them from `files`.
    fn take_newer(&mut self, ctx: &Context, files: &mut Vec<Chosen>) {
        let (newer, others) = std::mem::take(files).into_iter().partition(|file| self.is_newer(file));
        *files = others;
        self.add_newer(ctx, newer);
    }

    /// Gives the site those of its images that are not there yet, and takes them from `files`.
    fn attach(&mut self, files: &mut Vec<Chosen>) {
        let made = self.editor.session().images.missing.is_some();
        let mut used = vec![false; files.len()];
        let mut ids = Vec::new();
        for name in image_names(self.editor.site()) {
            if made || self.editor.session().images.is_stored(&name) {
                continue;
            }
            let Some(index) = files.iter().position(|file| base(&file.name) == base(&name)) else { continue };
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
