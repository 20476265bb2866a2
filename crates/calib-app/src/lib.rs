//! The app: annotate stills, see the site solved as you draw, place the polygons, check in every view.
//!
//! The document is `calib_editor`'s; this is the window about it. A frame, in order: finished work arrives
//! ([`app::App::logic`]), keys become commands ([`command`]), the pointer goes to the tool in hand through a
//! canvas ([`pane`]), everything is painted, what panels asked for is done, and a finished gesture is kept
//! ([`autosave`]).

pub mod platform;
pub mod theme;
pub mod icons;
pub mod paint;
mod drawing;
pub mod picture;
pub mod files;
pub mod autosave;
pub mod shelf;
pub mod demo;
pub mod dialog;
pub mod canvas;
pub mod refine;
pub mod edges;
pub mod overlay;
mod horizon;
mod lines;
mod mesh;
pub mod floor;
pub mod scene3d;
pub mod command;
pub mod keys;
mod loupe;
mod minimap;
pub mod panes;
mod handles;
pub mod pane;
pub mod panels;
pub mod app;
mod document;
mod arrivals;
mod stills;
mod plan;
mod import;

pub use app::App;
