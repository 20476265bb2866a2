//! Mixture likelihood of all edges under one camera: every edge belongs to the vertical, to one of the floor
//! directions, or to none.
//!
//! Let `pi_k` be the share of the edges in direction `k`, and `pi_0` the share without a direction. `odds_ik`
//! are the odds of edge `i` for direction `k` (`join.rs`). The log likelihood is
//! `log L = sum_i log(pi_0 + sum_k pi_k odds_ik)`. It is maximised over roll, pitch, log focal length,
//! azimuths and shares by expectation maximisation (Dempster, Laird and Rubin 1977). Every round computes the
//! probability that each edge belongs to each direction. It then takes one Gauss-Newton step on the weighted
//! residuals. The priors of the camera and of right angles are additional residuals.
//!
//! The prior of a camera ([`CameraPrior`]): cameras are upright and have a usual focal length.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use calib_core::Orientation;
use calib_core::single::Known;
use nalgebra::{DMatrix, DVector};

use super::frame::{Point, level, nadir};
use super::join::Line;

/// Standard deviation of the roll of installed cameras, in radians.
const ROLL_SIGMA_RAD: f64 = 0.08;
/// Median focal length of installed cameras, in image widths, as in the weak prior of the core.
const MEDIAN_FOCAL_WIDTHS: f64 = 0.8;
/// Standard deviation of the natural logarithm of the focal length, as in the weak prior of the core.
const LOG_FOCAL_SIGMA: f64 = 0.35;

/// Prior of a camera: normal densities of roll and log focal length, and a pitch with equally likely viewing
/// directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraPrior {
    /// Natural logarithm of the median focal length, in pixels.
    log_focal: f64,
    /// Standard deviation of the logarithm of the focal length.
    log_focal_sigma: f64,
    /// Whether the focal length is entered by the operator.
    is_focal_known: bool,
}

impl CameraPrior {
    /// Smallest standard deviation of the logarithm of a known focal length, so that the search covers a range.
    const MIN_LOG_FOCAL_SIGMA: f64 = 1e-3;

    /// Creates the prior for images of this width, in pixels, and for a known focal length.
    pub(super) fn new(width: f64, focal: Option<Known>) -> Self {
        let unknown = Self {
            log_focal: (MEDIAN_FOCAL_WIDTHS * width).ln(),
            log_focal_sigma: LOG_FOCAL_SIGMA,
            is_focal_known: false,
        };
        focal.map_or(unknown, |Known { value, sigma, .. }| Self {
            log_focal: value.ln(),
            log_focal_sigma: (sigma.unwrap_or(0.0) / value).max(Self::MIN_LOG_FOCAL_SIGMA),
            is_focal_known: true,
        })
    }

    /// Returns the smallest and the largest focal length of the search, in pixels; `None` if the focal length is not
    /// known.
    pub(super) fn focal_range(&self) -> Option<[f64; 2]> {
        let at = |sigmas: f64| (self.log_focal + sigmas * self.log_focal_sigma).exp();
        self.is_focal_known.then(|| [at(-3.0), at(3.0)])
    }

    /// Returns the log density of a camera over roll, pitch and log focal length, up to a constant.
    pub(super) fn log_density(&self, camera: &Orientation) -> f64 {
        let square: f64 = self.residuals(camera).iter().map(|(residual, _)| residual * residual).sum();
        camera.pitch.cos().max(1e-3).ln() - 0.5 * square
    }

    /// Returns the larger absolute residual of roll and log focal length, in standard deviations: a measure
    /// of how unusual a camera is. A known focal length is never unusual.
    pub(super) fn z_score(&self, camera: &Orientation) -> f64 {
        let [(roll, _), (focal, _)] = self.residuals(camera);
        if self.is_focal_known { roll.abs() } else { roll.abs().max(focal.abs()) }
    }

    /// Returns the residuals of roll and log focal length, in standard deviations, each with its derivative
    /// with respect to the parameter.
    pub(super) fn residuals(&self, camera: &Orientation) -> [(f64, f64); 2] {
        [
            (camera.roll / ROLL_SIGMA_RAD, ROLL_SIGMA_RAD.recip()),
            ((camera.focal.ln() - self.log_focal) / self.log_focal_sigma, self.log_focal_sigma.recip()),
        ]
    }
}

/// Largest number of expectation-maximisation rounds.
const MAX_ITERATIONS: usize = 40;
/// Largest parameter step of a converged iteration, in radians or as the log of the focal ratio.
const CONVERGED_STEP: f64 = 1e-7;
/// Standard deviation of the right angles in a scene, in radians, as in the core.
const RIGHT_ANGLE_SIGMA_RAD: f64 = 0.016;
/// Prior probability that two of the floor directions of a scene are at right angles.
const RIGHT_ANGLE_PROBABILITY: f64 = 0.95;
/// Average number of edges with the same information. A product over all edges assumes independence, but the
/// edges of one door, for example, are not independent. When cameras are compared, their log likelihood is
/// divided by this number (a composite likelihood: Varin, Reid and Firth 2011). The priors are not divided.
const EDGE_CORRELATION: f64 = 4.0;
/// Information of one weak pseudo-observation of every parameter, so that the equations are solvable without
/// edges. This information corresponds to a standard deviation of about 30 radians.
const REGULARISATION: f64 = 1e-3;

/// Mixture model: a camera, the directions of the edges, the share of edges in each direction, and the log
/// evidence.
#[derive(Clone, Debug)]
pub(super) struct Mixture {
    pub(super) camera: Orientation,
    /// Azimuths of the floor directions, in radians counter-clockwise from the camera's right.
    pub(super) azimuths: Vec<f64>,
    /// Index pairs of floor directions constrained to be at right angles.
    pub(super) right_angles: Vec<[usize; 2]>,
    /// Shares of the edges that belong to the vertical and to every floor direction. The other edges belong
    /// to no direction.
    pub(super) shares: Vec<f64>,
    /// Log evidence: the logarithm of likelihood times prior, integrated over the parameters by Laplace's
    /// approximation.
    pub(super) log_evidence: f64,
}

impl Mixture {
    /// Fits the mixture from start values: the camera, the azimuths and the pairs at right angles. Returns
    /// `None` if the edges do not determine the parameters.
    pub(super) fn fit(
        lines: &[Line],
        start: (Orientation, Vec<f64>, Vec<[usize; 2]>),
        prior: &CameraPrior,
    ) -> Option<Self> {
        let (camera, azimuths, tied) = start;
        let count = azimuths.len() + 1;
        let shares = vec![0.6 / count as f64; count];
        let mut found = Self { camera, azimuths, right_angles: tied, shares, log_evidence: 0.0 };
        for _ in 0..MAX_ITERATIONS {
            let (normal, gradient) = found.normal_equations(lines, prior);
            let step = normal.cholesky()?.solve(&gradient);
            found.move_by(&step);
            if step.amax() < CONVERGED_STEP {
                break;
            }
        }
        found.with_evidence(lines, prior)
    }

    /// Returns the vanishing points of the vertical and of every floor direction.
    pub(super) fn points(&self) -> Vec<Point> {
        let levels = self.azimuths.iter().map(|&azimuth| level(&self.camera, azimuth));
        std::iter::once(nadir(&self.camera)).chain(levels).collect()
    }

    /// Returns, for every edge, the probabilities that the edge belongs to the vertical and to each floor
    /// direction.
    pub(super) fn memberships(&self, lines: &[Line]) -> Vec<Vec<f64>> {
        let points = self.points();
        lines.iter().map(|line| self.membership(line, &points).1).collect()
    }

    /// Returns the likelihood of an edge, relative to an edge without a direction, and the probabilities that
    /// the edge belongs to each direction.
    fn membership(&self, line: &Line, points: &[Point]) -> (f64, Vec<f64>) {
        let none = 1.0 - self.shares.iter().sum::<f64>();
        let each: Vec<f64> =
            points.iter().zip(&self.shares).map(|(&point, share)| share * line.odds(point)).collect();
        let all = none + each.iter().sum::<f64>();
        (all, each.into_iter().map(|one| one / all).collect())
    }

    /// Returns, for every vanishing point, the index of each parameter that moves it, with the derivative.
    /// The parameters are roll, pitch, log focal length and the azimuths.
    pub(super) fn point_derivatives(&self) -> Vec<Vec<(usize, Point)>> {
        /// Step of the finite differences, in radians or as the log of the focal ratio.
        const STEP: f64 = 1e-6;
        let difference = |k: usize, j: usize| {
            let at = |by: f64| {
                let mut moved = self.clone();
                let mut step = DVector::zeros(3 + self.azimuths.len());
                step[j] = by;
                moved.move_by(&step);
                moved.points()[k]
            };
            let (ahead, behind) = (at(STEP), at(-STEP));
            std::array::from_fn(|c| (ahead[c] - behind[c]) / (2.0 * STEP))
        };
        let of = |k: usize| {
            let own = (k > 0).then(|| 2 + k);
            (0..3).chain(own).map(|j| (j, difference(k, j))).collect()
        };
        (0..=self.azimuths.len()).map(of).collect()
    }

    /// Builds the normal equations of the parameters, with every edge weighted by its probabilities, and
    /// updates the shares.
    fn normal_equations(&mut self, lines: &[Line], prior: &CameraPrior) -> (DMatrix<f64>, DVector<f64>) {
        let (points, derivatives) = (self.points(), self.point_derivatives());
        let mut equations = Equations::new(3 + self.azimuths.len());
        let mut totals = vec![0.0; points.len()];
        for line in lines {
            let (_, membership) = self.membership(line, &points);
            for (k, &probability) in membership.iter().enumerate() {
                totals[k] += probability;
                let Some(evidence) = line.evidence(points[k]).filter(|_| probability > 1e-4) else {
                    continue;
                };
                let slope =
                    |(j, by): &(usize, Point)| (*j, (0..3).map(|c| evidence.by_point[c] * by[c]).sum());
                let row: Vec<(usize, f64)> = derivatives[k].iter().map(slope).collect();
                equations.add(&row, evidence.residual, probability);
            }
        }
        self.add_priors(&mut equations, prior);
        // One pseudo-edge for each direction and one without a direction, so that no share is zero.
        let all = lines.len() as f64 + 1.0 + totals.len() as f64;
        self.shares = totals.iter().map(|total| (total + 1.0) / all).collect();
        (equations.normal, equations.gradient)
    }

    /// Adds the residuals of the camera prior and of the right angles.
    fn add_priors(&self, equations: &mut Equations, prior: &CameraPrior) {
        for ((residual, slope), unknown) in prior.residuals(&self.camera).into_iter().zip([0, 2]) {
            equations.add(&[(unknown, slope)], residual, 1.0);
        }
        for &[a, b] in &self.right_angles {
            let slope = RIGHT_ANGLE_SIGMA_RAD.recip();
            equations.add(
                &[(3 + a, -slope), (3 + b, slope)],
                self.right_angle_deviation([a, b]) / RIGHT_ANGLE_SIGMA_RAD,
                1.0,
            );
        }
    }

    /// Returns the deviation of two floor directions from a right angle, in radians.
    pub(super) fn right_angle_deviation(&self, [a, b]: [usize; 2]) -> f64 {
        (self.azimuths[b] - self.azimuths[a]).rem_euclid(PI) - FRAC_PI_2
    }

    /// Adds a step to the parameters roll, pitch, log focal length and azimuths, limited for each parameter.
    fn move_by(&mut self, step: &DVector<f64>) {
        /// Largest change of an angle, in radians, or of the log focal length, in one step.
        const MAX_STEP: f64 = 0.1;
        let by = |j: usize| step[j].clamp(-MAX_STEP, MAX_STEP);
        self.camera.roll += by(0);
        self.camera.pitch += by(1);
        self.camera.focal *= by(2).exp();
        self.azimuths.iter_mut().enumerate().for_each(|(k, azimuth)| *azimuth += by(3 + k));
    }

    /// Sets the log evidence: the logarithm of likelihood times prior, integrated over the parameters by
    /// Laplace's approximation. `None` if the parameters are undetermined.
    fn with_evidence(mut self, lines: &[Line], prior: &CameraPrior) -> Option<Self> {
        let points = self.points();
        let log_likelihood: f64 = lines.iter().map(|line| self.membership(line, &points).0.ln()).sum();
        let log_density = log_likelihood / EDGE_CORRELATION
            + self.log_density_of_azimuths()
            + prior.log_density(&self.camera);
        let (normal, _) = self.clone().normal_equations(lines, prior);
        let unknowns = normal.nrows() as f64;
        self.log_evidence = log_density
            + 0.5 * (unknowns * (TAU * EDGE_CORRELATION).ln() - normal.cholesky()?.ln_determinant());
        self.log_evidence.is_finite().then_some(self)
    }

    /// Returns the log prior density of the azimuths: uniform, except for an azimuth that a right
    /// angle determines.
    fn log_density_of_azimuths(&self) -> f64 {
        let free = self.azimuths.len() - self.right_angles.len();
        let of_scene = if self.right_angles.is_empty() {
            1.0 - RIGHT_ANGLE_PROBABILITY
        } else {
            RIGHT_ANGLE_PROBABILITY
        };
        let of_tie = |&pair: &[usize; 2]| {
            -0.5 * (self.right_angle_deviation(pair) / RIGHT_ANGLE_SIGMA_RAD).powi(2)
                - (TAU.sqrt() * RIGHT_ANGLE_SIGMA_RAD).ln()
        };
        of_scene.ln() - free as f64 * PI.ln() + self.right_angles.iter().map(of_tie).sum::<f64>()
    }
}

/// Normal equations of a weighted sum of squares.
struct Equations {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl Equations {
    fn new(unknowns: usize) -> Self {
        Self {
            normal: DMatrix::identity(unknowns, unknowns) * REGULARISATION,
            gradient: DVector::zeros(unknowns),
        }
    }

    /// Adds a weighted residual; `row` contains the index of each unknown with the derivative.
    fn add(&mut self, row: &[(usize, f64)], residual: f64, weight: f64) {
        for &(i, by) in row {
            self.gradient[i] -= weight * by * residual;
            for &(j, other) in row {
                self.normal[(i, j)] += weight * by * other;
            }
        }
    }
}
