//! What is drawn of a site on the images of its cameras and on its plan, made once for every painter.
//!
//! A painter asks for layers ([`on_image`], [`on_plan`]) and gets items: polylines, points and words in raw
//! pixels or in metres of the floor, each with its [`Meaning`]. [`Look`] says how a meaning looks; a new
//! kind of annotation has its row in [`KIND_LOOKS`] and needs no change in a painter. Handles, hover and
//! gestures are the business of a program that has them, signs of the size of the screen are laid where the
//! painter has drawn their line ([`lay`]).
//!
//! ```
//! use calib_draw::{Geometry, ImageLayer, ImageView, Look, Signs, on_image};
//!
//! let site = calib_site::Site::from_json(
//!     r#"{"format": "calib-site", "version": 1, "cameras": [{"id": "door", "size_px": [1920, 1080],
//!         "annotations": [{"kind": "vertical", "segments": [[[300, 200], [310, 700]]]}]}]}"#,
//! )?;
//! let view = ImageView::new(&site, 0);
//! let items = on_image(&view, &[ImageLayer::Annotations(Signs::OfKinds)]);
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
pub use image::{ImageLayer, ImageView, Signs, extension, guide, horizon, metres, on_image, reach, seen};
pub use item::{Geometry, Item, Line, Meaning, Sighted};
pub use kind::{Form, KIND_LOOKS, KindLook, Laid, Sign, Stand, lay};
pub use look::{LINE, Look, Outline};
pub use plan::{PlanLayer, PlanView, cone_corners, on_plan};
pub use scene::Scene;
