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

mod annotation;
mod scene_errors;
mod parameters;
mod overlaps;
mod constraints;
mod straightness;
mod lens_problem;
mod plumb_line;
mod vanishing_point;
mod abramov;
mod nuisances;
mod residual;
mod size_residual;
mod plane_frame;
mod directions;
mod likelihood;
mod minima;
mod outliers;
mod crossfall;
mod sizes;
mod prediction;
mod accuracy;
mod plausibility;
mod fit;
mod advice;

pub use abramov::{closed_form, minimum as paper_minimum};
pub use advice::{Sketch, draw_next, findings, floor_finding};
pub use annotation::{
    Annotation, Belongs, ConstraintKind, KINDS, Kind, KindRow, Known, Shape, USUAL_SIZES, UsualSize,
    line_name,
};
pub use constraints::{
    Constraints, Direction, DrawnPlane, Endpoint, InvalidSegment, Length, Line, Source, Upright,
};
pub use fit::{Fit, FitOptions, LocalMinimum, RULED_OUT, grid};
pub(crate) use lens_problem::{LensResidual, lens_prior, slope_prior};
pub use outliers::{heights_apart, is_inconsistent};
pub(crate) use outliers::{inflation, is_significant, student_factor};
pub(crate) use overlaps::lies_on;
pub use overlaps::{BESIDE, Repeats};
pub use parameters::{Fitted, FixedParameters, Orientation, PlanePrior, Prior, Priors};
pub use plumb_line::{LensFit, LensOptions};
pub(crate) use prediction::predictable;
pub use prediction::{Held, residuals_at, residuals_held};
pub use scene_errors::{Deviation, SceneErrors};
pub use straightness::{Edge, edges, outermost, straightness, straightness_rms};
pub(crate) use straightness::{edge_redundancy, straightness_with_jacobian, times_drawn};

pub use accuracy::{placed_floor_length_rel, placed_floor_shape_rel};
pub(crate) use likelihood::{Problem, State};
pub use minima::OPEN_FOCAL;
pub(crate) use minima::{PRIOR_TELLS, weak_prior};
pub(crate) use residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL};
