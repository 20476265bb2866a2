//! Overlays of a site on the images of its cameras and on its floor plan, shared by all painters (app,
//! report).
//!
//! A painter passes layers to [`on_image`] or [`on_plan`], which return items with geometry and [`Meaning`].
//! [`Look`] maps a meaning to colour, width and dash. A new kind of annotation that is drawn as lines needs only an
//! entry in [`KIND_LOOKS`]; no painter changes. The geometry of items is in raw pixels or floor metres.
//! The app adds handles, hover and gestures. The painter places signs of constant screen size on its lines
//! with [`place_sign`]. The files in data-flow order:
//!
//! - `scene`: a site and its results;
//! - `agreement`: distances between observed and solved links and marks;
//! - `image`, `plan`: the layers of an image and of the plan;
//! - `item`: items and their meanings;
//! - `colour`, `kind`, `look`: the appearance of every meaning.
//!
//! ```
//! use calib_draw::{Geometry, ImageLayer, ImageView, Look, Signs, on_image};
//!
//! let site = calib_site::Site::from_json(
//!     r#"{"format": "calib-site", "version": 1, "cameras": [{"id": "door", "size_px": [1920, 1080],
//!         "annotations": [{"kind": "vertical", "segments": [[[300, 200], [310, 700]]]}]}]}"#,
//! )?;
//! let view = ImageView::new(&site, 0);
//! let items = on_image(&view, &[ImageLayer::Annotations(Signs::All)]);
//! let lines = items.iter().filter(|item| matches!(item.geometry, Geometry::Polyline(_)));
//! assert_eq!(lines.map(|line| Look::of(line.meaning).colour.to_string()).collect::<Vec<_>>(), ["#5BB8F5"]);
//! # Ok::<(), calib_site::SiteError>(())
//! ```

mod colour;
mod kind;
mod item;
mod look;
mod scene;
mod agreement;
mod image;
mod plan;

pub use agreement::{Element, Sighting, View, elements};
pub use colour::Rgb;
pub use image::{ImageLayer, ImageView, Signs, extension, grid_step, guide, horizon, on_image, project};
pub use item::{AnnotatedLine, ElementStatus, Geometry, Item, Meaning};
pub use kind::{KIND_LOOKS, KindLook, PlacedShape, Sign, SignPosition, SignShape, place_sign};
pub use look::{LINE_WIDTH, Look, Outline};
pub use plan::{PlanLayer, PlanView, cone_corners, on_plan};
pub use scene::Scene;
