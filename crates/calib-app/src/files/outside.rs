//! Decisions about files: images outside the site's folder, conflicts on saving, typed paths. No outside
//! image is read before the operator allows it.

use std::path::PathBuf;

use calib_editor::{Action, image_names};
use calib_site::counted;
use egui::{Align2, Context, Key, RichText, TextEdit, Ui, Vec2, Window};

use crate::choice::Purpose;
use crate::platform::{Here, Platform as _};
use crate::state::{App, Conflict, Decision, PathField, Why};
use crate::theme;

impl App {
    /// Asks about images outside the site's folder whenever the image names change.
    pub(crate) fn watch_outside(&mut self) {
        let names = image_names(self.editor.site());
        if names == self.dialogs.outside.names {
            return;
        }
        let images = &self.editor.session().images;
        let reach = images.allowed_files();
        let files = names.iter().filter_map(|name| images.file(name));
        let beyond =
            files.filter(|file| !reach.allows(file, Here::real)).filter_map(|file| Here::real(&file));
        self.dialogs.outside.asked =
            beyond.filter(|file| !self.dialogs.outside.left.contains(file)).collect();
        self.dialogs.outside.names = names;
    }

    /// Carries out the decision about images outside the site's folder: reads or skips them while the site is
    /// open.
    pub(crate) fn settle_outside(&mut self, allows: bool) {
        let asked = std::mem::take(&mut self.dialogs.outside.asked);
        if !allows {
            let note = "Images outside the site's folder were not read. To be asked again, use \
                        \u{201c}Reload images and detect edges again\u{201d}.";
            self.act(Action::Note(note.into()));
            self.dialogs.outside.left.extend(asked);
            return;
        }
        let images = &self.editor.session().images;
        let is_asked = |name: &String| images.file(name).and_then(|file| Here::real(&file));
        for name in &self.dialogs.outside.names {
            if is_asked(name).is_some_and(|file| asked.contains(&file)) {
                self.pictures.forget(name);
            }
        }
        self.editor.allow_images(asked);
    }

    /// Asks again about the skipped images outside the site's folder.
    pub(crate) fn ask_outside_again(&mut self) {
        self.dialogs.outside.left.clear();
        self.dialogs.outside.names.clear();
    }

    /// Allows reading a file that the operator chose, in any folder.
    pub(crate) fn allow_chosen(&mut self, file: &std::path::Path) {
        self.editor.allow_images(Here::real(file));
    }

    /// Allows the app to read the images of the site that are readable now, also after the site is saved to another
    /// folder.
    pub(crate) fn keep_reach(&mut self) {
        let session = self.editor.session();
        let reach = session.images.allowed_files();
        let files = image_names(&session.site).into_iter().filter_map(|name| session.images.file(&name));
        let read: Vec<PathBuf> = files
            .filter(|file| reach.allows(file, Here::real))
            .filter_map(|file| Here::real(&file))
            .collect();
        self.editor.allow_images(read);
    }
}

/// Shows the dialogs of pending decisions about files.
#[inline(never)]
pub(crate) fn asked_ui(app: &mut App, ctx: &Context) {
    if let Some(conflict) = app.dialogs.conflict.clone() {
        sheet("File not saved", ctx, |ui| conflict_ui(app, ui, &conflict));
    }
    if let Some(field) = app.dialogs.path_field.clone() {
        sheet("Enter a path", ctx, |ui| path_ui(app, ui, field));
    }
    if !app.dialogs.outside.asked.is_empty() {
        sheet("Images outside the site's folder", ctx, |ui| outside_ui(app, ui));
    }
}

/// Shows a sheet at the top of the window.
fn sheet(title: &str, ctx: &Context, contents: impl FnOnce(&mut Ui)) {
    Window::new(title)
        .title_bar(false)
        .resizable(false)
        .anchor(Align2::CENTER_TOP, Vec2::new(0.0, 64.0))
        .default_width(420.0)
        .show(ctx, contents);
}

/// Shows the images outside the site's folder, and asks whether to read them.
fn outside_ui(app: &mut App, ui: &mut Ui) {
    const MAX_LISTED: usize = 8;
    let palette = theme::palette(ui.ctx());
    let files: Vec<String> =
        app.dialogs.outside.asked.iter().map(|file| file.display().to_string()).collect();
    ui.set_max_width(420.0);
    let path = app.editor.session().path.as_deref().and_then(std::path::Path::file_name);
    let site = path.map_or_else(|| "The site".into(), std::ffi::OsStr::to_string_lossy);
    let what = format!("{site} refers to {} outside its folder.", counted(files.len(), "image", "images"));
    ui.label(RichText::new(what).font(theme::medium(13.0)));
    for file in files.iter().take(MAX_LISTED) {
        ui.label(file);
    }
    if files.len() > MAX_LISTED {
        ui.label(format!("and {} more", files.len() - MAX_LISTED));
    }
    let why = match files.len() {
        1 => {
            "The author of the site chose this file. If you choose Read now, it is shown here and included \
             in reports."
        }
        _ => {
            "The author of the site chose these files. If you choose Read now, they are shown here and \
             included in reports."
        }
    };
    ui.label(RichText::new(why).color(palette.text2));
    ui.horizontal(|ui| {
        for (text, allows) in [("Read now", true), ("Skip", false)] {
            if ui.button(text).clicked() {
                app.decide_outside(allows);
            }
        }
    });
}

/// Shows the conflict on saving a file, and the possible decisions.
fn conflict_ui(app: &mut App, ui: &mut Ui, conflict: &Conflict) {
    let palette = theme::palette(ui.ctx());
    let name = conflict.path.display().to_string();
    ui.set_max_width(420.0);
    let (what, way_out) = match &conflict.why {
        Why::Changed(_) => (
            format!("{name} has changed since you opened it."),
            "Reload opens the version in the file and keeps your unsaved work on the start page. \
             Overwrite replaces the file with your work.",
        ),
        Why::ReadOnly => {
            (format!("{name} is read-only."), "Save the site under another name, or overwrite the file.")
        }
    };
    ui.label(RichText::new(what).font(theme::medium(13.0)));
    if let Why::Changed(differences) = &conflict.why {
        changes(ui, differences);
    }
    ui.label(RichText::new(way_out).color(palette.text2));
    let reload = (matches!(conflict.why, Why::Changed(_))).then_some(("Reload", Decision::Reload));
    let others = [
        ("Save as\u{2026}", Decision::SaveAs),
        ("Overwrite", Decision::Overwrite),
        ("Cancel", Decision::Leave),
    ];
    ui.horizontal(|ui| {
        for (text, decision) in reload.into_iter().chain(others) {
            if ui.button(text).clicked() {
                app.settle_conflict(decision);
            }
        }
    });
}

/// Shows the changes that another program or person made to the file.
fn changes(ui: &mut Ui, differences: &[String]) {
    const MAX_LISTED: usize = 8;
    ui.label(match differences {
        [] => "Only the results or the formatting differ.",
        _ => "Changed in the file:",
    });
    for difference in differences.iter().take(MAX_LISTED) {
        ui.label(difference);
    }
    if differences.len() > MAX_LISTED {
        ui.label(format!("and {} more", differences.len() - MAX_LISTED));
    }
}

/// Shows the field for a typed path.
fn path_ui(app: &mut App, ui: &mut Ui, mut field: PathField) {
    let palette = theme::palette(ui.ctx());
    let what = match field.purpose {
        Purpose::Open => "Path of a site, image, plan, folder or calibration",
        Purpose::SaveSite | Purpose::SavePlain => "Path to save the site to",
        Purpose::AddImages => "Path of an image, or of a folder of images",
        Purpose::LoadPlan => "Path of the floor plan",
        Purpose::ReplaceStill => "Path of the image",
        Purpose::NewerStill => "Path of the newer image",
        Purpose::Compare => "Path of the saved version",
        Purpose::Import => "Path of the file to import",
        Purpose::Export => "Path of the folder to export into",
        Purpose::SavePicture => "Path to save the screenshot to",
        Purpose::SaveReport => "Path to save the report to",
    };
    let label = ui.label(RichText::new(what).font(theme::medium(13.0)));
    let why = "This system has no file chooser. Type a path, or install zenity.";
    ui.label(RichText::new(why).color(palette.text2));
    let typed = ui.add(TextEdit::singleline(&mut field.text).desired_width(400.0)).labelled_by(label.id);
    let is_entered = typed.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
    let is_left = typed.lost_focus() && ui.input(|input| input.key_pressed(Key::Escape));
    let mut decided = is_entered.then(|| Some(field.clone())).or_else(|| is_left.then_some(None));
    ui.horizontal(|ui| {
        if ui.button("OK").clicked() {
            decided = Some(Some(field.clone()));
        }
        if ui.button("Cancel").clicked() {
            decided = Some(None);
        }
    });
    match decided {
        Some(decision) => app.take_typed(decision),
        None if ui.memory(|memory| memory.focused().is_none()) => typed.request_focus(),
        None => {}
    }
    app.dialogs.path_field = Some(field);
}
