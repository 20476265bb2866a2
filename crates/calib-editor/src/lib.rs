//! The operator's document without a screen: what is open, how it is changed, what follows from it.
//!
//! A view reads the [`Editor`] and sends [`Action`]s; [`Editor::apply`] is the one place that changes the
//! document. A day of work goes through here without a window: see `tests/day.rs`.
//!
//! In the order of the data: images and what is found in them; what is drawn, picked and edited, with its
//! history; what is solved from it as it is drawn; the tools that take the pointer; the commands; the actions
//! and what they do.
//!
//! Points of the document are raw pixels of an image or metres of the floor, never points of a screen. Here are
//! no files, threads or windows: whoever has them hands over bytes and sends what became of them.

// A file uses only those above it; a test holds it.
mod units;
mod keys;
pub mod images;
mod document_difference;
mod period;
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
mod placing;
mod proposals;
mod together;
mod agreement;
pub mod steps;
mod verdict;
mod tools;
pub mod command;
mod import;
mod action;
mod editor;
mod apply;

pub use action::{Action, NewStill, Opened, PlaceNumber};
pub use agreement::{Agreement, Apart, agreements, apart, far_links, lines_off, pair_apart};
pub use calib_image::{Edge, edges};
pub use command::Command;
pub use document_difference::differences;
pub use editor::{Editor, OldStill};
pub use epipolar::{Trace, post_length};
pub use family::{Family, Fit, view_of};
pub use history::History;
pub use hit::{Hit, Part};
pub use images::{FileResult, Images, Make, Reach, ReadFile, Source, data_uri, decode, image_names, parse};
pub use import::{plan_told_by, recognise, world_endings};
pub use keys::{Key, Modifiers, Shortcut};
pub use newer::{Newer, OnNewer, held_since};
pub use period::Period;
pub use proposed::{Hypothesis, OnProposed, Preview, Proposed, ProposedGroup};
pub use refine::refined;
pub use session::{Session, corners_of};
pub use solved::Solved;
pub use steps::site_subject;
pub use tools::{
    Icon, Pane, Phase, PlanHandle, Pointer, TOOLS, Tool, ToolRow, is_inside, plan_handles, plan_scale,
};
pub use units::{Units, number};
pub use verdict::{Standing, Verdict, summary, verdict};
