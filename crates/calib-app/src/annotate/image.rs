//! Image canvas: the image of a camera and its overlay.

use std::cell::RefCell;

use calib_core::Pixel;
use calib_editor::{Icon, Pane, Part, ReplacedImage, TOOLS, hit};
use calib_image::Confidence;
use egui::{Color32, Painter, Rect, Ui};

use crate::canvas::Mapping;
use crate::overlay::{Overlay, ProposedLines};
use crate::picture::Piece;
use crate::state::{App, Mode, Place};
use crate::theme;

/// Paints an image, or the reason why the image is missing.
pub(crate) fn paint(app: &mut App, painter: &Painter, name: Option<&str>, mapping: &Mapping, rect: Rect) {
    let Some(name) = name else { return };
    let images = &app.editor.session().images;
    if let Some(picture) = app.pictures.get(painter.ctx(), name, || images.reader(name)) {
        picture.paint(painter, mapping, Color32::WHITE);
        return;
    }
    let (text, colour) = match app.pictures.error(name) {
        Some(error) => (error.to_owned(), theme::palette(painter.ctx()).bad),
        None => ("Loading the image\u{2026}".to_owned(), theme::palette(painter.ctx()).text3),
    };
    painter.text(rect.center(), egui::Align2::CENTER_CENTER, text, theme::regular(12.0), colour);
}

/// Paints the replaced image over the new image, with the opacity that the operator chose.
pub(crate) fn blend_old(
    app: &mut App,
    painter: &Painter,
    camera: usize,
    mapping: &Mapping,
    [w, h]: [f64; 2],
) {
    let Some(ReplacedImage { of, image: name, opacity: share, .. }) = app.editor.replaced_image().cloned()
    else {
        return;
    };
    let images = &app.editor.session().images;
    let picture = app.pictures.get(painter.ctx(), &name, || images.reader(&name));
    if let Some(picture) = picture
        .filter(|_| app.editor.session().site.cameras.get(camera).is_some_and(|entry| of.matches(entry)))
    {
        let whole = Piece { low: [0.0, 0.0], size: [w, h], texture: picture.overview.id() };
        whole.paint(painter, mapping, Color32::from_white_alpha((255.0 * share) as u8));
    }
}

/// Returns the automatic calibration of the current camera for its main canvas; `None` for all other
/// canvases.
fn ghosts(app: &App, camera: usize, place: Place) -> Option<ProposedLines<'_>> {
    let is_shown = place == Place::Main && camera == app.editor.session().camera;
    let proposed = app.shown_proposal().filter(|_| is_shown)?;
    // Two calibrations that explain the edges equally well are both shown, because their horizons distinguish them.
    let is_believed = proposed.confidence != Confidence::None || proposed.alternative.is_some();
    Some(ProposedLines { preview: app.editor.preview()?, is_believed, lit: app.hover.lit_group })
}

/// Creates the overlay of a camera's image for the canvas at `place`.
pub(crate) fn overlay<'a>(
    app: &'a App,
    ui: &Ui,
    camera: usize,
    mapping: Mapping,
    place: Place,
) -> Overlay<'a> {
    let cursor =
        app.view.panes.cursor.and_then(|(pane, at)| (pane == Pane::Image(camera)).then(|| Pixel::from(at)));
    let lit = app.hover.lit.filter(|_| camera == app.editor.session().camera).or_else(|| {
        let pose = app.editor.session().solved.pose(camera);
        let near = mapping.units(theme::HIT);
        let over = cursor.filter(|_| app.editor.tool_row() == 0 && app.editor.tool().is_idle());
        let hit = hit::pick(
            &app.editor.session().site,
            camera,
            pose,
            over?,
            near,
            &app.editor.session().selection,
        )?;
        match hit.part {
            Part::Line { annotation, segment } | Part::Vertex { annotation, segment, .. } => {
                Some((annotation, segment))
            }
            _ => None,
        }
    });
    Overlay {
        session: app.editor.session(),
        camera,
        mapping,
        layers: app.view.layers,
        cursor: cursor.filter(|_| app.editor.tool().is_idle()),
        lit,
        holding: !app.editor.tool().is_idle(),
        drawing: !app.editor.tool().is_idle()
            && TOOLS
                .get(app.editor.tool_row())
                .is_some_and(|row| !row.acts_on_plan() && row.icon != Icon::Link),
        time: ui.input(|i| i.time) - app.hover.suspect_since,
        family: app
            .editor
            .family()
            .filter(|(of, _)| *of == camera && place == Place::Main && app.editor.tool().is_idle())
            .map(|(_, family)| family)
            .filter(|family| {
                app.editor.session().site.cameras.get(camera).is_some_and(|now| family.is_current(now))
            }),
        begun: app.editor.tool().open_link(app.editor.session()),
        suggested: Vec::new(),
        proposed: ghosts(app, camera, place),
        changed: None,
        names_elements: app.view.mode == Mode::All,
        named: RefCell::default(),
        labels: place != Place::Tile || mapping.rect.width() > 300.0,
        lines: place != Place::Tile || app.editor.tool_kind().is_some(),
    }
}
