//! How likely drawings are under given sigmas of the scene and of the hand: what these sigmas are estimated
//! from.
//!
//! The restricted likelihood (Patterson and Thompson 1971) integrates over camera and nuisance parameters,
//! flat ones and those with a prior, so that sigmas are not underestimated by what the fit absorbs. To first
//! order about the solution, with `chi2` and the normal matrix H there, n residuals of drawings of sigma
//! `sigma` and priors of sigmas `s_k`,
//!
//! `-2 log L = chi2 + log det H + 2 n log sigma + 2 sum_k log s_k`, up to a constant.
//!
//! Summed over many scenes and minimised over the sigmas it gives those of [`SceneErrors`].
//!
//! [`SceneErrors`]: crate::SceneErrors

use crate::single::constraints::Constraints;
use crate::single::fit::{Fit, FitOptions};
use crate::single::likelihood::Problem;
use crate::single::minima::weak_prior;
use crate::single::size_residual::CameraTerms;

impl Fit {
    /// Minus twice the log of the restricted likelihood of the scene's sigmas in `constraints` and the drawing's
    /// in `options`, up to a constant; `None` without a fit, or where the drawing's sigma is not given.
    ///
    /// An outlier counts as a residual of 30 px spread, so that rejecting is no gain.
    #[must_use]
    pub fn restricted_log_likelihood(constraints: &Constraints, options: &FitOptions) -> Option<f64> {
        const OUTLIER_PX: f64 = 30.0;
        let sigma = options.sigma?;
        let fit = Self::new(constraints, options).ok()?;
        let problem = Problem::new(constraints, options.fixed, options.priors, sigma, options.size[0]);
        let mut problem = Problem { rejected: &fit.outliers, ..problem };
        problem.priors.weak_log_focal = fit.weak_prior_used.then(|| weak_prior(options.size[0]));
        let drawn = problem.lines().count() + problem.lengths().count() + 2 * problem.uprights().count();
        let mut of_sigmas = 2.0 * drawn as f64 * sigma.ln();
        constraints.each_scene_prior(|_, sigma| of_sigmas += 2.0 * sigma.ln());
        let at = CameraTerms::<f64>::new(&fit.state.parameters, [0.0; 2]);
        of_sigmas += problem.lean_spread(&at).map_or(0.0, |spread| spread.log_determinant());
        let of_outliers = 2.0 * fit.outliers.len() as f64 * OUTLIER_PX.ln();
        let determinant = problem.normal(&fit.state)?.log_determinant(problem.free);
        Some(problem.cost(&fit.state)? + determinant + of_sigmas + of_outliers)
    }
}
