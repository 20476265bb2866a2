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
mod number;
mod units;
mod input;
pub mod file_name;
mod difference;
mod reach;
mod period;
mod images;
mod still;
pub mod hit;
pub mod edit;
pub mod planes;
pub mod suggest;
pub mod snap;
mod proposed;
mod history;
mod joint;
mod solved;
mod family;
mod epipolar;
mod preview;
mod refine;
mod session;
mod newer;
mod part_name;
mod placing;
mod proposals;
mod together;
mod pace;
pub mod places;
mod apart;
mod agreement;
mod site_subject;
pub mod steps;
mod verdict;
mod tools;
pub mod command;
mod import;
mod action;
mod editor;
mod apply;

pub use action::{Action, NewStill, Opened, PlaceNumber};
pub use agreement::{Agreement, agreements};
pub use apart::{Apart, apart, far_links, lines_off, pair_apart};
pub use calib_image::{Edge, edges};
pub use command::Command;
pub use difference::differences;
pub use editor::{Editor, OldStill};
pub use epipolar::{Trace, post_length};
pub use family::{Family, Fit, view_of};
pub use history::History;
pub use hit::{Hit, Part};
pub use images::{FileResult, Images, Make, ReadFile, Source, data_uri, image_names, parse};
pub use import::{plan_told_by, recognise, world_endings};
pub use input::{Key, Modifiers, Shortcut};
pub use newer::{Newer, OnNewer, held_since};
pub use number::number;
pub use period::Period;
pub use preview::Preview;
pub use proposed::{Hypothesis, OnProposed, Proposed, ProposedGroup};
pub use reach::Reach;
pub use refine::refined;
pub use session::{Session, corners_of};
pub use site_subject::site_subject;
pub use solved::Solved;
pub use still::decode;
pub use tools::{
    Icon, Pane, Phase, PlanHandle, Pointer, TOOLS, Tool, ToolRow, is_inside, plan_handles, plan_scale,
};
pub use units::Units;
pub use verdict::{Standing, Verdict, summary, verdict};
