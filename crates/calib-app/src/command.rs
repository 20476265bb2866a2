//! Commands. Document commands are sent to the editor, view commands are carried out here.

use calib_editor::command::{
    Files, Gesture, Group, Newer, Nudge, Proposing, Selection, Solving, Switch, View,
};
use calib_editor::{Action, CalibrationDecision, NewerAction, Pane, Period};
use egui::{Context, Modifiers, Vec2};

pub use calib_editor::Command;
pub use calib_editor::command::{COMMANDS, Row, all};

use crate::choice::Purpose;
use crate::state::{App, Looking, Mode, Orbit, Tour};

/// Whether a command has an effect now.
#[must_use]
pub fn is_enabled(app: &App, command: Command) -> bool {
    app.is_enabled(command)
}

/// Returns the current label of a command. The label of undo names the change that undo would revert.
#[must_use]
pub fn words(app: &App, command: Command) -> String {
    app.editor.command_text(command)
}

/// Runs a command if it has an effect now. Buttons, menus and keys all run their commands here.
pub fn run(app: &mut App, ctx: &Context, command: Command, modifiers: Modifiers) {
    if !app.is_enabled(command) {
        return;
    }
    match command.group() {
        Group::Tool(index) => {
            // The focused widget loses the focus, so that keys go to the tool.
            ctx.memory_mut(|memory| memory.focused().into_iter().for_each(|id| memory.surrender_focus(id)));
            app.act(Action::SelectTool(index));
        }
        Group::Files(command) => on_files(app, ctx, command),
        // Escape closes sheets first.
        Group::Gesture(Gesture::Cancel) if app.close_sheets() => {}
        Group::Gesture(Gesture::Cancel) if app.decides_proposal(ctx) => {
            app.act(Action::DecideCalibration(CalibrationDecision::Dismiss));
        }
        Group::Gesture(Gesture::Accept) if app.decides_proposal(ctx) => {
            app.act(Action::DecideCalibration(CalibrationDecision::AcceptAll));
        }
        Group::Gesture(command) => app.act(Action::Gesture(command)),
        Group::Selection(command) => on_selection(app, command),
        Group::Nudge(step) => nudge(app, step, modifiers.shift),
        Group::Lines(command) => app.act(Action::Lines(command)),
        Group::Proposing(Proposing::Propose) => app.propose(),
        Group::Proposing(Proposing::CalibrateAll) => app.calibrate_all(),
        Group::Newer(command) => on_newer(app, ctx, command),
        Group::Proposing(command) => app.act(Action::Proposing(command)),
        Group::View(command) => on_view(app, command),
        Group::Cameras(command) => app.act(Action::Cameras(command)),
        Group::Solving(command) => on_solving(app, ctx, command),
        Group::Switch(command) => switch(app, ctx, command),
    }
}

fn on_files(app: &mut App, ctx: &Context, command: Files) {
    app.act(Action::CancelGesture);
    match command {
        Files::NewSite => app.open_site(calib_site::Site::new(), calib_editor::Images::default(), None),
        Files::Demo => open_demonstration(app, false),
        Files::Tour => open_demonstration(app, true),
        Files::Save if app.editor.session().path.is_some() => app.save(),
        Files::Save | Files::SaveAs => app.open_dialog(Purpose::SaveSite),
        Files::SavePlain => app.open_dialog(Purpose::SavePlain),
        Files::Open => app.open_dialog(Purpose::Open),
        Files::AddImages => app.open_dialog(Purpose::AddImages),
        Files::AddFromAddress => {
            app.dialogs.address.get_or_insert_default();
        }
        Files::LoadPlan => app.open_dialog(Purpose::LoadPlan),
        Files::ReplaceStill => {
            app.jobs.replaced = app.editor.session().entry().map(Period::from_camera).unwrap_or_default();
            app.open_dialog(Purpose::ReplaceStill);
        }
        Files::Compare => app.open_dialog(Purpose::Compare),
        Files::Import => app.open_dialog(Purpose::Import),
        Files::Export => app.dialogs.export.open(),
        Files::Report => app.open_dialog(Purpose::SaveReport),
        Files::SavePicture => app.take_picture(ctx),
        Files::StopWork => app.stop_work(),
        Files::ReadAgain => {
            app.pictures.retry();
            app.edges.resume();
            app.ask_outside_again();
        }
    }
}

fn on_newer(app: &mut App, ctx: &Context, command: Newer) {
    match command {
        Newer::CompareStill => app.open_dialog(Purpose::NewerStill),
        Newer::NextLook => app.view.glance.showing = app.view.glance.showing.next(),
        Newer::Recover => app.recover_newer(ctx),
        Newer::DismissNewer if app.is_recovering_in_hand() => {
            let note = "The recovery uses this image. Cancel the recovery first.";
            app.act(Action::Note(note.into()));
        }
        Newer::DismissNewer => app.act(Action::Newer(NewerAction::Dismiss)),
    }
}

fn open_demonstration(app: &mut App, with_tour: bool) {
    let (mut site, images, truth) = crate::storage::demo::open_with_truth();
    // In the tour, the newcomer calibrates the first camera.
    if let Some(camera) = site.cameras.first_mut().filter(|_| with_tour) {
        camera.annotations.clear();
        camera.control_points.clear();
        (camera.efov_px, camera.placement) = (None, None);
    }
    app.open_site(site, images, None);
    if with_tour {
        let (marks, links) = (app.editor.site().marks.clone(), app.editor.site().links.len());
        app.tour = Tour::begun(truth, marks, links);
    }
}

fn on_selection(app: &mut App, command: Selection) {
    let image = app.editor.session().entry().and_then(|entry| entry.image.as_deref());
    let still = image.and_then(|image| app.pictures.ready(image)).map(|picture| picture.image.clone());
    app.act(Action::Selection(command, still));
}

fn nudge(app: &mut App, step: Nudge, coarse: bool) {
    let by = match step {
        Nudge::NudgeLeft => Some([-1.0, 0.0]),
        Nudge::NudgeRight => Some([1.0, 0.0]),
        Nudge::NudgeUp => Some([0.0, -1.0]),
        Nudge::NudgeDown => Some([0.0, 1.0]),
        Nudge::TurnLeft | Nudge::TurnRight | Nudge::Grow | Nudge::Shrink => None,
    };
    match by {
        Some(by) if app.view.mode == Mode::Scene => orbit_by(app, by, coarse),
        _ => {
            let on_plan =
                app.view.mode == Mode::Plan && matches!(app.view.panes.active, Some((_, Pane::Plan)));
            app.act(Action::Nudge { step, coarse, pane: on_plan.then_some(Pane::Plan) });
        }
    }
}

/// Orbits or pans the 3-D scene by one press of an arrow key. The effect is that of a short drag in direction
/// `by`.
fn orbit_by(app: &mut App, by: [f32; 2], pans: bool) {
    /// Length of the drag that one press of an arrow key replaces, in points.
    const DRAG_LENGTH: f32 = 12.0;
    if !app.editor.tool().is_idle() {
        app.act(Action::CancelGesture);
    }
    let mut orbit = app.view.orbit.unwrap_or_else(|| Orbit::of(app.editor.session()));
    let by = Vec2::new(-DRAG_LENGTH * by[0], -DRAG_LENGTH * by[1]);
    if pans {
        orbit.pan(by);
    } else {
        orbit.turn(by);
    }
    app.view.orbit = Some(orbit);
}

fn on_view(app: &mut App, command: View) {
    match command {
        View::ViewImage => app.show(Mode::Image),
        View::ViewPlan => app.show(Mode::Plan),
        View::ViewAll => app.show(Mode::All),
        View::ViewScene => app.show(Mode::Scene),
        View::Fit => {
            app.view.panes.views.clear();
            app.view.orbit = None;
        }
        View::Beside => {
            let beside = if app.view.mode == Mode::Scene {
                &mut app.view.beside_scene
            } else {
                &mut app.view.beside_plan
            };
            *beside = !*beside;
        }
        View::ZoomIn => zoom(app, 1.25),
        View::ZoomOut => zoom(app, 0.8),
        View::NextWindow => next_window(app),
    }
}

fn next_window(app: &mut App) {
    if app.is_fisheye(app.editor.session().camera) {
        app.show(Mode::Image);
        app.look(app.view.looking.next());
    } else {
        app.act(Action::Note("Fisheye windows need a fisheye lens. This camera does not have one.".into()));
    }
}

fn zoom(app: &mut App, factor: f64) {
    if app.view.mode == Mode::Scene {
        let mut orbit = app.view.orbit.unwrap_or_else(|| Orbit::of(app.editor.session()));
        orbit.zoom(factor);
        app.view.orbit = Some(orbit);
        return;
    }
    let key = app.zoom_key();
    if let Some(mapping) = app.view.panes.mapping(key.0, key.1) {
        let over = app.view.panes.cursor.filter(|(pane, _)| *pane == key.1);
        let at = over.map_or_else(|| mapping.rect.center(), |(_, at)| mapping.screen(at));
        let fitted = app.view.panes.fitted_zoom(key);
        app.view.panes.views.insert(key, mapping.zoomed(at, factor, fitted));
    }
}

fn on_solving(app: &mut App, ctx: &Context, command: Solving) {
    app.act(Action::CancelGesture);
    match command {
        Solving::Pause => app.act(Action::TogglePause),
        Solving::Refine => app.refine(ctx),
        Solving::CompareBefore => app.view.show_before = !app.view.show_before,
        Solving::FixPlacement => app.act(Action::TogglePlacementFixed),
        Solving::ResetPlacement => app.act(Action::RemovePlacement),
    }
}

fn switch(app: &mut App, ctx: &Context, command: Switch) {
    if command == Switch::Straighten && app.is_fisheye(app.editor.session().camera) {
        // The undistorted view and a fisheye window exclude each other, so the window is left.
        app.look(Looking::Whole);
    }
    let layers = &mut app.view.layers;
    let switch = match command {
        Switch::HideOverlays => &mut layers.hidden,
        Switch::Grid => &mut layers.grid,
        Switch::Edges => &mut layers.edges,
        Switch::Straighten => &mut layers.straight,
        Switch::Horizon => &mut layers.horizon,
        Switch::Field => &mut layers.field,
        Switch::Prism => &mut layers.prism,
        Switch::Guide => &mut layers.guide,
        Switch::ColourByResidual => &mut layers.by_residual,
        Switch::Above => &mut app.view.above,
        Switch::Coverage => &mut app.view.coverage,
        Switch::Blend => &mut app.view.blend,
        Switch::Magnify => &mut app.view.magnified,
        Switch::Shortcuts => &mut app.dialogs.shortcuts,
        Switch::About => &mut app.dialogs.about,
        Switch::Snap => return app.act(Action::ToggleSnap),
        Switch::Feet => return app.act(Action::ToggleUnits),
        Switch::Palette => return app.dialogs.palette.toggle(),
        Switch::Theme => {
            return ctx.set_theme(match ctx.theme() {
                egui::Theme::Dark => egui::Theme::Light,
                egui::Theme::Light => egui::Theme::Dark,
            });
        }
    };
    *switch = !*switch;
}
