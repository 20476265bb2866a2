//! What a camera at fixed parameters predicts of drawings that were not fitted.

use crate::optimize::least_squares;
use crate::single::constraints::{Constraints, Source};
use crate::single::fixed_parameters::FixedParameters;
use crate::single::likelihood::Problem;
use crate::single::nuisances::Nuisances;
use crate::single::orientation::Orientation;
use crate::single::plane_frame::Measured;
use crate::single::prior::{Prior, Priors};
use crate::single::residual::Parameters;
use crate::single::size_residual::{CameraTerms, floor_length, upright_residuals};

/// The residuals in pixels of all constraints at a fixed orientation and height, with the nuisance parameters
/// in closed form; constraints without a prediction there are left out.
pub fn residuals_at(
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

/// A camera whose drawings are looked at again.
#[derive(Clone, Copy, Debug)]
pub struct Held<'a> {
    /// Roll, pitch and focal of the stored solution.
    pub orientation: Orientation,
    /// In metres.
    pub height: f64,
    /// Whether the height is estimated from the drawings, as that of a camera is that somebody placed by hand.
    pub height_is_free: bool,
    /// What is known of the height.
    pub height_prior: Option<Prior>,
    /// Standard deviation of a drawn coordinate, in pixels.
    pub sigma: f64,
    /// What was rejected.
    pub rejected: &'a [Source],
    /// Of the image, in pixels.
    pub width: f64,
}

/// The residuals in pixels of all constraints that have a prediction at a camera, with the nuisance parameters
/// where they are likeliest there.
pub fn residuals_held(constraints: &Constraints, held: &Held) -> Vec<(Source, f64)> {
    /// What is left to estimate is next to linear.
    const MAX_STEPS: usize = 20;
    let Held { orientation: at, height, .. } = *held;
    let fixed = FixedParameters {
        roll: Some(at.roll),
        pitch: Some(at.pitch),
        focal: Some(at.focal),
        height: Some(height).filter(|_| !held.height_is_free),
    };
    let parameters = [at.roll, at.pitch, at.focal.ln(), height.ln()];
    let constraints = predictable(constraints, &parameters);
    let priors = Priors { height: held.height_prior, ..Priors::default() };
    let problem = Problem::new(&constraints, fixed, priors, held.sigma, held.width);
    let problem = Problem { rejected: held.rejected, ..problem };
    let found = problem.state_at(parameters).and_then(|start| least_squares(&problem, start, MAX_STEPS));
    let everything = Problem { rejected: &[], ..problem.clone() };
    found.and_then(|found| everything.residuals_in_pixels(&found.state)).unwrap_or_default()
}

/// The constraints that have a prediction at these parameters: no length above the horizon, no head behind
/// the camera.
pub(crate) fn predictable(constraints: &Constraints, parameters: &Parameters) -> Constraints {
    let mut constraints = constraints.clone();
    let nuisance = vec![0.0; Nuisances::of(&constraints).count()];
    let planes = constraints.plane_frames(parameters, &nuisance);
    let deviations = constraints.deviations.clone();
    let at = |plane: Option<usize>, measured: Measured| {
        let Some(plane) = plane else { return Some(CameraTerms::<f64>::new(parameters, [0.0; 2])) };
        let frame = planes[plane].as_ref()?;
        let parameters =
            if measured == Measured::OnPlane { &frame.parameters } else { &frame.along_verticals };
        Some(CameraTerms::new(parameters, frame.tilt))
    };
    let is_above = |deviation: Option<usize>| {
        let plane = deviation.and_then(|deviation| deviations[deviation].plane);
        plane.is_none_or(|plane| planes[plane].is_some())
    };
    constraints.lines.retain(|line| is_above(line.deviation));
    constraints.lengths.retain(|length| {
        at(length.plane, Measured::OnPlane)
            .is_some_and(|at| floor_length(&at, length.chart.as_ref(), &length.ends).is_some())
    });
    constraints.uprights.retain(|upright| {
        let at = at(upright.plane, Measured::Upright);
        at.is_some_and(|at| upright_residuals(&at, upright, 1.0).is_some())
    });
    constraints
}
