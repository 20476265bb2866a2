//! Search for camera hypotheses: vanishing points with many supporting edges, and the cameras that they allow.
//!
//! # Vanishing points
//!
//! Every pair of long edges yields a candidate point, which is tested on all edges (Fischler and Bolles 1981,
//! with all pairs instead of random ones). The score of a point is the sum of `log(1 - e + e odds)`: the log
//! likelihood of a mixture with the fraction `e` of the edges leading to it. After the selection of the best
//! point, every edge is weighted by the probability that it does not lead to this point. The search is then
//! repeated.
//!
//! # Cameras
//!
//! Each point in turn is assumed to be the vertical vanishing point. The tested focal lengths cover the range
//! `focal_range`. They also include the focal lengths with which the directions of two points are at right
//! angles. For every camera, the floor directions are searched in the same way, among the azimuths of the
//! intersections of long edges with the horizon.

use calib_core::Orientation;

use super::frame::{Point, azimuth, level, nadir, with_nadir};
use super::join::Line;
use super::mixture::CameraPrior;

/// Largest number of edges that are used, the longest first.
const MAX_EDGES: usize = 250;
/// Number of longest edges whose pairs generate candidates for vanishing points.
const POINT_GENERATOR_EDGES: usize = 70;
/// Number of longest edges that generate candidates for floor directions.
const DIRECTION_GENERATOR_EDGES: usize = 50;
/// Largest number of vanishing points.
const MAX_POINTS: usize = 8;
/// Prior fraction of the edges that lead to one vanishing point.
const MEMBER_FRACTION: f64 = 0.1;
/// Smallest score of a vanishing point. Random edges have smaller scores, even with thousands of candidates.
const MIN_SCORE: f64 = 6.0;
/// Smallest and largest horizontal field of view, in degrees.
const FIELD_OF_VIEW_RANGE_DEG: [f64; 2] = [18.0, 125.0];
/// Number of tested focal lengths between both limits of the field of view.
const FOCAL_COUNT: usize = 20;
/// Largest number of floor directions of a camera.
const MAX_DIRECTIONS: usize = 3;
/// Sine of the smallest angle between two floor directions.
const MIN_DIRECTION_SINE: f64 = 0.1;
/// Largest number of cameras that are refined.
const MAX_CAMERAS: usize = 8;

/// Camera orientation with its floor directions and their score.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    pub(super) camera: Orientation,
    /// Azimuths of the floor directions, in radians counter-clockwise from the camera's right.
    pub(super) azimuths: Vec<f64>,
    /// Log likelihood of the edges plus log prior density of the camera, minus [`MIN_SCORE`] for each floor direction.
    score: f64,
}

/// Evidence of all edges for one candidate vanishing point.
struct Candidate {
    /// Odds of each edge for the candidate.
    odds: Vec<f64>,
    /// Gain in log likelihood by each edge.
    gains: Vec<f64>,
}

impl Candidate {
    fn new(odds: impl Iterator<Item = f64>) -> Self {
        let odds: Vec<f64> = odds.collect();
        // Most edges do not lead to the candidate. Their logarithm is computed only once, because it is slow.
        let nothing = (1.0 - MEMBER_FRACTION).ln();
        let gain = |&odds: &f64| {
            if odds > 0.0 { (1.0 - MEMBER_FRACTION + MEMBER_FRACTION * odds).ln() } else { nothing }
        };
        let gains = odds.iter().map(gain).collect();
        Self { odds, gains }
    }

    /// Returns the score of the candidate, with the gain of each edge weighted by `left`.
    fn score(&self, left: &[f64]) -> f64 {
        self.gains.iter().zip(left).map(|(gain, left)| gain * left).sum()
    }

    /// Reduces the weights `left` of the edges that lead to this candidate.
    fn remove_from(&self, left: &mut [f64]) {
        left.iter_mut().zip(&self.odds).for_each(|(left, &odds)| *left *= non_member_probability(odds));
    }
}

/// Returns the probability that an edge with these odds does not lead to the candidate.
fn non_member_probability(odds: f64) -> f64 {
    (1.0 - MEMBER_FRACTION) / (1.0 - MEMBER_FRACTION + MEMBER_FRACTION * odds)
}

/// Returns cameras that explain many edges, the best first. `lines` must be sorted by length, the longest
/// first. `width` is the width of the image, in pixels.
pub(super) fn hypotheses(lines: &[Line], width: f64, prior: &CameraPrior) -> Vec<Hypothesis> {
    let lines = &lines[..lines.len().min(MAX_EDGES)];
    let cameras = candidate_cameras(&vanishing_points(lines), focal_range(width, prior));
    let mut found: Vec<Hypothesis> =
        cameras.into_iter().map(|camera| with_directions(lines, camera, prior)).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Hypothesis> = Vec::new();
    for hypothesis in found {
        if kept.len() < MAX_CAMERAS
            && kept.iter().all(|other| are_distinct(&hypothesis.camera, &other.camera))
        {
            kept.push(hypothesis);
        }
    }
    kept
}

/// Whether two cameras differ enough for both to be refined.
fn are_distinct(a: &Orientation, b: &Orientation) -> bool {
    let apart = [(a.focal / b.focal).ln() / 0.15, (a.roll - b.roll) / 0.05, (a.pitch - b.pitch) / 0.08];
    apart.iter().any(|apart| apart.abs() > 1.0)
}

/// Returns the vanishing points of the image, the best of every round first.
///
/// The joints of a tiled floor can be the longest edges of an image. Therefore the search is repeated on the
/// edges that lead to none of the points, until no point is found.
fn vanishing_points(lines: &[Line]) -> Vec<Point> {
    let mut points: Vec<Point> = Vec::new();
    let mut left = vec![1.0; lines.len()];
    loop {
        let is_left = |(_, left): &(&Line, &f64)| **left > 0.5;
        let first = lines.iter().zip(&left).filter(is_left).map(|(line, _)| line).take(POINT_GENERATOR_EDGES);
        let proposed = intersections(&first.collect::<Vec<_>>());
        let candidates: Vec<Candidate> =
            proposed.iter().map(|&point| Candidate::new(lines.iter().map(|line| line.odds(point)))).collect();
        let most = MAX_POINTS.saturating_sub(points.len());
        let chosen = select_greedily(&candidates, left.clone(), most, |_, _| true);
        if chosen.is_empty() {
            return points;
        }
        for (index, _) in chosen {
            candidates[index].remove_from(&mut left);
            points.push(proposed[index]);
        }
    }
}

/// Returns the intersections of all pairs of lines, except of identical lines.
fn intersections(lines: &[&Line]) -> Vec<Point> {
    let pairs = lines.iter().enumerate().flat_map(|(i, a)| lines[..i].iter().map(move |b| (a, b)));
    pairs
        .map(|(a, b)| cross(a.through, b.through))
        .filter(|point| point.iter().any(|c| c.abs() > 1e-9))
        .collect()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Selects at most `most` candidates, each time the best candidate for the remaining edges. `left` contains
/// the weights of the edges, and `are_compatible` determines whether two candidates are compatible. Returns
/// indices and scores.
fn select_greedily(
    candidates: &[Candidate],
    mut left: Vec<f64>,
    most: usize,
    are_compatible: impl Fn(usize, usize) -> bool,
) -> Vec<(usize, f64)> {
    let mut chosen: Vec<(usize, f64)> = Vec::new();
    while chosen.len() < most {
        let is_free = |i: &usize| chosen.iter().all(|&(other, _)| are_compatible(*i, other));
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

/// Returns the smallest and the largest focal length to test, in pixels. They follow from the entered focal length and
/// its standard deviation. Without an entry, they follow from the smallest and largest usual field of view. `width` is
/// the width of the image, in pixels.
fn focal_range(width: f64, prior: &CameraPrior) -> [f64; 2] {
    prior.focal_range().unwrap_or_else(|| {
        let [narrow, wide] =
            FIELD_OF_VIEW_RANGE_DEG.map(|field| 0.5 * width / (0.5 * field.to_radians()).tan());
        [wide, narrow]
    })
}

/// Returns the plausible cameras that have one of the vanishing points as the vertical, with focal lengths in this
/// range, in pixels.
fn candidate_cameras(points: &[Point], [shortest, longest]: [f64; 2]) -> Vec<Orientation> {
    let step = (shortest / longest).powf(((FOCAL_COUNT - 1) as f64).recip());
    let mut focals: Vec<f64> = (0..FOCAL_COUNT).map(|i| longest * step.powi(i as i32)).collect();
    for (i, a) in points.iter().enumerate() {
        // The rays to both points are at right angles: `a . b + f^2 aw bw = 0`.
        let squares = points[..i].iter().map(|b| -(a[0] * b[0] + a[1] * b[1]) / (a[2] * b[2]));
        focals.extend(squares.filter(|square| *square > 0.0).map(f64::sqrt));
    }
    focals.retain(|focal| (shortest * 0.99..=longest * 1.01).contains(focal));
    let all = points.iter().flat_map(|&point| focals.iter().map(move |&focal| with_nadir(point, focal)));
    all.filter(is_plausible).collect()
}

/// Whether the roll and pitch of a camera are plausible. With more roll, a floor direction was probably
/// mistaken for the vertical.
fn is_plausible(camera: &Orientation) -> bool {
    /// Largest plausible roll, in radians.
    const MAX_ROLL_RAD: f64 = 0.7;
    /// Largest plausible upward pitch, in radians.
    const MAX_UPWARD_PITCH_RAD: f64 = 0.7;
    camera.roll.abs() < MAX_ROLL_RAD && camera.pitch > -MAX_UPWARD_PITCH_RAD
}

/// Returns a camera with the floor directions that explain the most edges.
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
        .take(DIRECTION_GENERATOR_EDGES)
        .map(|(line, _)| azimuth(&camera, line.through))
        .collect();
    let candidate = |&azimuth: &f64| {
        let point = level(&camera, azimuth);
        Candidate::new(lines.iter().map(|line| line.odds(point)))
    };
    let candidates: Vec<Candidate> = azimuths.iter().map(candidate).collect();
    let apart = |i: usize, j: usize| (azimuths[i] - azimuths[j]).sin().abs() > MIN_DIRECTION_SINE;
    let chosen = select_greedily(&candidates, left, MAX_DIRECTIONS, apart);
    let of_directions: f64 = chosen.iter().map(|(_, score)| score - MIN_SCORE).sum();
    Hypothesis {
        camera,
        azimuths: chosen.iter().map(|&(index, _)| azimuths[index]).collect(),
        score: of_verticals + of_directions + prior.log_density(&camera),
    }
}
