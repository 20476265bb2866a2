//! What is done with the document as a whole: recovered, saved; cameras renamed, removed, given lenses.

use std::path::{Path, PathBuf};

use calib_core::{Annotation, LensEntry};

use crate::app::App;
use crate::claim::Claim;
use crate::files::{self, Autosave, Found};
use crate::shelf::News;

/// What a browser saves is a download, and lies beside nothing.
const HAS_FOLDERS: bool = cfg!(not(target_arch = "wasm32"));

/// The autosaves of a folder, as one window finds them.
#[derive(Debug, Default)]
pub(crate) struct Slots {
    /// What crashed sessions left.
    pub(crate) found: Vec<(Autosave, Found)>,
    /// Where this one keeps its own.
    pub(crate) autosave: Option<Autosave>,
    pub(crate) claims: Vec<(PathBuf, Claim)>,
}

impl Slots {
    pub(crate) fn of(folder: Option<&Path>) -> Self {
        let mut slots = Self::default();
        for slot in folder.into_iter().flat_map(Autosave::slots) {
            // What another window keeps is its own; what was found stays until the operator has decided.
            let Some(claim) = Claim::of(slot.folder()) else { continue };
            let folder = slot.folder().to_path_buf();
            match slot.find() {
                Some(work) => slots.found.push((slot, work)),
                None if slots.autosave.is_none() => slots.autosave = Some(slot),
                None => continue,
            }
            slots.claims.push((folder, claim));
        }
        slots
    }
}

impl App {
    /// Goes on with what a crashed session left.
    pub fn recover(&mut self, index: usize) {
        if index >= self.found.len() {
            return;
        }
        let (slot, found) = self.found.remove(index);
        self.open_site(found.site, found.images, found.path);
        self.autosave = Some(slot);
        // It differs from its file, and is kept already.
        (self.session.generation, self.kept) = (1, 1);
    }

    /// Leaves the work on the open site where it is kept, to be gone on with, and keeps the next elsewhere.
    pub(crate) fn put_aside(&mut self) {
        let Some(slot) = self.autosave.clone() else { return };
        if self.session.is_saved() {
            slot.forget();
            return;
        }
        let (images, path) = (self.session.images.clone(), self.session.path.clone());
        self.found.push((slot, Found { site: self.session.history.site(), images, path }));
        self.autosave = None;
        for slot in self.folder.iter().flat_map(|folder| Autosave::slots(folder)) {
            let is_taken = self.found.iter().any(|(found, _)| found.folder() == slot.folder());
            let own = self.claims.iter().any(|(folder, _)| folder == slot.folder());
            let claim = if own { None } else { Claim::of(slot.folder()) };
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
                    self.open_site(found.site, found.images, found.path);
                    self.shelf = shelf;
                    (self.session.generation, self.kept) = (1, 1);
                }
                News::Trouble(error) => self.error = Some(error),
                News::Note(note) => self.session.note = Some(note),
                News::Again => self.kept = u64::MAX,
            }
        }
    }

    /// Saves the site without its images: a file to lie beside them.
    pub(crate) fn save_plain(&mut self, path: &Path) {
        let solved = self.session.solved.write_into(&self.session.site);
        let site = self.session.images.name_into(&solved);
        match files::write(path, site.to_json().as_bytes()) {
            Ok(()) => self.session.note = Some(format!("Saved {} without its images.", path.display())),
            Err(error) => self.error = Some(error),
        }
    }

    /// Saves to the site's own file.
    pub fn save(&mut self) {
        let Some(path) = self.session.path.clone() else { return };
        let solved = self.session.solved.write_into(&self.session.site);
        match files::save(&path, &solved, &self.session.images) {
            Ok(()) => {
                // From now on images are looked for beside the file.
                let folder = path.parent().filter(|_| HAS_FOLDERS).map(Path::to_path_buf);
                if let Some(folder) = folder.filter(|f| self.session.images.folder.as_ref() != Some(f)) {
                    self.session.rebase(&folder);
                    self.pictures.clear();
                }
                self.session.saved = self.session.generation;
                self.session.note = Some(format!("Saved {}.", path.display()));
                if let Some(autosave) = &self.autosave {
                    autosave.forget();
                }
                self.kept = self.session.generation;
            }
            Err(error) => self.error = Some(error),
        }
    }

    /// Changes what is known of the lens of the camera in hand.
    pub fn with_lens(&mut self, name: &str, change: impl FnOnce(&mut LensEntry)) {
        let empty = LensEntry::default();
        if let Some(entry) = self.session.entry_mut() {
            change(entry.lens.get_or_insert_with(|| empty.clone()));
            entry.lens.take_if(|lens| *lens == empty);
            self.session.commit(name);
        }
    }

    /// Adds the copied annotations to the camera in hand, scaled to its image.
    pub fn paste_lines(&mut self) {
        let Some((copied, from)) = self.copied.clone() else { return };
        let Some(entry) = self.session.entry_mut() else { return };
        let ratio = [0, 1].map(|axis| f64::from(entry.size_px[axis]) / f64::from(from[axis].max(1)));
        let id = entry.id.clone();
        let taken: Vec<String> = entry.annotations.iter().filter_map(|known| known.id.clone()).collect();
        for mut annotation in copied {
            scale(&mut annotation, ratio);
            annotation.id.take_if(|id| taken.contains(id));
            // What it was tied to has lost its id, or is another's by now.
            annotation.at_right_angles_to.take_if(|id| taken.contains(id));
            entry.annotations.push(annotation);
        }
        self.session.commit(format!("paste annotations onto {id}"));
    }

    /// Gives the camera in hand another id, everywhere.
    pub fn rename_camera(&mut self, id: &str) {
        let session = &mut self.session;
        if id.is_empty() || session.site.cameras.iter().any(|camera| camera.id == id) {
            session.note = Some("Every camera needs an id of its own.".into());
            return;
        }
        let Some(entry) = session.entry_mut() else { return };
        let old = std::mem::replace(&mut entry.id, id.to_owned());
        let links =
            session.site.links.iter_mut().flat_map(|link| &mut link.seen).map(|seen| &mut seen.camera);
        let marks =
            session.site.marks.iter_mut().flat_map(|mark| &mut mark.seen).map(|seen| &mut seen.camera);
        let like = session.site.cameras.iter_mut().filter_map(|camera| camera.lens.as_mut()?.like.as_mut());
        for name in links.chain(marks).chain(like).filter(|name| **name == old) {
            id.clone_into(name);
        }
        session.commit(format!("rename {old}"));
        if let Some(still) = self.old_still.as_mut().filter(|still| still.camera == old) {
            id.clone_into(&mut still.camera);
        }
    }

    /// Removes the camera in hand and what refers to it.
    pub fn remove_camera(&mut self) {
        let session = &mut self.session;
        if session.camera >= session.site.cameras.len() {
            return;
        }
        let id = session.site.cameras.remove(session.camera).id;
        for link in &mut session.site.links {
            link.seen.retain(|seen| seen.camera != id);
        }
        session.site.links.retain(|link| !link.seen.is_empty());
        for mark in &mut session.site.marks {
            mark.seen.retain(|seen| seen.camera != id);
        }
        for camera in &mut session.site.cameras {
            if let Some(lens) = &mut camera.lens {
                lens.like.take_if(|like| *like == id);
            }
        }
        crate::edit::keep_distances(&mut session.site);
        session.selection.clear();
        session.camera = session.camera.min(session.site.cameras.len().saturating_sub(1));
        if self.old_still.as_ref().is_some_and(|old| old.camera == id) {
            self.old_still = None;
        }
        self.session.commit(format!("remove {id}"));
    }
}

/// Moves the points of an annotation to an image of another size.
pub(crate) fn scale(annotation: &mut Annotation, ratio: [f64; 2]) {
    let segments = annotation.segments.iter_mut().flatten().flatten();
    let points = annotation.points.iter_mut().flatten();
    for pixel in segments.chain(points).chain(&mut annotation.foot).chain(&mut annotation.head) {
        (pixel.u, pixel.v) = (pixel.u * ratio[0], pixel.v * ratio[1]);
    }
}
