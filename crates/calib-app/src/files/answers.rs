//! Results of file choosers, dispatched by their purpose.

use std::path::PathBuf;

use calib_editor::{Action, parse};
use egui::Context;

use crate::choice::{Chosen, Purpose};
use crate::state::{App, PathField};

impl App {
    /// Handles the chosen files once the file chooser is closed.
    pub(crate) fn poll_dialog(&mut self, ctx: &Context) {
        let Some(dialog) = &mut self.dialogs.dialog else { return };
        let Some(chosen) = dialog.poll() else {
            ctx.request_repaint_after(std::time::Duration::from_millis(100));
            return;
        };
        let (purpose, is_just_opened) = (dialog.purpose, dialog.is_just_opened());
        self.dialogs.dialog = None;
        if chosen.is_empty() && is_just_opened {
            self.type_path(purpose);
            return;
        }
        self.take_chosen(ctx, purpose, chosen);
    }

    /// Shows a field for a typed path, because the system has no file chooser.
    pub fn type_path(&mut self, purpose: Purpose) {
        let own = self.editor.session().path.as_ref().map(|path| path.display().to_string());
        let text = own.filter(|_| matches!(purpose, Purpose::SaveSite | Purpose::Open)).unwrap_or_default();
        self.dialogs.path_field = Some(PathField { purpose, text });
    }

    /// Handles a typed path like a chosen file; `None` only closes the field.
    pub(crate) fn typed(&mut self, ctx: &Context, typed: Option<PathField>) {
        self.dialogs.path_field = None;
        let Some(PathField { purpose, text }) = typed.filter(|typed| !typed.text.trim().is_empty()) else {
            return;
        };
        let mut path = PathBuf::from(text.trim());
        if let (Some(ending), None) = (purpose.saved_ending(), path.extension()) {
            path.set_extension(ending);
            if path.exists() {
                let error = format!("{} already exists. Press Enter to replace it.", path.display());
                self.act(Action::SetError(error));
                self.dialogs.path_field = Some(PathField { purpose, text: path.display().to_string() });
                return;
            }
        }
        let chosen = vec![Chosen::of_path(path)];
        match purpose {
            // A typed path can be a folder of images.
            Purpose::AddImages => self.open_images(ctx, chosen),
            _ => self.take_chosen(ctx, purpose, chosen),
        }
    }

    /// Opens, imports or writes the chosen files, according to the purpose of the chooser.
    fn take_chosen(&mut self, ctx: &Context, purpose: Purpose, chosen: Vec<Chosen>) {
        match purpose {
            Purpose::Open => self.open_files(ctx, chosen),
            Purpose::SaveSite => each_path(chosen, |path| self.save_to(path)),
            Purpose::SavePlain => each_path(chosen, |path| self.save_plain(&path)),
            Purpose::AddImages => self.add_images(ctx, chosen),
            Purpose::LoadPlan => self.load_plan(ctx, chosen),
            Purpose::ReplaceStill => {
                chosen.into_iter().for_each(|file| self.jobs.replacing = Some(self.read_still(ctx, file)));
            }
            Purpose::NewerStill => self.add_newer(ctx, chosen),
            Purpose::Compare => chosen.into_iter().for_each(|file| self.compare_with(file)),
            Purpose::Import => self.import(chosen),
            Purpose::Export => each_path(chosen, |folder| self.write_export(&folder)),
            Purpose::SaveReport => each_path(chosen, |path| self.save_report(&path)),
            Purpose::SavePicture => {
                for file in chosen {
                    self.save_picture(&file.path.unwrap_or_else(|| PathBuf::from(&file.name)));
                }
            }
        }
    }

    /// Compares the open site with a saved version.
    fn compare_with(&mut self, file: Chosen) {
        let name = file.name.clone();
        self.act(match file.into_text().and_then(|text| parse(&text, None)) {
            Ok((site, _)) => Action::Compare(Some(Box::new(site))),
            Err(error) => Action::SetError(format!("{name}: {error}")),
        });
    }
}

/// Calls `act` with the path of every chosen file that has one.
fn each_path(chosen: Vec<Chosen>, act: impl FnMut(PathBuf)) {
    chosen.into_iter().filter_map(|file| file.path).for_each(act);
}
