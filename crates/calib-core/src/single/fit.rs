//! Fit of one camera: from constraints to a camera with its covariance.
//!
//! 1. All minima of the likelihood are found from many starts. The weak prior on the focal length is added if
//!    it has a noticeable effect (`minima.rs`).
//! 2. Outliers are rejected by leave-one-out, and the rest is solved again (`outliers.rs`).
//! 3. Among minima whose chi-squares differ by less than [`MIN_CHI2_DIFFERENCE`], the most plausible one is
//!    chosen: usual focal length, upright, looking down. The other plausible ones are reported as
//!    alternatives.
//! 4. The covariance of roll, pitch, log focal length and log height is the inverse of the normal equations.
//!    If the noise was not given, the covariance is scaled by `chi2 / dof`, and by the square of Student's factor
//!    for few residuals ([`Noise`]). It is unknown if no noise level explains the residuals
//!    ([`is_inconsistent`]).
//! 5. The predicted relative error of floor lengths, [`Fit::floor_length_rel`], is that covariance propagated
//!    to the lengths between points of the EFOV (`accuracy.rs`).
//!
//! # Restricted likelihood
//!
//! [`Fit::restricted_log_likelihood`] measures the likelihood of annotations for given standard deviations of
//! the scene and of the annotation noise. The defaults of [`SceneErrors`] are estimated with it. The restricted
//! likelihood (Patterson and Thompson 1971) integrates over camera and nuisance parameters, with flat or
//! normal priors. So the fit does not bias the standard deviations downwards.
//!
//! To first order about the solution, let `chi2` and H be the chi-square and the normal matrix. With n
//! residuals of annotations of standard deviation `sigma` and priors of standard deviations `s_k`,
//!
//! `-2 log L = chi2 + log det H + 2 n log sigma + 2 sum_k log s_k`, up to a constant.
//!
//! The sum over many scenes is minimised over the standard deviations.
//!
//! [`SceneErrors`]: crate::SceneErrors

use nalgebra::Matrix4;

use crate::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
use crate::floor::{STAGE_1_HEIGHT, default_efov};
use crate::optimize::is_misfit;
use crate::outcome::{Failure, Parameter};
use crate::single::accuracy::{Grid, floor_length_rel};
use crate::single::constraints::{Constraints, Source};
use crate::single::likelihood::{Problem, State};
use crate::single::minima::{
    MAX_LOG_FOCAL_SIGMA, MIN_CHI2_DIFFERENCE, MIN_LOG_FOCAL_SIGMA_FOR_PRIOR, Minimum, Solutions,
    USUAL_FOCAL_PER_WIDTH, weak_prior, with_weak_prior,
};
use crate::single::outliers::{Noise, OutlierSearch, is_inconsistent, solve_without_outliers};
use crate::single::parameters::{FixedParameters, Orientation, Priors};
use crate::single::plausibility::{MIN_COST_DIFFERENCE, implausibility};
use crate::single::prediction::predictable;
use crate::single::residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL};
use crate::single::size_residual::CameraTerms;

/// Options of a fit: lens, image size, fixed parameters, priors and noise.
#[derive(Clone, Debug)]
pub struct FitOptions<'a> {
    /// Principal point and distortion.
    pub lens: Lens,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Polygon of the effective field of view, in raw pixels; empty if the EFOV was not annotated.
    pub efov: &'a [Pixel],
    /// Parameters that are not estimated, with their values.
    pub fixed: FixedParameters,
    /// Priors on parameters.
    pub priors: Priors,
    /// Standard deviation of an annotated coordinate, in pixels; estimated from the residuals if absent.
    pub sigma: Option<f64>,
    /// Whether the weak prior on the focal length is allowed.
    pub weak_prior: bool,
    /// Indices of annotations that are never rejected.
    pub keep: &'a [usize],
    /// Whether other cameras see the same floor, so that links may be suggested.
    pub has_neighbours: bool,
    /// Whether neither the plan nor another camera determines the scale, so that a known size may be suggested.
    pub is_scale_unknown: bool,
}

impl FitOptions<'_> {
    /// Returns options without fixed parameters and priors; the weak prior is allowed.
    #[must_use]
    pub fn new(lens: Lens, size: [f64; 2]) -> Self {
        let (fixed, priors) = (FixedParameters::default(), Priors::default());
        Self {
            lens,
            size,
            efov: &[],
            fixed,
            priors,
            sigma: None,
            weak_prior: true,
            keep: &[],
            has_neighbours: false,
            is_scale_unknown: false,
        }
    }
}

impl FitOptions<'_> {
    /// Returns the image width, in pixels, that usual focal lengths are relative to.
    ///
    /// It is the width of the image, except for a wide lens. For a wide lens it is the width for which the focal
    /// length of the lens is usual.
    fn width(&self) -> f64 {
        if self.lens.distortion.is_wide() { self.lens.focal / USUAL_FOCAL_PER_WIDTH } else { self.size[0] }
    }
}

/// Local minimum that the chi-square does not rule out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalMinimum {
    /// Roll, pitch and focal length.
    pub orientation: Orientation,
    /// Chi-square at the minimum.
    pub chi2: f64,
}

/// Estimate of stage 1 for one camera.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Camera at (0, 0, z0) with yaw 0, and the covariance of its estimated parameters.
    pub camera: Camera,
    /// Chi-square at the solution, without the weak prior.
    pub chi2: f64,
    /// Residuals minus unknowns, without the weak prior.
    pub dof: i64,
    /// Standard deviation of an annotated coordinate, in pixels: as given, or estimated from the residuals.
    pub sigma: f64,
    /// Predicted relative standard deviation of lengths on the floor; `None` if no floor is visible in the
    /// EFOV, or if the covariance is unknown.
    pub floor_length_rel: Option<f64>,
    /// Residual of every constraint, including outliers, in pixels.
    pub residuals: Vec<(Source, f64)>,
    /// Constraints rejected as outliers.
    pub outliers: Vec<Source>,
    /// Whether the chi-square is too large for the noise, and no outlier explains it.
    pub is_misfit: bool,
    /// Whether the residuals are too large for any noise estimate, so that the covariance is unknown.
    pub is_inconsistent: bool,
    /// Degrees of freedom of the noise estimate; `None` if the noise was given or assumed.
    pub noise_dof: Option<i64>,
    /// Other minima that the chi-square does not rule out.
    ///
    /// If the constraints do not determine the focal length, the minimum without the weak prior is included.
    pub alternatives: Vec<LocalMinimum>,
    /// Whether one of the alternatives is a local minimum of the same problem, rather than the minimum
    /// without the weak prior.
    pub has_two_solutions: bool,
    /// Standard deviation of the log focal length without the weak prior; `None` if the focal length is
    /// fixed.
    pub log_focal_sigma: Option<f64>,
    /// Whether the weak prior was used.
    pub has_weak_prior: bool,
    /// Whether the height is fixed, or determined by a prior, an upright or a known length.
    pub is_height_known: bool,
    /// Predicted relative standard deviation of ratios of lengths on the floor. Unlike `floor_length_rel`, it
    /// excludes the error of the common scale.
    pub(crate) floor_shape_rel: Option<f64>,
    pub(crate) state: State,
    /// Covariance of roll, pitch, log focal length and log height.
    pub(crate) core_covariance: Matrix4<f64>,
}

impl Fit {
    /// Computes the maximum-likelihood fit.
    ///
    /// # Errors
    /// If the constraints, with the weak prior on the focal length, do not determine the camera.
    pub fn new(constraints: &Constraints, options: &FitOptions) -> Result<Self, Failure> {
        let sigma = options.sigma.unwrap_or(1.0);
        let problem = Problem::new(constraints, options.fixed, options.priors, sigma, options.width());
        check_not_empty(&problem)?;
        let keep = |source: Source| options.keep.contains(&source.annotation);
        let search = OutlierSearch {
            fixed: options.fixed,
            weak_prior: options.weak_prior,
            noise_is_known: options.sigma.is_some(),
            keep: &keep,
        };
        let (found, rejected) = solve_without_outliers(&problem, search);
        let mut problem = Problem { rejected: &rejected, ..problem.clone() };
        let dof = problem.dof();
        let noise_at = |chi2: f64| match options.sigma {
            Some(_) => Noise::GIVEN,
            None => Noise::estimated(chi2, dof, rejected.len()),
        };
        let of_lines = found.without_weak_prior().first().map(|lowest| noise_at(lowest.chi2));
        let found = with_weighted_prior(found, of_lines, &problem, options);
        problem.priors.weak_log_focal = found.weak_prior.as_ref().map(|weak| weak.prior);
        let chosen = choose(&found, &problem, options).ok_or(Failure::NoOrientation)?;
        let best = &found.minima[chosen];
        let chi2 = found.chi2_of_annotations(best);
        // The reported noise is the noise that weighted the prior.
        let noise = of_lines.filter(|_| found.weak_prior.is_some()).unwrap_or_else(|| noise_at(chi2));
        let inconsistent = is_inconsistent(chi2, dof);
        let spread = noise.spread();
        let camera = Camera {
            covariance: if inconsistent { Covariance::UNKNOWN } else { covariance_of(best, spread) },
            ..camera_of(best, &problem, options)
        };
        let grid = grid(&camera, options.efov, options.size);
        let height_known = problem.free[LOG_HEIGHT] || options.fixed.height.is_some();
        let core_covariance = best.uncertainty.covariance * spread;
        let rel = floor_length_rel(&best.state.parameters, &grid, &core_covariance, height_known);
        check_determined(best, rel, &problem)?;
        let log_focal_sigma = problem.free[LOG_FOCAL].then(|| found.log_focal_sigma() * spread.sqrt());
        let (alternatives, two_solutions) = alternatives(&found, chosen, &problem, options, log_focal_sigma);
        Ok(Self {
            camera,
            chi2,
            dof,
            sigma: sigma * noise.inflation.sqrt(),
            floor_length_rel: rel.filter(|_| !inconsistent),
            floor_shape_rel: floor_length_rel(&best.state.parameters, &grid, &core_covariance, false),
            residuals: residuals(constraints, &problem, &best.state),
            is_misfit: is_misfit(chi2, dof),
            is_inconsistent: inconsistent,
            noise_dof: noise.dof,
            alternatives,
            has_two_solutions: two_solutions,
            log_focal_sigma,
            has_weak_prior: found.weak_prior.is_some(),
            is_height_known: height_known,
            state: best.state.clone(),
            core_covariance,
            outliers: rejected,
        })
    }

    /// Whether the annotations alone determine the camera: one minimum with an accurate focal length, without
    /// misfit and without the weak prior.
    #[must_use]
    pub fn determines_camera(&self) -> bool {
        let is_sharp = self.log_focal_sigma.is_none_or(|sigma| sigma < MIN_LOG_FOCAL_SIGMA_FOR_PRIOR);
        is_sharp && !(self.has_weak_prior || self.has_two_solutions || self.is_misfit)
    }

    /// Returns the standard deviation of the log focal length of this fit, with the weak prior if it was
    /// used.
    #[must_use]
    pub fn log_focal_sigma_with_prior(&self) -> f64 {
        self.core_covariance[(LOG_FOCAL, LOG_FOCAL)].max(0.0).sqrt()
    }
}

/// Returns the residuals of all constraints in pixels, including outliers, if they have a prediction.
fn residuals(constraints: &Constraints, problem: &Problem, state: &State) -> Vec<(Source, f64)> {
    let with_outliers = predictable(constraints, &state.parameters);
    let everything = Problem { rejected: &[], constraints: &with_outliers, ..problem.clone() };
    everything.residuals_in_pixels(state).unwrap_or_default()
}

/// Adds the weak prior if it has a noticeable effect, weighted against the noise estimated from the
/// residuals.
///
/// The weak prior is not added if the focal length has another prior.
fn with_weighted_prior(
    found: Solutions,
    noise: Option<Noise>,
    problem: &Problem,
    options: &FitOptions,
) -> Solutions {
    let spread = noise.map_or(1.0, |noise| noise.spread());
    let tells = found.log_focal_sigma() * spread.sqrt() > MIN_LOG_FOCAL_SIGMA_FOR_PRIOR;
    let is_asked = options.weak_prior && problem.free[LOG_FOCAL] && problem.priors.focal.is_none();
    let is_weighed = found.weak_prior.is_some() && spread <= 1.0;
    if !(is_asked && tells) || is_weighed {
        return found;
    }
    with_weak_prior(problem, options.fixed, found.without_weak_prior().to_vec(), spread)
}

/// Returns the other minima that the chi-square does not rule out. The flag is `true` if at least one of them is a
/// local minimum of the same problem. The minimum without the weak prior does not count.
///
/// If the lines determine the focal length, the weak prior does not rule out minima. It only chooses between
/// them.
fn alternatives(
    found: &Solutions,
    chosen: usize,
    problem: &Problem,
    options: &FitOptions,
    log_focal_sigma: Option<f64>,
) -> (Vec<LocalMinimum>, bool) {
    let implausibility =
        |minimum: &Minimum| implausibility(&camera_of(minimum, problem, options), options.efov);
    let best = &found.minima[chosen];
    // A camera that shows no floor may hang upside down, so other minima are reported even if unusual.
    let shows_floor = !default_efov(&camera_of(best, problem, options), options.size).polygon.is_empty();
    let beyond = if shows_floor { implausibility(best) + MIN_COST_DIFFERENCE } else { f64::INFINITY };
    let is_open = log_focal_sigma.is_some_and(|sigma| sigma > MAX_LOG_FOCAL_SIGMA);
    let lines_decide = found.weak_prior.is_some() && !is_open;
    let minima = if lines_decide { found.without_weak_prior() } else { &found.minima };
    let chi2 = |minimum: &Minimum| if lines_decide { minimum.chi2 } else { found.chi2_with_prior(minimum) };
    let limit = minima.iter().map(chi2).fold(f64::INFINITY, f64::min) + MIN_CHI2_DIFFERENCE;
    let own = if lines_decide { nearest(minima, best) } else { Some(chosen) };
    let is_possible = |minimum: &Minimum| {
        chi2(minimum) < limit && (!options.weak_prior || implausibility(minimum) < beyond)
    };
    let others = minima.iter().enumerate().filter(|&(i, minimum)| Some(i) != own && is_possible(minimum));
    let mut alternatives: Vec<LocalMinimum> = others
        .map(|(_, minimum)| LocalMinimum { orientation: minimum.state.orientation(), chi2: chi2(minimum) })
        .collect();
    let two_solutions = !alternatives.is_empty();
    if is_open && found.weak_prior.is_some() {
        alternatives.extend(found.without_weak_prior().first().map(local_minimum));
    }
    (alternatives, two_solutions)
}

/// Returns the index of the minimum closest to `to`.
fn nearest(minima: &[Minimum], to: &Minimum) -> Option<usize> {
    let distance = |minimum: &Minimum| -> f64 {
        let [turn, pitch, log_focal] =
            [ROLL, PITCH, LOG_FOCAL].map(|i| minimum.state.parameters[i] - to.state.parameters[i]);
        (0.5 * turn).sin().abs().hypot(0.5 * pitch).hypot(log_focal)
    };
    (0..minima.len()).min_by(|&a, &b| distance(&minima[a]).total_cmp(&distance(&minima[b])))
}

/// Returns the grid of points between which floor lengths are predicted, in the annotated EFOV or in the
/// default EFOV.
pub fn grid(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> Grid {
    if efov.is_empty() {
        Grid::from_floor(camera, &default_efov(camera, size).polygon)
    } else {
        Grid::from_polygon(camera, efov)
    }
}

/// Returns the index of the most plausible minimum that the chi-square does not rule out.
///
/// Plausible means: usual focal length, upright, looking down. If the focal length has another prior, the
/// chi-square replaces the usual focal length. If the weak prior is not allowed, the lowest minimum is
/// chosen.
fn choose(found: &Solutions, problem: &Problem, options: &FitOptions) -> Option<usize> {
    if found.minima.is_empty() || !options.weak_prior {
        return (!found.minima.is_empty()).then_some(0);
    }
    let usual = weak_prior(problem.width);
    let chi2 = |minimum: &Minimum| found.chi2_with_prior(minimum);
    let limit = found.minima.iter().map(chi2).fold(f64::INFINITY, f64::min) + MIN_CHI2_DIFFERENCE;
    let possible = found.minima.iter().enumerate().filter(|(_, minimum)| chi2(minimum) < limit);
    let badness = |m: &Minimum| {
        let camera = camera_of(m, problem, options);
        let of_focal = match problem.priors.focal {
            Some(_) => m.chi2,
            None => ((m.state.parameters[LOG_FOCAL] - usual.value) / usual.sigma).powi(2),
        };
        of_focal + implausibility(&camera, options.efov)
    };
    possible.min_by(|(_, a), (_, b)| badness(a).total_cmp(&badness(b))).map(|(i, _)| i)
}

/// Returns the orientation and chi-square of a minimum.
fn local_minimum(minimum: &Minimum) -> LocalMinimum {
    LocalMinimum { orientation: minimum.state.orientation(), chi2: minimum.chi2 }
}

/// Returns the camera at a minimum, without its covariance.
fn camera_of(minimum: &Minimum, problem: &Problem, options: &FitOptions) -> Camera {
    let Orientation { roll, pitch, focal } = minimum.state.orientation();
    // A fixed focal length is returned bit by bit.
    let focal = options.fixed.focal.unwrap_or(focal);
    let height = match options.fixed.height {
        Some(height) => height,
        None if problem.free[LOG_HEIGHT] => minimum.state.parameters[LOG_HEIGHT].exp(),
        None => STAGE_1_HEIGHT,
    };
    Camera {
        position: WorldPoint::new(0.0, 0.0, height),
        yaw: 0.0,
        pitch,
        roll,
        focal,
        lens: options.lens,
        covariance: Covariance::UNKNOWN,
    }
}

/// Returns the covariance of a minimum times `spread`, converted from log focal length and log height to
/// focal length and height.
fn covariance_of(minimum: &Minimum, spread: f64) -> Covariance {
    let [_, _, log_focal, log_height] = minimum.state.parameters;
    let target = [
        (ROLL, Covariance::ROLL, 1.0),
        (PITCH, Covariance::PITCH, 1.0),
        (LOG_FOCAL, Covariance::FOCAL, log_focal.exp()),
        (LOG_HEIGHT, Covariance::Z, log_height.exp()),
    ];
    let mut covariance = Covariance::EXACT;
    for (i, a, by_i) in target {
        for (j, b, by_j) in target {
            covariance.0[a][b] = minimum.uncertainty.covariance[(i, j)] * by_i * by_j * spread;
        }
    }
    covariance
}

/// Checks that there are constraints, unless roll, pitch and focal length are fixed.
fn check_not_empty(problem: &Problem) -> Result<(), Failure> {
    let count = problem.lines().count() + problem.lengths().count() + problem.uprights().count();
    let open = problem.free[..3].iter().any(|&free| free);
    if count > 0 || !open { Ok(()) } else { Err(Failure::NoAnnotations) }
}

/// Checks that the constraints determine the camera accurately enough; the error names the weakest parameter.
fn check_determined(best: &Minimum, rel: Option<f64>, problem: &Problem) -> Result<(), Failure> {
    /// Relative error of floor lengths below which a singular fit is accepted: the undetermined parameter
    /// does not matter.
    const MAX_SINGULAR_FLOOR_ERROR: f64 = 0.5;
    /// Relative error of floor lengths below which a regular fit is accepted.
    const MAX_REGULAR_FLOOR_ERROR: f64 = 10.0;
    let is_determined = !best.uncertainty.is_singular && rel.is_none_or(|rel| rel < MAX_REGULAR_FLOOR_ERROR);
    if is_determined || rel.is_some_and(|rel| rel < MAX_SINGULAR_FLOOR_ERROR) {
        return Ok(());
    }
    let parameters = [Parameter::Roll, Parameter::Pitch, Parameter::Focal];
    let weakest = (0..3)
        .filter(|&i| problem.free[i])
        .max_by(|&a, &b| best.uncertainty.sigma(a).total_cmp(&best.uncertainty.sigma(b)))
        .map(|i| parameters[i]);
    Err(Failure::Underdetermined { weakest })
}

impl Fit {
    /// Returns minus twice the log of the restricted likelihood, up to a constant.
    ///
    /// The standard deviations of the scene are in `constraints`, that of the annotation noise is in
    /// `options`. `None` if the fit fails or `options` has no noise. An outlier counts as a residual with a
    /// standard deviation of 30 px, so that rejections are no advantage.
    #[must_use]
    pub fn restricted_log_likelihood(constraints: &Constraints, options: &FitOptions) -> Option<f64> {
        /// Standard deviation of the residual of an outlier, in pixels.
        const OUTLIER_SIGMA_PX: f64 = 30.0;
        let sigma = options.sigma?;
        let fit = Self::new(constraints, options).ok()?;
        let problem = Problem::new(constraints, options.fixed, options.priors, sigma, options.size[0]);
        let mut problem = Problem { rejected: &fit.outliers, ..problem };
        problem.priors.weak_log_focal = fit.has_weak_prior.then(|| weak_prior(options.size[0]));
        let drawn = problem.lines().count() + problem.lengths().count() + 2 * problem.uprights().count();
        let mut of_sigmas = 2.0 * drawn as f64 * sigma.ln();
        constraints.each_scene_prior(|_, sigma| of_sigmas += 2.0 * sigma.ln());
        let at = CameraTerms::<f64>::new(&fit.state.parameters, [0.0; 2]);
        of_sigmas += problem.lean_spread(&at).map_or(0.0, |spread| spread.log_determinant());
        let of_outliers = 2.0 * fit.outliers.len() as f64 * OUTLIER_SIGMA_PX.ln();
        let determinant = problem.normal(&fit.state)?.log_determinant(problem.free);
        Some(problem.cost(&fit.state)? + determinant + of_sigmas + of_outliers)
    }
}
