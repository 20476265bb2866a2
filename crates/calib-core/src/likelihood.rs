//! Stage 1 by maximum likelihood: roll, pitch, focal and height together, every constraint one
//! residual in pixels, so that nothing needs a weight set by hand.
//!
//! Core unknowns are roll, pitch, log focal and log height; beside them every floor direction has an
//! angle and every group of equal segments a log length. A residual depends on the core and on one
//! of these at most: they are eliminated, and what is solved is 4 x 4 whatever was drawn.

use nalgebra::{Matrix4, SymmetricEigen};

use crate::criterion::{Held, Orientation};
use crate::dual::{Dual, Slope};
use crate::evidence::{Evidence, Length, Line, Source, Toward, Upright};
use crate::minimize::LeastSquares;
use crate::residual::{
    Angles, Core, LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL, Unrolled, Vanishing, floor_length, line_residual,
    upright_residuals,
};
use crate::vanishing::line_through;

/// A value that an unknown is believed to have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// In the unknown's own unit: radians, pixels, metres.
    pub value: f64,
    /// Standard deviation, in the same unit.
    pub sigma: f64,
}

/// What is believed of roll, pitch, focal and height.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Priors {
    /// In radians.
    pub roll: Option<Prior>,
    /// In radians.
    pub pitch: Option<Prior>,
    /// In pixels.
    pub focal: Option<Prior>,
    /// In metres.
    pub height: Option<Prior>,
    /// Of the log of the focal, where the lines alone do not tell it.
    pub weak_log_focal: Option<Prior>,
}

/// The fit of one camera: evidence, what is held and what is believed.
#[derive(Clone, Debug)]
pub(crate) struct Problem<'a> {
    pub(crate) evidence: &'a Evidence,
    /// Standard deviation of a drawn coordinate, in pixels.
    pub(crate) sigma: f64,
    pub(crate) priors: Priors,
    /// Which of the core unknowns are free.
    pub(crate) free: [bool; 4],
    /// Pieces of evidence set aside.
    pub(crate) aside: &'a [Source],
    /// Width of the image, in pixels: the unit of the possible focals.
    pub(crate) width: f64,
}

/// A value for every unknown.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State {
    pub(crate) core: Core,
    /// Angle of every floor direction in radians, then the log length of every group of lengths
    /// in units of the camera height.
    pub(crate) nuisance: Vec<f64>,
}

impl State {
    pub(crate) fn orientation(&self) -> Orientation {
        let [roll, pitch, log_focal, _] = self.core;
        Orientation { roll, pitch, focal: log_focal.exp() }
    }
}

/// Normal equations with one unknown beside the core per block.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    cost: f64,
    core: [[f64; 4]; 4],
    gradient: [f64; 4],
    blocks: Vec<Block>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Block {
    square: f64,
    cross: [f64; 4],
    gradient: f64,
}

impl Normal {
    fn new(nuisances: usize) -> Self {
        Self { cost: 0.0, core: [[0.0; 4]; 4], gradient: [0.0; 4], blocks: vec![Block::default(); nuisances] }
    }

    #[inline]
    fn add(&mut self, residual: f64, slope: &Slope, nuisance: Option<(usize, f64)>) {
        self.cost += residual * residual;
        for i in 0..4 {
            self.gradient[i] += slope[i] * residual;
            for j in i..4 {
                self.core[i][j] += slope[i] * slope[j];
            }
        }
        if let Some((index, derivative)) = nuisance {
            let block = &mut self.blocks[index];
            block.square += derivative * derivative;
            block.gradient += derivative * residual;
            for i in 0..4 {
                block.cross[i] += derivative * slope[i];
            }
        }
    }

    /// The core's equations with every block eliminated; damping multiplies the diagonal.
    fn reduced(&self, damping: f64, free: [bool; 4]) -> ([[f64; 4]; 4], [f64; 4]) {
        let grow = 1.0 + damping;
        let mut matrix = [[0.0; 4]; 4];
        let mut right = self.gradient.map(|g| -g);
        for i in 0..4 {
            for j in i..4 {
                matrix[i][j] = self.core[i][j] * if i == j { grow } else { 1.0 };
            }
        }
        for block in self.blocks.iter().filter(|block| block.square > 0.0) {
            let pivot = block.square * grow;
            for i in 0..4 {
                right[i] += block.cross[i] * block.gradient / pivot;
                for j in i..4 {
                    matrix[i][j] -= block.cross[i] * block.cross[j] / pivot;
                }
            }
        }
        for i in 0..4 {
            for j in 0..i {
                matrix[i][j] = matrix[j][i];
            }
        }
        for i in (0..4).filter(|&i| !free[i]) {
            for j in 0..4 {
                matrix[i][j] = 0.0;
                matrix[j][i] = 0.0;
            }
            matrix[i][i] = 1.0;
            right[i] = 0.0;
        }
        (matrix, right)
    }

    /// Information about the core: the inverse of its covariance, held unknowns with rows of zeros.
    pub(crate) fn information(&self, free: [bool; 4]) -> Matrix4<f64> {
        let (matrix, _) = self.reduced(0.0, free);
        let mut information = Matrix4::from_fn(|i, j| matrix[i][j]);
        for i in (0..4).filter(|&i| !free[i]) {
            information[(i, i)] = 0.0;
        }
        information
    }
}

/// The covariance of the free unknowns and its weakest direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertainty {
    /// Of roll, pitch, log focal, log height; zeros for those held. Where the evidence leaves a
    /// direction open, its variance is large, not infinite.
    pub(crate) covariance: Matrix4<f64>,
    /// Whether the evidence leaves a direction open.
    pub(crate) singular: bool,
}

impl Uncertainty {
    /// From information with rows of zeros for what is held.
    pub(crate) fn new(information: &Matrix4<f64>, free: [bool; 4]) -> Self {
        /// Relative to the best-known direction: below it the inverse is rounding.
        const OPEN: f64 = 1e-13;
        let scale: [f64; 4] = std::array::from_fn(|i| {
            let diagonal = information[(i, i)];
            if free[i] && diagonal > 0.0 { diagonal.sqrt().recip() } else { 0.0 }
        });
        let untouched = (0..4).any(|i| free[i] && scale[i] == 0.0);
        let scaled = Matrix4::from_fn(|i, j| {
            if scale[i] == 0.0 || scale[j] == 0.0 {
                f64::from(u8::from(i == j))
            } else {
                information[(i, j)] * scale[i] * scale[j]
            }
        });
        let eigen = SymmetricEigen::new(scaled);
        let most = eigen.eigenvalues.max();
        let least = OPEN * most;
        let singular = untouched || eigen.eigenvalues.min() < least;
        let inverse = eigen.eigenvectors
            * Matrix4::from_diagonal(&eigen.eigenvalues.map(|value| value.max(least).recip()))
            * eigen.eigenvectors.transpose();
        let mut covariance = Matrix4::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]);
        for i in (0..4).filter(|&i| free[i] && scale[i] == 0.0) {
            // Nothing at all is known of it: as uncertain as a factor of e^1000.
            covariance[(i, i)] = 1e6;
        }
        Self { covariance, singular }
    }

    pub(crate) fn sigma(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }
}

impl<'a> Problem<'a> {
    /// The problem of this evidence with what is held, at the start of everything else.
    pub(crate) fn new(evidence: &'a Evidence, held: Held, priors: Priors, sigma: f64, width: f64) -> Self {
        let tells_height = priors.height.is_some()
            || !evidence.uprights.is_empty()
            || evidence.lengths.iter().any(|length| evidence.length_groups[length.group].is_some());
        let free_height = tells_height && held.height.is_none();
        let free = [held.roll.is_none(), held.pitch.is_none(), held.focal.is_none(), free_height];
        Self { evidence, sigma, priors, free, aside: &[], width }
    }

    /// Number of residuals minus number of unknowns.
    pub(crate) fn dof(&self) -> i64 {
        let drawn = self.lines().count() + self.lengths().count() + 2 * self.uprights().count();
        let mut count = drawn as i64;
        let Priors { roll, pitch, focal, height, weak_log_focal } = self.priors;
        count += [roll, pitch, focal, height, weak_log_focal].iter().flatten().count() as i64;
        let beside = self.used().iter().filter(|&&used| used).count();
        let unknowns = self.free.iter().filter(|&&free| free).count() + beside;
        count - unknowns as i64
    }

    /// Which directions and lengths any evidence hangs on.
    pub(crate) fn used(&self) -> Vec<bool> {
        let mut used = vec![false; self.nuisances()];
        for line in self.lines() {
            if let Toward::Floor { group, .. } = line.toward {
                used[group] = true;
            }
        }
        for length in self.lengths().filter(|length| self.evidence.length_groups[length.group].is_none()) {
            used[self.evidence.groups + length.group] = true;
        }
        used
    }

    fn nuisances(&self) -> usize {
        self.evidence.groups + self.evidence.length_groups.len()
    }

    fn in_use(&self, source: Source) -> bool {
        self.aside.is_empty() || !self.aside.contains(&source)
    }

    pub(crate) fn lines(&self) -> impl Iterator<Item = &'a Line> + '_ {
        self.evidence.lines.iter().filter(|line| self.in_use(line.source))
    }

    pub(crate) fn lengths(&self) -> impl Iterator<Item = &'a Length> + '_ {
        self.evidence.lengths.iter().filter(|length| self.in_use(length.source))
    }

    pub(crate) fn uprights(&self) -> impl Iterator<Item = &'a Upright> + '_ {
        self.evidence.uprights.iter().filter(|upright| self.in_use(upright.source))
    }

    /// A state with this core, directions and lengths in closed form.
    ///
    /// `None` when a length lies above the horizon there.
    pub(crate) fn state_at(&self, core: Core) -> Option<State> {
        let mut nuisance = vec![0.0; self.nuisances()];
        let mut sums = vec![[0.0; 2]; self.evidence.groups];
        let ((sr, cr), (sp, cp), f) = (core[ROLL].sin_cos(), core[PITCH].sin_cos(), core[LOG_FOCAL].exp());
        for line in self.lines() {
            let Toward::Floor { group, quarter } = line.toward else { continue };
            let unroll = |[x, y]: [f64; 2]| [x * cr - y * sr, x * sr + y * cr];
            let [a, b, c] = line_through(unroll(line.ends[0].at), unroll(line.ends[1].at));
            // Where the viewing plane cuts the floor; doubled, an angle has no sign and adds up.
            let (x, y) = (cp * c - sp * f * b, -f * a);
            let square = x * x + y * y;
            if square > 0.0 {
                let weight = a.hypot(b) / square * if quarter { -1.0 } else { 1.0 };
                sums[group][0] += weight * (x * x - y * y);
                sums[group][1] += weight * 2.0 * x * y;
            }
        }
        for (angle, [cos, sin]) in nuisance.iter_mut().zip(&sums) {
            *angle = 0.5 * sin.atan2(*cos);
        }
        let mut totals = vec![(0.0, 0.0); self.evidence.length_groups.len()];
        let at = Unrolled::new(&core);
        for length in self.lengths() {
            let (log_length, _) = floor_length(&at, &length.ends)?;
            totals[length.group].0 += log_length.value;
            totals[length.group].1 += 1.0;
        }
        for (value, (sum, count)) in nuisance[self.evidence.groups..].iter_mut().zip(totals) {
            *value = if count > 0.0 { sum / count } else { 0.0 };
        }
        Some(State { core, nuisance })
    }

    /// Calls `sink` with every residual in sigmas, its slope, its unknown beside the core, and its source.
    ///
    /// `None` where the geometry is impossible: a length above the horizon, a focal beyond reason.
    pub(crate) fn each_residual(
        &self,
        state: &State,
        mut sink: impl FnMut(f64, &Slope, Option<(usize, f64)>, Option<Source>),
    ) -> Option<()> {
        let core = &state.core;
        let focal = core[LOG_FOCAL].exp();
        if !(focal > 0.02 * self.width && focal < 500.0 * self.width) || core[PITCH].abs() > 3.0 {
            return None;
        }
        let scale = self.sigma.recip();
        let angles = Angles::new(core);
        let down = angles.down();
        let directions: Vec<[Vanishing; 2]> = state.nuisance[..self.evidence.groups]
            .iter()
            .map(|&a| [angles.floor(a), angles.floor(a + std::f64::consts::FRAC_PI_2)])
            .collect();
        for line in self.lines() {
            let (vanishing, group) = match line.toward {
                Toward::Vertical => (&down, None),
                Toward::Floor { group, quarter } => (&directions[group][usize::from(quarter)], Some(group)),
            };
            let (residual, by_point) = line_residual(&line.ends, vanishing.at);
            let slope = |change: &[f64; 3]| scale * crate::camera::dot(&by_point, change);
            let core_slope =
                [slope(&vanishing.by_roll), slope(&vanishing.by_pitch), slope(&vanishing.by_log_focal), 0.0];
            let beside = group.map(|group| (group, slope(&vanishing.by_angle)));
            sink(scale * residual, &core_slope, beside, Some(line.source));
        }
        let at = Unrolled::new(core);
        for length in self.lengths() {
            let (log_length, noise) = floor_length(&at, &length.ends)?;
            let index = self.evidence.groups + length.group;
            let (expected, beside) = match self.evidence.length_groups[length.group] {
                Some(metres) => {
                    (Dual::constant(metres.ln()) - Dual::unknown(core[LOG_HEIGHT], LOG_HEIGHT), false)
                }
                None => (Dual::constant(state.nuisance[index]), true),
            };
            let residual = (log_length - expected) / noise * scale;
            let beside = beside.then(|| (index, -scale / noise.value));
            sink(residual.value, &residual.slope, beside, Some(length.source));
        }
        for upright in self.uprights() {
            for residual in upright_residuals(&at, upright, self.sigma)? {
                sink(residual.value, &residual.slope, None, Some(upright.source));
            }
        }
        self.each_prior(core, |residual, slope| sink(residual, &slope, None, None));
        Some(())
    }

    /// `(value - believed) / sigma` for every prior.
    fn each_prior(&self, core: &Core, mut sink: impl FnMut(f64, Slope)) {
        let Priors { roll, pitch, focal, height, weak_log_focal } = self.priors;
        let mut add = |index: usize, prior: Option<Prior>, value: f64, derivative: f64| {
            if let Some(Prior { value: believed, sigma }) = prior {
                let mut slope = [0.0; 4];
                slope[index] = derivative / sigma;
                sink((value - believed) / sigma, slope);
            }
        };
        add(ROLL, roll, core[ROLL], 1.0);
        add(PITCH, pitch, core[PITCH], 1.0);
        let (f, z) = (core[LOG_FOCAL].exp(), core[LOG_HEIGHT].exp());
        add(LOG_FOCAL, focal, f, f);
        add(LOG_FOCAL, weak_log_focal, core[LOG_FOCAL], 1.0);
        add(LOG_HEIGHT, height, z, z);
    }

    /// Every piece of evidence with its distance from the prediction in pixels (of an upright, of both
    /// coordinates of its head together).
    pub(crate) fn residuals_in_pixels(&self, state: &State) -> Option<Vec<(Source, f64)>> {
        let mut found: Vec<(Source, f64)> = Vec::new();
        self.each_residual(state, |residual, _, _, source| {
            let Some(source) = source else { return };
            match found.last_mut() {
                Some((last, pixels)) if *last == source => *pixels = pixels.hypot(residual * self.sigma),
                _ => found.push((source, residual * self.sigma)),
            }
        })?;
        Some(found)
    }

    /// Normal equations at a state; `None` where the geometry is impossible.
    pub(crate) fn normal(&self, state: &State) -> Option<Normal> {
        let mut normal = Normal::new(self.nuisances());
        self.each_residual(state, |residual, slope, beside, _| normal.add(residual, slope, beside))?;
        normal.cost.is_finite().then_some(normal)
    }

    /// Sum of the squared residuals in sigmas; `None` where the geometry is impossible.
    pub(crate) fn cost(&self, state: &State) -> Option<f64> {
        let mut cost = 0.0;
        self.each_residual(state, |residual, _, _, _| cost += residual * residual)?;
        cost.is_finite().then_some(cost)
    }

    /// Covariance of the core at a state.
    pub(crate) fn uncertainty(&self, state: &State) -> Option<Uncertainty> {
        Some(Uncertainty::new(&self.normal(state)?.information(self.free), self.free))
    }
}

impl LeastSquares for Problem<'_> {
    type State = State;
    type Normal = Normal;

    fn linearise(&self, state: &State) -> Option<(f64, Normal)> {
        let normal = self.normal(state)?;
        Some((normal.cost, normal))
    }

    fn step(&self, state: &State, normal: &Normal, damping: f64) -> Option<(State, f64, f64)> {
        let (matrix, right) = normal.reduced(damping, self.free);
        let core_step = solve_4(&matrix, &right)?;
        let grow = 1.0 + damping;
        let mut next = state.clone();
        let mut predicted = 0.0;
        let mut size = 0.0_f64;
        for i in 0..4 {
            next.core[i] += core_step[i];
            // Gain of the linear model under damping: step' (damping D step - gradient).
            predicted += core_step[i] * (damping * normal.core[i][i] * core_step[i] - normal.gradient[i]);
            size = size.max(core_step[i].abs());
        }
        for (value, block) in next.nuisance.iter_mut().zip(&normal.blocks) {
            if block.square > 0.0 {
                let coupled: f64 = block.cross.iter().zip(&core_step).map(|(c, s)| c * s).sum();
                let step = -(block.gradient + coupled) / (block.square * grow);
                *value += step;
                predicted += step * (damping * block.square * step - block.gradient);
                size = size.max(step.abs());
            }
        }
        Some((next, predicted, size))
    }
}

/// Solves a symmetric positive system by Cholesky; `None` when it is not positive.
fn solve_4(matrix: &[[f64; 4]; 4], right: &[f64; 4]) -> Option<[f64; 4]> {
    let mut lower = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - sum;
            if i == j {
                if rest <= 1e-15 * matrix[i][i] || rest.is_nan() {
                    return None;
                }
                lower[i][i] = rest.sqrt();
            } else {
                lower[i][j] = rest / lower[j][j];
            }
        }
    }
    let mut x = *right;
    for i in 0..4 {
        let sum: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    for i in (0..4).rev() {
        let sum: f64 = (i + 1..4).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    Some(x)
}

/// Every piece of evidence with its distance in pixels from what an orientation predicts, directions
/// and lengths taken as the evidence has them there; those without a prediction are left out.
pub(crate) fn residuals_at(
    evidence: &Evidence,
    at: Orientation,
    height: f64,
    width: f64,
) -> Vec<(Source, f64)> {
    let held =
        Held { roll: Some(at.roll), pitch: Some(at.pitch), focal: Some(at.focal), height: Some(height) };
    let core = [at.roll, at.pitch, at.focal.ln(), height.ln()];
    let evidence = predictable(evidence, &core);
    let problem = Problem::new(&evidence, held, Priors::default(), 1.0, width);
    problem.state_at(core).and_then(|state| problem.residuals_in_pixels(&state)).unwrap_or_default()
}

/// The evidence that has a prediction at a core: no length above the horizon, no head behind the camera.
pub(crate) fn predictable(evidence: &Evidence, core: &Core) -> Evidence {
    let mut evidence = evidence.clone();
    let at = Unrolled::new(core);
    evidence.lengths.retain(|length| floor_length(&at, &length.ends).is_some());
    evidence.uprights.retain(|upright| upright_residuals(&at, upright, 1.0).is_some());
    evidence
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::annotation::Known;
    use crate::evidence::End;
    use crate::minimize::{Ending, LevenbergMarquardt, least_squares};
    use proptest::prelude::*;

    fn any_end() -> impl Strategy<Value = End> {
        ([-900.0..900.0_f64, 50.0..500.0_f64], 0.6..1.5_f64, -0.2..0.2_f64, 0.6..1.5_f64)
            .prop_map(|(at, a, b, d)| End { at, spread: [a * a + b * b, b * (a + d), d * d + b * b] })
    }

    fn source(segment: usize) -> Source {
        Source { annotation: 0, segment }
    }

    /// Evidence that agrees with nothing: derivatives do not care.
    fn any_evidence() -> impl Strategy<Value = Evidence> {
        let lines = proptest::collection::vec(([any_end(), any_end()], 0..3_usize, any::<bool>()), 3..12);
        let lengths = proptest::collection::vec(([any_end(), any_end()], 0..2_usize), 0..6);
        let uprights = proptest::collection::vec((any_end(), any_end(), 1.0..2.0_f64), 0..3);
        (lines, lengths, uprights).prop_map(|(lines, lengths, uprights)| {
            let toward = |group: usize, quarter| match group {
                0 => Toward::Vertical,
                _ => Toward::Floor { group: group - 1, quarter },
            };
            Evidence {
                lines: lines
                    .into_iter()
                    .enumerate()
                    .map(|(i, (ends, group, quarter))| Line {
                        ends,
                        toward: toward(group, quarter),
                        source: source(i),
                    })
                    .collect(),
                groups: 2,
                lengths: lengths
                    .into_iter()
                    .enumerate()
                    .map(|(i, (ends, group))| Length { ends, group, source: source(100 + i) })
                    .collect(),
                length_groups: vec![None, Some(2.0)],
                uprights: uprights
                    .into_iter()
                    .enumerate()
                    .map(|(i, (foot, head, height))| {
                        let height = Known::prior(height, 0.05);
                        Upright { foot, head, height, source: source(200 + i) }
                    })
                    .collect(),
                mute: Vec::new(),
            }
        })
    }

    fn any_core() -> impl Strategy<Value = Core> {
        (-0.3..0.3_f64, 0.3..1.5_f64, 600.0..2500.0_f64, 1.5..6.0_f64)
            .prop_map(|(r, p, f, z)| [r, p, f.ln(), z.ln()])
    }

    fn residuals(problem: &Problem, state: &State) -> Option<Vec<(f64, Vec<f64>)>> {
        let mut rows = Vec::new();
        problem.each_residual(state, |residual, slope, beside, _| {
            let mut row = slope.to_vec();
            row.resize(4 + state.nuisance.len(), 0.0);
            if let Some((index, derivative)) = beside {
                row[4 + index] = derivative;
            }
            rows.push((residual, row));
        })?;
        Some(rows)
    }

    fn nudged(state: &State, index: usize, by: f64) -> State {
        let mut state = state.clone();
        match index {
            0..4 => state.core[index] += by,
            _ => state.nuisance[index - 4] += by,
        }
        state
    }

    fn priors() -> Priors {
        let prior = |value, sigma| Some(Prior { value, sigma });
        Priors {
            roll: prior(0.1, 0.02),
            pitch: prior(0.5, 0.1),
            focal: prior(1200.0, 50.0),
            height: prior(3.0, 0.2),
            weak_log_focal: prior(7.0, 0.35),
        }
    }

    proptest! {
        #[test]
        fn the_jacobian_is_that_of_differences(evidence in any_evidence(), core in any_core()) {
            const STEP: f64 = 1e-6;
            let problem = Problem::new(&evidence, Held::default(), priors(), 0.7, 1920.0);
            let state = problem.state_at(core);
            prop_assume!(state.is_some());
            let Some(state) = state else { return Ok(()) };
            let rows = residuals(&problem, &state);
            prop_assume!(rows.is_some());
            let rows = rows.unwrap_or_default();
            for index in 0..4 + state.nuisance.len() {
                let ahead = residuals(&problem, &nudged(&state, index, STEP));
                let behind = residuals(&problem, &nudged(&state, index, -STEP));
                let (Some(ahead), Some(behind)) = (ahead, behind) else { continue };
                for (k, (residual, row)) in rows.iter().enumerate() {
                    let numeric = (ahead[k].0 - behind[k].0) / (2.0 * STEP);
                    let scale = 1.0 + row[index].abs() + residual.abs();
                    // Central differences: rounding 1e-10 of the value, truncation 1e-12 of the third derivative.
                    prop_assert!((numeric - row[index]).abs() < 2e-4 * scale, "residual {k} by {index}: {numeric} {}", row[index]);
                }
            }
        }

        #[test]
        fn our_minimiser_agrees_with_the_levenberg_marquardt_crate(
            core in any_core(), nudge in [-0.05..0.05_f64, -0.1..0.1_f64, -0.2..0.2_f64],
            drawn in proptest::collection::vec(([-900.0..900.0_f64, -300.0..500.0_f64], 0.1..0.4_f64, -2.0..2.0_f64), 9..16),
        ) {
            let evidence = drawn_toward(&core, &drawn);
            let problem = Problem::new(&evidence, Held::default(), priors(), 1.0, 1920.0);
            let start = [core[0] + nudge[0], core[1] + nudge[1], core[2] + nudge[2], core[3]];
            let Some(start) = problem.state_at(start) else { return Ok(()) };
            let (_, cost, ending) = least_squares(&problem, start.clone(), 200).unwrap();
            prop_assert!(ending != Ending::OutOfRounds);
            let oracle = levenberg_marquardt::LevenbergMarquardt::new();
            let (_, report) = oracle.minimize(Oracle { problem: &problem, state: start });
            let theirs = 2.0 * report.objective_function;
            prop_assert!((theirs - cost).abs() < 1e-7 * cost + 1e-12, "{theirs} there, {cost} here");
        }
    }

    /// Lines toward the vertical and two floor directions, drawn with noise across them.
    fn drawn_toward(core: &Core, drawn: &[([f64; 2], f64, f64)]) -> Evidence {
        let angles = Angles::new(core);
        let end = |at| End { at, spread: [1.0, 0.0, 1.0] };
        let lines = drawn.iter().enumerate().map(|(i, &(a, share, noise))| {
            let (toward, v) = match i % 3 {
                0 => (Toward::Vertical, angles.down().at),
                1 => (Toward::Floor { group: 0, quarter: false }, angles.floor(0.7).at),
                _ => (
                    Toward::Floor { group: 0, quarter: true },
                    angles.floor(0.7 + std::f64::consts::FRAC_PI_2).at,
                ),
            };
            let way = [v[0] - a[0] * v[2], v[1] - a[1] * v[2]];
            let length = way[0].hypot(way[1]);
            let step = 700.0 * share / length;
            let b = [
                a[0] + step * way[0] - noise * way[1] / length,
                a[1] + step * way[1] + noise * way[0] / length,
            ];
            Line { ends: [end(a), end(b)], toward, source: source(i) }
        });
        Evidence { lines: lines.collect(), groups: 1, ..Evidence::default() }
    }

    /// The problem as the levenberg-marquardt crate wants it.
    struct Oracle<'a> {
        problem: &'a Problem<'a>,
        state: State,
    }

    impl levenberg_marquardt::LeastSquaresProblem<f64, nalgebra::Dyn, nalgebra::Dyn> for Oracle<'_> {
        type ParameterStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::U1>;
        type ResidualStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::U1>;
        type JacobianStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::Dyn>;

        fn set_params(&mut self, x: &nalgebra::DVector<f64>) {
            self.state.core.copy_from_slice(&x.as_slice()[..4]);
            self.state.nuisance.copy_from_slice(&x.as_slice()[4..]);
        }
        fn params(&self) -> nalgebra::DVector<f64> {
            nalgebra::DVector::from_iterator(
                4 + self.state.nuisance.len(),
                self.state.core.iter().chain(&self.state.nuisance).copied(),
            )
        }
        fn residuals(&self) -> Option<nalgebra::DVector<f64>> {
            let rows = residuals(self.problem, &self.state)?;
            Some(nalgebra::DVector::from_iterator(rows.len(), rows.iter().map(|(residual, _)| *residual)))
        }
        fn jacobian(&self) -> Option<nalgebra::DMatrix<f64>> {
            let rows = residuals(self.problem, &self.state)?;
            Some(nalgebra::DMatrix::from_fn(rows.len(), 4 + self.state.nuisance.len(), |i, j| rows[i].1[j]))
        }
    }

    #[test]
    fn the_executor_of_argmin_walks_the_same_way() {
        let end = |at| End { at, spread: [1.0, 0.0, 1.0] };
        let line = |a, b, toward, i| Line { ends: [end(a), end(b)], toward, source: source(i) };
        let floor = Toward::Floor { group: 0, quarter: false };
        let evidence = Evidence {
            lines: vec![
                line([-500.0, -200.0], [-430.0, 200.0], Toward::Vertical, 0),
                line([480.0, -210.0], [400.0, 220.0], Toward::Vertical, 1),
                line([-300.0, 400.0], [-100.0, 0.0], floor, 2),
                line([500.0, 390.0], [120.0, 10.0], floor, 3),
            ],
            groups: 1,
            ..Evidence::default()
        };
        let problem = Problem::new(&evidence, Held::default(), priors(), 1.0, 1920.0);
        let start = problem.state_at([0.0, 0.5, 1500_f64.ln(), 3_f64.ln()]).unwrap();
        let (direct, cost, _) = least_squares(&problem, start.clone(), 100).unwrap();
        let solver = LevenbergMarquardt::new(&problem, start.clone()).unwrap();
        let run = argmin::core::Executor::new(problem.clone(), solver)
            .configure(|state| state.param(start).max_iters(100))
            .run()
            .unwrap();
        assert!((run.state.best_cost - cost).abs() < 1e-9 * cost);
        assert!((run.state.best_param.unwrap().core[PITCH] - direct.core[PITCH]).abs() < 1e-9);
    }
}
