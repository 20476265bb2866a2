//! Panel with the steps of the current camera and their missing parts. Also the pictures of the three steps
//! on the start page.

use calib_core::Kind;
use calib_editor::steps::{nonstraightness_px, steps};
use calib_editor::{Action, TOOLS};
use egui::{Color32, Painter, Pos2, Rect, RichText, Shape, Stroke, Ui, Vec2};

use crate::annotate::lens;
use crate::command::Command;
use crate::icons::{self, Icon};
use crate::keys;
use crate::state::App;
use crate::theme;
use crate::widgets::heading;

/// Size of a picture of the start page, in points.
pub(crate) const SIZE: Vec2 = Vec2::new(170.0, 84.0);

/// Meaning of a line in a picture; `web/page.css` defines the same colours by these names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ink {
    /// Edge of the scene.
    Scene,
    /// Vertical line.
    Plumb,
    /// Floor line.
    Parallel,
    /// Line on the floor, perpendicular to the floor lines.
    Square,
    /// Field of view, filled.
    Field,
    /// Outline of the field of view before the operator rotates it on the plan, dashed.
    Before,
    /// Virtual element that all views show.
    Mark,
}

impl Ink {
    /// Returns the name of this meaning in `web/page.css`.
    #[cfg(test)]
    const fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Plumb => "plumb",
            Self::Parallel => "parallel",
            Self::Square => "square",
            Self::Field => "field",
            Self::Before => "before",
            Self::Mark => "mark",
        }
    }

    fn stroke(self, palette: &theme::Palette, is_dark: bool) -> Stroke {
        let kind = |kind| Stroke::new(2.0, theme::kind_icon(kind, is_dark));
        match self {
            Self::Scene => Stroke::new(1.0, palette.text3),
            Self::Before => Stroke::new(1.0, palette.text2),
            Self::Plumb => kind(Kind::Vertical),
            Self::Parallel => kind(Kind::Parallel),
            Self::Square => kind(Kind::Perpendicular),
            Self::Field | Self::Mark => Stroke::new(2.0, palette.accent),
        }
    }
}

/// Line of a picture: its meaning and its points.
type Line = (Ink, &'static [[f32; 2]]);

/// Picture of a step: lines with x right and y down, in points from the upper left corner.
pub(crate) type Picture = &'static [Line];

/// Picture of the first step: a corridor with lines that lead to one vanishing point.
pub(crate) const DRAW: Picture = &[
    (Ink::Scene, &[[58.0, 40.0], [58.0, 10.0], [112.0, 10.0], [112.0, 40.0]]),
    (Ink::Scene, &[[4.0, 84.0], [58.0, 40.0], [112.0, 40.0], [166.0, 84.0]]),
    (Ink::Scene, &[[76.0, 40.0], [76.0, 20.0], [94.0, 20.0], [94.0, 40.0]]),
    (Ink::Scene, &[[26.0, 66.0], [26.0, 0.0]]),
    (Ink::Plumb, &[[34.0, 60.0], [34.0, 4.0]]),
    (Ink::Plumb, &[[136.0, 60.0], [136.0, 4.0]]),
    (Ink::Parallel, &[[60.0, 78.0], [78.0, 44.0]]),
    (Ink::Parallel, &[[110.0, 78.0], [92.0, 44.0]]),
    (Ink::Square, &[[44.0, 54.0], [126.0, 54.0]]),
];

/// Picture of the second step: a plan with a field of view, before and after its rotation.
pub(crate) const PLACE: Picture = &[
    (Ink::Scene, &[[16.0, 8.0], [154.0, 8.0], [154.0, 76.0], [16.0, 76.0], [16.0, 8.0]]),
    (Ink::Scene, &[[96.0, 8.0], [96.0, 28.0]]),
    (Ink::Scene, &[[96.0, 52.0], [96.0, 76.0]]),
    (Ink::Before, &[[44.0, 36.0], [54.0, 18.0], [104.0, 18.0], [92.0, 54.0], [44.0, 36.0]]),
    (Ink::Field, &[[48.0, 44.0], [52.0, 60.0], [132.0, 68.0], [134.0, 20.0], [48.0, 44.0]]),
    (Ink::Mark, &[[30.0, 56.0], [50.0, 52.0]]),
    (Ink::Mark, &[[28.0, 50.0], [28.0, 62.0], [36.0, 56.0], [28.0, 50.0]]),
];

/// Picture of the third step: two views of one floor with the same mark.
pub(crate) const CHECK: Picture = &[
    (Ink::Scene, &[[6.0, 8.0], [82.0, 8.0], [82.0, 76.0], [6.0, 76.0], [6.0, 8.0]]),
    (Ink::Scene, &[[88.0, 8.0], [164.0, 8.0], [164.0, 76.0], [88.0, 76.0], [88.0, 8.0]]),
    (Ink::Scene, &[[6.0, 40.0], [50.0, 28.0], [82.0, 36.0]]),
    (Ink::Scene, &[[50.0, 28.0], [50.0, 8.0]]),
    (Ink::Scene, &[[88.0, 34.0], [108.0, 28.0], [164.0, 42.0]]),
    (Ink::Scene, &[[108.0, 28.0], [108.0, 8.0]]),
    (Ink::Mark, &[[34.0, 56.0], [44.0, 51.0], [54.0, 56.0], [44.0, 61.0], [34.0, 56.0]]),
    (Ink::Mark, &[[44.0, 56.0], [44.0, 30.0]]),
    (Ink::Mark, &[[120.0, 58.0], [132.0, 54.0], [142.0, 60.0], [130.0, 64.0], [120.0, 58.0]]),
    (Ink::Mark, &[[131.0, 59.0], [131.0, 38.0]]),
];

/// Paints a picture with its upper left corner at the screen point `at`.
pub(crate) fn paint(painter: &Painter, picture: Picture, at: Pos2) {
    let (palette, is_dark) = (theme::palette(painter.ctx()), painter.ctx().theme() == egui::Theme::Dark);
    let clip = painter.with_clip_rect(Rect::from_min_size(at, SIZE));
    for (ink, points) in picture {
        let points: Vec<Pos2> = points.iter().map(|&[x, y]| at + Vec2::new(x, y)).collect();
        let stroke = ink.stroke(palette, is_dark);
        if *ink == Ink::Field {
            let fill = stroke.color.gamma_multiply(0.2);
            clip.add(Shape::convex_polygon(points.clone(), fill, Stroke::new(0.0, Color32::TRANSPARENT)));
        }
        if *ink == Ink::Before {
            clip.extend(Shape::dashed_line(&points, stroke, 4.0, 3.0));
        } else {
            clip.add(Shape::line(points, stroke));
        }
    }
}

/// Returns a picture as SVG for the start page of the browser.
#[cfg(test)]
pub(crate) fn svg(picture: Picture) -> String {
    use std::fmt::Write as _;

    let mut text = format!("<svg viewBox=\"0 0 {} {}\">", SIZE.x, SIZE.y);
    for (ink, points) in picture {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x} {y}")).collect();
        // Writing to a string cannot fail.
        let _ = write!(text, "<path class=\"{}\" d=\"M{}\"/>", ink.name(), points.join("L"));
    }
    text + "</svg>"
}

/// Shows the panel of steps.
pub(crate) fn steps_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let session = app.editor.session();
    let id = session.entry().map_or_else(String::new, |entry| entry.id.clone());
    heading(ui, "Steps", &id);
    let list = steps(session, session.camera);
    let first = list.iter().position(|step| !step.is_done && !step.is_optional);
    let bent = nonstraightness_px(session, session.camera).is_some();
    for (i, step) in list.into_iter().enumerate() {
        let is_next = first == Some(i);
        let (icon, colour) = match (step.is_done, is_next) {
            (true, _) if step.is_contradicted => (Icon::Warn, palette.bad),
            (true, _) => (Icon::Check, palette.ok),
            (false, true) => (Icon::Chevron, palette.accent),
            (false, false) => (Icon::Open, palette.text3),
        };
        ui.horizontal(|ui| {
            icons::inline(ui, icon, colour);
            let title = RichText::new(step.title);
            ui.label(if is_next { title.font(theme::medium(12.0)) } else { title });
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.add(egui::Label::new(RichText::new(step.state).color(palette.text2)).truncate());
            });
        });
    }
    let is_blank = app
        .editor
        .session()
        .entry()
        .is_some_and(|entry| entry.image.is_some() && entry.annotations.is_empty());
    // With a plan, control points need the fewest clicks.
    let point_tool = TOOLS.iter().position(|tool| tool.title == "Control point");
    if let Some(tool) = point_tool.filter(|_| is_blank && app.editor.session().site.plan.is_some())
        && ui
            .button(keys::shown(ui.ctx(), "Click control points   C"))
            .on_hover_text("Click a point in the image, then the same point on the plan. Four points calibrate a camera without lines.")
            .clicked()
    {
        app.send(Action::SelectTool(tool));
    }
    let is_working = app.jobs.proposing.is_some() || app.jobs.automatic.is_some();
    let waits = !is_working && app.editor.session().proposed().is_none();
    if is_blank
        && waits
        && ui
            .button(keys::shown(ui.ctx(), "Calibrate automatically   Shift+P"))
            .on_hover_text("Detect lines from the edges in the image")
            .clicked()
    {
        app.send_command(Command::Propose);
    }
    if waits && app.blank_cameras().nth(1).is_some() {
        let button = ui.button(keys::shown(ui.ctx(), "Calibrate all images   Shift+A"));
        let tip = "Calibrate images that have no lines, and place the cameras relative to each other and on the plan";
        if button.on_hover_text(tip).clicked() {
            app.send_command(Command::CalibrateAll);
        }
    }
    if bent && ui.button("Fit k1, k2").on_hover_text("Fit the lens to the straight edges").clicked() {
        lens::fit(app);
    }
}
