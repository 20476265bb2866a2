//! Operator's document without a user interface: the open site, its editing tools, its history and its
//! results. A view reads the [`Editor`] and sends [`Action`]s. Only [`Editor::apply`] changes the document.
//! The tests operate the editor without a window: see `tests/day.rs`.
//!
//! The files, in data-flow order:
//!
//! - `keys`: keyboard shortcuts.
//! - `images`: images of the cameras, files to open, image files of the site.
//! - `document_difference`, `period`, `slots`: differences between two sites, calibration periods of a camera, and
//!   numbers for the colours of cameras.
//! - `hit`: parts of an image near the pointer.
//! - `suggest`, `proposed`: suggested edges, and automatic calibrations of images.
//! - `history`: undo and redo.
//! - `joint`, `solved`, `refine`, `live_joint`: results of each camera, and joint results of the site.
//! - `session`: the open site with its selection, history and results.
//! - `edit`, `epipolar`, `planes`, `snap`, `family`, `placement`: edits of the site and their geometry.
//! - `newer`, `suggestions`, `agreement`, `steps`, `status`: newer images, suggestions, consistency and
//!   status.
//! - `tools`: pointer tools. `command`, `import`, `action`: commands, file import, and requests of a view.
//! - `editor`, `apply`: the editor, and the effect of each action.
//!
//! Coordinates in the document are raw image pixels or floor metres, never screen points. The crate does not
//! access files, threads or windows. The caller passes bytes in and reports the outcome of file operations.

// A module uses only the modules above it; `tests/layout.rs` checks this.
mod keys;
pub mod images;
mod document_difference;
mod period;
mod slots;
pub mod hit;
pub mod suggest;
mod proposed;
mod history;
mod joint;
mod solved;
mod refine;
mod session;
pub mod edit;
mod epipolar;
pub mod planes;
pub mod snap;
mod family;
mod newer;
mod placement;
mod suggestions;
mod live_joint;
mod agreement;
pub mod steps;
mod status;
mod tools;
pub mod command;
mod import;
mod action;
mod editor;
mod apply;

pub use action::{Action, NewImage, Opened, PlacementNumber, PointAction};
pub use agreement::{
    Agreement, LinkDistance, agreements, inconsistent_links, line_distance_rms, link_distance,
    pair_rms_distance,
};
pub use calib_image::{Edge, edges};
pub use calib_site::{Units, number};
pub use command::Command;
pub use document_difference::differences;
pub use editor::{Editor, ReplacedImage};
pub use epipolar::{SearchLine, missing_search_line, post_length, search_line};
pub use family::{Family, Fit, hfov_deg};
pub use history::History;
pub use hit::{Hit, Part};
pub use images::{
    AllowedFiles, FileResult, Images, ReadFile, RenderImage, Source, data_uri, decode, image_names, parse,
    parse_with_drawing,
};
pub use import::{import_any, is_importable, plan_from_world_file, world_endings};
pub use keys::{Key, Modifiers, Shortcut};
pub use newer::{NewerAction, NewerImage, NewerUnderPointer, valid_since};
pub use period::Period;
pub use proposed::{
    AutomaticResult, CalibrationDecision, Hypothesis, PendingCalibration, PendingGroup, Preview,
};
pub use refine::refined;
pub use session::{LiveSolve, PendingLines, Revision, RulerSettings, Session, ToolSettings, corners_of};
pub use solved::Solved;
pub use status::{CameraStatus, StatusLevel, camera_status, summary};
pub use steps::site_subject;
pub use tools::{
    Icon, Pane, Phase, PlanHandle, Pointer, TOOLS, Tool, ToolRow, is_inside, is_plan_empty_at, plan_handles,
    plan_scale,
};
