//! Camera list with thumbnails, missing steps and floor error. Also the dock that compares two solutions of a camera
//! that fit its lines equally well.

use calib_core::{floor_grid, on_image};
use calib_editor::{Action, CameraStatus, Family, Fit, StatusLevel, camera_status, steps, summary};
use calib_image::CameraChange;
use egui::{
    Align2, Color32, Key, Painter, Popup, Rect, Response, RichText, Role, ScrollArea, Sense, Slider, Stroke,
    TextEdit, Ui, Vec2, WidgetInfo,
};

use crate::canvas::{Mapping, View};
use crate::choice::Purpose;
use crate::command::Command;
use crate::compare::panel;
use crate::handles::grouped_rows;
use crate::icons::{self, Icon, Look};
use crate::overlay::grid_step;
use crate::paint::{Pen, chip, line};
use crate::picture::{Piece, cropped};
use crate::shell::above;
use crate::state::{App, Mode, Order};
use crate::theme::{self, Palette};
use crate::widgets::{describe, number};

/// Shows the camera list, or a narrow strip of thumbnails with `rail`.
pub(crate) fn cameras_ui(app: &mut App, ui: &mut Ui, rail: bool) {
    let rows = rows(app);
    if !rail && app.view.above && app.view.mode == Mode::Image && ui.available_height() > 2.0 * above::HEIGHT
    {
        let frame = egui::Frame::NONE.fill(theme::palette(ui.ctx()).panel);
        egui::Panel::bottom("above")
            .exact_size(above::HEIGHT)
            .frame(frame)
            .show(ui, |ui| above::above_ui(app, ui));
    }
    if rail {
        ui.add_space(6.0);
    } else {
        header(app, ui);
    }
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        for &camera in &rows {
            if row(app, ui, camera, rail) {
                app.send(Action::CancelGesture);
                app.send(Action::SelectCamera(camera));
            }
        }
        if !rail {
            let palette = theme::palette(ui.ctx());
            ui.add_space(8.0);
            ui.vertical_centered(|ui| {
                ui.label(RichText::new("Drop images here to add them").small().color(palette.text3));
            });
        }
    });
}

fn header(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    egui::Frame::NONE.inner_margin(egui::Margin::symmetric(10, 6)).show(ui, |ui| {
        ui.horizontal(|ui| {
            ui.label(RichText::new("Cameras").font(theme::medium(13.0)));
            let count = app.editor.session().site.cameras.len();
            let done = (0..count).filter(|&i| steps::is_finished(app.editor.session(), i)).count();
            ui.label(RichText::new(format!("{done} of {count} done")).small().color(palette.text3));
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let look = Look { size: Vec2::splat(20.0), ..Look::default() };
                if icons::button(ui, Icon::Plus, "Add images", "", look).clicked() {
                    app.open_dialog(Purpose::AddImages);
                }
            });
        });
        // A short list needs no filter.
        if app.editor.session().site.cameras.len() > 6 {
            let label = ui.label(RichText::new("Filter").small().color(palette.text3));
            ui.add(
                TextEdit::singleline(&mut app.view.list.filter)
                    .hint_text("name")
                    .desired_width(f32::INFINITY),
            )
            .labelled_by(label.id);
            ui.horizontal(|ui| {
                ui.checkbox(&mut app.view.list.unfinished, "unfinished");
                let text = match app.view.list.order {
                    Order::Site => "site order",
                    Order::Missing => "missing steps",
                    Order::Sigma => "floor \u{b1}",
                };
                if ui.button(text).on_hover_text("Change the order of the list").clicked() {
                    app.view.list.order = match app.view.list.order {
                        Order::Site => Order::Missing,
                        Order::Missing => Order::Sigma,
                        Order::Sigma => Order::Site,
                    };
                }
            });
        }
    });
}

fn rows(app: &App) -> Vec<usize> {
    let wanted = app.view.list.filter.to_lowercase();
    let mut rows: Vec<usize> = app
        .editor
        .session()
        .site
        .cameras
        .iter()
        .enumerate()
        .filter(|(_, camera)| camera.id.to_lowercase().contains(&wanted))
        .filter(|(index, _)| !app.view.list.unfinished || !steps::is_finished(app.editor.session(), *index))
        .map(|(index, _)| index)
        .collect();
    match app.view.list.order {
        Order::Site => {}
        Order::Missing => {
            rows.sort_by_key(|&i| std::cmp::Reverse(steps::missing_steps(app.editor.session(), i)));
        }
        Order::Sigma => {
            let sigma = |i: usize| steps::floor_sigma(app.editor.session(), i).unwrap_or(f64::INFINITY);
            rows.sort_by(|&a, &b| sigma(b).total_cmp(&sigma(a)));
        }
    }
    rows
}

/// Shows a camera in the list; returns whether the camera was clicked.
fn row(app: &mut App, ui: &mut Ui, camera: usize, rail: bool) -> bool {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.session().site.cameras.get(camera) else { return false };
    let (id, image) = (entry.id.clone(), entry.image.clone());
    let height = if rail { 62.0 } else { 54.0 };
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), height), Sense::click());
    let is_own = camera == app.editor.session().camera;
    let label = format!("Camera {id}");
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, is_own, &label));
    describe(&response, &about(app, camera, palette).0);
    if !ui.is_rect_visible(rect) {
        return response.clicked();
    }
    if is_own {
        ui.painter().rect_filled(rect, 0.0, palette.raised);
        let bar = Rect::from_min_size(rect.min, Vec2::new(2.0, height));
        ui.painter().rect_filled(bar, 0.0, palette.accent);
    } else if response.hovered() {
        ui.painter().rect_filled(rect, 0.0, palette.raised.gamma_multiply(0.5));
    }
    let thumb = if rail {
        Rect::from_min_size(rect.min + Vec2::new(8.0, 5.0), Vec2::new(48.0, 34.0))
    } else {
        Rect::from_min_size(rect.min + Vec2::new(10.0, 7.0), Vec2::new(70.0, 40.0))
    };
    thumbnail(app, ui, image.as_deref(), thumb);
    let slot = app.editor.session().camera_slot(camera);
    chip(ui.painter(), thumb.left_top() + Vec2::new(9.0, 9.0), slot);
    if rail {
        let at = thumb.center_bottom() + Vec2::new(0.0, 3.0);
        let clip = ui.painter().with_clip_rect(rect.shrink(2.0));
        clip.text(at, Align2::CENTER_TOP, &id, theme::regular(10.0), palette.text2);
    } else {
        words(app, ui, camera, rect, thumb);
    }
    context_menu(app, &response, camera);
    let response = response.on_hover_text(summary(app.editor.session(), camera));
    response.clicked() || response.has_focus() && ui.input(|i| i.key_pressed(Key::Enter))
}

/// Shows the context menu of a camera while it is open. Its commands apply to the selected camera.
fn context_menu(app: &mut App, response: &Response, camera: usize) {
    /// Commands of the menu, in groups.
    const MENU: [&[Command]; 3] = [
        &[Command::Propose, Command::CopyLines, Command::PasteLines],
        &[Command::CompareStill, Command::ReplaceStill],
        &[Command::FixPlacement, Command::ResetPlacement, Command::RemoveCamera],
    ];
    if response.secondary_clicked() {
        app.send(Action::CancelGesture);
        app.send(Action::SelectCamera(camera));
    }
    let mut chosen = None;
    Popup::context_menu(response).show(|ui| grouped_rows(app, ui, &MENU, &mut chosen));
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

fn words(app: &App, ui: &Ui, camera: usize, rect: Rect, thumb: Rect) {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.session().site.cameras.get(camera) else { return };
    let left = thumb.right() + 8.0;
    let clip = ui.painter().with_clip_rect(rect.with_max_x(rect.right() - 8.0));
    let top = egui::pos2(left, rect.top() + 7.0);
    let sigma = steps::floor_sigma(app.editor.session(), camera);
    // A floor error of 100 % or more counts as unknown.
    let sigma = sigma.filter(|rel| *rel < 1.0);
    let solved = &app.editor.session().solved;
    let has_no_scale = solved.pose(camera).is_some() && !solved.scale_is_known(camera);
    let unknown = if has_no_scale { "no scale" } else { "\u{2014}" };
    let sigma = sigma.map_or_else(|| unknown.into(), |rel| format!("{:.1} %", 100.0 * rel));
    let right = egui::pos2(rect.right() - 10.0, rect.top() + 8.0);
    let taken = clip.text(right, Align2::RIGHT_TOP, sigma, theme::regular(11.0), palette.text2);
    let name = clip.with_clip_rect(clip.clip_rect().with_max_x(taken.left() - 4.0));
    name.text(top, Align2::LEFT_TOP, &entry.id, theme::medium(12.0), palette.text);
    let (text, colour) = about(app, camera, palette);
    let galley = ui.painter().layout(text, theme::regular(11.0), colour, rect.right() - 8.0 - left);
    clip.galley(egui::pos2(left, rect.top() + 23.0), galley, colour);
}

/// Returns the status of a camera as text, with its colour. A change in its newest image has priority, then the
/// end of its validity.
fn about(app: &App, camera: usize, palette: &Palette) -> (String, Color32) {
    let changed = app.editor.newer(camera).filter(|newer| newer.comparison.change != CameraChange::Unchanged);
    if let Some(newer) = changed {
        let (word, _, colour, _) = panel::verdict(newer.comparison.change, palette);
        return (format!("newest image: {}", word.to_lowercase()), colour);
    }
    let ended = app.editor.site().cameras.get(camera).and_then(|entry| entry.valid_to.as_ref());
    if let Some(to) = ended {
        return (format!("valid until {}", to.get(..10).unwrap_or(to)), palette.text3);
    }
    let CameraStatus { text, level: standing } = camera_status(app.editor.session(), camera);
    let colour = match standing {
        StatusLevel::Good => palette.ok,
        StatusLevel::Incomplete => palette.warn,
        StatusLevel::Contradictory => palette.bad,
    };
    (text, colour)
}

fn thumbnail(app: &mut App, ui: &Ui, name: Option<&str>, rect: Rect) {
    let palette = theme::palette(ui.ctx());
    let images = &app.editor.session().images;
    let picture = name.and_then(|name| app.pictures.get(ui.ctx(), name, || images.reader(name)));
    match picture {
        Some(picture) => {
            let uv = cropped(picture.overview.size_vec2(), rect);
            ui.painter().image(picture.overview.id(), rect, uv, Color32::WHITE);
        }
        None => {
            ui.painter().rect_filled(rect, 2.0, palette.canvas);
            ui.painter().rect_stroke(rect, 2.0, Stroke::new(1.0, palette.line), egui::StrokeKind::Inside);
        }
    }
}

/// Height of the dock that compares two solutions of a camera, in points.
pub(crate) const HEIGHT: f32 = 236.0;

/// Shows a message over the lower edge of the image if several fields of view fit the annotations. Its button opens
/// the comparison of two such solutions.
pub(crate) fn offer(app: &mut App, ui: &mut Ui, rect: Rect, is_tall: bool) {
    let palette = theme::palette(ui.ctx());
    let Some((_, family)) = app.editor.family() else { return };
    let [a, b] = [0, 1].map(|which| family.shown[which].view);
    let text = match family.range {
        Some([low, high]) => {
            format!("Every field of view from {low:.0}\u{b0} to {high:.0}\u{b0} fits these lines")
        }
        None => format!("Fields of view of {a:.0}\u{b0} and {b:.0}\u{b0} fit equally well"),
    };
    let size = Vec2::new(400.0_f32.min(rect.width() - 24.0), 30.0);
    let bar = Rect::from_center_size(egui::pos2(rect.center().x, rect.bottom() - 28.0), size);
    ui.scope_builder(egui::UiBuilder::new().max_rect(bar), |ui| {
        let frame = egui::Frame::NONE.fill(palette.warn_bg).corner_radius(4);
        frame.inner_margin(egui::Margin::symmetric(10, 4)).show(ui, |ui| {
            ui.set_min_size(size - Vec2::new(20.0, 8.0));
            ui.horizontal_centered(|ui| {
                ui.label(RichText::new(text).color(palette.warn));
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    if is_tall
                        && ui
                            .button("Compare them")
                            .on_hover_text("Show two of the solutions side by side")
                            .clicked()
                    {
                        app.view.compares_views = true;
                    }
                });
            });
        });
    });
}

/// Shows the dock below the image, which compares two solutions of a camera that fit its lines equally well.
pub(crate) fn dock_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some((_, family)) = app.editor.family() else { return };
    let (mut actions, mut fold) = (Vec::new(), false);
    egui::Frame::NONE.fill(palette.panel).inner_margin(12).show(ui, |ui| {
        ui.set_min_size(ui.available_size());
        let title = match family.range {
            Some(_) => "Two of the solutions that fit equally well",
            None => "Two solutions fit equally well",
        };
        ui.horizontal(|ui| {
            ui.label(RichText::new(title).font(theme::medium(13.0)));
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let look = Look { size: Vec2::splat(20.0), ..Look::default() };
                fold = icons::button(ui, Icon::Close, "Hide this comparison", "Hide", look).clicked();
            });
        });
        let width = 0.5 * (ui.available_width() - 12.0);
        ui.horizontal_top(|ui| {
            ui.spacing_mut().item_spacing.x = 12.0;
            for which in 0..2 {
                ui.allocate_ui(Vec2::new(width, ui.available_height()), |ui| {
                    ui.vertical(|ui| {
                        ui.set_width(width);
                        actions
                            .extend(card(app, ui, family, which).map(|view| Action::ShowView(which, view)));
                        let view = family.shown[which].view;
                        if ui.button(format!("Use {view:.0}\u{b0}")).clicked() {
                            actions.push(Action::SetFocalPrior(family.shown[which].solution.focal_px));
                        }
                    });
                });
            }
        });
    });
    app.view.compares_views = !fold;
    actions.into_iter().for_each(|action| app.send(action));
}

/// Shows one of the two solutions with numbers, image and floor. Returns the field of view, in degrees, if the
/// operator moved its slider.
fn card(app: &App, ui: &mut Ui, family: &Family, which: usize) -> Option<f64> {
    let palette = theme::palette(ui.ctx());
    let Fit { view, solution, pose } = &family.shown[which];
    let entry = app.editor.session().entry()?;
    let mut wanted = None;
    ui.horizontal(|ui| {
        ui.label(RichText::new(format!("{view:.0}\u{b0}")).font(theme::medium(12.0)));
        let pitch = number(solution.pitch_deg.unwrap_or_default(), 1);
        let text = format!("focal {:.0} px, pitch {pitch}\u{b0}", solution.focal_px);
        ui.label(RichText::new(text).color(palette.text2));
        if let Some([low, high]) = family.range {
            let mut slid = *view;
            let slider = Slider::new(&mut slid, low..=high).show_value(false);
            let response = ui
                .add(slider)
                .on_hover_text("Horizontal field of view: every position of the slider fits the lines");
            let label = format!("Horizontal field of view {}", which + 1);
            response.widget_info(|| WidgetInfo::slider(true, slid, &label));
            wanted = response.changed().then_some(slid);
        }
        let rms = format!("RMS {:.1} px", solution.rms_px.unwrap_or_default());
        ui.label(RichText::new(rms).color(palette.text3));
    });
    let size = Vec2::new(ui.available_width(), (ui.available_height() - 28.0).max(40.0));
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let label = format!("Solution with a field of view of {view:.0}\u{b0}");
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, &label));
    let (left, right) = rect.split_left_right_at_fraction(0.6);
    let (left, right) = (left.with_max_x(left.right() - 4.0), right.with_min_x(right.left() + 4.0));
    let picture = entry.image.as_ref().and_then(|name| app.pictures.ready(name));
    let clip = |rect: Rect| {
        let painter = ui.painter().with_clip_rect(rect.intersect(ui.clip_rect()));
        painter.rect_filled(rect, 0.0, theme::DARK.canvas);
        painter
    };
    let painter = clip(left);
    let mapping = Mapping::new(View::of([0.0, 0.0], entry.size(), left, false, true), left);
    if let Some(picture) = picture {
        let whole = Piece { low: [0.0, 0.0], size: entry.size(), texture: picture.overview.id() };
        whole.paint(&painter, &mapping, Color32::WHITE);
    }
    grid(app, &painter, &mapping, &family.shown[which]);
    let shown = (app.editor.session().site.units, app.ellipse_size());
    above::paint(&clip(right), right, entry, pose, picture, shown);
    wanted
}

fn grid(app: &App, painter: &Painter, mapping: &Mapping, fit: &Fit) {
    let step = grid_step(&fit.solution.efov_m, app.editor.session().site.units);
    for points in floor_grid(&fit.solution.efov_m, step) {
        for piece in on_image(&fit.pose, &points) {
            let piece: Vec<egui::Pos2> =
                piece.into_iter().map(|pixel| mapping.screen(pixel.into())).collect();
            line(painter, &piece, Pen::new(Color32::from_white_alpha(150), 1.0).faint());
        }
    }
}
