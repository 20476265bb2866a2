//! What has to be decided first: over whose work a file is written, and where; which files are read.
//!
//! Things of a usual size, for who has measured nothing.

use calib_core::Annotation;
use calib_core::single::{Known, USUAL_SIZES, UsualSize};
use calib_editor::Units;
use calib_site::counted;
use egui::{Align2, Context, Key, RichText, TextEdit, Ui, Vec2, Window};

use crate::choice::Purpose;
use crate::state::{App, Conflict, Decision, PathField, Why};
use crate::theme;

/// What is chosen in the menu.
pub(crate) enum Chosen {
    Like(&'static UsualSize),
    /// The size that it has, as if it was measured.
    Measured(Known),
}

/// The menu of things that an annotation may be like.
pub(crate) fn menu(ui: &mut Ui, units: Units, annotation: &Annotation) -> Option<Chosen> {
    let palette = theme::palette(ui.ctx());
    let constraint = annotation.kind.row().constraint;
    let own = annotation.usual();
    let title = own.map_or("like\u{2026}".to_owned(), |usual| format!("like {}", size(units, usual)));
    let mut chosen = None;
    ui.menu_button(RichText::new(title).small().color(palette.text2), |ui| {
        for usual in USUAL_SIZES.iter().filter(|usual| usual.constraint == constraint) {
            let text = format!("{}: {}", usual.title, size(units, usual));
            if ui.selectable_label(own == Some(usual), text).on_hover_text(usual.source).clicked() {
                chosen = Some(Chosen::Like(usual));
                ui.close();
            }
        }
        if let Some(usual) = own
            && ui.button("Measured").clicked()
        {
            chosen = Some(Chosen::Measured(usual.size));
            ui.close();
        }
    })
    .response
    .on_hover_text("A thing whose size is known about");
    chosen
}

fn size(units: Units, usual: &UsualSize) -> String {
    units.small_and_sigma(usual.size.value, usual.size.sigma.unwrap_or(0.0))
}

/// The sheet that asks, if there is one.
pub(super) fn show(app: &mut App, ctx: &Context) {
    if let Some(conflict) = app.conflict.clone() {
        sheet("A file is not written", ctx, |ui| decide(app, ui, &conflict));
    }
    if let Some(field) = app.path_field.clone() {
        sheet("A path", ctx, |ui| path(app, ui, field));
    }
    if !app.outside.asked.is_empty() {
        sheet("Images elsewhere", ctx, |ui| outside(app, ui));
    }
}

fn sheet(title: &str, ctx: &Context, contents: impl FnOnce(&mut Ui)) {
    Window::new(title)
        .title_bar(false)
        .resizable(false)
        .anchor(Align2::CENTER_TOP, Vec2::new(0.0, 64.0))
        .default_width(420.0)
        .show(ctx, contents);
}

/// Which images the site names outside its folder, and whether they are read.
fn outside(app: &mut App, ui: &mut Ui) {
    const MOST: usize = 8;
    let palette = theme::palette(ui.ctx());
    let files: Vec<String> = app.outside.asked.iter().map(|file| file.display().to_string()).collect();
    ui.set_max_width(420.0);
    let path = app.editor.session().path.as_deref().and_then(std::path::Path::file_name);
    let site = path.map_or_else(|| "The site".into(), std::ffi::OsStr::to_string_lossy);
    let what = format!("{site} names {} outside its folder.", counted(files.len(), "image", "images"));
    ui.label(RichText::new(what).font(theme::medium(13.0)));
    for file in files.iter().take(MOST) {
        ui.label(file);
    }
    if files.len() > MOST {
        ui.label(format!("and {} more", files.len() - MOST));
    }
    let why =
        "Whoever made the site chose them, not you. What is read is shown here, and stands in a report.";
    ui.label(RichText::new(why).color(palette.text2));
    ui.horizontal(|ui| {
        for (text, allows) in [("Allow once for this site", true), ("Leave out", false)] {
            if ui.button(text).clicked() {
                app.decide_outside(allows);
            }
        }
    });
}

fn decide(app: &mut App, ui: &mut Ui, conflict: &Conflict) {
    let palette = theme::palette(ui.ctx());
    let name = conflict.path.display().to_string();
    ui.set_max_width(420.0);
    let (what, way_out) = match &conflict.why {
        Why::Changed(_) => (
            format!("{name} was changed since it was read here."),
            "Reload opens what the file holds; your work stays under \u{201c}Work that was not saved\u{201d}. \
             Overwrite puts yours in its place.",
        ),
        Why::ReadOnly => {
            (format!("{name} is read-only."), "Save under another name, or write it all the same.")
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
        ("Leave it", Decision::Leave),
    ];
    ui.horizontal(|ui| {
        for (text, decision) in reload.into_iter().chain(others) {
            if ui.button(text).clicked() {
                app.settle_conflict(decision);
            }
        }
    });
}

/// What somebody else did to the file.
fn changes(ui: &mut Ui, differences: &[String]) {
    const MOST: usize = 8;
    if differences.is_empty() {
        ui.label("It differs in results or in layout alone.");
    }
    for difference in differences.iter().take(MOST) {
        ui.label(format!("In the file, {difference}"));
    }
    if differences.len() > MOST {
        ui.label(format!("and {} more", differences.len() - MOST));
    }
}

fn path(app: &mut App, ui: &mut Ui, mut field: PathField) {
    let palette = theme::palette(ui.ctx());
    let what = match field.purpose {
        Purpose::OpenSite => "Path of the site to open",
        Purpose::SaveSite | Purpose::SavePlain => "Path to save the site to",
        Purpose::AddImages => "Path of an image, or of a folder of images",
        Purpose::LoadPlan => "Path of the floor plan",
        Purpose::ReplaceStill => "Path of the still",
        Purpose::NewerStill => "Path of the newer still",
        Purpose::Compare => "Path of the saved version",
        Purpose::Import => "Path of the file to import",
        Purpose::Export => "Path of the folder to export into",
        Purpose::SavePicture => "Path to save the picture to",
        Purpose::SaveReport => "Path to save the report to",
    };
    let label = ui.label(RichText::new(what).font(theme::medium(13.0)));
    let why = "This system has no file chooser: xdg-desktop-portal or zenity brings one.";
    ui.label(RichText::new(why).color(palette.text2));
    let typed = ui.add(TextEdit::singleline(&mut field.text).desired_width(400.0)).labelled_by(label.id);
    let is_entered = typed.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
    let mut decided = is_entered.then(|| Some(field.clone()));
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
        None if !typed.has_focus() && field.text.is_empty() => typed.request_focus(),
        None => {}
    }
    app.path_field = Some(field);
}
