//! Lens of a camera entry: entered, fitted to its straight edges, or shared with another camera.

use std::collections::BTreeMap;

use crate::document::{Site, SiteCamera};
use crate::lens_cache::LensCache;
use crate::shared_lenses::SharedLenses;
use crate::solution::DistortionEntry;
use calib_core::camera::{Coefficient, Distortion, ImageCircle, Lens, Pixel};
use calib_core::optimize::is_misfit;
use calib_core::outcome::Finding;
use calib_core::single::{
    Annotation, Edge, FittedCoefficients, Kind, LensFit, LensOptions, Source, edges, outermost,
    straightness_rms,
};

/// Lens of a camera, with the results from its straight edges.
#[derive(Clone, Debug)]
pub(crate) struct LensEstimate {
    pub(crate) lens: Lens,
    /// Fit of the lens to the edges; `None` if the lens was not fitted.
    pub(crate) fit: Option<LensFit>,
    /// RMS deviation of the lines of one direction from straight lines, in pixels. It is set if only these
    /// lines are curved. The cause may then be the lens or the scene, so no distortion is fitted.
    pub(crate) curved_one_way_px: Option<f64>,
    /// RMS deviation of every straight edge from a straight line, in raw pixels.
    pub(crate) straightness: Vec<(Source, f64)>,
}

/// Returns the coefficients to fit for a distortion entry; `None` if its coefficients are entered.
fn fitted_coefficients(entry: &DistortionEntry) -> Option<FittedCoefficients> {
    if entry.distortion().is_some() {
        return None;
    }
    let row = entry.model.row();
    let wanted = |index: usize, named: &Coefficient| match &entry.fit {
        Some(list) => list.contains(named),
        None => index < row.default_count,
    };
    let mut which = [false; Distortion::MAX_FITTED];
    for ((index, named), which) in row.coefficients.iter().enumerate().zip(&mut which) {
        *which = wanted(index, named);
    }
    if row.in_order {
        let last = which.iter().rposition(|&is| is).unwrap_or(0);
        which[..=last].fill(true);
    }
    Some(FittedCoefficients { model: entry.model, which })
}

/// Returns the RMS deviation from a straight line under a lens without distortion, in pixels, for every edge that the
/// fitted lens makes much straighter. The lines of one direction count as one edge. "Much" means a chi-square gain of
/// 10, which is very strong evidence (Kass and Raftery 1995).
fn straightened_rms(
    fit: &LensFit,
    annotations: &[Annotation],
    edges: &[Edge],
    options: &LensOptions,
) -> Vec<f64> {
    /// Smallest decrease of an edge's chi-square by the fitted lens that counts as much straighter.
    const MIN_CHI2_GAIN: f64 = 10.0;
    let pinhole = Lens { pixel_aspect: options.pixel_aspect, ..Lens::pinhole(options.principal_point) };
    let mut drawings: BTreeMap<(usize, usize), [f64; 3]> = BTreeMap::new();
    for (index, Edge { points, source }) in edges.iter().enumerate().filter(|(_, edge)| edge.points.len() > 2)
    {
        let drawn = annotations.get(source.annotation);
        let is_one_direction =
            drawn.is_some_and(|drawn| matches!(drawn.kind, Kind::Parallel | Kind::Vertical));
        let square =
            |lens: &Lens| straightness_rms(lens, points).unwrap_or(0.0).powi(2) * points.len() as f64;
        let key = (source.annotation, if is_one_direction { 0 } else { index });
        let sums = drawings.entry(key).or_default();
        for (sum, own) in sums.iter_mut().zip([square(&pinhole), square(&fit.lens), points.len() as f64]) {
            *sum += own;
        }
    }
    let is_straighter =
        |[without, with, _]: &[f64; 3]| without - with > MIN_CHI2_GAIN * options.sigma.powi(2);
    let sums = drawings.into_values().filter(is_straighter);
    sums.map(|[without, _, points]| (without / points).sqrt()).collect()
}

/// Whether lines of three or more points reach the rim of the image circle of a fisheye.
fn reaches_rim(entry: &SiteCamera) -> bool {
    /// Smallest distance from the centre that counts as reaching the rim, relative to the radius of the image
    /// circle.
    const MIN_RIM_DISTANCE_REL: f64 = 0.9;
    let circle = entry.image_circle().unwrap_or_else(|| ImageCircle::default_for(entry.size()));
    let drawn = edges(&entry.annotations);
    let farthest = outermost(drawn.iter().flat_map(|edge| &edge.points), circle.centre());
    farthest.is_some_and(|point| point.distance(circle.centre()) > MIN_RIM_DISTANCE_REL * circle.radius)
}

impl Site {
    /// Returns the lens of a camera: its own, or the lens of the camera named by `like`.
    pub(crate) fn lens_estimate(
        &self,
        entry: &SiteCamera,
        known: &LensCache,
        shared: &SharedLenses,
    ) -> LensEstimate {
        let like =
            entry.lens.as_ref().and_then(|lens| lens.like.as_ref()).and_then(|id| self.first_entry(id));
        let owner = like.unwrap_or(entry);
        let mut lens_estimate = self.own_lens_estimate(owner, known, shared);
        lens_estimate.lens.principal_point = lens_estimate.centre_on(owner, entry);
        if like.is_some() {
            // Findings about the lens are reported for its owner only.
            (lens_estimate.fit, lens_estimate.curved_one_way_px) = (None, None);
        }
        lens_estimate.straightness =
            lens_estimate.straightness_under(&lens_estimate.lens, &entry.annotations);
        lens_estimate
    }

    /// Returns the lens of a camera that does not use the lens of another: stored, entered, or fitted to edges.
    fn own_lens_estimate(
        &self,
        entry: &SiteCamera,
        known: &LensCache,
        shared: &SharedLenses,
    ) -> LensEstimate {
        if let Some(solution) = entry.solution.as_ref().filter(|_| entry.is_given()) {
            let (fit, curved_one_way_px) = (None, None);
            return LensEstimate { lens: solution.lens(), fit, curved_one_way_px, straightness: Vec::new() };
        }
        let problem = lens_problem(entry, shared);
        let fit = problem.as_ref().and_then(|(edges, options)| known.fit(edges, options));
        let (mut own, mut curved_one_way_px) = (fit, None);
        if let Some((edges, options)) = problem.filter(|_| !is_lens_requested(entry, shared)) {
            // Floor lines and verticals with three or more points also serve other purposes than the lens.
            // The fit is used only if more than one line becomes straighter: all parallel lines of a curved
            // road are curved.
            let straightened = own
                .as_ref()
                .map_or_else(Vec::new, |fit| straightened_rms(fit, &entry.annotations, &edges, &options));
            own = own.filter(|_| straightened.len() > 1);
            if let [px] = straightened[..] {
                curved_one_way_px = Some(px);
            }
        }
        let lens = own.as_ref().map_or_else(|| entry.lens(), |fit| fit.lens);
        LensEstimate { lens, fit: own, curved_one_way_px, straightness: Vec::new() }
    }

    /// Fits the lenses of some cameras, reusing the fits in `before`. This is for repeated calibration while
    /// the operator annotates.
    pub(crate) fn lenses(&self, cameras: &[&SiteCamera], before: &LensCache) -> LensCache {
        let mut lenses = LensCache::default();
        // A shared lens is fitted with its owner.
        let is_own = |entry: &&&SiteCamera| entry.lens.as_ref().is_none_or(|lens| lens.like.is_none());
        let shared = SharedLenses::new(self);
        let problems = cameras.iter().filter(is_own).filter_map(|entry| lens_problem(entry, &shared));
        for (edges, options) in problems {
            lenses.keep(edges, options, before);
        }
        lenses
    }
}

/// Returns the edges and options for fitting the lens of a camera. Returns `None` if its distortion coefficients are
/// entered, or if its solution is not recomputed.
fn lens_problem(entry: &SiteCamera, shared: &SharedLenses) -> Option<(Vec<Edge>, LensOptions)> {
    let lens = entry.lens_of_image();
    let distortion = lens.as_ref().and_then(|lens| lens.distortion.as_ref());
    let fitted = distortion.map(fitted_coefficients);
    if fitted == Some(None) || entry.is_given() {
        return None;
    }
    let fitted = fitted.flatten();
    // A focal length that is only a prior is estimated together with the lens.
    let focal = lens.as_ref().and_then(|lens| lens.focal_px).filter(|focal| focal.fixed);
    let focal = distortion.and_then(|d| d.focal_px).or(focal.map(|focal| focal.value));
    let options = LensOptions {
        principal_point: entry.principal_point(),
        is_centre_fixed: entry.entered_principal_point().is_some(),
        pixel_aspect: entry.pixel_aspect(),
        size: entry.size(),
        circle: entry.image_circle(),
        // The coefficients of other models do not depend on the focal length, so the cache key must not
        // contain it.
        focal: focal.filter(|_| fitted.as_ref().is_none_or(FittedCoefficients::has_own_focal)),
        fitted,
        sigma: entry.sigma_px.unwrap_or(1.0),
    };
    Some((lens_edges(entry, shared), options))
}

/// Whether a lens fit is requested: by a distortion entry, or by straight edges of the camera or of a camera
/// that shares its lens.
fn is_lens_requested(owner: &SiteCamera, shared: &SharedLenses) -> bool {
    let is_entered = owner.lens.as_ref().is_some_and(|lens| lens.distortion.is_some());
    let has_edge = |camera: &SiteCamera| {
        camera.annotations.iter().any(|annotation| annotation.is_straight_edge() && !annotation.off)
    };
    is_entered || has_edge(owner) || sharing_edges(owner, shared).any(has_edge)
}

/// Returns the cameras that share the lens of `owner` and have the same image geometry, so that their edges can be
/// combined.
fn sharing_edges<'a>(
    owner: &'a SiteCamera,
    shared: &SharedLenses<'a>,
) -> impl Iterator<Item = &'a SiteCamera> {
    let has_its_image = |other: &&SiteCamera| {
        other.size_px == owner.size_px
            && other.pixel_aspect() == owner.pixel_aspect()
            && other.entered_principal_point() == owner.entered_principal_point()
    };
    shared.sharing(&owner.id).filter(has_its_image)
}

/// Returns the edges of a camera and of the cameras that share its lens with the same image geometry.
fn lens_edges(owner: &SiteCamera, shared: &SharedLenses) -> Vec<Edge> {
    // The image circle of one lens is at slightly different positions in the images of two cameras.
    let shifted = |other: &SiteCamera| {
        let [own, its] = [owner, other].map(SiteCamera::principal_point);
        let by = [own.u - its.u, own.v - its.v];
        let shift = move |at: Pixel| Pixel::new(at.u + by[0], at.v + by[1]);
        let edges = edges(&other.annotations).into_iter();
        edges.map(move |edge| Edge { points: edge.points.into_iter().map(shift).collect(), ..edge })
    };
    // Edges of other cameras do not belong to an annotation of the owner, so their index is out of range.
    let beyond = Source { annotation: usize::MAX, segment: 0 };
    let others = sharing_edges(owner, shared).flat_map(shifted);
    edges(&owner.annotations).into_iter().chain(others.map(|edge| Edge { source: beyond, ..edge })).collect()
}

impl LensEstimate {
    /// Whether the principal point was fitted together with the lens of a camera.
    fn has_own_centre(&self, entry: &SiteCamera) -> bool {
        self.lens.distortion.is_wide() && self.fit.is_some() && entry.entered_principal_point().is_none()
    }

    /// Returns the principal point of a camera with the lens of `owner`: the principal point of `entry`, plus
    /// the offset that the fit estimated for the owner.
    fn centre_on(&self, owner: &SiteCamera, entry: &SiteCamera) -> Pixel {
        let [own, its] = [owner, entry].map(SiteCamera::principal_point);
        if !self.has_own_centre(owner) {
            return its;
        }
        let Pixel { u, v } = self.lens.principal_point;
        Pixel::new(u + (its.u - own.u), v + (its.v - own.v))
    }

    /// Returns the estimate for another camera that uses this lens of `owner`.
    pub(crate) fn for_camera(&self, owner: &SiteCamera, entry: &SiteCamera) -> Self {
        let lens = Lens {
            principal_point: self.centre_on(owner, entry),
            pixel_aspect: entry.pixel_aspect(),
            ..self.lens
        };
        let mut lens_estimate = Self { lens, fit: None, curved_one_way_px: None, straightness: Vec::new() };
        lens_estimate.straightness = lens_estimate.straightness_under(&lens, &entry.annotations);
        lens_estimate
    }

    /// Computes the RMS deviation of every straight edge from a straight line under a lens, in raw pixels.
    pub(crate) fn straightness_under(&self, lens: &Lens, annotations: &[Annotation]) -> Vec<(Source, f64)> {
        edges(annotations)
            .iter()
            .filter(|edge| annotations[edge.source.annotation].is_straight_edge())
            .filter_map(|edge| Some((edge.source, straightness_rms(lens, &edge.points)?)))
            .collect()
    }

    /// Returns the findings about the lens of a camera.
    pub(crate) fn findings(&self, entry: &SiteCamera) -> Vec<Finding> {
        /// Largest accepted standard deviation of the undistorted image corner, in pixels.
        const MAX_CORNER_SIGMA_PX: f64 = 10.0;
        /// Smallest number of edges that may determine a lens together although each edge alone is
        /// uninformative.
        const MIN_EDGES_TOGETHER: usize = 5;
        let Some(fit) = &self.fit else {
            let curved = self.curved_one_way_px.map(|px| Finding::CurvedInOneDirection { px });
            return self.unused_edges().into_iter().chain(curved).collect();
        };
        let is_round = fit.lens.distortion.is_wide() || entry.image_circle().is_some();
        let is_own = |source: &Source| {
            entry.annotations.get(source.annotation).is_some_and(Annotation::is_straight_edge)
        };
        let uninformative: Vec<(Source, f64)> =
            fit.uninformative.iter().filter(|(source, _)| is_own(source)).copied().collect();
        let [_, _, corner] = fit.map_error;
        let mut findings = Vec::new();
        // If many edges determine the corners together, none of them is reported as uninformative.
        let is_determined = fit.fitted.is_some()
            && corner <= MAX_CORNER_SIGMA_PX
            && uninformative.len() >= MIN_EDGES_TOGETHER;
        if !uninformative.is_empty() && !is_determined {
            findings.push(Finding::UninformativeEdges {
                edges: uninformative.iter().map(|(source, _)| *source).collect(),
                total: self.straightness.len(),
                sagitta_px: uninformative.iter().map(|(_, sagitta)| *sagitta).fold(0.0, f64::max),
            });
        }
        if corner > MAX_CORNER_SIGMA_PX {
            let is_reached = is_round && reaches_rim(entry);
            findings.push(Finding::UncertainCorners { px: corner, is_round, is_reached });
        }
        if is_misfit(fit.chi2, fit.dof) {
            let [px_without_lens, px] = fit.straightness;
            findings.push(Finding::CurvedEdges { px, px_without_lens });
        }
        findings
    }

    /// Returns the finding about straight edges under a fixed lens. These edges are not used, but their
    /// residuals are reported.
    fn unused_edges(&self) -> Option<Finding> {
        let (first, _) = self.straightness.first()?;
        let count = self.straightness.len();
        Some(Finding::UnusedEdges {
            first: first.annotation,
            count,
            is_undistorted: self.lens.distortion == Distortion::None,
            px: self.straightness.iter().map(|(_, px)| px).sum::<f64>() / count as f64,
        })
    }
}
