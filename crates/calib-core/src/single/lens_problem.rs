//! Least-squares problem of a lens: coefficients fitted to straight edges, with priors, evidence, and several
//! starts.
//!
//! # Priors
//!
//! The priors are normal distributions. They apply to the coefficients of the Brown-Conrady model, with
//! coordinates divided by half the image diagonal. They also apply to the coefficients of the Kannala-Brandt
//! model, and to the principal point if it is free.
//!
//! Published calibrations of cameras from 45 to 100 degrees (KITTI, `EuRoC`, TUM RGB-D, MEVA, the samples of
//! `OpenCV`) have k1 between -0.27 and 0.16. For barrel distortion k2 is within 0.1 of k1 squared, and |p1|, |p2|
//! are below 0.003. Therefore k2 and k3 stay small if the edges do not determine them. The uncertainty in the
//! corners then equals the variation between real lenses.
//!
//! # Focal length and principal point of a fisheye
//!
//! A fisheye may also have a free focal length and a free principal point, which are fitted to the straight
//! edges together with the coefficients. Edges far from the axis determine the focal length. Without
//! such edges, the priors on the coefficients determine it. The lines of stage 1 determine it better in the
//! joint fit. The principal point has a prior.

use nalgebra::{DMatrix, DVector};

use crate::camera::{
    ByParameters, Chart, Coefficient, Distortion, DistortionModel, ImageCircle, Lens, Pixel,
};
use crate::optimize::{LeastSquares, least_squares_unless};
use crate::single::constraints::Source;
use crate::single::parameters::{FittedCoefficients, PrincipalPointPrior, Prior};
use crate::single::straightness::{
    Edge, outermost, straightness_in_charts_of, straightness_with_jacobian, uninformative,
};

/// Standard deviation of the prior on k1 of the Brown-Conrady model, with coordinates divided by half the image
/// diagonal.
pub(crate) const K1_SIGMA: f64 = 0.2;
/// Standard deviation of the prior on k2, in the coordinates of [`K1_SIGMA`]. The expected value is the square of
/// k1 if k1 is negative, and otherwise 0.
pub(crate) const K2_SIGMA: f64 = 0.1;
/// Standard deviation of the prior on k3, in the coordinates of [`K1_SIGMA`].
const K3_SIGMA: f64 = 0.1;
/// Standard deviation of the priors on p1 and p2, in the coordinates of [`K1_SIGMA`].
const TANGENTIAL_SIGMA: f64 = 0.003;

/// Standard deviations of the priors on k1 to k4 of a fisheye. The design families of fisheyes have k1 and k2
/// of 0 and 0 (equidistant), -0.042 and 0.0005 (equisolid), 0.083 and 0.008 (stereographic).
const FISHEYE_SIGMAS: [f64; 4] = [0.07, 0.03, 0.01, 0.003];

/// Standard deviation of the log slope of a fisheye: `d radius / d angle` relative to its value at the axis.
///
/// At right angles to the axis the log slope is 0, -0.35 and 0.69 for the three families. No real lens folds
/// back inside its image. Without this prior, a lens that folds near the outermost points could explain any
/// edges there.
const FISHEYE_LOG_SLOPE_SIGMA: f64 = 0.6;

/// Residual of a prior on a lens, `(value - expected) / sigma`, with its derivatives with respect to the
/// parameters of the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LensResidual {
    /// Residual, in standard deviations.
    pub(crate) value: f64,
    /// Derivatives of the residual with respect to the parameters of the lens.
    pub(crate) by: [f64; Lens::PARAMETERS],
    /// Standard deviation of the prior, in the unit of the parameter; 1 for the prior on the slope.
    pub(crate) sigma: f64,
}

/// Returns the prior residuals of the fitted parameters, given by their indices. `centre` and `aspect` are the
/// priors on the principal point and on the pixel aspect; without `aspect`, the pixel aspect has no residual.
///
/// The coefficients of the division model and the focal length of a fisheye have no prior.
pub(crate) fn lens_prior(
    lens: &Lens,
    size: [f64; 2],
    (centre, aspect): (PrincipalPointPrior, Option<Prior>),
    fitted: &[usize],
) -> Vec<LensResidual> {
    let is_coefficient = |index: &&usize| **index < Lens::CENTRE;
    let others = fitted.iter().filter(|index| !is_coefficient(index)).filter_map(|&index| {
        let Pixel { u, v } = lens.principal_point;
        let (off, sigma) = match index {
            Lens::CENTRE => (u - centre.value.u, centre.sigma),
            Lens::ASPECT => (lens.pixel_aspect - aspect?.value, aspect?.sigma),
            _ => (v - centre.value.v, centre.sigma),
        };
        let mut by = [0.0; Lens::PARAMETERS];
        by[index] = sigma.recip();
        Some(LensResidual { value: off / sigma, by, sigma })
    });
    let coefficients: Vec<usize> = fitted.iter().filter(is_coefficient).copied().collect();
    let mut residuals = coefficient_prior(lens, size, &coefficients);
    residuals.extend(others);
    residuals
}

/// Returns the prior residuals of the fitted distortion coefficients, given by their indices.
fn coefficient_prior(lens: &Lens, size: [f64; 2], fitted: &[usize]) -> Vec<LensResidual> {
    let brown = match lens.distortion {
        Distortion::BrownConrady(brown) => brown,
        Distortion::KannalaBrandt { k } => return fisheye_prior(&k, fitted),
        _ => return Vec::new(),
    };
    let row = DistortionModel::BrownConrady.row();
    // Conversion of the coefficient of r^n from units of the focal length to units of half the diagonal:
    // multiplication by this ratio to the power n.
    let ratio = 0.5 * size[0].hypot(size[1]) / lens.focal;
    let square = ratio * ratio;
    let place = |of: Coefficient| row.coefficients.iter().position(|&named| named == of);
    let residual = |&index: &usize| {
        let mut by = [0.0; Lens::PARAMETERS];
        let (value, scale, sigma) = match row.coefficients[index] {
            Coefficient::K1 => (square * brown.k1, square, K1_SIGMA),
            Coefficient::K2 => {
                let k1 = square * brown.k1.min(0.0);
                if let Some(first) = place(Coefficient::K1) {
                    by[first] = -2.0 * k1 * square / K2_SIGMA;
                }
                (square * square * brown.k2 - k1 * k1, square * square, K2_SIGMA)
            }
            Coefficient::K3 => (square.powi(3) * brown.k3, square.powi(3), K3_SIGMA),
            Coefficient::P1 => (ratio * brown.p1, ratio, TANGENTIAL_SIGMA),
            _ => (ratio * brown.p2, ratio, TANGENTIAL_SIGMA),
        };
        by[index] += scale / sigma;
        LensResidual { value: value / sigma, by, sigma: sigma / scale }
    };
    fitted.iter().map(residual).collect()
}

/// Returns the prior residuals of the coefficients of a fisheye. Their expected values are 0, as in the
/// equidistant model.
fn fisheye_prior(k: &[f64; 4], fitted: &[usize]) -> Vec<LensResidual> {
    let coefficients = fitted.iter().filter(|&&index| index < FISHEYE_SIGMAS.len());
    let residual = |&index: &usize| {
        let sigma = FISHEYE_SIGMAS[index];
        let mut by = [0.0; Lens::PARAMETERS];
        by[index] = sigma.recip();
        LensResidual { value: k[index] / sigma, by, sigma }
    };
    coefficients.map(residual).collect()
}

/// Returns the prior residual of the slope of a fisheye at its outermost annotated point.
///
/// Returns `None` for other lenses and without annotated points. The residual is infinite if the lens does not
/// show the point.
pub(crate) fn slope_prior(lens: &Lens, outermost: Option<Pixel>) -> Option<LensResidual> {
    let pixel = outermost.filter(|_| lens.distortion.is_wide())?;
    let (log, by) = lens.log_slope(pixel).unwrap_or((f64::INFINITY, [0.0; Lens::PARAMETERS]));
    Some(LensResidual {
        value: log / FISHEYE_LOG_SLOPE_SIGMA,
        by: by.map(|by| by / FISHEYE_LOG_SLOPE_SIGMA),
        sigma: 1.0,
    })
}

/// Fit of distortion coefficients to polylines, as a least-squares problem.
pub(super) struct LensProblem<'a> {
    pub(super) edges: Vec<&'a Edge>,
    /// Number of times that the same physical edge is annotated, for every edge: 1 plus the fractions that other
    /// polylines cover. The squared residuals of the edge are divided by this number.
    pub(super) repeat_counts: Vec<f64>,
    /// Distortion model and its fitted coefficients.
    pub(super) fitted: FittedCoefficients,
    /// Free parameters other than coefficients, as indices among the parameters of the lens.
    ///
    /// In the vector of values they follow the coefficients: log of the focal length in `unit`, and offset of
    /// the principal point from its expected position.
    pub(super) free: Vec<usize>,
    /// Principal point, or its expected position if it is free.
    pub(super) principal_point: Pixel,
    /// Pixel aspect of the lens.
    pub(super) pixel_aspect: f64,
    /// Focal length that the coefficients refer to, in pixels: half the image diagonal. For a model with its own
    /// focal length, it is that focal length or its start value.
    pub(super) unit: f64,
    /// Width and height of the image, in pixels.
    pub(super) size: [f64; 2],
    /// Image circle of a fisheye, if known.
    pub(super) circle: Option<ImageCircle>,
    /// Standard deviation of an annotated coordinate, in pixels.
    pub(super) sigma: f64,
}

impl LensProblem<'_> {
    /// Returns the lens whose fitted parameters are all 0. It defines the charts of the edges.
    fn start(&self) -> Lens {
        self.lens(&[])
    }

    /// Returns the lens with these values of the fitted parameters; missing values are 0.
    pub(super) fn lens(&self, values: &[f64]) -> Lens {
        let mut lens = Lens {
            principal_point: self.principal_point,
            focal: self.unit,
            pixel_aspect: self.pixel_aspect,
            distortion: self.fitted.distortion(values),
            image_circle: None,
        };
        for (&index, value) in self.free.iter().zip(values.iter().skip(self.fitted.len())) {
            match index {
                Lens::LENS_FOCAL => lens.focal *= value.exp(),
                Lens::CENTRE => lens.principal_point.u += value,
                _ => lens.principal_point.v += value,
            }
        }
        lens
    }

    /// Returns the indices of the fitted parameters among the parameters of the lens, in the order of the
    /// values.
    pub(super) fn indices(&self) -> Vec<usize> {
        self.fitted.indices().into_iter().chain(self.free.iter().copied()).collect()
    }

    /// Returns the sum of the squared residuals of every edge, in square pixels. Unlike in `cost`, a repeated edge
    /// has its full weight.
    pub(super) fn costs(&self, values: &[f64]) -> impl Iterator<Item = f64> {
        let (lens, start) = (self.lens(values), self.start());
        self.edges.iter().map(move |edge| edge_cost([&lens, &start], edge))
    }

    /// Returns the sum of the squared residuals of all edges; all copies of an edge together count once.
    pub(super) fn cost(&self, values: &[f64]) -> f64 {
        self.costs(values).zip(&self.repeat_counts).map(|(cost, times)| cost / times).sum()
    }

    /// Returns the prior residuals of the fitted parameters, in standard deviations.
    fn priors(&self, values: &[f64]) -> Vec<LensResidual> {
        let (lens, fitted) = (self.lens(values), &self.indices()[..values.len()]);
        let drawn = self.edges.iter().flat_map(|edge| &edge.points);
        let of_slope = slope_prior(&lens, outermost(drawn, self.principal_point));
        let centre = PrincipalPointPrior::of_fisheye(self.size, self.circle);
        lens_prior(&lens, self.size, (centre, None), fitted).into_iter().chain(of_slope).collect()
    }

    /// Returns the residuals, in pixels, and their Jacobian; edges first, then priors scaled by `sigma`. The best
    /// line of every edge is refitted, so its parameters are eliminated.
    ///
    /// Returns `None` if the lens folds back on itself before a corner of the image, or cannot undistort a point.
    pub(super) fn residuals_and_jacobian(&self, values: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (lens, start) = (self.lens(values), self.start());
        let indices = &self.indices()[..values.len()];
        if !lens.covers_image(self.size) {
            return None;
        }
        let edges: Vec<(Vec<f64>, Vec<Vec<f64>>)> = self
            .edges
            .iter()
            .zip(&self.repeat_counts)
            .map(|(edge, times)| {
                let (mut distances, mut columns) =
                    straightness_with_jacobian([&lens, &start], &edge.points, indices)?;
                let values = columns.iter_mut().flatten().chain(&mut distances);
                values.for_each(|value| *value /= times.sqrt());
                Some((distances, columns))
            })
            .collect::<Option<_>>()?;
        let priors = self.priors(values);
        let believed = priors.iter().map(|prior| self.sigma * prior.value);
        let residuals: Vec<f64> =
            edges.iter().flat_map(|(distances, _)| distances.iter().copied()).chain(believed).collect();
        let count = residuals.len();
        let column = |k: usize| {
            let believed = priors.iter().map(move |prior| self.sigma * prior.by[indices[k]]);
            edges.iter().flat_map(move |(_, columns)| columns[k].iter().copied()).chain(believed)
        };
        let jacobian = DMatrix::from_iterator(count, values.len(), (0..values.len()).flat_map(column));
        Some((DVector::from_vec(residuals), jacobian))
    }

    /// Returns minus twice the log evidence of the fitted parameters, up to a constant common to all models.
    pub(super) fn evidence(&self, values: &[f64]) -> Option<f64> {
        let per_variance = (self.sigma * self.sigma).recip();
        let (residuals, jacobian) = self.residuals_and_jacobian(values)?;
        let determinant = (jacobian.tr_mul(&jacobian) * per_variance).determinant();
        let of_priors: f64 = self.priors(values).iter().map(|prior| 2.0 * prior.sigma.ln()).sum();
        Some(residuals.norm_squared() * per_variance + determinant.ln() + of_priors)
    }

    /// Returns the edges that carry almost no information about the lens.
    ///
    /// These are the edges that a distortion would hardly curve. With a fitted lens, the corner must also be
    /// hardly less certain without the edge. A fisheye has no such edges, because it curves every edge that is
    /// not radial.
    pub(super) fn uninformative(&self, values: &[f64]) -> Vec<(Source, f64)> {
        /// Ratio of the standard deviations of the undistorted corner without and with an edge. Below this ratio the
        /// edge is uninformative.
        const MAX_SIGMA_RATIO: f64 = 1.05;
        if self.fitted.is_wide() {
            return Vec::new();
        }
        let lens = self.lens(values);
        let hardly_bent = uninformative(&self.edges, &lens, self.size, self.sigma);
        let Some(corner) = self.corner_variance(values, |_| true).filter(|_| !values.is_empty()) else {
            return hardly_bent;
        };
        let says_nothing = |(source, _): &(Source, f64)| {
            let without = self.corner_variance(values, |edge| edge.source != *source);
            without.is_some_and(|variance| variance < MAX_SIGMA_RATIO * MAX_SIGMA_RATIO * corner)
        };
        hardly_bent.into_iter().filter(says_nothing).collect()
    }

    /// Returns the pixels at which errors of the lens are reported: halfway to the end of the longer image axis,
    /// at that end, and in the corner.
    ///
    /// For a fisheye the image circle replaces the border. Without a known circle its radius is assumed to be
    /// half the longer side.
    pub(super) fn reference_pixels(&self) -> [Pixel; 3] {
        let [w, h] = self.size;
        let whole = ImageCircle::default_for(self.size);
        let circle = if self.fitted.is_wide() { self.circle.unwrap_or(whole) } else { whole };
        let (right, down) = (f64::from(u8::from(w > h)), f64::from(u8::from(w <= h)));
        let edge = Pixel { u: circle.u + right * circle.radius, v: circle.v + down * circle.radius };
        let rim = circle.radius * std::f64::consts::FRAC_1_SQRT_2;
        let end = Pixel { u: (circle.u + rim).min(w), v: (circle.v + rim).min(h) };
        let corner = if self.fitted.is_wide() { end } else { Pixel::from([w, h]) };
        let halfway = Pixel { u: 0.5 * (circle.u + edge.u), v: 0.5 * (circle.v + edge.v) };
        [halfway, edge, corner]
    }

    /// Returns the variance of the undistorted image corner, in square pixels, if only the edges with `is_used` are
    /// fitted.
    fn corner_variance(&self, values: &[f64], is_used: impl Fn(&Edge) -> bool) -> Option<f64> {
        let [_, _, corner] = self.reference_pixels();
        let used = self.edges.iter().copied().zip(self.repeat_counts.iter().copied());
        let (edges, times) = used.filter(|(edge, _)| is_used(edge)).unzip();
        let (fitted, open) = (self.fitted.clone(), self.free.clone());
        let some = LensProblem { edges, repeat_counts: times, fitted, free: open, ..*self };
        let covariance = some.covariance(values)?;
        let by = undistorted_by_parameters(&self.lens(values), corner)?;
        let jacobian: Vec<[f64; 2]> = self.indices().iter().map(|&k| by[k].at).collect();
        let pairs = (0..values.len()).flat_map(|i| (0..values.len()).map(move |j| (i, j)));
        let along = |(i, j): (usize, usize)| {
            covariance[(i, j)] * (jacobian[i][0] * jacobian[j][0] + jacobian[i][1] * jacobian[j][1])
        };
        Some(self.sigma * self.sigma * pairs.map(along).sum::<f64>())
    }

    /// Returns the covariance of the fitted parameters, divided by the variance `sigma^2` of an annotated
    /// coordinate.
    pub(super) fn covariance(&self, values: &[f64]) -> Option<DMatrix<f64>> {
        let (_, jacobian) = self.residuals_and_jacobian(values)?;
        jacobian.tr_mul(&jacobian).try_inverse()
    }

    /// Minimises the cost from several start values and from `smaller`, the result of the next smaller model.
    /// Returns the values with the lowest cost, and this cost.
    pub(super) fn solve(&self, smaller: &[f64]) -> Option<(Vec<f64>, f64)> {
        /// Maximum number of accepted steps to a minimum.
        const MAX_STEPS: usize = 60;
        /// Number of steps from every start before the candidates are ranked.
        const FIRST_STEPS: usize = 6;
        /// Maximum number of candidates that are refined to a minimum.
        const MAX_CANDIDATES: usize = 3;
        let count = self.indices().len();
        let padded = |values: &[f64]| -> Vec<f64> {
            (0..count).map(|i| values.get(i).copied().unwrap_or(0.0)).collect()
        };
        let starts = if self.fitted.is_wide() { &FISHEYE_STARTS[..] } else { &STARTS[..] };
        let starts = starts.iter().map(|start| padded(start)).chain([padded(smaller)]);
        let mut candidates = self.states_from(starts, FIRST_STEPS);
        candidates.sort_by(|a, b| a.1.total_cmp(&b.1));
        candidates.truncate(MAX_CANDIDATES);
        let minima = self.states_from(candidates.into_iter().map(|(values, _)| values), MAX_STEPS);
        minima.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Returns the distinct states reached from these starts after a number of steps, with their costs.
    fn states_from(&self, starts: impl Iterator<Item = Vec<f64>>, steps: usize) -> Vec<(Vec<f64>, f64)> {
        let mut found: Vec<(Vec<f64>, f64)> = Vec::new();
        for start in starts {
            let is_known = |at: &Vec<f64>, _| found.iter().any(|(other, _)| self.is_same(other, at));
            if let Some(summary) = least_squares_unless(self, start, steps, is_known) {
                found.push((summary.state, summary.cost));
            }
        }
        found
    }

    /// Whether two states are so close that runs from both converge to the same minimum.
    pub(super) fn is_same(&self, a: &[f64], b: &[f64]) -> bool {
        /// Largest difference of each parameter between equal states; for the principal point, in units of the
        /// focal length.
        const MAX_DISTANCE: f64 = 1e-4;
        let pixels = self.fitted.len() + self.free.iter().take_while(|&&index| index < Lens::CENTRE).count();
        let mut off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).enumerate();
        off.all(|(i, off)| off < if i < pixels { MAX_DISTANCE } else { MAX_DISTANCE * self.unit })
    }
}

/// Returns the derivatives of the undistorted position of a pixel with respect to the parameters of a lens; for
/// a wide lens, in the chart around the pixel.
///
/// If a wide lens does not show the pixel, the nearest valid pixel toward the principal point is used.
pub(super) fn undistorted_by_parameters(lens: &Lens, place: Pixel) -> Option<ByParameters> {
    /// Largest number of pixels tried for a wide lens, from the given pixel toward the principal point, to
    /// find a valid one.
    const MAX_POSITIONS: usize = 40;
    let centre = lens.principal_point;
    let toward = |k: usize| {
        let share = 1.0 - k as f64 / MAX_POSITIONS as f64;
        Pixel::new(centre.u + share * (place.u - centre.u), centre.v + share * (place.v - centre.v))
    };
    let tried = if lens.distortion.is_wide() { MAX_POSITIONS } else { 1 };
    (0..tried).map(toward).find_map(|pixel| {
        let chart = Chart::centred_on(lens, &[pixel]);
        let point = lens.pixel_to_chart(pixel, chart.as_ref())?;
        Some(lens.pixel_to_chart_by_parameters(pixel, &point, chart.as_ref()))
    })
}

/// Normal equations of a lens fit: the matrix J'J and the gradient J'r of the residuals r with the Jacobian
/// J.
pub(crate) struct Normal {
    square: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl LeastSquares for LensProblem<'_> {
    type State = Vec<f64>;
    type Normal = Normal;

    fn linearize(&self, values: &Vec<f64>) -> Option<(f64, Normal)> {
        let (residuals, jacobian) = self.residuals_and_jacobian(values)?;
        let (cost, normal) = Normal::new(&residuals, &jacobian);
        cost.is_finite().then_some((cost, normal))
    }

    fn step(&self, values: &Vec<f64>, normal: &Normal, damping: f64) -> Option<(Vec<f64>, f64, f64)> {
        normal.step(values, damping)
    }
}

impl Normal {
    /// Returns the normal equations of residuals with their Jacobian, and the sum of squares.
    pub(super) fn new(residuals: &DVector<f64>, jacobian: &DMatrix<f64>) -> (f64, Self) {
        let normal = Self { square: jacobian.tr_mul(jacobian), gradient: jacobian.tr_mul(residuals) };
        (residuals.norm_squared(), normal)
    }

    /// Computes a damped step. Returns the new values, the predicted reduction of the cost, and the largest
    /// absolute component of the step.
    pub(super) fn step(&self, values: &[f64], damping: f64) -> Option<(Vec<f64>, f64, f64)> {
        let mut damped = self.square.clone();
        for i in 0..values.len() {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&(-&self.gradient));
        let predicted: f64 = (0..values.len())
            .map(|i| step[i] * (damping * self.square[(i, i)] * step[i] - self.gradient[i]))
            .sum();
        let next = values.iter().zip(step.iter()).map(|(value, step)| value + step).collect();
        Some((next, predicted, step.amax()))
    }
}

/// Start values of the first two coefficients, with coordinates in units of half the image diagonal.
const STARTS: [[f64; 2]; 7] =
    [[0.0, 0.0], [-0.1, 0.0], [0.1, 0.0], [-0.25, 0.05], [-0.4, 0.15], [-0.55, 0.3], [-0.1, -0.02]];

/// Start values of the first two coefficients of a fisheye: the families equidistant, equisolid and
/// stereographic.
const FISHEYE_STARTS: [[f64; 2]; 3] = [[0.0, 0.0], [-0.042, 0.0005], [0.083, 0.008]];

/// Returns the sum of the squared distances of the points of a polyline from the best straight line, in
/// square pixels. The sum is infinite if a point cannot be undistorted.
fn edge_cost(lenses: [&Lens; 2], edge: &Edge) -> f64 {
    straightness_in_charts_of(lenses, &edge.points)
        .map_or(f64::INFINITY, |distances| distances.iter().map(|d| d * d).sum())
}

impl LensProblem<'_> {
    /// Frees the focal length, and the principal point unless it is fixed.
    ///
    /// The start value is the focal length with the lowest cost after a few steps from each of several values.
    pub(super) fn with_free_focal(mut self, is_centre_fixed: bool) -> Self {
        /// Start values of the focal length: fisheyes from 60 to 250 degrees, in units of half the image
        /// diagonal.
        const START_FOCALS: [f64; 5] = [0.4, 0.52, 0.68, 0.9, 1.2];
        /// Number of steps from every start value.
        const FIRST_STEPS: usize = 8;
        self.free = vec![Lens::LENS_FOCAL];
        if !is_centre_fixed {
            self.free.extend([Lens::CENTRE, Lens::CENTRE + 1]);
        }
        let [w, h] = self.size;
        let half_diagonal = 0.5 * w.hypot(h);
        let log_focal = self.fitted.len();
        let absolute = |values: &[f64], unit: f64| -> Vec<f64> {
            let mut values = values.to_vec();
            values[log_focal] += unit.ln();
            values
        };
        let mut best: Option<(f64, f64)> = None;
        let mut reached: Vec<Vec<f64>> = Vec::new();
        for start in START_FOCALS {
            self.unit = start * half_diagonal;
            let is_known = |values: &Vec<f64>, _| {
                let here = absolute(values, self.unit);
                reached.iter().any(|other| self.is_same(other, &here))
            };
            let values = vec![0.0; self.indices().len()];
            let Some(found) = least_squares_unless(&self, values, FIRST_STEPS, is_known) else { continue };
            reached.push(absolute(&found.state, self.unit));
            if best.is_none_or(|(cost, _)| found.cost < cost) {
                best = Some((found.cost, self.lens(&found.state).focal));
            }
        }
        self.unit = best.map_or(half_diagonal, |(_, focal)| focal);
        self
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::BrownConrady;

    proptest! {
        #[test]
        fn prior_derivatives_match_finite_differences(k in [-0.4..0.2_f64, -0.3..0.3_f64, -0.2..0.2_f64], p in [-0.01..0.01_f64, -0.01..0.01_f64], focal in 400.0..3000.0_f64) {
            const STEP: f64 = 1e-6;
            let brown = BrownConrady { k1: k[0], k2: k[1], k3: k[2], p1: p[0], p2: p[1] };
            let lens = Lens { principal_point: Pixel::new(960.0, 540.0), focal, pixel_aspect: 1.0, distortion: Distortion::BrownConrady(brown), image_circle: None };
            let all = [0, 1, 2, 3, 4, 5, 6, 7];
            let size = [1920.0, 1080.0];
            let centre = PrincipalPointPrior::of_image(size);
            let aspect = Some(Prior { value: 1.1, sigma: 0.02 });
            let prior = |lens: &Lens| lens_prior(lens, size, (centre, aspect), &all);
            let here = prior(&lens);
            prop_assert_eq!(here.len(), Lens::PARAMETERS);
            for k in all {
                let (ahead, behind) = (prior(&lens.nudged(k, STEP)), prior(&lens.nudged(k, -STEP)));
                for (i, residual) in here.iter().enumerate() {
                    let numeric = (ahead[i].value - behind[i].value) / (2.0 * STEP);
                    prop_assert!((numeric - residual.by[k]).abs() < 1e-3 * (1.0 + residual.by[k].abs()), "{i} by {k}: {numeric} {:?}", residual.by);
                }
            }
        }

        #[test]
        fn fisheye_slope_derivatives_match_finite_differences(
            k in [-0.03..0.1_f64, -0.002..0.01_f64], focal in 500.0..900.0_f64, at in [0.0..1920.0_f64, 0.0..1920.0_f64],
        ) {
            const STEPS: [f64; Lens::PARAMETERS] = [1e-8, 1e-8, 1e-8, 1e-8, 1e-6, 1e-3, 1e-3, 1e-6];
            let distortion = Distortion::KannalaBrandt { k: [k[0], k[1], 0.0, 0.0] };
            let lens = Lens { principal_point: Pixel::new(950.0, 970.0), focal, pixel_aspect: 1.0, distortion, image_circle: None };
            let at = Pixel::from(at);
            prop_assume!(at.distance(lens.principal_point) > 50.0);
            let slope = |lens: &Lens| slope_prior(lens, Some(at)).map(|prior| prior.value).unwrap();
            let here = slope_prior(&lens, Some(at)).unwrap();
            prop_assume!(here.value.abs() < 2.0);
            for (k, step) in STEPS.into_iter().enumerate() {
                let numeric = (slope(&lens.nudged(k, step)) - slope(&lens.nudged(k, -step))) / (2.0 * step);
                prop_assert!((numeric - here.by[k]).abs() < 1e-3 * (1.0 + here.by[k].abs()), "{k}: {numeric} {:?}", here.by);
            }
        }
    }
}
