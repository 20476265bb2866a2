//! Customer-facing reports of a site: overlays as SVG, and self-contained HTML pages.
//!
//! The crate reads no files and no clock, and decodes no images; callers provide images as `data:` URIs. The
//! command line, the desktop app and the browser app therefore write identical reports. The files in
//! data-flow order:
//!
//! - `style`, `words`, `svg`, `labels`, `frame`: sizes, text formats, SVG output, label placement, and the
//!   HTML frame;
//! - `overlay`: overlay of a camera's image;
//! - `plan_quality`, `coverage_layer`, `plan_view`: the site from above, with its uncertainties or its
//!   coverage;
//! - `site_section`, `planes`, `walk_page`, `coverage_page`, `measurement_section`: sections of the report;
//! - `summary`: usability of each camera, for customers;
//! - `page`: the report of a site; `watch_page`: the report of drift detection.

// A module uses only the modules above it.
mod style;
mod words;
mod svg;
mod labels;
mod frame;
mod overlay;
mod plan_quality;
mod coverage_layer;
mod plan_view;
mod site_section;
mod planes;
mod walk_page;
mod coverage_page;
mod measurement_section;
mod summary;
mod page;
mod watch_page;

pub use coverage_layer::{added_walls_text, count_colour, level_colour, level_text, levels};
pub use coverage_page::{CoveragePage, hand_over_text};
pub use measurement_section::{measurement_name, measurement_text, speed_remark};
pub use overlay::overlay;
pub use page::{EmbeddedImage, ImageRequest, ImageSource, coverage_html, page};
pub use plan_view::{BACKGROUND, PLAN_OPACITY, PlanBackground, coverage_view, plan_view};
pub use planes::planes_text;
pub use site_section::{WarningGroup, connectivity_text, group_warnings, worst_first};
pub use summary::{MAX_FLOOR_ERROR_REL, MAX_RMS_PX};
pub use svg::{Anchor, Stroke, Svg};
pub use walk_page::{WalkPage, disagreement_text, zone_name};
pub use watch_page::{WatchedCamera, watch_page, watch_text};
pub use words::{
    camera_lens, centimetres, decimals, distance, is_lens_estimated, measured_text, scene_errors_text,
    shortened_list, straight_down_text,
};
