//! Panel of ground points: points with known coordinates that wait for a click in an image.

use calib_editor::{Action, PointAction, Session};
use calib_site::{CoordinateSystem, Georeference, GroundPoint, SiteCamera, typed_degrees};
use egui::{DragValue, RichText, TextEdit, Ui, Vec2};

use crate::icons::{self, Icon, Look};
use crate::state::App;
use crate::theme;
use crate::widgets::heading;

/// Standard deviation of a typed position, in metres: the accuracy of a phone.
const TYPED_SIGMA_M: f64 = 4.0;

/// Largest number of listed points.
const MAX_ROWS: usize = 200;

/// Shows the ground points with the cameras in which they are clicked, and a field for a new one.
pub(crate) fn ground_points_ui(app: &mut App, ui: &mut Ui) {
    let points = app.editor.session().site.ground_points.clone();
    let georeference = app.editor.session().georeference();
    heading(ui, "Points to click", if points.is_empty() { "" } else { "cameras" });
    for point in points.iter().take(MAX_ROWS) {
        point_row(app, ui, point, georeference.as_ref());
    }
    if points.len() > MAX_ROWS {
        let text = format!("Points not listed: {}.", points.len() - MAX_ROWS);
        ui.label(RichText::new(text).small().color(theme::palette(ui.ctx()).text3));
    }
    new_point(app, ui);
    grid_field(app, ui);
}

/// Shows the field for the map grid (EPSG code) of points with east and north coordinates.
fn grid_field(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let site = &app.editor.session().site;
    let known = site.crs.clone().unwrap_or_default();
    let id = ui.scope_id().with("grid");
    let mut text = ui.data(|data| data.get_temp::<String>(id)).unwrap_or_else(|| known.clone());
    let field = ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Coordinate grid").color(palette.text2));
        ui.add(TextEdit::singleline(&mut text).hint_text("EPSG:25832").desired_width(96.0))
            .labelled_by(label.id)
    });
    // The text is kept only while it is typed, so that another site shows its own grid.
    if field.inner.has_focus() {
        ui.data_mut(|data| data.insert_temp(id, text));
        return;
    }
    ui.data_mut(|data| data.remove::<String>(id));
    let is_entered = field.inner.lost_focus() && !ui.input(|input| input.key_pressed(egui::Key::Escape));
    if !is_entered {
        return;
    }
    let text = text.trim().to_uppercase();
    if text == known {
        return;
    }
    match (text.is_empty(), CoordinateSystem::new(&text)) {
        (true, _) => app.send(Action::Points(PointAction::SetGrid(None))),
        (false, Ok(_)) => app.send(Action::Points(PointAction::SetGrid(Some(text)))),
        (false, Err(error)) => app.send(Action::SetError(format!("Grid {text}: expected {error}."))),
    }
}

/// Shows a ground point: its id, the cameras in which it is clicked, and, if it is chosen, its coordinates.
fn point_row(app: &mut App, ui: &mut Ui, point: &GroundPoint, georeference: Option<&Georeference>) {
    let palette = theme::palette(ui.ctx());
    let is_chosen = app.editor.session().tool.ground_point.as_ref() == Some(&point.id);
    let cameras = cameras_with(app.editor.session(), &point.id, georeference);
    let mut sent = None;
    ui.horizontal(|ui| {
        let title = RichText::new(&point.id).font(theme::medium(12.0));
        let label = ui.selectable_label(is_chosen, title);
        let about = point.name.as_deref().unwrap_or("Choose this point, then click it in the images");
        if label.on_hover_text(about).clicked() {
            sent = Some(PointAction::Choose((!is_chosen).then(|| point.id.clone())));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let text = if cameras.is_empty() { "\u{2014}".into() } else { cameras.join(", ") };
            ui.add(egui::Label::new(text).truncate()).on_hover_text(
                "Cameras in which this point was clicked, and the distance on the floor between each click and \
                 the coordinates of the point",
            );
        });
    });
    if is_chosen {
        ui.horizontal(|ui| {
            let label = ui.label(RichText::new(coordinates(point)).color(palette.text2));
            let mut sigma = point.sigma_m.unwrap_or_default();
            let field =
                DragValue::new(&mut sigma).prefix("\u{b1} ").suffix(" m").range(0.001..=1000.0).speed(0.01);
            let field = ui.add(field.max_decimals(3).update_while_editing(false)).labelled_by(label.id);
            if field
                .on_hover_text("Accuracy: 4 m for a phone, 0.5 m for an aerial image, 0.02 m for RTK")
                .changed()
            {
                sent = Some(PointAction::SetGroundPoint(Box::new(GroundPoint {
                    sigma_m: Some(sigma),
                    ..point.clone()
                })));
            }
            let look = Look { size: Vec2::splat(18.0), ..Look::default() };
            if icons::button(ui, Icon::Close, &format!("Remove point {}", point.id), "", look).clicked() {
                sent = Some(PointAction::RemoveGroundPoint(point.id.clone()));
            }
        });
    }
    if let Some(action) = sent {
        app.send(Action::Points(action));
    }
}

/// Shows the field for the coordinates of a new ground point.
fn new_point(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let label = ui.label(RichText::new("Latitude, longitude").color(palette.text2));
    let mut text = std::mem::take(&mut app.typed_point);
    let field =
        TextEdit::singleline(&mut text).hint_text("48.137154, 11.576124").desired_width(f32::INFINITY);
    let field = ui.add(field).labelled_by(label.id);
    let is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
    match typed_degrees(&text) {
        Some([lat, lon]) if is_entered => {
            let site = &app.editor.session().site;
            let is_clicked = |id: &String| {
                let points = site.cameras.iter().flat_map(|camera| &camera.control_points);
                points.into_iter().any(|point| point.id.as_ref() == Some(id))
            };
            let is_used = |id: &String| site.ground_points.iter().any(|own| own.id == *id) || is_clicked(id);
            let id = (1..).map(|number| format!("G{number}")).find(|id| !is_used(id)).unwrap_or_default();
            let (lat_deg, lon_deg) = (Some(lat), Some(lon));
            let point =
                GroundPoint { id, lat_deg, lon_deg, sigma_m: Some(TYPED_SIGMA_M), ..GroundPoint::default() };
            app.send(Action::Points(PointAction::SetGroundPoint(Box::new(point))));
            text.clear();
        }
        None if !text.trim().is_empty() && !field.has_focus() => {
            let message = "Type latitude and longitude in degrees, such as 48.137154, 11.576124.";
            ui.label(RichText::new(message).small().color(palette.warn));
        }
        _ if text.is_empty() => {
            let message = "Type coordinates and press Enter, or drop a GPX, KML, GeoJSON or CSV file.";
            ui.label(RichText::new(message).small().color(palette.text3));
        }
        _ => {}
    }
    app.typed_point = text;
}

/// Returns the ids of the cameras in which a ground point is clicked. Each id is followed by the distance between
/// the click and the coordinates of the point.
fn cameras_with(session: &Session, id: &str, georeference: Option<&Georeference>) -> Vec<String> {
    let (site, units) = (&session.site, session.site.units);
    let with_distance = |(index, camera): (usize, &SiteCamera)| {
        let point = camera.control_points.iter().find(|point| point.id.as_deref() == Some(id))?;
        let pose = session.solved.placed_pose(index);
        let distance = pose.and_then(|pose| site.control_point_distance(pose, georeference, point));
        let text = distance.map_or_else(String::new, |distance| {
            format!(" {:.2} {}", distance / units.metres(), units.symbol())
        });
        Some(format!("{}{text}", camera.id))
    };
    site.cameras.iter().enumerate().filter_map(with_distance).collect()
}

/// Returns the coordinates of a ground point as text.
fn coordinates(point: &GroundPoint) -> String {
    match (point.lat_deg.zip(point.lon_deg), point.crs_m, point.world_m) {
        (Some((lat, lon)), ..) => format!("{lat:.7}, {lon:.7}"),
        (_, Some([east, north]), _) => format!("{east:.2}, {north:.2} m"),
        (_, _, Some(world)) => format!("{:.2}, {:.2}, {:.2} m", world.x, world.y, world.z),
        _ => String::new(),
    }
}
