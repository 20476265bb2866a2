//! Stage 1: roll, pitch, focal length and height of one camera, with their covariance, from its annotations.
//!
//! Rule: one image; no document and no other camera. The files in data-flow order:
//!
//! - `annotation`: annotations in raw pixels, the table of their kinds, and usual sizes of common objects;
//! - `scene_errors`: standard deviations of the scene's own errors (sloping floors, corners off 90 degrees);
//! - `parameters`: orientation, fixed parameters, priors on parameters and planes, choice of distortion
//!   coefficients;
//! - `overlaps`: lines that are drawn more than once, so that repeated evidence counts once;
//! - `constraints`: undistorted constraints computed from the annotations;
//! - `straightness`, `lens_problem`, `plumb_line`: distortion from straight edges: the residuals, the
//!   least-squares problem with its priors, and the model selection;
//! - `vanishing_point`, `abramov`: the paper's method: closed forms and the criterion C;
//! - `nuisances`: layout and priors of the nuisance parameters;
//! - `residual`, `size_residual`: **residuals of a vertical line and of every other constraint**, with
//!   formulas and Jacobians;
//! - `plane_frame`, `directions`, `crossfall`, `sizes`, `likelihood`: the least-squares problem over all
//!   constraints;
//! - `minima`, `outliers`: all local minima, the chi-square test, leave-one-out rejection, contradictory
//!   uprights;
//! - `prediction`: residuals of constraints under fixed cameras, and the predicted gain of leaving one out;
//! - `accuracy`: covariance propagated to **the relative error of floor lengths**;
//! - `plausibility`: prior that cameras are upright and look down;
//! - `fit`: entry point; [`Fit::new`] runs the whole estimate;
//! - `p3p`, `point_fit`, `point_lens`: pose, focal length and lens from control points alone;
//! - `slope`: dependence of floor lengths on the slope of the ground;
//! - `advice`: findings about a fit, and suggested annotations.

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
mod p3p;
mod point_fit;
mod point_lens;
mod slope;
mod advice;

pub use abramov::{closed_form, minimum as paper_minimum};
pub use advice::{SuggestedLine, findings, floor_finding, suggest_lines};
pub use annotation::{
    Annotation, ConstraintKind, FieldUse, KINDS, Kind, KindRow, Known, Shape, USUAL_SIZES, UsualSize,
    line_name,
};
pub use constraints::{
    AnnotatedPlane, Constraints, Direction, Endpoint, InvalidSegment, LengthConstraint, LineConstraint,
    Source, UprightConstraint,
};
pub use fit::{Fit, FitOptions, LocalMinimum, grid};
pub(crate) use lens_problem::{LensResidual, lens_prior, slope_prior};
pub use outliers::{contradictory_uprights, is_inconsistent};
pub(crate) use outliers::{inflation, is_significant, student_factor};
pub(crate) use overlaps::is_repeat_of;
pub use overlaps::{MAX_OVERLAP_DISTANCE_PX, Repeats};
pub use parameters::{
    FittedCoefficients, FixedParameters, Orientation, PlanePrior, PrincipalPointPrior, Prior, Priors,
};
pub use plumb_line::{LensFit, LensOptions};
pub use point_fit::{PointFit, PointFitOptions};
pub(crate) use prediction::predictable;
pub use prediction::{StoredCamera, residuals_at, residuals_of_stored};
pub use scene_errors::{Deviation, SceneErrors};
pub use slope::{MIN_SLOPE_EFFECT_REL, STEEP_GRADE, slope_finding};
pub use straightness::{Edge, edges, outermost, straightness, straightness_rms};
pub(crate) use straightness::{edge_redundancy, repeat_counts, straightness_with_jacobian};

pub use accuracy::{placed_floor_length_rel, placed_floor_shape_rel};
pub(crate) use likelihood::{Problem, State};
pub(crate) use minima::MIN_LOG_FOCAL_SIGMA_FOR_PRIOR;
pub use minima::{MAX_LOG_FOCAL_SIGMA, MIN_CHI2_DIFFERENCE, weak_prior};
pub(crate) use residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL};
