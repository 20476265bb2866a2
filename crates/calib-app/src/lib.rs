//! The app: annotate images, see the site solved while drawing, place cameras, and check them in every view.
//!
//! The document and its tools are in `calib_editor`; this crate is the window. A module uses only modules above it in
//! the list below: the platform and storage first, then the [`state`], then features (annotate, plan, files, compare,
//! propose, export), then canvases ([`pane`]) and the window ([`shell`]).
//!
//! Sequence of a frame ([`App::logic`], [`App::show_ui`]): finished work is collected, keys become commands
//! ([`command`]), pointer events go through a canvas to the current tool, everything is painted, requests of panels are
//! carried out, and a finished gesture is autosaved ([`storage::autosave`]).

pub mod choice;
mod drawing;
pub mod platform;
pub mod theme;
pub mod icons;
pub mod paint;
pub mod canvas;
pub mod picture;
mod edges;
pub mod storage;
pub mod state;
pub mod widgets;
pub mod command;
pub mod keys;
mod handles;
pub mod overlay;
pub mod annotate;
pub mod plan;
mod files;
mod compare;
pub mod propose;
pub mod export;
pub mod pane;
pub mod scene3d;
pub mod shell;
mod frame;
#[cfg(target_arch = "wasm32")]
pub mod browser;

pub use state::App;
