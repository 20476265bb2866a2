//! Opening, recovering and saving of sites. A site file is overwritten only if it is unchanged
//! since it was read, or if the operator confirms.

use std::path::{Path, PathBuf};

use calib_editor::{Action, Images, Opened, differences};
use calib_site::{Site, counted};

use crate::choice::Purpose;
use crate::edges::Proposing;
use crate::platform::{Here, Platform as _};
use crate::state::{App, Comparing, Conflict, Decision, Outside, Panes, Sheet, Tour, Why};
use crate::storage::autosave::{self, Autosave, Found, News, Recent, Work};
use crate::storage::files;

impl App {
    /// Opens a site in place of the current site.
    pub fn open_site(&mut self, site: Site, images: Images, path: Option<PathBuf>) {
        self.open(Opened { site, images, path, is_unsaved: false });
    }

    /// Replaces the site, and resets everything that belongs to the old site.
    fn open(&mut self, opened: Opened) {
        self.keep_autosave();
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
        // Work for the old site must not change the new site.
        self.jobs.adding.clear();
        self.jobs.importing.clear();
        (self.jobs.replacing, self.jobs.planning, self.jobs.refining, self.dialogs.dialog) =
            (None, None, None, None);
        (self.jobs.proposing, self.jobs.automatic, self.dialogs.automatic) = (None, None, None);
        (self.jobs.video, self.dialogs.address) = (None, None);
        self.jobs.videos.clear();
        self.stop_comparing();
        (self.jobs.picture, self.jobs.pictured) = (None, None);
        (self.dialogs.export, self.tour) = (Sheet::default(), Tour::default());
        self.dialogs.outside = Outside::default();
        self.view.compares_views = false;
    }

    /// Opens a site file; errors are shown. Returns whether the site is open.
    pub fn open_path(&mut self, path: &Path) -> bool {
        match files::open_stamped(path) {
            Ok((site, images, held)) => {
                let as_held = site.clone();
                self.open_site(site, images, Some(path.to_path_buf()));
                self.remember_recent(path, &as_held);
                (self.storage.held, self.storage.as_held) = (Some(held), Some(as_held));
                true
            }
            Err(error) => {
                self.act(Action::SetError(error));
                false
            }
        }
    }

    /// Adds a site to the list of recent sites on the start page.
    pub(crate) fn remember_recent(&mut self, path: &Path, site: &Site) {
        if let Some((folder, now)) = self.storage.folder.as_deref().zip(Here::now()) {
            self.storage.recent = autosave::remember(folder, Recent::of(path, site, now));
        }
    }

    /// Restores an unsaved site from its autosave, by its index in the list of the start page.
    pub fn recover(&mut self, index: usize) {
        if index >= self.storage.found.len() {
            return;
        }
        let (slot, Found { site, images, path, held, .. }) = self.storage.found.remove(index);
        // The restored site differs from its file and already has an autosave.
        self.open(Opened { site, images, path, is_unsaved: true });
        (self.storage.autosave, self.storage.held) = (Some(slot), held);
    }

    /// Keeps the autosave of the open site if the site has unsaved changes, and chooses a free slot for the
    /// next site.
    fn keep_autosave(&mut self) {
        let Some(slot) = self.storage.autosave.clone() else { return };
        let session = self.editor.session();
        if session.is_saved() {
            slot.forget();
            return;
        }
        let (images, path) = (session.images.clone(), session.path.clone());
        let held = self.storage.held;
        self.storage.found.push((
            slot,
            Found { site: session.site_with_joint_results(), images, path, held, at: Here::now() },
        ));
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

    /// Deletes the autosave of an unsaved site, by its index in the list of the start page.
    pub fn discard_found(&mut self, index: usize) {
        if index < self.storage.found.len() {
            self.storage.found.remove(index).0.forget();
        }
    }

    /// Handles messages of the browser's site storage.
    pub(crate) fn poll_shelf(&mut self) {
        while let Some(news) = self.storage.shelf.as_mut().and_then(|shelf| shelf.news()) {
            match news {
                News::Opened(found) => {
                    // Without the storage, `open` cannot begin a new entry there. Later changes replace the opened
                    // entry.
                    let shelf = self.storage.shelf.take();
                    let Found { site, images, path, .. } = *found;
                    self.open(Opened { site, images, path, is_unsaved: true });
                    self.storage.shelf = shelf;
                }
                News::Trouble(error) => self.act(Action::SetError(error)),
                News::Note(note) => self.act(Action::Note(note)),
                News::Again => self.storage.kept = u64::MAX,
            }
        }
    }

    /// Autosaves the site if a gesture has finished since the last autosave.
    pub(crate) fn remember(&mut self) {
        let generation = self.editor.session().revision.generation;
        // An autosave without a thumbnail is repeated once the first image is decoded.
        let is_due = self.storage.shelf.is_some() && self.storage.thumbnail.is_due(&self.pictures);
        if self.storage.kept == generation && !is_due {
            return;
        }
        self.storage.kept = generation;
        if self.storage.autosave.is_none() && self.storage.folder.is_some() && generation == 1 {
            let note = "Autosave is full (nine unsaved sites). Save this site to a file.";
            self.act(Action::Note(note.into()));
        }
        let session = self.editor.session();
        // The autosave is written even after an undo to the saved state, because the autosave does not record which
        // state was saved.
        let site = session.site_with_joint_results();
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
            self.act(Action::SetError(format!("Autosave failed: {error}. Save the site to a file.")));
        }
    }

    /// Saves the site without embedded images; the file must be in the folder of the images.
    pub(crate) fn save_plain(&mut self, path: &Path) {
        let session = self.editor.session();
        let site = session.images.with_file_names(&session.solved.write_into(&session.site));
        self.act(match Here::write(path, site.to_json().as_bytes()) {
            Ok(()) => Action::Note(format!("Saved {} without its images.", path.display())),
            Err(error) => Action::SetError(error),
        });
    }

    /// Writes the exported files into a folder, or as downloads in the browser.
    pub(crate) fn write_export(&mut self, folder: &Path) {
        let Some(files) = self.dialogs.export.files() else { return };
        let written = files.iter().try_for_each(|file| Here::write(&folder.join(&file.name), &file.bytes));
        let count = counted(files.len(), "file", "files");
        match written {
            Ok(()) => {
                self.act(Action::Note(if folder.as_os_str().is_empty() {
                    format!("Downloaded {count}.")
                } else {
                    format!("Wrote {count} to {}.", folder.display())
                }));
                self.dialogs.export.close();
            }
            Err(error) => self.act(Action::SetError(error)),
        }
    }
}

impl App {
    /// Saves the site to its file; has no effect if the site has no file yet.
    pub fn save(&mut self) {
        if let Some(path) = self.editor.session().path.clone() {
            self.save_to(path);
        }
    }

    /// Saves the site to a file, which becomes the site's file. If the file must not be overwritten without
    /// asking, a dialog opens instead.
    pub(crate) fn save_to(&mut self, path: PathBuf) {
        match self.obstacle(&path) {
            Some(why) => self.dialogs.conflict = Some(Conflict { path, why }),
            None => self.write_to(path),
        }
    }

    /// Returns the reason why a file must not be written without asking; `None` if it can be written.
    fn obstacle(&self, path: &Path) -> Option<Why> {
        if !Here::HAS_FOLDERS {
            return None;
        }
        // An unreadable file counts as changed.
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

    /// Returns the changes of a file since it was read. If the earlier content is unknown, returns its
    /// differences from the open site.
    fn changes_of(&self, path: &Path) -> Vec<String> {
        let before = self.storage.as_held.as_ref().unwrap_or_else(|| self.editor.site());
        match files::open(path) {
            Ok((now, _)) => differences(before, &now),
            Err(error) => vec![error],
        }
    }

    /// Carries out the decision of the operator about a conflict on saving.
    pub(crate) fn decide_on_file(&mut self, decision: Decision) {
        let Some(Conflict { path, .. }) = self.dialogs.conflict.take() else { return };
        match decision {
            Decision::Reload => {
                self.open_path(&path);
            }
            Decision::SaveAs => self.open_dialog(Purpose::SaveSite),
            Decision::Overwrite => self.write_to(path),
            Decision::Leave => {}
        }
    }

    /// Renames the images in running work to their names relative to the new folder of the site.
    fn rebase_work(&mut self, folder: &Path) {
        let images = &self.editor.session().images;
        let compared = self.jobs.comparing.iter_mut().flat_map(Comparing::images_mut);
        let proposed = self.jobs.proposing.iter_mut().flat_map(Proposing::images_mut);
        for name in compared.chain(proposed) {
            *name = images.rebased_name(name, folder);
        }
        if let Some(automatic) = &mut self.jobs.automatic {
            automatic.rebase(images, folder);
        }
    }

    /// Writes the site file, and stores its hash and content to detect later changes of the file by other programs.
    fn write_to(&mut self, path: PathBuf) {
        let session = self.editor.session();
        let solved = session.solved.write_into(&session.site);
        match files::save(&path, &solved, &session.images) {
            Ok(held) => {
                self.remember_recent(&path, &solved);
                (self.storage.held, self.storage.as_held) = (Some(held), Some(solved));
            }
            Err(error) => {
                self.act(Action::SetError(error));
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
        self.storage.kept = self.editor.session().revision.generation;
    }
}
