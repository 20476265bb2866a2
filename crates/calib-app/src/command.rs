//! Everything the app can be told: one list for keys, the palette, the shortcut sheet and tests; one place that acts.

use egui::{Context, Key, KeyboardShortcut, Modifiers};

use crate::app::App;
use crate::deeds;
use crate::tools::TOOLS;

/// A command that was given, with what came along.
#[derive(Clone, Copy, Debug)]
pub struct Told<'a> {
    /// Which.
    pub command: Command,
    /// Where it was given.
    pub ctx: &'a Context,
    /// The keys held with it.
    pub modifiers: Modifiers,
}

/// A row of the list.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Which.
    pub command: Command,
    /// What it does, as the palette says it.
    pub text: &'static str,
    /// The keys that give it; in a browser some are the browser's.
    pub keys: Option<KeyboardShortcut>,
    /// What acts.
    deed: fn(&mut App, Told<'_>),
}

const NONE: Modifiers = Modifiers::NONE;
const CTRL: Modifiers = Modifiers::COMMAND;
const SHIFT: Modifiers = Modifiers::SHIFT;
/// A browser keeps Ctrl+N for itself.
const NEW: Modifiers =
    if cfg!(target_arch = "wasm32") { Modifiers::COMMAND.plus(Modifiers::ALT) } else { CTRL };
const CTRL_SHIFT: Modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);

macro_rules! keys {
    () => {
        None
    };
    ($modifiers:ident $key:ident) => {
        Some(KeyboardShortcut::new($modifiers, Key::$key))
    };
}

/// Names, words and keys of the commands, under what acts on them.
macro_rules! commands {
    ($($deed:ident { $($name:ident $text:literal $($modifiers:ident $key:ident)?;)* })*) => {
        /// Something the app can be told.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[expect(missing_docs, reason = "the table says what each does, in the operator's words")]
        pub enum Command {
            Tool(usize),
            $($($name,)*)*
        }

        /// Every command but the tools, which have a list of their own.
        pub const COMMANDS: &[Row] = &[$($(Row {
            command: Command::$name,
            text: $text,
            keys: keys!($($modifiers $key)?),
            deed: deeds::$deed,
        },)*)*];
    };
}

commands! {
    on_files {
        NewSite "New site" NEW N;
        Demo "Open the demonstration site";
        Tour "Take the tour of the demonstration";
        Open "Open a site\u{2026}" CTRL O;
        SaveAs "Save the site as\u{2026}" CTRL_SHIFT S;
        Save "Save the site" CTRL S;
        SavePlain "Save the site without its images\u{2026}";
        AddImages "Add images\u{2026}" CTRL I;
        LoadPlan "Load a floor plan\u{2026}";
        ReplaceStill "Replace the still of this camera\u{2026}";
        Compare "Compare with a saved version\u{2026}";
        Import "Import lenses or cameras of another program\u{2026}";
        Export "Export for other programs\u{2026}" CTRL E;
        SavePicture "Save a picture of this view\u{2026}" CTRL_SHIFT P;
        StopWork "Cancel what is under way: reading, finding edges, refining";
        ReadAgain "Read images again, look for edges again";
    }
    gesture {
        Redo "Redo" CTRL_SHIFT Z;
        Undo "Undo" CTRL Z;
        Accept "End the line or polygon" NONE Enter;
        Cancel "Put back what is held; deselect" NONE Escape;
        StepBack "Take the last point back" NONE Backspace;
    }
    on_selection {
        Delete "Delete what is selected" NONE Delete;
        Duplicate "Duplicate the selected lines into a group of their own" NONE D;
        OnOff "Switch what is selected on or off" NONE X;
        UseAnyway "Use a suspected line anyway";
        SelectAll "Select everything on this image" CTRL A;
        Deselect "Deselect all";
        PullOntoEdge "Pull the selected lines onto the edge" NONE J;
    }
    nudge {
        NudgeLeft "Nudge left, 0.1 px (Shift 1 px)" NONE ArrowLeft;
        NudgeRight "Nudge right, 0.1 px (Shift 1 px)" NONE ArrowRight;
        NudgeUp "Nudge up, 0.1 px (Shift 1 px)" NONE ArrowUp;
        NudgeDown "Nudge down, 0.1 px (Shift 1 px)" NONE ArrowDown;
        TurnLeft "Turn the camera on the plan left, 0.1\u{b0} (Shift 1\u{b0})" CTRL ArrowLeft;
        TurnRight "Turn the camera on the plan right, 0.1\u{b0} (Shift 1\u{b0})" CTRL ArrowRight;
        Grow "Enlarge the field on the plan, 0.1 % (Shift 1 %)" CTRL ArrowUp;
        Shrink "Shrink the field on the plan, 0.1 % (Shift 1 %)" CTRL ArrowDown;
    }
    on_lines {
        NewGroup "Begin a new group with the next line" NONE W;
        RightAngle "Tie the last two parallel groups at right angles";
        TakeSuggestion "Draw the suggested line" NONE N;
        TakeSecondSolution "Use the second solution's field of view";
        CopyLines "Copy this camera's annotations" CTRL_SHIFT C;
        PasteLines "Paste annotations onto this camera" CTRL_SHIFT V;
    }
    on_view {
        ViewImage "View: image" NONE Num1;
        ViewPlan "View: plan" NONE Num2;
        ViewAll "View: all cameras" NONE Num3;
        ViewScene "View: scene" NONE Num4;
        Beside "Show or hide the image beside the plan, or beside the scene" NONE Z;
        Fit "Fit the view" NONE Home;
        ZoomIn "Zoom in" NONE Plus;
        ZoomOut "Zoom out" NONE Minus;
    }
    on_cameras {
        NextUnfinished "Next unfinished camera" SHIFT CloseBracket;
        PreviousUnfinished "Previous unfinished camera" SHIFT OpenBracket;
        NextCamera "Next camera" NONE CloseBracket;
        PreviousCamera "Previous camera" NONE OpenBracket;
        RemoveCamera "Remove this camera";
    }
    on_solving {
        Pause "Pause or resume solving" NONE F8;
        Refine "Refine all cameras together" NONE F9;
        CompareBefore "Show or hide the poses before Refine" NONE B;
        FixPlacement "Hold or release this camera's place";
        ResetPlacement "Forget this camera's place";
    }
    switch {
        HideOverlays "Hide or show what lies on the image" NONE H;
        Grid "Show or hide the metre grid" NONE G;
        Edges "Offer or hide the edges that were found" NONE I;
        Straighten "Take the bend of the lens out of the image" NONE T;
        Horizon "Show or hide the horizon";
        Field "Show or hide the field of view";
        Prism "Show or hide the prism";
        Guide "Show or hide the person at the cursor";
        ColourByResidual "Colour lines by kind or by residual";
        Above "Show or hide the floor from above" NONE Y;
        Coverage "Shade coverage on the plan";
        Blend "Lay the images of all cameras on the plan";
        Snap "Snap to 10 cm and 5\u{b0} on the plan";
        Feet "Metres or feet on screen";
        Palette "Commands" CTRL K;
        Shortcuts "Keyboard shortcuts" SHIFT Questionmark;
        About "About, and licences";
        Theme "Light or dark theme";
    }
}

/// Every command: the table, then the tools.
pub fn all() -> impl Iterator<Item = Row> {
    let tools = TOOLS.iter().enumerate().map(|(index, tool)| Row {
        command: Command::Tool(index),
        text: tool.title,
        keys: Some(KeyboardShortcut::new(NONE, tool.key)),
        deed: deeds::take_tool,
    });
    COMMANDS.iter().copied().chain(tools)
}

/// The command whose keys were pressed; typing in a field is not commanding.
///
/// `was_typing` says whether a field had the focus in the last frame: the Escape that has taken it away is the
/// field's, as that which closes a menu is the menu's.
pub fn pressed(ctx: &Context, was_typing: bool) -> Vec<(Command, Modifiers)> {
    if ctx.text_edit_focused() {
        return Vec::new();
    }
    let is_others = was_typing || egui::Popup::is_any_open(ctx);
    let mut found = Vec::new();
    ctx.input_mut(|input| {
        input.events.retain(|event| {
            let egui::Event::Key { key, pressed: true, modifiers, .. } = event else { return true };
            let matches = |row: &Row| row.keys.is_some_and(|keys| fits(keys, *key, *modifiers));
            let Some(row) = all().find(matches) else { return true };
            if !(is_others && *key == Key::Escape) {
                found.push((row.command, *modifiers));
            }
            // Enter still presses a button that has the focus, Escape still closes a menu.
            matches!(row.command, Command::Accept | Command::Cancel)
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
        || keys.logical_key == Key::OpenBracket && key == Key::OpenCurlyBracket;
    same_key
        && modifiers.command == keys.modifiers.command
        && modifiers.alt == keys.modifiers.alt
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
        C::CompareBefore => session.before_refine.is_some() || app.compared.is_some(),
        C::StopWork => app.is_working(),
        C::Export => !session.site.cameras.is_empty(),
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
pub fn words(app: &App, command: Command) -> String {
    match command {
        Command::Undo => format!("Undo {}", app.session.history.undo_name().unwrap_or_default()),
        Command::Redo => format!("Redo {}", app.session.history.redo_name().unwrap_or_default()),
        _ => all().find(|row| row.command == command).map_or_else(String::new, |row| row.text.to_owned()),
    }
}

/// Does it. This is the one place that acts.
pub fn run(app: &mut App, ctx: &Context, command: Command, modifiers: Modifiers) {
    let row = all().find(|row| row.command == command);
    if let Some(row) = row.filter(|_| is_enabled(app, command)) {
        (row.deed)(app, Told { command, ctx, modifiers });
    }
}
