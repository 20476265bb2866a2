//! Customer-facing reports of a site: overlays as SVG, and self-contained HTML pages.
//!
//! Its rule: no files, no clock, no pixel decoding; callers provide images as `data:` URIs. The command line,
//! the desktop app and the browser app therefore write identical reports. In data-flow order:
//!
//! - `style`, `words`, `svg`, `labels`, `frame`: sizes, text formats, SVG output, label placement, and the
//!   HTML frame;
//! - `overlay`: overlay of a camera's image;
//! - `plan_quality`, `plan_view`: the site from above, with its uncertainties;
//! - `site_section`, `planes`, `walk_page`: sections of the report;
//! - `page`: the report of a site; `watch_page`: the report of drift detection.

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
