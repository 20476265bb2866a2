//! Canvases of images and plan: pointer events go to the tool, then the canvas is painted.

use std::sync::Arc;

use calib_core::{Distortion, Pixel};

use calib_core::floor::annotated_line_curve;
use calib_editor::command::Gesture;
use calib_editor::{Action, NewerUnderPointer, Pane, Phase, Pointer, hit, is_plan_empty_at, snap};
use egui::{CursorIcon, Event, Modifiers, Painter, Pos2, Rect, Role, Sense, Ui, Vec2, WidgetInfo};

use crate::annotate::image;
use crate::annotate::loupe;
use crate::annotate::measurements::{paint_on_image, update_measurements};
use crate::annotate::minimap;
use crate::canvas::{Bend, Mapping, View};
use crate::choice::Purpose;
use crate::compare::panel;
use crate::crosshair::Crosshair;
use crate::handles;
use crate::keys;
use crate::paint::{Pen, line, tag};
use crate::picture::picture_key;
use crate::plan::coverage::{legend_ui, paint_borders, paint_coverage, update_coverage};
use crate::plan::drawing_fields::snapped;
use crate::plan::floor::Floor;
use crate::plan::north::paint_north;
use crate::state::{App, Mode, Place};
use crate::theme::{self, on_image};

/// Largest movement of the pointer during a click, in points.
const MAX_CLICK_MOVEMENT: f32 = 4.0;
/// Longest interval between the two presses of a double click, in seconds.
const DOUBLE_CLICK_S: f64 = 0.4;

/// Pans and zooms a canvas by wheel, drag and touch.
fn pan_and_zoom(app: &mut App, ui: &Ui, key: (Place, Pane), mapping: &mut Mapping) {
    let pointer = ui.input(|i| i.pointer.hover_pos());
    let is_over = pointer.is_some_and(|at| is_over(ui, mapping.rect, at));
    let holds = app.view.panes.captured == Some(key);
    if !is_over && !holds {
        return;
    }
    let (scroll, zoom, by, space, middle, touch) = ui.input(|i| {
        let touch = i.multi_touch().map_or(Vec2::ZERO, |touch| touch.translation_delta);
        let space = i.key_down(egui::Key::Space) && i.pointer.primary_down();
        let (middle, by) = (i.pointer.middle_down(), i.pointer.delta());
        (i.smooth_scroll_delta(), f64::from(i.zoom_delta()), by, space, middle, touch)
    });
    // If the tiles overflow the window, the wheel scrolls them; Ctrl and the wheel zoom a tile.
    let scroll = if key.0 == Place::Tile && app.view.panes.tiles_overflow { Vec2::ZERO } else { scroll };
    let at = pointer.unwrap_or_else(|| mapping.rect.center());
    let factor = zoom * (f64::from(scroll.y) / 240.0).exp();
    if factor != 1.0 {
        mapping.view = mapping.zoomed(at, factor, app.view.panes.fitted_zoom(key));
    }
    if scroll.x != 0.0 {
        mapping.view.pan(Vec2::new(scroll.x, 0.0));
    }
    if space || middle || holds && app.view.panes.has_finger_pan {
        mapping.view.pan(by);
        ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
    }
    mapping.view.pan(touch);
    app.view.panes.views.insert(key, mapping.view);
}

/// Whether a screen point is on a visible part of the canvas `rect`.
fn is_over(ui: &Ui, rect: Rect, at: Pos2) -> bool {
    rect.contains(at) && ui.clip_rect().contains(at) && ui.ctx().layer_id_at(at) == Some(ui.layer_id())
}

/// Returns whether the pointer events belong to a pinch. At its start, undoes the press of the first finger: cancels
/// the gesture that it began, or removes the last point of an earlier gesture.
fn is_pinch(app: &mut App, ui: &Ui) -> bool {
    let (has_two, has_any) = ui.input(|i| (i.multi_touch().is_some(), i.any_touches()));
    let panes = &mut app.view.panes;
    if has_two && !panes.has_pinch {
        panes.has_pinch = true;
        let (has_pressed, was_idle) = (panes.captured.is_some(), panes.was_idle);
        panes.forget_pointer();
        if has_pressed && was_idle {
            app.act(Action::CancelGesture);
        } else if has_pressed {
            app.act(Action::Gesture(Gesture::StepBack));
        }
    } else if !has_any {
        panes.has_pinch = false;
    }
    app.view.panes.has_pinch
}

/// Returns the distance at which a handle responds, in points: a finger is less precise than a mouse.
fn hit_radius(ui: &Ui) -> f32 {
    if ui.input(egui::InputState::any_touches) { theme::TOUCH_HIT } else { theme::HIT }
}

/// Sends the pointer events on a canvas to the current tool.
fn pointer_events(app: &mut App, ui: &Ui, key: (Place, Pane), mapping: &Mapping) {
    if is_pinch(app, ui) {
        return;
    }
    let (events, time, modifiers) = ui.input(|i| (i.events.clone(), i.time, i.modifiers));
    let is_move = |event: &Event| matches!(event, Event::PointerMoved(_));
    let mut events =
        events.into_iter().filter(|e| is_move(e) || matches!(e, Event::PointerButton { .. })).peekable();
    while let Some(event) = events.next() {
        match event {
            // Only the last of several consecutive moves is handled.
            Event::PointerMoved(_) if events.peek().is_some_and(is_move) => {}
            Event::PointerMoved(at) => handle_move(app, ui, key, mapping, at, modifiers),
            Event::PointerButton { pos, button: egui::PointerButton::Primary, pressed: true, modifiers } => {
                handle_press(app, ui, key, mapping, (pos, time), modifiers);
            }
            Event::PointerButton { pos, button: egui::PointerButton::Primary, pressed: false, modifiers }
                if app.view.panes.captured == Some(key) =>
            {
                app.view.panes.moved |= pos.distance(app.view.panes.pressed) > MAX_CLICK_MOVEMENT;
                handle_release(app, ui, key, mapping, pos, modifiers);
            }
            _ => {}
        }
    }
}

/// Handles a movement of the pointer.
fn handle_move(
    app: &mut App,
    ui: &Ui,
    key: (Place, Pane),
    mapping: &Mapping,
    at: Pos2,
    modifiers: Modifiers,
) {
    let holds = app.view.panes.captured == Some(key);
    let is_covered = app.view.panes.is_covered(key, at);
    if holds || (app.view.panes.captured.is_none() && !is_covered && is_over(ui, mapping.rect, at)) {
        app.view.panes.moved |= holds && at.distance(app.view.panes.pressed) > MAX_CLICK_MOVEMENT;
        app.view.panes.cursor = Some((key.1, mapping.document(at)));
        let phase = if holds { Phase::Drag } else { Phase::Hover };
        if !app.view.panes.has_finger_pan {
            send_pointer(app, ui, key, mapping, at, phase, modifiers);
        }
    } else if app.view.panes.cursor.is_some_and(|(pane, _)| pane == key.1)
        && (is_covered || !mapping.rect.contains(at))
    {
        app.view.panes.cursor = None;
    }
}

/// Handles a press of the primary button.
fn handle_press(
    app: &mut App,
    ui: &Ui,
    key: (Place, Pane),
    mapping: &Mapping,
    (at, time): (Pos2, f64),
    modifiers: Modifiers,
) {
    let space = ui.input(|i| i.key_down(egui::Key::Space));
    let is_covered = app.view.panes.is_covered(key, at);
    if app.view.panes.captured.is_some() || space || is_covered || !is_over(ui, mapping.rect, at) {
        return;
    }
    let panes = &mut app.view.panes;
    let recent = panes.last_press.is_some_and(|(when, before)| {
        time - when < DOUBLE_CLICK_S && before.distance(at) < 2.0 * MAX_CLICK_MOVEMENT
    });
    panes.double = recent;
    panes.was_idle = app.editor.tool().is_idle();
    panes.last_press = (!recent).then_some((time, at));
    (panes.captured, panes.active) = (Some(key), Some(key));
    (panes.pressed, panes.moved) = (at, false);
    panes.cursor = Some((key.1, mapping.document(at)));
    app.view.panes.has_finger_pan = is_finger_pan(app, ui, key, mapping, at);
    if !app.view.panes.has_finger_pan {
        send_pointer(app, ui, key, mapping, at, Phase::Press, modifiers);
    }
}

/// Handles the release of the primary button.
fn handle_release(
    app: &mut App,
    ui: &Ui,
    key: (Place, Pane),
    mapping: &Mapping,
    at: Pos2,
    modifiers: Modifiers,
) {
    let panes = &mut app.view.panes;
    let (has_panned, has_moved) = (std::mem::take(&mut panes.has_finger_pan), panes.moved);
    if has_panned && !has_moved {
        // A tap on an empty image clears the selection, as a click does.
        send_pointer(app, ui, key, mapping, at, Phase::Press, modifiers);
    }
    if !(has_panned && has_moved) {
        send_pointer(app, ui, key, mapping, at, Phase::Release, modifiers);
    }
    app.view.panes.captured = None;
}

/// Whether a press pans the canvas: a finger on an empty part of it, with the selection tool.
fn is_finger_pan(app: &App, ui: &Ui, key: (Place, Pane), mapping: &Mapping, at: Pos2) -> bool {
    if app.editor.tool_row() != 0 || !ui.input(egui::InputState::any_touches) {
        return false;
    }
    let session = app.editor.session();
    let Pane::Image(camera) = key.1 else {
        return is_plan_empty_at(session, mapping.document(at), mapping.units(theme::TOUCH_HIT));
    };
    let (at, radius) = (Pixel::from(mapping.document(at)), mapping.units(theme::TOUCH_HIT));
    let pose = session.solved.pose(camera);
    let is_proposed = camera == session.camera && session.proposed().is_some();
    let hit = hit::pick(&session.site, camera, pose, at, radius, &session.selection);
    // A tap can select a line of an automatic calibration.
    hit.is_none() && !is_proposed
}

/// Returns the capture time of the newer image of a camera if `shows_newer` is set, otherwise of its calibrated
/// image. `None` if the time is unknown, or if the camera has no newer image.
fn captured_under(app: &App, pane: Pane, shows_newer: bool) -> Option<String> {
    let Pane::Image(camera) = pane else { return None };
    let [old, new] = &app.editor.newer(camera)?.captured;
    if shows_newer { new.clone() } else { old.clone() }
}

/// Returns the newer image of a camera if the canvas shows it at a screen point.
fn newer_under(app: &App, key: (Place, Pane), at: Pos2) -> Option<NewerUnderPointer> {
    let (Place::Main, Pane::Image(camera)) = key else { return None };
    let is_under = app.view.panes.newer_from.is_some_and(|(of, from)| of == camera && at.x >= from);
    let is_under = is_under && app.view.mode == Mode::Image;
    app.editor.newer(camera).filter(|_| is_under).map(NewerUnderPointer::from)
}

/// Sends a pointer event at a screen point to the tool.
fn send_pointer(
    app: &mut App,
    ui: &Ui,
    key: (Place, Pane),
    mapping: &Mapping,
    at: Pos2,
    phase: Phase,
    modifiers: Modifiers,
) {
    let pane = key.1;
    let is_black = mapping.bend.is_some_and(|bend| bend.size().is_some()) && mapping.bent_at(at).is_none();
    // A gesture cannot start outside the image of a fisheye window; a running gesture stays at its last
    // point.
    let at_px = match phase {
        Phase::Press if is_black => return,
        Phase::Drag | Phase::Release if is_black => app.view.panes.pointed,
        _ => mapping.document(at),
    };
    let at_px = match pane {
        Pane::Plan => snapped(app, at_px, mapping.units(hit_radius(ui))).unwrap_or(at_px),
        Pane::Image(_) => at_px,
    };
    app.view.panes.pointed = at_px;
    let (mut still, mut offer) = (None, None);
    if let Pane::Image(camera) = pane {
        let name = app.editor.session().site.cameras.get(camera).and_then(|entry| entry.image.as_ref());
        still = name.and_then(|name| app.pictures.ready(name)).map(|picture| Arc::clone(&picture.image));
        offer = app.edge_under_pointer(ui.ctx(), camera, at_px.into(), snap::SNAP_RADIUS_PX);
    }
    let newer = newer_under(app, key, at);
    let pointer = Pointer {
        pane,
        at: at_px,
        phase,
        modifiers: keys::held(modifiers),
        radius: mapping.units(hit_radius(ui)),
        point_size: mapping.units(1.0),
        moved: app.view.panes.moved,
        double: app.view.panes.double,
        edge: offer,
        captured: captured_under(app, pane, newer.is_some()),
        newer,
        image: still,
    };
    app.act(Action::Pointer(pointer));
}

/// Pans and zooms a canvas, sends the pointer events to the tool, and clears the canvas. Returns the new
/// mapping and the painter.
fn canvas(
    app: &mut App,
    ui: &Ui,
    key: (Place, Pane),
    mut mapping: Mapping,
    label: &str,
) -> (Mapping, Painter) {
    let rect = mapping.rect;
    let response = ui.interact(rect, ui.scope_id().with(key), Sense::CLICK);
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, label));
    app.view.panes.rects.insert(key, rect);
    app.view.panes.bends.extend(mapping.bend.map(|bend| (key, bend)));
    pan_and_zoom(app, ui, key, &mut mapping);
    pointer_events(app, ui, key, &mapping);
    handles::show(app, &response, key, &mapping);
    let painter = ui.painter().with_clip_rect(rect.intersect(ui.clip_rect()));
    painter.rect_filled(rect, 0.0, theme::palette(ui.ctx()).canvas);
    (mapping, painter)
}

/// Returns the undistortion of a camera's image if the undistorted image is shown, or the window of a fisheye image.
fn bend(app: &App, camera: usize) -> Option<Bend> {
    if app.is_fisheye(camera) {
        return app.window(camera);
    }
    let lens =
        app.editor.session().solved.pose(camera).filter(|_| app.view.layers.straight).map(|pose| pose.lens);
    lens.filter(|lens| lens.distortion != Distortion::None).map(Bend::Lens)
}

/// Shows the canvas with the image of a camera.
pub fn image(app: &mut App, ui: &mut Ui, rect: Rect, camera: usize, place: Place) {
    let Some(entry) = app.editor.session().site.cameras.get(camera) else { return };
    let (size, name) = (entry.size(), entry.image.clone());
    let pane = Pane::Image(camera);
    let label = format!("Image of {}", entry.id);
    let bend = bend(app, camera).filter(|_| place == Place::Main);
    let shown = bend.and_then(|bend| bend.size()).unwrap_or(size);
    let whole = View::of([0.0, 0.0], shown, rect, false, place != Place::Main);
    let key = (place, pane);
    let view = app.view.panes.fitted_or_chosen(key, whole);
    let mapping = Mapping { view, rect, bend };
    let (mapping, painter) = canvas(app, ui, key, mapping, &label);
    image::paint(app, &painter, name.as_deref(), &mapping, rect);
    image::blend_old(app, &painter, camera, &mapping, size);
    let split = panel::paint(app, &painter, (camera, place), &mapping, size);
    let border_labels = paint_borders(app, camera, &painter, &mapping);
    let is_own = camera == app.editor.session().camera && place != Place::Tile;
    let suggested = if is_own { app.suggested(ui.ctx()) } else { Vec::new() };
    let is_measured = !app.editor.site().measurements.is_empty();
    if is_measured {
        update_measurements(app);
    }
    let mut overlay = image::overlay(app, ui, camera, mapping, place);
    overlay.suggested = suggested;
    if let Some(split) = split {
        overlay.compare(split, app.editor.newer(camera));
    }
    overlay.paint(&painter);
    for (at, text) in border_labels {
        tag(&painter, at, egui::Align2::CENTER_BOTTOM, &text, on_image::WHITE);
    }
    if is_measured && !app.view.layers.hidden {
        paint_on_image(app, camera, &overlay, &painter);
    }
    // A selection box is a rectangle of pixels; every other preview is a line of the scene.
    let is_box = app.editor.tool_row() == 0;
    for points in app.editor.tool().preview_lines(pane) {
        let pixels: Vec<Pixel> = points.iter().map(|&at| at.into()).collect();
        let points = if is_box { overlay.path(&pixels) } else { overlay.curve(&pixels) };
        line(&painter, &points, Pen::new(on_image::WHITE, 1.5).dashed(&[4.0, 4.0]));
    }
    paint_edge_under_pointer(app, ui, &painter, camera, &mapping);
    if place != Place::Tile {
        handles::on_image(app, ui, camera, &mapping);
    }
    cursor(app, ui, pane, &mapping);
    if place == Place::Main {
        app.view.panes.newer_from = split.map(|from| (camera, from));
        app.view.panes.wipe = None;
        if let Some(split) = split {
            panel::slide(app, ui, camera, &mapping, (size[0], split));
        }
        minimap::minimap_ui(app, ui, camera, &mapping, size);
    }
    enlarge(app, ui, camera, &mapping);
}

/// Shows the loupe at a dragged point, or at the crosshair.
fn enlarge(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping) {
    let pane = Pane::Image(camera);
    let is_own = |crosshair: &Crosshair| crosshair.canvas == Some(mapping.rect);
    let crosshair = Crosshair::with(ui.ctx(), |crosshair| crosshair.at.filter(|_| is_own(crosshair)));
    let dragged = app
        .editor
        .tool()
        .dragged_point()
        .filter(|(held, _)| *held == pane && app.view.panes.cursor.is_some_and(|(over, _)| over == pane));
    let at = dragged.map(|(_, at)| at).or(crosshair.map(|at| mapping.document(at)));
    if let Some(at) = at {
        loupe::loupe_ui(app, ui, camera, mapping, at);
    }
}

/// Paints the detected edge under the pointer as a dashed line; a click accepts the edge as an annotation.
fn paint_edge_under_pointer(app: &mut App, ui: &Ui, painter: &Painter, camera: usize, mapping: &Mapping) {
    let Some((_, at)) = app.view.panes.cursor.filter(|(pane, _)| *pane == Pane::Image(camera)) else {
        return;
    };
    if !app.editor.tool().is_idle() {
        return;
    }
    let Some(edge) = app.edge_under_pointer(ui.ctx(), camera, at.into(), snap::SNAP_RADIUS_PX) else {
        return;
    };
    let colour = app.editor.tool_kind().map_or(on_image::WHITE, theme::kind);
    let Some(entry) = app.editor.session().site.cameras.get(camera) else { return };
    let lens = hit::shown_lens(entry, app.editor.session().solved.pose(camera));
    line(
        painter,
        &mapping.path(&annotated_line_curve(&lens, &edge)),
        Pen::new(colour, 2.25).dashed(&[3.0, 6.0]),
    );
    for end in edge.map(|pixel| mapping.screen(pixel.into())) {
        painter.circle_stroke(end, 4.0, egui::Stroke::new(1.25, colour));
    }
}

/// Sets the shape of the pointer on a canvas.
fn cursor(app: &App, ui: &Ui, pane: Pane, mapping: &Mapping) {
    let over = ui.input(|i| i.pointer.hover_pos()).filter(|&at| is_over(ui, mapping.rect, at));
    let Some(at) = over else { return };
    if ui.input(|i| i.key_down(egui::Key::Space)) {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
        return;
    }
    let icon = match (app.editor.tool().dragged_point(), app.editor.tool_row(), pane) {
        (Some((held, _)), _, _) if held == pane => CursorIcon::None,
        (_, 0, Pane::Image(camera)) => {
            let pose = app.editor.session().solved.pose(camera);
            let at = Pixel::from(mapping.document(at));
            let near = mapping.units(theme::HIT);
            match hit::pick(
                &app.editor.session().site,
                camera,
                pose,
                at,
                near,
                &app.editor.session().selection,
            ) {
                Some(_) => CursorIcon::Move,
                None => CursorIcon::Default,
            }
        }
        (_, 0, Pane::Plan) => CursorIcon::Default,
        (None, _, Pane::Image(camera)) if moves_point(app, camera, mapping, at) => CursorIcon::Move,
        _ => CursorIcon::Crosshair,
    };
    ui.ctx().set_cursor_icon(icon);
}

/// Whether a drag at a screen point moves a point of a line, although a drawing tool is active.
fn moves_point(app: &App, camera: usize, mapping: &Mapping, at: Pos2) -> bool {
    let at = mapping.document(at).into();
    app.editor.tool_kind().is_some()
        && hit::line_point(app.editor.site(), camera, at, mapping.units(theme::HIT)).is_some()
}

/// Shows the canvas with the floor plan.
pub fn plan(app: &mut App, ui: &mut Ui, rect: Rect, place: Place) {
    let key = (place, Pane::Plan);
    // A plan image that has just been loaded is shown completely.
    let shown = app.editor.site().plan.as_ref().and_then(picture_key);
    let shown = shown.filter(|key| app.pictures.ready(key).is_some() && app.editor.tool().is_idle());
    if shown.is_some()
        && app.view.panes.plan != shown
        && app.view.panes.views.get(&key) == app.view.panes.fitted.get(&key)
    {
        app.view.panes.views.remove(&key);
    }
    if shown.is_some() {
        app.view.panes.plan = shown;
    }
    let [low, high] = app.floor_bounds();
    let whole = View::of(low, high, rect, true, false);
    // After the first change of the site, pan and zoom of the plan stay.
    let view = match app.view.panes.views.get(&key) {
        Some(view) if app.editor.session().history.depth() > 0 => *view,
        _ => app.view.panes.fitted_or_chosen(key, whole),
    };
    let (mapping, painter) = canvas(app, ui, key, Mapping::new(view, rect), "Floor plan");
    let palette = theme::palette(ui.ctx());
    let pieces = app.plan_pieces(ui.ctx(), &mapping);
    if app.view.coverage {
        update_coverage(app);
    }
    let before = app.editor.ghost_poses(app.view.show_before);
    let floor = Floor {
        session: app.editor.session(),
        mapping,
        opacity: app.opacity(ui.ctx()),
        blend: app.view.blend,
        fills_fields: !app.view.coverage,
        ellipses: app.ellipse_size(),
        before: &before,
    };
    floor.paint_plan(&painter, &pieces);
    floor.paint_grid(&painter, palette.text3.gamma_multiply(0.18));
    floor.paint_images(&painter, &app.pictures);
    if app.view.coverage {
        paint_coverage(app.coverage.as_ref(), app.editor.site(), &painter, &mapping);
    }
    let cursor = app.view.panes.cursor.and_then(|(pane, at)| (pane == Pane::Plan).then_some(at));
    floor.paint_cameras(&painter, cursor);
    // During a drag, labels of elements would hide the numbers of the dragged camera.
    floor.paint_elements(&painter, cursor.filter(|_| app.editor.tool().is_idle()));
    for points in app.editor.tool().preview_lines(Pane::Plan) {
        let points: Vec<Pos2> = points.into_iter().map(|at| mapping.screen(at)).collect();
        line(&painter, &points, Pen::new(on_image::WAITING, 2.0));
    }
    floor.paint_scale(&painter);
    paint_north(app.editor.session(), &floor.mapping, &painter);
    handles::on_plan(app, ui, &mapping);
    app.view.panes.plan_button = None;
    if place == Place::Main {
        open_plan_ui(app, ui, key, rect);
        let legend = if app.view.coverage { legend_ui(app, ui, rect) } else { None };
        app.view.panes.legend = legend.map(|rect| (key, rect));
    }
    self::cursor(app, ui, Pane::Plan, &mapping);
}

/// Shows a button that opens a floor plan, if the site has none. It is in the middle of an empty floor, otherwise at
/// the top.
fn open_plan_ui(app: &mut App, ui: &mut Ui, key: (Place, Pane), rect: Rect) {
    /// Size of the panel with the button, in points.
    const SIZE: Vec2 = Vec2::new(236.0, 64.0);
    if app.editor.site().plan.is_some() || app.jobs.planning.is_some() {
        return;
    }
    let session = app.editor.session();
    let is_empty = (0..session.site.cameras.len()).all(|camera| session.solved.pose(camera).is_none());
    let at = if is_empty { rect.center() } else { rect.center_top() + Vec2::new(0.0, 0.5 * SIZE.y + 10.0) };
    let panel = Rect::from_center_size(at, SIZE);
    let palette = theme::palette(ui.ctx());
    ui.painter().rect_filled(panel, 6.0, palette.panel);
    ui.scope_builder(egui::UiBuilder::new().max_rect(panel.shrink(8.0)), |ui| {
        ui.vertical_centered(|ui| {
            ui.label(egui::RichText::new("No floor plan is loaded.").color(palette.text2));
            let button = ui.button("Load a floor plan\u{2026}");
            if button.on_hover_text("Load an image, a PDF, an SVG or a DXF file").clicked() {
                app.open_dialog(Purpose::LoadPlan);
            }
        });
    });
    app.view.panes.plan_button = Some((key, panel));
}
