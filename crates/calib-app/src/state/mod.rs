//! What views read: the document, and how it is looked at. No view is named here.

mod mode;
mod conflict;
mod path_field;
mod outside;
mod sent;
mod panes;
mod layers;
mod orbit;
mod palette;
mod tour;
mod list;
mod export;
mod reading;
mod comparing;
mod glance;
mod looking;
mod app;
mod windows;
mod suggested;
mod proposed;
mod newer;
mod work;
mod plan;

pub use app::App;
pub use conflict::{Conflict, Decision, Why};
pub use export::Sheet;
pub use glance::{Glance, Showing};
pub use layers::Layers;
pub use list::{List, Order};
pub use looking::Looking;
pub use mode::Mode;
pub use orbit::Orbit;
pub use outside::Outside;
pub use palette::Palette;
pub use panes::{Panes, Place};
pub use path_field::PathField;
pub use tour::{STEPS, Tour, TourButton, TourStep};

pub(crate) use comparing::{Comparing, OfCamera, Recovering, Step};
pub(crate) use export::{Asked, formats};
pub(crate) use orbit::NEAR;
pub(crate) use reading::{Planning, Read, ReadPicture};
pub(crate) use sent::Sent;
