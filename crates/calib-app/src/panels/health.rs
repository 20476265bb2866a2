//! Every camera with the age of its calibration and what its newest still shows.

use calib_editor::{Action, held_since};
use calib_site::SiteCamera;
use egui::{RichText, Ui};

use crate::autosave::ago;
use crate::panels::heading;
use crate::panels::newer::verdict;
use crate::state::{App, Mode};
use crate::theme;

/// The list.
pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let count = app.editor.site().cameras.len();
    let compared = (0..count).filter(|&camera| app.editor.newer(camera).is_some()).count();
    heading(ui, "Calibrations", &format!("{compared} of {count} compared"));
    for camera in 0..count {
        row(app, ui, camera);
    }
}

/// One camera; a click takes it in hand and looks at its image.
fn row(app: &mut App, ui: &mut Ui, camera: usize) {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.site().cameras.get(camera) else { return };
    let name = name(entry);
    let (word, colour) = match app.editor.newer(camera) {
        Some(newer) => {
            let (word, _, colour, _) = verdict(newer.comparison.became, palette);
            (word, colour)
        }
        None => ("no newer still", palette.text3),
    };
    let mut wanted = false;
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 8.0;
        wanted = ui.link(RichText::new(name).font(theme::medium(12.0))).clicked();
        ui.label(RichText::new(age(app, camera)).color(palette.text2));
        ui.label(RichText::new(word).color(colour));
    });
    if wanted {
        app.send(Action::Drop);
        app.send(Action::Choose(camera));
        app.mode = Mode::Image;
    }
}

/// Of a period that has ended with its end.
fn name(entry: &SiteCamera) -> String {
    match &entry.valid_to {
        Some(to) => format!("{} until {}", entry.id, to.get(..10).unwrap_or(to)),
        None => entry.id.clone(),
    }
}

/// How old the calibration is: since it holds, or since its still was taken.
fn age(app: &App, camera: usize) -> String {
    let known = held_since(app.editor.session(), camera);
    known.map_or_else(|| "of unknown age".into(), |since| format!("of {}", ago(since, (app.clock)())))
}
