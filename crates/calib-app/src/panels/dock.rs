//! Two cameras that fit what was drawn equally well, side by side; a slider each where a whole family does.

use calib_core::{floor_grid, on_image};
use calib_editor::{Action, Family, Fit};
use egui::{Color32, Painter, Rect, RichText, Role, Sense, Slider, Ui, Vec2, WidgetInfo};

use crate::canvas::{Mapping, View};
use crate::icons::{self, Icon, Look};
use crate::overlay::grid_step;
use crate::paint::{Pen, line};
use crate::panels::{above, number};
use crate::picture::Piece;
use crate::state::App;
use crate::theme;

/// Height of the part, in points.
pub const HEIGHT: f32 = 236.0;

/// A line over the foot of the image: the image stays where it is until the operator asks for more.
pub fn offer(app: &mut App, ui: &mut Ui, rect: Rect, is_tall: bool) {
    let palette = theme::palette(ui.ctx());
    let Some((_, family)) = app.editor.family() else { return };
    let [a, b] = [0, 1].map(|which| family.shown[which].view);
    let text = match family.range {
        Some([low, high]) => format!("Every view from {low:.0}\u{b0} to {high:.0}\u{b0} fits these lines"),
        None => format!("Views of {a:.0}\u{b0} and {b:.0}\u{b0} fit equally well"),
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
                    if is_tall && ui.button("Compare them").clicked() {
                        app.compares_views = true;
                    }
                });
            });
        });
    });
}

/// The part below the image.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let Some((_, family)) = app.editor.family() else { return };
    let (mut actions, mut fold) = (Vec::new(), false);
    egui::Frame::NONE.fill(palette.panel).inner_margin(12).show(ui, |ui| {
        ui.set_min_size(ui.available_size());
        let title = match family.range {
            Some(_) => "Two of the cameras that fit equally well",
            None => "Two cameras fit equally well",
        };
        ui.horizontal(|ui| {
            ui.label(RichText::new(title).font(theme::medium(13.0)));
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let look = Look { size: Vec2::splat(20.0), ..Look::default() };
                fold = icons::button(ui, Icon::Close, "Hide the two cameras", "Hide", look).clicked();
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
                            actions.push(Action::UseFocal(family.shown[which].solution.focal_px));
                        }
                    });
                });
            }
        });
    });
    app.compares_views = !fold;
    actions.into_iter().for_each(|action| app.send(action));
}

/// One camera: its numbers, its image with the grid, its floor. The field of view it is to have instead.
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
            let response = ui.add(slider).on_hover_text("Horizontal view: every place fits the lines");
            let label = format!("Horizontal view {}", which + 1);
            response.widget_info(|| WidgetInfo::slider(true, slid, &label));
            wanted = response.changed().then_some(slid);
        }
        let rms = format!("rms {:.1} px", solution.rms_px.unwrap_or_default());
        ui.label(RichText::new(rms).color(palette.text3));
    });
    let size = Vec2::new(ui.available_width(), (ui.available_height() - 28.0).max(40.0));
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let label = format!("Camera with a view of {view:.0}\u{b0}");
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
    above::paint(&clip(right), right, entry, pose, picture, app.editor.session().units);
    wanted
}

fn grid(app: &App, painter: &Painter, mapping: &Mapping, fit: &Fit) {
    let step = grid_step(&fit.solution.efov_m, app.editor.session().units);
    for points in floor_grid(&fit.solution.efov_m, step) {
        for piece in on_image(&fit.pose, &points) {
            let piece: Vec<egui::Pos2> =
                piece.into_iter().map(|pixel| mapping.screen(pixel.into())).collect();
            line(painter, &piece, Pen::new(Color32::from_white_alpha(150), 1.0).faint());
        }
    }
}
