//! Mixture likelihood of all edges under one camera: every edge belongs to the vertical, to one of the floor
//! directions, or to none.
//!
//! With the shares `pi` and the odds of `join.rs`, `log L = sum_i log(pi_0 + sum_k pi_k odds_ik)`. It is
//! maximised over roll, pitch, log focal length, azimuths and shares by expectation maximisation (Dempster,
//! Laird and Rubin 1977). Every round computes the probability that each edge belongs to each direction. It
//! then takes one Gauss-Newton step on the weighted residuals. The priors of the camera and of right angles
//! are additional residuals.
//!
//! The prior of a camera ([`CameraPrior`]): cameras are upright and have a usual focal length.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use calib_core::Orientation;
use nalgebra::{DMatrix, DVector};

use super::frame::{Point, level, nadir};
use super::join::Line;

/// Standard deviation of the roll of installed cameras, in radians.
const ROLL: f64 = 0.08;
/// Median focal length, in image widths, and standard deviation of its logarithm: the weak prior of the core.
const FOCAL: [f64; 2] = [0.8, 0.35];

/// Prior of a camera: normal densities of roll and log focal length, and a pitch with equally likely viewing
/// directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraPrior {
    log_focal: f64,
}

impl CameraPrior {
    /// Creates the prior for images of this width, in pixels.
    pub(super) fn from_width(width: f64) -> Self {
        Self { log_focal: (FOCAL[0] * width).ln() }
    }

    /// Returns the log density of a camera over roll, pitch and log focal length, up to a constant.
    pub(super) fn log_density(&self, camera: &Orientation) -> f64 {
        let square: f64 = self.residuals(camera).iter().map(|(residual, _)| residual * residual).sum();
        camera.pitch.cos().max(1e-3).ln() - 0.5 * square
    }

    /// Returns the larger of the two residuals, in standard deviations: a measure of how unusual a camera is.
    pub(super) fn z_score(&self, camera: &Orientation) -> f64 {
        self.residuals(camera).iter().map(|(residual, _)| residual.abs()).fold(0.0, f64::max)
    }

    /// Returns the residuals of roll and log focal length in standard deviations, each with its derivative.
    pub(super) fn residuals(&self, camera: &Orientation) -> [(f64, f64); 2] {
        [
            (camera.roll / ROLL, ROLL.recip()),
            ((camera.focal.ln() - self.log_focal) / FOCAL[1], FOCAL[1].recip()),
        ]
    }
}

/// Largest number of expectation-maximisation rounds.
const MAX_ITERATIONS: usize = 40;
/// Largest parameter step of a converged iteration.
const CONVERGED_STEP: f64 = 1e-7;
/// Standard deviation of a right angle in a scene, in radians, as in the core.
const RIGHT_ANGLE: f64 = 0.016;
/// Prior probability that two of the floor directions of a scene are at right angles.
const SQUARE_SCENES: f64 = 0.95;
/// Average number of edges with the same information. The edges of one door, for example, are not
/// independent, as a product over all edges assumes. When cameras are compared, their log likelihood is
/// divided by this number (a composite likelihood: Varin, Reid and Firth 2011). The priors are not divided.
const EDGE_CORRELATION: f64 = 4.0;
/// Information of one weak pseudo-observation for every parameter, so that the equations are solvable without
/// edges. It corresponds to a standard deviation of about 30 radians.
const REGULARISATION: f64 = 1e-3;

/// Camera with its directions and shares, and the resulting evidence of the edges.
#[derive(Clone, Debug)]
pub(super) struct Mixture {
    pub(super) camera: Orientation,
    pub(super) azimuths: Vec<f64>,
    /// Pairs of floor directions constrained to be at right angles.
    pub(super) right_angles: Vec<[usize; 2]>,
    /// Shares of the vertical and of every floor direction; the rest belongs to none.
    pub(super) shares: Vec<f64>,
    /// Log evidence: the logarithm of likelihood times prior, integrated over the parameters by Laplace's
    /// approximation.
    pub(super) log_evidence: f64,
}

impl Mixture {
    /// Fits the mixture from a start; `None` if the edges do not determine it.
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

    pub(super) fn points(&self) -> Vec<Point> {
        let levels = self.azimuths.iter().map(|&azimuth| level(&self.camera, azimuth));
        std::iter::once(nadir(&self.camera)).chain(levels).collect()
    }

    /// Returns, for every edge, the probabilities that it belongs to each direction.
    pub(super) fn memberships(&self, lines: &[Line]) -> Vec<Vec<f64>> {
        let points = self.points();
        lines.iter().map(|line| self.membership(line, &points).1).collect()
    }

    /// Returns the likelihood of an edge, and the probabilities that it belongs to each direction.
    fn membership(&self, line: &Line, points: &[Point]) -> (f64, Vec<f64>) {
        let none = 1.0 - self.shares.iter().sum::<f64>();
        let each: Vec<f64> =
            points.iter().zip(&self.shares).map(|(&point, share)| share * line.odds(point)).collect();
        let all = none + each.iter().sum::<f64>();
        (all, each.into_iter().map(|one| one / all).collect())
    }

    /// Computes the derivatives of every vanishing point with respect to its parameters.
    pub(super) fn point_derivatives(&self) -> Vec<Vec<(usize, Point)>> {
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

    /// Builds the normal equations, with every edge weighted by its probabilities, and updates the shares.
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
        // One pseudo-edge for each direction and for none, so that no share is zero.
        let all = lines.len() as f64 + 1.0 + totals.len() as f64;
        self.shares = totals.iter().map(|total| (total + 1.0) / all).collect();
        (equations.normal, equations.gradient)
    }

    fn add_priors(&self, equations: &mut Equations, prior: &CameraPrior) {
        for ((residual, slope), unknown) in prior.residuals(&self.camera).into_iter().zip([0, 2]) {
            equations.add(&[(unknown, slope)], residual, 1.0);
        }
        for &[a, b] in &self.right_angles {
            let slope = RIGHT_ANGLE.recip();
            equations.add(
                &[(3 + a, -slope), (3 + b, slope)],
                self.right_angle_deviation([a, b]) / RIGHT_ANGLE,
                1.0,
            );
        }
    }

    /// Returns the deviation of two floor directions from a right angle, in radians.
    pub(super) fn right_angle_deviation(&self, [a, b]: [usize; 2]) -> f64 {
        (self.azimuths[b] - self.azimuths[a]).rem_euclid(PI) - FRAC_PI_2
    }

    fn move_by(&mut self, step: &DVector<f64>) {
        /// Largest change of an angle, in radians, or of the log focal length in one step.
        const MOST: f64 = 0.1;
        let by = |j: usize| step[j].clamp(-MOST, MOST);
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

    /// Returns the log prior density of the azimuths: uniform, except for one that a right angle determines.
    fn log_density_of_azimuths(&self) -> f64 {
        let free = self.azimuths.len() - self.right_angles.len();
        let of_scene = if self.right_angles.is_empty() { 1.0 - SQUARE_SCENES } else { SQUARE_SCENES };
        let of_tie = |&pair: &[usize; 2]| {
            -0.5 * (self.right_angle_deviation(pair) / RIGHT_ANGLE).powi(2) - (TAU.sqrt() * RIGHT_ANGLE).ln()
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

    /// Adds a residual with its derivatives.
    fn add(&mut self, row: &[(usize, f64)], residual: f64, weight: f64) {
        for &(i, by) in row {
            self.gradient[i] -= weight * by * residual;
            for &(j, other) in row {
                self.normal[(i, j)] += weight * by * other;
            }
        }
    }
}
