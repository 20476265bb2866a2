//! Everything the app can be told: one list for keys, the palette, the shortcut sheet and tests; one place that acts.

use egui::{Context, Key, KeyboardShortcut, Modifiers};

use crate::app::App;
use crate::deeds;
use crate::tools::TOOLS;

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
    SavePlain,
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
        bare(C::SavePlain, "Save the site without its images\u{2026}"),
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
        row(C::Accept, "End the line or polygon", NONE, Key::Enter),
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
        C::Undo | C::Redo | C::Accept | C::Cancel | C::StepBack => deeds::gesture(app, command),
        C::Delete | C::Duplicate | C::OnOff | C::UseAnyway | C::SelectAll | C::Deselect | C::PullOntoEdge => {
            deeds::on_selection(app, command);
        }
        C::NudgeLeft | C::NudgeRight | C::NudgeUp | C::NudgeDown => deeds::nudge(app, command, modifiers),
        C::NewGroup
        | C::RightAngle
        | C::TakeSuggestion
        | C::TakeSecondSolution
        | C::CopyLines
        | C::PasteLines => deeds::on_lines(app, command),
        C::NewSite
        | C::Demo
        | C::Tour
        | C::Open
        | C::Save
        | C::SaveAs
        | C::SavePlain
        | C::AddImages
        | C::LoadPlan
        | C::ReplaceStill
        | C::Compare
        | C::SavePicture => deeds::on_files(app, ctx, command),
        C::ViewImage | C::ViewPlan | C::ViewAll | C::ViewScene | C::Fit | C::ZoomIn | C::ZoomOut => {
            deeds::on_view(app, command);
        }
        C::NextCamera | C::PreviousCamera | C::NextUnfinished | C::PreviousUnfinished | C::RemoveCamera => {
            deeds::on_cameras(app, command);
        }
        C::Pause | C::Refine | C::CompareBefore | C::FixPlacement | C::ResetPlacement => {
            deeds::on_solving(app, command);
        }
        C::Palette => app.palette.toggle(),
        C::Shortcuts => app.shortcuts = !app.shortcuts,
        C::About => app.about = !app.about,
        C::Theme => ctx.set_theme(match ctx.theme() {
            egui::Theme::Dark => egui::Theme::Light,
            egui::Theme::Light => egui::Theme::Dark,
        }),
        _ => deeds::switch(app, command),
    }
}
