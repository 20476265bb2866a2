//! State that views read: the document, its view, dialogs, storage and running work. It depends on no view.

mod view;
mod files;
mod request;
mod tour;
mod export;
mod comparing;
mod coverage;
mod measurements;
mod video;
mod address;
mod automatic;
mod app;
mod work;

pub(crate) use address::AddressSheet;
pub(crate) use app::is_offered;
pub use app::{App, Dialogs, Hover, Jobs, Storage, ViewState};
pub(crate) use automatic::{Automatic, AutomaticReport, AutomaticRow, RowPlacement};
pub(crate) use comparing::{Comparing, Recovering};
pub(crate) use coverage::Computed;
pub(crate) use coverage::ShownBorder;
pub use coverage::{Shading, ShownCoverage};
pub use export::Sheet;
pub use files::{Conflict, Decision, Outside, PathField, Why};
pub(crate) use files::{Planning, Read, ReadPicture};
pub(crate) use measurements::ShownMeasurements;
pub(crate) use request::Sent;
pub use tour::{STEPS, Tour, TourButton, TourStep};
pub(crate) use video::{Reading, SCENE_FRAMES, Still, VideoSheet};
pub(crate) use view::NEAR;
pub use view::{
    EllipseSize, Glance, Layers, List, Looking, Mode, Orbit, Order, Palette, Panes, Place, Showing,
};

pub(crate) use export::{Asked, formats};
