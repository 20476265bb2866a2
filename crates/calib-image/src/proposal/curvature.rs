//! Lens of an image from the curvature of single edges.
//!
//! Only points of one physical edge are evidence for a lens. Edges that would agree better on a vanishing
//! point with distortion are not: joints of a tiled floor agree by chance under many lenses.
//!
//! The ends of a straight 3D edge and the middle of their undistorted chord determine the rise of the edge in
//! the image ([`Rise`](crate::Rise)). The lens has k1 and k2, with coordinates divided by half the image
//! diagonal. The log likelihood of the rises `r_i` is
//!
//! `log L = sum_i log((1 - b) N(r_i - p_i; s_i^2) + b N(r_i - p_i; t^2)) / c`
//!
//! with `p_i` the predicted rise, `s_i` its standard deviation, `b` the share of edges that are curved in the
//! scene, and `t` the standard deviation of their rise. `c` is the average number of edges with the same
//! error (a composite likelihood: Varin, Reid and Firth 2011). The prior is the same as for a hand-annotated lens
//! (`single/lens_problem.rs` of the core).
//!
//! A lens without distortion and a lens with distortion have equal prior probabilities. Their Bayes factor follows
//! from Laplace's approximation. The covariance of the coefficients includes the less likely of the two lenses.

use std::f64::consts::TAU;

use calib_core::{BrownConrady, Distortion, Lens, Pixel, UndistortedPixel};
use nalgebra::{Matrix2, Vector2};

use crate::line_segment::LineSegment;

/// Standard deviations of k1, and of k2 about its expected value.
const PRIOR_SIGMAS: [f64; 2] = [0.2, 0.1];
/// Values of k1 at which the search starts.
const STARTS: [f64; 7] = [0.0, -0.08, -0.16, -0.26, -0.4, -0.6, 0.1];
/// Standard deviation of the systematic error of a measured rise (sagitta), common to all samples of an
/// edge, in pixels.
const SYSTEMATIC_SIGMA_PX: f64 = 0.08;
/// Share of edges that are curved in the scene.
const CURVED_FRACTION: f64 = 0.15;
/// Standard deviation of the rise of edges that are curved in the scene, in pixels.
const CURVED_SIGMA_PX: f64 = 1.0;
/// Average number of edges with the same error.
const EDGE_CORRELATION: f64 = 4.0;

/// Estimate of a lens, with other lenses that are one standard deviation away from it.
#[derive(Clone, Debug)]
pub(super) struct LensEstimate {
    pub(super) lens: Lens,
    /// Lenses at one standard deviation along the principal axes of the covariance of the coefficients. Empty
    /// for a known lens.
    pub(super) deviating: Vec<Lens>,
}

impl LensEstimate {
    /// Returns a lens that is known.
    pub(super) const fn known(lens: Lens) -> Self {
        Self { lens, deviating: Vec::new() }
    }

    /// Estimates the lens from the rises of the edges. `pinhole` is the lens without distortion, and `size` the
    /// width and height of the image, in pixels.
    pub(super) fn from_rises(segments: &[LineSegment], pinhole: Lens, size: [f64; 2]) -> Self {
        let problem = Problem { segments, pinhole, half_diagonal: 0.5 * size[0].hypot(size[1]) };
        let best = STARTS
            .into_iter()
            .map(|k1| problem.maximize(Vector2::new(k1, expected_k2(k1))))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((mode, log_posterior)) = best else { return Self::known(pinhole) };
        let covariance = problem.covariance(mode);
        // Both priors are densities at the coefficients; a lens without distortion has no coefficients.
        let normalization = 0.5 * covariance.determinant().max(f64::MIN_POSITIVE).ln()
            - PRIOR_SIGMAS.iter().map(|sigma| sigma.ln()).sum::<f64>();
        let log_odds = log_posterior - problem.log_likelihood(Vector2::zeros()) + normalization;
        let probability = (1.0 + (-log_odds).exp()).recip();
        let between = mode * mode.transpose();
        let (chosen, covariance) = if probability > 0.5 {
            (mode, covariance + between * (1.0 - probability))
        } else {
            (Vector2::zeros(), (covariance + between) * probability)
        };
        let axes = covariance.symmetric_eigen();
        let deviating = (0..2).map(|axis| {
            let step = axes.eigenvectors.column(axis) * axes.eigenvalues[axis].max(0.0).sqrt();
            problem.lens(chosen + step)
        });
        Self { lens: problem.lens(chosen), deviating: deviating.collect() }
    }
}

/// Returns the expected k2 of a lens with this k1.
fn expected_k2(k1: f64) -> f64 {
    k1.min(0.0).powi(2)
}

/// Maximum a posteriori problem of k1 and k2.
struct Problem<'a> {
    segments: &'a [LineSegment],
    pinhole: Lens,
    /// Unit of the coordinates of k1 and k2, in pixels.
    half_diagonal: f64,
}

impl Problem<'_> {
    /// Returns the lens with the coefficients k1 and k2.
    fn lens(&self, k: Vector2<f64>) -> Lens {
        if k == Vector2::zeros() {
            return self.pinhole;
        }
        let brown = BrownConrady { k1: k[0], k2: k[1], ..BrownConrady::default() };
        Lens { focal: self.half_diagonal, distortion: Distortion::BrownConrady(brown), ..self.pinhole }
    }

    /// Returns, for every edge with a measured rise, the difference between measured and predicted rise and its
    /// standard deviation, in pixels.
    fn differences(&self, k: Vector2<f64>) -> Vec<[f64; 2]> {
        /// Difference of an edge outside the lens model, in pixels.
        const OUTSIDE_PX: f64 = 3.0;
        let lens = self.lens(k);
        let of = |segment: &LineSegment| {
            let rise = segment.rise?;
            let sigma = rise.sigma.hypot(SYSTEMATIC_SIGMA_PX);
            Some([predicted_rise(segment, &lens).map_or(OUTSIDE_PX, |predicted| rise.px - predicted), sigma])
        };
        self.segments.iter().filter_map(of).collect()
    }

    fn log_likelihood(&self, k: Vector2<f64>) -> f64 {
        let each = self
            .differences(k)
            .into_iter()
            .map(|[off, sigma]| densities(off, sigma).iter().sum::<f64>().ln());
        each.sum::<f64>() / EDGE_CORRELATION
    }

    /// Returns the log likelihood plus the log prior without its normalization.
    fn log_posterior(&self, k: Vector2<f64>) -> f64 {
        self.log_likelihood(k) - 0.5 * prior(k).map(|(residual, _)| residual * residual).iter().sum::<f64>()
    }

    /// Returns the coefficients at the maximum of the posterior near `start`, and the log posterior there.
    fn maximize(&self, start: Vector2<f64>) -> (Vector2<f64>, f64) {
        /// Largest number of Gauss-Newton steps.
        const MAX_STEPS: usize = 30;
        /// Largest number of halvings of a step.
        const HALVINGS: i32 = 8;
        let mut best = (start, self.log_posterior(start));
        for _ in 0..MAX_STEPS {
            let (normal, gradient) = self.normal_equations(best.0);
            let Some(step) = normal.cholesky().map(|factor| factor.solve(&gradient)) else { break };
            let shorter = (0..HALVINGS).map(|n| best.0 + step * 0.5_f64.powi(n));
            let mut tried = shorter.map(|k| (k, self.log_posterior(k)));
            let Some(better) = tried.find(|(_, value)| *value > best.1) else { break };
            let is_converged = better.1 - best.1 < 1e-6;
            best = better;
            if is_converged {
                break;
            }
        }
        best
    }

    /// Returns the covariance of the coefficients.
    fn covariance(&self, k: Vector2<f64>) -> Matrix2<f64> {
        let prior = Matrix2::from_diagonal(&Vector2::from(PRIOR_SIGMAS.map(|sigma| sigma * sigma)));
        self.normal_equations(k).0.try_inverse().unwrap_or(prior)
    }

    /// Returns the normal equations of one Gauss-Newton step. The weight of an edge follows from the probabilities
    /// that it is straight or curved in the scene.
    fn normal_equations(&self, k: Vector2<f64>) -> (Matrix2<f64>, Vector2<f64>) {
        /// Step of the finite differences.
        const STEP: f64 = 1e-5;
        let ahead = [Vector2::x(), Vector2::y()].map(|axis| self.differences(k + axis * STEP));
        let (mut normal, mut gradient) = (Matrix2::zeros(), Vector2::zeros());
        for (i, [off, sigma]) in self.differences(k).into_iter().enumerate() {
            let slope = Vector2::from([0, 1].map(|axis| (ahead[axis][i][0] - off) / STEP));
            let [straight, curved] = densities(off, sigma);
            let weight = (straight / sigma.powi(2) + curved / CURVED_SIGMA_PX.powi(2))
                / ((straight + curved).max(f64::MIN_POSITIVE) * EDGE_CORRELATION);
            normal += slope * slope.transpose() * weight;
            gradient -= slope * off * weight;
        }
        for (residual, slope) in prior(k) {
            normal += slope * slope.transpose();
            gradient -= slope * residual;
        }
        (normal, gradient)
    }
}

/// Returns the prior residuals of k1 and k2, each with its derivatives.
fn prior(k: Vector2<f64>) -> [(f64, Vector2<f64>); 2] {
    let [sigma, sigma_k2] = PRIOR_SIGMAS;
    [
        (k[0] / sigma, Vector2::new(sigma.recip(), 0.0)),
        ((k[1] - expected_k2(k[0])) / sigma_k2, Vector2::new(-2.0 * k[0].min(0.0), 1.0) / sigma_k2),
    ]
}

/// Returns the weighted densities of a difference, in pixels: of an edge that is straight in the scene, and of
/// one that is curved.
fn densities(off: f64, sigma: f64) -> [f64; 2] {
    let normal = |sigma: f64| (-0.5 * (off / sigma).powi(2)).exp() / (TAU.sqrt() * sigma);
    // A small constant keeps the logarithm finite.
    [(1.0 - CURVED_FRACTION) * normal(sigma), CURVED_FRACTION * normal(CURVED_SIGMA_PX) + 1e-9]
}

/// Returns the rise of a straight edge between the ends of a segment, in pixels; `None` outside the lens model.
fn predicted_rise(segment: &LineSegment, lens: &Lens) -> Option<f64> {
    if lens.distortion == Distortion::None {
        return Some(0.0);
    }
    let [a, b] = segment.ends;
    let (from, to) = (lens.undistort(a)?, lens.undistort(b)?);
    let middle = UndistortedPixel { u: 0.5 * (from.u + to.u), v: 0.5 * (from.v + to.v) };
    Some(rise_of_point(lens.distort(middle)?, [a, b]))
}

/// Returns the signed distance of a point from a chord, in pixels, with the sign of [`Rise`](crate::Rise).
pub(super) fn rise_of_point(at: Pixel, [a, b]: [Pixel; 2]) -> f64 {
    ((at.v - a.v) * (b.u - a.u) - (at.u - a.u) * (b.v - a.v)) / a.distance(b)
}

#[cfg(test)]
mod tests {
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::line_segment::Rise;

    const SIZE: [f64; 2] = [1920.0, 1080.0];

    fn pinhole() -> Lens {
        Lens::pinhole(Pixel::new(960.0, 540.0))
    }

    fn lens(k1: f64, k2: f64) -> Lens {
        Problem { segments: &[], pinhole: pinhole(), half_diagonal: 0.5 * SIZE[0].hypot(SIZE[1]) }
            .lens(Vector2::new(k1, k2))
    }

    /// Returns random straight edges under a lens, with the share `curved` of edges that are arcs.
    fn edges(lens: &Lens, count: usize, curved: f64) -> Vec<LineSegment> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut found = Vec::new();
        while found.len() < count {
            let middle = [random.random_range(0.0..SIZE[0]), random.random_range(0.0..SIZE[1])];
            let (angle, half) = (random.random_range(0.0..TAU), random.random_range(20.0..120.0));
            let end = |sign: f64| {
                Pixel::new(middle[0] + sign * half * angle.cos(), middle[1] + sign * half * angle.sin())
            };
            let ends = [end(-1.0), end(1.0)];
            let Some(px) = predicted_rise(&LineSegment::new(ends, 0.3), lens) else { continue };
            let noise = 0.1 * (random.random_range(-1.0..1.0_f64) + random.random_range(-1.0..1.0));
            let arc = if random.random_bool(curved) { random.random_range(-3.0..3.0) } else { 0.0 };
            found.push(LineSegment {
                rise: Some(Rise { px: px + noise + arc, sigma: 0.08 }),
                ..LineSegment::new(ends, 0.3)
            });
        }
        found
    }

    #[test]
    fn both_coefficients_follow_from_single_edges() {
        for (k1, k2) in [(-0.41, 0.11), (-0.12, 0.0), (0.06, 0.01)] {
            let found = LensEstimate::from_rises(&edges(&lens(k1, k2), 300, 0.2), pinhole(), SIZE);
            let corner = Pixel::new(100.0, 80.0);
            let [is, was] = [&found.lens, &lens(k1, k2)].map(|lens| lens.undistort(corner).unwrap());
            let off = (is.u - was.u).hypot(is.v - was.v);
            assert!(off < 8.0, "{k1} {k2}: {off} px, {:?}", found.lens.distortion);
        }
    }

    #[test]
    fn straight_edges_have_no_lens_and_few_edges_leave_it_open() {
        let straight = LensEstimate::from_rises(&edges(&pinhole(), 300, 0.2), pinhole(), SIZE);
        assert_eq!(straight.lens, pinhole());
        let open = LensEstimate::from_rises(&[], pinhole(), SIZE);
        assert_eq!(open.lens, pinhole());
        let corner = Pixel::new(100.0, 80.0);
        let moved = |estimate: &LensEstimate| {
            let each = estimate.deviating.iter().filter_map(|lens| lens.undistort(corner));
            each.map(|at| (at.u - corner.u).hypot(at.v - corner.v)).fold(0.0, f64::max)
        };
        assert!(moved(&straight) < 4.0 && moved(&open) > 40.0, "{} {}", moved(&straight), moved(&open));
    }
}
