//! Stage 1 of one camera, whole: all minima, outliers, sigmas, and the choice between two answers.

use nalgebra::Matrix4;

use crate::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
use crate::floor::{STAGE_1_HEIGHT, default_efov};
use crate::outcome::{Failure, Parameter};
use crate::single::abramov::{FixedParameters, Orientation};
use crate::single::accuracy::{Grid, floor_length_rel};
use crate::single::constraints::{Constraints, Source};
use crate::single::likelihood::{Problem, State, predictable};
use crate::single::minima::{Minimum, Solutions, weak_prior};
use crate::single::outliers::{OutlierSearch, inflation, is_misfit, solve_without_outliers};
use crate::single::prior::Priors;
use crate::single::residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL};

/// What the fit of one camera starts from, beside its evidence.
#[derive(Clone, Debug)]
pub struct FitOptions<'a> {
    /// Principal point and distortion.
    pub lens: Lens,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Polygon of the effective field of view, raw pixels; empty if none was drawn.
    pub efov: &'a [Pixel],
    /// What is not estimated.
    pub fixed: FixedParameters,
    /// Prior knowledge.
    pub priors: Priors,
    /// Standard deviation of a drawn coordinate, in pixels; judged by the residuals if absent.
    pub sigma: Option<f64>,
    /// Let the weak prior about the focal enter where the lines do not tell it.
    pub weak_prior: bool,
    /// Annotations that are never rejected, by index.
    pub keep: &'a [usize],
}

impl FitOptions<'_> {
    /// Nothing known beside the lens and the size of the image; the weak prior may enter.
    #[must_use]
    pub fn new(lens: Lens, size: [f64; 2]) -> Self {
        let (fixed, priors) = (FixedParameters::default(), Priors::default());
        Self { lens, size, efov: &[], fixed, priors, sigma: None, weak_prior: true, keep: &[] }
    }
}

/// Another minimum that the evidence cannot rule out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalMinimum {
    /// Its roll, pitch and focal.
    pub orientation: Orientation,
    /// Its chi-square.
    pub chi2: f64,
}

/// Stage 1 of one camera.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The camera at (0, 0, z0), yaw 0, with the covariance of what was estimated.
    pub camera: Camera,
    /// Chi-square at the solution.
    pub chi2: f64,
    /// Residuals minus unknowns.
    pub dof: i64,
    /// Standard deviation of a drawn coordinate that the covariance stands on, in pixels.
    pub sigma: f64,
    /// Predicted relative error of lengths on the floor.
    pub floor_length_rel: Option<f64>,
    /// Distance of every piece of evidence from its prediction, in pixels.
    pub residuals: Vec<(Source, f64)>,
    /// Evidence rejected.
    pub outliers: Vec<Source>,
    /// The evidence contradicts itself, and no line of it explains that.
    pub misfit: bool,
    /// Other minima that the evidence cannot rule out.
    pub alternatives: Vec<LocalMinimum>,
    /// Whether one of them is a minimum of its own (rather than the answer without the weak prior).
    pub two_solutions: bool,
    /// Standard deviation of the log focal by the lines alone; `None` when the focal is held.
    pub log_focal_sigma: Option<f64>,
    /// Whether the weak prior entered.
    pub weak_prior_used: bool,
    /// Whether the height was told by something.
    pub height_known: bool,
    pub(crate) state: State,
    pub(crate) core_covariance: Matrix4<f64>,
}

/// Chi-square by which a second minimum must be worse to be ruled out.
const RULED_OUT: f64 = 6.0;

impl Fit {
    /// The maximum-likelihood fit.
    ///
    /// # Errors
    /// When the evidence leaves more open than a weak prior about the focal can close.
    pub fn new(constraints: &Constraints, options: &FitOptions) -> Result<Self, Failure> {
        let sigma = options.sigma.unwrap_or(1.0);
        let problem = Problem::new(constraints, options.fixed, options.priors, sigma, options.size[0]);
        check_any(&problem)?;
        let keep = |source: Source| options.keep.contains(&source.annotation);
        let search = OutlierSearch {
            fixed: options.fixed,
            weak_prior: options.weak_prior,
            noise_is_known: options.sigma.is_some(),
            keep: &keep,
        };
        let (found, rejected) = solve_without_outliers(&problem, search);
        let mut problem = Problem { rejected: &rejected, ..problem.clone() };
        let log_focal_sigma = problem.free[LOG_FOCAL].then(|| {
            let alone = found.without_weak_prior.as_ref().or(found.minima.first());
            alone.map_or(f64::INFINITY, |minimum| minimum.uncertainty.sigma(LOG_FOCAL))
        });
        let weak_prior_used =
            found.without_weak_prior.is_some() || (found.minima.is_empty() && options.weak_prior);
        if weak_prior_used {
            problem.priors.weak_log_focal = Some(weak_prior(options.size[0]));
        }
        let chosen = choose(&found.minima, &problem, options).ok_or(Failure::NoOrientation)?;
        let dof = problem.dof();
        let inflation = options.sigma.map_or_else(|| inflation(found.minima[chosen].chi2, dof), |_| 1.0);
        let best = &found.minima[chosen];
        let camera = camera_of(best, &problem, options, inflation);
        let grid = grid(&camera, options.efov, options.size);
        let height_known = problem.free[LOG_HEIGHT] || options.fixed.height.is_some();
        let core_covariance = best.uncertainty.covariance * inflation;
        let rel = floor_length_rel(&best.state.parameters, &grid, &core_covariance, height_known);
        check_open(best, rel, &problem)?;
        let (alternatives, two_solutions) = alternatives(&found, chosen);
        // What was rejected is shown, too, as far as it has a prediction.
        let shown = predictable(constraints, &best.state.parameters);
        let everything = Problem { rejected: &[], constraints: &shown, ..problem.clone() };
        Ok(Self {
            camera,
            chi2: best.chi2,
            dof,
            sigma: sigma * inflation.sqrt(),
            floor_length_rel: rel,
            residuals: everything.residuals_in_pixels(&best.state).unwrap_or_default(),
            misfit: is_misfit(best.chi2, dof),
            alternatives,
            two_solutions,
            log_focal_sigma: log_focal_sigma.map(|s| s * inflation.sqrt()),
            weak_prior_used,
            height_known,
            state: best.state.clone(),
            core_covariance,
            outliers: rejected,
        })
    }

    /// Standard deviation of the log focal of the answer.
    #[must_use]
    pub fn log_focal_sigma_of_answer(&self) -> f64 {
        self.core_covariance[(LOG_FOCAL, LOG_FOCAL)].max(0.0).sqrt()
    }
}

/// Other answers that the evidence cannot rule out, and whether one of them is a minimum of its own.
fn alternatives(found: &Solutions, chosen: usize) -> (Vec<LocalMinimum>, bool) {
    let limit = found.minima[0].chi2 + RULED_OUT;
    let others = found.minima.iter().enumerate().filter(|&(i, minimum)| i != chosen && minimum.chi2 < limit);
    let mut alternatives: Vec<LocalMinimum> = others.map(|(_, minimum)| solved(minimum)).collect();
    let two_solutions = !alternatives.is_empty();
    alternatives.extend(found.without_weak_prior.as_ref().map(solved));
    (alternatives, two_solutions)
}

/// The grid of the EFOV drawn, or of the floor that counts as seen.
pub(crate) fn grid(camera: &Camera, efov: &[Pixel], size: [f64; 2]) -> Grid {
    if efov.is_empty() {
        Grid::of_floor(camera, &default_efov(camera, size).polygon)
    } else {
        Grid::of_polygon(camera, efov)
    }
}

/// Among the minima that cannot be ruled out the one nearer to what cameras usually have, unless
/// something else was said about the focal.
fn choose(minima: &[Minimum], problem: &Problem, options: &FitOptions) -> Option<usize> {
    let lowest = minima.first()?;
    if problem.priors.focal.is_some() || !options.weak_prior {
        return Some(0);
    }
    let usual = weak_prior(problem.width).value;
    let possible = minima.iter().enumerate().filter(|(_, m)| m.chi2 < lowest.chi2 + RULED_OUT);
    let distance = |m: &Minimum| (m.state.parameters[LOG_FOCAL] - usual).abs();
    possible.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b))).map(|(i, _)| i)
}

fn solved(minimum: &Minimum) -> LocalMinimum {
    LocalMinimum { orientation: minimum.state.orientation(), chi2: minimum.chi2 }
}

fn camera_of(minimum: &Minimum, problem: &Problem, options: &FitOptions, inflation: f64) -> Camera {
    let Orientation { roll, pitch, focal } = minimum.state.orientation();
    // What is held comes back as it was, to the last digit.
    let focal = options.fixed.focal.unwrap_or(focal);
    let height = match options.fixed.height {
        Some(height) => height,
        None if problem.free[LOG_HEIGHT] => minimum.state.parameters[LOG_HEIGHT].exp(),
        None => STAGE_1_HEIGHT,
    };
    // From log focal and log height to focal and height.
    let target = [(ROLL, Covariance::ROLL, 1.0), (PITCH, Covariance::PITCH, 1.0)]
        .into_iter()
        .chain([(LOG_FOCAL, Covariance::FOCAL, focal), (LOG_HEIGHT, Covariance::Z, height)]);
    let target: Vec<(usize, usize, f64)> = target.collect();
    let mut covariance = Covariance::EXACT;
    for &(i, a, by_i) in &target {
        for &(j, b, by_j) in &target {
            covariance.0[a][b] = minimum.uncertainty.covariance[(i, j)] * by_i * by_j * inflation;
        }
    }
    Camera {
        position: WorldPoint::new(0.0, 0.0, height),
        yaw: 0.0,
        pitch,
        roll,
        focal,
        lens: options.lens,
        covariance,
    }
}

fn check_any(problem: &Problem) -> Result<(), Failure> {
    let drawn = problem.lines().count() + problem.lengths().count() + problem.uprights().count();
    let open = problem.free[..3].iter().any(|&free| free);
    if drawn > 0 || !open { Ok(()) } else { Err(Failure::NothingDrawn) }
}

/// An answer whose floor is anybody's guess is none.
fn check_open(best: &Minimum, rel: Option<f64>, problem: &Problem) -> Result<(), Failure> {
    /// Relative error of floor lengths beyond which there is no answer.
    const HOPELESS: f64 = 0.5;
    /// Beyond it the fit may call itself an answer: the floor is anybody's guess.
    const ABSURD: f64 = 10.0;
    let is_told = !best.uncertainty.singular && rel.is_none_or(|rel| rel < ABSURD);
    if is_told || rel.is_some_and(|rel| rel < HOPELESS) {
        return Ok(());
    }
    let parameters = [Parameter::Roll, Parameter::Pitch, Parameter::Focal];
    let weakest = (0..3)
        .filter(|&i| problem.free[i])
        .max_by(|&a, &b| best.uncertainty.sigma(a).total_cmp(&best.uncertainty.sigma(b)))
        .map(|i| parameters[i]);
    Err(Failure::Underdetermined { weakest })
}
