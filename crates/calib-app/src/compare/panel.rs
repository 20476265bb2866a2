//! Comparison of a newer image of the current camera: its canvas (wipe or blink), and its panel. The panel
//! shows the measured change and starts the recovery.

use calib_editor::{Action, NewerAction, NewerImage, Pane};
use calib_image::CameraChange;
use egui::{Color32, CursorIcon, Painter, Rect, RichText, Role, Sense, Slider, TextEdit, Ui, WidgetInfo};

use crate::canvas::Mapping;
use crate::command::Command;
use crate::icons::{self, Icon};
use crate::keys;
use crate::overlay::right_of;
use crate::paint::{Pen, line};
use crate::platform::{Here, Platform as _};
use crate::state::{App, Glance, Mode, Place, Showing};
use crate::theme::{self, Palette, on_image};
use crate::widgets::{decimals, heading, number, section};

/// Display time of each image while blinking, in seconds.
const SECONDS_PER_IMAGE: f64 = 0.7;

/// Paints the newer image of the current camera over the old image. Returns the screen x from which the newer
/// image is visible; `None` without a newer image.
pub(crate) fn paint(
    app: &mut App,
    painter: &Painter,
    (camera, place): (usize, Place),
    mapping: &Mapping,
    [w, h]: [f64; 2],
) -> Option<f32> {
    let is_shown =
        place == Place::Main && app.view.mode == Mode::Image && camera == app.editor.session().camera;
    let name = app.editor.newer(camera).filter(|_| is_shown)?.image.clone();
    let split = split(app.view.glance, painter, mapping, w);
    let images = &app.editor.session().images;
    let picture = app.pictures.get(painter.ctx(), &name, || images.reader(&name))?;
    let right = painter.with_clip_rect(painter.clip_rect().intersect(right_of(split)));
    for piece in picture.pieces(painter.ctx()) {
        piece.paint(&right, mapping, Color32::WHITE);
    }
    if app.view.glance.showing == Showing::Wipe {
        let ends = [0.0, h].map(|v| mapping.screen([w * f64::from(app.view.glance.share), v]));
        line(painter, &ends.map(|end| egui::pos2(split, end.y)), Pen::new(on_image::WHITE, 1.5));
    }
    Some(split)
}

/// Lets the operator drag the wipe line while no gesture is active. `width` is the image width in pixels,
/// `split` the screen x of the line.
pub(crate) fn slide(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping, (width, split): (f64, f32)) {
    /// Largest distance from the wipe line at which a press drags the line, in points.
    const MAX_GRAB_DISTANCE: f32 = 6.0;
    let is_free =
        app.view.glance.showing == Showing::Wipe && app.editor.tool_row() == 0 && app.editor.tool().is_idle();
    let strip = Rect::everything_right_of(split - MAX_GRAB_DISTANCE)
        .with_max_x(split + MAX_GRAB_DISTANCE)
        .intersect(mapping.rect);
    let strip = Some(strip).filter(|strip| is_free && strip.is_positive());
    app.view.panes.wipe = strip.map(|strip| ((Place::Main, Pane::Image(camera)), strip));
    let Some(strip) = strip else { return };
    let response = ui.interact(strip, ui.scope_id().with("wipe"), Sense::drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, "Divider between the images"));
    if let Some(to) = response.interact_pointer_pos() {
        let [u, _] = mapping.document(to);
        app.view.glance.share = (u / width).clamp(0.0, 1.0) as f32;
    }
    if response.hovered() || response.dragged() {
        ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
    }
}

/// Returns the screen x of the left border of the visible newer image. It is +∞ if only the old image is visible, and
/// −∞ if only the newer image is visible.
fn split(glance: Glance, painter: &Painter, mapping: &Mapping, width: f64) -> f32 {
    match glance.showing {
        Showing::Wipe => mapping.screen([width * f64::from(glance.share), 0.0]).x,
        Showing::Old => f32::INFINITY,
        Showing::New => f32::NEG_INFINITY,
        // Reduced motion disables blinking.
        Showing::Blink if Here::wants_stillness() => f32::NEG_INFINITY,
        Showing::Blink => {
            let time = painter.ctx().input(|input| input.time);
            let left = SECONDS_PER_IMAGE - time.rem_euclid(SECONDS_PER_IMAGE);
            painter.ctx().request_repaint_after(std::time::Duration::from_secs_f64(left));
            if ((time / SECONDS_PER_IMAGE) as u64).is_multiple_of(2) {
                f32::NEG_INFINITY
            } else {
                f32::INFINITY
            }
        }
    }
}

/// Shows the comparison panel if the current camera has a newer image.
pub(crate) fn compare_ui(app: &mut App, ui: &mut Ui) {
    let Some(newer) = app.editor.selected_newer().filter(|_| app.view.mode == Mode::Image).cloned() else {
        return;
    };
    let is_held = app.is_recovering_in_hand();
    section(ui, |ui| {
        heading(ui, "Newer image", &newer.title);
        judgement(ui, &newer);
        glance(app, ui);
        since(app, ui, &newer);
        ui.horizontal_wrapped(|ui| {
            if newer.has_moved() {
                let tip = "Transfer the annotations to the newer image and calibrate the camera from them. \
                           The old calibration ends when the new one begins";
                if ui.button(keys::shown(ui.ctx(), "Recover   Shift+R")).on_hover_text(tip).clicked() {
                    app.send_command(Command::Recover);
                }
            }
            // The newer image must not change during the recovery.
            let waits = "The recovery uses this image. Cancel the recovery first.";
            let button = egui::Button::new("Discard");
            let tip = "Remove the newer image and keep the calibration";
            if ui.add_enabled(!is_held, button).on_hover_text(tip).on_disabled_hover_text(waits).clicked() {
                app.send_command(Command::DismissNewer);
            }
        });
    });
}

/// Returns the label, icon, text colour and background colour of a comparison result.
pub(crate) fn verdict(became: CameraChange, palette: &Palette) -> (&'static str, Icon, Color32, Color32) {
    match became {
        CameraChange::Unchanged => ("Unchanged", Icon::Check, palette.ok, palette.raised),
        CameraChange::Moved => ("Moved", Icon::Warn, palette.bad, palette.bad_bg),
        CameraChange::Windowed => ("Zoomed or cropped", Icon::Warn, palette.bad, palette.bad_bg),
        CameraChange::Shifted => ("Position changed", Icon::Warn, palette.bad, palette.bad_bg),
        CameraChange::DifferentView => ("Replaced or covered", Icon::Warn, palette.bad, palette.bad_bg),
        CameraChange::TooDark => ("Unclear: too dark", Icon::Warn, palette.warn, palette.warn_bg),
        CameraChange::Blind => ("Unclear: no edges", Icon::Warn, palette.warn, palette.warn_bg),
        CameraChange::TooFewEdges => ("Unclear: too few edges", Icon::Warn, palette.warn, palette.warn_bg),
    }
}

fn judgement(ui: &mut Ui, newer: &NewerImage) {
    let palette = theme::palette(ui.ctx());
    let (word, icon, colour, fill) = verdict(newer.comparison.change, palette);
    egui::Frame::NONE.fill(fill).corner_radius(4).inner_margin(8).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.horizontal_top(|ui| {
            icons::inline(ui, icon, colour);
            ui.vertical(|ui| {
                ui.label(RichText::new(word).font(theme::medium(12.0)));
                ui.label(RichText::new(sentence(newer.comparison.change)).color(palette.text2));
                for number in numbers(newer) {
                    ui.label(RichText::new(number).color(palette.text));
                }
            });
        });
    });
    ui.add_space(4.0);
}

fn sentence(became: CameraChange) -> String {
    let words = became.to_string();
    let mut letters = words.chars();
    let first = letters.next().map(|first| first.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

/// Formats an angle and its sigma, given in radians, as degrees with the digits that the sigma supports.
fn degrees(angle: f64, sigma: f64) -> [String; 2] {
    let decimals = decimals(sigma.to_degrees());
    [angle, sigma].map(|value| number(value.to_degrees(), decimals))
}

/// Returns text rows with the measured rotation and zoom, their sigmas, and the fraction of matched edge
/// points.
fn numbers(newer: &NewerImage) -> Vec<String> {
    let found = &newer.comparison;
    let again =
        format!("{:.0} % of {} edge points matched", 100.0 * found.found_fraction, found.visible_samples);
    if !found.change.is_aligned() {
        return vec![again];
    }
    let (zoom, zoom_sigma) = found.zoom();
    if let Some(window) = found.window {
        let [left, top, width, height] = window.px();
        let agreeing = format!("{:.0} % of the image matches", 100.0 * found.found_fraction);
        let part = format!("part of the old image: {width:.0} \u{d7} {height:.0} px at {left:.0}, {top:.0}");
        return vec![part, format!("zoom {zoom:.3}"), agreeing];
    }
    let (angle, angle_sigma) = found.angle(&newer.pose);
    let by_axis = found.movement(&newer.pose);
    let axis = |name: &str, index: usize| {
        let (value, sigma) = by_axis[index];
        let sign = if value < 0.0 { "\u{2212}" } else { "+" };
        let [size, sigma] = degrees(value.abs(), sigma);
        format!("{name} {sign}{size}\u{b0} \u{b1} {sigma}\u{b0}")
    };
    let [turned, turned_sigma] = degrees(angle, angle_sigma);
    let [zoom, zoom_sigma] = [zoom, zoom_sigma].map(|value| number(value, decimals(zoom_sigma)));
    vec![
        format!("rotated {turned}\u{b0} \u{b1} {turned_sigma}\u{b0}"),
        format!("zoom {zoom} \u{b1} {zoom_sigma}"),
        axis("yaw", 0),
        axis("pitch", 1),
        axis("roll", 2),
        format!("image shifted {:.2} px", found.shift),
        again,
    ]
}

/// Shows the choice of the display: wipe, blink, newer image or old image.
fn glance(app: &mut App, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for (showing, word) in Showing::ALL {
            ui.selectable_value(&mut app.view.glance.showing, showing, word);
        }
    });
    if app.view.glance.showing == Showing::Wipe {
        let palette = theme::palette(ui.ctx());
        ui.horizontal(|ui| {
            let label = ui.label(RichText::new("Old | new").color(palette.text2));
            let slider = Slider::new(&mut app.view.glance.share, 0.0..=1.0).show_value(false);
            ui.add(slider).labelled_by(label.id);
        });
    }
}

/// Shows the field for the time since which the camera has its new pose. The time is the start of the new
/// camera period.
fn since(app: &mut App, ui: &mut Ui, newer: &NewerImage) {
    if !newer.has_moved() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let mut text = newer.since.clone();
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Valid from").color(palette.text2));
        let field = TextEdit::singleline(&mut text).hint_text("2026-05-01T08:00:00Z");
        let field = field.desired_width(f32::INFINITY);
        let waits = "The recovery uses this time. Cancel the recovery first.";
        let is_free = !app.is_recovering_in_hand();
        ui.add_enabled(is_free, field).on_disabled_hover_text(waits).labelled_by(label.id);
    });
    if text != newer.since {
        app.send(Action::Newer(NewerAction::SetSince(text)));
    }
}
