//! Panel with the table of annotations, their residuals and their switches; also the menu of usual sizes.

use calib_core::single::{ConstraintKind, KINDS, Known, USUAL_SIZES, UsualSize, line_name, straightness};
use calib_core::{Annotation, Pixel};
use calib_editor::edit::waits_for_height;
use calib_editor::{Action, Part, TOOLS, Units, planes};
use egui::{Align2, Rect, RichText, Role, Sense, Ui, Vec2, WidgetInfo};

use crate::annotate::result::empty_field;
use crate::annotate::sigmas::{self, Usual};
use crate::focus::RequestedField;
use crate::icons::{self, Icon};
use crate::keys;
use crate::state::App;
use crate::theme;
use crate::widgets::{describe, heading, length_field, number};

/// Choice of the operator in the menu of usual sizes.
pub(crate) enum SizeChoice {
    /// Typical size of a common object, such as a door, from the table `USUAL_SIZES`.
    Like(&'static UsualSize),
    /// Usual size of the annotation, to be used as its measured length or height, in metres.
    Measured(Known),
}

/// Shows the menu of objects whose usual size suits the annotation; returns the choice.
pub(crate) fn usual_size_menu(ui: &mut Ui, units: Units, annotation: &Annotation) -> Option<SizeChoice> {
    let palette = theme::palette(ui.ctx());
    let constraint = annotation.kind.row().constraint;
    let own = annotation.usual_size();
    let title = own.map_or("usual\u{2026}".to_owned(), |usual| format!("usual: {}", size(units, usual)));
    let mut chosen = None;
    ui.menu_button(RichText::new(title).small().color(palette.text2), |ui| {
        for usual in USUAL_SIZES.iter().filter(|usual| usual.constraint == constraint) {
            let text = format!("{}: {}", usual.title, size(units, usual));
            if ui.selectable_label(own == Some(usual), text).on_hover_text(usual.source).clicked() {
                chosen = Some(SizeChoice::Like(usual));
                ui.close();
            }
        }
        if let Some(usual) = own
            && ui.button("Measured").clicked()
        {
            chosen = Some(SizeChoice::Measured(usual.size));
            ui.close();
        }
    })
    .response
    .on_hover_text("Use the usual size of an object");
    chosen
}

/// Returns the size of a usual object and its standard deviation as text.
fn size(units: Units, usual: &UsualSize) -> String {
    units.short_length_and_sigma(usual.size.value, usual.size.sigma.unwrap_or(0.0))
}

/// Request of the operator in a row of the table. The first number is the index of the annotation. `Select` also
/// contains the index of the line, and whether the line is added to the selection.
enum RowRequest {
    Select(usize, usize, bool),
    Toggle(usize),
    Length(usize, f64),
    Height(usize, f64),
    Usual(usize, SizeChoice),
    Sigmas(usize, Box<Annotation>),
}

/// Shows the panel of annotations.
pub(crate) fn annotations_ui(app: &mut App, ui: &mut Ui) {
    heading(ui, "Lines", "residual, px");
    app.hover.lit = None;
    let Some(entry) = app.editor.session().entry() else { return };
    let annotations = entry.annotations.clone();
    let sigma = entry.sigma_px.unwrap_or(1.0);
    let usual = Usual { click: sigma, scene: app.editor.session().site.scene_errors(entry) };
    if annotations.is_empty() {
        let palette = theme::palette(ui.ctx());
        let text = if keys::are_shown(ui.ctx()) {
            "No lines yet. Press Shift+P to detect lines, or V, P or R to draw verticals, parallels or \
             right angles."
        } else {
            "No lines yet. Choose a tool on the left, then drag along an edge."
        };
        ui.label(RichText::new(text).color(palette.text2));
    }
    let mut requests = Vec::new();
    ui.spacing_mut().item_spacing.y = 0.0;
    for row in KINDS {
        let mut letter = 'a';
        // Unnamed annotations of a kind without settings are listed under one heading.
        let (plain, named): (Vec<usize>, Vec<usize>) = (0..annotations.len())
            .filter(|&i| annotations[i].kind == row.kind)
            .partition(|&i| row.is_one_group() && annotations[i].name.is_none());
        let headings = std::iter::once(plain).chain(named.into_iter().map(|index| vec![index]));
        for indices in headings.filter(|indices| !indices.is_empty()) {
            let count = indices.iter().map(|&i| annotations[i].polylines().count()).sum();
            let (first, units) = (indices[0], app.editor.session().site.units);
            let guess = |line: &[Pixel]| planes::estimated_line_length(app.editor.session(), line);
            group(ui, units, &annotations[first], first, (letter, count), guess, &mut requests);
            letter = char::from_u32(letter as u32 + 1).filter(char::is_ascii_lowercase).unwrap_or('z');
            for index in indices {
                let annotation = &annotations[index];
                for (segment, line) in annotation.polylines().enumerate() {
                    let line = Line { annotation: index, segment, points: &line, sigma, off: annotation.off };
                    line_row(app, ui, &annotations, &line, &mut requests);
                    if row.constraint == ConstraintKind::StraightEdge {
                        point_rows(app, ui, &line);
                    }
                }
                if is_selected(app, index) {
                    let changed = sigmas::fields(ui, annotation, usual);
                    requests.extend(changed.map(|changed| RowRequest::Sigmas(index, Box::new(changed))));
                }
            }
        }
    }
    for request in requests {
        apply_request(app, request);
    }
}

fn group(
    ui: &mut Ui,
    units: Units,
    annotation: &Annotation,
    index: usize,
    (letter, count): (char, usize),
    guess: impl Fn(&[Pixel]) -> Option<f64>,
    requests: &mut Vec<RowRequest>,
) {
    let palette = theme::palette(ui.ctx());
    let row = annotation.kind.row();
    let icon =
        TOOLS.iter().find(|tool| tool.kind == Some(row.kind)).map_or(Icon::Vertical, |tool| tool.icon.into());
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        icons::inline(ui, icon, theme::kind_icon(row.kind, ui.visuals().dark_mode));
        let name = annotation.name.clone().unwrap_or_else(|| {
            if row.has_letter { format!("{} {letter}", row.title) } else { row.title.to_owned() }
        });
        ui.label(RichText::new(name).font(theme::medium(12.0)));
        ui.label(RichText::new(count.to_string()).color(palette.text3));
        if annotation.at_right_angles_to.is_some() {
            ui.label(RichText::new("right angle").color(palette.text2))
                .on_hover_text("At right angles to another direction");
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if row.has_length || row.constraint == ConstraintKind::Upright {
                requests.extend(
                    usual_size_menu(ui, units, annotation).map(|chosen| RowRequest::Usual(index, chosen)),
                );
            }
            if annotation.like.is_some() {
                return;
            }
            if row.has_length && !annotation.off {
                let mut value = annotation.length_m.unwrap_or(1.0);
                if length(ui, units, &mut value, "Known length") {
                    requests.push(RowRequest::Length(index, value));
                }
            } else if let Some(height) =
                annotation.height_m.filter(|_| !row.has_length && !waits_for_height(annotation))
            {
                let mut value = height.value;
                if length(ui, units, &mut value, "Height of the upright") {
                    requests.push(RowRequest::Height(index, value));
                }
            }
        });
    });
    requests.extend(requested_size(ui, units, annotation, index, guess));
}

/// Shows a field for the size of an annotation that is off until its size is entered. Returns the request with the
/// entered size.
fn requested_size(
    ui: &mut Ui,
    units: Units,
    annotation: &Annotation,
    index: usize,
    guess: impl Fn(&[Pixel]) -> Option<f64>,
) -> Option<RowRequest> {
    let row = annotation.kind.row();
    let waits_for_length = row.has_length && annotation.off;
    if annotation.like.is_some() || !waits_for_length && !waits_for_height(annotation) {
        return None;
    }
    let (palette, requested) = (theme::palette(ui.ctx()), Some(RequestedField::Size(index)));
    ui.horizontal(|ui| {
        ui.add_space(24.0);
        if waits_for_length {
            let estimate = annotation.polylines().next().and_then(|line| guess(&line));
            let label = ui.label(RichText::new("measured").color(palette.text2));
            let entered = empty_field(ui, ("length", index), label.id, units, estimate, requested);
            entered.map(|metres| RowRequest::Length(index, metres))
        } else {
            let label = ui.label(RichText::new("height").color(palette.text2));
            let entered = empty_field(ui, ("height", index), label.id, units, None, requested);
            entered.map(|metres| RowRequest::Height(index, metres))
        }
    })
    .inner
}

fn length(ui: &mut Ui, units: Units, value: &mut f64, tip: &str) -> bool {
    ui.add(length_field(units, value, 0.01)).on_hover_text(tip).changed()
}

struct Line<'a> {
    annotation: usize,
    segment: usize,
    points: &'a [Pixel],
    sigma: f64,
    off: bool,
}

fn line_row(
    app: &mut App,
    ui: &mut Ui,
    annotations: &[Annotation],
    line: &Line<'_>,
    requests: &mut Vec<RowRequest>,
) {
    let palette = theme::palette(ui.ctx());
    let (index, segment) = (line.annotation, line.segment);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 19.0), Sense::click());
    let name = line_name(annotations, index, segment);
    let part = Part::Line { annotation: index, segment };
    let selected = app.editor.session().selection.contains(&part);
    let residual = app.editor.session().solution().and_then(|solution| {
        solution.residuals.iter().find(|r| r.annotation == Some(index) && r.segment == Some(segment)).cloned()
    });
    let suspect = residual.as_ref().is_some_and(|r| r.outlier);
    let label = format!("Line {name}");
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, selected, &label));
    if response.hovered() {
        app.hover.lit = Some((index, segment));
    }
    if selected {
        ui.painter().rect_filled(rect, 0.0, palette.accent_bg);
    } else if suspect {
        let since = ui.input(|i| i.time) - app.hover.suspect_since;
        let lit = crate::paint::is_lit(ui.ctx(), since);
        ui.painter().rect_filled(rect, 0.0, palette.bad_bg.gamma_multiply(if lit { 1.0 } else { 0.4 }));
    } else if response.hovered() {
        ui.painter().rect_filled(rect, 0.0, palette.raised);
    }
    if response.clicked() {
        requests.push(RowRequest::Select(index, segment, ui.input(|i| i.modifiers.command)));
    }
    let text = match (suspect, line.off) {
        (true, _) => palette.bad,
        (false, true) => palette.text3,
        (false, false) => palette.text,
    };
    let y = rect.center().y;
    let painter = ui.painter();
    painter.text(egui::pos2(rect.left() + 24.0, y), Align2::LEFT_CENTER, &name, theme::medium(12.0), text);
    let length: f64 = line.points.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    let about = if suspect { "rejected".to_owned() } else { format!("{length:.0} px") };
    let px = residual
        .as_ref()
        .map_or_else(String::new, |residual| format!(", residual {:.1} px", residual.px.abs()));
    describe(&response, &format!("{about}{px}"));
    painter.text(
        egui::pos2(rect.left() + 64.0, y),
        Align2::LEFT_CENTER,
        about,
        theme::regular(11.0),
        palette.text3,
    );
    if let Some(residual) = residual {
        residual_cell(ui, rect, residual.px.abs(), line.sigma);
    }
    if switch(ui, rect, &name, !line.off) {
        requests.push(RowRequest::Toggle(index));
    }
}

/// Paints a residual in pixels at the right end of a row, with its bar. `sigma` is the standard deviation of a click,
/// in pixels.
fn residual_cell(ui: &Ui, rect: Rect, px: f64, sigma: f64) {
    let palette = theme::palette(ui.ctx());
    bar(ui, rect, px / sigma);
    let text = if px < 100.0 { format!("{px:.1}") } else { format!("{px:.0}") };
    let at = egui::pos2(rect.right(), rect.center().y);
    ui.painter().text(at, Align2::RIGHT_CENTER, text, theme::regular(12.0), palette.text);
}

/// Whether a line or a vertex of an annotation is selected.
fn is_selected(app: &App, index: usize) -> bool {
    let is_own = |part: &Part| match *part {
        Part::Line { annotation, .. } | Part::Vertex { annotation, .. } => annotation == index,
        _ => false,
    };
    app.editor.session().selection.iter().any(is_own)
}

/// Shows the deviation of every point of the selected straight edge from a straight line, in pixels of the
/// undistorted image. A large deviation identifies a misplaced point.
fn point_rows(app: &App, ui: &mut Ui, line: &Line<'_>) {
    let session = app.editor.session();
    let is_own = |part: &Part| match *part {
        Part::Line { annotation, segment } | Part::Vertex { annotation, segment, .. } => {
            (annotation, segment) == (line.annotation, line.segment)
        }
        _ => false,
    };
    if line.points.len() < 3 || !session.selection.iter().any(is_own) {
        return;
    }
    let Some(off) = session.pose().and_then(|pose| straightness(&pose.lens, line.points)) else { return };
    let palette = theme::palette(ui.ctx());
    ui.horizontal_wrapped(|ui| {
        ui.add_space(64.0);
        for (index, px) in off.into_iter().enumerate() {
            let text =
                RichText::new(number(px, 1)).small().color(theme::residual(palette, px.abs() / line.sigma));
            let label = ui.label(text);
            let words = format!("Point {} is {} px off the straight line", index + 1, number(px.abs(), 1));
            label.widget_info(|| WidgetInfo::labeled(Role::Label, true, &words));
            label.on_hover_text(words);
        }
    });
}

/// Shows the checkbox of a line; returns whether it was clicked.
fn switch(ui: &mut Ui, row: Rect, name: &str, mut on: bool) -> bool {
    let place = Rect::from_min_size(row.min + Vec2::new(2.0, 1.0), Vec2::new(18.0, 17.0));
    let check = ui.put(place, egui::Checkbox::without_text(&mut on));
    check.widget_info(|| WidgetInfo::selected(Role::CheckBox, true, on, format!("Use {name}")));
    check.changed()
}

/// Paints a bar proportional to a residual divided by its sigma, with a tick at three sigmas.
fn bar(ui: &Ui, row: Rect, over_sigma: f64) {
    /// Width of the complete bar, in points.
    const BAR_WIDTH: f32 = 44.0;
    /// Residual at which the bar is complete, in sigmas.
    const MAX_BAR_SIGMAS: f64 = 4.2;
    let palette = theme::palette(ui.ctx());
    let right = row.right() - 40.0;
    let back = Rect::from_min_max(
        egui::pos2(right - BAR_WIDTH, row.center().y - 4.0),
        egui::pos2(right, row.center().y + 4.0),
    );
    ui.painter().rect_filled(back, 1.0, palette.bg);
    let share = (over_sigma / MAX_BAR_SIGMAS).clamp(0.0, 1.0) as f32;
    let filled = Rect::from_min_size(back.min, Vec2::new(share * BAR_WIDTH, back.height()));
    ui.painter().rect_filled(filled, 1.0, theme::residual(palette, over_sigma));
    let tick = back.left() + (3.0 / MAX_BAR_SIGMAS) as f32 * BAR_WIDTH;
    ui.painter().vline(tick, back.y_range(), egui::Stroke::new(1.0, palette.text2));
}

/// Standard deviation of a typed height of a person or post, in metres.
const TYPED_HEIGHT_SIGMA_M: f64 = 0.03;

/// Sends the actions of a request to the editor.
fn apply_request(app: &mut App, request: RowRequest) {
    app.send(Action::CancelGesture);
    let drawn = |index: usize| app.editor.session().entry()?.annotations.get(index).cloned();
    let action = match request {
        RowRequest::Select(annotation, segment, true) => {
            Some(Action::SelectMore(Part::Line { annotation, segment }))
        }
        RowRequest::Select(annotation, segment, false) => {
            Some(Action::Select(Part::Line { annotation, segment }))
        }
        RowRequest::Toggle(index) => {
            let name = app.editor.session().part_name(Part::Line { annotation: index, segment: 0 });
            drawn(index).filter(|annotation| !waits_for_height(annotation)).map(|annotation| {
                let off = !annotation.off;
                annotate(index, Annotation { off, ..annotation }, &format!("switch {name} on or off"))
            })
        }
        RowRequest::Length(index, value) => drawn(index).map(|annotation| {
            let measured = Annotation { length_m: Some(value), off: false, ..annotation };
            annotate(index, measured, "enter a known length")
        }),
        RowRequest::Usual(index, chosen) => drawn(index)
            .map(|annotation| annotate(index, with_size(annotation, &chosen), "choose a usual size")),
        RowRequest::Sigmas(index, annotation) => {
            Some(annotate(index, *annotation, "change the accuracy of an annotation"))
        }
        RowRequest::Height(index, value) => drawn(index).map(|annotation| {
            let known = annotation.height_m.filter(|_| !waits_for_height(&annotation));
            let height =
                known.map_or(Known::prior(value, TYPED_HEIGHT_SIGMA_M), |known| Known { value, ..known });
            let off = annotation.off && known.is_some();
            let measured = Annotation { height_m: Some(height), off, ..annotation };
            annotate(index, measured, "enter the height of an upright")
        }),
    };
    action.into_iter().for_each(|action| app.send(action));
}

/// Returns the annotation with the chosen size, switched on. The size replaces every earlier size.
fn with_size(annotation: Annotation, chosen: &SizeChoice) -> Annotation {
    let bare = Annotation { like: None, length_m: None, height_m: None, off: false, ..annotation };
    match chosen {
        SizeChoice::Like(usual) => Annotation { like: Some(usual.id.to_owned()), ..bare },
        SizeChoice::Measured(known) if bare.kind.row().has_length => {
            Annotation { length_m: Some(known.value), ..bare }
        }
        SizeChoice::Measured(known) => Annotation { height_m: Some(*known), ..bare },
    }
}

/// Creates the action that replaces an annotation; `name` is its name in the undo history.
fn annotate(index: usize, annotation: Annotation, name: &str) -> Action {
    Action::Annotate { index, annotation: Box::new(annotation), name: name.to_owned() }
}
