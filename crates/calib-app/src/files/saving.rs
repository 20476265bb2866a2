//! The site's own file: it is written only while it is what was read, or when the operator says so.
//!
//! What is done with the document as a whole: opened, recovered, saved.
//!
//! Files that arrive together, by a drop or a choice of several: a site with its images, or images.

use std::path::{Path, PathBuf};

use calib_editor::images::{base, has_ending, is_image, mime};
use calib_editor::{Action, Images, Opened, differences, image_names, parse};
use calib_site::{Site, counted};
use egui::Context;

use crate::choice::{Chosen, Purpose};
use crate::edges::Proposing;
use crate::files::images::is_world_file;
use crate::platform::{Here, Platform as _};
use crate::state::{App, Comparing, Conflict, Decision, Outside, Panes, Sheet, Tour, Why};
use crate::storage::autosave::{self, Autosave, Found, News, Recent, Work};
use crate::storage::files;

impl App {
    /// Opens a site in place of the one that is open.
    pub fn open_site(&mut self, site: Site, images: Images, path: Option<PathBuf>) {
        self.open(Opened { site, images, path, is_unsaved: false });
    }

    fn open(&mut self, opened: Opened) {
        self.put_aside();
        (self.storage.held, self.storage.as_held, self.dialogs.conflict) = (None, None, None);
        self.storage.kept = u64::from(opened.is_unsaved);
        self.act(Action::Open(Box::new(opened)));
        if let Some(shelf) = &mut self.storage.shelf {
            shelf.begin();
        }
        self.pictures.clear();
        self.edges.clear();
        self.view.panes = Panes::default();
        self.view.orbit = None;
        // Nothing that was asked for the old site lands in the new one.
        self.jobs.adding.clear();
        (self.jobs.replacing, self.jobs.planning, self.jobs.refining, self.dialogs.dialog) =
            (None, None, None, None);
        self.stop_comparing();
        (self.jobs.picture, self.jobs.pictured) = (None, None);
        (self.dialogs.export, self.tour) = (Sheet::default(), Tour::default());
        self.dialogs.outside = Outside::default();
        self.view.compares_views = false;
    }

    /// Opens a site file; what is wrong with it is shown.
    pub fn open_path(&mut self, path: &Path) {
        match files::open_stamped(path) {
            Ok((site, images, held)) => {
                let as_held = site.clone();
                self.open_site(site, images, Some(path.to_path_buf()));
                self.remember_recent(path, &as_held);
                (self.storage.held, self.storage.as_held) = (Some(held), Some(as_held));
            }
            Err(error) => self.act(Action::Fail(error)),
        }
    }

    /// Remembers a site for the start page.
    pub(crate) fn remember_recent(&mut self, path: &Path, site: &Site) {
        if let Some((folder, now)) = self.storage.folder.as_deref().zip(Here::now()) {
            self.storage.recent = autosave::remember(folder, Recent::of(path, site, now));
        }
    }

    /// Goes on with what a crashed session left.
    pub fn recover(&mut self, index: usize) {
        if index >= self.storage.found.len() {
            return;
        }
        let (slot, Found { site, images, path, held, .. }) = self.storage.found.remove(index);
        // It differs from its file, and is kept already.
        self.open(Opened { site, images, path, is_unsaved: true });
        (self.storage.autosave, self.storage.held) = (Some(slot), held);
    }

    /// Leaves the work on the open site where it is kept, to be gone on with, and keeps the next elsewhere.
    fn put_aside(&mut self) {
        let Some(slot) = self.storage.autosave.clone() else { return };
        let session = self.editor.session();
        if session.is_saved() {
            slot.forget();
            return;
        }
        let (images, path) = (session.images.clone(), session.path.clone());
        let held = self.storage.held;
        self.storage.found.push((slot, Found { site: session.kept(), images, path, held, at: Here::now() }));
        self.storage.autosave = None;
        for slot in self.storage.folder.iter().flat_map(|folder| Autosave::slots(folder)) {
            let is_taken = self.storage.found.iter().any(|(found, _)| found.folder() == slot.folder());
            let own = self.storage.claims.iter().any(|(folder, _)| folder == slot.folder());
            let claim = if own { None } else { Here::claim(slot.folder()) };
            if is_taken || !(own || claim.is_some()) || slot.find().is_some() {
                continue;
            }
            self.storage.claims.extend(claim.map(|claim| (slot.folder().to_path_buf(), claim)));
            slot.forget();
            self.storage.autosave = Some(slot);
            return;
        }
    }

    /// Forgets what a crashed session left.
    pub fn discard_found(&mut self, index: usize) {
        if index < self.storage.found.len() {
            self.storage.found.remove(index).0.forget();
        }
    }

    /// What the shelf has to tell.
    pub(crate) fn poll_shelf(&mut self) {
        while let Some(news) = self.storage.shelf.as_mut().and_then(|shelf| shelf.news()) {
            match news {
                News::Opened(found) => {
                    // It stays the shelf's: what follows is kept in its place.
                    let shelf = self.storage.shelf.take();
                    let Found { site, images, path, .. } = *found;
                    self.open(Opened { site, images, path, is_unsaved: true });
                    self.storage.shelf = shelf;
                }
                News::Trouble(error) => self.act(Action::Fail(error)),
                News::Note(note) => self.act(Action::Note(note)),
                News::Again => self.storage.kept = u64::MAX,
            }
        }
    }

    /// Keeps every finished gesture where a crash does not reach it.
    pub(crate) fn remember(&mut self) {
        let generation = self.editor.session().generation;
        // What was kept before its still was decoded is kept again with its picture.
        let is_due = self.storage.shelf.is_some() && self.storage.thumbnail.is_due(&self.pictures);
        if self.storage.kept == generation && !is_due {
            return;
        }
        self.storage.kept = generation;
        if self.storage.autosave.is_none() && self.storage.folder.is_some() && generation == 1 {
            let note = "Not kept against a crash: nine unsaved sites wait already. Save it as a file.";
            self.act(Action::Note(note.into()));
        }
        let session = self.editor.session();
        // Undo to what is saved leaves nothing to lose, but the file tells no tale of it: keep it all the same.
        let site = session.kept();
        if self.storage.shelf.is_some() {
            self.storage.thumbnail.renew(&site, &self.pictures);
        }
        let session = self.editor.session();
        if let Some(shelf) = &mut self.storage.shelf {
            let thumbnail = self.storage.thumbnail.of(&site);
            let last = session.history.undo_name().unwrap_or_default();
            shelf.keep(Work {
                site: &site,
                images: &session.images,
                path: session.path.clone(),
                last,
                thumbnail,
            });
        }
        let Some(autosave) = &self.storage.autosave else { return };
        if let Err(error) = autosave.keep(&site, &session.images, session.path.as_deref(), self.storage.held)
        {
            self.act(Action::Fail(format!("Autosave: {error}")));
        }
    }

    /// Saves the site without its images: a file to lie beside them.
    pub(crate) fn save_plain(&mut self, path: &Path) {
        let session = self.editor.session();
        let site = session.images.name_into(&session.solved.write_into(&session.site));
        self.act(match Here::write(path, site.to_json().as_bytes()) {
            Ok(()) => Action::Note(format!("Saved {} without its images.", path.display())),
            Err(error) => Action::Fail(error),
        });
    }

    /// Writes what the sheet shows into a folder; in the browser, without one, as downloads.
    pub(crate) fn write_export(&mut self, folder: &Path) {
        let Some(files) = self.dialogs.export.files() else { return };
        let written = files.iter().try_for_each(|file| Here::write(&folder.join(&file.name), &file.bytes));
        let count = counted(files.len(), "file", "files");
        match written {
            Ok(()) => {
                self.act(Action::Note(if folder.as_os_str().is_empty() {
                    format!("Handed over as downloads: {count}.")
                } else {
                    format!("Wrote {count} to {}.", folder.display())
                }));
                self.dialogs.export.close();
            }
            Err(error) => self.act(Action::Fail(error)),
        }
    }
}

impl App {
    /// Saves to the site's own file.
    pub fn save(&mut self) {
        if let Some(path) = self.editor.session().path.clone() {
            self.save_to(path);
        }
    }

    /// Saves to a file, which is the site's own from then on, unless that would take something away.
    pub(crate) fn save_to(&mut self, path: PathBuf) {
        match self.obstacle(&path) {
            Some(why) => self.dialogs.conflict = Some(Conflict { path, why }),
            None => self.write_to(path),
        }
    }

    /// Why a file is not to be written without asking.
    fn obstacle(&self, path: &Path) -> Option<Why> {
        if !Here::HAS_FOLDERS {
            return None;
        }
        // Whatever is there and cannot be read is not what was read.
        let there = path.exists().then(|| Here::read(path).map_or(0, |bytes| files::stamp(&bytes)));
        let is_own = self.editor.session().path.as_deref() == Some(path);
        match there {
            Some(now) if is_own && self.storage.held != Some(now) => {
                Some(Why::Changed(self.changes_of(path)))
            }
            Some(_) if Here::is_read_only(path) => Some(Why::ReadOnly),
            _ => None,
        }
    }

    /// What a file has that was otherwise when it was read; where that is not known, against the open site.
    fn changes_of(&self, path: &Path) -> Vec<String> {
        let before = self.storage.as_held.as_ref().unwrap_or_else(|| self.editor.site());
        match files::open(path) {
            Ok((now, _)) => differences(before, &now),
            Err(error) => vec![error],
        }
    }

    /// Does what the operator decided about a file that was not written.
    pub(crate) fn decide_on_file(&mut self, decision: Decision) {
        let Some(Conflict { path, .. }) = self.dialogs.conflict.take() else { return };
        match decision {
            Decision::Reload => self.open_path(&path),
            Decision::SaveAs => self.ask(Purpose::SaveSite),
            Decision::Overwrite => self.write_to(path),
            Decision::Leave => {}
        }
    }

    /// What is being looked for goes on under the names that its images have beside the file.
    fn rebase_work(&mut self, folder: &Path) {
        let images = &self.editor.session().images;
        let compared = self.jobs.comparing.iter_mut().flat_map(Comparing::images_mut);
        let proposed = self.jobs.proposing.iter_mut().flat_map(Proposing::images_mut);
        for name in compared.chain(proposed) {
            *name = images.rebased_name(name, folder);
        }
    }

    fn write_to(&mut self, path: PathBuf) {
        let session = self.editor.session();
        let solved = session.solved.write_into(&session.site);
        match files::save(&path, &solved, &session.images) {
            Ok(held) => {
                self.remember_recent(&path, &solved);
                (self.storage.held, self.storage.as_held) = (Some(held), Some(solved));
            }
            Err(error) => {
                self.act(Action::Fail(error));
                return;
            }
        }
        let folder = path.parent().filter(|_| Here::HAS_FOLDERS).map(Path::to_path_buf);
        if let Some(folder) =
            folder.as_ref().filter(|&new| Some(new) != self.editor.session().images.folder.as_ref())
        {
            self.pictures.clear();
            self.keep_reach();
            self.rebase_work(folder);
        }
        self.act(Action::Saved { path, folder });
        if let Some(autosave) = &self.storage.autosave {
            autosave.forget();
        }
        self.storage.kept = self.editor.session().generation;
    }
}

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
            self.jobs.arriving.push(Here::dropped(ctx, dropped));
        }
        let mut arrived = Vec::new();
        self.jobs.arriving.retain(|task| task.poll().map(|files| arrived.push(files)).is_none());
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
