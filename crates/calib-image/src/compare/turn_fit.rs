//! Robust estimate of a camera's rotation and zoom from the offsets of edges, with its covariance.
//!
//! The edges are observed in a new image. A sample on an edge has the offset `d` across the edge, with the
//! standard deviation `sigma`. A small rotation and zoom `x` predicts the offset `a' x`, with the derivatives
//! `a`. The estimate minimises
//!
//! ```text
//! sum over samples of rho((d - a' x) / s),   s^2 = sigma^2 + tau^2
//! ```
//!
//! with Tukey's `rho` (Beaton and Tukey 1974), starting from least absolute deviations. Moving objects form a
//! minority of mutually consistent offsets and must not bias the estimate. `tau` is the scatter of the
//! samples beyond their own noise, estimated from the median.
//!
//! # Correlation within an edge
//!
//! Lighting, codecs and the detector's own error shift all samples of one edge alike, by an offset of
//! variance `e^2` ([`Scatter::edge`]). The samples of an edge are therefore not independent. With `W` the
//! precisions of the samples about their edge, `p` = [`Scatter::place`] and the vector `1` of ones,
//!
//! ```text
//! W = diag(w / (sigma^2 + p^2)),    (W^-1 + e^2 1 1')^-1 = W - W 1 1' W e^2 / (1 + e^2 1' W 1)
//! ```
//!
//! (Woodbury 1950). `w` are the weights of Tukey's `rho`. An edge of twenty samples therefore counts little
//! more than an edge of five. `p` and `e` are estimated from medians: `p` from the samples about their edge,
//! `e` from the edges about the fitted rotation. If a step is estimated, `e` is zero, because the offsets of
//! edges of unknown depth are the signal of the step.
//!
//! # Correlation within a block
//!
//! Everything in one block of the image is shifted alike, by one lens error or one shelf. The shift is a
//! vector with variance `b^2` along either axis ([`Scatter::block`]). It is eliminated like the offsets of
//! edges. With `P` the precisions of the samples of a block and `N` the directions across their edges,
//!
//! ```text
//! (P^-1 + b^2 N N')^-1 = P - P N (1 / b^2 + N' P N)^-1 N' P
//! ```
//!
//! (Woodbury 1950).
//!
//! # Covariance
//!
//! The covariance is the sum of two parts. The first is the cluster-robust covariance of the blocks, with the
//! correction of Bell and `McCaffrey` (2002). It uses the mean slope of Tukey's psi instead of the mean
//! weight (Huber 1981, section 7.6). The second covers lighting, codec and interpolation errors that are as
//! smooth over the image as a rotation. No residual shows these; their size was measured on images rotated by
//! known amounts ([`IMAGE_VARIANCE_RATIO`]).
//!
//! # Tone
//!
//! Lighting changes, a clipped sky or a different gamma shift a blurred edge towards its dark or its bright
//! side. The shift depends on the contrast and brightness level of the edge. If most edges of one direction
//! are bright above and dark below, this looks like a tilt. The dependence on contrast and level is therefore
//! estimated with the rotation ([`EdgeOffset::by_tone`]).

use std::collections::BTreeMap;

use calib_core::camera::RotationZoom;
use calib_core::optimize::chi2_score;
use nalgebra::{DMatrix, DVector, Matrix2, OMatrix, Vector2};

/// Number of parameters of the tone, the effect of lighting on edges.
pub const TONE_SIZE: usize = 3;
/// Number of parameters of a step (translation) of the camera.
pub const STEP_SIZE: usize = 3;

/// Offset of an edge from its predicted position, in the direction across the edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeOffset {
    /// Offset, in pixels.
    pub offset: f64,
    /// Direction of positive offsets in the image, a unit vector.
    pub across: [f64; 2],
    /// Standard deviation of the offset, in pixels.
    pub sigma: f64,
    /// Derivatives of the offset with respect to rotation and zoom, in pixels per radian and per log focal
    /// ratio.
    pub by_rotation: [f64; RotationZoom::SIZE],
    /// Sensitivity to lighting: contrast towards the positive side, times the powers 0, 1 and 2 of the
    /// brightness level.
    pub by_tone: [f64; TONE_SIZE],
    /// Derivatives of the offset with respect to a step (translation) of the camera, in pixels per metre.
    pub by_step: [f64; STEP_SIZE],
    /// Index of the image block of this sample.
    pub block: usize,
    /// Index of the edge, if the edge has several samples. The samples of an edge are consecutive in a list.
    pub edge: Option<usize>,
}

impl EdgeOffset {
    /// Returns the derivative of the offset with respect to parameter `k`: rotation and zoom, then tone, then
    /// step.
    pub(super) fn derivative(&self, k: usize) -> f64 {
        /// Index of the first parameter of the step.
        const FIRST_STEP_PARAMETER: usize = RotationZoom::SIZE + TONE_SIZE;
        match k {
            0..RotationZoom::SIZE => self.by_rotation[k],
            RotationZoom::SIZE..FIRST_STEP_PARAMETER => self.by_tone[k - RotationZoom::SIZE],
            _ => self.by_step[k - FIRST_STEP_PARAMETER],
        }
    }

    /// Returns the offset predicted by these parameters, in pixels.
    #[must_use]
    pub fn predicted(&self, estimate: &DVector<f64>) -> f64 {
        (0..estimate.len()).map(|k| self.derivative(k) * estimate[k]).sum()
    }
}

/// Prior standard deviation of the shift of an edge by lighting, in pixels per unit of contrast in log
/// brightness.
const TONE_PRIOR_SIGMA_PX: f64 = 0.3;

/// Matrix with a row for each parameter and a column for each component (u, v) of the shift of a block.
type ByMotion = OMatrix<f64, nalgebra::Dyn, nalgebra::U2>;

/// Normal equations of the edges of one block.
#[derive(Clone, Debug)]
pub(super) struct BlockEquations {
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// Product `A' P N`, with `A` the derivatives of the offsets. `P` and `N` are in the documentation of
    /// this file.
    cross: ByMotion,
    /// Product `N' P N`: the information about the shift of the block.
    motion: Matrix2<f64>,
    /// Product `N' P d`, with `d` the offsets: the score of the shift of the block. `P` and `N` are in the
    /// documentation of this file.
    motion_score: Vector2<f64>,
    /// Precision of an offset common to all samples, in 1/px².
    pub(super) precision: f64,
}

/// Normal equations of all blocks.
#[derive(Clone, Debug)]
pub(super) struct NormalEquations {
    information: DMatrix<f64>,
    score: DVector<f64>,
}

impl BlockEquations {
    pub(super) fn zeros(unknowns: usize) -> Self {
        Self {
            information: DMatrix::zeros(unknowns, unknowns),
            score: DVector::zeros(unknowns),
            cross: ByMotion::zeros(unknowns),
            motion: Matrix2::zeros(),
            motion_score: Vector2::zeros(),
            precision: 0.0,
        }
    }

    /// Adds the samples of one edge, whose common offset has the standard deviation `shared`, in pixels.
    pub(super) fn add(&mut self, edge: &[EdgeOffset], precisions: &[f64], shared: f64) {
        // The products A' W 1 (`together`), N' W 1 (`way`), d' W 1 (`offset`) and 1' W 1 (`total`).
        let (mut total, mut offset) = (0.0, 0.0);
        let (mut together, mut way) = (DVector::zeros(self.score.len()), Vector2::zeros());
        for (row, &precision) in edge.iter().zip(precisions).filter(|(_, precision)| **precision > 0.0) {
            let by = DVector::from_fn(self.score.len(), |k, _| row.derivative(k));
            let across = Vector2::from(row.across);
            self.score.axpy(precision * row.offset, &by, 1.0);
            self.information.ger(precision, &by, &by, 1.0);
            self.cross.ger(precision, &by, &across, 1.0);
            self.motion.ger(precision, &across, &across, 1.0);
            self.motion_score += precision * row.offset * across;
            together.axpy(precision, &by, 1.0);
            way += precision * across;
            offset += precision * row.offset;
            total += precision;
        }
        let known = shared * shared / (1.0 + shared * shared * total);
        self.score.axpy(-known * offset, &together, 1.0);
        self.information.ger(-known, &together, &together, 1.0);
        self.cross.ger(-known, &together, &way, 1.0);
        self.motion.ger(-known, &way, &way, 1.0);
        self.motion_score -= known * offset * way;
        self.precision += total - known * total * total;
    }

    /// Returns the information and score with the shift of the block eliminated. `block` is the standard
    /// deviation of the shift along either axis, in pixels.
    fn without_shift(&self, block: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        if block <= 0.0 {
            return Some((self.information.clone(), self.score.clone()));
        }
        let known = (Matrix2::identity() / (block * block) + self.motion).try_inverse()?;
        let carried = &self.cross * known;
        Some((
            &self.information - &carried * self.cross.transpose(),
            &self.score - carried * self.motion_score,
        ))
    }
}

impl NormalEquations {
    /// Sums the equations of the blocks. `block` is the standard deviation of the shift of each block along
    /// either axis, in pixels.
    pub(super) fn from_blocks(blocks: &[BlockEquations], block: f64) -> Option<Self> {
        let unknowns = blocks.first()?.score.len();
        let (mut information, mut score) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        for one in blocks {
            let (own, own_score) = one.without_shift(block)?;
            information += own;
            score += own_score;
        }
        Some(Self { information, score })
    }

    /// Returns the covariance bound of the parameters: the inverse of the information including the tone
    /// prior.
    pub(super) fn bound(&self) -> Option<DMatrix<f64>> {
        Some(self.information_with_prior().cholesky()?.inverse())
    }

    /// Computes the cluster-robust covariance from the scatter of the blocks (Bell and `McCaffrey` 2002).
    ///
    /// With the total information `I`, and the information `I_k`, the score `s_k` and
    /// `H_k = I^-1/2 I_k I^-1/2` of block `k`, the covariance is the sum of the squares of
    /// `I^-1/2 (1 - H_k)^-1/2 I^-1/2 s_k`. The precision `P` of the tone prior adds `I^-1 P I^-1`. A
    /// direction with nearly all information in one block cannot be tested against the other blocks. Its squared
    /// score then counts as at least its expectation, 1. `slope` is the mean slope of psi divided by the mean
    /// weight.
    pub(super) fn cluster_covariance(
        &self,
        blocks: &[BlockEquations],
        block: f64,
        estimate: &DVector<f64>,
        slope: f64,
    ) -> Option<DMatrix<f64>> {
        /// Share of the information above which a single block dominates a direction of the parameter space.
        const MAX_BLOCK_SHARE: f64 = 0.95;
        let root = self.information_with_prior().cholesky()?.l().try_inverse()?;
        let bound = root.transpose() * &root;
        let prior =
            DMatrix::from_diagonal(&(self.information_with_prior().diagonal() - self.information.diagonal()));
        let mut covariance = &bound * prior * &bound;
        for one in blocks {
            let (information, score) = one.without_shift(block)?;
            let standardised = &root * (score - &information * estimate);
            let eigen = (&root * information * root.transpose()).symmetric_eigen();
            let mut along = eigen.eigenvectors.transpose() * standardised;
            for (along, &share) in along.iter_mut().zip(&eigen.eigenvalues) {
                *along = if share > MAX_BLOCK_SHARE {
                    along.abs().max(1.0).copysign(*along)
                } else {
                    *along / ((1.0 - share).sqrt() * slope)
                };
            }
            let moved = root.transpose() * (eigen.eigenvectors * along);
            covariance.ger(1.0, &moved, &moved, 1.0);
        }
        Some(covariance)
    }

    /// Returns the information including the tone prior.
    fn information_with_prior(&self) -> DMatrix<f64> {
        let mut information = self.information.clone();
        let tone = (RotationZoom::SIZE..RotationZoom::SIZE + TONE_SIZE).filter(|&i| i < self.score.len());
        tone.for_each(|i| information[(i, i)] += TONE_PRIOR_SIGMA_PX.powi(-2));
        information
    }

    /// Returns the estimate of the parameters; `None` if the edges do not determine all of them.
    pub(super) fn solve(&self) -> Option<DVector<f64>> {
        /// Smallest squared pivot of the scaled information for a parameter to count as determined.
        const MIN_PIVOT: f64 = 1e-9;
        // Scale every parameter by its marginal information, so that radians and ratios are comparable.
        let information = self.information_with_prior();
        let units = information.diagonal().map(|value| value.max(f64::MIN_POSITIVE).sqrt().recip());
        let scaled =
            DMatrix::from_fn(units.len(), units.len(), |i, j| information[(i, j)] * units[i] * units[j]);
        let cholesky = scaled.cholesky()?;
        let is_determined = cholesky.l_dirty().diagonal().iter().all(|pivot| pivot * pivot > MIN_PIVOT);
        is_determined.then(|| cholesky.solve(&self.score.component_mul(&units)).component_mul(&units))
    }
}

/// Parameters that a [`RotationFit`] estimates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FitParameters {
    /// Rotation and zoom only, for offsets that lighting does not affect.
    Rotation,
    /// Rotation, zoom and tone.
    RotationAndTone,
    /// Rotation, zoom, tone and a step of the camera.
    RotationToneAndStep,
}

/// Rotation and zoom fitted to the offsets of all edges.
#[derive(Clone, Debug)]
pub struct RotationFit {
    /// Estimated parameters: rotation and zoom, then tone, then step.
    pub estimate: DVector<f64>,
    /// Covariance of the estimate: the cluster-robust part plus the part of image-wide errors.
    pub covariance: DMatrix<f64>,
    /// Covariance under the assumption that only the shifts of edges and of blocks are common to several samples. It
    /// approximates the lower bound for any estimator from these edges (Cramér 1946, Rao 1945).
    pub bound: DMatrix<f64>,
    /// Scatter of the samples beyond their own noise.
    pub scatter: Scatter,
    /// Weight of every sample, 0 to 1; 0 for an outlier, for example a moving object.
    pub weights: Vec<f64>,
    /// Number of blocks with usable samples.
    pub blocks: usize,
}

/// Standard deviations of the offsets beyond their own noise, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scatter {
    /// Standard deviation of a sample about its edge.
    pub place: f64,
    /// Standard deviation of the shift common to all samples of an edge.
    pub edge: f64,
    /// Standard deviation of the shift common to all edges of a block, along either axis.
    pub block: f64,
}

/// Smallest residual with a Tukey weight of zero, in standard deviations: 95 % efficiency for normal errors.
const TUKEY_LIMIT: f64 = 4.685;
/// Ratio of the standard deviation to the median absolute deviation of a normal variable.
pub(crate) const MAD_TO_SIGMA: f64 = 1.4826;
/// Smallest accepted standard deviation of an offset, in pixels.
const MIN_SIGMA_PX: f64 = 0.01;
/// Largest standard deviation of the shift of a block, in pixels. Larger shifts come from the depth of the
/// scene, not from lens, lighting or codec. They indicate a step of the camera, not a rotation.
const MAX_BLOCK_SIGMA_PX: f64 = 0.2;
/// Ratio of the variance of image-wide errors that resemble a rotation to the bound. The value is not
/// derived. It was chosen on half of the images of `tests/compare.rs`, which have a width of 960 pixels and
/// some thousand samples each.
const IMAGE_VARIANCE_RATIO: f64 = 0.5;
/// Number of iterations of reweighted least squares.
const ITERATIONS: usize = 12;

impl FitParameters {
    /// Returns the number of estimated parameters.
    const fn unknowns(self) -> usize {
        match self {
            Self::Rotation => RotationZoom::SIZE,
            Self::RotationAndTone => RotationZoom::SIZE + TONE_SIZE,
            Self::RotationToneAndStep => RotationZoom::SIZE + TONE_SIZE + STEP_SIZE,
        }
    }
}

impl RotationFit {
    /// Fits the parameters `of` to the offsets; `None` if the edges do not determine the parameters.
    #[must_use]
    pub fn new(offsets: &[EdgeOffset], of: FitParameters) -> Option<Self> {
        let rows = Rows { offsets, unknowns: of.unknowns() };
        let mut estimate = rows.least_deviations()?;
        let mut weights = vec![1.0; offsets.len()];
        let (mut blocks, mut scatter) = (Vec::new(), Scatter::default());
        for _ in 0..ITERATIONS {
            let residuals = rows.residuals(&estimate);
            let together = excess_scatter(&residuals, offsets);
            weights = rows.standardised(&residuals, together).map(tukey).collect();
            let of_edges = if of == FitParameters::RotationToneAndStep {
                None
            } else {
                rows.scatter(&residuals, &weights)
            };
            scatter = of_edges.unwrap_or(Scatter { place: together, ..Scatter::default() });
            let precision =
                |i: usize| weights[i] / offsets[i].sigma.hypot(scatter.place).max(MIN_SIGMA_PX).powi(2);
            let precisions: Vec<f64> = (0..offsets.len()).map(precision).collect();
            blocks = rows.blocks(&precisions, scatter.edge);
            estimate = NormalEquations::from_blocks(&blocks, scatter.block)?.solve()?;
        }
        let all = NormalEquations::from_blocks(&blocks, scatter.block)?;
        let slope = rows.slope(&estimate, &weights);
        let (bound, cluster_part) =
            (all.bound()?, all.cluster_covariance(&blocks, scatter.block, &estimate, slope)?);
        let (covariance, blocks) = (IMAGE_VARIANCE_RATIO * &bound + cluster_part, blocks.len());
        Some(Self { estimate, covariance, bound, scatter, weights, blocks })
    }

    /// Returns the fitted rotation and zoom.
    #[must_use]
    pub fn rotation(&self) -> RotationZoom {
        RotationZoom::from_parameters(std::array::from_fn(|i| self.estimate[i]))
    }

    /// Returns the fitted step of the camera, in metres; zero if the step is not estimated.
    #[must_use]
    pub fn step(&self) -> [f64; STEP_SIZE] {
        /// Index of the first parameter of the step.
        const FIRST_STEP_PARAMETER: usize = RotationZoom::SIZE + TONE_SIZE;
        std::array::from_fn(|k| self.estimate.get(FIRST_STEP_PARAMETER + k).copied().unwrap_or_default())
    }

    /// Returns the significance of the parameters `from..to` as a z-score: the distance of the estimate from
    /// zero, in standard deviations of a normal variable.
    ///
    /// Most of the covariance is itself estimated from `m` blocks. Hotelling's (1931) square is therefore
    /// scaled to a chi-square by its expectation, `(m - k - 2) / (m - 1)` for `k` parameters.
    #[must_use]
    pub fn z_score(&self, from: usize, to: usize) -> f64 {
        let (count, blocks) = (to - from, self.blocks as f64);
        let part = self.covariance.view((from, from), (count, count)).into_owned();
        let estimate = self.estimate.rows(from, count).into_owned();
        let Some(inverse) = part.cholesky() else { return 0.0 };
        let square = estimate.dot(&inverse.solve(&estimate));
        let shrunk = square * ((blocks - count as f64 - 2.0) / (blocks - 1.0).max(1.0)).max(0.0);
        chi2_score(shrunk, count as f64).max(0.0)
    }
}

/// Samples as rows of a linear system.
struct Rows<'a> {
    offsets: &'a [EdgeOffset],
    /// Number of estimated parameters.
    unknowns: usize,
}

impl Rows<'_> {
    /// Returns the offsets minus the offsets predicted by an estimate, in pixels.
    fn residuals(&self, estimate: &DVector<f64>) -> Vec<f64> {
        self.offsets.iter().map(|row| row.offset - row.predicted(estimate)).collect()
    }

    /// Divides the residuals by their standard deviations: the noise of each sample combined with the scatter
    /// `together`, in pixels.
    fn standardised(&self, residuals: &[f64], together: f64) -> impl Iterator<Item = f64> {
        let each = residuals.iter().zip(self.offsets);
        each.map(move |(residual, row)| residual / row.sigma.hypot(together).max(MIN_SIGMA_PX))
    }

    /// Estimates the parameters with the least absolute deviations by iteratively reweighted least squares
    /// (Schlossmacher 1973).
    fn least_deviations(&self) -> Option<DVector<f64>> {
        /// Residual below which all samples have the same weight, in pixels.
        const MIN_RESIDUAL_PX: f64 = 0.05;
        let mut estimate = DVector::zeros(self.unknowns);
        for _ in 0..ITERATIONS {
            let residuals = self.residuals(&estimate);
            let weights: Vec<f64> = residuals.iter().map(|r| r.abs().max(MIN_RESIDUAL_PX).recip()).collect();
            estimate = NormalEquations::from_blocks(&self.blocks(&weights, 0.0), 0.0)?.solve()?;
        }
        Some(estimate)
    }

    /// Returns the mean slope of Tukey's psi divided by the mean weight: 0.83 for normal errors.
    fn slope(&self, estimate: &DVector<f64>, weights: &[f64]) -> f64 {
        /// Lower limit of the result, for few samples.
        const MIN_SLOPE_RATIO: f64 = 0.5;
        let residuals = self.residuals(estimate);
        let together = excess_scatter(&residuals, self.offsets);
        let slopes: f64 = self.standardised(&residuals, together).map(psi_slope).sum();
        (slopes / weights.iter().sum::<f64>()).max(MIN_SLOPE_RATIO)
    }

    /// Iterates over the edges, each as the range of its samples.
    fn edges(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        let edges = self.offsets.chunk_by(|a, b| a.edge.is_some() && a.edge == b.edge);
        edges.scan(0, |end, edge| {
            let start = std::mem::replace(end, *end + edge.len());
            Some(start..*end)
        })
    }

    /// Estimates the scatter of samples, edges and blocks; `None` if too few edges have several samples.
    fn scatter(&self, residuals: &[f64], weights: &[f64]) -> Option<Scatter> {
        /// Smallest number of samples of an edge for an estimate of their scatter.
        const MIN_SAMPLES_PER_EDGE: usize = 3;
        /// Smallest number of edges with several samples for an estimate of the scatter.
        const MIN_EDGES: usize = 12;
        let (mut about, mut own, mut means, mut of_means) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for edge in self.edges() {
            let used: Vec<usize> = edge.filter(|&i| weights[i] > 0.0).collect();
            if used.len() < MIN_SAMPLES_PER_EDGE {
                continue;
            }
            let count = used.len() as f64;
            let mean = used.iter().map(|&i| residuals[i]).sum::<f64>() / count;
            let freedom = (count / (count - 1.0)).sqrt();
            about.extend(used.iter().map(|&i| freedom * (residuals[i] - mean)));
            own.extend(used.iter().map(|&i| self.offsets[i].sigma));
            means.push((mean, &self.offsets[used[used.len() / 2]]));
            of_means.push(count);
        }
        if means.len() < MIN_EDGES {
            return None;
        }
        let deviation =
            |values: Vec<f64>| MAD_TO_SIGMA * median(values.iter().map(|value| value.abs()).collect());
        let place = deviation(about);
        let all = deviation(means.iter().map(|(mean, _)| *mean).collect());
        let by_places = place * place / median(of_means);
        let by_blocks = motion_variance(&means, all).min(MAX_BLOCK_SIGMA_PX * MAX_BLOCK_SIGMA_PX);
        Some(Scatter {
            place: (place * place - median(own).powi(2)).max(0.0).sqrt(),
            edge: (all * all - by_places - by_blocks).max(0.0).sqrt(),
            block: by_blocks.sqrt(),
        })
    }

    /// Builds the normal equations of every block; an edge belongs to the block of its middle sample. `edge`
    /// is the standard deviation of the shift of an edge, in pixels.
    fn blocks(&self, precisions: &[f64], edge: f64) -> Vec<BlockEquations> {
        let count = self.offsets.iter().map(|row| row.block + 1).max().unwrap_or(0);
        let mut blocks: Vec<BlockEquations> =
            (0..count).map(|_| BlockEquations::zeros(self.unknowns)).collect();
        for places in self.edges() {
            let block = self.offsets[places.start + places.len() / 2].block;
            blocks[block].add(&self.offsets[places.clone()], &precisions[places], edge);
        }
        blocks.retain(|block| block.precision > 0.0);
        blocks
    }
}

/// Estimates the variance, along either axis, of the shift common to all edges of a block, in square pixels.
///
/// The estimate uses the products of pairs of edges, `E r r' = b^2 n n'`, with `r` the offsets of the edges
/// and `n` the directions across them. `b^2` is the variance, and `E` the expectation. Offsets are clamped to
/// three times `usual`, in pixels.
fn motion_variance(edges: &[(f64, &EdgeOffset)], usual: f64) -> f64 {
    let mut sums: BTreeMap<usize, [f64; 5]> = BTreeMap::new();
    let (mut products, mut squares) = (0.0, 0.0);
    for (off, EdgeOffset { across: [x, y], block, .. }) in edges {
        let off = off.clamp(-3.0 * usual, 3.0 * usual);
        // Sums of r n and of n n' over the previous edges of the block.
        let sum = sums.entry(*block).or_default();
        products += off * (sum[0] * x + sum[1] * y);
        squares += sum[2] * x * x + 2.0 * sum[3] * x * y + sum[4] * y * y;
        for (sum, own) in sum.iter_mut().zip([off * x, off * y, x * x, x * y, y * y]) {
            *sum += own;
        }
    }
    if squares > 0.0 { (products / squares).max(0.0) } else { 0.0 }
}

/// Returns Tukey's weight of a standardised residual.
fn tukey(residual: f64) -> f64 {
    let share = residual / TUKEY_LIMIT;
    (1.0 - share * share).max(0.0).powi(2)
}

/// Returns the slope of Tukey's psi, which is a residual times its weight.
fn psi_slope(residual: f64) -> f64 {
    let square = (residual / TUKEY_LIMIT).powi(2);
    (1.0 - square).max(0.0) * (1.0 - 5.0 * square)
}

/// Returns the median; 0 for no values.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Estimates the standard deviation of the residuals beyond the noise of their samples, in pixels.
fn excess_scatter(residuals: &[f64], offsets: &[EdgeOffset]) -> f64 {
    let all = MAD_TO_SIGMA * median(residuals.iter().map(|r| r.abs()).collect());
    let own = median(offsets.iter().map(|row| row.sigma).collect());
    (all * all - own * own).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use calib_core::camera::{Camera, Covariance, Lens, Pixel, WorldPoint, pixel_to_camera_ray};
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const COLUMNS: usize = 8;
    const BLOCKS: usize = 48;

    fn camera() -> Camera {
        Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.3,
            pitch: 0.4,
            roll: 0.05,
            focal: 700.0,
            lens: Lens::pinhole(Pixel::new(480.0, 270.0)),
            covariance: Covariance::EXACT,
        }
    }

    /// Returns the covariance without the image-wide part, for data without image-wide errors.
    fn cluster_part(fit: &RotationFit) -> DMatrix<f64> {
        &fit.covariance - IMAGE_VARIANCE_RATIO * &fit.bound
    }

    fn normal(random: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| random.random_range(-0.5..0.5_f64)).sum()
    }

    /// Creates an edge at a random position in a block of the image, with offset 0.
    fn edge(camera: &Camera, block: usize, random: &mut ChaCha8Rng) -> EdgeOffset {
        let u = 120.0 * ((block % COLUMNS) as f64 + random.random_range(0.0..1.0));
        let v = 90.0 * ((block / COLUMNS) as f64 + random.random_range(0.0..1.0));
        let angle = random.random_range(0.0..std::f64::consts::TAU);
        let contrast = if angle.sin() > 0.0 { 1.0 } else { random.random_range(-1.0..1.0) };
        place(camera, block, [u, v], angle, contrast)
    }

    /// Creates a sample of an edge; `angle` is the direction of positive offsets.
    fn place(camera: &Camera, block: usize, [u, v]: [f64; 2], angle: f64, contrast: f64) -> EdgeOffset {
        const ASIDE: f64 = 1e-6;
        let ray = pixel_to_camera_ray(camera, Pixel { u, v }).unwrap();
        let (sin, cos) = angle.sin_cos();
        let slope = |k: usize| {
            let mut step = [0.0; RotationZoom::SIZE];
            step[k] = ASIDE;
            let there = RotationZoom::from_parameters(step).for_camera(camera).ray_to_pixel(ray).unwrap();
            ((there.u - u) * cos + (there.v - v) * sin) / ASIDE
        };
        EdgeOffset {
            offset: 0.0,
            across: [cos, sin],
            sigma: 0.1,
            by_rotation: std::array::from_fn(slope),
            by_tone: [contrast, 0.0, 0.0],
            by_step: [0.0; STEP_SIZE],
            block,
            edge: None,
        }
    }

    /// Creates edges of three to twenty samples, eight pixels apart. The samples of an edge share an offset
    /// of 0.08 px beyond their own noise. The edges of a block share a vector of `moved` pixels along either
    /// axis.
    fn long_edges(camera: &Camera, truth: &[f64; 4], moved: f64, random: &mut ChaCha8Rng) -> Vec<EdgeOffset> {
        let mut all = Vec::new();
        let mut motion = [0.0; 2];
        for index in 0..4 * BLOCKS {
            let block = index / 4;
            if index % 4 == 0 {
                motion = [0, 1].map(|_| moved * normal(random));
            }
            let corner = [120.0 * (block % COLUMNS) as f64, 90.0 * (block / COLUMNS) as f64];
            let start =
                [corner[0] + random.random_range(0.0..120.0), corner[1] + random.random_range(0.0..90.0)];
            let (angle, contrast) =
                (random.random_range(0.0..std::f64::consts::TAU), random.random_range(-1.0..1.0));
            let shared = 0.08 * normal(random);
            for far in (0..random.random_range(3..=20)).map(|place| 8.0 * f64::from(place)) {
                let at = [start[0] - far * angle.sin(), start[1] + far * angle.cos()];
                let mut place = place(camera, block, at, angle, contrast);
                let predicted: f64 = (0..4).map(|k| place.by_rotation[k] * truth[k]).sum();
                let of_block: f64 =
                    motion.iter().zip(place.across).map(|(motion, across)| motion * across).sum();
                place.offset = predicted + shared + of_block + 0.1 * normal(random);
                place.edge = Some(index);
                all.push(place);
            }
        }
        all
    }

    /// Creates edges after a rotation, with noise, noise common to a block, and lighting that shifts edges to
    /// the dark side. In the first `moved` blocks an object moved.
    fn edges(truth: &[f64; 4], light: f64, moved: usize, random: &mut ChaCha8Rng) -> Vec<EdgeOffset> {
        let camera = camera();
        let mut all = Vec::new();
        for block in 0..BLOCKS {
            let shared = 0.05 * normal(random);
            for _ in 0..30 {
                let mut edge = edge(&camera, block, random);
                let predicted: f64 = (0..4).map(|k| edge.by_rotation[k] * truth[k]).sum();
                let own = if block < moved { 3.0 } else { 0.0 };
                edge.offset = predicted + light * edge.by_tone[0] + shared + 0.1 * normal(random) + own;
                all.push(edge);
            }
        }
        all
    }

    #[test]
    fn the_covariance_holds_with_common_noise_other_lighting_and_moving_objects() {
        const TRIALS: usize = 150;
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut inside = 0;
        for _ in 0..TRIALS {
            let truth: [f64; 4] = std::array::from_fn(|_| 1e-3 * normal(&mut random));
            let fit = RotationFit::new(&edges(&truth, 0.1, 8, &mut random), FitParameters::RotationAndTone)
                .unwrap();
            let is_inside =
                |k: usize| (fit.estimate[k] - truth[k]).abs() < 1.96 * cluster_part(&fit)[(k, k)].sqrt();
            inside += (0..4).filter(|&k| is_inside(k)).count();
        }
        let share = inside as f64 / (4 * TRIALS) as f64;
        assert!((0.9..0.995).contains(&share), "{share} inside 95 %");
    }

    #[test]
    fn a_fixed_camera_rarely_appears_moved() {
        const TRIALS: usize = 150;
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let clear = |_| {
            let fit =
                RotationFit::new(&edges(&[0.0; 4], 0.2, 6, &mut random), FitParameters::RotationAndTone)
                    .unwrap();
            fit.z_score(0, RotationZoom::SIZE) > 3.0
        };
        let alarms = (0..TRIALS).map(clear).filter(|alarm| *alarm).count();
        assert!(alarms <= 2, "{alarms} of {TRIALS}");
    }

    #[test]
    fn errors_reach_the_bound_with_common_shifts_of_edges_and_blocks() {
        const TRIALS: usize = 200;
        let (camera, mut random) = (camera(), ChaCha8Rng::seed_from_u64(6));
        for moved in [0.0, 0.03, 0.1] {
            let (mut squares, mut inside, mut edge, mut block) = (0.0, 0, 0.0, 0.0);
            for _ in 0..TRIALS {
                let truth: [f64; 4] = std::array::from_fn(|_| 1e-3 * normal(&mut random));
                let offsets = long_edges(&camera, &truth, moved, &mut random);
                let fit = RotationFit::new(&offsets, FitParameters::RotationAndTone).unwrap();
                let bound = fit.bound.view((0, 0), (4, 4)).into_owned().cholesky().unwrap();
                let error = DVector::from_fn(4, |k, _| fit.estimate[k] - truth[k]);
                squares += error.dot(&bound.solve(&error)) / 4.0;
                inside +=
                    (0..4).filter(|&k| error[k].abs() < 1.96 * cluster_part(&fit)[(k, k)].sqrt()).count();
                edge += fit.scatter.edge / TRIALS as f64;
                block += fit.scatter.block / TRIALS as f64;
            }
            let over_bound = (squares / TRIALS as f64).sqrt();
            let share = inside as f64 / (4 * TRIALS) as f64;
            assert!((0.94..1.06).contains(&over_bound), "{over_bound} of the bound");
            assert!((0.93..0.98).contains(&share), "{share} inside 95 %");
            assert!((0.06..0.1).contains(&edge), "{edge} px of an edge, 0.08 in truth");
            assert!((block - moved).abs() < 0.02, "{block} px of a block, {moved} in truth");
        }
    }

    #[test]
    fn a_dominant_block_does_not_reduce_the_covariance_below_the_bound() {
        let mut random = ChaCha8Rng::seed_from_u64(8);
        let camera = camera();
        let many = (0..800).map(|_| edge(&camera, 3, &mut random)).collect::<Vec<_>>();
        let few = (0..12).map(|block| edge(&camera, 4 * block, &mut random)).collect::<Vec<_>>();
        let mut all: Vec<EdgeOffset> = many.into_iter().chain(few).collect();
        all.iter_mut().for_each(|edge| edge.offset = 0.1 * normal(&mut random));
        let fit = RotationFit::new(&all, FitParameters::Rotation).unwrap();
        // The block determines pan and tilt, but not the roll about itself.
        for k in 0..2 {
            let of_bound = fit.covariance[(k, k)] / fit.bound[(k, k)];
            assert!(of_bound > 1.0, "{of_bound} of the bound");
        }
    }

    #[test]
    fn undetermined_parameters_are_not_estimated() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let one = edge(&camera(), 3, &mut random);
        assert!(RotationFit::new(&[one; 40], FitParameters::Rotation).is_none());
        assert!(RotationFit::new(&[], FitParameters::RotationAndTone).is_none());
    }
}
