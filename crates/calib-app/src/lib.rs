//! The app: annotate stills, see the site solved as you draw, place the polygons, check in every view.
//!
//! The document is `calib_editor`'s; this is the window about it. Low stands what views read, the [`state`]; then
//! what comes in and goes out, commands, canvases and panels; highest the frame, which calls them. In its order:
//! finished work arrives ([`App::logic`]), keys become commands ([`command`]), the pointer goes to the tool in
//! hand through a canvas ([`pane`]), everything is painted, what panels asked for is done, and a finished gesture
//! is kept ([`autosave`]).

// A file uses only those above it; a test holds it.
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
