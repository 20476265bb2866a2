//! The app: annotate images, see the site solved while drawing, place cameras, and check them in every view.
//!
//! The document and its tools are in `calib_editor`; this crate is the window. A module uses only modules
//! above it in the list below. The order is: platform, storage, [`state`], features (annotate, plan, files,
//! compare, propose, export), canvases ([`pane`]), window ([`shell`]).
//!
//! Sequence of a frame ([`App::logic`], [`App::show_ui`]):
//! 1. Finished work is collected.
//! 2. Keys become commands ([`command`]).
//! 3. Pointer events go through a canvas to the current tool, and everything is painted.
//! 4. Requests of panels are carried out.
//! 5. A finished gesture is autosaved ([`storage::autosave`]).

pub mod drawing;
pub mod choice;
pub mod platform;
pub mod theme;
pub mod icons;
pub mod paint;
mod focus;
pub mod crosshair;
pub mod canvas;
mod detail;
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
