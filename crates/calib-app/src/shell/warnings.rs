//! Panels with the warnings of a result, buttons that act on the warnings, and the age of every calibration.

use calib_core::{Code, Finding, Severity, Subject};
use calib_editor::{Action, Part, site_subject, valid_since};
use calib_site::{PixelAspectEntry, SceneEntry, SiteCamera, Warning, usual_pixel_aspect};
use egui::{RichText, Ui};

use crate::annotate::sigmas::{GROUND_ANSWERS, set_scene};
use crate::command::Command;
use crate::compare::panel::verdict;
use crate::icons::{self, Icon};
use crate::keys;
use crate::state::{App, Mode};
use crate::storage::autosave::ago;
use crate::theme;
use crate::widgets::announce;
use crate::widgets::heading;

/// Shows every camera with the age of its calibration and the comparison result of its newest image.
pub(crate) fn health_ui(app: &mut App, ui: &mut Ui) {
    let count = app.editor.site().cameras.len();
    let compared = (0..count).filter(|&camera| app.editor.newer(camera).is_some()).count();
    heading(ui, "Calibrations", &format!("{compared} of {count} compared"));
    for camera in 0..count {
        row(app, ui, camera);
    }
}

/// Shows a camera; a click selects the camera and shows its image.
fn row(app: &mut App, ui: &mut Ui, camera: usize) {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.site().cameras.get(camera) else { return };
    let name = name(entry);
    let (word, colour) = match app.editor.newer(camera) {
        Some(newer) => {
            let (word, _, colour, _) = verdict(newer.comparison.change, palette);
            (word, colour)
        }
        None => ("no newer image", palette.text3),
    };
    let mut wanted = false;
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 8.0;
        wanted = ui.link(RichText::new(name).font(theme::medium(12.0))).clicked();
        ui.label(RichText::new(age(app, camera)).color(palette.text2));
        ui.label(RichText::new(word).color(colour));
    });
    if wanted {
        app.send(Action::CancelGesture);
        app.send(Action::SelectCamera(camera));
        app.view.mode = Mode::Image;
    }
}

/// Returns the name of a camera period, with the end date if the period has ended.
fn name(entry: &SiteCamera) -> String {
    match &entry.valid_to {
        Some(to) => format!("{} until {}", entry.id, to.get(..10).unwrap_or(to)),
        None => entry.id.clone(),
    }
}

/// Returns the age of a calibration as text, from the start of its period or the time of its image.
fn age(app: &App, camera: usize) -> String {
    let known = valid_since(app.editor.session(), camera);
    known.map_or_else(|| "age unknown".into(), |since| format!("from {}", ago(since, (app.clock)())))
}

/// Shows the warnings of the current camera; the most severe is open, the others are folded.
pub(crate) fn warnings_ui(app: &mut App, ui: &mut Ui) {
    let warnings = sorted_warnings(app);
    let mut request = None;
    let is_open = ui.scope_id().with("more warnings");
    let mut shows_all = ui.data(|data| data.get_temp::<bool>(is_open)).unwrap_or(false);
    let first = warnings.len().min(1);
    for warning in warnings.iter().take(if shows_all { warnings.len() } else { first }) {
        let message = app.editor.session().warning_text(app.editor.session().camera, warning);
        let shown = Warning { message, ..warning.clone() };
        card(ui, &shown, |ui| buttons(app, ui, warning, &mut request));
    }
    if warnings.len() > 1 {
        let more = format!("Show {} more", warnings.len() - 1);
        if ui.button(if shows_all { "Show only the first" } else { &more }).clicked() {
            shows_all = !shows_all;
            ui.data_mut(|data| data.insert_temp(is_open, shows_all));
        }
    }
    let shared = rejected_observations(app);
    for (warning, part) in &shared {
        card(ui, warning, |ui| part_buttons(ui, *part, &mut request));
    }
    if warnings.is_empty() && shared.is_empty() && app.editor.session().solution().is_some() {
        let palette = theme::palette(ui.ctx());
        ui.horizontal(|ui| {
            icons::inline(ui, Icon::Check, palette.ok);
            ui.label(RichText::new("No warnings").color(palette.text2));
        });
    }
    if let Some(action) = request {
        run_action(app, action);
    }
}

/// Returns the warnings about rejected link observations of the current camera, with the observations.
fn rejected_observations(app: &App) -> Vec<(Warning, Part)> {
    let session = app.editor.session();
    let (Some(report), Some(entry)) = (session.solved.joint_report(), session.entry()) else {
        return Vec::new();
    };
    let here = |warning: &Warning| {
        let Subject::Link(link) = site_subject(&session.site, report, warning)? else { return None };
        let seen = session.site.links.get(link)?.seen.iter().position(|seen| seen.camera == entry.id)?;
        Some((warning.clone(), Part::Link { link, seen, point: 0 }))
    };
    let outliers = report.site.warnings.iter().filter(|warning| warning.code == Code::Outlier);
    outliers.filter_map(here).collect()
}

/// Shows the buttons for a rejected line or link observation.
fn part_buttons(ui: &mut Ui, part: Part, request: &mut Option<WarningAction>) {
    ui.horizontal_wrapped(|ui| {
        if ui.button("Show").on_hover_text("Zoom to the item").clicked() {
            *request = Some(WarningAction::Show(Location::Part(part)));
        }
        let buttons = [
            ("Use anyway", Command::UseAnyway, "Use the item although it does not fit the others"),
            ("Delete", Command::Delete, "Delete the item"),
        ];
        for (text, command, tip) in buttons {
            if ui.button(text).on_hover_text(tip).clicked() {
                *request = Some(WarningAction::OnPart(command, part));
            }
        }
    });
}

/// Returns the warnings of the current camera, the most severe first.
fn sorted_warnings(app: &App) -> Vec<Warning> {
    let solution = app.editor.session().solution();
    let mut warnings = solution.map(|solution| solution.warnings.clone()).unwrap_or_default();
    warnings.sort_by_key(|warning| std::cmp::Reverse(warning.code.severity()));
    warnings
}

/// Carries out the action of a button.
fn run_action(app: &mut App, action: WarningAction) {
    app.send(Action::CancelGesture);
    match action {
        WarningAction::Show(Location::Part(part)) => {
            app.send(Action::Select(part));
            app.reveal(part);
        }
        WarningAction::Show(Location::View(command)) | WarningAction::Run(command) => {
            app.send_command(command);
        }
        WarningAction::OnPart(command, part) => {
            app.send(Action::Select(part));
            app.send_command(command);
        }
        WarningAction::SetPixelAspect(value) => {
            let aspect = Some(PixelAspectEntry::Known(value));
            app.change_lens("enter the pixel aspect", |lens| lens.pixel_aspect = aspect);
        }
        WarningAction::SetScene(scene) => set_scene(app, scene),
    }
}

/// Shows the warnings of the joint solve of the site.
pub(crate) fn site(app: &mut App, ui: &mut Ui) {
    let session = app.editor.session();
    let Some(report) = session.solved.joint_report() else { return };
    let mut request = None;
    for warning in &report.site.warnings {
        card(ui, warning, |ui| {
            if ui.button("Show").clicked() {
                request = Some(site_subject(&session.site, report, warning));
            }
        });
    }
    if let Some(subject) = request {
        show_subject(app, subject);
    }
}

/// Selects the subject of a site warning, and shows all cameras.
fn show_subject(app: &mut App, subject: Option<Subject>) {
    let site = app.editor.site();
    let camera_of = |id: &str| site.cameras.iter().position(|camera| camera.id == id);
    let first = |link: usize| site.links.get(link).and_then(|link| camera_of(&link.seen.first()?.camera));
    let action = match subject {
        Some(Subject::Link(link)) => {
            first(link).map(|camera| Action::SelectOn(camera, Part::Link { link, seen: 0, point: 0 }))
        }
        Some(Subject::Mark(mark)) => Some(Action::Select(Part::Mark(mark))),
        Some(Subject::Camera(camera)) => Some(Action::SelectCamera(camera)),
        _ => None,
    };
    app.send(Action::CancelGesture);
    app.send_command(Command::ViewAll);
    action.into_iter().for_each(|action| app.send(action));
}

/// Shows a warning with its advice, and more widgets below.
fn card(ui: &mut Ui, warning: &Warning, more: impl FnOnce(&mut Ui)) {
    let palette = theme::palette(ui.ctx());
    let (fill, colour) = match warning.code.severity() {
        Severity::Error => (palette.bad_bg, palette.bad),
        Severity::Warning => (palette.warn_bg, palette.warn),
        Severity::Note => (palette.raised, palette.warn),
    };
    egui::Frame::NONE.fill(fill).corner_radius(4).inner_margin(8).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.horizontal_top(|ui| {
            icons::inline(ui, Icon::Warn, colour);
            ui.vertical(|ui| {
                ui.label(RichText::new(&warning.message).font(theme::medium(12.0)));
                ui.label(RichText::new(&warning.advice).color(palette.text2));
                more(ui);
            });
        });
    });
    ui.add_space(4.0);
}

/// Location that shows the subject of a warning.
#[derive(Clone, Copy)]
enum Location {
    Part(Part),
    View(Command),
}

/// Action that the operator requests with a button of a warning.
#[derive(Clone, Copy)]
enum WarningAction {
    Show(Location),
    Run(Command),
    OnPart(Command, Part),
    SetPixelAspect(f64),
    SetScene(Option<SceneEntry>),
}

/// Shows the buttons of a warning.
fn buttons(app: &App, ui: &mut Ui, warning: &Warning, request: &mut Option<WarningAction>) {
    let place = location_of(app, warning);
    if let (Code::Outlier, Location::Part(part)) = (warning.code, place) {
        return part_buttons(ui, part, request);
    }
    ui.horizontal_wrapped(|ui| {
        if ui.button("Show").clicked() {
            *request = Some(WarningAction::Show(place));
        }
        for (text, tip, answer) in answers(app, warning.code) {
            if ui.button(text).on_hover_text(tip).clicked() {
                *request = Some(answer);
            }
        }
        match (warning.code, place) {
            (Code::FocalUnobservable | Code::Weak | Code::Unusable | Code::TwoSolutions, _)
                if app.is_enabled(Command::TakeSuggestion) =>
            {
                let buttons = [
                    ("Show the suggestion   N", Command::TakeSuggestion),
                    ("Another suggestion   Shift+N", Command::DismissSuggestion),
                ];
                for (text, command) in buttons {
                    if ui.button(keys::shown(ui.ctx(), text)).clicked() {
                        *request = Some(WarningAction::Run(command));
                    }
                }
            }
            _ => {}
        }
    });
}

/// Returns the answers to the question of a warning, with the text and the tooltip of each button.
fn answers(app: &App, code: Code) -> Vec<(String, &'static str, WarningAction)> {
    let size = app.editor.session().entry().map(|entry| entry.size_px);
    match (code, size.and_then(usual_pixel_aspect)) {
        (Code::PixelsNotSquare, Some(usual)) => vec![
            (
                format!("Pixel aspect {usual:.3}"),
                "The recorder has stretched the image: objects look too wide or too narrow",
                WarningAction::SetPixelAspect(usual),
            ),
            (
                "Square pixels".into(),
                "Objects in the image have their true shape",
                WarningAction::SetPixelAspect(1.0),
            ),
        ],
        (Code::FloorSlope, _) => {
            GROUND_ANSWERS.map(|(text, scene, tip)| (text.into(), tip, WarningAction::SetScene(scene))).into()
        }
        _ => Vec::new(),
    }
}

/// Returns the location that shows the subject of a warning.
fn location_of(app: &App, warning: &Warning) -> Location {
    let session = app.editor.session();
    let entry = session.entry();
    let line = |annotation, segment| Location::Part(Part::Line { annotation, segment });
    let lens = || entry.and_then(|entry| entry.annotations.iter().position(|a| a.is_straight_edge()));
    let subject = session.solved.finding(&session.site, session.camera, warning).map(Finding::subject);
    let found = match subject {
        Some(Subject::Line(source)) => Some(line(source.annotation, source.segment)),
        Some(Subject::Annotation(index)) => Some(line(index, 0)),
        Some(Subject::OwnControlPoint(point) | Subject::ControlPoint { point, .. }) => {
            Some(Location::Part(Part::Control(point)))
        }
        Some(Subject::Efov) => Some(Location::Part(Part::Field)),
        Some(Subject::Placement) => Some(Location::View(Command::ViewPlan)),
        Some(Subject::Link(_) | Subject::Mark(_) | Subject::Distance(_) | Subject::Camera(_)) => {
            Some(Location::View(Command::ViewAll))
        }
        Some(Subject::Lens) => lens().map(|index| line(index, 0)),
        _ => None,
    };
    let suspect = || first_outlier(app).filter(|_| warning.code == Code::Outlier).map(Location::Part);
    let worst = || worst_line(app).map(Location::Part);
    found.or_else(suspect).or_else(worst).unwrap_or(Location::View(Command::ViewImage))
}

/// Returns the line of the current camera with the largest residual in pixels.
fn worst_line(app: &App) -> Option<Part> {
    let residuals = app.editor.session().solution()?.residuals.iter();
    let lines =
        residuals.filter_map(|residual| Some((residual.px.abs(), residual.annotation?, residual.segment?)));
    let (_, annotation, segment) = lines.max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Part::Line { annotation, segment })
}

/// Returns the first rejected line of the current camera.
fn first_outlier(app: &App) -> Option<Part> {
    let residual = app.editor.session().solution()?.residuals.iter().find(|r| r.outlier)?;
    Some(Part::Line { annotation: residual.annotation?, segment: residual.segment? })
}

/// Shows the current error of the document, with a button that closes it.
pub(crate) fn error(app: &mut App, ui: &mut Ui) {
    let Some(error) = app.editor.error().map(str::to_owned) else { return };
    let palette = theme::palette(ui.ctx());
    let (mut close, mut save) = (false, false);
    egui::Frame::NONE.fill(palette.bad_bg).inner_margin(12).show(ui, |ui| {
        ui.set_width(ui.available_width());
        announce(&ui.label(RichText::new(error).color(palette.bad)), true);
        ui.horizontal(|ui| {
            close = ui.button("Close").clicked();
            save = !app.editor.session().is_saved() && ui.button("Save the site").clicked();
        });
    });
    if save {
        app.send_command(Command::Save);
    }
    if close {
        app.send(Action::CloseError);
    }
}
