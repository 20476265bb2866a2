//! Predictions of a fixed camera for constraints, and the predicted chi-square without each constraint.
//!
//! The linear model predicts the chi-square of the rest if one constraint is left out. Let `N d = -g` be the
//! normal equations at the minimum, with the step d and the gradient g. Let r be the residuals of the
//! constraint and J their Jacobian. Without the constraint the normal equations have `N' = N - J'J`,
//! `g' = g - J'r`. After the step `d = -N'^-1 g'` the chi-square of the rest is `chi2 - r'r - g' N'^-1 g'`.
//! This equals `chi2 - r' (1 - H)^-1 r` with the leverage `H = J N^-1 J'` (Cook 1977, "Detection of
//! Influential Observation in Linear Regression"). So a constraint that alone determines the fit is detected.
//! Its residual is small, but its leverage is large.

use std::collections::HashMap;

use crate::optimize::{Dual, NuisanceJacobian, least_squares};
use crate::single::constraints::{Constraints, Source};
use crate::single::likelihood::{Problem, State};
use crate::single::nuisances::Nuisances;
use crate::single::parameters::{FixedParameters, Orientation, Prior, Priors};
use crate::single::plane_frame::DistanceKind;
use crate::single::residual::Parameters;
use crate::single::size_residual::{CameraTerms, floor_length, upright_residuals};

impl Problem<'_> {
    /// Returns, for each constraint, the predicted chi-square of all others if this constraint is left out.
    /// `minimum` is the minimum with all constraints.
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
            // If the removal leaves a parameter undetermined, the gain is limited to the constraint's own
            // residuals.
            rest.cost - gain.map_or(0.0, |(gain, _)| gain.max(0.0))
        };
        by_source.into_iter().map(|(source, residuals)| (source, without(residuals))).collect()
    }
}

/// Returns the residuals in pixels of all constraints at a fixed orientation and height.
///
/// The nuisance parameters are computed in closed form. Constraints without a prediction are omitted.
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

/// Stored camera whose constraints are evaluated again.
#[derive(Clone, Copy, Debug)]
pub struct StoredCamera<'a> {
    /// Roll, pitch and focal length of the stored solution.
    pub orientation: Orientation,
    /// Height, in metres.
    pub height: f64,
    /// Whether the height is estimated again from the annotations. Otherwise it is fixed at `height`. The height
    /// of a stored camera may come from a placement by hand that is newer than its residuals.
    pub is_height_free: bool,
    /// Prior on the height.
    pub height_prior: Option<Prior>,
    /// Standard deviation of an annotated coordinate, in pixels.
    pub sigma: f64,
    /// Constraints that were rejected as outliers.
    pub rejected: &'a [Source],
    /// Width of the image, in pixels.
    pub width: f64,
}

/// Returns the residuals in pixels of all constraints that have a prediction at a stored camera, with the
/// most likely nuisance parameters.
pub fn residuals_of_stored(constraints: &Constraints, stored: &StoredCamera) -> Vec<(Source, f64)> {
    /// Maximum number of steps; the remaining problem is almost linear.
    const MAX_STEPS: usize = 20;
    let StoredCamera { orientation: at, height, .. } = *stored;
    let fixed = FixedParameters {
        roll: Some(at.roll),
        pitch: Some(at.pitch),
        focal: Some(at.focal),
        height: Some(height).filter(|_| !stored.is_height_free),
    };
    let parameters = [at.roll, at.pitch, at.focal.ln(), height.ln()];
    let constraints = predictable(constraints, &parameters);
    let priors = Priors { height: stored.height_prior, ..Priors::default() };
    let problem = Problem::new(&constraints, fixed, priors, stored.sigma, stored.width);
    let problem = Problem { rejected: stored.rejected, ..problem };
    let found = problem.state_at(parameters).and_then(|start| least_squares(&problem, start, MAX_STEPS));
    let everything = Problem { rejected: &[], ..problem.clone() };
    found.and_then(|found| everything.residuals_in_pixels(&found.state)).unwrap_or_default()
}

/// Returns the constraints that have a prediction at these parameters. Lengths above the horizon, heads behind
/// the camera, and annotations on planes above the camera have no prediction.
pub(crate) fn predictable(constraints: &Constraints, parameters: &Parameters) -> Constraints {
    let mut constraints = constraints.clone();
    let nuisance = vec![0.0; Nuisances::new(&constraints).count()];
    let planes = constraints.plane_frames(parameters, &nuisance);
    let deviations = constraints.deviations.clone();
    let at = |plane: Option<usize>, measured: DistanceKind| {
        let Some(plane) = plane else { return Some(CameraTerms::<f64>::new(parameters, [0.0; 2])) };
        let frame = planes[plane].as_ref()?;
        let parameters =
            if measured == DistanceKind::OnPlane { &frame.parameters } else { &frame.along_verticals };
        Some(CameraTerms::new(parameters, frame.tilt))
    };
    let is_above = |deviation: Option<usize>| {
        let plane = deviation.and_then(|deviation| deviations[deviation].plane);
        plane.is_none_or(|plane| planes[plane].is_some())
    };
    constraints.lines.retain(|line| is_above(line.deviation));
    constraints.lengths.retain(|length| {
        at(length.plane, DistanceKind::OnPlane)
            .is_some_and(|at| floor_length(&at, length.chart.as_ref(), &length.ends).is_some())
    });
    constraints.uprights.retain(|upright| {
        let at = at(upright.plane, DistanceKind::Upright);
        at.is_some_and(|at| upright_residuals(&at, upright, 1.0).is_some())
    });
    constraints
}
