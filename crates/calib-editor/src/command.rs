//! Everything the program can be told: one list for keys, the palette, the shortcut sheet and tests.
//!
//! The groups of the table are enums of their own, so that whoever acts on a group names every command in it:
//! a command is added by its row here and its arm where its group is acted on.

use crate::keys::{Key, Modifiers, Shortcut};
use crate::tools::TOOLS;

/// A row of the list.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Which.
    pub command: Command,
    /// What it does, as the palette says it.
    pub text: &'static str,
    /// What has to be there for it to do anything.
    pub needs: Needs,
    /// The keys that give it.
    pub keys: Option<Shortcut>,
}

/// What a command needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Needs {
    /// Nothing.
    #[default]
    Nothing,
    /// A camera of the site.
    Cameras,
    /// A camera in hand.
    Camera,
    /// Something that is selected.
    Selection,
    /// Something that is selected, or a proposed line that is chosen.
    Chosen,
    /// Lines that the still proposes.
    Proposed,
    /// A newer still of the camera in hand.
    Newer,
    /// A newer still that shows the camera in hand moved.
    Moved,
    /// A gesture to take back.
    Undo,
    /// A gesture to do again.
    Redo,
    /// A line that the solution proposes.
    Suggestion,
    /// Another solution that fits as well.
    SecondSolution,
    /// Lines that were copied, and a camera to paste them onto.
    Copied,
    /// Poses to compare with.
    Before,
    /// Work that is under way.
    Work,
}

const NONE: Modifiers = Modifiers::NONE;
const CTRL: Modifiers = Modifiers::COMMAND;
const SHIFT: Modifiers = Modifiers::SHIFT;
const CTRL_SHIFT: Modifiers = Modifiers::COMMAND_SHIFT;

macro_rules! keys {
    () => {
        None
    };
    ($modifiers:ident $key:ident) => {
        Some(Shortcut { modifiers: $modifiers, key: Key::$key })
    };
}

macro_rules! needs {
    () => {
        Needs::Nothing
    };
    ($needs:ident) => {
        Needs::$needs
    };
}

/// Names, words, needs and keys of the commands, by what they act on.
macro_rules! commands {
    ($(#[$doc:meta] $group:ident {
        $($name:ident $text:literal $([$needs:ident])? $($modifiers:ident $key:ident)?;)*
    })*) => {
        /// Something the program can be told.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[expect(missing_docs, reason = "the table says what each does, in the operator's words")]
        pub enum Command {
            Tool(usize),
            $($($name,)*)*
        }

        $(
            #[$doc]
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            #[expect(missing_docs, reason = "the table says what each does, in the operator's words")]
            pub enum $group { $($name,)* }
        )*

        /// A command as one of its group.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Group {
            /// A tool is taken, by its index in the list.
            Tool(usize),
            $(#[$doc] $group($group),)*
        }

        impl Command {
            /// The group it belongs to.
            #[must_use]
            pub const fn group(self) -> Group {
                match self {
                    Self::Tool(index) => Group::Tool(index),
                    $($(Self::$name => Group::$group($group::$name),)*)*
                }
            }
        }

        /// Every command but the tools, which have a list of their own.
        pub const COMMANDS: &[Row] = &[$($(Row {
            command: Command::$name,
            text: $text,
            needs: needs!($($needs)?),
            keys: keys!($($modifiers $key)?),
        },)*)*];
    };
}

commands! {
    /// What is opened, saved, exchanged.
    Files {
        NewSite "New site" CTRL N;
        Demo "Open the demonstration site";
        Tour "Take the tour of the demonstration";
        Open "Open a site\u{2026}" CTRL O;
        SaveAs "Save the site as\u{2026}" CTRL_SHIFT S;
        Save "Save the site" CTRL S;
        SavePlain "Save the site without its images\u{2026}";
        AddImages "Add images\u{2026}" CTRL I;
        LoadPlan "Load a floor plan\u{2026}" [Cameras];
        ReplaceStill "Replace the still of this camera\u{2026}" [Camera];
        Compare "Compare with a saved version\u{2026}";
        Import "Import lenses or cameras of another program\u{2026}";
        Export "Export for other programs\u{2026}" [Cameras] CTRL E;
        Report "Report: one page to hand over\u{2026}" [Cameras];
        SavePicture "Save a picture of this view\u{2026}" CTRL_SHIFT P;
        StopWork "Cancel what is under way: reading, finding edges, refining" [Work];
        ReadAgain "Read images again, look for edges again";
    }
    /// What is in the hand.
    Gesture {
        Redo "Redo" [Redo] CTRL_SHIFT Z;
        Undo "Undo" [Undo] CTRL Z;
        Accept "End the line or polygon" NONE Enter;
        Cancel "Put back what is held; deselect" NONE Escape;
        StepBack "Take the last point back" NONE Backspace;
    }
    /// What is selected.
    Selection {
        Delete "Delete what is selected" [Chosen] NONE Delete;
        Duplicate "Duplicate the selected lines into a group of their own" [Selection] NONE D;
        OnOff "Switch what is selected on or off" [Selection] NONE X;
        UseAnyway "Use a suspected line anyway" [Selection];
        SelectAll "Select everything on this image" [Camera] CTRL A;
        Deselect "Deselect all" [Selection];
        PullOntoEdge "Pull the selected lines onto the edge" [Selection] NONE J;
    }
    /// Small steps.
    Nudge {
        NudgeLeft "Nudge left, 0.1 px (Shift 1 px)" NONE ArrowLeft;
        NudgeRight "Nudge right, 0.1 px (Shift 1 px)" NONE ArrowRight;
        NudgeUp "Nudge up, 0.1 px (Shift 1 px)" NONE ArrowUp;
        NudgeDown "Nudge down, 0.1 px (Shift 1 px)" NONE ArrowDown;
        TurnLeft "Turn the camera on the plan left, 0.1\u{b0} (Shift 1\u{b0})" CTRL ArrowLeft;
        TurnRight "Turn the camera on the plan right, 0.1\u{b0} (Shift 1\u{b0})" CTRL ArrowRight;
        Grow "Enlarge the field on the plan, 0.1 % (Shift 1 %)" CTRL ArrowUp;
        Shrink "Shrink the field on the plan, 0.1 % (Shift 1 %)" CTRL ArrowDown;
    }
    /// What is drawn.
    Lines {
        NewGroup "Begin a new group with the next line" NONE W;
        RightAngle "Tie the last two parallel groups at right angles";
        TakeSuggestion "Take the tool for what helps most" [Suggestion] NONE N;
        DismissSuggestion "Suggest something else" [Suggestion] SHIFT N;
        TakeSecondSolution "Use the second solution's field of view" [SecondSolution];
        CopyLines "Copy this camera's annotations" [Camera] CTRL_SHIFT C;
        PasteLines "Paste annotations onto this camera" [Copied] CTRL_SHIFT V;
    }
    /// What the still proposes.
    Proposing {
        Propose "Propose lines from the edges of this image" [Camera] SHIFT P;
        AcceptProposed "Accept all proposed lines" [Proposed];
        DismissProposed "Dismiss all proposed lines" [Proposed];
        AcceptGroup "Accept the chosen group of proposed lines" [Proposed];
        FlipGroup "Flip the chosen group of proposed lines: verticals or floor lines" [Proposed];
        DeleteGroup "Delete the chosen group of proposed lines" [Proposed];
    }
    /// What newer stills show.
    Newer {
        CompareStill "Compare with a newer still of this camera\u{2026}" [Camera] SHIFT C;
        NextLook "Look at the newer still: old, new, both by turns, a wipe" [Newer] SHIFT B;
        Recover "Recover: carry what is drawn to the newer still, solve from it" [Moved] SHIFT R;
        DismissNewer "Put the newer still aside" [Newer];
    }
    /// How it is looked at.
    View {
        ViewImage "View: image" NONE Num1;
        ViewPlan "View: plan" NONE Num2;
        ViewAll "View: all cameras" NONE Num3;
        ViewScene "View: scene" NONE Num4;
        Beside "Show or hide the image beside the plan, or beside the scene" NONE Z;
        Fit "Fit the view" NONE Home;
        ZoomIn "Zoom in" NONE Plus;
        ZoomOut "Zoom out" NONE Minus;
        NextWindow "Look at a fisheye through the next window: four round it, all unrolled, the whole image" [Camera] SHIFT T;
    }
    /// Which camera is in hand.
    Cameras {
        NextUnfinished "Next unfinished camera" SHIFT CloseBracket;
        PreviousUnfinished "Previous unfinished camera" SHIFT OpenBracket;
        NextCamera "Next camera" [Cameras] NONE CloseBracket;
        PreviousCamera "Previous camera" [Cameras] NONE OpenBracket;
        RemoveCamera "Remove this camera" [Camera];
    }
    /// Solving, and where cameras stand.
    Solving {
        Pause "Pause or resume solving" NONE F8;
        Refine "Refine all cameras together" [Cameras] NONE F9;
        CompareBefore "Show or hide the poses before Refine" [Before] NONE B;
        FixPlacement "Hold or release this camera's place" [Camera];
        ResetPlacement "Forget this camera's place" [Camera];
    }
    /// What is shown, and how.
    Switch {
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
        needs: Needs::Nothing,
        keys: Some(Shortcut { modifiers: NONE, key: tool.key }),
    });
    COMMANDS.iter().copied().chain(tools)
}

/// The row of a command.
#[must_use]
pub fn row(command: Command) -> Option<Row> {
    all().find(|row| row.command == command)
}
