//! What a camera at fixed parameters predicts of drawings that were not fitted.
//!
//! What the linear model of a fit promises of the rest without each of its constraints.
//!
//! With the normal equations `N d = -g` at the minimum and those of the residuals `r` of one constraint taken
//! out, `N' = N - J'J`, `g' = g - J'r`, the rest has at the step `d = -N'^-1 g'` the chi-square
//! `chi2 - r'r - g' N'^-1 g'`, and that is `chi2 - r' (1 - H)^-1 r` with the leverage `H = J N^-1 J'`
//! (Cook 1977, "Detection of Influential Observation in Linear Regression"): a constraint that holds the fit by
//! itself has a small residual and a large leverage, and is found all the same.

use std::collections::HashMap;

use crate::optimize::{Dual, NuisanceJacobian, least_squares};
use crate::single::constraints::{Constraints, Source};
use crate::single::likelihood::{Problem, State};
use crate::single::nuisances::Nuisances;
use crate::single::parameters::{FixedParameters, Orientation, Prior, Priors};
use crate::single::plane_frame::Measured;
use crate::single::residual::Parameters;
use crate::single::size_residual::{CameraTerms, floor_length, upright_residuals};

impl Problem<'_> {
    /// The chi-square of the rest without each constraint, predicted at a minimum.
    pub(crate) fn chi2_without(&self, minimum: &State) -> HashMap<Source, f64> {
        let mut by_source: HashMap<Source, Vec<(Dual, NuisanceJacobian)>> = HashMap::new();
        let found = self.each_residual(minimum, |residual: Dual, nuisance, source| {
            source.iter().for_each(|&source| by_source.entry(source).or_default().push((residual, nuisance)));
        });
        let Some(whole) = found.and_then(|()| self.normal(minimum)) else { return HashMap::new() };
        let without = |residuals: Vec<(Dual, NuisanceJacobian)>| {
            let mut rest = whole.clone();
            for (residual, nuisance) in &residuals {
                rest.remove(residual.value, &residual.gradient, nuisance);
            }
            let State { mut parameters, mut nuisance } = minimum.clone();
            let gain = rest.step(&mut parameters, &mut nuisance, 0.0, self.free);
            // What leaves a parameter open by its absence promises no more than its own residuals.
            rest.cost - gain.map_or(0.0, |(gain, _)| gain.max(0.0))
        };
        by_source.into_iter().map(|(source, residuals)| (source, without(residuals))).collect()
    }
}

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
