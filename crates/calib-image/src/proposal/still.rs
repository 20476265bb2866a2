//! From the edges of a still to what it proposes.
//!
//! 1. Under a few distortions: edges joined, cameras sought, the best worked out as mixtures, with and without right
//!    angles. Where a lens that bends makes the grouping much likelier, its k1 is refined.
//! 2. The strokes of the likeliest mixture are solved as an operator's would be.
//! 3. The sigma of the focal is that of the solve and, beside it, how far the other mixtures are from this one, by
//!    their evidence; the verdict follows from it.

use calib_core::{Lens, Orientation, Pixel, SiteCamera, Solution};

use super::belief::Belief;
use super::drawn::{Group, entry, groups, solved, stroke};
use super::line::Line;
use super::line_segment::LineSegment;
use super::mixture::Mixture;
use super::search::{Hypothesis, hypotheses};
use super::strokes::strokes;
use super::verdict::{Reason, Verdict};
use super::{bend, join};

/// Edges that are worked with, the longest ones.
const MOST_LINES: usize = 400;
/// Fewer edges propose nothing.
const LEAST_LINES: usize = 8;
/// Strokes that are shown at most.
const STROKES: usize = 20;
/// Log evidence against edges of no direction that a proposal needs.
const LEAST_EVIDENCE: f64 = 25.0;
/// How many edges say the same: the edges of one door are not as independent as the likelihood has them.
const ALIKE: f64 = 4.0;
/// Floor directions that are nearer to a right angle than this, in radians, may be at right angles.
const NEARLY_SQUARE: f64 = 0.4;
/// Relative standard deviation of the focal up to which a proposal is sure, and up to which there is one.
const SURE: f64 = 0.06;
const CHECK: f64 = 0.10;
/// By how much the solve underestimates its sigma: strokes of edges share what is wrong with them.
const WIDENING: f64 = 1.2;

/// What is known of a still: its edges, its size, and the lens if somebody knows it.
#[derive(Clone, Debug)]
pub struct Still {
    /// Straight edges, raw pixels.
    pub segments: Vec<LineSegment>,
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Principal point, raw pixel; the centre if absent.
    pub principal_point: Option<Pixel>,
    /// The lens, where it is known; else its distortion is found with the grouping.
    pub lens: Option<Lens>,
}

/// What a still proposes.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// Whether to believe it.
    pub verdict: Verdict,
    /// Why it is not sure.
    pub reasons: Vec<Reason>,
    /// The strokes, direction by direction; empty where nothing was found.
    pub groups: Vec<Group>,
    /// The camera as it would be drawn, without an image.
    pub camera: Option<SiteCamera>,
    /// What the solve makes of it.
    pub solution: Option<Solution>,
    /// Relative standard deviation of the focal, wrong groups included.
    pub focal_sigma_rel: Option<f64>,
    /// Another camera that explains the edges nearly as well.
    pub alternative: Option<Orientation>,
}

/// All mixtures under one lens, the likeliest first.
struct Grouping {
    lens: Lens,
    k1: f64,
    lines: Vec<Line>,
    mixtures: Vec<Mixture>,
}

impl Grouping {
    fn log_evidence(&self) -> Option<f64> {
        Some(self.mixtures.first()?.log_evidence + bend::log_density(self.k1))
    }
}

impl Proposal {
    /// The proposal of a still.
    #[must_use]
    pub fn new(still: &Still) -> Self {
        if still.segments.len() < LEAST_LINES {
            return Self::none(vec![Reason::FewEdges { found: still.segments.len() }]);
        }
        let Some((grouping, others)) = still.grouping() else {
            return Self::none(vec![Reason::NoDirections]);
        };
        match grouping.mixtures.first() {
            Some(best) if best.log_evidence > LEAST_EVIDENCE => Self::of(&grouping, best, &others, still.size),
            _ => Self::none(vec![Reason::NoDirections]),
        }
    }

    fn none(reasons: Vec<Reason>) -> Self {
        Self {
            verdict: Verdict::None,
            reasons,
            groups: Vec::new(),
            camera: None,
            solution: None,
            focal_sigma_rel: None,
            alternative: None,
        }
    }

    /// The proposal of the likeliest mixture; `others` are the rest with their log evidence less its own.
    fn of(grouping: &Grouping, best: &Mixture, others: &[(f64, Orientation)], size: [u32; 2]) -> Self {
        let chosen = strokes(best, &grouping.lines, STROKES);
        let draw = |line: usize| stroke(&grouping.lines[line], &grouping.lens);
        let groups = groups(best, &chosen, &draw);
        let camera = entry(size, &grouping.lens, &groups);
        let mut proposal = Self { groups, ..Self::none(Vec::new()) };
        let Some(solution) = solved(&camera) else {
            proposal.reasons = vec![Reason::NoVerticals];
            proposal.camera = Some(camera);
            return proposal;
        };
        let scatter = Scatter::new(best, others);
        let own = solution.sigma.as_ref().and_then(|sigma| sigma.focal_px).unwrap_or(f64::INFINITY);
        let own = WIDENING * own / solution.focal_px;
        let sigma = own.hypot(scatter.sigma);
        proposal.judge(sigma, own, &scatter, &solution);
        proposal.focal_sigma_rel = Some(sigma);
        proposal.camera = Some(camera);
        proposal.solution = Some(solution);
        proposal
    }

    /// The verdict, with what speaks against it.
    fn judge(&mut self, sigma: f64, own: f64, scatter: &Scatter, solution: &Solution) {
        let directions = self.groups.iter().filter(|group| group.annotation.id.is_some()).count();
        if own > SURE {
            self.reasons.push(match directions {
                0 | 1 => Reason::OneDirection { sigma: own },
                _ => Reason::FocalOpen { sigma: own },
            });
        }
        if let Some(rival) = scatter.rival.filter(|_| sigma > SURE && scatter.sigma > 0.5 * own) {
            self.reasons.push(Reason::TwoHypotheses { focals: [solution.focal_px, rival.focal] });
            self.alternative = Some(rival);
        }
        let chi2_per_dof = solution.chi2.unwrap_or(0.0) / solution.dof.unwrap_or(1).max(1) as f64;
        if solution.warnings.iter().any(|warning| warning.code == calib_core::Code::Misfit) {
            self.reasons.push(Reason::Misfit { chi2_per_dof });
        }
        self.verdict = match sigma {
            sigma if sigma < SURE && self.reasons.is_empty() => Verdict::Sure,
            sigma if sigma < CHECK => Verdict::Check,
            _ => Verdict::None,
        };
    }
}

/// How far the other mixtures are from the likeliest one.
struct Scatter {
    /// Standard deviation of the log focal over all of them, by their evidence.
    sigma: f64,
    /// The one that adds most.
    rival: Option<Orientation>,
}

impl Scatter {
    fn new(best: &Mixture, others: &[(f64, Orientation)]) -> Self {
        let parts = others.iter().map(|(log_evidence, camera)| {
            let weight = (log_evidence / ALIKE).min(0.0).exp();
            (weight, weight * (camera.focal / best.camera.focal).ln().powi(2), *camera)
        });
        let parts: Vec<(f64, f64, Orientation)> = parts.collect();
        let all: f64 = 1.0 + parts.iter().map(|(weight, ..)| weight).sum::<f64>();
        let sigma = (parts.iter().map(|(_, square, _)| square).sum::<f64>() / all).sqrt();
        let rival = parts.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(_, _, camera)| camera);
        Self { sigma, rival }
    }
}

impl Still {
    /// The likeliest grouping, and all other cameras with their log evidence less its own.
    fn grouping(&self) -> Option<(Grouping, Vec<(f64, Orientation)>)> {
        let tried: Vec<Grouping> = match self.lens {
            Some(lens) => vec![self.grouped(lens, 0.0)],
            None => bend::COARSE.iter().map(|&k1| self.bent(k1)).collect(),
        };
        let score = |grouping: &Grouping| grouping.log_evidence().unwrap_or(f64::NEG_INFINITY);
        let straight = score(tried.first()?);
        let best = (0..tried.len()).max_by(|&a, &b| score(&tried[a]).total_cmp(&score(&tried[b])))?;
        let best = if score(&tried[best]) > straight + bend::LEAST_GAIN { best } else { 0 };
        let refined = (best > 0).then(|| self.refined(&tried[best]));
        let mut all = tried;
        let chosen = refined.unwrap_or_else(|| all.swap_remove(best));
        let most = chosen.mixtures.first()?.log_evidence;
        let own = chosen.mixtures.iter().skip(1);
        let others = own.map(|mixture| (mixture.log_evidence - most, mixture.camera)).collect();
        Some((chosen, others))
    }

    fn centre(&self) -> Pixel {
        let [w, h] = self.size.map(f64::from);
        self.principal_point.unwrap_or(Pixel::new(0.5 * w, 0.5 * h))
    }

    fn bent(&self, k1: f64) -> Grouping {
        self.grouped(bend::lens(k1, self.centre(), self.size.map(f64::from)), k1)
    }

    /// Edges joined and grouped under a lens.
    fn grouped(&self, lens: Lens, k1: f64) -> Grouping {
        let lines = self.lines(&lens);
        let belief = Belief::of_width(f64::from(self.size[0]));
        let found = hypotheses(&lines, f64::from(self.size[0]), &belief);
        let mut mixtures: Vec<Mixture> =
            found.iter().flat_map(|hypothesis| variants(&lines, hypothesis, &belief)).collect();
        mixtures.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        Grouping { lens, k1, lines, mixtures }
    }

    fn lines(&self, lens: &Lens) -> Vec<Line> {
        let mut lines = join::lines(&self.segments, lens);
        lines.truncate(MOST_LINES);
        lines
    }

    /// The same grouping under the distortion that makes it likeliest.
    fn refined(&self, coarse: &Grouping) -> Grouping {
        let belief = Belief::of_width(f64::from(self.size[0]));
        let size = self.size.map(f64::from);
        let score = |k1: f64| {
            let lines = self.lines(&bend::lens(k1, self.centre(), size));
            let best = coarse.mixtures.first()?;
            let start = (best.camera, best.azimuths.clone(), best.tied.clone());
            Some(Mixture::fitted(&lines, start, &belief)?.log_evidence + bend::log_density(k1))
        };
        let (k1, _) = bend::refined((coarse.k1, coarse.log_evidence().unwrap_or(f64::NEG_INFINITY)), score);
        self.bent(k1)
    }
}

/// The mixtures of a hypothesis: with no right angle, and with each that may be one.
fn variants(lines: &[Line], hypothesis: &Hypothesis, belief: &Belief) -> Vec<Mixture> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let azimuths = &hypothesis.azimuths;
    let pairs = (0..azimuths.len()).flat_map(|b| (0..b).map(move |a| [a, b]));
    let is_square =
        |&[a, b]: &[usize; 2]| ((azimuths[b] - azimuths[a]).rem_euclid(PI) - FRAC_PI_2).abs() < NEARLY_SQUARE;
    let ties = std::iter::once(Vec::new()).chain(pairs.filter(is_square).map(|pair| vec![pair]));
    ties.filter_map(|tied| Mixture::fitted(lines, (hypothesis.camera, azimuths.clone(), tied), belief)).collect()
}
