//! The site's own file: it is written only while it is what was read, or when the operator says so.

use std::path::{Path, PathBuf};

use calib_editor::{Action, differences};

use crate::choice::Purpose;
use crate::files;
use crate::platform::{Here, Platform as _};
use crate::propose::Proposing;
use crate::state::{App, Comparing, Conflict, Decision, Why};

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
            Some(why) => self.conflict = Some(Conflict { path, why }),
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
            Some(now) if is_own && self.held != Some(now) => Some(Why::Changed(self.changes_of(path))),
            Some(_) if Here::is_read_only(path) => Some(Why::ReadOnly),
            _ => None,
        }
    }

    /// What a file has that was otherwise when it was read; where that is not known, against the open site.
    fn changes_of(&self, path: &Path) -> Vec<String> {
        let before = self.as_held.as_ref().unwrap_or_else(|| self.editor.site());
        match files::open(path) {
            Ok((now, _)) => differences(before, &now),
            Err(error) => vec![error],
        }
    }

    /// Does what the operator decided about a file that was not written.
    pub(crate) fn decide_on_file(&mut self, decision: Decision) {
        let Some(Conflict { path, .. }) = self.conflict.take() else { return };
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
        let compared = self.comparing.iter_mut().flat_map(Comparing::images_mut);
        let proposed = self.proposing.iter_mut().flat_map(Proposing::images_mut);
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
                (self.held, self.as_held) = (Some(held), Some(solved));
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
        if let Some(autosave) = &self.autosave {
            autosave.forget();
        }
        self.kept = self.editor.session().generation;
    }
}
