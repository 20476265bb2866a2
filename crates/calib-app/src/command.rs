//! Everything the app can be told: one list for keys, the palette, the shortcut sheet and tests; one place that acts.

use std::collections::BTreeSet;

use calib_core::{Kind, Known, Site};
use egui::{Context, Key, KeyboardShortcut, Modifiers};

use crate::app::{App, Mode};
use crate::dialog::Purpose;
use crate::hit::Part;
use crate::tools::{Pane, TOOLS};
use crate::{edit, snap};

/// Something the app can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the table says what each does, in the operator's words")]
pub enum Command {
    Tool(usize),
    NewSite,
    Demo,
    Tour,
    Open,
    Save,
    SaveAs,
    AddImages,
    LoadPlan,
    ReplaceStill,
    Compare,
    SavePicture,
    Undo,
    Redo,
    Delete,
    Duplicate,
    OnOff,
    UseAnyway,
    SelectAll,
    Deselect,
    NudgeLeft,
    NudgeRight,
    NudgeUp,
    NudgeDown,
    NewGroup,
    RightAngle,
    PullOntoEdge,
    TakeSuggestion,
    TakeSecondSolution,
    CopyLines,
    PasteLines,
    ViewImage,
    ViewPlan,
    ViewAll,
    ViewScene,
    Fit,
    ZoomIn,
    ZoomOut,
    HideOverlays,
    NextCamera,
    PreviousCamera,
    NextUnfinished,
    PreviousUnfinished,
    RemoveCamera,
    Pause,
    Refine,
    CompareBefore,
    FixPlacement,
    ResetPlacement,
    Grid,
    Edges,
    Horizon,
    Field,
    Prism,
    Guide,
    ColourByResidual,
    Coverage,
    Blend,
    Theme,
    Feet,
    Palette,
    Shortcuts,
    About,
    Accept,
    Cancel,
    StepBack,
}

/// A row of the list.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Which.
    pub command: Command,
    /// What it does, as the palette says it.
    pub text: &'static str,
    /// The keys that give it.
    pub keys: Option<KeyboardShortcut>,
}

const fn row(command: Command, text: &'static str, modifiers: Modifiers, key: Key) -> Row {
    Row { command, text, keys: Some(KeyboardShortcut::new(modifiers, key)) }
}

const fn bare(command: Command, text: &'static str) -> Row {
    Row { command, text, keys: None }
}

const NONE: Modifiers = Modifiers::NONE;
const CTRL: Modifiers = Modifiers::COMMAND;
const SHIFT: Modifiers = Modifiers::SHIFT;
const CTRL_SHIFT: Modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);

/// Every command but the tools, which have a list of their own.
pub const COMMANDS: &[Row] = {
    use Command as C;
    &[
        row(C::NewSite, "New site", CTRL, Key::N),
        bare(C::Demo, "Open the demonstration site"),
        bare(C::Tour, "Take the tour of the demonstration"),
        row(C::Open, "Open a site\u{2026}", CTRL, Key::O),
        row(C::SaveAs, "Save the site as\u{2026}", CTRL_SHIFT, Key::S),
        row(C::Save, "Save the site", CTRL, Key::S),
        row(C::AddImages, "Add images\u{2026}", CTRL, Key::I),
        bare(C::LoadPlan, "Load a floor plan\u{2026}"),
        bare(C::ReplaceStill, "Replace the still of this camera\u{2026}"),
        bare(C::Compare, "Compare with a saved version\u{2026}"),
        bare(C::SavePicture, "Save a picture of the window"),
        row(C::Redo, "Redo", CTRL_SHIFT, Key::Z),
        row(C::Undo, "Undo", CTRL, Key::Z),
        row(C::Delete, "Delete what is selected", NONE, Key::Delete),
        row(C::Duplicate, "Duplicate the selected lines into a group of their own", NONE, Key::D),
        row(C::OnOff, "Switch what is selected on or off", NONE, Key::X),
        bare(C::UseAnyway, "Use a suspected line anyway"),
        row(C::SelectAll, "Select everything on this image", CTRL, Key::A),
        bare(C::Deselect, "Deselect all"),
        row(C::NudgeLeft, "Nudge left, 0.1 px (Shift 1 px)", NONE, Key::ArrowLeft),
        row(C::NudgeRight, "Nudge right, 0.1 px (Shift 1 px)", NONE, Key::ArrowRight),
        row(C::NudgeUp, "Nudge up, 0.1 px (Shift 1 px)", NONE, Key::ArrowUp),
        row(C::NudgeDown, "Nudge down, 0.1 px (Shift 1 px)", NONE, Key::ArrowDown),
        row(C::NewGroup, "Begin a new group with the next line", NONE, Key::W),
        bare(C::RightAngle, "Tie the last two parallel groups at right angles"),
        row(C::PullOntoEdge, "Pull the selected lines onto the edge", NONE, Key::J),
        row(C::TakeSuggestion, "Draw the suggested line", NONE, Key::N),
        bare(C::TakeSecondSolution, "Use the second solution's field of view"),
        row(C::CopyLines, "Copy this camera's annotations", CTRL_SHIFT, Key::C),
        row(C::PasteLines, "Paste annotations onto this camera", CTRL_SHIFT, Key::V),
        row(C::ViewImage, "View: image", NONE, Key::Num1),
        row(C::ViewPlan, "View: plan", NONE, Key::Num2),
        row(C::ViewAll, "View: all cameras", NONE, Key::Num3),
        row(C::ViewScene, "View: scene", NONE, Key::Num4),
        row(C::Fit, "Fit the view", NONE, Key::Home),
        row(C::ZoomIn, "Zoom in", NONE, Key::Plus),
        row(C::ZoomOut, "Zoom out", NONE, Key::Minus),
        row(C::HideOverlays, "Hide or show what lies on the image", NONE, Key::H),
        row(C::NextUnfinished, "Next unfinished camera", SHIFT, Key::CloseBracket),
        row(C::PreviousUnfinished, "Previous unfinished camera", SHIFT, Key::OpenBracket),
        row(C::NextCamera, "Next camera", NONE, Key::CloseBracket),
        row(C::PreviousCamera, "Previous camera", NONE, Key::OpenBracket),
        bare(C::RemoveCamera, "Remove this camera"),
        row(C::Pause, "Pause or resume solving", NONE, Key::F8),
        row(C::Refine, "Refine all cameras together", NONE, Key::F9),
        row(C::CompareBefore, "Show or hide the poses before Refine", NONE, Key::B),
        bare(C::FixPlacement, "Hold or release this camera's place"),
        bare(C::ResetPlacement, "Forget this camera's place"),
        row(C::Grid, "Show or hide the metre grid", NONE, Key::G),
        row(C::Edges, "Offer or hide the edges that were found", NONE, Key::I),
        bare(C::Horizon, "Show or hide the horizon"),
        bare(C::Field, "Show or hide the field of view"),
        bare(C::Prism, "Show or hide the prism"),
        bare(C::Guide, "Show or hide the person at the cursor"),
        bare(C::ColourByResidual, "Colour lines by kind or by residual"),
        bare(C::Coverage, "Shade coverage on the plan"),
        bare(C::Blend, "Lay the images of all cameras on the plan"),
        bare(C::Theme, "Light or dark theme"),
        bare(C::Feet, "Metres or feet on screen"),
        row(C::Palette, "Commands", CTRL, Key::K),
        row(C::Shortcuts, "Keyboard shortcuts", SHIFT, Key::Questionmark),
        bare(C::About, "About, and licences"),
        row(C::Accept, "End the line, take the suggestion", NONE, Key::Enter),
        row(C::Cancel, "Put back what is held; deselect", NONE, Key::Escape),
        row(C::StepBack, "Take the last point back", NONE, Key::Backspace),
    ]
};

/// Every command: the table, then the tools.
pub fn all() -> impl Iterator<Item = Row> {
    let tools = TOOLS.iter().enumerate().map(|(index, tool)| Row {
        command: Command::Tool(index),
        text: tool.title,
        keys: Some(KeyboardShortcut::new(NONE, tool.key)),
    });
    COMMANDS.iter().copied().chain(tools)
}

/// The command whose keys were pressed; typing in a field is not commanding.
pub fn pressed(ctx: &Context) -> Vec<(Command, Modifiers)> {
    if ctx.text_edit_focused() {
        return Vec::new();
    }
    let mut found = Vec::new();
    ctx.input_mut(|input| {
        input.events.retain(|event| {
            let egui::Event::Key { key, pressed: true, modifiers, .. } = event else { return true };
            let matches = |row: &Row| row.keys.is_some_and(|keys| fits(keys, *key, *modifiers));
            let Some(row) = all().find(matches) else { return true };
            found.push((row.command, *modifiers));
            // Enter still presses a button that has the focus.
            matches!(row.command, Command::Accept)
        });
    });
    found
}

fn fits(keys: KeyboardShortcut, key: Key, modifiers: Modifiers) -> bool {
    let is_nudge = matches!(key, Key::ArrowLeft | Key::ArrowRight | Key::ArrowUp | Key::ArrowDown);
    // The sign of a key says whether Shift was needed to reach it.
    let is_sign = matches!(key, Key::Questionmark | Key::Plus);
    let same_key = keys.logical_key == key
        || keys.logical_key == Key::Plus && key == Key::Equals
        || keys.logical_key == Key::CloseBracket && key == Key::CloseCurlyBracket
        || keys.logical_key == Key::OpenBracket && key == Key::OpenCurlyBracket
        || keys.logical_key == Key::Delete && key == Key::Delete;
    same_key
        && modifiers.command == keys.modifiers.command
        && !modifiers.alt
        && (is_nudge || is_sign || modifiers.shift == keys.modifiers.shift)
}

/// Whether a command would do something now.
#[must_use]
pub fn is_enabled(app: &App, command: Command) -> bool {
    use Command as C;
    let session = &app.session;
    match command {
        C::Undo => session.history.undo_name().is_some() || !app.tool.is_idle(),
        C::Redo => session.history.redo_name().is_some() && app.tool.is_idle(),
        C::Delete | C::OnOff | C::Duplicate | C::PullOntoEdge | C::Deselect | C::UseAnyway => {
            !session.selection.is_empty()
        }
        C::TakeSuggestion => session.solution().is_some_and(|solution| solution.draw_next.is_some()),
        C::TakeSecondSolution => session.solution().is_some_and(|solution| !solution.alternatives.is_empty()),
        C::PasteLines => app.copied.is_some() && session.entry().is_some(),
        C::CompareBefore => session.before_refine.is_some(),
        C::LoadPlan | C::Refine | C::NextCamera | C::PreviousCamera => !session.site.cameras.is_empty(),
        C::CopyLines
        | C::RemoveCamera
        | C::ReplaceStill
        | C::SelectAll
        | C::FixPlacement
        | C::ResetPlacement => session.entry().is_some(),
        _ => true,
    }
}

/// The words of a command now: undo says what it takes back.
#[must_use]
pub fn text_of(app: &App, row: Row) -> String {
    match row.command {
        Command::Undo => format!("Undo {}", app.session.history.undo_name().unwrap_or_default()),
        Command::Redo => format!("Redo {}", app.session.history.redo_name().unwrap_or_default()),
        _ => row.text.to_owned(),
    }
}

/// Does it. This is the one place that acts.
pub fn run(app: &mut App, ctx: &Context, command: Command, modifiers: Modifiers) {
    use Command as C;
    if !is_enabled(app, command) {
        return;
    }
    match command {
        C::Tool(index) => app.take_tool(index),
        C::Undo | C::Redo | C::Accept | C::Cancel | C::StepBack => gesture(app, command),
        C::Delete | C::Duplicate | C::OnOff | C::UseAnyway | C::SelectAll | C::Deselect | C::PullOntoEdge => {
            on_selection(app, command);
        }
        C::NudgeLeft | C::NudgeRight | C::NudgeUp | C::NudgeDown => nudge(app, command, modifiers),
        C::NewGroup
        | C::RightAngle
        | C::TakeSuggestion
        | C::TakeSecondSolution
        | C::CopyLines
        | C::PasteLines => on_lines(app, command),
        C::NewSite
        | C::Demo
        | C::Tour
        | C::Open
        | C::Save
        | C::SaveAs
        | C::AddImages
        | C::LoadPlan
        | C::ReplaceStill
        | C::Compare
        | C::SavePicture => on_files(app, ctx, command),
        C::ViewImage | C::ViewPlan | C::ViewAll | C::ViewScene | C::Fit | C::ZoomIn | C::ZoomOut => {
            on_view(app, command);
        }
        C::NextCamera | C::PreviousCamera | C::NextUnfinished | C::PreviousUnfinished | C::RemoveCamera => {
            on_cameras(app, command);
        }
        C::Pause | C::Refine | C::CompareBefore | C::FixPlacement | C::ResetPlacement => {
            on_solving(app, command);
        }
        C::Palette => app.palette.toggle(),
        C::Shortcuts => app.shortcuts = !app.shortcuts,
        C::About => app.about = !app.about,
        C::Theme => ctx.set_theme(match ctx.theme() {
            egui::Theme::Dark => egui::Theme::Light,
            egui::Theme::Light => egui::Theme::Dark,
        }),
        _ => switch(app, command),
    }
}

fn switch(app: &mut App, command: Command) {
    use Command as C;
    let layers = &mut app.layers;
    let switch = match command {
        C::Grid => &mut layers.grid,
        C::Edges => &mut layers.edges,
        C::Horizon => &mut layers.horizon,
        C::Field => &mut layers.field,
        C::Prism => &mut layers.prism,
        C::Guide => &mut layers.guide,
        C::ColourByResidual => &mut layers.by_residual,
        C::HideOverlays => &mut layers.hidden,
        C::Coverage => &mut app.coverage,
        C::Blend => &mut app.blend,
        C::Feet => &mut app.feet,
        _ => return,
    };
    *switch = !*switch;
}

fn gesture(app: &mut App, command: Command) {
    match command {
        // What is in the hand is taken back first.
        Command::Undo | Command::Redo if !app.tool.is_idle() => app.cancel(),
        Command::Undo => app.session.undo(),
        Command::Redo => app.session.redo(),
        Command::Accept => app.tool.accept(&mut app.session),
        Command::StepBack => {
            if !app.tool.step_back(&mut app.session) {
                on_selection(app, Command::Delete);
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

fn on_selection(app: &mut App, command: Command) {
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
    let lines: BTreeSet<(usize, usize)> = parts
        .iter()
        .filter_map(|&part| match part {
            Part::Line { annotation, segment } | Part::Vertex { annotation, segment, .. } => {
                Some((annotation, segment))
            }
            _ => None,
        })
        .collect();
    let mut pulled = 0;
    for (annotation, segment) in lines {
        let ends = [0, 1].map(|vertex| Part::Vertex { annotation, segment, vertex });
        let site = &mut app.session.site;
        let a = edit::pixel_mut(site, camera, ends[0]).copied();
        let b = edit::pixel_mut(site, camera, ends[1]).copied();
        let Some(line) = a.zip(b).and_then(|(a, b)| snap::pull(&still, [a, b])) else { continue };
        for (part, to) in ends.into_iter().zip(line) {
            if let Some(pixel) = edit::pixel_mut(&mut app.session.site, camera, part) {
                *pixel = to;
            }
        }
        pulled += 1;
    }
    app.session.commit(format!("pull {name} onto the edge"));
    app.session.note = Some(match pulled {
        0 => "No edge runs along it.".into(),
        count => format!("{count} pulled onto the edge."),
    });
}

fn nudge(app: &mut App, command: Command, modifiers: Modifiers) {
    let by = match command {
        Command::NudgeLeft => [-1.0, 0.0],
        Command::NudgeRight => [1.0, 0.0],
        Command::NudgeUp => [0.0, -1.0],
        _ => [0.0, 1.0],
    };
    let step = if modifiers.shift { 1.0 } else { 0.1 };
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

fn on_lines(app: &mut App, command: Command) {
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

fn on_files(app: &mut App, ctx: &Context, command: Command) {
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
        C::Open => app.ask(Purpose::OpenSite),
        C::AddImages => app.ask(Purpose::AddImages),
        C::LoadPlan => app.ask(Purpose::LoadPlan),
        C::ReplaceStill => app.ask(Purpose::ReplaceStill),
        C::Compare => app.ask(Purpose::Compare),
        _ => app.take_picture(ctx),
    }
}

fn on_view(app: &mut App, command: Command) {
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

fn on_cameras(app: &mut App, command: Command) {
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

fn on_solving(app: &mut App, command: Command) {
    use Command as C;
    app.cancel();
    let camera = app.session.camera;
    match command {
        C::Pause => {
            app.session.solved.paused = !app.session.solved.paused;
            app.session.solve();
        }
        C::Refine => app.session.refine(),
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
