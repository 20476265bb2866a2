//! Stage 1 of one camera: its lens and orientation from its own lines, by maximum likelihood or by the
//! paper's method.

use std::collections::BTreeMap;

use crate::camera_result::CameraResult;
use crate::document::{Site, SiteCamera};
use crate::lens_cache::LensCache;
use crate::lens_step::LensEstimate;
use crate::nominal_focal::DataSheetConflict;
use crate::options::Options;
use crate::points_outside::SharedObservations;
use crate::points_step::{UsedPoints, from_points, priors_from};
use crate::shared_lenses::SharedLenses;
use crate::solution::{Alternative, CovarianceEntry, DistortionEntry, Method, Sigmas, Solution, Stage};
use calib_core::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
use calib_core::floor::{STAGE_1_HEIGHT, view_angle};
use calib_core::outcome::{Estimator, Failure, Finding, Parameter, Residual, ResidualOf};
use calib_core::single::{
    Annotation, Constraints, Fit, FitOptions, FixedParameters, Kind, Known, LocalMinimum, Orientation,
    PlanePrior, PointFit, PrincipalPointPrior, Priors, STEEP_GRADE, SceneErrors, Shape, Source, findings,
    paper_minimum, residuals_at, slope_finding, suggest_lines,
};

/// Results of stage 1 of the cameras whose lens other cameras share, by camera id.
pub(crate) type LensOwners = BTreeMap<String, Result<SingleFit, Failure>>;

/// Inputs from other cameras.
#[derive(Clone, Copy)]
pub(crate) struct SharedInputs<'a> {
    /// Shared lenses that are already estimated.
    pub(crate) owners: &'a LensOwners,
    /// Lens fits that are already computed.
    pub(crate) known: &'a LensCache,
    /// Cameras that share the lens of another camera.
    pub(crate) lenses: &'a SharedLenses<'a>,
    /// Links and marks by camera.
    pub(crate) shared: &'a SharedObservations<'a>,
    /// Whether no line may be rejected.
    pub(crate) keeps_all: bool,
}

/// Returns the fixed parameters of a camera. A shared lens fixes the focal length at the value of its owner, or
/// at the `refined` value of the bundle adjustment.
fn fixed_parameters(
    entry: &SiteCamera,
    lens: &Lens,
    owner: Option<&Result<SingleFit, Failure>>,
    refined: Option<f64>,
) -> Result<FixedParameters, Failure> {
    let own = entry.fixed_parameters(lens);
    match owner {
        None => Ok(own),
        // Straight edges do not determine the focal length, so each camera estimates its own.
        Some(Ok(owner)) if owner.result.solution.stage == Stage::Lens && owner.fixed.focal.is_none() => {
            Ok(own)
        }
        Some(Ok(owner)) => {
            let estimated = refined.unwrap_or(owner.result.solution.focal_px);
            Ok(FixedParameters { focal: owner.fixed.focal.or(Some(estimated)), ..own })
        }
        Some(Err(failure)) => {
            let like = entry.lens.as_ref().and_then(|lens| lens.like.as_deref()).unwrap_or_default();
            Err(Failure::SharedLensFailed { camera: like.to_owned(), reason: Box::new(failure.clone()) })
        }
    }
}

/// Other evidence of a camera, which decides which annotations may be suggested.
#[derive(Clone, Copy)]
struct SuggestionContext {
    /// Whether there are other cameras and only few links to them.
    has_neighbours: bool,
    /// Whether the scale is undetermined: the site has no plan, and the camera has no control point, link or
    /// placement with a scale.
    is_scale_open: bool,
}

/// Result of stage 1 of one camera.
#[derive(Clone, Debug)]
pub(crate) struct SingleFit {
    pub(crate) result: CameraResult,
    pub(crate) lens_estimate: LensEstimate,
    /// Constraints under the lens.
    pub(crate) constraints: Constraints,
    /// Parameters that were not estimated.
    pub(crate) fixed: FixedParameters,
    /// Maximum-likelihood fit to the lines; `None` if no such fit was computed, for example if only control points
    /// determine the camera.
    pub(crate) fit: Option<Fit>,
    /// Whether control points, or the points of a mark, determine the camera, alone or together with the lines.
    pub(crate) is_from_points: bool,
    /// Whether these points also determine the distortion of the lens.
    pub(crate) has_lens_from_points: bool,
    /// Index of the mark whose points determine the camera; `None` for control points and lines.
    pub(crate) mark: Option<usize>,
    /// Indices of the control points that contradict the others.
    pub(crate) suspect_points: Vec<usize>,
    /// Prior on the principal point; `None` if it is known.
    pub(crate) principal_point: Option<PrincipalPointPrior>,
    /// Principal point that explains all lines, in pixels, if the entered one contradicts them.
    pub(crate) other_centre: Option<Pixel>,
    /// Contradiction between the data sheet and the lines alone.
    pub(crate) data_sheet_conflict: Option<DataSheetConflict>,
}

impl SingleFit {
    /// Whether the principal point is estimated together with the orientation. This is false for a fisheye, whose
    /// principal point is estimated together with its lens.
    pub(crate) fn fits_principal_point(&self) -> bool {
        self.principal_point.is_some() && !self.lens_estimate.lens.distortion.is_wide()
    }

    /// Whether lines were rejected.
    pub(crate) fn has_outliers(&self) -> bool {
        self.fit.as_ref().is_some_and(|fit| !fit.outliers.is_empty())
    }

    /// Whether lens parameters are estimated together with the orientation.
    pub(crate) fn fits_lens(&self) -> bool {
        self.is_fitted() || (self.fit.is_some() && self.fits_principal_point())
    }

    /// Whether both the lens and the orientation were fitted to annotations of this camera.
    pub(crate) fn is_fitted(&self) -> bool {
        self.fit.is_some() && self.lens_estimate.fit.as_ref().is_some_and(|fit| fit.fitted.is_some())
    }
}

impl Site {
    /// Runs stage 1 of a camera. An entered or imported solution is kept.
    ///
    /// `better` is the lens estimate of a first fit, with the camera from its bundle adjustment. The lens of this
    /// camera is more accurate, because all constraints determine it. The first fit rejects no line if the lens was
    /// fitted, because that lens may be wrong.
    pub(crate) fn fit_single(
        &self,
        entry: &SiteCamera,
        options: &Options,
        better: Option<(&LensEstimate, &Camera)>,
        others: SharedInputs,
    ) -> Result<SingleFit, Failure> {
        let like = entry.lens.as_ref().and_then(|lens| lens.like.as_ref());
        let owner = like.and_then(|id| others.owners.get(id));
        let owned = like.and_then(|id| self.first_entry(id));
        let mut lens_estimate = match (better, owner.zip(owned)) {
            (Some((lens_estimate, _)), _) => lens_estimate.clone(),
            (None, Some((Ok(owner), owned))) => owner.lens_estimate.for_camera(owned, entry),
            _ => self.lens_estimate(entry, others.known, others.lenses),
        };
        let lens = better.map(|(_, camera)| camera.lens);
        let is_fitted = lens_estimate.fit.as_ref().is_some_and(|fit| fit.fitted.is_some());
        let is_draft = others.keeps_all || lens.is_none() && is_fitted;
        lens_estimate.lens = lens.unwrap_or(lens_estimate.lens);
        let lens = lens_estimate.lens;
        if let Some(given) = entry.solution.as_ref().filter(|_| entry.is_given()) {
            let (constraints, fixed) = (Constraints::default(), FixedParameters::default());
            let (principal_point, sloping) = (None, None);
            let inputs =
                SingleInputs { entry, lens_estimate, constraints, fixed, is_draft, principal_point, sloping };
            return Ok(inputs.with_result(CameraResult::new(given.clone()), None));
        }
        let fixed = fixed_parameters(entry, &lens, owner, better.map(|(_, camera)| camera.focal))?;
        let constraints =
            Constraints::on_planes(&entry.annotations, &lens, self.scene_errors(entry), &self.plane_priors());
        let principal_point = self.principal_point_prior(entry, &lens);
        let sloping = if is_draft { None } else { self.sloping_constraints(entry, &lens) };
        let inputs =
            SingleInputs { entry, lens_estimate, constraints, fixed, is_draft, principal_point, sloping };
        if options.method != Method::Paper {
            return self.fit_by_likelihood(inputs, options, others.shared);
        }
        if inputs.has_lens_only() {
            let result = lens_only(entry, &inputs.lens_estimate);
            return Ok(inputs.with_result(result, None));
        }
        let result = paper(entry, &inputs.constraints, &self.plane_priors(), lens, fixed)?;
        Ok(inputs.with_result(result, None))
    }

    /// Computes the single-camera solution (stage 1) of a camera by maximum likelihood, from its lines. If the
    /// lines do not determine the camera, control points or a mark are used in addition or instead.
    fn fit_by_likelihood(
        &self,
        inputs: SingleInputs,
        options: &Options,
        shared: &SharedObservations,
    ) -> Result<SingleFit, Failure> {
        let SingleInputs { entry, fixed, .. } = inputs;
        // The distortion is estimated from points only if the camera has no lines.
        let searches_lens = inputs.constraints.is_empty() && inputs.is_lens_open();
        let points = UsedPoints::new(self, entry);
        let of_points = points.options(entry, inputs.lens_estimate.lens, fixed);
        // Each closure returns the mark, the control points that contradict the fit, and the fit.
        let by_control_points = || {
            points.determined(&of_points, searches_lens).map(|found| (None, points.suspects(&found), found))
        };
        let by_mark = || {
            let marked = UsedPoints::from_mark(self, entry);
            let options = marked.options(entry, inputs.lens_estimate.lens, fixed);
            marked.determined(&options, searches_lens).map(|found| (marked.mark, Vec::new(), found))
        };
        let by_points = || inputs.is_open().then(|| by_control_points().or_else(by_mark)).flatten();
        if inputs.constraints.is_empty()
            && let Some((mark, suspect_points, found)) = by_points()
        {
            let single = inputs.with_points(&found, mark.is_some());
            return Ok(SingleFit { mark, suspect_points, ..single });
        }
        if inputs.has_lens_only() {
            let result = lens_only(entry, &inputs.lens_estimate);
            return Ok(inputs.with_result(result, None));
        }
        if inputs.constraints.is_empty() && inputs.is_open() && points.len() > 0 {
            let explained = points.explanation(&of_points, &[]).map(|found| found.failure(entry));
            let count = points.len();
            let unexplained = if points.are_contradictory(&of_points) {
                Failure::ContradictoryPoints { count }
            } else {
                Failure::UndeterminedByPoints { count }
            };
            return Err(explained.unwrap_or(unexplained));
        }
        let context = self.suggestion_context(entry, shared);
        let planes = self.plane_priors();
        let by_lines = |priors: Priors| likelihood(&inputs, &planes, priors, options.prior, context);
        let entered = entry.priors(&inputs.lens_estimate.lens);
        let alone = by_lines(entered);
        let is_determined = alone.as_ref().is_ok_and(|(_, fit)| fit.determines_camera());
        if let Some((mark, suspect_points, found)) = if is_determined { None } else { by_points() }
            && let Ok((result, fit)) = by_lines(priors_from(&found.camera, 1.0, &entered))
        {
            return Ok(SingleFit {
                is_from_points: true,
                mark,
                suspect_points,
                ..inputs.with_result(result, Some(fit))
            });
        }
        let (result, fit) = alone?;
        let suspect_points = points.suspects_beside(&fit, &of_points);
        Ok(SingleFit { suspect_points, ..inputs.with_result(result, Some(fit)) })
    }
}

/// Camera entry with its lens and the constraints under that lens.
struct SingleInputs<'a> {
    entry: &'a SiteCamera,
    lens_estimate: LensEstimate,
    constraints: Constraints,
    fixed: FixedParameters,
    /// Whether the lens is the first fit, which may be wrong.
    is_draft: bool,
    /// Prior on the principal point; `None` if it is known.
    principal_point: Option<PrincipalPointPrior>,
    /// Constraints under a floor tilt that allows steep ground; `None` if scene errors are entered, or for a draft.
    sloping: Option<Constraints>,
}

impl SingleInputs<'_> {
    /// Whether roll, pitch or focal length is estimated.
    fn is_open(&self) -> bool {
        let FixedParameters { roll, pitch, focal, .. } = self.fixed;
        roll.is_none() || pitch.is_none() || focal.is_none()
    }

    /// Whether the distortion is undetermined: there is no entry, no shared lens, no fit to edges and no image
    /// circle.
    fn is_lens_open(&self) -> bool {
        let is_entered =
            self.entry.lens.as_ref().is_some_and(|lens| lens.distortion.is_some() || lens.like.is_some());
        !is_entered && self.lens_estimate.fit.is_none() && self.entry.image_circle().is_none()
    }

    /// Whether only the lens can be estimated: there are straight edges and no other lines.
    fn has_lens_only(&self) -> bool {
        self.constraints.is_empty() && self.lens_estimate.fit.is_some() && self.is_open()
    }

    /// Returns the result of a camera that only points determine. `are_of_mark` is true for the points of a mark.
    fn with_points(self, found: &PointFit, are_of_mark: bool) -> SingleFit {
        let mut result = from_points(self.entry, found);
        // `recount_redundancy` counts the redundancy of control points after the placement.
        if are_of_mark && found.dof < 2 {
            result.findings.push(Finding::UncheckedPoints { dof: found.dof });
        }
        let lens = found.camera.lens;
        let has_lens_from_points = lens.distortion != self.lens_estimate.lens.distortion;
        let mut single = self.with_result(result, None);
        single.lens_estimate.lens = lens;
        SingleFit { is_from_points: true, has_lens_from_points, ..single }
    }

    fn with_result(self, result: CameraResult, fit: Option<Fit>) -> SingleFit {
        let Self { lens_estimate, constraints, fixed, principal_point, .. } = self;
        SingleFit {
            result,
            lens_estimate,
            constraints,
            fixed,
            fit,
            is_from_points: false,
            has_lens_from_points: false,
            mark: None,
            suspect_points: Vec::new(),
            principal_point,
            other_centre: None,
            data_sheet_conflict: None,
        }
    }
}

impl Site {
    /// Returns the constraints of a camera under a floor tilt that allows steep ground; `None` if scene errors are
    /// entered.
    fn sloping_constraints(&self, entry: &SiteCamera, lens: &Lens) -> Option<Constraints> {
        if entry.scene.or(self.scene).is_some() {
            return None;
        }
        let usual = self.scene_errors(entry);
        let scene = SceneErrors { floor_tilt: STEEP_GRADE.atan(), ..usual };
        Some(Constraints::on_planes(&entry.annotations, lens, scene, &self.plane_priors()))
    }

    /// Collects the other evidence of a camera.
    fn suggestion_context(&self, entry: &SiteCamera, shared: &SharedObservations) -> SuggestionContext {
        /// Smallest number of links of a camera for which no further links are suggested, because they would add
        /// little information.
        const MAX_LINKS_FOR_SUGGESTION: usize = 4;
        let links = shared.links(&entry.id).len();
        let is_placed = entry.placement.as_ref().is_some_and(|placement| placement.scale.is_some());
        SuggestionContext {
            has_neighbours: links < MAX_LINKS_FOR_SUGGESTION
                && self.cameras.iter().any(|other| other.id != entry.id),
            is_scale_open: links == 0 && self.plan.is_none() && entry.control_points.is_empty() && !is_placed,
        }
    }
}

/// Fits the lines of a camera by maximum likelihood, with these priors. `weak_prior` allows the weak prior on
/// the focal length.
fn likelihood(
    inputs: &SingleInputs,
    planes: &[PlanePrior],
    priors: Priors,
    weak_prior: bool,
    SuggestionContext { has_neighbours, is_scale_open }: SuggestionContext,
) -> Result<(CameraResult, Fit), Failure> {
    let SingleInputs { entry, lens_estimate, constraints, fixed, is_draft, .. } = inputs;
    let is_kept = |&i: &usize| *is_draft || entry.annotations[i].keep;
    let keep: Vec<usize> = (0..entry.annotations.len()).filter(is_kept).collect();
    let options = FitOptions {
        lens: lens_estimate.lens,
        size: entry.size(),
        efov: entry.efov_px.as_deref().unwrap_or_default(),
        fixed: *fixed,
        // A fixed focal length needs no prior.
        priors: Priors { focal: priors.focal.filter(|_| fixed.focal.is_none()), ..priors },
        sigma: entry.sigma_px,
        weak_prior,
        keep: &keep,
        has_neighbours,
        is_scale_unknown: is_scale_open,
    };
    let fit = Fit::new(constraints, &options)?;
    let sketches = suggest_lines(&fit, constraints, &options);
    let mut solution = Solution::from_camera(&fit.camera, Method::MaximumLikelihood, Stage::Partial);
    solution.set_uncertainty(&fit.camera, fit.floor_length_rel);
    solution.sigma_px = Some(fit.sigma);
    solution.chi2 = Some(fit.chi2);
    solution.dof = usize::try_from(fit.dof.max(0)).ok();
    solution.alternatives =
        fit.alternatives.iter().map(|other| alternative(other, entry, &fit.camera.lens)).collect();
    let mut findings = findings(&fit, sketches.first().map(|sketch| sketch.suggestion));
    findings.extend(inputs.sloping.as_ref().and_then(|sloping| slope_finding(&fit, sloping, &options)));
    findings.extend(unused_annotations(&entry.annotations, Estimator::MaximumLikelihood, |_| false));
    let off = residuals_when_off(entry, &fit.camera, planes);
    solution.residuals = residual_entries(fit.residuals.iter().copied().chain(off), &fit.outliers);
    solution.rms_px = rms(&entry.annotations, &solution.residuals);
    Ok((CameraResult { solution, findings, sketches }, fit))
}

/// Returns the residuals of the annotations that are switched off, in pixels.
pub(crate) fn residuals_when_off(
    entry: &SiteCamera,
    camera: &Camera,
    planes: &[PlanePrior],
) -> Vec<(Source, f64)> {
    let off = Constraints::switched_off(&entry.annotations, &camera.lens, planes);
    let at = Orientation { roll: camera.roll, pitch: camera.pitch, focal: camera.focal };
    residuals_at(&off, at, camera.position.z, entry.size()[0])
}

fn alternative(other: &LocalMinimum, entry: &SiteCamera, lens: &Lens) -> Alternative {
    let focal = other.orientation.focal;
    Alternative {
        focal_px: focal,
        hfov_deg: view_angle(lens, focal, entry.size()).to_degrees(),
        pitch_deg: other.orientation.pitch.to_degrees(),
        roll_deg: other.orientation.roll.to_degrees(),
        chi2: other.chi2,
    }
}

/// Runs stage 1 by the paper's method.
fn paper(
    entry: &SiteCamera,
    constraints: &Constraints,
    planes: &[PlanePrior],
    lens: Lens,
    fixed: FixedParameters,
) -> Result<CameraResult, Failure> {
    let width = entry.size()[0];
    let (at, _) = paper_minimum(constraints, fixed, width)?;
    let height = fixed.height.unwrap_or(STAGE_1_HEIGHT);
    let camera = Camera {
        position: WorldPoint::new(0.0, 0.0, height),
        yaw: 0.0,
        pitch: at.pitch,
        roll: at.roll,
        focal: at.focal,
        lens,
        covariance: Covariance::EXACT,
    };
    let mut solution = Solution::from_camera(&camera, Method::Paper, Stage::Partial);
    let off = Constraints::switched_off(&entry.annotations, &lens, planes);
    let both =
        [constraints, &off].into_iter().flat_map(|constraints| residuals_at(constraints, at, height, width));
    solution.residuals = residual_entries(both, &[]);
    solution.rms_px = rms(&entry.annotations, &solution.residuals);
    let unknown = |kind: Kind| !kind.row().in_paper;
    let mut findings: Vec<Finding> =
        unused_annotations(&entry.annotations, Estimator::Paper, unknown).collect();
    findings.extend(unused_priors(entry));
    Ok(CameraResult { findings, ..CameraResult::new(solution) })
}

/// Converts residuals of annotations to entries of the document, sorted, with outliers marked.
pub(crate) fn residual_entries(
    residuals: impl Iterator<Item = (Source, f64)>,
    outliers: &[Source],
) -> Vec<Residual> {
    let mut list: Vec<Residual> = residuals
        .filter(|(_, px)| px.is_finite())
        .map(|(source, px)| Residual {
            annotation: Some(source.annotation),
            segment: Some(source.segment),
            outlier: outliers.contains(&source),
            ..Residual::new(ResidualOf::Annotation, px)
        })
        .collect();
    list.sort_by_key(|residual| (residual.annotation, residual.segment));
    list
}

/// Returns the covariance of a camera whose lens alone was fitted.
fn lens_covariance(lens_estimate: &LensEstimate) -> Covariance {
    let mut covariance = Covariance::EXACT;
    if let Some(fit) = lens_estimate.fit.as_ref().filter(|fit| fit.fitted.is_some()) {
        // For a fisheye, the focal parameter of the lens fit is the log of the focal length of the camera.
        let focal = lens_estimate.lens.focal;
        let place = |k: usize| match k {
            Lens::LENS_FOCAL if lens_estimate.lens.distortion.is_wide() => (Covariance::FOCAL, focal),
            _ => (Covariance::LENS + k, 1.0),
        };
        for (i, row) in fit.covariance.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                let ((a, by_a), (b, by_b)) = (place(i), place(j));
                covariance.0[a][b] = value * by_a * by_b;
            }
        }
    }
    covariance
}

/// Creates the solution of a camera with only straight edges: its lens.
fn lens_only(entry: &SiteCamera, lens_estimate: &LensEstimate) -> CameraResult {
    // Without a focal length, the coefficients refer to the width of the image. A fisheye has its own focal
    // length.
    let lens = &lens_estimate.lens;
    let unit = if lens.distortion.is_wide() { lens.focal } else { entry.size()[0] };
    let focal = entry.lens_of_image().and_then(|lens| lens.focal_px).map_or(unit, |focal| focal.value);
    let camera = Camera {
        position: WorldPoint::default(),
        yaw: 0.0,
        pitch: 0.0,
        roll: 0.0,
        focal,
        lens: lens_estimate.lens,
        covariance: lens_covariance(lens_estimate),
    };
    let mut solution = Solution {
        image_circle_px: entry.image_circle(),
        pixel_aspect: camera.lens.pixel_aspect,
        distortion: DistortionEntry::from_lens(&camera.lens, focal),
        sigma: Some(Sigmas::from_camera(&camera, None)).filter(|sigma| *sigma != Sigmas::default()),
        covariance: CovarianceEntry::from_camera(&camera),
        ..Solution::new(Method::MaximumLikelihood, Stage::Lens, focal, camera.lens.principal_point)
    };
    solution.residuals = residual_entries(
        lens_estimate.straightness_under(&lens_estimate.lens, &entry.annotations).into_iter(),
        &[],
    );
    solution.rms_px = rms(&entry.annotations, &solution.residuals);
    let findings = lens_estimate.findings(entry);
    CameraResult { findings, ..CameraResult::new(solution) }
}

/// Returns the root mean square of the residuals of the used annotations, in pixels.
pub(crate) fn rms(annotations: &[Annotation], residuals: &[Residual]) -> Option<f64> {
    let is_used = |r: &&Residual| !r.outlier && r.annotation.is_some_and(|index| !annotations[index].off);
    let squares: Vec<f64> = residuals.iter().filter(is_used).map(|r| r.px * r.px).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Reports annotations that a method cannot use.
fn unused_annotations(
    annotations: &[Annotation],
    by: Estimator,
    unknown: impl Fn(Kind) -> bool,
) -> impl Iterator<Item = Finding> {
    annotations.iter().enumerate().filter(|(_, a)| !a.off).filter_map(move |(index, annotation)| {
        let row = annotation.kind.row();
        let drawn = annotation.segments.as_ref().map_or(0, Vec::len);
        let tied = annotation.at_right_angles_to.is_some()
            || annotation.id.is_some() && annotations.iter().any(|a| a.at_right_angles_to == annotation.id);
        if unknown(annotation.kind) {
            return Some(Finding::UnusedKind { annotation: index, by });
        }
        let is_short = row.shape == Shape::Segments && drawn < row.min_segments && !(tied && drawn > 0);
        is_short.then_some(Finding::TooFewSegments {
            annotation: index,
            by,
            count: drawn,
            required: row.min_segments,
        })
    })
}

fn unused_priors(entry: &SiteCamera) -> impl Iterator<Item = Finding> {
    let lens = entry.lens.as_ref();
    let priors = [
        (Parameter::Focal, lens.and_then(|l| l.focal_px)),
        (Parameter::Pitch, lens.and_then(|l| l.pitch_deg)),
        (Parameter::Roll, lens.and_then(|l| l.roll_deg)),
        (Parameter::Height, entry.height_m),
    ];
    let is_prior = |known: Option<Known>| known.is_some_and(|known| !known.fixed);
    priors
        .into_iter()
        .filter(move |(_, known)| is_prior(*known))
        .map(|(parameter, _)| Finding::UnusedPrior { parameter })
}
