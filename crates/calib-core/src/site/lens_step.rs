//! The lens of a camera entry: given, fitted to its straight edges, or that of another camera.

use crate::camera::{Coefficient, Distortion, Lens};
use crate::finding::{Code, Warning};
use crate::single::{
    Annotation, Edge, Fitted, LensFit, LensOptions, Source, is_misfit, line_name, straightness_rms,
};
use crate::site::document::{Site, SiteCamera};
use crate::site::lens_cache::LensCache;
use crate::site::solution::DistortionEntry;

/// The lens of a camera, and what its straight edges said.
#[derive(Clone, Debug)]
pub(crate) struct LensEstimate {
    pub(crate) lens: Lens,
    /// Where it was fitted.
    pub(crate) fit: Option<LensFit>,
    /// Root mean square distance of every polyline from straight, in raw pixels.
    pub(crate) straightness: Vec<(Source, f64)>,
}

/// What a distortion entry asks to be fitted; `None` when its coefficients are given.
fn asked(entry: &DistortionEntry) -> Option<Fitted> {
    if entry.distortion().is_some() {
        return None;
    }
    let row = entry.model.row();
    let wanted = |index: usize, named: &Coefficient| match &entry.fit {
        Some(list) => list.contains(named),
        None => index < row.usual,
    };
    let mut which = [false; Distortion::MOST];
    for (index, named) in row.coefficients.iter().enumerate() {
        which[index] = wanted(index, named);
    }
    if row.in_order {
        let last = which.iter().rposition(|&is| is).unwrap_or(0);
        which[..=last].fill(true);
    }
    Some(Fitted { model: entry.model, which })
}

/// Lines of three points and more, of whatever kind, that are not switched off.
pub(crate) fn edges(annotations: &[Annotation]) -> Vec<Edge> {
    let used = annotations.iter().enumerate().filter(|(_, a)| !a.off);
    used.flat_map(|(annotation, drawn)| {
        let lines = drawn.polylines().enumerate().filter(|(_, points)| points.len() > 2);
        lines
            .map(move |(segment, points)| Edge { points, source: Source { annotation, segment } })
            .collect::<Vec<_>>()
    })
    .collect()
}

impl Site {
    /// The lens of a camera: its own, or that of the camera it is like.
    pub(crate) fn lens_estimate(&self, entry: &SiteCamera, lenses: &LensCache) -> LensEstimate {
        let like = entry.lens.as_ref().and_then(|lens| lens.like.as_ref()).and_then(|id| self.camera(id));
        let owner = like.unwrap_or(entry);
        let mut lens_estimate = self.own_lens_estimate(owner, lenses);
        lens_estimate.lens.principal_point = entry.principal_point();
        if like.is_some() {
            lens_estimate.fit = None;
        }
        lens_estimate.straightness =
            lens_estimate.straightness_under(&lens_estimate.lens, &entry.annotations);
        lens_estimate
    }

    fn own_lens_estimate(&self, entry: &SiteCamera, lenses: &LensCache) -> LensEstimate {
        if let Some(solution) = entry.solution.as_ref().filter(|_| entry.is_given()) {
            return LensEstimate { lens: solution.lens(), fit: None, straightness: Vec::new() };
        }
        let fit = self.lens_question(entry).and_then(|(edges, options)| lenses.fit(&edges, &options));
        let lens = fit.as_ref().map_or_else(|| entry.lens(), |fit| fit.lens);
        LensEstimate { lens, fit, straightness: Vec::new() }
    }

    /// The edges from which the lens of a camera is fitted, and what is asked; `None` where it is given.
    fn lens_question(&self, entry: &SiteCamera) -> Option<(Vec<Edge>, LensOptions)> {
        let distortion = entry.lens.as_ref().and_then(|lens| lens.distortion.as_ref());
        let fitted = distortion.map(asked);
        // Without polylines, lines that happen to have a third point are not asked about the lens.
        let straight = entry.annotations.iter().any(|a| a.is_straight_edge() && !a.off);
        if fitted == Some(None) || !straight && fitted.is_none() || entry.is_given() {
            return None;
        }
        let fitted = fitted.flatten();
        let focal = entry.lens.as_ref().and_then(|lens| lens.focal_px).map(|focal| focal.value);
        let focal = distortion.and_then(|d| d.focal_px).or(focal);
        let options = LensOptions {
            principal_point: entry.principal_point(),
            size: entry.size(),
            // Of the others the coefficients do not depend on it: another focal is no other question.
            focal: focal.filter(|_| fitted.as_ref().is_some_and(Fitted::has_own_focal)),
            fitted,
            sigma: entry.sigma_px.unwrap_or(1.0),
        };
        Some((self.edges_of(entry), options))
    }

    /// The fits of all lenses, those that `before` knows taken from there: for whoever calibrates again
    /// and again while an operator draws.
    #[must_use]
    pub fn lenses(&self, before: &LensCache) -> LensCache {
        let mut lenses = LensCache::default();
        // The lens of another camera is asked of that one.
        let is_own = |entry: &&SiteCamera| entry.lens.as_ref().is_none_or(|lens| lens.like.is_none());
        let questions = self.cameras.iter().filter(is_own).filter_map(|entry| self.lens_question(entry));
        for (edges, options) in questions {
            lenses.keep(edges, options, before);
        }
        lenses
    }

    /// The edges of a camera and of those that are like it and have the same image.
    fn edges_of(&self, owner: &SiteCamera) -> Vec<Edge> {
        let is_like = |other: &&SiteCamera| {
            other.lens.as_ref().is_some_and(|lens| lens.like.as_ref() == Some(&owner.id))
                && other.size_px == owner.size_px
                && other.principal_point() == owner.principal_point()
        };
        // Theirs say nothing about the owner's annotations: they stand beyond the list.
        let beyond = Source { annotation: usize::MAX, segment: 0 };
        let shared = self.cameras.iter().filter(is_like).flat_map(|other| edges(&other.annotations));
        edges(&owner.annotations)
            .into_iter()
            .chain(shared.map(|edge| Edge { source: beyond, ..edge }))
            .collect()
    }
}

impl LensEstimate {
    /// The same lens on another camera.
    pub(crate) fn shared_by(&self, entry: &SiteCamera) -> Self {
        let lens = Lens { principal_point: entry.principal_point(), ..self.lens };
        let mut lens_estimate = Self { lens, fit: None, straightness: Vec::new() };
        lens_estimate.straightness = lens_estimate.straightness_under(&lens, &entry.annotations);
        lens_estimate
    }

    /// Root mean square distance of every straight edge from straight under a lens, in raw pixels.
    pub(crate) fn straightness_under(&self, lens: &Lens, annotations: &[Annotation]) -> Vec<(Source, f64)> {
        edges(annotations)
            .iter()
            .filter(|edge| annotations[edge.source.annotation].is_straight_edge())
            .filter_map(|edge| Some((edge.source, straightness_rms(lens, &edge.points)?)))
            .collect()
    }

    /// What the operator should know of the lens.
    pub(crate) fn warnings(&self, annotations: &[Annotation]) -> Vec<Warning> {
        /// Pixels by which the undistorted corner may be uncertain.
        const MOST: f64 = 10.0;
        let Some(fit) = &self.fit else {
            return self.unfitted(annotations);
        };
        let mut warnings = Vec::new();
        let is_own =
            |source: &Source| annotations.get(source.annotation).is_some_and(Annotation::is_straight_edge);
        let unusable: Vec<&(Source, f64)> =
            fit.uninformative.iter().filter(|(source, _)| is_own(source)).collect();
        let [_, _, corner] = fit.map_error;
        // Many edges that say little each say enough together, where the corners are known.
        let is_told = fit.fitted.is_some() && corner <= MOST && unusable.len() > NAMED;
        if !unusable.is_empty() && !is_told {
            warnings.push(says_little(annotations, &unusable, self.straightness.len()));
        }
        if corner > MOST {
            let how =
                if corner.is_finite() { format!("by \u{b1} {corner:.0} px") } else { "altogether".into() };
            warnings.push(Warning::new(
                Code::UninformativePolyline,
                format!("The straight edges leave the corners of the image uncertain {how}."),
                "Draw straight edges that reach into the corners.",
            ));
        }
        if is_misfit(fit.chi2, fit.dof) {
            let [before, after] = fit.straightness;
            warnings.push(Warning::new(
                Code::Misfit,
                format!("The edges drawn as straight are {after:.2} px rms off straight ({before:.2} px without a lens)."),
                "Look for an edge that is not straight in space, or fit another model.",
            ));
        }
        warnings
    }

    /// Straight edges beside a lens that is given: they check it, and change nothing.
    fn unfitted(&self, annotations: &[Annotation]) -> Vec<Warning> {
        let count = self.straightness.len();
        if count == 0 {
            return Vec::new();
        }
        let mean = self.straightness.iter().map(|(_, px)| px).sum::<f64>() / count as f64;
        let first = self.straightness.first().map_or(0, |(source, _)| source.annotation);
        let which =
            if count == 1 { annotations[first].label(first) } else { format!("{count} straight edges") };
        let bent = if self.lens.distortion == Distortion::None {
            "no distortion"
        } else {
            "the distortion that is given"
        };
        vec![Warning::new(
            Code::UnusedAnnotation,
            format!(
                "The fit does not use {which}: {bent} is held. They are {mean:.2} px off straight under it."
            ),
            "Take the coefficients out of lens.distortion to have them fitted.",
        )]
    }
}

/// Edges that are named one by one; more are counted.
const NAMED: usize = 4;

/// Straight edges that would hardly bend, whatever the lens.
fn says_little(annotations: &[Annotation], unusable: &[&(Source, f64)], drawn: usize) -> Warning {
    let names: Vec<String> =
        unusable.iter().map(|(s, _)| line_name(annotations, s.annotation, s.segment)).collect();
    let most = unusable.iter().map(|(_, sagitta)| *sagitta).fold(0.0, f64::max);
    let who = match names.len() {
        1 => format!("{} says", names[0]),
        2..=NAMED => format!("{} say", names.join(", ")),
        count => format!("{count} of {drawn} straight edges say"),
    };
    let by = if names.len() == 1 { "it by" } else { "none of them by more than" };
    Warning::new(
        Code::UninformativePolyline,
        format!(
            "{who} next to nothing about the lens: 10 px of distortion in the corner would bend {by} {most:.1} px."
        ),
        "Draw long edges far from the image centre that do not point at it.",
    )
}
