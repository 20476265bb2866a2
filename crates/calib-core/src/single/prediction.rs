//! What a camera at fixed parameters predicts of drawings that were not fitted.

use crate::single::constraints::{Constraints, Source};
use crate::single::fixed_parameters::FixedParameters;
use crate::single::likelihood::Problem;
use crate::single::orientation::Orientation;
use crate::single::prior::Priors;
use crate::single::residual::{CameraTerms, Parameters, floor_length, upright_residuals};

/// The residuals in pixels of all constraints at a fixed orientation and height, with the nuisance parameters
/// in closed form; constraints without a prediction there are left out.
pub(crate) fn residuals_at(
    constraints: &Constraints,
    at: Orientation,
    height: f64,
    width: f64,
) -> Vec<(Source, f64)> {
    let fixed = FixedParameters {
        roll: Some(at.roll),
        pitch: Some(at.pitch),
        focal: Some(at.focal),
        height: Some(height),
    };
    let parameters = [at.roll, at.pitch, at.focal.ln(), height.ln()];
    let constraints = predictable(constraints, &parameters);
    let problem = Problem::new(&constraints, fixed, Priors::default(), 1.0, width);
    problem.state_at(parameters).and_then(|state| problem.residuals_in_pixels(&state)).unwrap_or_default()
}

/// The constraints that have a prediction at these parameters: no length above the horizon, no head behind
/// the camera.
pub(crate) fn predictable(constraints: &Constraints, parameters: &Parameters) -> Constraints {
    let mut constraints = constraints.clone();
    let at = CameraTerms::<f64>::new(parameters, [0.0; 2]);
    constraints.lengths.retain(|length| floor_length(&at, &length.ends).is_some());
    constraints.uprights.retain(|upright| upright_residuals(&at, upright, 1.0).is_some());
    constraints
}
