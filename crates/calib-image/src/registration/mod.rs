//! Registration of the cameras of a site from one image each: their relative poses on the floor, without
//! common annotations.
//!
//! Each camera has a calibration (roll, pitch, focal length, lens) and a height that is known to about 10 %.
//! The views may differ so much that no local feature matches. Colours of surfaces remain: the method
//! maximises the volumetric colour consistency of the images. It is related to space carving (Seitz and Dyer,
//! *Photorealistic scene reconstruction by voxel coloring*, 1999; Kutulakos and Seitz, *A theory of shape by
//! space carving*, 2000), with the poses as unknowns.
//!
//! The colours of a site are divided into classes. A ray of one image shows a surface of one class. It
//! supports a pose if the other image shows the class at the projection of a point of the ray. The formula is
//! in `pair_score`. Rays of rare classes and of small blobs have more weight.
//!
//! All lengths are in heights of the camera, because only the heights determine the scale of the floor. The
//! pose of a pair has four parameters: yaw, position, and the ratio of the heights. Colours determine the
//! length of the baseline least: poses with the same yaw and baseline direction form a ridge of the score. A
//! pair is found if its best score is much larger than the best score outside this ridge. The joint search
//! maximises the sum of the scores of all pairs of a group, with Newton's method.
//!
//! The files in data-flow order:
//!
//! - `local_view`: the frame of one camera; `lab_image`: small image in Lab;
//! - `colour_classes`: classes of the site and their shares in pixels; `colour_items`: rays with a class;
//! - `class_volume`, `direction_map`: class shares by position and by direction;
//! - `site_colours`: prepared data of all cameras, [`SiteColours`];
//! - `relative_pose`, `pair_score`: pose of a pair and its score; `pattern_search`: maximum of a score;
//! - `coarse_search`: all poses of a pair; `pair_search`: refinement and decision, [`register_pair`];
//! - `floor_pose`: spanning trees of pairs; `pair_model`: quadratic model of the score of a pair;
//! - `joint_search`: maximum of all pairs of a group;
//! - `site_registration`: the entry point, [`register`];
//! - `floor_scan`: how far the visible floor reaches; `plan_obstacles`: obstacles of a floor plan;
//! - `plan_search`: place of a group on the plan;
//! - `site_placement`: placements in a site, [`PlacementSearch`].

mod local_view;
mod lab_image;
mod colour_classes;
mod colour_items;
mod class_volume;
mod direction_map;
mod site_colours;
mod relative_pose;
mod pattern_search;
mod pair_score;
mod coarse_search;
mod pair_search;
mod floor_pose;
mod pair_model;
mod joint_search;
mod site_registration;
mod floor_scan;
mod plan_obstacles;
mod plan_search;
mod site_placement;

pub use local_view::View;
pub use pair_search::{PairDecision, PairRegistration, register_pair};
pub use site_colours::SiteColours;
pub use site_placement::{CameraPlacement, PairPlacement, PlacementSearch, SitePlacement};
pub use site_registration::{PairAgreement, SiteRegistration, join, register};

#[cfg(test)]
mod tests;
