//! Camera from control points: pose and focal length, without any line.
//!
//! The residuals are the reprojection errors of the points in raw pixels, in standard deviations, and the
//! priors. Seven parameters are estimated: position, yaw, pitch, roll and log focal length.
//!
//! 1. **Starts.** Triples of points give poses by P3P. If the focal length is not fixed, its values are a
//!    geometric sequence, or values around its prior.
//! 2. **Consensus.** The starts with the least `sum of ln(1 + e^2 / s^2)` are refined with weights `1 / (1 +
//!    e^2 / s^2)` (Cauchy's loss, iteratively reweighted), so that wrong points have little influence
//!    (Fischler and Bolles 1981 for the idea of minimal samples).
//! 3. **Minima.** Points beyond the limit for inliers are outliers, if the others are redundant. The camera is
//!    then refined by least squares from the inliers. Every distinct minimum is a candidate.
//!
//! Four points of a plane determine the focal length if the plane is not parallel to the image (Zhang 2000,
//! section 3.1). Three points determine the pose up to four solutions if the focal length is known.

use nalgebra::{SMatrix, SVector};

use crate::camera::{
    Camera, Covariance, Lens, ObservedPixel, POSE_PARAMS, PosedCamera, WorldPoint, angles_from_rotation, dot,
};
use crate::floor::ControlPoint;
use crate::optimize::{LeastSquares, damp_diagonal, least_squares, product, pseudo_invert};
use crate::single::minima::{MIN_CHI2_DIFFERENCE, MIN_LOG_FOCAL_SIGMA_FOR_PRIOR, weak_prior};
use crate::single::p3p::{Pose, p3p};
use crate::single::parameters::{FixedParameters, Prior, Priors};
use crate::single::plausibility::implausibility;

/// Inputs of a [`PointFit`] beside the points.
#[derive(Clone, Copy, Debug)]
pub struct PointFitOptions<'a> {
    /// Lens of the camera, including its principal point.
    pub lens: Lens,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Fixed parameters.
    pub fixed: FixedParameters,
    /// Priors.
    pub priors: Priors,
    /// Standard deviation of a pixel coordinate, in pixels.
    pub sigma: f64,
    /// Standard deviations of the coordinates of each point, in metres. Points without one are exact.
    pub position_sigmas: &'a [f64],
}

/// Camera whose pose and focal length are estimated from control points.
#[derive(Clone, Debug, PartialEq)]
pub struct PointFit {
    /// Most plausible camera, with the covariance that follows from `sigma` in the options.
    pub camera: Camera,
    /// Chi-square of the inliers and priors.
    pub chi2: f64,
    /// Number of residuals of the inliers and priors, minus the number of parameters.
    pub dof: i64,
    /// Cauchy's loss of all points and priors, `sum of ln(1 + e^2 / s^2)`, plus a small cost of an unusual focal
    /// length. The scale s is three standard deviations for points, and one for priors.
    pub loss: f64,
    /// Indices of the points that contradict the others.
    pub outliers: Vec<usize>,
    /// Standard deviation of the log focal length from points and priors; `None` if the focal length is
    /// fixed.
    pub log_focal_sigma: Option<f64>,
    /// Other cameras that the chi-square does not rule out. They have at most as many outliers as the camera with
    /// the least loss.
    pub alternatives: Vec<Camera>,
}

/// Index of the height in the state, which is in the order of [`Covariance`]. The other indices follow.
const Z: usize = Covariance::Z;
const PITCH: usize = Covariance::PITCH;
const ROLL: usize = Covariance::ROLL;
const LOG_FOCAL: usize = POSE_PARAMS - 1;

type State = [f64; POSE_PARAMS];
/// Square matrix with a row and a column for every parameter of the state, stored row by row.
type Square = [f64; POSE_PARAMS * POSE_PARAMS];
type Column = [f64; POSE_PARAMS];

/// Minimum of the weighted sum of squares.
#[derive(Clone)]
struct Minimum {
    camera: Camera,
    cost: f64,
    /// Loss of the camera, as in [`PointFit::loss`].
    loss: f64,
    outliers: Vec<usize>,
    dof: i64,
    log_focal_sigma: Option<f64>,
}

impl PointFit {
    /// Computes the fit. Returns `None` for fewer than three points, for collinear points, and if no triple of
    /// points has a pose.
    #[must_use]
    pub fn new(points: &[ControlPoint], options: &PointFitOptions) -> Option<Self> {
        /// Number of starts that are refined.
        const MAX_REFINED: usize = 8;
        /// Largest difference of Cauchy's loss from the least one. Two poses that the points do not
        /// distinguish differ by less.
        const MAX_LOSS_DIFFERENCE: f64 = 10.0;
        let problem = Problem::new(points, options);
        let mut minima: Vec<Minimum> = Vec::new();
        let mut consensuses: Vec<Camera> = Vec::new();
        for start in problem.best_starts(MAX_REFINED) {
            let Some(consensus) = problem.consensus(&start, &consensuses) else { continue };
            consensuses.push(consensus);
            // A minimum with a clearly larger loss is a wrong pose.
            let least = minima.iter().map(|known| known.loss).fold(f64::INFINITY, f64::min);
            if problem.loss_below(&consensus, least + MAX_LOSS_DIFFERENCE).is_none() {
                continue;
            }
            let Some(minimum) = problem.minimum(&consensus) else { continue };
            if !minima.iter().any(|known| is_same(&known.camera, &minimum.camera)) {
                minima.push(minimum);
            }
        }
        problem.choose(minima)
    }

    /// Computes the fit from one start, without a search. `None` if no minimum is reached.
    pub(crate) fn near(points: &[ControlPoint], options: &PointFitOptions, start: &Camera) -> Option<Self> {
        let problem = Problem::new(points, options);
        let start = Camera { lens: options.lens, ..*start };
        let minimum = problem.minimum(&problem.consensus(&start, &[])?)?;
        problem.choose(vec![minimum])
    }
}

/// Converts the covariance of a state to that of a camera with this focal length.
fn camera_covariance(square: &Square, focal: f64) -> Covariance {
    let by = |i: usize| if i == LOG_FOCAL { focal } else { 1.0 };
    let mut covariance = Covariance::EXACT;
    for i in 0..POSE_PARAMS {
        for j in 0..POSE_PARAMS {
            covariance.0[i][j] = square[i * POSE_PARAMS + j] * by(i) * by(j);
        }
    }
    covariance
}

/// Whether two cameras are the same minimum.
fn is_same(a: &Camera, b: &Camera) -> bool {
    let (p, q) = (a.position, b.position);
    let distance = p.distance(q);
    let turn: f64 =
        [a.yaw - b.yaw, a.pitch - b.pitch, a.roll - b.roll].iter().map(|by| (0.5 * by).sin().powi(2)).sum();
    distance < 1e-3 * (1.0 + p.z.abs()) && turn.sqrt() < 1e-3 && (a.focal / b.focal).ln().abs() < 1e-3
}

/// Weighted least-squares problem: reprojection errors of the control points, and priors.
struct Problem<'a> {
    points: &'a [ControlPoint],
    observed: Vec<Option<ObservedPixel>>,
    options: &'a PointFitOptions<'a>,
    free: [bool; POSE_PARAMS],
    /// Weights of the squared errors of the points, in 1 / px^2.
    weights: Vec<f64>,
    weak_log_focal: Option<Prior>,
}

impl<'a> Problem<'a> {
    fn new(points: &'a [ControlPoint], options: &'a PointFitOptions<'a>) -> Self {
        let FixedParameters { roll, pitch, focal, height } = options.fixed;
        let mut free = [true; POSE_PARAMS];
        free[Z] = height.is_none();
        free[PITCH] = pitch.is_none();
        free[ROLL] = roll.is_none();
        free[LOG_FOCAL] = focal.is_none();
        let observed = points.iter().map(|point| ObservedPixel::new(point.pixel, &options.lens)).collect();
        Self { points, observed, options, free, weights: vec![1.0; points.len()], weak_log_focal: None }
    }

    /// Returns the focal lengths at which starts are computed.
    fn focals(&self) -> Vec<f64> {
        /// Range of unknown focal lengths, in image widths.
        const RANGE: [f64; 2] = [0.25, 16.0];
        /// Number of start values of an unknown focal length; neighbours differ by a factor of 1.3.
        const COUNT: u32 = 17;
        if let Some(focal) = self.options.fixed.focal {
            return vec![focal];
        }
        if let Some(Prior { value, sigma }) = self.options.priors.focal {
            let around = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|by| value + by * sigma);
            return around.into_iter().filter(|&focal| focal > 0.2 * value).collect();
        }
        let ratio = (RANGE[1] / RANGE[0]).powf(f64::from(COUNT - 1).recip());
        let mut focals: Vec<f64> =
            (0..COUNT).map(|i| self.options.size[0] * RANGE[0] * ratio.powf(f64::from(i))).collect();
        // The usual focal lengths come first, because good starts make the search shorter.
        let usual = weak_prior(self.options.size[0]).value;
        focals.sort_by(|a, b| (a.ln() - usual).abs().total_cmp(&(b.ln() - usual).abs()));
        focals
    }

    /// Returns the `count` candidate cameras with the least loss, ascending by loss. The candidates are the
    /// solutions of P3P for the triples of points and the focal lengths.
    fn best_starts(&self, count: usize) -> Vec<Camera> {
        /// Largest number of triples for which every triple is used with every focal length. With more triples, each
        /// focal length uses every second triple.
        const MAX_TRIPLES_OF_EVERY_FOCAL: usize = 12;
        let triples = triples(self.points, &self.observed);
        let mut best: Vec<(f64, Camera)> = Vec::with_capacity(count + 1);
        let focals = self.focals();
        // Neighbouring focal lengths are similar, so each focal length uses every second triple of many.
        let step = if focals.len() > 1 && triples.len() > MAX_TRIPLES_OF_EVERY_FOCAL { 2 } else { 1 };
        for (index, &focal) in focals.iter().enumerate() {
            let own = triples.iter().skip(index % step).step_by(step);
            for camera in own.flat_map(|triple| self.cameras_of(*triple, focal)) {
                let limit = best.get(count - 1).map_or(f64::INFINITY, |(loss, _)| *loss);
                let Some(loss) = self.loss_below(&camera, limit) else { continue };
                best.insert(best.partition_point(|(other, _)| *other <= loss), (loss, camera));
                best.truncate(count);
            }
        }
        best.into_iter().map(|(_, camera)| camera).collect()
    }

    fn cameras_of(&self, triple: [usize; 3], focal: f64) -> Vec<Camera> {
        let blank = Camera {
            position: WorldPoint::default(),
            yaw: 0.0,
            pitch: 0.0,
            roll: 0.0,
            focal,
            lens: self.options.lens,
            covariance: Covariance::UNKNOWN,
        };
        let rays = triple.map(|i| {
            let [x, y, w] = blank.lens.bearing(self.points[i].pixel).unwrap_or([f64::NAN; 3]);
            [x / focal, y / focal, w]
        });
        let world = triple.map(|i| {
            let WorldPoint { x, y, z } = self.points[i].world;
            [x, y, z]
        });
        let camera = |pose: Pose| {
            let (roll, pitch, yaw) = angles_from_rotation(&pose.rotation);
            let [x, y, z] = pose.centre;
            let FixedParameters { roll: fixed_roll, pitch: fixed_pitch, height, .. } = self.options.fixed;
            Camera {
                position: WorldPoint::new(x, y, height.unwrap_or(z)),
                yaw,
                pitch: fixed_pitch.unwrap_or(pitch),
                roll: fixed_roll.unwrap_or(roll),
                ..blank
            }
        };
        p3p(&rays, &world).into_iter().map(camera).collect()
    }

    /// Returns the reprojection error of a point divided by the scale of Cauchy's loss, which is three standard
    /// deviations. It is infinite if the camera does not show the point. `rotation` is the rotation of the
    /// camera.
    fn scaled_error(&self, camera: &Camera, rotation: &[[f64; 3]; 3], index: usize) -> f64 {
        let ControlPoint { world, pixel, .. } = self.points[index];
        let WorldPoint { x, y, z } = camera.position;
        let offset = [world.x - x, world.y - y, world.z - z];
        let shown = camera.project(rotation.map(|row| dot(&row, &offset)));
        let error = shown.map_or(f64::INFINITY, |shown| shown.distance(pixel));
        error / (3.0 * self.sigma(camera, index))
    }

    /// Returns the standard deviation of a coordinate of a reprojection error, in raw pixels. It combines the
    /// noise of the pixel with the uncertainty of the point's position, projected into the image.
    fn sigma(&self, camera: &Camera, index: usize) -> f64 {
        let of_position = self.options.position_sigmas.get(index).map_or(0.0, |sigma| {
            sigma * camera.focal / camera.position.distance(self.points[index].world).max(1e-3)
        });
        self.options.sigma.hypot(of_position)
    }

    /// Returns Cauchy's loss of all points and priors, plus a small cost of an unusual focal length.
    fn loss(&self, camera: &Camera) -> f64 {
        self.loss_below(camera, f64::INFINITY).unwrap_or(f64::INFINITY)
    }

    /// Returns the loss of [`Self::loss`]; `None` if it is not below `limit`.
    fn loss_below(&self, camera: &Camera, limit: f64) -> Option<f64> {
        /// Largest loss of a point, also of a point that the camera does not show: an error of a million scales.
        const HIDDEN: f64 = 28.0;
        let usual = weak_prior(self.options.size[0]);
        let of_focal =
            if self.free[LOG_FOCAL] { (camera.focal.ln() - usual.value) / usual.sigma } else { 0.0 };
        let of_priors: f64 = self
            .prior_residuals(&self.state(camera))
            .map(|(residual, ..)| (residual * residual).ln_1p())
            .sum();
        let mut loss = of_priors + 0.1 * of_focal * of_focal;
        let rotation = camera.rotation();
        for index in 0..self.points.len() {
            loss += self.scaled_error(camera, &rotation, index).powi(2).ln_1p().min(HIDDEN);
            if loss.is_nan() || loss >= limit {
                return None;
            }
        }
        Some(loss)
    }

    fn state(&self, camera: &Camera) -> State {
        let WorldPoint { x, y, z } = camera.position;
        [x, y, z, camera.yaw, camera.pitch, camera.roll, camera.focal.ln()]
    }

    fn camera(&self, [x, y, z, yaw, pitch, roll, log_focal]: State) -> Camera {
        Camera {
            position: WorldPoint { x, y, z },
            yaw,
            pitch,
            roll,
            // A fixed focal length is returned bit by bit.
            focal: self.options.fixed.focal.unwrap_or_else(|| log_focal.exp()),
            lens: self.options.lens,
            covariance: Covariance::UNKNOWN,
        }
    }

    /// Returns the residual of each prior, the index of its parameter, and the derivative with respect to it.
    fn prior_residuals(&self, state: &State) -> impl Iterator<Item = (f64, usize, f64)> {
        let Priors { roll, pitch, focal, height, .. } = self.options.priors;
        let angle = |prior: Option<Prior>, index: usize| {
            let wrapped = |by: f64| by.sin().atan2(by.cos());
            prior.map(|prior| (wrapped(state[index] - prior.value) / prior.sigma, index, prior.sigma.recip()))
        };
        let of_focal = focal.map(|prior| {
            let focal = state[LOG_FOCAL].exp();
            ((focal - prior.value) / prior.sigma, LOG_FOCAL, focal / prior.sigma)
        });
        let of_height = height.map(|prior| ((state[Z] - prior.value) / prior.sigma, Z, prior.sigma.recip()));
        let weak = self
            .weak_log_focal
            .map(|prior| ((state[LOG_FOCAL] - prior.value) / prior.sigma, LOG_FOCAL, prior.sigma.recip()));
        let all = [angle(roll, ROLL), angle(pitch, PITCH), of_focal, of_height, weak];
        let free = self.free;
        all.into_iter().flatten().filter(move |(_, index, _)| free[*index])
    }

    /// Returns the number of residuals of the points with weight and of the priors, minus the free parameters.
    fn dof(&self) -> i64 {
        let points = self.weights.iter().filter(|&&weight| weight > 0.0).count();
        let priors = self.prior_residuals(&[0.0; POSE_PARAMS]).count();
        let unknowns = self.free.iter().filter(|&&free| free).count();
        2 * points as i64 + priors as i64 - unknowns as i64
    }

    /// Returns the robust minimum reached from a start. `None` if it is one of `known`, or if a step fails.
    fn consensus(&self, start: &Camera, known: &[Camera]) -> Option<Camera> {
        /// Number of reweighted minimisations, and of steps in each.
        const ROUNDS: usize = 6;
        const STEPS: usize = 6;
        let mut camera = *start;
        let mut problem = self.with_weights(Vec::new());
        for _ in 0..ROUNDS {
            let rotation = camera.rotation();
            let robust = |i: usize| (1.0 + self.scaled_error(&camera, &rotation, i).powi(2)).recip();
            let weights = (0..self.points.len()).map(|i| robust(i) * self.sigma(&camera, i).powi(-2));
            problem.weights = weights.collect();
            let before = camera;
            camera = problem.refined(&camera, STEPS)?;
            if known.iter().any(|known| is_same(known, &camera)) {
                return None;
            }
            if is_same(&before, &camera) {
                break;
            }
        }
        Some(camera)
    }

    /// Returns the least-squares minimum of the inliers of a robust minimum.
    fn minimum(&self, camera: &Camera) -> Option<Minimum> {
        /// Largest error of an inlier, in scales of the loss.
        const MAX_INLIER_SCALES: f64 = 3.0;
        /// Least redundancy of the inliers: with less redundancy, even a wrong camera nearly fits the points.
        const MIN_REDUNDANCY: i64 = 3;
        let rotation = camera.rotation();
        let is_inlier = |i: usize| self.scaled_error(camera, &rotation, i) <= MAX_INLIER_SCALES;
        let outliers: Vec<usize> = (0..self.points.len()).filter(|&i| !is_inlier(i)).collect();
        let of = |i: usize| self.sigma(camera, i).powi(-2);
        let weights = |rejected: &[usize]| {
            (0..self.points.len()).map(|i| if rejected.contains(&i) { 0.0 } else { of(i) }).collect()
        };
        let mut problem = self.with_weights(weights(&outliers));
        let has_consensus = outliers.is_empty() || problem.dof() >= MIN_REDUNDANCY;
        let outliers = if has_consensus { outliers } else { Vec::new() };
        if !has_consensus {
            problem.weights = weights(&[]);
        }
        problem.converged(camera, outliers)
    }

    fn with_weights(&self, weights: Vec<f64>) -> Self {
        Problem { weights, observed: self.observed.clone(), ..*self }
    }

    fn refined(&self, start: &Camera, steps: usize) -> Option<Camera> {
        least_squares(self, self.state(start), steps).map(|summary| self.camera(summary.state))
    }

    /// Returns the least-squares minimum of the points with weight. The weak prior on the focal length is
    /// added if the points do not determine the focal length and no other prior is given.
    fn converged(&mut self, start: &Camera, outliers: Vec<usize>) -> Option<Minimum> {
        const STEPS: usize = 60;
        let log_focal_sigma = |covariance: Option<Square>| {
            covariance.map_or(f64::INFINITY, |square: Square| {
                square[LOG_FOCAL * POSE_PARAMS + LOG_FOCAL].max(0.0).sqrt()
            })
        };
        let mut camera = self.normalized(self.refined(start, STEPS)?);
        let mut covariance = self.covariance(&camera);
        let sigma = self.free[LOG_FOCAL].then(|| log_focal_sigma(covariance));
        let is_open = sigma.is_some_and(|sigma| sigma > MIN_LOG_FOCAL_SIGMA_FOR_PRIOR);
        if is_open && self.options.priors.focal.is_none() {
            self.weak_log_focal = Some(weak_prior(self.options.size[0]));
            camera = self.normalized(self.refined(start, STEPS)?);
            covariance = self.covariance(&camera);
        }
        let (cost, _) = self.linearize(&self.state(&camera))?;
        let loss = self.loss(&camera);
        camera.covariance =
            covariance.map_or(Covariance::UNKNOWN, |square| camera_covariance(&square, camera.focal));
        Some(Minimum { camera, cost, loss, outliers, dof: self.dof(), log_focal_sigma: sigma })
    }

    /// Returns the camera with a pitch within 90 degrees, unless roll or pitch is known: a pitch beyond the
    /// vertical is the same camera with roll and yaw rotated by 180 degrees.
    fn normalized(&self, camera: Camera) -> Camera {
        let Priors { roll: of_roll, pitch: of_pitch, .. } = self.options.priors;
        if !(self.free[ROLL] && self.free[PITCH]) || of_roll.is_some() || of_pitch.is_some() {
            return camera;
        }
        let (roll, pitch, yaw) = angles_from_rotation(&camera.rotation());
        Camera { roll, pitch, yaw, ..camera }
    }

    /// Returns the covariance of the state; zeros for fixed parameters. `None` if a parameter is not determined.
    fn covariance(&self, camera: &Camera) -> Option<Square> {
        let (_, (mut square, _)) = self.linearize(&self.state(camera))?;
        pseudo_invert(&mut square, POSE_PARAMS);
        let is_determined = |k: usize| !self.free[k] || square[k * POSE_PARAMS + k] > 0.0;
        let is_finite = square.iter().all(|value| value.is_finite());
        (is_finite && (0..POSE_PARAMS).all(is_determined)).then_some(square)
    }

    /// Returns the fit of the most plausible minimum. The candidates are the minimum with the least loss, and the
    /// minima that have no more outliers and that the chi-square does not rule out.
    fn choose(&self, mut minima: Vec<Minimum>) -> Option<PointFit> {
        minima.sort_by(|a, b| a.loss.total_cmp(&b.loss));
        let best = minima.first()?.clone();
        minima.retain(|other| {
            other.outliers.len() <= best.outliers.len() && other.cost < best.cost + MIN_CHI2_DIFFERENCE
        });
        let cost = |m: &Minimum| m.cost + implausibility(&m.camera, &[]);
        let chosen = minima.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))?.clone();
        let others = minima.iter().filter(|other| !is_same(&other.camera, &chosen.camera));
        Some(PointFit {
            alternatives: others.map(|other| other.camera).collect(),
            camera: chosen.camera,
            chi2: chosen.cost,
            dof: chosen.dof,
            loss: chosen.loss,
            outliers: chosen.outliers,
            log_focal_sigma: chosen.log_focal_sigma,
        })
    }
}

impl LeastSquares for Problem<'_> {
    type State = State;
    type Normal = (Square, Column);

    fn linearize(&self, state: &State) -> Option<(f64, Self::Normal)> {
        let posed = PosedCamera::new(self.camera(*state));
        let (mut square, mut gradient) = ([0.0; POSE_PARAMS * POSE_PARAMS], [0.0; POSE_PARAMS]);
        let mut cost = 0.0;
        let mut add = |error: f64, by: Column| {
            cost += error * error;
            for i in 0..POSE_PARAMS {
                gradient[i] += by[i] * error;
                for j in 0..POSE_PARAMS {
                    square[i * POSE_PARAMS + j] += by[i] * by[j];
                }
            }
        };
        for ((point, observed), weight) in self.points.iter().zip(&self.observed).zip(&self.weights) {
            let Some(observed) = observed.as_ref().filter(|_| *weight > 0.0) else { continue };
            let shown = posed.reproject(point.world, observed.chart.as_ref())?;
            let by_weight = weight.sqrt();
            let error = observed.raw_offset([shown.at[0] - observed.at[0], shown.at[1] - observed.at[1]]);
            let mut by = [[0.0; POSE_PARAMS]; 2];
            for k in (0..POSE_PARAMS).filter(|&k| self.free[k]) {
                let raw = observed.raw_offset(shown.d_camera.map(|row| row[k]));
                (by[0][k], by[1][k]) = (raw[0] * by_weight, raw[1] * by_weight);
            }
            error.iter().zip(by).for_each(|(error, by)| add(error * by_weight, by));
        }
        for (error, index, derivative) in self.prior_residuals(state) {
            let mut by = [0.0; POSE_PARAMS];
            by[index] = derivative;
            add(error, by);
        }
        cost.is_finite().then_some((cost, (square, gradient)))
    }

    fn step(
        &self,
        state: &State,
        (square, gradient): &Self::Normal,
        damping: f64,
    ) -> Option<(State, f64, f64)> {
        let mut damped = *square;
        damp_diagonal(&mut damped, damping);
        let step = solve_normal_equations(&damped, gradient, &self.free);
        let gain = |i: usize| step[i] * (damping * square[i * POSE_PARAMS + i] * step[i] + gradient[i]);
        let predicted = (0..POSE_PARAMS).map(gain).sum();
        let size = step.iter().fold(0.0, |size: f64, by| size.max(by.abs()));
        Some((std::array::from_fn(|i| state[i] - step[i]), predicted, size))
    }
}

/// Solves the normal equations of the free parameters. The step of a fixed parameter is zero.
fn solve_normal_equations(square: &Square, gradient: &Column, free: &[bool; POSE_PARAMS]) -> Column {
    let mut matrix = SMatrix::<f64, POSE_PARAMS, POSE_PARAMS>::from_row_slice(square);
    (0..POSE_PARAMS).filter(|&k| !free[k]).for_each(|k| matrix[(k, k)] = 1.0);
    if let Some(factor) = matrix.cholesky() {
        return factor.solve(&SVector::from(*gradient)).into();
    }
    // A parameter is undetermined.
    let (mut inverse, mut step) = (*square, Vec::new());
    pseudo_invert(&mut inverse, POSE_PARAMS);
    product(&inverse, gradient, POSE_PARAMS, &mut step);
    std::array::from_fn(|k| step[k])
}

/// Returns the triples of points with the largest triangles in the image. They are selected from all triples, or
/// from a random sample.
fn triples(points: &[ControlPoint], observed: &[Option<ObservedPixel>]) -> Vec<[usize; 3]> {
    /// Number of triples. If a third of the points is wrong, at least one triple is right with 99.98 % probability.
    const MAX_TRIPLES: usize = 24;
    /// Number of sampled triples. The half with the larger triangles in the image is used.
    const SAMPLED: usize = 2 * MAX_TRIPLES;
    let shown: Vec<usize> = (0..points.len()).filter(|&i| observed[i].is_some()).collect();
    let n = shown.len();
    let mut found: Vec<[usize; 3]> = if n * n.saturating_sub(1) * n.saturating_sub(2) / 6 <= SAMPLED {
        let pairs = |i: usize| (i + 1..n).flat_map(move |j| (j + 1..n).map(move |k| [i, j, k]));
        (0..n).flat_map(pairs).collect()
    } else {
        let mut random = Random(1);
        let triple = std::iter::repeat_with(|| std::array::from_fn(|_| random.below(n)));
        triple.filter(|[i, j, k]: &[usize; 3]| i != j && j != k && i != k).take(SAMPLED).collect()
    };
    let area = |triple: &[usize; 3]| {
        let [a, b, c] = triple.map(|index| points[shown[index]].pixel);
        ((b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u)).abs()
    };
    found.sort_by(|a, b| area(b).total_cmp(&area(a)));
    found.into_iter().take(MAX_TRIPLES).map(|triple| triple.map(|i| shown[i])).collect()
}

/// Generator of repeatable random numbers (Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number
/// Generators", `SplitMix64`).
struct Random(u64);

impl Random {
    /// Returns a number from 0 to `limit` - 1.
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % limit as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;
    use proptest::prelude::*;
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    const SIZE: [f64; 2] = [1920.0, 1080.0];

    fn camera(pitch_deg: f64, roll_deg: f64, yaw: f64, focal: f64) -> Camera {
        Camera {
            position: WorldPoint::new(3.0, -2.0, 4.5),
            yaw,
            pitch: pitch_deg.to_radians(),
            roll: roll_deg.to_radians(),
            focal,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        }
    }

    /// Returns control points in the lower part of the image, on the floor or up to 2 m above it.
    fn points(
        camera: &Camera,
        count: usize,
        height: f64,
        noise: f64,
        random: &mut ChaCha8Rng,
    ) -> Vec<ControlPoint> {
        let mut found = Vec::new();
        while found.len() < count {
            let pixel = Pixel::new(random.random_range(60.0..1860.0), random.random_range(300.0..1040.0));
            let z = random.random_range(0.0..1.0) * height;
            let Some(floor) = camera.pixel_to_floor(pixel, z).filter(|at| at.x.hypot(at.y) < 60.0) else {
                continue;
            };
            let off = [0, 1].map(|_| noise * (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>());
            found.push(ControlPoint {
                pixel: Pixel::new(pixel.u + off[0], pixel.v + off[1]),
                world: WorldPoint::new(floor.x, floor.y, z),
            });
        }
        found
    }

    fn options(fixed: FixedParameters) -> PointFitOptions<'static> {
        PointFitOptions {
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            size: SIZE,
            fixed,
            priors: Priors::default(),
            sigma: 1.0,
            position_sigmas: &[],
        }
    }

    /// Returns the inputs for points without noise. The weak prior on the focal length is then not used.
    fn exact(fixed: FixedParameters) -> PointFitOptions<'static> {
        PointFitOptions { sigma: 0.01, ..options(fixed) }
    }

    fn is_found(truth: &Camera, found: &Camera) -> bool {
        found.position.distance(truth.position) < 1e-4
            && (found.focal / truth.focal).ln().abs() < 1e-5
            && (found.pitch - truth.pitch).abs() < 1e-5
            && (found.roll - truth.roll).abs() < 1e-5
    }

    /// Whether four points are well spread: every triangle of them has a large area in the image.
    fn are_spread(points: &[ControlPoint]) -> bool {
        let observed: Vec<_> = points
            .iter()
            .map(|p| ObservedPixel::new(p.pixel, &options(FixedParameters::default()).lens))
            .collect();
        triples(points, &observed).iter().all(|triple| {
            let [a, b, c] = triple.map(|i| points[i].pixel);
            ((b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u)).abs() > 40_000.0
        })
    }

    proptest! {
        #[test]
        fn four_floor_points_determine_pose_and_focal_length(
            seed in 0..10_000_u64, pitch in 12.0..60.0, roll in -20.0..20.0, yaw in -3.0..3.0, focal in 500.0..4000.0,
        ) {
            let truth = camera(pitch, roll, yaw, focal);
            let points = points(&truth, 4, 0.0, 0.0, &mut ChaCha8Rng::seed_from_u64(seed));
            prop_assume!(are_spread(&points));
            let found = PointFit::new(&points, &exact(FixedParameters::default())).unwrap();
            let mut all = found.alternatives.iter().chain([&found.camera]);
            prop_assert!(all.any(|found| is_found(&truth, found)), "{found:?}");
        }

        #[test]
        fn six_points_in_space_determine_pose_and_focal_length(
            seed in 0..10_000_u64, pitch in -5.0..80.0, roll in -170.0..170.0, yaw in -3.0..3.0, focal in 500.0..4000.0,
        ) {
            let truth = camera(pitch, roll, yaw, focal);
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let rotation = truth.rotation();
            let points: Vec<ControlPoint> = (0..6).map(|_| {
                let pixel = Pixel::new(random.random_range(60.0..1860.0), random.random_range(40.0..1040.0));
                let depth = random.random_range(4.0..12.0);
                let p = [(pixel.u - 960.0) / focal * depth, (pixel.v - 540.0) / focal * depth, depth];
                let q: [f64; 3] = std::array::from_fn(|j| (0..3).map(|i| rotation[i][j] * p[i]).sum());
                let WorldPoint { x, y, z } = truth.position;
                ControlPoint { pixel, world: WorldPoint::new(x + q[0], y + q[1], z + q[2]) }
            }).collect();
            let found = PointFit::new(&points, &exact(FixedParameters::default())).unwrap();
            let mut all = found.alternatives.iter().chain([&found.camera]);
            prop_assert!(all.any(|found| is_found(&truth, found)), "{found:?}");
        }

        #[test]
        fn three_points_have_the_true_pose_among_the_minima_if_the_focal_length_is_known(
            seed in 0..10_000_u64, pitch in 12.0..60.0, roll in -20.0..20.0, focal in 500.0..4000.0,
        ) {
            let truth = camera(pitch, roll, 0.4, focal);
            let points = points(&truth, 3, 2.0, 0.0, &mut ChaCha8Rng::seed_from_u64(seed));
            prop_assume!(are_spread(&points));
            let fixed = FixedParameters { focal: Some(focal), ..FixedParameters::default() };
            let found = PointFit::new(&points, &exact(fixed)).unwrap();
            let mut all = found.alternatives.iter().chain([&found.camera]);
            prop_assert!(all.any(|found| is_found(&truth, found)), "{found:?}");
            prop_assert_eq!(found.camera.focal.to_bits(), focal.to_bits());
        }

        #[test]
        fn wrong_points_are_the_outliers(seed in 0..10_000_u64, wrong in 1..4_usize) {
            let truth = camera(28.0, 2.0, 0.4, 1400.0);
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut points = points(&truth, 12, 2.0, 0.5, &mut random);
            for point in &mut points[..wrong] {
                point.pixel.u += if random.random() { 200.0 } else { -200.0 };
            }
            let found = PointFit::new(&points, &options(FixedParameters::default())).unwrap();
            prop_assert_eq!(found.outliers, (0..wrong).collect::<Vec<_>>());
            prop_assert!((found.camera.focal / truth.focal).ln().abs() < 0.2);
        }
    }

    #[test]
    fn errors_are_as_large_as_the_covariance_predicts() {
        let truth = camera(28.0, 2.0, 0.4, 1400.0);
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let (mut square, mut count) = ([0.0; 3], 0.0);
        for _ in 0..300 {
            let points = points(&truth, 8, 2.0, 1.0, &mut random);
            let found = PointFit::new(&points, &options(FixedParameters::default())).unwrap();
            let error = [
                (found.camera.focal - truth.focal, Covariance::FOCAL),
                (found.camera.pitch - truth.pitch, Covariance::PITCH),
                (found.camera.position.z - truth.position.z, Covariance::Z),
            ];
            for (sum, (error, index)) in square.iter_mut().zip(error) {
                *sum += (error / found.camera.covariance.sigma(index).unwrap()).powi(2);
            }
            count += 1.0;
        }
        for sum in square {
            assert!((0.8..1.25).contains(&(sum / count)), "{square:?} of {count}");
        }
    }

    #[test]
    fn collinear_points_have_no_fit() {
        let truth = camera(28.0, 2.0, 0.4, 1400.0);
        let along = |k: f64| {
            let world = WorldPoint::new(3.0 + 0.5 * k, 4.0 + k, 0.0);
            truth.world_to_pixel(world).map(|pixel| ControlPoint { pixel, world })
        };
        let points: Vec<ControlPoint> = [0.0, 1.0, 2.0, 3.0].into_iter().filter_map(along).collect();
        assert_eq!(points.len(), 4);
        assert_eq!(PointFit::new(&points, &options(FixedParameters::default())), None);
    }
}
