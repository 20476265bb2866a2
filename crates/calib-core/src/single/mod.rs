//! Stage 1: roll, pitch, focal and height of one camera, with their covariance, from what was drawn on its
//! image.
//!
//! Law: one image; no document, no other camera. The files in the order of the data:
//!
//! - `annotation` what was drawn, in raw pixels, and the table of kinds; `usual_sizes` things of
//!   known size; `scene_errors` how far the scene may be
//!   from it; `constraints` the same, undistorted, by `drawn_constraints`; `overlaps`, `repeats`, `redrawing` what of
//!   it is drawn more than once, and counts once;
//! - `straightness`, `edge_information`, `fitted`, `lens_prior`, `lens_problem`, `open_lens`, `plumb_line` the distortion from straight edges: residuals, which edges
//!   are informative, the fit of a lens;
//! - `orientation`, `fixed_parameters` what is estimated, and what of it is known for certain;
//! - `vanishing_point`, `abramov` the paper's method: closed forms and the criterion C;
//! - `prior`, `nuisances`, `residual`, `size_residual`, `directions`, `likelihood`, `crossfall`, `leverage`, `prediction` the least-squares problem: **the residual of a vertical line** and of
//!   every other constraint is in `residual` and `size_residual`, with the formula and its Jacobian;
//! - `chi_square`, `minima`, `outliers` the test of residuals, all local minima, and leave-one-out rejection; `upright_heights` whether uprights contradict each other;
//! - `plausibility` what is believed of cameras: they stand upright and show the floor;
//! - `accuracy` the covariance propagated to the floor: **the sigma of floor lengths**;
//! - `fit` the front door: [`Fit::new`] runs all of it; `scene_likelihood` how likely drawings are under sigmas; `link_design` what shared points would tell; `advice` the findings about a fit, and what to draw next.

mod chi_square;
mod annotation;
mod usual_sizes;
mod scene_errors;
mod plane_prior;
mod endpoint;
mod overlaps;
mod repeats;
mod constraints;
mod redrawing;
mod drawn_constraints;
mod straightness;
mod edge_information;
mod fitted;
mod lens_prior;
mod lens_problem;
mod open_lens;
mod plumb_line;
mod vanishing_point;
mod orientation;
mod fixed_parameters;
mod abramov;
mod prior;
mod nuisances;
mod upright_heights;
mod residual;
mod size_residual;
mod plane_frame;
mod directions;
mod likelihood;
mod crossfall;
mod sizes;
mod leverage;
mod prediction;
mod minima;
mod outliers;
mod accuracy;
mod plausibility;
mod fit;
mod scene_likelihood;
mod link_design;
mod advice;

pub use abramov::{closed_form, minimum as paper_minimum};
pub use advice::{Sketch, draw_next, findings};
pub use annotation::{Annotation, ConstraintKind, KINDS, Kind, KindRow, Known, Shape, line_name};
pub use constraints::{Constraints, Direction, DrawnPlane, Endpoint, InvalidSegment, Length, Line, Upright};
pub use fit::{Fit, FitOptions, LocalMinimum, RULED_OUT};
pub use fitted::Fitted;
pub use fixed_parameters::FixedParameters;
pub use orientation::Orientation;
pub use plane_prior::PlanePrior;
pub use plumb_line::{LensFit, LensOptions};
pub use prior::{Prior, Priors};
pub use repeats::Repeats;
pub use scene_errors::{Deviation, SceneErrors};
pub use straightness::{Edge, straightness, straightness_rms};
pub use upright_heights::heights_apart;
pub use usual_sizes::{USUAL_SIZES, UsualSize};

pub use accuracy::{placed_floor_length_rel, placed_floor_shape_rel};
pub use advice::floor_finding;
pub use annotation::Belongs;
pub use chi_square::is_misfit;
pub(crate) use chi_square::{LEVEL, chi2_score};
pub use constraints::Source;
pub use fit::grid;
pub(crate) use lens_prior::{LensResidual, lens_prior, slope_prior};
pub(crate) use likelihood::{Problem, State};
pub use minima::OPEN_FOCAL;
pub(crate) use minima::{PRIOR_TELLS, weak_prior};
pub use outliers::is_inconsistent;
pub(crate) use outliers::{inflation, is_significant, student_factor};
pub use overlaps::BESIDE;
pub(crate) use overlaps::lies_on;
pub(crate) use prediction::predictable;
pub use prediction::{Held, residuals_at, residuals_held};
pub(crate) use residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL};
pub(crate) use straightness::{edge_redundancy, straightness_with_jacobian, times_drawn};
pub use straightness::{edges, outermost};
