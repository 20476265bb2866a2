//! What the linear model of a fit promises of the rest without each of its constraints.
//!
//! With the normal equations `N d = -g` at the minimum and those of the residuals `r` of one constraint taken
//! out, `N' = N - J'J`, `g' = g - J'r`, the rest has at the step `d = -N'^-1 g'` the chi-square
//! `chi2 - r'r - g' N'^-1 g'`, and that is `chi2 - r' (1 - H)^-1 r` with the leverage `H = J N^-1 J'`
//! (Cook 1977, "Detection of Influential Observation in Linear Regression"): a constraint that holds the fit by
//! itself has a small residual and a large leverage, and is found all the same.

use std::collections::HashMap;

use crate::optimize::{Dual, NuisanceJacobian};
use crate::single::constraints::Source;
use crate::single::likelihood::{Problem, State};

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
