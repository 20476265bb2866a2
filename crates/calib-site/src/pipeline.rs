//! Calibration of a site: each camera separately, then all cameras jointly, then placement and findings.

use std::borrow::Cow;
use std::collections::BTreeSet;

use crate::bounds::At;
use crate::bundle_step::{BundleResult, refine_lenses};
use crate::camera_result::CameraResult;
use crate::check_entries::check_solution;
use crate::document::{Site, SiteCamera};
use crate::georeference_step::MapResult;
use crate::lens_cache::LensCache;
use crate::nominal_focal::DataSheetConflict;
use crate::options::Options;
use crate::pixel_aspect::usual_pixel_aspect;
use crate::placement_step::placed_uncertainty;
use crate::points_outside::SharedObservations;
use crate::points_step::{Explanation, UsedPoints, is_possible};
use crate::principal_point::PrincipalPointEntry;
use crate::quality::is_recomputed;
use crate::scene::PlaneSolution;
use crate::shared_lenses::SharedLenses;
use crate::single_step::{LensOwners, SharedInputs, SingleFit, residual_entries, residuals_when_off, rms};
use crate::site_solution::{ElementSolution, SiteSolution};
use crate::solution::{DistortionEntry, FailureEntry, Method, Solution, Stage};
use calib_core::bundle::{CameraEstimate, PlaneEstimate};
use calib_core::camera::{Camera, Covariance, Distortion, FloorPoint, Lens, Pixel, Plane};
use calib_core::floor::{default_efov, efov_on_plane};
use calib_core::outcome::{Code, Failure, Finding, ResidualOf, SharedEvidence};
use calib_core::single::{
    Constraints, FixedParameters, InvalidSegment, Kind, MAX_LOG_FOCAL_SIGMA, PlanePrior, PrincipalPointPrior,
    Priors, SceneErrors, contradictory_uprights, is_inconsistent,
};

/// Result of a calibration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Results of the requested cameras, each with its index in the site.
    pub cameras: Vec<(usize, Result<Solution, FailureEntry>)>,
    /// Findings or failure of each of these cameras in the same order, not yet converted to sentences.
    pub findings: Vec<Result<Vec<Finding>, Failure>>,
    /// Results of the links of the site; `None` for unused links.
    pub links: Vec<Option<ElementSolution>>,
    /// Results of the marks of the site; `None` for unused marks.
    pub marks: Vec<Option<ElementSolution>>,
    /// Estimated planes of the site; `None` for planes that were not estimated.
    pub planes: Vec<Option<PlaneSolution>>,
    /// Results for the site as a whole.
    pub site: SiteSolution,
    /// Findings about the site as a whole, not yet converted to sentences.
    pub site_findings: Vec<Finding>,
}

impl Report {
    /// Returns the site with these results. Annotations and entered values are unchanged.
    #[must_use]
    pub fn write_into(&self, site: &Site) -> Site {
        let mut solved = site.clone();
        let solution = self.site.clone();
        solved.solution = (!solution.is_empty()).then_some(solution);
        for (link, found) in solved.links.iter_mut().zip(&self.links) {
            link.solution.clone_from(found);
        }
        for (mark, found) in solved.marks.iter_mut().zip(&self.marks) {
            mark.solution.clone_from(found);
        }
        for (index, plane) in solved.planes.iter_mut().enumerate() {
            plane.solution = self.planes.get(index).copied().flatten();
        }
        for (index, result) in &self.cameras {
            let camera = &mut solved.cameras[*index];
            (camera.solution, camera.error) = match result {
                Ok(solution) => (Some(solution.clone()), None),
                Err(failure) => (None, Some(failure.clone())),
            };
        }
        solved
    }

    /// Whether every camera has a result.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.cameras.iter().all(|(_, result)| result.is_ok())
    }
}

impl Site {
    /// Calibrates the cameras requested by `options`. A camera that cannot be solved does not prevent the
    /// others from being solved.
    #[must_use]
    pub fn calibrate(&self, options: &Options) -> Report {
        let entries: Vec<&SiteCamera> = self.cameras.iter().collect();
        let shared = SharedObservations::new(self, &entries);
        let single_fits = self.single_fits(&entries, &LensCache::default(), &shared, options);
        let is_joint = options.refine && options.method != Method::Paper;
        let bundle = match options.method {
            Method::Paper => BundleResult::default(),
            _ if is_joint => self.bundle_adjust(&single_fits),
            _ => self.refine_separately(&entries, &single_fits),
        };
        let joined_stage = if is_joint { Stage::Refined } else { Stage::Placed };
        let is_requested =
            |camera: &SiteCamera| options.cameras.as_ref().is_none_or(|ids| ids.contains(&camera.id));
        let mut results: Vec<(usize, Result<CameraResult, Failure>)> = (0..self.cameras.len())
            .filter(|&index| is_requested(&self.cameras[index]))
            .map(|index| {
                let joined = bundle.cameras.get(index).and_then(Option::as_ref);
                let how = (options.method, joined_stage);
                (index, self.finish(entries[index], &single_fits[index], joined, how, &shared))
            })
            .collect();
        let triangulated = bundle.triangulated();
        self.add_shared_residuals(&bundle, &triangulated, &mut results);
        self.add_reliabilities(&bundle, &mut results);
        let [links, marks] = self.elements(&bundle, &triangulated);
        let (mut site, mut site_findings) = self.quality(&bundle, &triangulated, &results);
        if !is_joint {
            site_findings.extend(self.unused_evidence(&bundle.single_marks));
        }
        site.warnings = self.warnings(None, &site_findings);
        let entry = |(index, result)| {
            let (entry, findings) = self.to_document(index, result);
            ((index, entry), findings)
        };
        let (cameras, findings) = results.into_iter().map(entry).unzip();
        let found = |found: &Option<PlaneEstimate>| {
            found.map(|PlaneEstimate { plane, covariance }| PlaneSolution::from_plane(&plane, &covariance))
        };
        let planes = bundle.planes.iter().map(found).collect();
        let mut report = Report { cameras, findings, links, marks, planes, site, site_findings };
        let MapResult { georeference, findings } = self.solve_georeference(|| report.write_into(self));
        report.site.georeference = georeference;
        let far = self.far_from_origin(report.site.georeference.as_ref(), &report.cameras);
        let findings: Vec<Finding> = findings.into_iter().chain(far).collect();
        report.site.warnings.extend(self.warnings(None, &findings));
        report.site_findings.extend(findings);
        report
    }

    /// Runs stage 1 for the given cameras, which must include the owners of shared lenses. If lens parameters
    /// are estimated, stage 1 runs again under the lens refined with all constraints.
    pub(crate) fn single_fits(
        &self,
        entries: &[&SiteCamera],
        known: &LensCache,
        shared: &SharedObservations,
        options: &Options,
    ) -> Vec<Result<SingleFit, Failure>> {
        let like = |camera: &&SiteCamera| camera.lens.as_ref().and_then(|lens| lens.like.clone());
        // Shared lenses are fitted once.
        let (none, lenses) = (LensOwners::new(), SharedLenses::new(self));
        let alone = SharedInputs { owners: &none, known, lenses: &lenses, shared, keeps_all: false };
        let owners: LensOwners = entries
            .iter()
            .filter_map(like)
            .collect::<BTreeSet<String>>()
            .into_iter()
            .filter_map(|id| {
                let first = self.fit_single(self.first_entry(&id)?, options, None, alone);
                Some((id, first))
            })
            .collect();
        let others = SharedInputs { owners: &owners, ..alone };
        let first = |&camera: &&SiteCamera| match owners.get(&camera.id) {
            Some(first) if self.first_entry(&camera.id) == Some(camera) => first.clone(),
            _ => self.fit_single(camera, options, None, others),
        };
        let mut single_fits: Vec<Result<SingleFit, Failure>> = entries.iter().map(first).collect();
        if options.method == Method::Paper {
            return single_fits;
        }
        let fits_aspect = entries.iter().any(|entry| entry.pixel_aspect_prior().is_some());
        if fits_aspect || single_fits.iter().flatten().any(SingleFit::fits_lens) {
            let drafts = refine_lenses(entries, &single_fits, self.plane_priors(), false);
            for (index, draft) in drafts.cameras.iter().enumerate() {
                let own = single_fits[index].as_ref().ok().filter(|first| first.fit.is_some());
                if let (Some(draft), Some(own)) = (draft, own) {
                    let better = (&own.lens_estimate, &draft.camera);
                    single_fits[index] = self.fit_single(entries[index], options, Some(better), others);
                }
            }
        }
        let best = |(fit, entry)| {
            let fit = self.with_best_aspect(entry, fit, options, others);
            let fit = self.with_best_centre(entry, fit, options, others)?;
            Ok(self.compared_with_data_sheet(entry, fit, options, others))
        };
        single_fits.into_iter().zip(entries.iter().copied()).map(best).collect()
    }

    /// Returns the fit of a camera. If its lines contradict each other, returns a better fit with another principal
    /// point, if one is found.
    ///
    /// If the assumed principal point is far from the true one, correct lines contradict each other and are rejected.
    /// Therefore the principal point is estimated from all lines: first near the image centre, then with the prior of
    /// a cropped image. An exactly entered principal point is kept, but another one that explains the lines is
    /// reported.
    pub(crate) fn with_best_centre(
        &self,
        entry: &SiteCamera,
        fit: Result<SingleFit, Failure>,
        options: &Options,
        others: SharedInputs,
    ) -> Result<SingleFit, Failure> {
        let fit = fit?;
        let has_doubts = fit.has_outliers() || fit.fit.as_ref().is_some_and(|fit| fit.is_misfit);
        let is_wide = fit.lens_estimate.lens.distortion.is_wide();
        let entered = entry.entered_principal_point();
        let is_exact = entered.is_none() && self.scene_errors(entry) == SceneErrors::EXACT;
        if !has_doubts || is_wide || is_exact || entry.is_given() {
            return Ok(fit);
        }
        let centred = entry.principal_point_near_centre();
        let crop = PrincipalPointPrior::of_crop(entry.size());
        let fitted_near = |prior: PrincipalPointPrior| {
            let (found, camera) = self.fit_without_outliers(entry, prior, options, others)?;
            // The lines must determine the principal point of a crop themselves.
            let is_sharp = |axis: usize| {
                let sigma = camera.covariance.sigma(Covariance::CENTRE + axis);
                sigma.is_some_and(|sigma| sigma < centred.sigma)
            };
            (prior != crop || is_sharp(0) && is_sharp(1)).then_some((found, camera.lens.principal_point))
        };
        let prior = |PrincipalPointEntry { value, sigma }| Some(PrincipalPointPrior { value, sigma: sigma? });
        let found = match entered.and_then(prior) {
            Some(prior) => fitted_near(prior),
            None => [centred, crop].into_iter().find_map(fitted_near),
        };
        let Some((found, at)) = found else { return Ok(fit) };
        Ok(match entered {
            Some(PrincipalPointEntry { value, sigma: None }) => {
                let other_centre = Some(at).filter(|at| at.distance(value) > centred.sigma);
                SingleFit { other_centre, ..fit }
            }
            _ => found,
        })
    }

    /// Fits a camera with this prior on its principal point, and rejects no line before the principal point is
    /// estimated. `None` if the lines still contradict each other. Also returns the camera with its lens.
    fn fit_without_outliers(
        &self,
        entry: &SiteCamera,
        prior: PrincipalPointPrior,
        options: &Options,
        others: SharedInputs,
    ) -> Option<(SingleFit, Camera)> {
        let mut entry = entry.clone();
        let centre = PrincipalPointEntry { value: prior.value, sigma: Some(prior.sigma) };
        entry.lens = entry.lens_of_image().map(Cow::into_owned);
        entry.lens.get_or_insert_default().principal_point_px = Some(centre);
        let (found, estimate) = self.fit_all_lines(&entry, options, others)?;
        estimate?;
        if found.has_outliers() || found.fit.as_ref().is_none_or(|fit| fit.is_misfit) {
            return None;
        }
        let camera = self.refine_lens(&entry, &found)?.camera;
        Some((found, camera))
    }

    /// Reports links, marks and distances that are not used because each camera is solved separately.
    fn unused_evidence(&self, single_marks: &[usize]) -> impl Iterator<Item = Finding> {
        let links = self.links.iter().filter(|link| !link.off && !link.seen.is_empty()).count();
        let marks = self.marks.iter().enumerate().filter(|(_, mark)| !mark.off && !mark.seen.is_empty());
        let marks = marks.filter(|(index, _)| !single_marks.contains(index)).count();
        let distances = self.distances.iter().filter(|distance| !distance.off).count();
        [
            (SharedEvidence::Links, links),
            (SharedEvidence::Marks, marks),
            (SharedEvidence::Distances, distances),
        ]
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(evidence, count)| Finding::UnusedEvidence { evidence, count })
    }

    /// Completes the result of a camera: takes its joint estimate, which has the stage `joined_stage`, or
    /// places it separately, and adds findings.
    pub(crate) fn finish(
        &self,
        entry: &SiteCamera,
        first: &Result<SingleFit, Failure>,
        joined: Option<&CameraEstimate>,
        (method, joined_stage): (Method, Stage),
        shared: &SharedObservations,
    ) -> Result<CameraResult, Failure> {
        let first = first.as_ref().map_err(Clone::clone)?;
        let mut result = first.result.clone();
        if entry.is_given() {
            // Residuals of links and marks are computed again.
            result.solution.residuals.retain(|residual| residual.of == ResidualOf::Annotation);
            result.solution.warnings.retain(|warning| !is_recomputed(warning.code));
            result.findings = entry.pose_findings();
            result.findings.extend(self.shared_points_outside(entry, shared));
            return check_finite(result);
        }
        let Some(own) = result.solution.camera() else { return check_finite(result) };
        let own = joined.map_or(own, |joined| joined.camera);
        let (camera, stage) = match joined {
            Some(joined) if joined.is_connected => {
                // A conflict between height and placement is reported for connected cameras, too.
                let mut conflicts = Vec::new();
                let single = first.result.solution.camera().unwrap_or(own);
                let _ = self.place(entry, single, &first.suspect_points, &mut conflicts);
                conflicts.retain(|finding: &Finding| finding.code() == Code::ScaleConflict);
                result.findings.extend(conflicts);
                (joined.camera, joined_stage)
            }
            _ => self.place(entry, own, &first.suspect_points, &mut result.findings),
        };
        let camera = if is_inconsistent_with(first, joined) {
            Camera { covariance: Covariance::UNKNOWN, ..camera }
        } else {
            camera
        };
        if let Some(joined) = joined {
            apply_joint_estimate(entry, &camera, (first, &self.plane_priors()), joined, &mut result);
            if joined.is_connected {
                let (points, links) = (UsedPoints::new(self, entry), shared.links(&entry.id).len());
                recount_redundancy(entry, first, (&points, links), &mut result.findings);
            }
        }
        result.solution.position_m = Some(camera.position);
        result.solution.yaw_deg = Some(camera.yaw.to_degrees());
        result.solution.image_circle_px = entry.image_circle();
        result.solution.stage = stage;
        // Pixels outside the image circle do not show floor.
        let shown = Camera { lens: Lens { image_circle: entry.image_circle(), ..camera.lens }, ..camera };
        if method != Method::Paper && (stage > Stage::Partial || joined.is_some()) {
            placed_uncertainty(entry, &shown, &mut result);
        }
        let straightness = first.lens_estimate.straightness_under(&camera.lens, &entry.annotations);
        result.solution.residuals.extend(residual_entries(straightness.into_iter(), &[]));
        result.solution.residuals.sort_by_key(|residual| (residual.annotation, residual.segment));
        add_single_findings(entry, first, &camera, &mut result);
        let camera = shown;
        result.solution.efov_m = efov(entry, &camera, &self.plane_priors(), &mut result.findings);
        result.findings.retain(|finding| !is_recomputed(finding.code()));
        result.findings.extend(entry.findings_at(&camera));
        result.findings.extend(self.shared_points_outside(entry, shared));
        if self.is_placed_by_hand(entry, &camera, stage) {
            result.findings.push(Finding::PlacedByHand);
        }
        self.add_control_residuals(entry, &camera, &mut result);
        self.explain_points(entry, (first, &camera), &mut result)?;
        check_finite(result)
    }
}

impl Site {
    /// Adds a finding if two control points of a camera are exchanged.
    ///
    /// # Errors
    /// If the control points contradict each other and no consensus remains: two are exchanged, all are
    /// mirrored, no position fits them, or the camera is impossible.
    fn explain_points(
        &self,
        entry: &SiteCamera,
        (first, camera): (&SingleFit, &Camera),
        result: &mut CameraResult,
    ) -> Result<(), Failure> {
        let points = UsedPoints::new(self, entry);
        let options = points.options(entry, first.lens_estimate.lens, first.fixed);
        let is_misfit = result.findings.iter().any(|finding| finding.code() == Code::Misfit);
        // Points that determine the camera also determine its position, unless they contradict each other.
        // The camera of a mark may have one or two control points, which are too few for a position.
        let is_unplaced = first.is_from_points
            && first.fit.is_none()
            && points.len() > 2
            && result.solution.stage == Stage::Partial;
        if points.len() > 0 && (is_misfit || is_unplaced || camera.position.z < 0.0) {
            return match points.explanation(&options, &[]) {
                Some(explanation) => Err(explanation.failure(entry)),
                None if is_unplaced => Err(Failure::ContradictoryPoints { count: points.len() }),
                None if is_possible(camera, entry.size()) => Ok(()),
                None => Err(Failure::ImpossibleCamera { focal: camera.focal, height: camera.position.z }),
            };
        }
        if first.suspect_points.len() > 1
            && let Some(Explanation::Exchanged(points)) = points.explanation(&options, &first.suspect_points)
        {
            result.findings.push(Finding::ExchangedControlPoints { points });
        }
        Ok(())
    }
}

/// Whether the annotations of a camera, or its shared observations, contradict each other beyond any noise.
fn is_inconsistent_with(first: &SingleFit, joined: Option<&CameraEstimate>) -> bool {
    first.fit.as_ref().is_some_and(|fit| fit.is_inconsistent)
        || first.other_centre.is_some()
        || joined.is_some_and(|joined| is_inconsistent(joined.chi2, joined.dof))
}

/// Replaces the numbers of stage 1 by the joint estimate.
fn apply_joint_estimate(
    entry: &SiteCamera,
    camera: &Camera,
    (first, planes): (&SingleFit, &[PlanePrior]),
    joined: &CameraEstimate,
    result: &mut CameraResult,
) {
    let CameraResult { solution, findings, .. } = result;
    solution.pitch_deg = Some(camera.pitch.to_degrees());
    solution.roll_deg = Some(camera.roll.to_degrees());
    solution.focal_px = camera.focal;
    solution.principal_point_px = camera.lens.principal_point;
    solution.pixel_aspect = camera.lens.pixel_aspect;
    solution.distortion = DistortionEntry::from_lens(&camera.lens, camera.focal);
    // For a single camera, the chi-square is relative to the assumed noise. For connected cameras, it is relative to the
    // estimated noise.
    let noise = first.fit.as_ref().map_or(1.0, |fit| fit.sigma / entry.sigma_px.unwrap_or(1.0));
    let chi2 = if joined.is_connected { joined.chi2 } else { joined.chi2 * noise * noise };
    solution.chi2 = Some(chi2);
    solution.dof = usize::try_from(joined.dof).ok();
    solution.sigma_px = Some(joined.sigma);
    let outliers = first.fit.as_ref().map_or(&[][..], |fit| &fit.outliers[..]);
    let off = residuals_when_off(entry, camera, planes);
    solution.residuals = residual_entries(joined.residuals.iter().copied().chain(off), outliers);
    solution.rms_px = rms(&entry.annotations, &solution.residuals);
    // The focal length may be determined by other cameras, or by the straight edges of a fisheye, even if
    // stage 1 does not determine it.
    let focal_is_determined = camera
        .covariance
        .sigma(Covariance::FOCAL)
        .is_none_or(|sigma| sigma < MAX_LOG_FOCAL_SIGMA * camera.focal);
    if (joined.is_connected || camera.lens.distortion.is_wide()) && focal_is_determined {
        findings.retain(|finding| !matches!(finding.code(), Code::FocalUnobservable | Code::PriorDominates));
    }
    if joined.is_connected && joined.is_misfit {
        findings.retain(|finding| finding.code() != Code::Misfit);
        findings.push(Finding::JointMisfit { chi2: joined.chi2, dof: joined.dof });
    }
}

/// Adds the entered and the measured length to the findings about rejected known lengths.
fn add_lengths(entry: &SiteCamera, camera: &Camera, findings: &mut [Finding]) {
    for finding in findings {
        let Finding::LineOutlier { line, lengths, .. } = finding else { continue };
        let annotation = entry.annotations.get(line.annotation);
        let Some(annotation) = annotation.filter(|annotation| annotation.kind == Kind::KnownLength) else {
            continue;
        };
        let ends = annotation.segments.iter().flatten().nth(line.segment);
        let ends = ends.and_then(|points| Some([*points.first()?, *points.last()?]));
        let feet = ends.map(|ends| ends.map(|pixel| camera.pixel_to_floor(pixel, 0.0)));
        if let (Some([Some(a), Some(b)]), Some(entered)) = (feet, annotation.length_m) {
            *lengths = Some([entered, a.distance(b)]);
        }
    }
}

/// Adds the findings about the lens and the lines of a camera. If the lines contradict the entered principal
/// point, the uncertainty is unknown.
fn add_single_findings(entry: &SiteCamera, first: &SingleFit, camera: &Camera, result: &mut CameraResult) {
    let CameraResult { solution, findings, .. } = result;
    // This finding comes first, because it may be the cause of the others.
    findings.splice(0..0, first.data_sheet_conflict.as_ref().map(DataSheetConflict::finding));
    findings.extend(first.lens_estimate.findings(entry));
    findings.extend(invalid_segments(&first.constraints));
    findings.extend(check_lens(entry, camera));
    findings.extend(check_principal_point(entry, first, camera));
    findings.extend(check_resolution(entry, first));
    findings.extend(check_pixels(entry));
    findings.extend(height_findings(entry, camera, findings));
    add_lengths(entry, camera, findings);
    if first.other_centre.is_some() {
        solution.set_uncertainty(&Camera { covariance: Covariance::UNKNOWN, ..*camera }, None);
        let is_replaced = |code: Code| matches!(code, Code::Weak | Code::Unusable | Code::UncertaintyUnknown);
        findings.retain(|finding| !is_replaced(finding.code()));
        findings.push(Finding::UncertaintyUnknown);
    }
}

/// Reports an entered principal point that is outside the image in u and v, or far from the image centre while lines
/// contradict each other. The lens then probably belongs to another resolution. A principal point of another
/// resolution is shifted by a similar factor in x and y.
fn check_resolution(entry: &SiteCamera, first: &SingleFit) -> Option<Finding> {
    /// Smallest factor, in either direction, between the entered principal point and the image centre that indicates
    /// another resolution. A principal point of the same resolution is nearer to the image centre.
    const MIN_RATIO: f64 = 1.3;
    /// Largest quotient of the ratios in u and v. Two resolutions can have different aspect ratios: 16:9 and 4:3
    /// differ by a factor of 1.33.
    const MAX_ASPECT_RATIO: f64 = 1.4;
    /// Ratio from which the principal point is outside the image.
    const OUTSIDE: f64 = 2.0;
    let entered = entry.entered_principal_point().filter(|entered| entered.sigma.is_none())?.value;
    let [w, h] = entry.size();
    let ratios = [2.0 * entered.u / w, 2.0 * entered.v / h];
    let all = |is: &dyn Fn(f64) -> bool| ratios.iter().all(|&ratio| is(ratio));
    let is_similar = (ratios[0] / ratios[1]).ln().abs() < MAX_ASPECT_RATIO.ln();
    let is_other = is_similar && (all(&|ratio| ratio > MIN_RATIO) || all(&|ratio| ratio < MIN_RATIO.recip()));
    let has_doubts = first.has_outliers() || first.fit.as_ref().is_some_and(|fit| fit.is_misfit);
    let is_reported = all(&|ratio| ratio > OUTSIDE) || is_other && has_doubts && first.other_centre.is_none();
    is_reported.then_some(Finding::OtherResolution { entered, size: entry.size_px })
}

/// Reports an image size whose pixels are usually not square, if no pixel aspect is entered.
fn check_pixels(entry: &SiteCamera) -> Option<Finding> {
    let aspect = usual_pixel_aspect(entry.size_px)
        .filter(|_| entry.lens.as_ref().is_none_or(|lens| lens.pixel_aspect.is_none()))?;
    Some(Finding::PixelsNotSquare { size: entry.size_px, aspect })
}

/// Reports an entered principal point that contradicts the lines, or an estimated one far from the image
/// centre. If the data sheet contradicts the lines, the principal point that was estimated without the data
/// sheet is checked.
fn check_principal_point(entry: &SiteCamera, first: &SingleFit, camera: &Camera) -> Option<Finding> {
    let entered = entry.entered_principal_point();
    if let Some((estimated, PrincipalPointEntry { value, .. })) = first.other_centre.zip(entered) {
        let swapped = Pixel::new(value.v, value.u);
        let is_exchanged = swapped.distance(estimated) < 0.25 * value.distance(estimated);
        return Some(Finding::WrongPrincipalPoint { entered: value, estimated, is_exchanged });
    }
    let of_lines = first.data_sheet_conflict.as_ref().map_or(camera, |conflict| &conflict.of_lines);
    let (estimated, centred) = (of_lines.lens.principal_point, entry.principal_point_near_centre());
    let is_estimated = entered.is_none() && first.fits_principal_point();
    let [w, h] = entry.size();
    (is_estimated && centred.contradicts(estimated))
        .then(|| Finding::OffCentre { estimated, distance: estimated.distance(centred.value) / w.max(h) })
}

/// Updates the findings about redundancy by counting lines and control points together; stage 1 counts
/// only lines. A wrong control point is detectable only with redundant points or links.
fn recount_redundancy(
    entry: &SiteCamera,
    first: &SingleFit,
    (points, links): (&UsedPoints, usize),
    findings: &mut Vec<Finding>,
) {
    // Three points of the floor determine its slope.
    if points.len() + links > 2 {
        findings.retain(|finding| finding.code() != Code::FloorSlope);
    }
    let is_linked = links > 0;
    /// Number of unknowns of a position and a yaw.
    const UNKNOWNS: i64 = 4;
    /// Degrees of freedom below which a wrong point is not detected reliably.
    const MIN_DOF: i64 = 2;
    let used = points.len() as i64 - first.suspect_points.len() as i64;
    if used < 2 {
        if first.is_from_points && first.fit.is_none() {
            // `add_reliabilities` reports unchecked points of the mark.
            findings.retain(|finding| finding.code() != Code::Unchecked);
        }
        return;
    }
    let FixedParameters { roll, pitch, focal, height } = first.fixed;
    let Priors { roll: by_roll, pitch: by_pitch, focal: by_focal, height: by_height, .. } =
        entry.priors(&first.lens_estimate.lens);
    let orientation = [(roll, by_roll), (pitch, by_pitch), (focal, by_focal)];
    let open = orientation.iter().filter(|(fixed, prior)| fixed.is_none() && prior.is_none()).count() as i64;
    let (of_lines, has_height) = match &first.fit {
        // The lines were fitted with priors from the points.
        Some(fit) if first.is_from_points => (fit.dof - open, fit.is_height_known),
        Some(fit) => (fit.dof, fit.is_height_known),
        None => (-open, height.is_some() || by_height.is_some()),
    };
    let rejected = first.suspect_points.len() + first.fit.as_ref().map_or(0, |fit| fit.outliers.len());
    let dof = of_lines + 2 * used - UNKNOWNS + i64::from(has_height) - rejected as i64;
    if dof >= MIN_DOF {
        findings.retain(|finding| finding.code() != Code::Unchecked);
    } else if first.is_from_points {
        findings.retain(|finding| finding.code() != Code::Unchecked);
        findings.push(Finding::UncheckedPoints { dof });
    }
    let of_position = 2 * used - UNKNOWNS + i64::from(has_height);
    let is_reported = findings.iter().any(|finding| matches!(finding, Finding::UncheckedPoints { .. }));
    if of_position < MIN_DOF && !is_linked && !is_reported {
        findings.push(Finding::UncheckedPoints { dof: of_position.max(0) });
    }
}

fn efov(
    entry: &SiteCamera,
    camera: &Camera,
    planes: &[PlanePrior],
    findings: &mut Vec<Finding>,
) -> Vec<FloorPoint> {
    let Some(corners) = &entry.efov_px else { return default_efov(camera, entry.size()).polygon };
    let named = entry.efov_plane.as_ref().and_then(|id| planes.iter().find(|plane| plane.id == *id));
    let efov = efov_on_plane(camera, corners, named.map_or(&Plane::FLOOR, |prior| &prior.plane));
    if efov.clipped {
        findings.push(Finding::EfovAboveHorizon { is_whole: efov.polygon.is_empty() });
    }
    efov.polygon
}

/// Reports uprights that contradict each other if residuals are too large. A wrong annotation affects heights
/// and orientation together, so its own residual need not be the largest.
fn height_findings(entry: &SiteCamera, camera: &Camera, findings: &[Finding]) -> Option<Finding> {
    let is_misfit = findings.iter().any(|finding| finding.code() == Code::Misfit);
    let [lowest, highest] = contradictory_uprights(camera, &entry.annotations).filter(|_| is_misfit)?;
    Some(Finding::ContradictoryUprights { lowest, highest })
}

/// Reports a distortion that cannot be inverted inside the image.
fn check_lens(entry: &SiteCamera, camera: &Camera) -> Option<Finding> {
    let is_distorted = camera.lens.distortion != Distortion::None;
    (is_distorted && !camera.lens.covers_image(entry.size())).then_some(Finding::DistortionNotInvertible)
}

/// Reports segments that give no constraint.
fn invalid_segments(constraints: &Constraints) -> impl Iterator<Item = Finding> {
    constraints.invalid.iter().map(|(source, why)| match why {
        InvalidSegment::OutsideLens => Finding::OutsideLens { line: *source },
        InvalidSegment::NoLength => Finding::NoLength { line: *source },
    })
}

/// Returns an error if a number of the result is not finite, or outside the bounds of the site file.
fn check_finite(result: CameraResult) -> Result<CameraResult, Failure> {
    let solution = &result.solution;
    let pose = solution.camera().is_none_or(|camera| {
        let angles = [camera.roll, camera.pitch, camera.yaw, camera.focal];
        let covariance = camera.covariance;
        let known = !covariance.is_known() || covariance.0.iter().flatten().all(|value| value.is_finite());
        known && camera.position.is_finite() && angles.iter().all(|value| value.is_finite())
    });
    let quality =
        [solution.rms_px, solution.chi2, solution.sigma_px].iter().flatten().all(|value| value.is_finite());
    let others = solution.alternatives.iter().all(|other| {
        [other.focal_px, other.pitch_deg, other.roll_deg, other.chi2].iter().all(|value| value.is_finite())
    });
    // A solution that could not be read again must not be written.
    let readable = check_solution(&At::root(), solution).is_ok();
    if pose && quality && others && readable { Ok(result) } else { Err(Failure::TooExtreme) }
}
