//! The demonstration site: a farm shop, its store and a barn, of which everything is known.
//!
//! A small ray tracer of our own shows the scene as six cameras see it, through their lenses; the
//! plan and the operator's drawings come from the same lists of walls and things. So a calibration
//! can be held against the truth:
//!
//! ```no_run
//! let demo = calib_demo::demo_site();
//! for ((id, camera), entry) in demo.truth.iter().zip(&demo.site.cameras) {
//!     let picture = calib_demo::render(camera, entry.size_px);
//!     picture.save(format!("{id}.png")).unwrap();
//! }
//! ```

// A module uses only those above it.
pub mod random;
pub mod layout;
mod vector;
mod texture;
mod material;
mod shape;
mod tree;
mod stage;
mod building;
mod goods;
mod shop;
mod produce;
mod store;
mod barn;
mod figure;
mod world;
mod light;
mod picture;
mod plan;
mod edge;
mod hand;
mod element;
mod site;
mod walk;
#[cfg(test)]
mod checks;

pub use picture::{render, render_later};
pub use site::{DemoSite, KnownLens, demo_site, demo_site_with, demo_site_without_plan, moved};
pub use walk::{Crowd, Moved, SECOND, Seen, Walk, walk};
pub use world::visible;
