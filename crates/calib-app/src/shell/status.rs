//! Status line (next click, pointer position, duration of the solve) and the strip of tools.

use calib_core::camera::FloorCovariance;
use calib_core::floor::SurfacePoint;
use calib_core::{Pixel, SurfaceProjector, WorldPoint};
use calib_editor::{Action, Pane, TOOLS, plan_scale};
use calib_image::Confidence;
use calib_site::{Stage, counted};
use egui::scroll_area::ScrollBarVisibility;
use egui::{Align, Align2, Layout, RichText, Ui, Vec2};

use crate::crosshair::Crosshair;
use crate::icons::{self, Icon, Look};
use crate::keys;
use crate::shell::announce::result_region;
use crate::state::App;
use crate::theme;
use crate::widgets::{announce, decimals, number};

/// Shows the status line.
pub(crate) fn status_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let mut stop = false;
    ui.horizontal_centered(|ui| {
        let hint = match &app.editor.session().note {
            Some(note) if app.editor.tool().is_idle() && is_fresh(ui, note) => note.clone(),
            _ if app.editor.session().site.cameras.is_empty() => {
                "Open the demonstration, open a site, or drop images here.".into()
            }
            _ if app.view.layers.hidden && app.editor.tool().is_idle() => {
                "The overlays are hidden. Press H to show them.".into()
            }
            _ => proposal_hint(app, ui).unwrap_or_else(|| app.editor.tool().hint(app.editor.session())),
        };
        let hint = match Crosshair::with(ui.ctx(), |crosshair| crosshair.at) {
            Some(_) => format!("{hint}  Arrow keys move the crosshair (Shift: faster). Enter clicks."),
            None => hint,
        };
        let hint = keys::shown_hint(ui.ctx(), &hint).to_owned();
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let is_narrow = ui.ctx().content_rect().width() < crate::widgets::NARROW;
            state(app, ui, &mut stop);
            // A narrow window shows only the hint for the next click.
            if !is_narrow {
                pointer_position(app, ui);
            }
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let label = egui::Label::new(RichText::new(hint).color(palette.text)).truncate();
                announce(&ui.add(label), false);
            });
        });
    });
    result_region(app, ui);
    if stop {
        app.stop_work();
    }
}

/// Returns the hint for the selected detected line, or for accepting or discarding the automatic calibration.
fn proposal_hint(app: &App, ui: &Ui) -> Option<String> {
    let proposed =
        app.shown_proposal().filter(|_| app.editor.tool_row() == 0 && app.editor.tool().is_idle())?;
    let picked = app.editor.session().picked_line().and_then(|(group, _)| proposed.groups.get(group));
    Some(match picked {
        Some(group) => {
            let title = group.title();
            format!("A line of the group \u{201c}{title}\u{201d} is selected. Press Delete to remove it.")
        }
        None if proposed.confidence == Confidence::None && proposed.alternative.is_some() => {
            "Two solutions fit the edges equally well. Click the correct one, or press Esc to discard both."
                .into()
        }
        None if proposed.confidence == Confidence::None => "Press Esc to discard the detected lines.".into(),
        None => {
            let lines = counted(proposed.count(), "line", "lines");
            if !keys::are_shown(ui.ctx()) {
                return Some(format!("{lines} detected. Accept or discard them in the panel."));
            }
            format!(
                "{lines} detected. Press Enter to accept all, Esc to discard all, or click one to select it."
            )
        }
    })
}

/// Whether a note is recent enough to replace the hint for the next click.
fn is_fresh(ui: &Ui, note: &str) -> bool {
    /// Duration for which a note is shown, in seconds.
    const NOTE_DURATION_S: f64 = 10.0;
    let (id, now) = (ui.scope_id().with("note"), ui.input(|input| input.time));
    let known: Option<(String, f64)> = ui.data(|data| data.get_temp(id));
    let since = known.filter(|(text, _)| text == note).map_or(now, |(_, since)| since);
    ui.data_mut(|data| data.insert_temp(id, (note.to_owned(), since)));
    let left = NOTE_DURATION_S - (now - since);
    if left > 0.0 {
        ui.ctx().request_repaint_after(std::time::Duration::from_secs_f64(left));
    }
    left > 0.0
}

fn state(app: &App, ui: &mut Ui, stop: &mut bool) {
    let palette = theme::palette(ui.ctx());
    let loading = app.pictures.loading();
    if app.is_working() {
        let look = Look { size: Vec2::splat(18.0), ..Look::default() };
        if icons::button(ui, Icon::Close, "Cancel the running task", "Cancel", look).clicked() {
            *stop = true;
        }
    }
    if let Some(refining) = &app.jobs.refining {
        ui.spinner();
        let text = format!("refining {}", counted(refining.from.cameras.len(), "camera", "cameras"));
        ui.label(RichText::new(text).color(palette.text2));
    }
    if let Some(proposing) = &app.jobs.proposing {
        ui.spinner();
        ui.label(RichText::new(proposing.doing()).color(palette.text2));
    }
    if let Some(automatic) = &app.jobs.automatic {
        ui.spinner();
        ui.label(RichText::new(automatic.doing()).color(palette.text2));
    }
    if let Some(doing) = app.doing_newer() {
        ui.spinner();
        ui.label(RichText::new(doing).color(palette.text2));
    }
    let waiting = app.waiting();
    if waiting > 0 {
        ui.spinner();
        let text = format!("{} waiting", counted(waiting, "file", "files"));
        ui.label(RichText::new(text).color(palette.text2));
    }
    if loading > 0 {
        ui.spinner();
        ui.label(
            RichText::new(format!("reading {}", counted(loading, "image", "images"))).color(palette.text2),
        );
    }
    if app.edges.pending() > 0 {
        ui.spinner();
        ui.label(RichText::new("detecting edges").color(palette.text2));
    }
    let solved = &app.editor.session().solved;
    if solved.paused {
        ui.label(RichText::new("Solving is paused").color(palette.warn));
        return;
    }
    match solved.result(app.editor.session().camera) {
        Some(Ok(_)) => {
            let text = format!("Solved in {:.1} ms", solved.milliseconds);
            ui.label(RichText::new(text).color(palette.ok));
            icons::inline(ui, Icon::Check, palette.ok);
        }
        Some(Err(_)) => {
            ui.label(RichText::new("Not solved yet").color(palette.warn));
        }
        None => {}
    }
}

/// Shows the position of the pointer on the image, the floor or the plan.
fn pointer_position(app: &App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some((pane, at)) = app.view.panes.cursor else { return };
    let strong = |text: String| RichText::new(text).font(theme::medium(12.0)).color(palette.text);
    match pane {
        Pane::Image(camera) => {
            let Some(entry) = app.editor.session().site.cameras.get(camera) else { return };
            let pose = app.editor.session().solved.pose(camera);
            if let Some(pose) = pose {
                floor(app, ui, (camera, pose), at.into());
                ui.add_space(12.0);
            }
            ui.label(strong(format!("{}, {}", number(at[0], 1), number(at[1], 1))));
            ui.label(RichText::new(format!("{} px", entry.id)).color(palette.text2));
        }
        Pane::Plan => {
            let seen = (0..app.editor.session().site.cameras.len())
                .filter(|&i| {
                    let field = app.editor.session().solved.solution(i).map(|solution| &solution.efov_m);
                    let holds = !app.editor.site().is_superseded(i);
                    holds && field.is_some_and(|field| calib_editor::is_inside(field, at))
                })
                .map(|i| app.editor.session().site.cameras[i].id.as_str());
            let seen: Vec<&str> = seen.collect();
            let coverage = app.coverage.as_ref().filter(|_| app.view.coverage);
            if let Some(text) = coverage.and_then(|coverage| coverage.at(at)) {
                ui.label(RichText::new(text).color(palette.text2));
                ui.add_space(12.0);
            } else if !seen.is_empty() {
                ui.label(RichText::new(format!("seen by {}", seen.join(", "))).color(palette.text2));
                ui.add_space(12.0);
            }
            if app.editor.session().site.plan.is_some() {
                let px = plan_scale(&app.editor.session().site).plan_from_floor(at.into());
                ui.label(RichText::new(format!("plan px {:.0}, {:.0}", px.x, px.y)).color(palette.text3));
                ui.add_space(12.0);
            }
            ui.label(strong(app.editor.session().site.units.point(at, 2)));
            ui.label(RichText::new("floor").color(palette.text2));
            // A point of the plan is exact.
            map_position(app, ui, WorldPoint::new(at[0], at[1], 0.0), Some([[0.0; 2]; 2]));
        }
    }
}

/// Shows the floor point at a pixel of a camera, with its standard deviation. While the scale is unknown, the unit
/// is the height of the camera.
fn floor(app: &App, ui: &mut Ui, (camera, pose): (usize, &calib_core::Camera), at: Pixel) {
    let palette = theme::palette(ui.ctx());
    let session = app.editor.session();
    let surfaces = session.solved.surfaces(&session.site);
    let Some(SurfacePoint { surface, at: point }) = pose.pixel_to_surface(at, 0.0, &surfaces) else {
        let is_wall = pose.pixel_to_floor(at, 0.0).is_some();
        let place = if is_wall { "on the wall of a pit" } else { "above the horizon" };
        ui.label(RichText::new(format!("no position: {place}")).color(palette.text2));
        return;
    };
    let covariance = SurfaceProjector::new(pose, 0.0, &surfaces).covariance(at, 1.0, surface);
    let sigma = covariance.and_then(|covariance| covariance.worst_sigma());
    let (units, is_scaled) = (session.site.units, session.solved.scale_is_known(camera));
    let unit = if is_scaled { units.metres() } else { pose.position.z.abs().max(1e-6) };
    let symbol = if is_scaled { units.symbol() } else { "\u{d7} camera height" };
    let shown = sigma.map_or(2, |sigma| decimals(sigma / unit).min(3));
    if let Some(sigma) = sigma {
        let text = format!("\u{b1} {}", number(sigma / unit, shown));
        ui.label(RichText::new(text).color(palette.text2));
    }
    if app.view.coverage
        && is_scaled
        && let Some(density) = pose.pixel_density(point)
    {
        ui.label(RichText::new(format!("{density:.0} px/m")).color(palette.text2));
        ui.add_space(12.0);
    }
    let strong = |text: String| RichText::new(text).font(theme::medium(12.0)).color(palette.text);
    let [x, y] = <[f64; 2]>::from(point.on_floor()).map(|value| number(value / unit, shown));
    ui.label(strong(format!("{x}, {y} {symbol}")));
    let plane = surface.and_then(|index| session.site.planes.get(index));
    ui.label(RichText::new(plane.map_or("floor", |plane| &plane.id)).color(palette.text2));
    let is_on_plan = session.solved.solution(camera).is_some_and(|solution| solution.stage > Stage::Partial);
    if is_scaled && is_on_plan {
        map_position(app, ui, point, covariance.and_then(|covariance| covariance.total()));
    }
}

/// Shows the latitude and longitude of a point of the site with their standard deviation, if the site has a
/// georeference. `on_floor` is the covariance of the point, in square metres.
fn map_position(app: &App, ui: &mut Ui, point: WorldPoint, on_floor: Option<[[f64; 2]; 2]>) {
    let session = app.editor.session();
    let Some(georeference) = session.georeference() else { return };
    let at = georeference.tangent_plane().to_geographic(point);
    ui.add_space(12.0);
    let calibration = Some(session.georeference_covariance(point.on_floor()));
    let sigma = on_floor.and_then(|pixel| FloorCovariance { pixel, calibration }.worst_sigma());
    let sigma = sigma.filter(|sigma| *sigma > 0.0).map_or_else(String::new, |sigma| {
        let sigma = sigma / session.site.units.metres();
        format!(" \u{b1} {} {}", number(sigma, decimals(sigma)), session.site.units.symbol())
    });
    // The seventh decimal of a degree is about 1 cm.
    let text = format!("{:.7}, {:.7}{sigma}", at.latitude.to_degrees(), at.longitude.to_degrees());
    ui.label(RichText::new(text).color(theme::palette(ui.ctx()).text2));
}

/// Titles of the tools that are followed by a gap in the strip.
const TOOLS_BEFORE_GAP: [&str; 3] = ["Select", "Upright", "Mark"];

/// Shows the strip of tools.
pub(crate) fn toolstrip_ui(app: &mut App, ui: &mut Ui) {
    ui.add_space(6.0);
    // The buttons share the available height.
    let height = ((ui.available_height() - 24.0) / TOOLS.len() as f32).clamp(22.0, 34.0);
    let mut chosen = None;
    // A low window scrolls the strip.
    egui::ScrollArea::vertical().scroll_bar_visibility(ScrollBarVisibility::AlwaysHidden).show(ui, |ui| {
        ui.vertical_centered(|ui| tools(app, ui, height, &mut chosen));
    });
    if let Some(index) = chosen {
        app.send(Action::SelectTool(index));
    }
}

/// Shows the buttons of the tools; a click sets `chosen`.
fn tools(app: &App, ui: &mut Ui, height: f32, chosen: &mut Option<usize>) {
    let palette = theme::palette(ui.ctx());
    let dark = ui.visuals().dark_mode;
    ui.spacing_mut().item_spacing.y = 1.0;
    for (index, row) in TOOLS.iter().enumerate() {
        let colour = row.kind.map(|kind| theme::kind_icon(kind, dark));
        let look = Look {
            size: Vec2::new(36.0, height),
            chosen: Some(index == app.editor.tool_row()),
            colour,
            ..Look::default()
        };
        let label = format!("{} tool", row.title);
        let key = row.key.map_or("", calib_editor::Key::name);
        let key = if keys::are_shown(ui.ctx()) { key } else { "" };
        let tip = if key.is_empty() { row.title.into() } else { format!("{}  ({key})", row.title) };
        let response = icons::button(ui, row.icon.into(), &label, &tip, look);
        let corner = response.rect.right_bottom() - Vec2::new(2.0, 1.0);
        ui.painter().text(corner, Align2::RIGHT_BOTTOM, key, theme::regular(10.0), palette.text3);
        if response.clicked() {
            *chosen = Some(index);
        }
        if TOOLS_BEFORE_GAP.contains(&row.title) {
            ui.add_space(4.0);
        }
    }
}
