//! How a camera turned, by edges that are beside where they were: robust, and with a sigma that the edges themselves bear
//! out.
//!
//! At a place of an edge the offset across it is `d`, and a small turn `x` would make it `a' x`. The estimate minimises
//!
//! ```text
//! sum over places of rho((d - a' x) / s),   s^2 = sigma^2 + tau^2
//! ```
//!
//! with Tukey's `rho` (Beaton and Tukey 1974), from a start of least absolute deviations: things that moved by themselves
//! are a minority that agrees with itself and must not pull. `tau`, how much places scatter beyond their own noise, is
//! that of the median.
//!
//! All places of one edge are moved alike by what light, codecs and the detector's own error do to it: an edge is off by an
//! amount in common, of the variance `e^2` ([`Scatter::edge`]), and its places are no more independent than that allows.
//! With W the precisions of its places about their edge (`p` is [`Scatter::place`])
//!
//! ```text
//! W = diag(w / (sigma^2 + p^2)),    (W^-1 + e^2 1 1')^-1 = W - W 1 1' W e^2 / (1 + e^2 1' W 1)
//! ```
//!
//! (Woodbury 1950), w being Tukey's weights, so that an edge of twenty places counts little more than one of five. p and e
//! are those of the median of places about their edge, and of edges about what the turn tells. Where a step is estimated,
//! e is none: what edges of unknown depth are off by is what tells it.
//!
//! Neighbours share more than that (one shelf, one shadow, one fault of the lens), so the covariance is that of the
//! delete-one jackknife over blocks of the image (Efron and Stein 1981), of whole edges.
//!
//! Other light, a clipped sky, another gamma move the middle of a blurred edge towards its dark or its bright side, by an
//! amount that its contrast and its level decide. Where most edges of one direction are bright above and dark below, that
//! is a tilt; so how it depends on contrast and level is estimated along with the turn, as [`EdgeOffset::tone`] has it.

use nalgebra::{DMatrix, DVector};

use crate::health::sigmas::sigmas;
use crate::health::turn::Turn;

/// Parameters of what light does to edges.
pub const TONE: usize = 3;
/// Parameters of a step.
pub const STEP: usize = 3;

/// What is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Estimated {
    /// The turn alone, of what light does not move.
    Turn,
    /// The turn, and what light does.
    TurnAndTone,
    /// Besides, a step of the camera beside its turn.
    Step,
}

/// How far an edge is, across itself, from where it is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeOffset {
    /// In pixels.
    pub offset: f64,
    /// Its noise, in pixels.
    pub sigma: f64,
    /// Derivatives of where the edge is, across itself, by a turn.
    pub turn: [f64; Turn::SIZE],
    /// How much the light on it may move it: its contrast towards the side that offsets count to, by powers of its level.
    pub tone: [f64; TONE],
    /// Derivatives by a step.
    pub step: [f64; STEP],
    /// Which part of the image it is in.
    pub block: usize,
    /// Of which edge it is one of several places; these stand one after the other.
    pub edge: Option<usize>,
}

/// What edges say together.
#[derive(Clone, Debug)]
pub struct TurnFit {
    /// The turn, then what light does, then the step, as far as they are estimated.
    pub estimate: DVector<f64>,
    /// Its covariance.
    pub covariance: DMatrix<f64>,
    /// What its covariance would be if nothing but their edge moved places alike: about what no estimate by these edges can
    /// be better than (Cramér 1946, Rao 1945).
    pub bound: DMatrix<f64>,
    /// Scatter of places beyond their own noise.
    pub scatter: Scatter,
    /// Weight of every place, 0 to 1: 0 where it is of something that moved by itself.
    pub weights: Vec<f64>,
    /// Blocks that tell anything.
    pub blocks: usize,
}

/// How far places are off beyond their own noise: standard deviations, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scatter {
    /// Of a place about its edge.
    pub place: f64,
    /// Of an edge, all its places alike.
    pub edge: f64,
}

/// Where Tukey's weights end, in scales: 95 % efficient where errors are normal.
const TUKEY: f64 = 4.685;
/// Of a normal number, the standard deviation over the median deviation.
const MEDIAN: f64 = 1.4826;
/// No offset is known better than this, in pixels.
const FINEST: f64 = 0.01;
/// What codecs and interpolation may move a whole image by, in pixels: it does not average.
const COMMON: f64 = 0.004;
/// What light moves an edge by, in pixels for a contrast of 1 in the logarithm of brightness: standard deviation.
const LIGHT: f64 = 0.3;
/// Rounds of weighing.
const ROUNDS: usize = 12;

impl Estimated {
    const fn unknowns(self) -> usize {
        match self {
            Self::Turn => Turn::SIZE,
            Self::TurnAndTone => Turn::SIZE + TONE,
            Self::Step => Turn::SIZE + TONE + STEP,
        }
    }
}

impl EdgeOffset {
    /// Derivatives by everything that may be estimated, in its order.
    fn by(&self, k: usize) -> f64 {
        const FROM: usize = Turn::SIZE + TONE;
        match k {
            0..Turn::SIZE => self.turn[k],
            Turn::SIZE..FROM => self.tone[k - Turn::SIZE],
            _ => self.step[k - FROM],
        }
    }

    /// The offset that these parameters tell.
    #[must_use]
    pub fn told(&self, estimate: &DVector<f64>) -> f64 {
        (0..estimate.len()).map(|k| self.by(k) * estimate[k]).sum()
    }
}

impl TurnFit {
    /// The fit; `None` where the edges do not determine it.
    #[must_use]
    pub fn new(offsets: &[EdgeOffset], of: Estimated) -> Option<Self> {
        let rows = Rows { offsets, unknowns: of.unknowns() };
        let mut estimate = rows.least_deviations()?;
        let mut weights = vec![1.0; offsets.len()];
        let mut precisions = Vec::new();
        let mut scatter = Scatter::default();
        for _ in 0..ROUNDS {
            let residuals = rows.residuals(&estimate);
            let together = excess(&residuals, offsets);
            let scale = |i: usize| offsets[i].sigma.hypot(together).max(FINEST);
            weights = (0..offsets.len()).map(|i| tukey(residuals[i] / scale(i))).collect();
            let of_edges = if of == Estimated::Step { None } else { rows.scatter(&residuals, &weights) };
            scatter = of_edges.unwrap_or(Scatter { place: together, edge: 0.0 });
            let precision = |i: usize| weights[i] / offsets[i].sigma.hypot(scatter.place).max(FINEST).powi(2);
            precisions = (0..offsets.len()).map(precision).collect();
            estimate = rows.sum(&precisions, scatter.edge).solved()?;
        }
        let all = rows.sum(&precisions, scatter.edge);
        let bound = all.believed().cholesky()?.inverse();
        let (covariance, blocks) = rows.jackknife(&all, &precisions, scatter.edge, &estimate)?;
        Some(Self { estimate, covariance, bound, scatter, weights, blocks })
    }

    /// The turn.
    #[must_use]
    pub fn turn(&self) -> Turn {
        Turn::of(std::array::from_fn(|i| self.estimate[i]))
    }

    /// The step; none where it is not estimated.
    #[must_use]
    pub fn step(&self) -> [f64; STEP] {
        const FROM: usize = Turn::SIZE + TONE;
        std::array::from_fn(|k| self.estimate.get(FROM + k).copied().unwrap_or_default())
    }

    /// As how many sigmas of a normal number it is improbable that parameters from one to before another are 0.
    ///
    /// The covariance is itself estimated from a few blocks: Hotelling's (1931) square is brought to a chi-square by its
    /// expectation, `(m - k - 1) / m`.
    #[must_use]
    pub fn clear(&self, from: usize, to: usize) -> f64 {
        let (count, blocks) = (to - from, self.blocks as f64);
        let part = self.covariance.view((from, from), (count, count)).into_owned();
        let estimate = self.estimate.rows(from, count).into_owned();
        let Some(inverse) = part.cholesky() else { return 0.0 };
        let square = estimate.dot(&inverse.solve(&estimate));
        let shrunk = square * ((blocks - count as f64 - 1.0) / blocks).max(0.0);
        sigmas(shrunk, count as f64)
    }
}

/// The places as rows of a linear system.
struct Rows<'a> {
    offsets: &'a [EdgeOffset],
    unknowns: usize,
}

impl Rows<'_> {
    fn residuals(&self, estimate: &DVector<f64>) -> Vec<f64> {
        self.offsets.iter().map(|row| row.offset - row.told(estimate)).collect()
    }

    /// Least absolute deviations by weighted least squares (Schlossmacher 1973).
    fn least_deviations(&self) -> Option<DVector<f64>> {
        /// Nearer than this to the estimate all deviations count the same, in pixels.
        const NEAR: f64 = 0.05;
        let mut estimate = DVector::zeros(self.unknowns);
        for _ in 0..ROUNDS {
            let residuals = self.residuals(&estimate);
            let weights: Vec<f64> = residuals.iter().map(|r| r.abs().max(NEAR).recip()).collect();
            estimate = self.sum(&weights, 0.0).solved()?;
        }
        Some(estimate)
    }

    /// The places of every edge, as ranges of all.
    fn edges(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        let edges = self.offsets.chunk_by(|a, b| a.edge.is_some() && a.edge == b.edge);
        edges.scan(0, |end, edge| {
            let start = std::mem::replace(end, *end + edge.len());
            Some(start..*end)
        })
    }

    /// Scatter of places about their edges, and of edges; `None` where too few edges have several places.
    fn scatter(&self, residuals: &[f64], weights: &[f64]) -> Option<Scatter> {
        /// Fewer places tell no scatter of their own.
        const PLACES: usize = 3;
        const EDGES: usize = 12;
        let (mut about, mut own, mut means, mut of_means) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for edge in self.edges() {
            let used: Vec<usize> = edge.filter(|&i| weights[i] > 0.0).collect();
            if used.len() < PLACES {
                continue;
            }
            let count = used.len() as f64;
            let mean = used.iter().map(|&i| residuals[i]).sum::<f64>() / count;
            let freedom = (count / (count - 1.0)).sqrt();
            about.extend(used.iter().map(|&i| freedom * (residuals[i] - mean)));
            own.extend(used.iter().map(|&i| self.offsets[i].sigma));
            means.push(mean);
            of_means.push(count);
        }
        if means.len() < EDGES {
            return None;
        }
        let deviation = |values: Vec<f64>| MEDIAN * median(values.iter().map(|value| value.abs()).collect());
        let place = deviation(about);
        let by_places = place * place / median(of_means);
        let edge = (deviation(means).powi(2) - by_places).max(0.0).sqrt();
        Some(Scatter { place: (place * place - median(own).powi(2)).max(0.0).sqrt(), edge })
    }

    fn sum(&self, precisions: &[f64], shared: f64) -> Sum {
        let mut sum = Sum::nothing(self.unknowns);
        self.edges().for_each(|edge| sum.add(&self.offsets[edge.clone()], &precisions[edge], shared));
        sum
    }

    /// Covariance by leaving out one block after the other, and how many blocks there are.
    fn jackknife(
        &self,
        all: &Sum,
        precisions: &[f64],
        shared: f64,
        estimate: &DVector<f64>,
    ) -> Option<(DMatrix<f64>, usize)> {
        let count = 1 + self.offsets.iter().map(|row| row.block).max()?;
        let mut parts: Vec<Sum> = (0..count).map(|_| Sum::nothing(self.unknowns)).collect();
        for edge in self.edges() {
            let block = self.offsets[edge.start + edge.len() / 2].block;
            parts[block].add(&self.offsets[edge.clone()], &precisions[edge], shared);
        }
        parts.retain(|part| part.information.trace() > 0.0);
        let mut covariance = DMatrix::zeros(self.unknowns, self.unknowns);
        for part in &parts {
            let without = all.without(part).solved()? - estimate;
            covariance += &without * without.transpose();
        }
        let blocks = parts.len();
        Some((covariance * ((blocks as f64 - 1.0) / blocks as f64) + all.of_common()?, blocks))
    }
}

/// Normal equations.
struct Sum {
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// Of an offset that all places have in common.
    precision: f64,
}

impl Sum {
    fn nothing(unknowns: usize) -> Self {
        Self {
            information: DMatrix::zeros(unknowns, unknowns),
            score: DVector::zeros(unknowns),
            precision: 0.0,
        }
    }

    /// The places of one edge, whose offset in common has the standard deviation `shared`.
    fn add(&mut self, edge: &[EdgeOffset], precisions: &[f64], shared: f64) {
        // W 1, W d and A' W 1.
        let (mut total, mut offset) = (0.0, 0.0);
        let mut together = DVector::zeros(self.score.len());
        for (row, &precision) in edge.iter().zip(precisions).filter(|(_, precision)| **precision > 0.0) {
            let by = DVector::from_fn(self.score.len(), |k, _| row.by(k));
            self.score.axpy(precision * row.offset, &by, 1.0);
            self.information.ger(precision, &by, &by, 1.0);
            together.axpy(precision, &by, 1.0);
            offset += precision * row.offset;
            total += precision;
        }
        let known = shared * shared / (1.0 + shared * shared * total);
        self.score.axpy(-known * offset, &together, 1.0);
        self.information.ger(-known, &together, &together, 1.0);
        self.precision += total - known * total * total;
    }

    /// What is believed of light before it is seen.
    fn believed(&self) -> DMatrix<f64> {
        let tone = Turn::SIZE..Turn::SIZE + TONE;
        let precision = |i: usize| if tone.contains(&i) { LIGHT.powi(-2) } else { 0.0 };
        &self.information
            + DMatrix::from_fn(
                self.score.len(),
                self.score.len(),
                |i, j| if i == j { precision(i) } else { 0.0 },
            )
    }

    /// The covariance that offsets in common to all places leave.
    fn of_common(&self) -> Option<DMatrix<f64>> {
        Some((self.believed() * (self.precision.recip() * COMMON.powi(-2))).cholesky()?.inverse())
    }

    fn without(&self, part: &Self) -> Self {
        let (information, score) = (&self.information - &part.information, &self.score - &part.score);
        Self { information, score, precision: self.precision - part.precision }
    }

    fn solved(&self) -> Option<DVector<f64>> {
        /// A parameter that edges tell less of than this share of what they tell of it alone is not told.
        const TOLD: f64 = 1e-9;
        // In units of what each is told by itself, so that radians and shares are alike.
        let information = self.believed();
        let units = information.diagonal().map(|value| value.max(f64::MIN_POSITIVE).sqrt().recip());
        let scaled =
            DMatrix::from_fn(units.len(), units.len(), |i, j| information[(i, j)] * units[i] * units[j]);
        let cholesky = scaled.cholesky()?;
        let is_told = cholesky.l_dirty().diagonal().iter().all(|pivot| pivot * pivot > TOLD);
        is_told.then(|| cholesky.solve(&self.score.component_mul(&units)).component_mul(&units))
    }
}

fn tukey(residual: f64) -> f64 {
    let share = residual / TUKEY;
    (1.0 - share * share).max(0.0).powi(2)
}

fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// What residuals scatter beyond the noise of their places, in pixels.
fn excess(residuals: &[f64], offsets: &[EdgeOffset]) -> f64 {
    let all = MEDIAN * median(residuals.iter().map(|r| r.abs()).collect());
    let own = median(offsets.iter().map(|row| row.sigma).collect());
    (all * all - own * own).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
    use crate::health::turn::ray_in_camera;
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

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

    fn normal(random: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| random.random_range(-0.5..0.5_f64)).sum()
    }

    /// An edge somewhere in a block of the image, where it was.
    fn edge(camera: &Camera, block: usize, random: &mut ChaCha8Rng) -> EdgeOffset {
        let u = 120.0 * ((block % COLUMNS) as f64 + random.random_range(0.0..1.0));
        let v = 90.0 * ((block / COLUMNS) as f64 + random.random_range(0.0..1.0));
        let angle = random.random_range(0.0..std::f64::consts::TAU);
        let contrast = if angle.sin() > 0.0 { 1.0 } else { random.random_range(-1.0..1.0) };
        place(camera, block, [u, v], angle, contrast)
    }

    /// A place of an edge, across which offsets count in the direction of an angle.
    fn place(camera: &Camera, block: usize, [u, v]: [f64; 2], angle: f64, contrast: f64) -> EdgeOffset {
        const ASIDE: f64 = 1e-6;
        let ray = ray_in_camera(camera, Pixel { u, v }).unwrap();
        let (sin, cos) = angle.sin_cos();
        let slope = |k: usize| {
            let mut step = [0.0; Turn::SIZE];
            step[k] = ASIDE;
            let there = Turn::of(step).at(camera).shown(ray).unwrap();
            ((there.u - u) * cos + (there.v - v) * sin) / ASIDE
        };
        EdgeOffset {
            offset: 0.0,
            sigma: 0.1,
            turn: std::array::from_fn(slope),
            tone: [contrast, 0.0, 0.0],
            step: [0.0; STEP],
            block,
            edge: None,
        }
    }

    /// Edges of three to twenty places, eight pixels apart, that share an offset of 0.08 px beside the noise of each.
    fn long_edges(camera: &Camera, truth: &[f64; 4], random: &mut ChaCha8Rng) -> Vec<EdgeOffset> {
        let mut all = Vec::new();
        for index in 0..4 * BLOCKS {
            let block = index / 4;
            let corner = [120.0 * (block % COLUMNS) as f64, 90.0 * (block / COLUMNS) as f64];
            let start =
                [corner[0] + random.random_range(0.0..120.0), corner[1] + random.random_range(0.0..90.0)];
            let (angle, contrast) =
                (random.random_range(0.0..std::f64::consts::TAU), random.random_range(-1.0..1.0));
            let shared = 0.08 * normal(random);
            for far in (0..random.random_range(3..=20)).map(|place| 8.0 * f64::from(place)) {
                let at = [start[0] - far * angle.sin(), start[1] + far * angle.cos()];
                let mut place = place(camera, block, at, angle, contrast);
                let told: f64 = (0..4).map(|k| place.turn[k] * truth[k]).sum();
                place.offset = told + shared + 0.1 * normal(random);
                place.edge = Some(index);
                all.push(place);
            }
        }
        all
    }

    /// Edges after a turn: with noise, noise that a block shares, light that moves them to the dark side, and a share
    /// of the blocks where something moved by itself.
    fn edges(truth: &[f64; 4], light: f64, moved: usize, random: &mut ChaCha8Rng) -> Vec<EdgeOffset> {
        let camera = camera();
        let mut all = Vec::new();
        for block in 0..BLOCKS {
            let shared = 0.05 * normal(random);
            for _ in 0..30 {
                let mut edge = edge(&camera, block, random);
                let told: f64 = (0..4).map(|k| edge.turn[k] * truth[k]).sum();
                let own = if block < moved { 3.0 } else { 0.0 };
                edge.offset = told + light * edge.tone[0] + shared + 0.1 * normal(random) + own;
                all.push(edge);
            }
        }
        all
    }

    #[test]
    fn intervals_hold_though_blocks_share_noise_light_changed_and_things_moved() {
        const TRIALS: usize = 150;
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut inside = 0;
        for _ in 0..TRIALS {
            let truth: [f64; 4] = std::array::from_fn(|_| 1e-3 * normal(&mut random));
            let fit = TurnFit::new(&edges(&truth, 0.1, 8, &mut random), Estimated::TurnAndTone).unwrap();
            let is_inside =
                |k: usize| (fit.estimate[k] - truth[k]).abs() < 1.96 * fit.covariance[(k, k)].sqrt();
            inside += (0..4).filter(|&k| is_inside(k)).count();
        }
        let share = inside as f64 / (4 * TRIALS) as f64;
        assert!((0.9..0.995).contains(&share), "{share} inside 95 %");
    }

    #[test]
    fn a_camera_that_stands_still_is_clearly_moved_in_few_trials() {
        const TRIALS: usize = 150;
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let clear = |_| {
            let fit = TurnFit::new(&edges(&[0.0; 4], 0.2, 6, &mut random), Estimated::TurnAndTone).unwrap();
            fit.clear(0, Turn::SIZE) > 3.0
        };
        let alarms = (0..TRIALS).map(clear).filter(|alarm| *alarm).count();
        assert!(alarms <= 2, "{alarms} of {TRIALS}");
    }

    #[test]
    fn errors_are_those_of_the_bound_where_the_places_of_an_edge_are_moved_alike() {
        const TRIALS: usize = 200;
        let (camera, mut random) = (camera(), ChaCha8Rng::seed_from_u64(6));
        let (mut squares, mut shared) = (0.0, 0.0);
        for _ in 0..TRIALS {
            let truth: [f64; 4] = std::array::from_fn(|_| 1e-3 * normal(&mut random));
            let offsets = long_edges(&camera, &truth, &mut random);
            let fit = TurnFit::new(&offsets, Estimated::TurnAndTone).unwrap();
            let bound = fit.bound.view((0, 0), (4, 4)).into_owned().cholesky().unwrap();
            let error = DVector::from_fn(4, |k, _| fit.estimate[k] - truth[k]);
            squares += error.dot(&bound.solve(&error)) / 4.0;
            shared += fit.scatter.edge / TRIALS as f64;
        }
        let over_bound = (squares / TRIALS as f64).sqrt();
        assert!((0.94..1.06).contains(&over_bound), "{over_bound} of the bound");
        assert!((0.06..0.1).contains(&shared), "{shared} px of an edge, 0.08 in truth");
    }

    #[test]
    fn what_edges_do_not_tell_is_not_estimated() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let one = edge(&camera(), 3, &mut random);
        assert!(TurnFit::new(&[one; 40], Estimated::Turn).is_none());
        assert!(TurnFit::new(&[], Estimated::TurnAndTone).is_none());
    }
}
