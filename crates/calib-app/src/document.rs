//! What is done with the document as a whole: opened, recovered, saved.

use std::path::{Path, PathBuf};

use calib_editor::{Action, Images, Opened};
use calib_site::{Site, counted};

use crate::autosave::{Autosave, Found};
use crate::files;
use crate::platform::{Here, Platform as _};
use crate::recent::{self, Recent};
use crate::shelf::{News, Work};
use crate::state::{App, Outside, Panes, Sheet, Tour};

impl App {
    /// Opens a site in place of the one that is open.
    pub fn open_site(&mut self, site: Site, images: Images, path: Option<PathBuf>) {
        self.open(Opened { site, images, path, is_unsaved: false });
    }

    fn open(&mut self, opened: Opened) {
        self.put_aside();
        (self.held, self.as_held, self.conflict) = (None, None, None);
        self.kept = u64::from(opened.is_unsaved);
        self.act(Action::Open(Box::new(opened)));
        if let Some(shelf) = &mut self.shelf {
            shelf.begin();
        }
        self.pictures.clear();
        self.edges.clear();
        self.panes = Panes::default();
        self.orbit = None;
        // Nothing that was asked for the old site lands in the new one.
        self.adding.clear();
        (self.replacing, self.planning, self.refining, self.dialog) = (None, None, None, None);
        self.stop_comparing();
        (self.picture, self.pictured) = (None, None);
        (self.export, self.tour) = (Sheet::default(), Tour::default());
        self.outside = Outside::default();
        self.compares_views = false;
    }

    /// Opens a site file; what is wrong with it is shown.
    pub fn open_path(&mut self, path: &Path) {
        match files::open_stamped(path) {
            Ok((site, images, held)) => {
                let as_held = site.clone();
                self.open_site(site, images, Some(path.to_path_buf()));
                self.remember_recent(path, &as_held);
                (self.held, self.as_held) = (Some(held), Some(as_held));
            }
            Err(error) => self.act(Action::Fail(error)),
        }
    }

    /// Remembers a site for the start page.
    pub(crate) fn remember_recent(&mut self, path: &Path, site: &Site) {
        if let Some((folder, now)) = self.folder.as_deref().zip(Here::now()) {
            self.recent = recent::remember(folder, Recent::of(path, site, now));
        }
    }

    /// Goes on with what a crashed session left.
    pub fn recover(&mut self, index: usize) {
        if index >= self.found.len() {
            return;
        }
        let (slot, Found { site, images, path, held, .. }) = self.found.remove(index);
        // It differs from its file, and is kept already.
        self.open(Opened { site, images, path, is_unsaved: true });
        (self.autosave, self.held) = (Some(slot), held);
    }

    /// Leaves the work on the open site where it is kept, to be gone on with, and keeps the next elsewhere.
    fn put_aside(&mut self) {
        let Some(slot) = self.autosave.clone() else { return };
        let session = self.editor.session();
        if session.is_saved() {
            slot.forget();
            return;
        }
        let (images, path) = (session.images.clone(), session.path.clone());
        let held = self.held;
        self.found.push((slot, Found { site: session.kept(), images, path, held, at: Here::now() }));
        self.autosave = None;
        for slot in self.folder.iter().flat_map(|folder| Autosave::slots(folder)) {
            let is_taken = self.found.iter().any(|(found, _)| found.folder() == slot.folder());
            let own = self.claims.iter().any(|(folder, _)| folder == slot.folder());
            let claim = if own { None } else { Here::claim(slot.folder()) };
            if is_taken || !(own || claim.is_some()) || slot.find().is_some() {
                continue;
            }
            self.claims.extend(claim.map(|claim| (slot.folder().to_path_buf(), claim)));
            slot.forget();
            self.autosave = Some(slot);
            return;
        }
    }

    /// Forgets what a crashed session left.
    pub fn discard_found(&mut self, index: usize) {
        if index < self.found.len() {
            self.found.remove(index).0.forget();
        }
    }

    /// What the shelf has to tell.
    pub(crate) fn poll_shelf(&mut self) {
        while let Some(news) = self.shelf.as_mut().and_then(|shelf| shelf.news()) {
            match news {
                News::Opened(found) => {
                    // It stays the shelf's: what follows is kept in its place.
                    let shelf = self.shelf.take();
                    let Found { site, images, path, .. } = *found;
                    self.open(Opened { site, images, path, is_unsaved: true });
                    self.shelf = shelf;
                }
                News::Trouble(error) => self.act(Action::Fail(error)),
                News::Note(note) => self.act(Action::Note(note)),
                News::Again => self.kept = u64::MAX,
            }
        }
    }

    /// Keeps every finished gesture where a crash does not reach it.
    pub(crate) fn remember(&mut self) {
        let generation = self.editor.session().generation;
        // What was kept before its still was decoded is kept again with its picture.
        let is_due = self.shelf.is_some() && self.thumbnail.is_due(&self.pictures);
        if self.kept == generation && !is_due {
            return;
        }
        self.kept = generation;
        if self.autosave.is_none() && self.folder.is_some() && generation == 1 {
            let note = "Not kept against a crash: nine unsaved sites wait already. Save it as a file.";
            self.act(Action::Note(note.into()));
        }
        let session = self.editor.session();
        // Undo to what is saved leaves nothing to lose, but the file tells no tale of it: keep it all the same.
        let site = session.kept();
        if self.shelf.is_some() {
            self.thumbnail.renew(&site, &self.pictures);
        }
        let session = self.editor.session();
        if let Some(shelf) = &mut self.shelf {
            let thumbnail = self.thumbnail.of(&site);
            let last = session.history.undo_name().unwrap_or_default();
            shelf.keep(Work {
                site: &site,
                images: &session.images,
                path: session.path.clone(),
                last,
                thumbnail,
            });
        }
        let Some(autosave) = &self.autosave else { return };
        if let Err(error) = autosave.keep(&site, &session.images, session.path.as_deref(), self.held) {
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
        let Some(files) = self.export.files() else { return };
        let written = files.iter().try_for_each(|file| Here::write(&folder.join(&file.name), &file.bytes));
        let count = counted(files.len(), "file", "files");
        match written {
            Ok(()) => {
                self.act(Action::Note(if folder.as_os_str().is_empty() {
                    format!("Handed over as downloads: {count}.")
                } else {
                    format!("Wrote {count} to {}.", folder.display())
                }));
                self.export.close();
            }
            Err(error) => self.act(Action::Fail(error)),
        }
    }
}
