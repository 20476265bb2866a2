//! The app: annotate stills, see the site solved as you draw, place the polygons, check in every view.
//!
//! A frame, in order: finished work arrives ([`app::App::logic`]), keys become commands ([`command`]),
//! the pointer goes to the tool ([`tools`]) through a canvas ([`pane`]), what differs is solved
//! ([`solved`]), everything is painted, and a finished gesture is kept ([`files::Autosave`]).

pub mod theme;
mod units;
pub mod icons;
pub mod paint;
pub mod task;
mod claim;
mod drawing;
pub mod picture;
pub mod files;
pub mod work;
pub mod shelf;
pub mod demo;
pub mod dialog;
pub mod canvas;
pub mod hit;
pub mod edit;
pub mod history;
pub mod solved;
pub mod session;
pub mod refine;
pub mod family;
pub mod snap;
pub mod edges;
pub mod epipolar;
pub mod tools;
pub mod overlay;
mod horizon;
mod lines;
mod mesh;
pub mod floor;
pub mod scene3d;
pub mod command;
mod deeds;
mod loupe;
mod minimap;
pub mod pane;
pub mod panels;
pub mod app;
mod document;
mod arrivals;
mod stills;
mod plan;
mod import;
#[cfg(target_arch = "wasm32")]
pub mod web;

pub use app::App;
pub use units::Units;
