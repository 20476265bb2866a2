//! Images that the site names outside its folder: nothing is read of them before the operator says so.

use std::path::PathBuf;

use calib_editor::{Action, image_names};

use crate::platform::{Here, Platform as _};
use crate::state::App;

impl App {
    /// Asks about images outside the folder of the site, whenever the site names others than before.
    pub(crate) fn watch_outside(&mut self) {
        let names = image_names(self.editor.site());
        if names == self.outside.names {
            return;
        }
        let images = &self.editor.session().images;
        let reach = images.reach();
        let files = names.iter().filter_map(|name| images.file(name));
        let beyond = files.filter(|file| !reach.holds(file, Here::real)).filter_map(|file| Here::real(&file));
        self.outside.asked = beyond.filter(|file| !self.outside.left.contains(file)).collect();
        self.outside.names = names;
    }

    /// Reads the images outside the folder, for as long as this site is open, or leaves them out.
    pub(crate) fn settle_outside(&mut self, allows: bool) {
        let asked = std::mem::take(&mut self.outside.asked);
        if !allows {
            let note = "Left out: the site keeps the names of its images. \u{201c}Read images again\u{201d} asks again.";
            self.act(Action::Note(note.into()));
            self.outside.left.extend(asked);
            return;
        }
        let images = &self.editor.session().images;
        let is_asked = |name: &String| images.file(name).and_then(|file| Here::real(&file));
        for name in &self.outside.names {
            if is_asked(name).is_some_and(|file| asked.contains(&file)) {
                self.pictures.forget(name);
            }
        }
        self.editor.allow_images(asked);
    }

    /// Asks again about what was left out.
    pub(crate) fn ask_outside_again(&mut self) {
        self.outside.left.clear();
        self.outside.names.clear();
    }

    /// A file that the operator chose is read wherever it is.
    pub(crate) fn allow_chosen(&mut self, file: &std::path::Path) {
        self.editor.allow_images(Here::real(file));
    }

    /// What is read beside one folder is read on when the site has another.
    pub(crate) fn keep_reach(&mut self) {
        let session = self.editor.session();
        let reach = session.images.reach();
        let files = image_names(&session.site).into_iter().filter_map(|name| session.images.file(&name));
        let read: Vec<PathBuf> =
            files.filter(|file| reach.holds(file, Here::real)).filter_map(|file| Here::real(&file)).collect();
        self.editor.allow_images(read);
    }
}
