//! One person seen by two cameras at one moment: where the cameras put them, and what movements of either would do to
//! that.
//!
//! Of cameras a and b with `p` the places of the floor, `J` their derivatives by a movement, and movements `m` that the
//! calibrations do not know of, `pa - pb = -Ja ma + Jb mb + e`, with `e` of the covariance of both feet.
//!
//! One source of evidence over time: the normal equations of every window, added up from the first on.

use std::collections::BTreeMap;

use calib_core::camera::{Camera, Movement};
use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, Vector2};

use crate::moments::{Foot, Moments};
use crate::normal_equations::NormalEquations;

/// Unknowns of a pair: the movements of both cameras.
pub(crate) const UNKNOWNS: usize = 2 * Movement::SIZE;
/// Two views of one person differ so far, in metres, beside the noise of the boxes: each shows another side.
const BODY: f64 = 0.08;
/// Walking speed, in m/s, of what is not seen at the very same time.
const SPEED: f64 = 1.2;

/// A foot on the floor.
struct OnFloor {
    at: i64,
    point: Vector2<f64>,
    covariance: Matrix2<f64>,
    slopes: SMatrix<f64, 2, { Movement::SIZE }>,
}

impl OnFloor {
    fn of(camera: &Camera, foot: &Foot) -> Option<Self> {
        let point = camera.pixel_to_floor(foot.pixel, 0.0)?;
        let slopes = camera.floor_slopes(foot.pixel)?;
        let by_pixel = Matrix2::from(slopes.by_pixel);
        let covariance = by_pixel * by_pixel.transpose() * (foot.sigma * foot.sigma);
        let slopes = SMatrix::from(Movement::slopes(camera, &slopes));
        Some(Self { at: foot.at, point: Vector2::new(point.x, point.y), covariance, slopes })
    }
}

/// The covariance of the distance between two sightings of one person.
fn spread(a: &OnFloor, b: &OnFloor) -> Matrix2<f64> {
    let moved = SPEED * (a.at - b.at) as f64 / 1e9;
    a.covariance + b.covariance + Matrix2::identity() * (BODY * BODY + moved * moved)
}

/// Pairs of sightings that are of one person: each the nearest of the other, and no third nearly as near.
fn matches(a: &[OnFloor], b: &[OnFloor]) -> Vec<[usize; 2]> {
    /// People nearer to each other than this, in metres, may be one person; so may those within so many sigmas.
    const GATE: f64 = 1.0;
    const SIGMAS: f64 = 4.0;
    /// The next one must be so many times as far.
    const CLEAR: f64 = 1.6;
    let distance = |i: usize, j: usize| (a[i].point - b[j].point).norm();
    let mut found = Vec::new();
    for i in 0..a.len() {
        let nearest = (0..b.len()).min_by(|&j, &k| distance(i, j).total_cmp(&distance(i, k)));
        let Some(j) = nearest else { continue };
        let near = distance(i, j);
        let reach = GATE + SIGMAS * spread(&a[i], &b[j]).symmetric_eigenvalues().max().max(0.0).sqrt();
        let others = (0..b.len()).filter(|&k| k != j).map(|k| distance(i, k));
        let rivals = (0..a.len()).filter(|&k| k != i).map(|k| distance(k, j));
        let is_clear = others.chain(rivals).all(|other| other > CLEAR * near);
        if near < reach && is_clear {
            found.push([i, j]);
        }
    }
    found
}

/// What one match tells of the movements of both cameras.
fn evidence(a: &OnFloor, b: &OnFloor) -> Option<NormalEquations> {
    /// Sigmas beyond which a match counts less (Huber 1964): some are of two people, or of a foot that is hidden.
    const HUBER: f64 = 2.5;
    let inverse = spread(a, b).try_inverse()?;
    let difference = a.point - b.point;
    let distance = (difference.transpose() * inverse * difference).x.max(0.0).sqrt();
    let weighted = inverse * (HUBER / distance.max(HUBER));
    let mut by = SMatrix::<f64, 2, UNKNOWNS>::zeros();
    by.fixed_columns_mut::<{ Movement::SIZE }>(0).copy_from(&-a.slopes);
    by.fixed_columns_mut::<{ Movement::SIZE }>(Movement::SIZE).copy_from(&b.slopes);
    let information = by.transpose() * weighted * by;
    let score = by.transpose() * weighted * difference;
    Some(NormalEquations {
        information: DMatrix::from_column_slice(UNKNOWNS, UNKNOWNS, information.as_slice()),
        score: DVector::from_column_slice(score.as_slice()),
    })
}

/// What the moments of a window tell of every pair of cameras, and by how many matches.
pub(crate) fn of_window(
    cameras: &[Camera],
    moments: &Moments,
) -> BTreeMap<[usize; 2], (NormalEquations, u64)> {
    let mut pairs = BTreeMap::new();
    for moment in moments.iter() {
        let mut seen: BTreeMap<usize, Vec<OnFloor>> = BTreeMap::new();
        for foot in moment {
            let on_floor = cameras.get(foot.camera).and_then(|camera| OnFloor::of(camera, foot));
            seen.entry(foot.camera).or_default().extend(on_floor);
        }
        for (&a, of_a) in &seen {
            for (&b, of_b) in seen.range(a + 1..) {
                for [i, j] in matches(of_a, of_b) {
                    let Some(one) = evidence(&of_a[i], &of_b[j]) else { continue };
                    let (sum, count) =
                        pairs.entry([a, b]).or_insert_with(|| (NormalEquations::nothing(UNKNOWNS), 0));
                    sum.add(&one);
                    *count += 1;
                }
            }
        }
    }
    pairs
}

/// One source of evidence over time.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    /// Of all windows before an index.
    before: Vec<NormalEquations>,
    /// Tracks or matches of the same.
    counts: Vec<u64>,
    /// Precisions of what stays the same: calibration and detector are off by something, but not by much.
    held: DVector<f64>,
    /// The inverse of how many times as large as claimed variances are.
    inverse_dispersion: DMatrix<f64>,
}

impl Series {
    /// Of the equations of every window, with the tracks or matches that they are of; `variance` is the true one of the
    /// score of all of them, where it is known.
    pub(crate) fn new(
        windows: &[(NormalEquations, u64)],
        held: DVector<f64>,
        variance: Option<DMatrix<f64>>,
    ) -> Self {
        let (mut before, mut counts) = (vec![NormalEquations::nothing(held.len())], vec![0]);
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
            None => of_scores(&neighbours(&seen, &held), held.len()),
        };
        let inverse_dispersion = inverse_dispersion(seen, &held, dispersion);
        Self { before, counts, held, inverse_dispersion }
    }

    /// What all windows together, up to `end`, tell of a change at the begin of a window.
    pub(crate) fn change(&self, at: usize, end: usize) -> NormalEquations {
        /// Fewer tracks or matches are no sample: one odd person would be a change.
        const LEAST: u64 = 100;
        if self.counts[at] < LEAST || self.counts[end] - self.counts[at] < LEAST {
            return NormalEquations::nothing(self.held.len());
        }
        let after = self.before[end].without(&self.before[at]);
        NormalEquations::change(&self.before[at], &after, &self.held).calibrated(&self.inverse_dispersion)
    }
}

/// What neighbouring windows differ by.
fn neighbours(windows: &[NormalEquations], held: &DVector<f64>) -> Vec<NormalEquations> {
    /// Of a degree of freedom.
    const SOME: f64 = 0.25;
    let mut pairs: Vec<(f64, NormalEquations)> = windows
        .chunks_exact(2)
        .filter_map(|pair| {
            let change = NormalEquations::change(&pair[0], &pair[1], held);
            let (chi2, freedom) = change.chi2(held)?;
            (freedom > SOME).then_some((chi2 / freedom, change))
        })
        .collect();
    // The largest is the one that a change may be in.
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    pairs.pop();
    pairs.into_iter().map(|(_, change)| change).collect()
}

/// The inverse of how many times as large as claimed variances are. People who come together, hours and days that are
/// not alike make differences of long windows larger than `dispersion` lets expect: the largest counts.
fn inverse_dispersion(
    mut windows: Vec<NormalEquations>,
    held: &DVector<f64>,
    dispersion: DMatrix<f64>,
) -> DMatrix<f64> {
    let inverse = dispersion.try_inverse().unwrap_or_else(|| DMatrix::identity(held.len(), held.len()));
    let mut largest = 1.0_f64;
    loop {
        let pairs = neighbours(&windows, held);
        if pairs.len() < LEAST {
            return inverse / largest;
        }
        let chi2 = pairs.iter().filter_map(|pair| pair.calibrated(&inverse).chi2(held));
        let (chi2, freedom) = chi2.fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
        largest = largest.max(chi2 / freedom);
        windows = joined(&windows);
    }
}

/// With `H = C C'` what scores claim, and `V` their variance, `C^-1 V C^-T`.
fn dispersion(claimed: &NormalEquations, variance: &DMatrix<f64>) -> DMatrix<f64> {
    let identity = DMatrix::identity(claimed.len(), claimed.len());
    let found = claimed.root().and_then(|root| {
        let half = root.solve_lower_triangular(variance)?;
        root.solve_lower_triangular(&half.transpose())
    });
    // Nothing is known so much better than claimed.
    found.map_or_else(|| identity.clone(), |found| found + &identity * SMALLEST)
}

/// Differences of windows that tell how far they may be believed: fewer would make it a lottery.
const LEAST: usize = 8;

/// From what neighbouring windows differ by, so that a change, which is between two of them only, does not count; drawn
/// to its mean as far as there are few of them.
fn of_scores(pairs: &[NormalEquations], unknowns: usize) -> DMatrix<f64> {
    let identity = DMatrix::identity(unknowns, unknowns);
    if pairs.len() < LEAST {
        return identity;
    }
    let mut sum = NormalEquations::nothing(unknowns);
    let mut squares = DMatrix::zeros(unknowns, unknowns);
    for pair in pairs {
        sum.add(pair);
        squares += &pair.score * pair.score.transpose();
    }
    let found = dispersion(&sum, &squares);
    let (count, few) = (pairs.len() as f64, 2.0 * unknowns as f64);
    let mean = found.trace() / unknowns as f64;
    // The inverse of what is estimated from few is too large, and the more so the fewer there are.
    (found * count + identity * (few * mean)) * (ESTIMATED / (count + few))
}

/// How much larger than estimated a variance may be.
const ESTIMATED: f64 = 1.5;
/// Of what is claimed, at least: of so much nobody can be sure.
const SMALLEST: f64 = 0.1;

/// Every two windows as one.
fn joined(windows: &[NormalEquations]) -> Vec<NormalEquations> {
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
    fn variances_larger_than_claimed_are_seen_and_a_change_is_not_taken_for_one() {
        let held = DVector::from_element(1, 1e-4);
        for (variance, step) in [(1.0, 0.0), (4.0, 0.0), (4.0, 30.0)] {
            let found =
                1.0 / Series::new(&windows(variance, step), held.clone(), None).inverse_dispersion[(0, 0)];
            assert!((0.7 * variance..2.0 * variance).contains(&found), "{found} of {variance}");
        }
    }
}
