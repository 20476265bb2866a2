//! People seen by two cameras at one moment: the difference of their floor positions, and its derivatives
//! with respect to movements of either camera.
//!
//! For cameras a and b let `pa` and `pb` be the floor positions of one person. `Ja` and `Jb` are their
//! derivatives with respect to a movement of the camera. `ma` and `mb` are the movements since the
//! calibrations. Then `pa - pb = -Ja ma + Jb mb + e`. The covariance of the noise `e` is the sum of the
//! covariances of both feet.
//!
//! The file also contains the evidence of one source over time, [`Series`]: the cumulative normal equations
//! of the windows.

use std::collections::BTreeMap;

use calib_core::camera::{Camera, PanTiltZoom};
use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, Vector2};

use crate::moments::{Foot, Moments};
use crate::normal_equations::NormalEquations;

/// Number of unknowns of a pair: the movements of both cameras.
pub(crate) const UNKNOWNS: usize = 2 * PanTiltZoom::SIZE;
/// Standard deviation of the floor position of one person between two cameras, in metres. It is added to the
/// noise of the boxes, because each camera sees another side of the person.
const BODY_SIGMA_M: f64 = 0.08;
/// Walking speed, in m/s, which bounds the motion between two detections that are not simultaneous.
const WALKING_SPEED_MPS: f64 = 1.2;

/// Position of a foot on the floor.
struct FloorFoot {
    /// Time, in nanoseconds since 1970.
    at: i64,
    /// Position on the floor, in metres.
    point: Vector2<f64>,
    /// Covariance of `point` from the noise of the pixel, in square metres.
    covariance: Matrix2<f64>,
    /// Derivatives of `point` with respect to a movement of the camera.
    slopes: SMatrix<f64, 2, { PanTiltZoom::SIZE }>,
}

impl FloorFoot {
    fn from_foot(camera: &Camera, foot: &Foot) -> Option<Self> {
        let point = camera.pixel_to_floor(foot.pixel, 0.0)?;
        let slopes = camera.floor_derivatives(foot.pixel)?;
        let by_pixel = Matrix2::from(slopes.by_pixel);
        let covariance = by_pixel * by_pixel.transpose() * (foot.sigma * foot.sigma);
        let slopes = SMatrix::from(PanTiltZoom::floor_derivatives(camera, &slopes));
        Some(Self { at: foot.at, point: Vector2::new(point.x, point.y), covariance, slopes })
    }
}

/// Returns the covariance of the difference between the floor positions of two sightings of one person, in
/// square metres.
fn difference_covariance(a: &FloorFoot, b: &FloorFoot) -> Matrix2<f64> {
    let moved = WALKING_SPEED_MPS * (a.at - b.at) as f64 / 1e9;
    a.covariance + b.covariance + Matrix2::identity() * (BODY_SIGMA_M * BODY_SIGMA_M + moved * moved)
}

/// Returns the index pairs of feet in `a` and `b` that belong to the same person. The two feet must be mutual
/// nearest neighbours, and no third foot may be nearly as close.
fn match_feet(a: &[FloorFoot], b: &[FloorFoot]) -> Vec<[usize; 2]> {
    /// Largest distance between two feet of one person, in metres, without the noise of their positions.
    const MATCH_DISTANCE_M: f64 = 1.0;
    /// Noise added to the largest distance, in standard deviations of the difference of the positions.
    const MATCH_SIGMAS: f64 = 4.0;
    /// Minimum ratio of the distance to the second nearest foot to the distance of the match.
    const MIN_DISTANCE_RATIO: f64 = 1.6;
    let distance = |i: usize, j: usize| (a[i].point - b[j].point).norm();
    let mut found = Vec::new();
    for i in 0..a.len() {
        let nearest = (0..b.len()).min_by(|&j, &k| distance(i, j).total_cmp(&distance(i, k)));
        let Some(j) = nearest else { continue };
        let near = distance(i, j);
        let reach = MATCH_DISTANCE_M
            + MATCH_SIGMAS
                * difference_covariance(&a[i], &b[j]).symmetric_eigenvalues().max().max(0.0).sqrt();
        let others = (0..b.len()).filter(|&k| k != j).map(|k| distance(i, k));
        let rivals = (0..a.len()).filter(|&k| k != i).map(|k| distance(k, j));
        let is_clear = others.chain(rivals).all(|other| other > MIN_DISTANCE_RATIO * near);
        if near < reach && is_clear {
            found.push([i, j]);
        }
    }
    found
}

/// Returns the evidence of one match about the movements of both cameras.
fn evidence(a: &FloorFoot, b: &FloorFoot) -> Option<NormalEquations> {
    /// Distance of a match, in standard deviations, above which its weight decreases (Huber 1964). Some
    /// matches are of two people, or of a hidden foot.
    const HUBER_LIMIT_SIGMAS: f64 = 2.5;
    let inverse = difference_covariance(a, b).try_inverse()?;
    let difference = a.point - b.point;
    let distance = (difference.transpose() * inverse * difference).x.max(0.0).sqrt();
    let weighted = inverse * (HUBER_LIMIT_SIGMAS / distance.max(HUBER_LIMIT_SIGMAS));
    let mut by = SMatrix::<f64, 2, UNKNOWNS>::zeros();
    by.fixed_columns_mut::<{ PanTiltZoom::SIZE }>(0).copy_from(&-a.slopes);
    by.fixed_columns_mut::<{ PanTiltZoom::SIZE }>(PanTiltZoom::SIZE).copy_from(&b.slopes);
    let information = by.transpose() * weighted * by;
    let score = by.transpose() * weighted * difference;
    Some(NormalEquations {
        information: DMatrix::from_column_slice(UNKNOWNS, UNKNOWNS, information.as_slice()),
        score: DVector::from_column_slice(score.as_slice()),
    })
}

/// Returns the evidence of the moments of a window for every pair of cameras, and the number of matches.
pub(crate) fn window_evidence(
    cameras: &[Camera],
    moments: &Moments,
) -> BTreeMap<[usize; 2], (NormalEquations, u64)> {
    let mut pairs = BTreeMap::new();
    for moment in moments.iter() {
        let mut seen: BTreeMap<usize, Vec<FloorFoot>> = BTreeMap::new();
        for foot in moment {
            let on_floor = cameras.get(foot.camera).and_then(|camera| FloorFoot::from_foot(camera, foot));
            seen.entry(foot.camera).or_default().extend(on_floor);
        }
        for (&a, of_a) in &seen {
            for (&b, of_b) in seen.range(a + 1..) {
                for [i, j] in match_feet(of_a, of_b) {
                    let Some(one) = evidence(&of_a[i], &of_b[j]) else { continue };
                    let (sum, count) =
                        pairs.entry([a, b]).or_insert_with(|| (NormalEquations::zeros(UNKNOWNS), 0));
                    sum.add(&one);
                    *count += 1;
                }
            }
        }
    }
    pairs
}

/// Evidence of one source over time: the heights at one camera, or the matches of one pair of cameras.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    /// Sum of the normal equations of all windows before each index.
    before: Vec<NormalEquations>,
    /// Number of tracks or matches in all windows before each index.
    counts: Vec<u64>,
    /// Prior precisions (inverse variances) of the constant errors of calibration and detector.
    prior_precisions: DVector<f64>,
    /// Inverse of the dispersion, the ratio of the true to the claimed variance of the score.
    inverse_dispersion: DMatrix<f64>,
}

impl Series {
    /// Creates a series from the normal equations of every window and its number of tracks or matches.
    /// `variance` is the true variance of the score of all windows. With `None` it is estimated from the
    /// differences of neighbouring windows.
    pub(crate) fn new(
        windows: &[(NormalEquations, u64)],
        prior_precisions: DVector<f64>,
        variance: Option<DMatrix<f64>>,
    ) -> Self {
        let (mut before, mut counts) = (vec![NormalEquations::zeros(prior_precisions.len())], vec![0]);
        for (window, count) in windows {
            let mut sum = before[before.len() - 1].clone();
            sum.add(window);
            before.push(sum);
            counts.push(counts[counts.len() - 1] + count);
        }
        let seen = windows.iter().filter(|(_, count)| *count > 0).map(|(window, _)| window.clone());
        let seen: Vec<NormalEquations> = seen.collect();
        let dispersion = match variance {
            Some(variance) => dispersion(&before[windows.len()], &variance),
            None => {
                empirical_dispersion(&neighbour_changes(&seen, &prior_precisions), prior_precisions.len())
            }
        };
        let inverse_dispersion = inverse_dispersion(seen, &prior_precisions, dispersion);
        Self { before, counts, prior_precisions, inverse_dispersion }
    }

    /// Returns the evidence of all windows before index `end` about a change at the start of window `at`. The
    /// evidence is zero if too few samples precede or follow the change.
    pub(crate) fn change(&self, at: usize, end: usize) -> NormalEquations {
        /// Smallest number of tracks or matches before and after a change. With fewer, a single outlier would
        /// look like a change.
        const MIN_SAMPLES: u64 = 100;
        if self.counts[at] < MIN_SAMPLES || self.counts[end] - self.counts[at] < MIN_SAMPLES {
            return NormalEquations::zeros(self.prior_precisions.len());
        }
        let after = self.before[end].minus(&self.before[at]);
        NormalEquations::change(&self.before[at], &after, &self.prior_precisions)
            .rescaled(&self.inverse_dispersion)
    }
}

/// Returns the evidence about the change between the two windows of each neighbouring pair. The pair with the
/// most significant change is dropped.
fn neighbour_changes(windows: &[NormalEquations], prior_precisions: &DVector<f64>) -> Vec<NormalEquations> {
    /// Minimum effective degrees of freedom of a change between two windows.
    const MIN_FREEDOM: f64 = 0.25;
    let mut pairs: Vec<(f64, NormalEquations)> = windows
        .chunks_exact(2)
        .filter_map(|pair| {
            let change = NormalEquations::change(&pair[0], &pair[1], prior_precisions);
            let (chi2, freedom) = change.chi2(prior_precisions)?;
            (freedom > MIN_FREEDOM).then_some((chi2 / freedom, change))
        })
        .collect();
    // The most significant difference may be a true change of the camera.
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    pairs.pop();
    pairs.into_iter().map(|(_, change)| change).collect()
}

/// Returns the inverse of the dispersion, enlarged for long windows. Groups of people, and differences
/// between hours and days, make the differences of long windows larger than `dispersion` predicts. The
/// dispersion is multiplied by the largest chi-square per degree of freedom over all window lengths.
fn inverse_dispersion(
    mut windows: Vec<NormalEquations>,
    prior_precisions: &DVector<f64>,
    dispersion: DMatrix<f64>,
) -> DMatrix<f64> {
    let inverse = dispersion
        .try_inverse()
        .unwrap_or_else(|| DMatrix::identity(prior_precisions.len(), prior_precisions.len()));
    let mut largest = 1.0_f64;
    loop {
        let pairs = neighbour_changes(&windows, prior_precisions);
        if pairs.len() < MIN_CHANGES {
            return inverse / largest;
        }
        let chi2 = pairs.iter().filter_map(|pair| pair.rescaled(&inverse).chi2(prior_precisions));
        let (chi2, freedom) = chi2.fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
        largest = largest.max(chi2 / freedom);
        windows = merge_pairs(&windows);
    }
}

/// Returns the dispersion, the ratio of the true to the claimed variance of the score: `C^-1 V C^-T`, with
/// `H = C C'` the claimed information and `V` the true variance.
fn dispersion(claimed: &NormalEquations, variance: &DMatrix<f64>) -> DMatrix<f64> {
    let identity = DMatrix::identity(claimed.len(), claimed.len());
    let found = claimed.root().and_then(|root| {
        let half = root.solve_lower_triangular(variance)?;
        root.solve_lower_triangular(&half.transpose())
    });
    // The added term prevents an estimate much smaller than the claimed variance.
    found.map_or_else(|| identity.clone(), |found| found + &identity * MIN_DISPERSION)
}

/// Smallest number of window differences for an estimate of the dispersion.
const MIN_CHANGES: usize = 8;

/// Estimates the dispersion from the differences of neighbouring windows. A change of the camera affects only
/// one difference. With few differences, the estimate is shrunk towards its mean.
fn empirical_dispersion(pairs: &[NormalEquations], unknowns: usize) -> DMatrix<f64> {
    let identity = DMatrix::identity(unknowns, unknowns);
    if pairs.len() < MIN_CHANGES {
        return identity;
    }
    let mut sum = NormalEquations::zeros(unknowns);
    let mut squares = DMatrix::zeros(unknowns, unknowns);
    for pair in pairs {
        sum.add(pair);
        squares += &pair.score * pair.score.transpose();
    }
    let found = dispersion(&sum, &squares);
    let (count, few) = (pairs.len() as f64, 2.0 * unknowns as f64);
    let mean = found.trace() / unknowns as f64;
    // The inverse of an estimate from few samples is biased upwards.
    (found * count + identity * (few * mean)) * (VARIANCE_SAFETY_FACTOR / (count + few))
}

/// Safety factor on the dispersion estimated from window differences.
const VARIANCE_SAFETY_FACTOR: f64 = 1.5;
/// Dispersion added to every estimate: the minimum ratio of true to claimed variance.
const MIN_DISPERSION: f64 = 0.1;

/// Merges every two consecutive windows into one.
fn merge_pairs(windows: &[NormalEquations]) -> Vec<NormalEquations> {
    let whole = |pair: &[NormalEquations]| {
        let mut whole = pair[0].clone();
        pair.iter().skip(1).for_each(|more| whole.add(more));
        whole
    };
    windows.chunks(2).map(whole).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows(variance: f64, step: f64) -> Vec<(NormalEquations, u64)> {
        let mut noise = crate::tests::Noise::new(5);
        let window = |index: usize| {
            let mean = variance.sqrt() * noise.normal() + if index < 60 { 0.0 } else { step };
            let information = DMatrix::from_element(1, 1, 1.0);
            (NormalEquations { information, score: DVector::from_element(1, mean) }, 1)
        };
        (0..128).map(window).collect()
    }

    #[test]
    fn dispersion_is_estimated_and_not_affected_by_a_change() {
        let prior_precisions = DVector::from_element(1, 1e-4);
        for (variance, step) in [(1.0, 0.0), (4.0, 0.0), (4.0, 30.0)] {
            let found = 1.0
                / Series::new(&windows(variance, step), prior_precisions.clone(), None).inverse_dispersion
                    [(0, 0)];
            assert!((0.7 * variance..2.0 * variance).contains(&found), "{found} of {variance}");
        }
    }
}
