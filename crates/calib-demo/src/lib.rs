//! Demonstration site with known truth: a farm shop, its store room and a barn.
//!
//! A small ray tracer renders the scene for six cameras with their lenses. The plan and the simulated
//! operator's annotations use the same lists of walls and objects. A calibration can therefore be compared with
//! the truth:
//!
//! ```no_run
//! let demo = calib_demo::demo_site();
//! for ((id, camera), entry) in demo.truth.iter().zip(&demo.site.cameras) {
//!     let image = calib_demo::render(camera, entry.size_px);
//!     image.save(format!("{id}.png")).unwrap();
//! }
//! ```
//!
//! # Files
//!
//! - `random`, `layout`: random rooms and sites for measuring estimators.
//! - `vector`, `texture`, `material`, `shape`, `stage`: basic types of the renderer.
//! - `building`, `goods`, `shop`, `produce`, `store`, `barn`, `figure`: objects of the scene.
//! - `tree`, `world`, `light`, `picture`: rendering.
//! - `edge`, `hand`, `element`, `plan`, `site`: annotations, plan and site document.
//! - `walk`: walking people and their detections.

// Modules use only modules above them in this list.
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
pub use plan::render_plan;
pub use site::{DemoSite, KnownLens, changed_cameras, demo_site, demo_site_with, demo_site_without_plan};
pub use walk::{Crowd, FootDetection, PoseChange, SECOND, Walk, walk};
pub use world::visible;
