//! What each command does, group by group; only [`crate::command::run`] calls these.

use std::collections::BTreeSet;

use crate::app::{App, Mode};
use crate::command::{Command, Told};
use crate::dialog::Purpose;
use crate::hit::Part;
use crate::scene3d::Orbit;
use crate::tools::Pane;
use crate::{edit, snap};
use calib_core::{Kind, Known, Site};

pub(crate) fn take_tool(app: &mut App, Told { command, .. }: Told<'_>) {
    if let Command::Tool(index) = command {
        app.take_tool(index);
    }
}

pub(crate) fn switch(app: &mut App, Told { command, ctx, .. }: Told<'_>) {
    use Command as C;
    let layers = &mut app.layers;
    let switch = match command {
        C::Grid => &mut layers.grid,
        C::Edges => &mut layers.edges,
        C::Straighten => &mut layers.straight,
        C::Horizon => &mut layers.horizon,
        C::Field => &mut layers.field,
        C::Prism => &mut layers.prism,
        C::Guide => &mut layers.guide,
        C::ColourByResidual => &mut layers.by_residual,
        C::HideOverlays => &mut layers.hidden,
        C::Above => &mut app.above,
        C::Coverage => &mut app.coverage,
        C::Blend => &mut app.blend,
        C::Snap => &mut app.session.snap,
        C::Shortcuts => &mut app.shortcuts,
        C::About => &mut app.about,
        C::Palette => return app.palette.toggle(),
        C::Feet => return app.session.units = app.session.units.other(),
        _ => {
            return ctx.set_theme(match ctx.theme() {
                egui::Theme::Dark => egui::Theme::Light,
                egui::Theme::Light => egui::Theme::Dark,
            });
        }
    };
    *switch = !*switch;
}

pub(crate) fn gesture(app: &mut App, told: Told<'_>) {
    match told.command {
        // What is in the hand is taken back first.
        Command::Undo | Command::Redo if !app.tool.is_idle() => app.cancel(),
        Command::Undo => app.session.undo(),
        Command::Redo => app.session.redo(),
        Command::Accept => app.tool.accept(&mut app.session),
        Command::StepBack => {
            if !app.tool.step_back(&mut app.session) {
                on_selection(app, Told { command: Command::Delete, ..told });
            }
        }
        _ if app.close_sheets() => {}
        _ if app.tool.is_idle() => {
            app.session.selection.clear();
            app.take_tool(0);
        }
        _ => app.cancel(),
    }
    app.session.solve();
}

pub(crate) fn on_selection(app: &mut App, Told { command, .. }: Told<'_>) {
    app.cancel();
    let session = &mut app.session;
    let (camera, name) = (session.camera, session.selection_name());
    let parts = session.selection.clone();
    match command {
        Command::Delete if !parts.is_empty() => {
            edit::delete(&mut session.site, camera, &parts);
            session.selection.clear();
            session.commit(format!("delete {name}"));
        }
        Command::Duplicate => {
            let Some(entry) = session.site.cameras.get_mut(camera) else { return };
            let aside = 0.02 * entry.size()[0];
            session.selection = edit::duplicate(entry, &parts, [aside, 0.0]);
            session.commit(format!("duplicate {name}"));
        }
        Command::OnOff => flags(app, &parts, &format!("switch {name} on or off"), |off, _| *off = !*off),
        Command::UseAnyway => {
            flags(app, &parts, &format!("use {name} anyway"), |off, keep| (*off, *keep) = (false, true));
        }
        Command::SelectAll => {
            session.selection =
                crate::hit::handles(&session.site, camera).into_iter().map(|(part, _)| part).collect();
        }
        Command::Deselect => session.selection.clear(),
        Command::PullOntoEdge => pull(app, &parts, &name),
        _ => {}
    }
}

/// Changes `off` and `keep` of everything that is selected, each once.
fn flags(app: &mut App, parts: &BTreeSet<Part>, name: &str, change: impl Fn(&mut bool, &mut bool)) {
    let mut seen = BTreeSet::new();
    let site = &mut app.session.site;
    for &part in parts {
        let key = match part {
            Part::Vertex { annotation, .. } | Part::Line { annotation, .. } => (0, annotation),
            Part::Control(index) => (1, index),
            Part::Link { link, .. } => (2, link),
            Part::Pin { mark, .. } | Part::Mark(mark) => (3, mark),
            Part::Corner(_) | Part::Field => continue,
        };
        if !seen.insert(key) {
            continue;
        }
        let entry = site.cameras.get_mut(app.session.camera);
        let pair = match key.0 {
            0 => entry.and_then(|e| e.annotations.get_mut(key.1)).map(|a| (&mut a.off, &mut a.keep)),
            1 => entry.and_then(|e| e.control_points.get_mut(key.1)).map(|p| (&mut p.off, &mut p.keep)),
            2 => site.links.get_mut(key.1).map(|l| (&mut l.off, &mut l.keep)),
            _ => site.marks.get_mut(key.1).map(|m| (&mut m.off, &mut m.keep)),
        };
        if let Some((off, keep)) = pair {
            change(off, keep);
        }
    }
    app.session.commit(name);
}

fn pull(app: &mut App, parts: &BTreeSet<Part>, name: &str) {
    let camera = app.session.camera;
    let still = app.session.entry().and_then(|entry| entry.image.clone());
    let Some(still) = still.and_then(|image| app.pictures.ready(&image).map(|p| p.image.clone())) else {
        app.session.note = Some("The image is not there yet.".into());
        return;
    };
    let pulled = snap::pull_parts(&mut app.session.site, camera, parts, &still);
    app.session.commit(format!("pull {name} onto the edge"));
    app.session.note = Some(match pulled {
        0 => "No edge runs along it.".into(),
        count => format!("{count} pulled onto the edge."),
    });
}

/// Turns or scales the camera in hand about its foot, as its handles on the plan do.
fn turn_or_scale(app: &mut App, Told { command, modifiers, .. }: Told<'_>) {
    app.cancel();
    let session = &mut app.session;
    let camera = session.camera;
    if session.is_held_by_points(camera) {
        session.note = Some("Control points hold this camera; switch them off to move it by hand.".into());
        return;
    }
    let Some(mut placement) = session.placement(camera) else { return };
    let step = if modifiers.shift { 1.0 } else { 0.1 };
    match command {
        Command::TurnLeft => placement.turn += f64::to_radians(step),
        Command::TurnRight => placement.turn -= f64::to_radians(step),
        Command::Grow => placement.scale *= 1.0 + 0.01 * step,
        _ => placement.scale /= 1.0 + 0.01 * step,
    }
    session.place(camera, placement);
    let id = session.site.cameras[camera].id.clone();
    let is_turn = matches!(command, Command::TurnLeft | Command::TurnRight);
    session.commit(format!("{} {id}", if is_turn { "turn" } else { "scale" }));
}

pub(crate) fn nudge(app: &mut App, told: Told<'_>) {
    use Command as C;
    let Told { command, modifiers, .. } = told;
    if matches!(command, C::TurnLeft | C::TurnRight | C::Grow | C::Shrink) {
        return turn_or_scale(app, told);
    }
    let by = match command {
        Command::NudgeLeft => [-1.0, 0.0],
        Command::NudgeRight => [1.0, 0.0],
        Command::NudgeUp => [0.0, -1.0],
        _ => [0.0, 1.0],
    };
    let step = if modifiers.shift { 1.0 } else { 0.1 };
    if !app.tool.is_idle() {
        app.cancel();
    }
    if app.mode == Mode::Scene {
        /// Points of a drag.
        const DRAG: f32 = 12.0;
        let mut orbit = app.orbit.unwrap_or_else(|| Orbit::of(&app.session));
        let by = egui::Vec2::new(-DRAG * by[0] as f32, -DRAG * by[1] as f32);
        if modifiers.shift {
            orbit.pan(by);
        } else {
            orbit.turn(by);
        }
        app.orbit = Some(orbit);
        return;
    }
    let session = &mut app.session;
    let on_plan = app.mode == Mode::Plan && matches!(app.panes.active, Some((_, Pane::Plan)));
    let marks: Vec<usize> = session
        .selection
        .iter()
        .filter_map(|part| if let Part::Mark(mark) = part { Some(*mark) } else { None })
        .collect();
    let name = session.selection_name();
    if !marks.is_empty() {
        // A tenth of a pixel on the image, a centimetre on the floor.
        for index in marks {
            let Some(mark) = session.site.marks.get_mut(index) else { continue };
            mark.at_m.x += 0.1 * step * by[0];
            mark.at_m.y -= 0.1 * step * by[1];
        }
        session.commit(format!("nudge {name}"));
    } else if on_plan && session.selection.is_empty() && !session.is_held_by_points(session.camera) {
        let camera = session.camera;
        let Some(mut placement) = session.placement(camera) else { return };
        placement.by.x += 0.1 * step * by[0];
        placement.by.y -= 0.1 * step * by[1];
        session.place(camera, placement);
        let id = session.site.cameras[camera].id.clone();
        session.commit(format!("nudge {id}"));
    } else if !session.selection.is_empty() {
        let (camera, parts) = (session.camera, session.selection.clone());
        edit::shift(&mut session.site, camera, &parts, by.map(|value| step * value));
        session.commit(format!("nudge {name}"));
    }
}

pub(crate) fn on_lines(app: &mut App, Told { command, .. }: Told<'_>) {
    app.cancel();
    match command {
        Command::NewGroup => {
            app.session.fresh_group = true;
            app.session.note = Some("The next line begins a new group.".into());
        }
        Command::RightAngle => right_angle(app),
        Command::TakeSuggestion => {
            let camera = app.session.camera;
            let Some(next) = app.session.solution().and_then(|s| s.draw_next.clone()) else { return };
            let Some(entry) = app.session.site.cameras.get_mut(camera) else { return };
            let is_new = next.segments_px.len() >= 2 && next.kind != Kind::Vertical;
            let mut parts = BTreeSet::new();
            for (i, segment) in next.segments_px.iter().enumerate() {
                parts.insert(edit::add_line(entry, next.kind, segment.to_vec(), is_new && i == 0));
            }
            app.session.selection = parts;
            app.session.commit("draw the suggested line");
            app.session.note = Some("Now drag its ends onto the real edge.".into());
        }
        Command::TakeSecondSolution => {
            let other = app.session.solution().and_then(|s| s.alternatives.first().cloned());
            let Some(focal) = other.map(|other| other.focal_px) else { return };
            app.with_lens("use the second solution", |lens| {
                lens.focal_px = Some(Known::prior(focal, 0.05 * focal));
            });
        }
        Command::CopyLines => {
            app.copied = app.session.entry().map(|entry| (entry.annotations.clone(), entry.size_px));
            app.session.note = Some("Copied. Choose a camera and paste.".into());
        }
        Command::PasteLines => app.paste_lines(),
        _ => {}
    }
}

fn right_angle(app: &mut App) {
    let Some(entry) = app.session.entry_mut() else { return };
    let groups: Vec<usize> =
        (0..entry.annotations.len()).filter(|&i| entry.annotations[i].kind == Kind::Parallel).collect();
    let [.., first, second] = groups[..] else {
        app.session.note = Some("Needs two groups of parallels: W begins a second one.".into());
        return;
    };
    let taken = |id: &String| entry.annotations.iter().any(|a| a.id.as_ref() == Some(id));
    let free = (b'a'..=b'z').map(|c| char::from(c).to_string()).find(|id| !taken(id));
    let id = entry.annotations[first].id.clone().or(free);
    entry.annotations[first].id.clone_from(&id);
    let tied = &mut entry.annotations[second].at_right_angles_to;
    *tied = if tied.is_some() { None } else { id };
    app.session.commit("tie two directions at right angles");
}

pub(crate) fn on_files(app: &mut App, Told { command, ctx, .. }: Told<'_>) {
    use Command as C;
    app.cancel();
    match command {
        C::NewSite => app.open_site(Site::new(), crate::files::Images::default(), None),
        C::Demo => {
            let (site, images) = crate::demo::open();
            app.open_site(site, images, None);
        }
        C::Tour => {
            let (mut site, images) = crate::demo::open();
            // The first camera is the newcomer's to do.
            if let Some(camera) = site.cameras.first_mut() {
                camera.annotations.clear();
                camera.control_points.clear();
                (camera.efov_px, camera.placement) = (None, None);
            }
            app.open_site(site, images, None);
            app.tour = crate::panels::tour::Tour::begun();
        }
        C::Save if app.session.path.is_some() => app.save(),
        C::Save | C::SaveAs => app.ask(Purpose::SaveSite),
        C::SavePlain => app.ask(Purpose::SavePlain),
        C::Open => app.ask(Purpose::OpenSite),
        C::AddImages => app.ask(Purpose::AddImages),
        C::LoadPlan => app.ask(Purpose::LoadPlan),
        C::ReplaceStill => {
            app.replaced = app.session.entry().map_or_else(String::new, |entry| entry.id.clone());
            app.ask(Purpose::ReplaceStill);
        }
        C::Compare => app.ask(Purpose::Compare),
        C::Import => app.ask(Purpose::Import),
        C::Export => app.export.open(),
        C::StopWork => app.stop_work(),
        C::ReadAgain => {
            app.pictures.retry();
            app.edges.resume();
        }
        _ => app.take_picture(ctx),
    }
}

pub(crate) fn on_view(app: &mut App, Told { command, .. }: Told<'_>) {
    use Command as C;
    match command {
        C::ViewImage => app.show(Mode::Image),
        C::ViewPlan => app.show(Mode::Plan),
        C::ViewAll => app.show(Mode::All),
        C::ViewScene => app.show(Mode::Scene),
        C::Fit => {
            app.panes.views.clear();
            app.orbit = None;
        }
        C::Beside => {
            let beside = if app.mode == Mode::Scene { &mut app.beside_scene } else { &mut app.beside_plan };
            *beside = !*beside;
        }
        C::ZoomIn | C::ZoomOut if app.mode == Mode::Scene => {
            let mut orbit = app.orbit.unwrap_or_else(|| Orbit::of(&app.session));
            orbit.zoom(if command == C::ZoomIn { 1.25 } else { 0.8 });
            app.orbit = Some(orbit);
        }
        _ => {
            let factor = if command == C::ZoomIn { 1.25 } else { 0.8 };
            let key = app.zoom_key();
            if let Some(mapping) = app.panes.mapping(key.0, key.1) {
                let over = app.panes.cursor.filter(|(pane, _)| *pane == key.1);
                let at = over.map_or_else(|| mapping.rect.center(), |(_, at)| mapping.screen(at));
                app.panes.views.insert(key, mapping.zoomed(at, factor));
            }
        }
    }
}

pub(crate) fn on_cameras(app: &mut App, Told { command, .. }: Told<'_>) {
    use Command as C;
    app.cancel();
    let count = app.session.site.cameras.len();
    let own = app.session.camera;
    let step = |by: usize, wanted: &dyn Fn(usize) -> bool| {
        (1..=count).map(|i| (own + i * by) % count).find(|&camera| wanted(camera))
    };
    let is_open = |camera: usize| !crate::panels::steps::is_finished(&app.session, camera);
    let to = match command {
        _ if count == 0 => None,
        C::NextCamera => step(1, &|_| true),
        C::PreviousCamera => step(count - 1, &|_| true),
        C::NextUnfinished => step(1, &is_open),
        C::PreviousUnfinished => step(count - 1, &is_open),
        _ => {
            app.remove_camera();
            None
        }
    };
    if let Some(camera) = to {
        app.session.choose(camera);
    }
}

pub(crate) fn on_solving(app: &mut App, Told { command, ctx, .. }: Told<'_>) {
    use Command as C;
    app.cancel();
    let camera = app.session.camera;
    match command {
        C::Pause => {
            app.session.solved.paused = !app.session.solved.paused;
            app.session.solve();
        }
        C::Refine => app.refine(ctx),
        C::CompareBefore => app.show_before = !app.show_before,
        C::FixPlacement => {
            let Some(placement) = app.session.placement(camera) else { return };
            let fixed = app.session.site.cameras[camera].placement.as_ref().is_some_and(|p| p.fixed);
            app.session.place(camera, placement);
            let id = app.session.site.cameras[camera].id.clone();
            if let Some(entry) = app.session.site.cameras[camera].placement.as_mut() {
                entry.fixed = !fixed;
            }
            app.session.commit(format!("{} {id}", if fixed { "release" } else { "hold" }));
        }
        _ => {
            let entry = &mut app.session.site.cameras[camera];
            entry.placement = None;
            let id = entry.id.clone();
            app.session.commit(format!("forget the place of {id}"));
        }
    }
}
