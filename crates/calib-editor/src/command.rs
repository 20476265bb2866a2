//! Table of all commands: the source of the keyboard shortcuts, the command palette, the shortcut sheet and
//! the tests.
//!
//! Each group of commands has its own enum, so that its handler must match every command in it. A new command
//! needs a table entry here and a match arm in the handler of its group.

use crate::keys::{Key, Modifiers, Shortcut};
use crate::tools::TOOLS;

/// Entry of the command table.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Command that the entry describes.
    pub command: Command,
    /// Text of the command in the palette.
    pub text: &'static str,
    /// Condition under which the command is enabled.
    pub needs: Needs,
    /// Keyboard shortcut, if the command has one.
    pub keys: Option<Shortcut>,
}

/// Condition under which a command is enabled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Needs {
    /// Always enabled.
    #[default]
    Nothing,
    /// At least one camera in the site.
    Cameras,
    /// A selected camera.
    Camera,
    /// At least one selected part.
    Selection,
    /// At least one selected part, or a selected line of an automatic calibration.
    Chosen,
    /// An undecided automatic calibration of the selected camera.
    Proposed,
    /// A newer image of the selected camera.
    Newer,
    /// A newer image of the selected camera whose comparison shows that the camera moved.
    Moved,
    /// A gesture to undo.
    Undo,
    /// A gesture to redo.
    Redo,
    /// A suggestion of the next annotation for the selected camera.
    Suggestion,
    /// A second solution that fits the annotations of the selected camera equally well.
    SecondSolution,
    /// Copied annotations, and a camera to paste them onto.
    Copied,
    /// Earlier poses of the cameras to compare with.
    Before,
    /// A running background task.
    Work,
}

/// No modifier key.
const NONE: Modifiers = Modifiers::NONE;
/// Ctrl, or Cmd on a Mac.
const CTRL: Modifiers = Modifiers::COMMAND;
/// Shift key.
const SHIFT: Modifiers = Modifiers::SHIFT;
/// Ctrl and Shift, or Cmd and Shift on a Mac.
const CTRL_SHIFT: Modifiers = Modifiers::COMMAND_SHIFT;

/// Expands to an optional keyboard shortcut.
macro_rules! keys {
    () => {
        None
    };
    ($modifiers:ident $key:ident) => {
        Some(Shortcut { modifiers: $modifiers, key: Key::$key })
    };
}

/// Expands to the condition of a command; `Nothing` if it is omitted.
macro_rules! needs {
    () => {
        Needs::Nothing
    };
    ($needs:ident) => {
        Needs::$needs
    };
}

/// Declares the commands by group, each with its name, text, condition and shortcut.
macro_rules! commands {
    ($(#[$doc:meta] $group:ident {
        $($name:ident $text:literal $([$needs:ident])? $($modifiers:ident $key:ident)?;)*
    })*) => {
        /// Command of the operator.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[expect(missing_docs, reason = "the table describes each command")]
        pub enum Command {
            Tool(usize),
            $($($name,)*)*
        }

        $(
            #[$doc]
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            #[expect(missing_docs, reason = "the table describes each command")]
            pub enum $group { $($name,)* }
        )*

        /// Command as a member of its group.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Group {
            /// Selects the tool with this index in the list of tools.
            Tool(usize),
            $(#[$doc] $group($group),)*
        }

        impl Command {
            /// Returns the command as a member of its group.
            #[must_use]
            pub const fn group(self) -> Group {
                match self {
                    Self::Tool(index) => Group::Tool(index),
                    $($(Self::$name => Group::$group($group::$name),)*)*
                }
            }
        }

        /// Table of all commands, except the selection of tools, which have their own table.
        pub const COMMANDS: &[Row] = &[$($(Row {
            command: Command::$name,
            text: $text,
            needs: needs!($($needs)?),
            keys: keys!($($modifiers $key)?),
        },)*)*];
    };
}

commands! {
    /// Commands that open, save, import and export.
    Files {
        NewSite "New site" CTRL N;
        Demo "Open the demonstration site";
        Tour "Start the tour of the demonstration site";
        Open "Open\u{2026}" CTRL O;
        SaveAs "Save the site as\u{2026}" CTRL_SHIFT S;
        Save "Save the site" CTRL S;
        SavePlain "Save the site without its images\u{2026}";
        AddImages "Add images\u{2026}" CTRL I;
        AddFromAddress "Add an image from the address of a camera\u{2026}";
        LoadPlan "Load a floor plan\u{2026}" [Cameras];
        ReplaceStill "Replace the image of this camera\u{2026}" [Camera];
        Compare "Compare with a saved version\u{2026}";
        Import "Import lenses or cameras from another program\u{2026}";
        Export "Export for other programs\u{2026}" [Cameras] CTRL E;
        Report "Create a one-page report\u{2026}" [Cameras];
        SavePicture "Save this view as an image\u{2026}" CTRL_SHIFT P;
        StopWork "Cancel the running task" [Work];
        ReadAgain "Reload images and detect edges again";
    }
    /// Commands on the current gesture and the history.
    Gesture {
        Redo "Redo" [Redo] CTRL_SHIFT Z;
        Undo "Undo" [Undo] CTRL Z;
        Accept "Finish the line or polygon" NONE Enter;
        Cancel "Cancel the current action, or deselect all" NONE Escape;
        StepBack "Remove the last point" NONE Backspace;
    }
    /// Commands on the selected parts.
    Selection {
        Delete "Delete the selection" [Chosen] NONE Delete;
        Duplicate "Duplicate the selected lines into a new group" [Selection] NONE D;
        OnOff "Switch the selection on or off" [Selection] NONE X;
        UseAnyway "Use the rejected line or point anyway" [Selection];
        SelectAll "Select everything in this image" [Camera] CTRL A;
        Deselect "Deselect all" [Selection];
        PullOntoEdge "Snap the selected lines to image edges" [Selection] NONE J;
    }
    /// Small steps of the selected parts or of the camera.
    Nudge {
        NudgeLeft "Nudge left by 0.1 px (Shift: 1 px)" NONE ArrowLeft;
        NudgeRight "Nudge right by 0.1 px (Shift: 1 px)" NONE ArrowRight;
        NudgeUp "Nudge up by 0.1 px (Shift: 1 px)" NONE ArrowUp;
        NudgeDown "Nudge down by 0.1 px (Shift: 1 px)" NONE ArrowDown;
        TurnLeft "Rotate the camera left on the plan by 0.1\u{b0} (Shift: 1\u{b0})" CTRL ArrowLeft;
        TurnRight "Rotate the camera right on the plan by 0.1\u{b0} (Shift: 1\u{b0})" CTRL ArrowRight;
        Grow "Enlarge the field of view on the plan by 0.1 % (Shift: 1 %)" CTRL ArrowUp;
        Shrink "Shrink the field of view on the plan by 0.1 % (Shift: 1 %)" CTRL ArrowDown;
    }
    /// Commands on annotations.
    Lines {
        NewGroup "Start a new group with the next line" NONE W;
        RightAngle "Mark the last two groups of lines as perpendicular, or undo this";
        TakeSuggestion "Select the tool for the suggested line" [Suggestion] NONE N;
        DismissSuggestion "Show another suggestion" [Suggestion] SHIFT N;
        TakeSecondSolution "Use the focal length of the second solution" [SecondSolution];
        CopyLines "Copy this camera's annotations" [Camera] CTRL_SHIFT C;
        PasteLines "Paste annotations onto this camera" [Copied] CTRL_SHIFT V;
    }
    /// Commands on automatic calibrations.
    Proposing {
        Propose "Calibrate automatically from the edges of this image" [Camera] SHIFT P;
        CalibrateAll "Calibrate and place all cameras automatically" [Cameras] SHIFT A;
        AcceptProposed "Accept all detected lines" [Proposed];
        DismissProposed "Discard all detected lines" [Proposed];
        AcceptGroup "Accept the selected group of detected lines" [Proposed];
        FlipGroup "Switch the selected group between verticals and floor lines" [Proposed];
        DeleteGroup "Delete the selected group of detected lines" [Proposed];
    }
    /// Commands on newer images.
    Newer {
        CompareStill "Compare with a newer image of this camera\u{2026}" [Camera] SHIFT C;
        NextLook "Switch the comparison: wipe, blink, new, old" [Newer] SHIFT B;
        Recover "Recover: transfer the annotations to the newer image and solve" [Moved] SHIFT R;
        DismissNewer "Discard the newer image" [Newer];
    }
    /// Commands on the view.
    View {
        ViewImage "View: image" NONE Num1;
        ViewPlan "View: plan" NONE Num2;
        ViewAll "View: all cameras" NONE Num3;
        ViewScene "View: scene" NONE Num4;
        Beside "Show or hide the image next to the plan or scene" NONE Z;
        Fit "Fit the view" NONE Home;
        ZoomIn "Zoom in" NONE Plus;
        ZoomOut "Zoom out" NONE Minus;
        NextWindow "Fisheye: next view (four windows, panorama, whole image)" [Camera] SHIFT T;
    }
    /// Commands on the list of cameras.
    Cameras {
        NextUnfinished "Next unfinished camera" SHIFT CloseBracket;
        PreviousUnfinished "Previous unfinished camera" SHIFT OpenBracket;
        NextCamera "Next camera" [Cameras] NONE CloseBracket;
        PreviousCamera "Previous camera" [Cameras] NONE OpenBracket;
        RemoveCamera "Remove this camera" [Camera];
    }
    /// Commands on solving and on placements.
    Solving {
        Pause "Pause or resume solving" NONE F8;
        Refine "Place and refine all cameras" [Cameras] NONE F9;
        CompareBefore "Show or hide the poses before the refinement" [Before] NONE B;
        FixPlacement "Fix or unfix this camera's placement" [Camera];
        ResetPlacement "Remove this camera's placement" [Camera];
    }
    /// Switches of the display.
    Switch {
        HideOverlays "Show or hide the overlays on the image" NONE H;
        Grid "Show or hide the floor grid" NONE G;
        Edges "Show or hide the detected edges" NONE I;
        Straighten "Show the image without distortion" NONE T;
        Horizon "Show or hide the horizon";
        Field "Show or hide the field of view";
        Prism "Show or hide the prism (field of view, up to 2 m high)";
        Guide "Show or hide the person at the pointer";
        ColourByResidual "Colour lines by kind or by error";
        Above "Show or hide the top view of the floor" NONE Y;
        Coverage "Show or hide the pixel density on the plan";
        Blend "Show the images of all cameras on the plan";
        Magnify "Draw uncertainty ellipses 10 times larger";
        Snap "Snap to 10 cm and 5\u{b0} on the plan";
        Feet "Switch between metres and feet";
        Palette "Commands" CTRL K;
        Shortcuts "Keyboard shortcuts" SHIFT Questionmark;
        About "About and licences";
        Theme "Switch between light and dark theme";
    }
}

/// Returns the entries of all commands: the command table, then the tools.
pub fn all() -> impl Iterator<Item = Row> {
    let tools = TOOLS.iter().enumerate().map(|(index, tool)| Row {
        command: Command::Tool(index),
        text: tool.title,
        needs: Needs::Nothing,
        keys: tool.key.map(|key| Shortcut { modifiers: NONE, key }),
    });
    COMMANDS.iter().copied().chain(tools)
}

/// Returns the table entry of a command or tool.
#[must_use]
pub fn row(command: Command) -> Option<Row> {
    all().find(|row| row.command == command)
}
