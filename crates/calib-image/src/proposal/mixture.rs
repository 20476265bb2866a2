//! The likelihood of all edges under one camera: every edge is of the verticals, of one of the floor directions, or of
//! none of them.
//!
//! With the shares `pi` and the odds of `line.rs`, `log L = sum_i log(pi_0 + sum_k pi_k odds_ik)`. It is maximised
//! over roll, pitch, log focal, azimuths and shares by expectation and maximisation (Dempster, Laird and Rubin
//! 1977): the probability of every edge to belong to every direction, then one Gauss-Newton step on the residuals
//! so weighted, with what is believed of cameras and of right angles as residuals of their own.
//!
//! What is believed of a camera before an edge is seen: it stands upright and its lens is a usual one.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use calib_core::Orientation;
use nalgebra::{DMatrix, DVector};

use super::frame::{Point, level, nadir};
use super::join::Line;

/// Standard deviation of the roll of cameras that somebody set up, in radians.
const ROLL: f64 = 0.08;
/// Widths of the image that the focal is, and the standard deviation of its log: the weak prior of the core.
const FOCAL: [f64; 2] = [0.8, 0.35];

/// Normal densities of roll and log focal, and a pitch by which every direction of sight is as likely.
#[derive(Clone, Copy, Debug)]
pub(super) struct Belief {
    log_focal: f64,
}

impl Belief {
    /// Of a camera with images of this width, in pixels.
    pub(super) fn of_width(width: f64) -> Self {
        Self { log_focal: (FOCAL[0] * width).ln() }
    }

    /// Log density of a camera by roll, pitch and log focal, up to a constant.
    pub(super) fn log_density(&self, camera: &Orientation) -> f64 {
        let square: f64 = self.residuals(camera).iter().map(|(residual, _)| residual * residual).sum();
        camera.pitch.cos().max(1e-3).ln() - 0.5 * square
    }

    /// How unusual a camera is: its larger residual, in sigmas.
    pub(super) fn sigmas(&self, camera: &Orientation) -> f64 {
        self.residuals(camera).iter().map(|(residual, _)| residual.abs()).fold(0.0, f64::max)
    }

    /// The residuals of roll and log focal in sigmas, each with its derivative.
    pub(super) fn residuals(&self, camera: &Orientation) -> [(f64, f64); 2] {
        [
            (camera.roll / ROLL, ROLL.recip()),
            ((camera.focal.ln() - self.log_focal) / FOCAL[1], FOCAL[1].recip()),
        ]
    }
}

/// Expectations at most.
const ROUNDS: usize = 40;
/// A step that moves every parameter by less than this ends the search.
const STILL: f64 = 1e-7;
/// Standard deviation of a right angle in a scene, in radians: that of the core.
const RIGHT_ANGLE: f64 = 0.016;
/// How probable it is, before an edge is seen, that two of the floor directions of a scene are at right angles.
const SQUARE_SCENES: f64 = 0.95;
/// How many edges say the same: those of one door are not as independent as a product over all edges has them. Where
/// cameras are compared, their log likelihood is divided by it (a composite likelihood: Varin, Reid and Firth 2011);
/// what is believed before an edge is seen is believed once, and is not.
const ALIKE: f64 = 4.0;
/// One pseudo-observation for every unknown that nothing is believed of, so that the equations can be solved where
/// no edge speaks: a radian is known to about 30.
const REGULAR: f64 = 1e-3;

/// A camera with its directions and shares, and how likely they make the edges.
#[derive(Clone, Debug)]
pub(super) struct Mixture {
    pub(super) camera: Orientation,
    pub(super) azimuths: Vec<f64>,
    /// Pairs of floor directions that are at right angles to each other.
    pub(super) tied: Vec<[usize; 2]>,
    /// Of the verticals, then of every floor direction; the rest is of none.
    pub(super) shares: Vec<f64>,
    /// Log of the evidence: the posterior integrated over the parameters, to first order (Laplace).
    pub(super) log_evidence: f64,
}

impl Mixture {
    /// The likeliest from a start; `None` where the edges do not determine it.
    pub(super) fn fitted(
        lines: &[Line],
        start: (Orientation, Vec<f64>, Vec<[usize; 2]>),
        belief: &Belief,
    ) -> Option<Self> {
        let (camera, azimuths, tied) = start;
        let count = azimuths.len() + 1;
        let shares = vec![0.6 / count as f64; count];
        let mut found = Self { camera, azimuths, tied, shares, log_evidence: 0.0 };
        for _ in 0..ROUNDS {
            let (normal, gradient) = found.expected(lines, belief);
            let step = normal.cholesky()?.solve(&gradient);
            found.move_by(&step);
            if step.amax() < STILL {
                break;
            }
        }
        found.concluded(lines, belief)
    }

    pub(super) fn points(&self) -> Vec<Point> {
        let levels = self.azimuths.iter().map(|&azimuth| level(&self.camera, azimuth));
        std::iter::once(nadir(&self.camera)).chain(levels).collect()
    }

    /// The probability of every edge to belong to every direction, by edge.
    pub(super) fn memberships(&self, lines: &[Line]) -> Vec<Vec<f64>> {
        let points = self.points();
        lines.iter().map(|line| self.membership(line, &points).1).collect()
    }

    /// The likelihood of an edge, and the probability to belong to every direction.
    fn membership(&self, line: &Line, points: &[Point]) -> (f64, Vec<f64>) {
        let none = 1.0 - self.shares.iter().sum::<f64>();
        let each: Vec<f64> =
            points.iter().zip(&self.shares).map(|(&point, share)| share * line.odds(point)).collect();
        let all = none + each.iter().sum::<f64>();
        (all, each.into_iter().map(|one| one / all).collect())
    }

    /// Derivatives of every vanishing point by the parameters that it depends on.
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

    /// The normal equations with every edge weighted by its probabilities; takes the shares on the way.
    fn expected(&mut self, lines: &[Line], belief: &Belief) -> (DMatrix<f64>, DVector<f64>) {
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
        self.add_beliefs(&mut equations, belief);
        // One edge more of each and of none: no share is nothing.
        let all = lines.len() as f64 + 1.0 + totals.len() as f64;
        self.shares = totals.iter().map(|total| (total + 1.0) / all).collect();
        (equations.normal, equations.gradient)
    }

    fn add_beliefs(&self, equations: &mut Equations, belief: &Belief) {
        for ((residual, slope), unknown) in belief.residuals(&self.camera).into_iter().zip([0, 2]) {
            equations.add(&[(unknown, slope)], residual, 1.0);
        }
        for &[a, b] in &self.tied {
            let slope = RIGHT_ANGLE.recip();
            equations.add(&[(3 + a, -slope), (3 + b, slope)], self.off_square([a, b]) / RIGHT_ANGLE, 1.0);
        }
    }

    /// How far two floor directions are from a right angle, in radians.
    pub(super) fn off_square(&self, [a, b]: [usize; 2]) -> f64 {
        (self.azimuths[b] - self.azimuths[a]).rem_euclid(PI) - FRAC_PI_2
    }

    fn move_by(&mut self, step: &DVector<f64>) {
        /// Most that one step turns, in radians, or changes the log focal.
        const MOST: f64 = 0.1;
        let by = |j: usize| step[j].clamp(-MOST, MOST);
        self.camera.roll += by(0);
        self.camera.pitch += by(1);
        self.camera.focal *= by(2).exp();
        self.azimuths.iter_mut().enumerate().for_each(|(k, azimuth)| *azimuth += by(3 + k));
    }

    /// With its evidence: the posterior density integrated over the unknowns to first order (Laplace).
    fn concluded(mut self, lines: &[Line], belief: &Belief) -> Option<Self> {
        let points = self.points();
        let log_likelihood: f64 = lines.iter().map(|line| self.membership(line, &points).0.ln()).sum();
        let log_density =
            log_likelihood / ALIKE + self.log_density_of_azimuths() + belief.log_density(&self.camera);
        let (normal, _) = self.clone().expected(lines, belief);
        let unknowns = normal.nrows() as f64;
        self.log_evidence =
            log_density + 0.5 * (unknowns * (TAU * ALIKE).ln() - normal.cholesky()?.ln_determinant());
        self.log_evidence.is_finite().then_some(self)
    }

    /// Log density of the azimuths before an edge is seen: any, but for one that a right angle gives.
    fn log_density_of_azimuths(&self) -> f64 {
        let free = self.azimuths.len() - self.tied.len();
        let of_scene = if self.tied.is_empty() { 1.0 - SQUARE_SCENES } else { SQUARE_SCENES };
        let of_tie = |&pair: &[usize; 2]| {
            -0.5 * (self.off_square(pair) / RIGHT_ANGLE).powi(2) - (TAU.sqrt() * RIGHT_ANGLE).ln()
        };
        of_scene.ln() - free as f64 * PI.ln() + self.tied.iter().map(of_tie).sum::<f64>()
    }
}

/// Normal equations of a weighted sum of squares.
struct Equations {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl Equations {
    fn new(unknowns: usize) -> Self {
        Self { normal: DMatrix::identity(unknowns, unknowns) * REGULAR, gradient: DVector::zeros(unknowns) }
    }

    /// A residual with its derivatives.
    fn add(&mut self, row: &[(usize, f64)], residual: f64, weight: f64) {
        for &(i, by) in row {
            self.gradient[i] -= weight * by * residual;
            for &(j, other) in row {
                self.normal[(i, j)] += weight * by * other;
            }
        }
    }
}
