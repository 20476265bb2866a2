//! Automatic calibration of one image from its straight edges.
//!
//! 1. The lens is estimated from the curvature of single edges.
//! 2. Edges are undistorted and joined, and cameras are searched. The best cameras are refined as mixtures,
//!    with and without right angles.
//! 3. The most informative edges of the likeliest mixture, its strokes, are solved like annotations of an operator.
//! 4. The standard deviation of the focal length combines three parts: the standard deviation of the solution,
//!    the scatter of the other mixtures weighted by their evidence, and the uncertainty of the lens. This
//!    standard deviation determines the confidence, together with other checks.
//! 5. The strokes get the standard deviation with which their solution has this standard deviation of the focal
//!    length. Every later solve then includes the uncertainty of the automatic choice of edges.

use calib_core::single::{Known, PrincipalPointPrior};
use calib_core::{Code, ImageCircle, Kind, Lens, Orientation, Pixel};
use calib_site::{LensEntry, PrincipalPointEntry, SiteCamera, Solution, usual_pixel_aspect};

use super::confidence::{Confidence, Reason};
use super::curvature::LensEstimate;
use super::curved_edge::curved_edges;
use super::edge_class::classify_edges;
use super::frame::{level, with_nadir};
use super::join;
use super::join::Line;
use super::mixture::{CameraPrior, Mixture};
use super::quarter_turn::QuarterTurn;
use super::search::{Hypothesis, hypotheses};
use super::strokes::{Group, entry, groups, select_strokes, solve_entry, stroke};
use crate::bars::{Bars, ImageEdges};
use crate::line_segment::LineSegment;

/// Largest number of edges used, the longest first.
const MAX_LINES: usize = 400;
/// Smallest number of edges for a calibration.
const MIN_LINES: usize = 8;
/// Largest number of strokes of a calibration.
const MAX_STROKES: usize = 20;
/// Smallest log evidence of a calibration, relative to edges without directions. At 0, directions and no
/// directions are equally likely.
const MIN_LOG_EVIDENCE: f64 = 0.0;
/// Largest deviation of two floor directions from a right angle, in radians, for trying a right angle.
const MAX_RIGHT_ANGLE_DEVIATION: f64 = 0.4;
/// Largest relative standard deviation of the focal length with the confidence `sure`.
const MAX_SURE_FOCAL_SIGMA: f64 = 0.06;
/// Largest relative standard deviation of the focal length with the confidence `check`.
const MAX_CHECK_FOCAL_SIGMA: f64 = 0.10;
/// Relative standard deviation of an unknown focal length.
const UNKNOWN_FOCAL_SIGMA: f64 = 10.0;
/// Largest z-score of roll and focal length under the camera prior with the confidence `sure`.
const MAX_SURE_PRIOR_Z_SCORE: f64 = 2.0;
/// Largest z-score of roll and focal length under the camera prior with the confidence `check`.
const MAX_CHECK_PRIOR_Z_SCORE: f64 = 3.0;
/// Correction factor for the standard deviation of the solver. The solver underestimates it, because the
/// strokes of one edge share their errors.
const SIGMA_INFLATION: f64 = 1.6;
/// Largest standard deviation of a stroke, in pixels. Rejected calibrations reach it.
const MAX_STROKE_SIGMA_PX: f64 = 20.0;

/// Input of an automatic calibration: the edges of an image, its size, and the lens if known.
#[derive(Clone, Debug)]
pub struct EdgeImage {
    /// Straight edges, in raw pixels.
    pub segments: Vec<LineSegment>,
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Known values: focal length, data sheet, principal point, pixel aspect and roll; other values are not used. The
    /// roll decides between an upright camera and one that hangs upside down or on its side. An unknown principal
    /// point is at the centre of the image circle, or near the centre of the picture. Pixels of unknown aspect are
    /// assumed to be square.
    pub known: LensEntry,
    /// Black bars at the sides of the image.
    pub bars: Bars,
    /// Lens, if known; otherwise the distortion is estimated from the measured rises of the edges.
    pub lens: Option<Lens>,
    /// Image circle of a round image, in raw pixels; `None` if the scene fills the image.
    pub image_circle: Option<ImageCircle>,
}

/// Automatic calibration of an image.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AutomaticCalibration {
    /// Confidence of the calibration.
    pub confidence: Confidence,
    /// Reasons for a reduced confidence.
    pub reasons: Vec<Reason>,
    /// Suggested annotations, by direction; empty if no directions were found.
    pub groups: Vec<Group>,
    /// Edges curved by distortion, each a polyline in raw pixels, for fitting the distortion; empty if the
    /// lens is known or has no distortion.
    pub curved_edges: Vec<Vec<Pixel>>,
    /// Camera entry for a site file, with the suggested annotations and without an image; `None` if no
    /// directions were found.
    pub camera: Option<SiteCamera>,
    /// Solution of `camera`; `None` if it is not solvable or contradicts the edges.
    pub solution: Option<Solution>,
    /// Relative standard deviation of the focal length, including the effect of wrong groups.
    pub focal_sigma_rel: Option<f64>,
    /// Another camera that explains the edges nearly as well.
    pub alternative: Option<Alternative>,
}

/// Another camera that explains the edges of an image nearly as well as the best camera.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Alternative {
    /// Roll, pitch and focal length of the other camera.
    pub orientation: Orientation,
    /// Annotations of the edges that this camera explains, by direction.
    pub groups: Vec<Group>,
}

/// Edges under one lens, and the mixtures that explain them.
struct Grouping {
    lens: Lens,
    /// Joined and undistorted edges, the longest first.
    lines: Vec<Line>,
    /// Mixtures, the likeliest first.
    mixtures: Vec<Mixture>,
    /// Relative standard deviation that the uncertainty of the lens causes in the focal length of the likeliest
    /// mixture.
    lens_sigma: f64,
}

impl Grouping {
    /// Returns the suggested annotations of a mixture.
    fn groups_of(&self, mixture: &Mixture) -> Vec<Group> {
        let draw = |line: usize| stroke(&self.lines[line], &self.lens);
        groups(
            mixture,
            &select_strokes(mixture, &self.lines, MAX_STROKES),
            &draw,
            &classify_edges(mixture, &self.lines),
        )
    }

    /// Returns all mixtures except the likeliest, each with its log evidence relative to the likeliest
    /// mixture.
    fn others(&self) -> Vec<(f64, &Mixture)> {
        let Some((best, others)) = self.mixtures.split_first() else { return Vec::new() };
        others.iter().map(|other| (other.log_evidence - best.log_evidence, other)).collect()
    }
}

impl AutomaticCalibration {
    /// Calibrates an image from its edges. The camera is searched near a known roll. If the roll is unknown, the
    /// camera is assumed to be upright.
    #[must_use]
    pub fn new(image: &EdgeImage) -> Self {
        match image.upright() {
            Some((turn, upright)) => Self::of_upright(&upright).turned_back(turn, image),
            None => Self::of_upright(image),
        }
    }

    /// Converts the result for the image that was rotated by `turn` to the original `image`.
    fn turned_back(mut self, turn: QuarterTurn, image: &EdgeImage) -> Self {
        let back = turn.inverse();
        back.groups(&mut self.groups);
        back.polylines(&mut self.curved_edges);
        if let Some(other) = &mut self.alternative {
            back.groups(&mut other.groups);
            other.orientation.roll += turn.angle();
        }
        let Some(upright) = self.camera.take() else { return self };
        let mut camera = SiteCamera {
            annotations: self.groups.iter().map(|group| group.annotation.clone()).collect(),
            ..SiteCamera::new(upright.id, image.size)
        };
        let distortion = upright.lens.and_then(|lens| lens.distortion);
        camera.lens = Some(LensEntry { distortion, roll_deg: image.known.roll_deg, ..image.known_lens() });
        self.solution = self.solution.and_then(|_| solve_entry(&camera));
        if self.solution.is_none() {
            self.confidence = Confidence::None;
        }
        self.camera = Some(camera);
        self
    }

    /// Calibrates an image of an upright camera.
    fn of_upright(image: &EdgeImage) -> Self {
        if image.segments.len() < MIN_LINES {
            return Self::none(vec![Reason::FewEdges { found: image.segments.len() }]);
        }
        if image.image_circle.is_some() && image.lens.is_none() {
            return Self::none(vec![Reason::RoundImage]);
        }
        let grouping = image.group_edges();
        match grouping.mixtures.first() {
            Some(best) if best.log_evidence > MIN_LOG_EVIDENCE => {
                let straight = curved_edges(&grouping.lines, &image.segments, &grouping.lens);
                // The distortion of a known lens is not fitted.
                let straight = if image.lens.is_some() { Vec::new() } else { straight };
                let found = Self { curved_edges: straight, ..Self::from_grouping(&grouping, best, image) };
                found.compared_with_edges_alone(image)
            }
            _ => Self::none(vec![Reason::NoDirections]),
        }
    }

    /// Compares a calibration with a known focal length with the calibration by edges alone, and reduces the
    /// confidence if they differ. The known focal length decides which edges belong together, so the chosen edges alone
    /// do not show the contradiction.
    fn compared_with_edges_alone(mut self, image: &EdgeImage) -> Self {
        /// Difference of the log focal lengths, in standard deviations, above which the calibration is not `sure`.
        const MAX_SURE_DEVIATION: f64 = 2.0;
        /// Difference of the log focal lengths, in standard deviations, above which the confidence is `none`.
        const MAX_CHECK_DEVIATION: f64 = 3.0;
        let lens = image.lens.unwrap_or_else(|| image.pinhole());
        let Some(Known { value, sigma, .. }) = image.known_focal(&lens) else { return self };
        let known = image.known.without_known_focal();
        let alone = Self::of_upright(&EdgeImage { known, ..image.clone() });
        let Some((solution, alone_sigma)) = alone.solution.zip(alone.focal_sigma_rel) else { return self };
        let deviation =
            (value / solution.focal_px).ln().abs() / alone_sigma.hypot(sigma.unwrap_or(0.0) / value);
        if deviation > MAX_SURE_DEVIATION {
            let is_usable = deviation < MAX_CHECK_DEVIATION;
            self.confidence =
                self.confidence.max(if is_usable { Confidence::Check } else { Confidence::None });
            if !self.reasons.contains(&Reason::FocalConflict) {
                self.reasons.push(Reason::FocalConflict);
            }
        }
        self
    }

    /// Creates a result without a calibration, for these reasons.
    fn none(reasons: Vec<Reason>) -> Self {
        Self {
            confidence: Confidence::None,
            reasons,
            groups: Vec::new(),
            curved_edges: Vec::new(),
            camera: None,
            solution: None,
            focal_sigma_rel: None,
            alternative: None,
        }
    }

    /// Creates the result for the likeliest mixture `best` of an image.
    fn from_grouping(grouping: &Grouping, best: &Mixture, image: &EdgeImage) -> Self {
        let groups = grouping.groups_of(best);
        let camera = entry(image.size, &image.known_lens(), &grouping.lens, &groups);
        let mut proposal = Self { groups, ..Self::none(Vec::new()) };
        let Some(solution) = solve_entry(&camera) else {
            proposal.reasons = vec![Reason::NoVerticals];
            proposal.camera = Some(camera);
            return proposal;
        };
        if is_different_camera([solution.roll_deg, solution.pitch_deg], &best.camera) {
            // The strokes alone allow an implausible camera; its numbers would be mistaken for a result.
            proposal.reasons = vec![Reason::TwoHypotheses { focals: [best.camera.focal, solution.focal_px] }];
            proposal.camera = Some(camera);
            return proposal;
        }
        // An entered roll decides whether the camera lies on its side. It may be wrong if the camera looks up.
        let is_open = |reason: &Reason| image.known.roll_deg.is_none() || *reason != Reason::MayLieOnItsSide;
        let mount = doubtful_mount(best).filter(is_open);
        proposal.reasons.extend(image.doubts().into_iter().chain(mount));
        let scatter = Scatter::new(best, &grouping.others());
        let known = image.known_focal(&grouping.lens);
        let sigmas = FocalSigmas::new(&camera, &solution, scatter.sigma.hypot(grouping.lens_sigma), known);
        let unusual = image.prior(&grouping.lens).z_score(&best.camera);
        proposal.focal_sigma_rel = Some(sigmas.total);
        proposal.camera = Some(camera);
        proposal.solution = Some(solution.clone());
        let stroke_sigma = proposal.widen_strokes(sigmas.total);
        let alternative = proposal.set_confidence(sigmas, unusual, &scatter, &solution);
        proposal.alternative = alternative
            .map(|other| Alternative { orientation: other.camera, groups: grouping.groups_of(other) });
        let others = proposal.alternative.iter_mut().flat_map(|other| &mut other.groups);
        proposal
            .groups
            .iter_mut()
            .chain(others)
            .for_each(|group| group.annotation.sigma_px = Some(stroke_sigma));
        proposal
    }

    /// Sets the standard deviation `s` of the strokes so that the relative standard deviation `r` of the focal length in
    /// the solution is `target`, up to 3 %. Returns `s`, in pixels.
    ///
    /// `r^2` is almost linear in `s^2`: right angles and the principal point contribute a constant. Therefore `s^2` is
    /// found by the secant method. It starts from the present solution, with the usual standard deviation of 1 pixel.
    ///
    /// A fixed focal length has no standard deviation; the strokes then have the usual one of automatic edges.
    fn widen_strokes(&mut self, target: f64) -> f64 {
        /// Largest number of solves.
        const MAX_SOLVES: usize = 6;
        let Some(camera) = self.camera.as_mut() else { return SIGMA_INFLATION };
        let mut before = [1.0, self.solution.as_ref().and_then(relative_focal_sigma).unwrap_or(target)];
        let (mut solved, mut next) = (SIGMA_INFLATION, SIGMA_INFLATION);
        for _ in 0..MAX_SOLVES {
            camera.annotations.iter_mut().for_each(|annotation| annotation.sigma_px = Some(next));
            let Some(solution) = solve_entry(camera) else { break };
            let sigma = relative_focal_sigma(&solution);
            (self.solution, solved) = (Some(solution), next);
            let Some(sigma) = sigma.filter(|sigma| (target / sigma).ln().abs() > 0.03) else { break };
            next = next_stroke_sigma(before, [solved, sigma], target);
            before = [solved, sigma];
            if next == solved {
                break;
            }
        }
        camera.annotations.iter_mut().for_each(|annotation| annotation.sigma_px = Some(solved));
        solved
    }

    /// Sets the confidence and its reasons. Returns the rival mixture if it is one of the reasons.
    ///
    /// `first` is the solution with the usual standard deviation of the strokes. `unusual` is the z-score of the
    /// camera under its prior.
    fn set_confidence<'a>(
        &mut self,
        sigmas: FocalSigmas,
        unusual: f64,
        scatter: &Scatter<'a>,
        first: &Solution,
    ) -> Option<&'a Mixture> {
        let focal = self.solution.as_ref().unwrap_or(first).focal_px;
        let FocalSigmas { total: sigma, own, is_known } = sigmas;
        let missing = self.missing_directions(own, is_known);
        let is_complete = missing.is_none();
        self.reasons.extend(missing);
        if is_complete && own > MAX_SURE_FOCAL_SIGMA {
            self.reasons.push(Reason::FocalUncertain { sigma: own });
        }
        let rival = scatter.rival.filter(|_| sigma > MAX_SURE_FOCAL_SIGMA && scatter.sigma > 0.5 * own);
        if let Some(rival) = rival {
            self.reasons.push(Reason::TwoHypotheses { focals: [focal, rival.camera.focal] });
        }
        if unusual > MAX_SURE_PRIOR_Z_SCORE {
            self.reasons.push(Reason::Unusual { focal });
        }
        if first.has_warning(Code::Misfit) {
            let chi2_per_dof = first.chi2.unwrap_or(0.0) / first.dof.unwrap_or(1).max(1) as f64;
            self.reasons.push(Reason::Misfit { chi2_per_dof });
        }
        if first.has_warning(Code::FocalConflict) {
            self.reasons.push(Reason::FocalConflict);
        }
        if self.reasons.is_empty() && sigma >= MAX_SURE_FOCAL_SIGMA {
            self.reasons.push(Reason::FocalUncertain { sigma });
        }
        let is_plausible = is_complete && unusual < MAX_CHECK_PRIOR_Z_SCORE && sigma < MAX_CHECK_FOCAL_SIGMA;
        self.confidence = match self.reasons.is_empty() {
            true => Confidence::Sure,
            false if is_plausible => Confidence::Check,
            false => Confidence::None,
        };
        rival
    }

    /// Returns the reason for a reduced confidence if verticals or a second floor direction are missing. A known focal
    /// length replaces the second direction. `sigma` is the relative standard deviation of the focal length.
    fn missing_directions(&self, sigma: f64, is_focal_known: bool) -> Option<Reason> {
        let levels = self.groups.iter().filter(|group| group.annotation.kind == Kind::Parallel).count();
        let verticals = self.groups.iter().find(|group| group.annotation.kind == Kind::Vertical);
        if verticals.is_none_or(|group| group.probabilities.len() < 2) {
            return Some(Reason::NoVerticals);
        }
        (levels < if is_focal_known { 1 } else { 2 }).then_some(Reason::OneDirection { sigma })
    }
}

/// Scatter of the other mixtures about the likeliest one.
struct Scatter<'a> {
    /// Standard deviation of the log focal length over all mixtures, weighted by their evidence.
    sigma: f64,
    /// Mixture with the largest contribution to `sigma`.
    rival: Option<&'a Mixture>,
}

impl<'a> Scatter<'a> {
    fn new(best: &Mixture, others: &[(f64, &'a Mixture)]) -> Self {
        let parts = others.iter().map(|&(log_evidence, other)| {
            let weight = log_evidence.min(0.0).exp();
            (weight, weight * (other.camera.focal / best.camera.focal).ln().powi(2), other)
        });
        let parts: Vec<(f64, f64, &Mixture)> = parts.collect();
        let all: f64 = 1.0 + parts.iter().map(|(weight, ..)| weight).sum::<f64>();
        let sigma = (parts.iter().map(|(_, square, _)| square).sum::<f64>() / all).sqrt();
        let rival = parts.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(_, _, other)| other);
        Self { sigma, rival }
    }
}

impl EdgeImage {
    /// Creates the input from the edges and the width and height of an image, in pixels; the lens is unknown.
    #[must_use]
    pub fn new(segments: Vec<LineSegment>, size: [u32; 2]) -> Self {
        Self { segments, size, known: LensEntry::default(), bars: Bars::NONE, lens: None, image_circle: None }
    }

    /// Adds the bars of the image: edges of a bar are not used, and the principal point is near the centre of
    /// the picture between the bars.
    #[must_use]
    pub fn with_bars(mut self, bars: Bars) -> Self {
        let size = self.size;
        self.segments.retain(|segment| segment.ends.iter().all(|&end| bars.is_in_picture(end, size)));
        self.bars = bars;
        self
    }

    /// Creates the input for a camera of a site. The lens is known if the site specifies the distortion.
    #[must_use]
    pub fn from_camera(camera: &SiteCamera, edges: ImageEdges) -> Self {
        let given = camera.lens.as_ref().and_then(|lens| lens.distortion.as_ref());
        let is_known = given.is_some_and(|distortion| distortion.distortion().is_some());
        let roll_deg = camera.lens.as_ref().and_then(|lens| lens.roll_deg);
        Self {
            known: LensEntry { roll_deg, ..camera.known_lens() },
            lens: is_known.then(|| camera.lens()),
            image_circle: camera.image_circle(),
            ..Self::new(edges.segments, camera.size_px).with_bars(edges.bars)
        }
    }

    /// Returns the image rotated by quarter turns so that the camera is upright, with the rotation. `None` if the roll is
    /// near 0 or unknown, or if the lens cannot be rotated: without square pixels or with terms that are not symmetric
    /// about the axis.
    fn upright(&self) -> Option<(QuarterTurn, Self)> {
        let turn = QuarterTurn::of_roll(self.known.roll_deg?.value, self.size);
        // Round images without a lens are refused.
        if turn.is_none() || self.image_circle.is_some() && self.lens.is_none() {
            return None;
        }
        let lens = match &self.lens {
            Some(lens) => Some(turn.lens(lens)?),
            None => None,
        };
        let is_square = self.known.pixel_aspect.is_none();
        if turn.is_on_side() && !is_square {
            return None;
        }
        // The fields of view of a data sheet belong to the sides of the image, so the focal length in pixels is used.
        let under = self.lens.unwrap_or_else(|| self.pinhole());
        let known = LensEntry {
            focal_px: self.known_focal(&under),
            principal_point_px: self.known_centre().map(|entry| turn.principal_point(entry)),
            pixel_aspect: self.known.pixel_aspect,
            roll_deg: self
                .known
                .roll_deg
                .map(|roll| Known { value: roll.value - turn.angle().to_degrees(), ..roll }),
            ..LensEntry::default()
        };
        let upright = Self {
            segments: self.segments.iter().map(|segment| turn.segment(segment)).collect(),
            size: turn.turned_size(),
            known,
            bars: turn.bars(self.bars),
            lens,
            // The centre of the circle is the principal point above.
            image_circle: None,
        };
        Some((turn, upright))
    }

    /// Returns the reason to doubt that the pixels are square, if their aspect is unknown.
    fn pixel_doubt(&self) -> Option<Reason> {
        let aspect = usual_pixel_aspect(self.size).filter(|_| self.known.pixel_aspect.is_none())?;
        Some(Reason::PixelsNotSquare { aspect })
    }

    /// Returns the entered principal point, otherwise the centre of the image circle.
    fn known_centre(&self) -> Option<PrincipalPointEntry> {
        let of_circle = || self.image_circle.map(|circle| PrincipalPointEntry::known(circle.centre()));
        self.known.principal_point_px.or_else(of_circle)
    }

    /// Returns the principal point for the site file: the entered one, otherwise the centre of the
    /// image circle, otherwise the centre between unequal bars. `None` if none of these is available.
    fn principal_point_entry(&self) -> Option<PrincipalPointEntry> {
        let [w, h] = self.bars.picture_size(self.size).map(f64::from);
        let off_centre = PrincipalPointEntry {
            value: self.bars.picture_centre(self.size),
            sigma: Some(PrincipalPointPrior::of_image([w, h]).sigma),
        };
        self.known_centre().or_else(|| (!self.bars.are_symmetric()).then_some(off_centre))
    }

    /// Returns the reasons for a reduced confidence that follow from the size and the bars of the image.
    fn doubts(&self) -> Vec<Reason> {
        let bars = (!self.bars.are_symmetric()).then_some(Reason::Bars { bars: self.bars });
        self.pixel_doubt().into_iter().chain(bars).collect()
    }

    /// Returns the width of the picture between the bars, in pixels.
    fn picture_width(&self) -> f64 {
        f64::from(self.bars.picture_size(self.size)[0])
    }

    /// Returns the prior of cameras for this image under a lens.
    fn prior(&self, lens: &Lens) -> CameraPrior {
        CameraPrior::new(self.picture_width(), self.known_focal(lens))
    }

    /// Returns the known focal length under a lens, in pixels.
    fn known_focal(&self, lens: &Lens) -> Option<Known> {
        let known = Some(self.known.clone());
        SiteCamera { lens: known, ..SiteCamera::new("still", self.size) }.known_focal(lens)
    }

    /// Returns the known values of the lens for a site file, with the principal point and without the roll. The edges
    /// determine the roll.
    fn known_lens(&self) -> LensEntry {
        LensEntry { principal_point_px: self.principal_point_entry(), roll_deg: None, ..self.known.clone() }
    }

    /// Returns the width and height, in pixels.
    fn sides(&self) -> [f64; 2] {
        self.size.map(f64::from)
    }

    /// Returns the lens without distortion: with the principal point or the image centre, and with the pixel
    /// aspect or square pixels.
    fn pinhole(&self) -> Lens {
        let centre =
            self.known_centre().map_or_else(|| self.bars.picture_centre(self.size), |entry| entry.value);
        let aspect = self.known.pixel_aspect.map_or(1.0, |entry| entry.start(self.size));
        Lens { pixel_aspect: aspect, ..Lens::pinhole(centre) }
    }

    /// Joins and groups the edges under the known or estimated lens.
    fn group_edges(&self) -> Grouping {
        let LensEstimate { lens, deviating } = match self.lens {
            Some(lens) => LensEstimate::known(lens),
            None => LensEstimate::from_rises(&self.segments, self.pinhole(), self.sides()),
        };
        let lines = self.lines(&lens);
        let prior = self.prior(&lens);
        let found = hypotheses(&lines, self.picture_width(), &prior);
        let mut mixtures: Vec<Mixture> =
            found.iter().flat_map(|hypothesis| variants(&lines, hypothesis, &prior)).collect();
        mixtures.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        let square = |best: &Mixture| -> f64 {
            deviating.iter().map(|other| self.log_focal_change(best, other).powi(2)).sum()
        };
        let lens_sigma = mixtures.first().map_or(0.0, square).sqrt();
        Grouping { lens, lines, mixtures, lens_sigma }
    }

    /// Returns the change of the log focal length of a mixture under another lens.
    fn log_focal_change(&self, best: &Mixture, lens: &Lens) -> f64 {
        let prior = self.prior(lens);
        let start = (best.camera, best.azimuths.clone(), best.right_angles.clone());
        let other = Mixture::fit(&self.lines(lens), start, &prior);
        other.map_or(UNKNOWN_FOCAL_SIGMA, |other| (other.camera.focal / best.camera.focal).ln())
    }

    /// Undistorts and joins the edges, the longest first.
    fn lines(&self, lens: &Lens) -> Vec<Line> {
        let mut lines = join::lines(&self.segments, lens);
        lines.truncate(MAX_LINES);
        lines
    }
}

/// Relative standard deviations of the focal length.
#[derive(Clone, Copy)]
struct FocalSigmas {
    /// Standard deviation with all its parts.
    total: f64,
    /// Part from the solution, without the choice of edges and without the lens.
    own: f64,
    /// Whether a known focal length contributes.
    is_known: bool,
}

impl FocalSigmas {
    /// Returns the standard deviations of a solved camera entry. `of_choice` is the part from the choice of edges and from
    /// the lens. `known` is the known focal length; it limits all parts.
    fn new(camera: &SiteCamera, solution: &Solution, of_choice: f64, known: Option<Known>) -> Self {
        let Some(Known { value, sigma, .. }) = known else {
            let own = own_focal_sigma(camera, solution);
            return Self { total: own.hypot(of_choice), own, is_known: false };
        };
        let of_known = (sigma.unwrap_or(0.0) / value).max(1e-6);
        let limited = |sigma: f64| (sigma.powi(-2) + of_known.powi(-2)).powf(-0.5);
        let mut alone = camera.clone();
        if let Some(lens) = &mut alone.lens {
            *lens = lens.without_known_focal();
        }
        let own =
            solve_entry(&alone).map_or(UNKNOWN_FOCAL_SIGMA, |solution| own_focal_sigma(&alone, &solution));
        Self { total: limited(own.hypot(of_choice)), own: limited(own), is_known: true }
    }
}

/// Returns the relative standard deviation of the focal length of the solution of a camera entry.
///
/// The strokes have common errors that the solver treats as independent. Therefore the part from the lines is
/// multiplied by [`SIGMA_INFLATION`]. The part from the uncertainty of the principal point is not. A second solution
/// with a fixed principal point separates both parts.
fn own_focal_sigma(camera: &SiteCamera, solution: &Solution) -> f64 {
    let mut fixed = camera.clone();
    let centre = PrincipalPointEntry::known(camera.principal_point());
    fixed.lens.get_or_insert_default().principal_point_px = Some(centre);
    let relative = |solution: &Solution| relative_focal_sigma(solution).unwrap_or(UNKNOWN_FOCAL_SIGMA);
    let whole = relative(solution);
    // A known principal point is fixed already.
    let is_fixed = fixed == *camera;
    let with_fixed = || solve_entry(&fixed).as_ref().map_or(whole, relative);
    let lines = if is_fixed { whole } else { with_fixed().min(whole) };
    let of_centre = (whole * whole - lines * lines).max(0.0);
    (SIGMA_INFLATION * lines).hypot(of_centre.sqrt()).min(UNKNOWN_FOCAL_SIGMA)
}

/// Returns the relative standard deviation of the focal length of a solution; `None` if the focal length is fixed.
fn relative_focal_sigma(solution: &Solution) -> Option<f64> {
    let sigma = solution.sigma.as_ref()?.focal_px?;
    Some((sigma / solution.focal_px).min(UNKNOWN_FOCAL_SIGMA))
}

/// Returns the next standard deviation of the strokes by the secant method, in pixels. Each pair contains a standard
/// deviation of the strokes, and the resulting relative standard deviation of the focal length.
fn next_stroke_sigma([s0, r0]: [f64; 2], [s1, r1]: [f64; 2], target: f64) -> f64 {
    /// Largest factor of one step, also if the solution depends little on the strokes.
    const MAX_FACTOR: f64 = 4.0;
    let slope = (r1.powi(2) - r0.powi(2)) / (s1.powi(2) - s0.powi(2));
    let square = 1.0 + (target.powi(2) - r1.powi(2)) / (slope * s1.powi(2));
    let factor = match slope > 0.0 {
        true => square.max(0.0).sqrt(),
        false if r1 < target => MAX_FACTOR,
        false => MAX_FACTOR.recip(),
    };
    let next = s1 * factor.clamp(MAX_FACTOR.recip(), MAX_FACTOR);
    (100.0 * next.clamp(1.0, MAX_STROKE_SIGMA_PX)).round() / 100.0
}

/// Whether the solution of the strokes differs from the camera of all edges in roll or pitch by more than
/// noise, for example upside down.
fn is_different_camera(found_deg: [Option<f64>; 2], camera: &Orientation) -> bool {
    /// Largest accepted difference of roll and pitch, in radians.
    const MAX_ANGLE_DIFFERENCE: f64 = 0.5;
    let differs = |found: Option<f64>, own: f64| {
        found.is_some_and(|found| (found.to_radians() - own).abs() > MAX_ANGLE_DIFFERENCE)
    };
    differs(found_deg[0], camera.roll) || differs(found_deg[1], camera.pitch)
}

/// Returns the reason for a reduced confidence if the camera may not be mounted upright, otherwise `None`. The edges
/// of a scene also fit a camera that is rotated by 90 or 180 degrees. The pose is therefore doubtful if the pose of
/// the rotated camera is usual, too.
fn doubtful_mount(mixture: &Mixture) -> Option<Reason> {
    /// Pitch below which a camera that hangs upside down is as likely as a camera that looks up, in radians.
    const MIN_USUAL_PITCH_RAD: f64 = -0.17;
    /// Largest deviation of the roll of a camera on its side from 90 degrees, in radians.
    const MAX_SIDE_ROLL_RAD: f64 = 0.035;
    /// Pitches at which a camera on its side usually looks down, in radians.
    const SIDE_PITCHES_RAD: std::ops::Range<f64> = 0.09..1.2;
    let camera = &mixture.camera;
    if camera.pitch < MIN_USUAL_PITCH_RAD {
        return Some(Reason::MayBeUpsideDown { pitch_deg: camera.pitch.to_degrees() });
    }
    let lies_on_side = |&azimuth: &f64| {
        let turned = with_nadir(level(camera, azimuth), camera.focal);
        (turned.roll.abs() - std::f64::consts::FRAC_PI_2).abs() < MAX_SIDE_ROLL_RAD
            && SIDE_PITCHES_RAD.contains(&turned.pitch.abs())
    };
    mixture.azimuths.iter().any(lies_on_side).then_some(Reason::MayLieOnItsSide)
}

/// Returns the mixtures of a hypothesis: without a right angle, and with each possible right angle.
fn variants(lines: &[Line], hypothesis: &Hypothesis, prior: &CameraPrior) -> Vec<Mixture> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let azimuths = &hypothesis.azimuths;
    let pairs = (0..azimuths.len()).flat_map(|b| (0..b).map(move |a| [a, b]));
    let is_square = |&[a, b]: &[usize; 2]| {
        ((azimuths[b] - azimuths[a]).rem_euclid(PI) - FRAC_PI_2).abs() < MAX_RIGHT_ANGLE_DEVIATION
    };
    let ties = std::iter::once(Vec::new()).chain(pairs.filter(is_square).map(|pair| vec![pair]));
    ties.filter_map(|tied| Mixture::fit(lines, (hypothesis.camera, azimuths.clone(), tied), prior)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upside_down_solution_is_another_camera() {
        let camera = Orientation { roll: -0.03, pitch: 0.4, focal: 1000.0 };
        assert!(!is_different_camera([Some(1.5), Some(25.0)], &camera), "a difference within noise");
        assert!(is_different_camera([Some(169.0), Some(20.0)], &camera), "upside down");
        assert!(is_different_camera([Some(-2.0), Some(70.0)], &camera), "looking down");
    }
}
