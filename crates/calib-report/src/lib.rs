//! What is handed over of a site: drawings as SVG, and one page of HTML with every overlay, number and warning.
//!
//! No files, no clock, no pixels: pictures come and go as what a page refers to them by, so that the command line,
//! the app and the page in the browser write the same report.

// A module uses only those above it.
mod style;
mod words;
mod svg;
mod labels;
mod frame;
mod overlay;
mod plan_quality;
mod plan_view;
mod site_section;
mod planes;
mod walk_page;
mod page;
mod watch_page;

pub use overlay::overlay;
pub use page::{Picture, Pictures, Shown, page};
pub use plan_view::{GROUND, Ground, PLAN_SHARE, plan_view};
pub use planes::planes_text;
pub use site_section::{WarningKind, kinds, together, worst_first};
pub use svg::{Anchor, Stroke, Svg};
pub use walk_page::{WalkPage, direction, zone_name};
pub use watch_page::{WatchedCamera, watch_page, watch_text};
pub use words::{centimetres, decimals, distance, few, is_fitted, lens_of, scene_errors, straight_down};
