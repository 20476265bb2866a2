//! Search for camera hypotheses: vanishing points with many supporting edges, the cameras that they allow,
//! and the distortion.
//!
//! # Vanishing points
//!
//! Every pair of long edges yields a candidate point, which is tested on all edges (Fischler and Bolles 1981,
//! with all pairs instead of random ones). The score of a point is the sum of `log(1 - e + e odds)`: the log
//! likelihood of a mixture with the fraction `e` of the edges leading to it. After the best point is taken,
//! every edge is weighted by the probability that it does not lead there. The search is then repeated.
//!
//! # Cameras
//!
//! Each point in turn is assumed to be the vertical vanishing point. Its focal lengths are a fixed range, and
//! the focal lengths that put two of the points at right angles. For every camera, the floor directions are
//! searched in the same way, among the azimuths of the intersections of long edges with the horizon.
//!
//! # Distortion
//!
//! Distortion rotates every edge by an amount that depends on its position. With the correct distortion, more
//! edges lead to common points. One parameter is searched: k1, with coordinates divided by half the image
//! diagonal. For barrel distortion k2 is the square of k1, as in usual lenses (`single/lens_prior.rs` of the
//! core). The suggested annotations contain inner points, from which the solver fits as many coefficients as
//! they support.

use calib_core::{BrownConrady, Distortion, Lens, Orientation, Pixel};

use super::frame::{Point, azimuth, level, nadir, with_nadir};
use super::join::Line;
use super::mixture::CameraPrior;

/// Number of longest edges that are used.
const MAX_EDGES: usize = 250;
/// Numbers of longest edges that generate vanishing points, and floor directions.
const PROPOSERS: [usize; 2] = [70, 50];
/// Largest number of vanishing points.
const MAX_POINTS: usize = 8;
/// Prior fraction of the edges that lead to one point.
const SHARE: f64 = 0.1;
/// Smallest score of a point; chance reaches less, even with thousands of candidates.
const MIN_SCORE: f64 = 6.0;
/// Smallest and largest horizontal field of view, in degrees, and the number of focal lengths between them.
const FIELDS: [f64; 2] = [18.0, 125.0];
const FOCALS: usize = 20;
/// Largest number of floor directions of a camera, and the sine of the smallest angle between them.
const DIRECTIONS: usize = 3;
const MIN_DIRECTION_SINE: f64 = 0.1;
/// Largest number of cameras to refine.
const MAX_CAMERAS: usize = 8;

/// Camera with the azimuths of its floor directions.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    pub(super) camera: Orientation,
    pub(super) azimuths: Vec<f64>,
    score: f64,
}

/// Evidence of all edges for one candidate.
struct Candidate {
    odds: Vec<f64>,
    gains: Vec<f64>,
}

impl Candidate {
    fn new(odds: impl Iterator<Item = f64>) -> Self {
        let odds: Vec<f64> = odds.collect();
        // Most edges do not lead there, and a logarithm is slow.
        let nothing = (1.0 - SHARE).ln();
        let gain = |&odds: &f64| if odds > 0.0 { (1.0 - SHARE + SHARE * odds).ln() } else { nothing };
        let gains = odds.iter().map(gain).collect();
        Self { odds, gains }
    }

    fn score(&self, left: &[f64]) -> f64 {
        self.gains.iter().zip(left).map(|(gain, left)| gain * left).sum()
    }

    /// Reduces the weights of the edges that lead to this candidate.
    fn remove_from(&self, left: &mut [f64]) {
        left.iter_mut().zip(&self.odds).for_each(|(left, &odds)| *left *= remainder(odds));
    }
}

/// Returns the probability that an edge with these odds does not lead to the candidate.
fn remainder(odds: f64) -> f64 {
    (1.0 - SHARE) / (1.0 - SHARE + SHARE * odds)
}

/// Returns cameras that explain many edges, the best first. `lines` must be sorted by length, the longest
/// first.
pub(super) fn hypotheses(lines: &[Line], width: f64, prior: &CameraPrior) -> Vec<Hypothesis> {
    let lines = &lines[..lines.len().min(MAX_EDGES)];
    let points: Vec<Point> = vanishing_points(lines).into_iter().map(|(point, _)| point).collect();
    let cameras = cameras(&points, width);
    let mut found: Vec<Hypothesis> =
        cameras.into_iter().map(|camera| with_directions(lines, camera, prior)).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Hypothesis> = Vec::new();
    for hypothesis in found {
        if kept.len() < MAX_CAMERAS && kept.iter().all(|other| is_other(&hypothesis.camera, &other.camera)) {
            kept.push(hypothesis);
        }
    }
    kept
}

/// Whether two cameras differ enough for both to be refined.
fn is_other(a: &Orientation, b: &Orientation) -> bool {
    let apart = [(a.focal / b.focal).ln() / 0.15, (a.roll - b.roll) / 0.05, (a.pitch - b.pitch) / 0.08];
    apart.iter().any(|apart| apart.abs() > 1.0)
}

/// Returns the total score of the best vanishing points, for any camera: a measure of how well the edges
/// concur.
pub(super) fn concurrence(lines: &[Line]) -> f64 {
    vanishing_points(&lines[..lines.len().min(MAX_EDGES)]).iter().map(|(_, score)| score).sum()
}

/// Returns the vanishing points of the image with their scores, the best first.
fn vanishing_points(lines: &[Line]) -> Vec<(Point, f64)> {
    let first = &lines[..lines.len().min(PROPOSERS[0])];
    let pairs = first.iter().enumerate().flat_map(|(i, a)| first[..i].iter().map(move |b| (a, b)));
    let proposed: Vec<Point> = pairs
        .map(|(a, b)| cross(a.through, b.through))
        .filter(|point| point.iter().any(|c| c.abs() > 1e-9))
        .collect();
    let candidates: Vec<Candidate> =
        proposed.iter().map(|&point| Candidate::new(lines.iter().map(|line| line.odds(point)))).collect();
    let chosen = greedy(&candidates, vec![1.0; lines.len()], MAX_POINTS, |_, _| true);
    chosen.into_iter().map(|(index, score)| (proposed[index], score)).collect()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Selects candidates one after the other, each time the best for the remaining edges; returns indices and
/// scores.
fn greedy(
    candidates: &[Candidate],
    mut left: Vec<f64>,
    most: usize,
    may_both: impl Fn(usize, usize) -> bool,
) -> Vec<(usize, f64)> {
    let mut chosen: Vec<(usize, f64)> = Vec::new();
    while chosen.len() < most {
        let is_free = |i: &usize| chosen.iter().all(|&(other, _)| may_both(*i, other));
        let scores = (0..candidates.len()).filter(is_free).map(|i| (i, candidates[i].score(&left)));
        let Some((best, score)) = scores.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if score < MIN_SCORE {
            break;
        }
        candidates[best].remove_from(&mut left);
        chosen.push((best, score));
    }
    chosen
}

/// Returns the cameras that the vanishing points allow.
fn cameras(points: &[Point], width: f64) -> Vec<Orientation> {
    let [narrow, wide] = FIELDS.map(|field| 0.5 * width / (0.5 * field.to_radians()).tan());
    let step = (wide / narrow).powf(((FOCALS - 1) as f64).recip());
    let mut focals: Vec<f64> = (0..FOCALS).map(|i| narrow * step.powi(i as i32)).collect();
    for (i, a) in points.iter().enumerate() {
        // The rays to both are at right angles: `a . b + f^2 aw bw = 0`.
        let squares = points[..i].iter().map(|b| -(a[0] * b[0] + a[1] * b[1]) / (a[2] * b[2]));
        focals.extend(squares.filter(|square| *square > 0.0).map(f64::sqrt));
    }
    focals.retain(|focal| (wide * 0.99..=narrow * 1.01).contains(focal));
    let all = points.iter().flat_map(|&point| focals.iter().map(move |&focal| with_nadir(point, focal)));
    all.filter(is_plausible).collect()
}

/// Whether the roll and pitch of a camera are plausible. With more roll, a floor direction was probably
/// mistaken for the vertical.
fn is_plausible(camera: &Orientation) -> bool {
    const ROLL: f64 = 0.7;
    const UP: f64 = 0.7;
    camera.roll.abs() < ROLL && camera.pitch > -UP
}

/// Finds the floor directions under a camera that explain the most edges.
fn with_directions(lines: &[Line], camera: Orientation, prior: &CameraPrior) -> Hypothesis {
    let down = nadir(&camera);
    let vertical = Candidate::new(lines.iter().map(|line| line.odds(down)));
    let mut left = vec![1.0; lines.len()];
    let of_verticals = vertical.score(&left);
    vertical.remove_from(&mut left);
    let azimuths: Vec<f64> = lines
        .iter()
        .zip(&left)
        .filter(|(_, left)| **left > 0.5)
        .take(PROPOSERS[1])
        .map(|(line, _)| azimuth(&camera, line.through))
        .collect();
    let candidate = |&azimuth: &f64| {
        let point = level(&camera, azimuth);
        Candidate::new(lines.iter().map(|line| line.odds(point)))
    };
    let candidates: Vec<Candidate> = azimuths.iter().map(candidate).collect();
    let apart = |i: usize, j: usize| (azimuths[i] - azimuths[j]).sin().abs() > MIN_DIRECTION_SINE;
    let chosen = greedy(&candidates, left, DIRECTIONS, apart);
    let of_directions: f64 = chosen.iter().map(|(_, score)| score - MIN_SCORE).sum();
    Hypothesis {
        camera,
        azimuths: chosen.iter().map(|&(index, _)| azimuths[index]).collect(),
        score: of_verticals + of_directions + prior.log_density(&camera),
    }
}

/// Standard deviation of k1 among lenses.
const K1_PRIOR_SIGMA: f64 = 0.2;
/// Coarse candidates for k1; zero (no distortion) comes first.
pub(super) const K1_CANDIDATES: [f64; 4] = [0.0, -0.08, -0.16, -0.26];
/// Smallest rise of the log evidence for distortion to be accepted.
pub(super) const MIN_EVIDENCE_GAIN: f64 = 6.0;
/// Number of times the step is halved.
const HALVINGS: usize = 3;

/// Returns the lens with this k1.
pub(super) fn lens(k1: f64, principal_point: Pixel, size: [f64; 2]) -> Lens {
    if k1 == 0.0 {
        return Lens::pinhole(principal_point);
    }
    let brown = BrownConrady { k1, k2: k1.min(0.0).powi(2), ..BrownConrady::default() };
    Lens {
        principal_point,
        focal: 0.5 * size[0].hypot(size[1]),
        distortion: Distortion::BrownConrady(brown),
        image_circle: None,
    }
}

/// Returns the log prior density of k1, up to a constant.
pub(super) fn log_density(k1: f64) -> f64 {
    -0.5 * (k1 / K1_PRIOR_SIGMA).powi(2)
}

/// Refines the best coarse k1 by repeatedly halving the step. `score` returns `None` if the score is
/// undefined.
pub(super) fn refine_k1(mut best: (f64, f64), mut score: impl FnMut(f64) -> Option<f64>) -> (f64, f64) {
    let mut step = 0.5 * (K1_CANDIDATES[1] - K1_CANDIDATES[0]).abs();
    for _ in 0..HALVINGS {
        for k1 in [best.0 - step, best.0 + step] {
            if let Some(found) = score(k1).filter(|found| *found > best.1) {
                best = (k1, found);
            }
        }
        step *= 0.5;
    }
    best
}
