//! Local minima of the likelihood: starts from closed forms and a coarse grid, distinct solutions, and the
//! weak prior on the focal length.

use crate::camera::Chart;
use crate::floor::STAGE_1_HEIGHT;
use crate::optimize::{Summary, Uncertainty, least_squares, least_squares_unless};
use crate::single::constraints::Direction;
use crate::single::likelihood::{Problem, State};
use crate::single::parameters::FixedParameters;
use crate::single::parameters::Prior;
use crate::single::residual::{LOG_FOCAL, PITCH, Parameters, ROLL};
use crate::single::size_residual::CameraTerms;
use crate::single::vanishing_point::{roll_from_verticals, vanishing_point};

/// Horizontal fields of view of the start values of the focal length, in degrees.
const START_FIELDS_OF_VIEW_DEG: [f64; 10] = [14.0, 22.0, 33.0, 45.0, 58.0, 72.0, 88.0, 104.0, 122.0, 140.0];
/// Start values of the pitch, in degrees, if the verticals do not relate pitch to focal length.
const START_PITCHES_DEG: [f64; 7] = [0.0, 8.0, 20.0, 35.0, 50.0, 68.0, 86.0];
/// Focal length of usual cameras, in image widths.
pub(crate) const USUAL_FOCAL_PER_WIDTH: f64 = 0.8;
/// Standard deviation of the log focal length above which the constraints do not determine the focal length.
pub const MAX_LOG_FOCAL_SIGMA: f64 = 0.2;
/// Standard deviation of the log focal length above which the weak prior is added: it then has at least a
/// twelfth of the information of the constraints.
pub(crate) const MIN_LOG_FOCAL_SIGMA_FOR_PRIOR: f64 = 0.1;
/// Minimum difference in chi-square that rules out the worse of two cameras.
pub const MIN_CHI2_DIFFERENCE: f64 = 6.0;
/// Maximum number of accepted steps of a run. Near a minimum convergence is quadratic. If the cost is flat in
/// the focal length, the weak prior determines the focal length.
const MAX_STEPS: usize = 60;

/// Returns the weak prior on the log of the focal length in pixels, for an image of this width: installed
/// cameras have a focal length of about 0.8 image widths, within a factor of 1.4.
#[must_use]
pub fn weak_prior(width: f64) -> Prior {
    Prior { value: (USUAL_FOCAL_PER_WIDTH * width).ln(), sigma: 0.35 }
}

/// Minimum of the likelihood.
#[derive(Clone, Debug)]
pub(crate) struct Minimum {
    pub(crate) state: State,
    /// Chi-square: sum of the squared residuals, in standard deviations.
    pub(crate) chi2: f64,
    pub(crate) uncertainty: Uncertainty,
}

/// Returns every distinct minimum found, the lowest first; empty if no start is possible.
pub(crate) fn minima(problem: &Problem, fixed: FixedParameters) -> Vec<Minimum> {
    minima_including(Vec::new(), problem, fixed)
}

/// Returns the known minima and all other minima that are found, the lowest first.
pub(crate) fn minima_including(
    known: Vec<Minimum>,
    problem: &Problem,
    fixed: FixedParameters,
) -> Vec<Minimum> {
    let mut found = known;
    let vanishing = vanishing_point(problem.lines().filter(|line| line.direction == Direction::Vertical));
    for roll in start_rolls(problem, fixed, vanishing) {
        for start in starts(problem, fixed, roll, vanishing) {
            found = with_minimum_from(start, problem, found);
        }
        if !found.is_empty() {
            break;
        }
    }
    let turned: Vec<State> = found.iter().filter_map(|minimum| opposite_start(minimum, problem)).collect();
    for start in turned {
        found = with_minimum_from(start, problem, found);
    }
    found.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    without_vague(found, problem)
}

/// Removes minima that fit the heads of uprights only because the uncertainty of the predicted heads is large.
///
/// The likelihood contains the log determinant of the covariance of the predicted heads, in addition to the
/// chi-square. The differences of the determinant between usual cameras are negligible. A camera at the
/// height of the heads predicts them so vaguely that its chi-square is 0.
fn without_vague(mut found: Vec<Minimum>, problem: &Problem) -> Vec<Minimum> {
    if problem.uprights().next().is_none() || found.len() < 2 {
        return found;
    }
    let of_all: Vec<(f64, f64)> =
        found.iter().map(|minimum| (minimum.chi2, log_spread(&minimum.state, problem))).collect();
    let is_vague = |&(chi2, spread): &(f64, f64)| {
        let is_better = |&(other, sharp): &(f64, f64)| {
            sharp + MIN_CHI2_DIFFERENCE < spread && other + sharp + MIN_CHI2_DIFFERENCE < chi2 + spread
        };
        of_all.iter().any(is_better)
    };
    let mut vague = of_all.iter().map(is_vague);
    found.retain(|_| !vague.next().unwrap_or(false));
    found
}

/// Returns the log determinant of the covariance of the predicted heads; 0 without uprights.
fn log_spread(state: &State, problem: &Problem) -> f64 {
    let at = CameraTerms::<f64>::new(&state.parameters, [0.0; 2]);
    // The determinant of a huge covariance is lost in rounding errors.
    problem.log_spread_of_uprights(&at).filter(|spread| !spread.is_nan()).unwrap_or(f64::INFINITY)
}

/// Adds the minimum reached from a start, if it is new or lower.
fn with_minimum_from(start: State, problem: &Problem, mut found: Vec<Minimum>) -> Vec<Minimum> {
    let is_known =
        |state: &State, cost: f64| found.iter().any(|known| is_near_minimum(known, state, cost, problem));
    let summary = least_squares_unless(problem, start, MAX_STEPS, is_known);
    let Some(minimum) = summary.and_then(|summary| minimum(problem, summary)) else { return found };
    match found.iter_mut().find(|other| is_same(other, &minimum, problem)) {
        Some(other) if minimum.chi2 < other.chi2 => *other = minimum,
        Some(_) => {}
        None => found.push(minimum),
    }
    found
}

/// Whether a run from a state would converge to a known minimum: the state is within one standard deviation
/// of every parameter, and one unit of chi-square.
fn is_near_minimum(minimum: &Minimum, state: &State, cost: f64, problem: &Problem) -> bool {
    let is_near = |i: usize| {
        let off = (state.parameters[i] - minimum.state.parameters[i]).abs();
        !problem.free[i] || off < minimum.uncertainty.sigma(i)
    };
    (0.0..1.0).contains(&(cost - minimum.chi2)) && (0..4).all(is_near)
}

/// Returns a start at the camera rotated by 180 degrees, which fits lines equally well (`plausibility.rs`), if
/// a minimum is doubtful.
///
/// A minimum is doubtful if the camera is sideways or upside down, looks up, or contradicts a prior.
fn opposite_start(minimum: &Minimum, problem: &Problem) -> Option<State> {
    use std::f64::consts::{FRAC_PI_4, PI, TAU};
    /// Distance from a prior, in standard deviations, above which a minimum contradicts it.
    const MIN_CONTRADICTION_SIGMAS: f64 = 2.0;
    if !problem.free[ROLL] || !problem.free[PITCH] {
        return None;
    }
    let [roll, pitch, log_focal, log_height] = minimum.state.parameters;
    let is_against = |prior: Option<Prior>, value: f64| {
        prior.is_some_and(|prior| (value - prior.value).abs() > MIN_CONTRADICTION_SIGMAS * prior.sigma)
    };
    let is_doubtful = roll.abs() > FRAC_PI_4
        || pitch < 0.0
        || is_against(problem.priors.roll, roll)
        || is_against(problem.priors.pitch, pitch);
    let middle = problem.priors.roll.map_or(0.0, |prior| prior.value);
    let other = middle + (roll - middle).rem_euclid(TAU) - PI;
    is_doubtful.then(|| problem.state_at([other, -pitch, log_focal, log_height])).flatten()
}

/// Returns the minimum reached from a nearby state, for example after an annotation was left out. It may be
/// singular.
pub(crate) fn minimum_near(problem: &Problem, state: &State) -> Option<Minimum> {
    let start = problem.state_at(state.parameters)?;
    minimum(problem, least_squares(problem, start, MAX_STEPS)?)
}

/// Returns the minimum that a run reached, with its angles normalised and its covariance.
fn minimum(problem: &Problem, summary: Summary<Problem>) -> Option<Minimum> {
    let Summary { mut state, cost: chi2, normal, .. } = summary;
    let parameters = state.parameters;
    normalize_angles(&mut state, problem);
    // The normal equations of the run are valid for unchanged angles only.
    let uncertainty = if state.parameters == parameters {
        Uncertainty::new(&normal.information(problem.free), problem.free)
    } else {
        problem.uncertainty(&state)?
    };
    Some(Minimum { state, chi2, uncertainty })
}

/// Normalises the pitch to [-90, 90] degrees and the roll to [-180, 180). A camera with a pitch beyond the
/// vertical equals a camera with roll and yaw rotated by 180 degrees.
fn normalize_angles(state: &mut State, problem: &Problem) {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};
    // If the roll or the pitch is fixed or has a prior, both keep their values.
    if !problem.free[ROLL]
        || !problem.free[PITCH]
        || problem.priors.roll.is_some()
        || problem.priors.pitch.is_some()
    {
        return;
    }
    let [roll, pitch, ..] = &mut state.parameters;
    if pitch.abs() > FRAC_PI_2 {
        *pitch = pitch.signum() * PI - *pitch;
        *roll += PI;
        // The yaw also changes by 180 degrees. The angle of a floor direction does not, because an axis has
        // no sign.
    }
    // A roll within the range keeps its exact value.
    if !(-PI..PI).contains(roll) {
        *roll = (*roll + PI).rem_euclid(TAU) - PI;
    }
}

/// Whether two minima are the same. Roll, pitch and log focal length must differ by less than one standard deviation
/// of at least one of the two.
fn is_same(a: &Minimum, b: &Minimum, problem: &Problem) -> bool {
    /// Largest difference of roll and pitch (radians) and of log focal length between equal states.
    const SAME_STATE_DISTANCE: f64 = 1e-4;
    let turn = |x: f64| (x + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    let difference: [f64; 3] = std::array::from_fn(|i| match i {
        ROLL => turn(a.state.parameters[ROLL] - b.state.parameters[ROLL]),
        _ => a.state.parameters[i] - b.state.parameters[i],
    });
    if difference.iter().all(|d| d.abs() < SAME_STATE_DISTANCE) {
        return true;
    }
    let is_far = |minimum: &Minimum| {
        [ROLL, PITCH, LOG_FOCAL].into_iter().filter(|&i| problem.free[i]).any(|i| {
            difference[i].abs() > SAME_STATE_DISTANCE && difference[i].abs() > minimum.uncertainty.sigma(i)
        })
    };
    !(is_far(a) && is_far(b))
}

/// Returns the rolls from which the search starts, in radians, the likeliest first. The search ends at the
/// first roll that leads to a minimum.
///
/// Verticals determine the roll up to 180 degrees. Uprights determine it, because the head is above the foot.
/// Without lengths and uprights, the two rolls fit equally well, so the second one is omitted.
fn start_rolls(problem: &Problem, fixed: FixedParameters, vanishing: Option<[f64; 3]>) -> Vec<f64> {
    use std::f64::consts::{FRAC_PI_2, PI};
    if let Some(roll) = fixed.roll {
        return vec![roll];
    }
    let expected = problem.priors.roll.map(|prior| prior.value).or_else(|| roll_from_uprights(problem));
    let likely = expected.unwrap_or(0.0);
    let has_sizes = problem.lengths().next().is_some() || problem.uprights().next().is_some();
    let Some(roll) = vanishing.map(roll_from_verticals) else {
        let turns: &[f64] =
            if expected.is_some() || !has_sizes { &[0.0] } else { &[0.0, FRAC_PI_2, -FRAC_PI_2, PI] };
        return turns.iter().map(|turn| likely + turn).collect();
    };
    let roll = roll + PI * ((likely - roll) / PI).round();
    if has_sizes { vec![roll, roll + PI] } else { vec![roll] }
}

/// Returns the mean roll at which the heads of uprights are above their feet; `None` without uprights.
fn roll_from_uprights(problem: &Problem) -> Option<f64> {
    let unit = |chart: Option<&Chart>, [u, v]: [f64; 2]| {
        let rows = chart.map(Chart::bearing_from_chart);
        let [x, y, w] = rows.map_or([u, v, problem.width], |rows| rows.map(|[a, b, c]| a * u + b * v + c));
        let length = (x * x + y * y + w * w).sqrt();
        [x / length, y / length]
    };
    let down = problem.uprights().fold([0.0; 2], |[x, y], upright| {
        let [foot, head] = [upright.foot, upright.head].map(|end| unit(upright.chart.as_ref(), end.point));
        [x + foot[0] - head[0], y + foot[1] - head[1]]
    });
    (down != [0.0; 2]).then(|| down[0].atan2(down[1]))
}

/// Returns the start states with this roll: the best states on a grid of focal lengths, and of pitches if
/// the vanishing point of the verticals is unknown.
fn starts(problem: &Problem, fixed: FixedParameters, roll: f64, vanishing: Option<[f64; 3]>) -> Vec<State> {
    /// Maximum number of start states.
    const MAX_STARTS: usize = 4;
    let focals = focals(problem, fixed);
    let usual_height = problem.priors.height.map_or(STAGE_1_HEIGHT, |prior| prior.value);
    let log_height = fixed.height.unwrap_or(usual_height).ln();
    let mut rows: Vec<Vec<Parameters>> = Vec::new();
    match (fixed.pitch, vanishing) {
        (Some(pitch), _) => rows.push(focals.iter().map(|f| [roll, pitch, f.ln(), log_height]).collect()),
        (None, Some([x, y, w])) => {
            // The distance of the vanishing point is f cot pitch, with the sign of the pitch.
            let w = if x * roll.sin() + y * roll.cos() < 0.0 { -w } else { w };
            let along = x.hypot(y);
            rows.push(focals.iter().map(|f| [roll, (f * w).atan2(along), f.ln(), log_height]).collect());
        }
        (None, None) => {
            let pitch = |degrees: f64| degrees.to_radians();
            rows.extend(
                START_PITCHES_DEG
                    .map(|p| focals.iter().map(|f| [roll, pitch(p), f.ln(), log_height]).collect()),
            );
        }
    }
    lowest_on_grid(problem, &rows, MAX_STARTS)
}

/// Returns the start values of the focal length, in pixels: the fixed value, or a range and the mean of the
/// prior.
fn focals(problem: &Problem, fixed: FixedParameters) -> Vec<f64> {
    if let Some(focal) = fixed.focal {
        return vec![focal];
    }
    let mut focals: Vec<f64> = START_FIELDS_OF_VIEW_DEG
        .iter()
        .map(|degrees| 0.5 * problem.width / (0.5 * degrees.to_radians()).tan())
        .collect();
    focals.extend(problem.priors.focal.map(|prior| prior.value));
    focals.sort_by(f64::total_cmp);
    focals
}

/// Returns the states at the local minima of the cost on a grid of parameters, the lowest first, at most
/// `most`. The cost includes the log determinant of the covariance of the predicted heads.
fn lowest_on_grid(problem: &Problem, rows: &[Vec<Parameters>], most: usize) -> Vec<State> {
    let states: Vec<Vec<Option<(f64, State)>>> = rows
        .iter()
        .map(|row| {
            row.iter()
                .map(|&parameters| {
                    let state = problem.state_at(parameters)?;
                    Some((problem.cost(&state)? + log_spread(&state, problem), state))
                })
                .collect()
        })
        .collect();
    let cost = |i: usize, j: usize| states[i][j].as_ref().map_or(f64::INFINITY, |(cost, _)| *cost);
    let mut found: Vec<(f64, usize, usize)> = Vec::new();
    for i in 0..rows.len() {
        for j in 0..rows[i].len() {
            let neighbours = (i.saturating_sub(1)..(i + 2).min(rows.len()))
                .flat_map(|a| (j.saturating_sub(1)..(j + 2).min(rows[i].len())).map(move |b| (a, b)));
            let here = cost(i, j);
            if here.is_finite() && neighbours.into_iter().all(|(a, b)| here <= cost(a, b)) {
                found.push((here, i, j));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
        .iter()
        .take(most)
        .filter_map(|&(_, i, j)| states[i][j].as_ref().map(|(_, state)| state.clone()))
        .collect()
}

/// Minima, with the weak prior on the focal length if it was added.
#[derive(Clone, Debug)]
pub(crate) struct Solutions {
    /// Reported minima, the lowest first.
    pub(crate) minima: Vec<Minimum>,
    /// Weak prior, if it was added.
    pub(crate) weak_prior: Option<WeakPrior>,
}

/// Weak prior on the focal length that was added to the cost, with the minima without it.
#[derive(Clone, Debug)]
pub(crate) struct WeakPrior {
    /// Prior in the cost. The cost is in units of the assumed noise, so for larger noise the sigma is reduced
    /// accordingly.
    pub(crate) prior: Prior,
    /// Ratio of the estimated to the assumed variance of the annotation noise.
    pub(crate) spread: f64,
    /// Minima without the weak prior, the lowest first.
    pub(crate) without: Vec<Minimum>,
}

impl Solutions {
    /// Returns the minima without the weak prior, the lowest first.
    pub(crate) fn without_weak_prior(&self) -> &[Minimum] {
        self.weak_prior.as_ref().map_or(&self.minima, |weak| &weak.without)
    }

    /// Returns the standard deviation of the log focal length without the weak prior, for the assumed noise.
    pub(crate) fn log_focal_sigma(&self) -> f64 {
        self.without_weak_prior().first().map_or(f64::INFINITY, |best| best.uncertainty.sigma(LOG_FOCAL))
    }

    /// Returns the contribution of the weak prior to the cost of a minimum.
    fn chi2_of_prior(&self, minimum: &Minimum) -> f64 {
        let off =
            |weak: &WeakPrior| (minimum.state.parameters[LOG_FOCAL] - weak.prior.value) / weak.prior.sigma;
        self.weak_prior.as_ref().map_or(0.0, |weak| off(weak).powi(2))
    }

    /// Returns the chi-square of a minimum without the weak prior.
    pub(crate) fn chi2_of_annotations(&self, minimum: &Minimum) -> f64 {
        minimum.chi2 - self.chi2_of_prior(minimum)
    }

    /// Returns the chi-square of a minimum with the weak prior, at its stated sigma.
    pub(crate) fn chi2_with_prior(&self, minimum: &Minimum) -> f64 {
        let spread = self.weak_prior.as_ref().map_or(1.0, |weak| weak.spread);
        self.chi2_of_annotations(minimum) + self.chi2_of_prior(minimum) / spread
    }
}

/// Solves without the weak prior, and again with it if the focal length is undetermined.
pub(crate) fn solve(problem: &Problem, fixed: FixedParameters, allow_weak_prior: bool) -> Solutions {
    let minima = minima(problem, fixed);
    let found = Solutions { minima, weak_prior: None };
    let is_open = found.log_focal_sigma() > MAX_LOG_FOCAL_SIGMA;
    if is_open && allow_weak_prior && problem.free[LOG_FOCAL] {
        with_weak_prior(problem, fixed, found.minima, 1.0)
    } else {
        found
    }
}

/// Recomputes the minima with the weak prior, for a noise variance of `spread` times the assumed one.
pub(crate) fn with_weak_prior(
    problem: &Problem,
    fixed: FixedParameters,
    without: Vec<Minimum>,
    spread: f64,
) -> Solutions {
    let Prior { value, sigma } = weak_prior(problem.width);
    let prior = Prior { value, sigma: sigma / spread.sqrt() };
    let mut with_prior = problem.clone();
    with_prior.priors.weak_log_focal = Some(prior);
    let minima = minima(&with_prior, fixed);
    Solutions { minima, weak_prior: Some(WeakPrior { prior, spread, without }) }
}
