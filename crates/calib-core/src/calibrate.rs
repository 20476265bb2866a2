//! The whole calibration of a site: every camera by itself, then placed.

use crate::advice::{draw_next, warnings};
use crate::annotation::{Annotation, Kind, Shape, line_name};
use crate::bounds::At;
use crate::camera::Camera;
use crate::check::check_solution;
use crate::covariance::Covariance;
use crate::criterion::{self, Held};
use crate::efov::{default_efov, efov_on_floor};
use crate::evidence::{Evidence, Mute, Source};
use crate::fit::{Fit, FitOptions, Solved};
use crate::lens::{Distortion, Lens};
use crate::likelihood::{Priors, residuals_at};
use crate::optics::Optics;
use crate::placement::STAGE_1_HEIGHT;
use crate::placing::placed_uncertainty;
use crate::report::{Code, Failure, FailureCode, Residual, ResidualOf, Warning};
use crate::site::{Site, SiteCamera};
use crate::solution::{
    Alternative, CovarianceEntry, DistortionEntry, Method, Sigmas, SiteSolution, Solution, Stage,
};
use crate::space::{FloorPoint, WorldPoint};

/// How to calibrate.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// By which method stage 1 is solved.
    pub method: Method,
    /// Improve all cameras together.
    pub refine: bool,
    /// Let a weak belief about the focal enter where the lines do not tell it.
    pub prior: bool,
    /// Ids of the cameras to solve; all of them if absent.
    pub cameras: Option<Vec<String>>,
}

impl Default for Options {
    fn default() -> Self {
        Self { method: Method::MaximumLikelihood, refine: true, prior: true, cameras: None }
    }
}

/// What calibrating a site found out.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// For every camera that was asked for: its index in the site, and the result.
    pub cameras: Vec<(usize, Result<Solution, Failure>)>,
    /// What is to be said of the site as a whole.
    pub site: SiteSolution,
}

impl Report {
    /// The site with these results written into it; what was drawn and entered stays as it is.
    #[must_use]
    pub fn write_into(&self, site: &Site) -> Site {
        let mut solved = site.clone();
        solved.solution = (!self.site.warnings.is_empty()).then(|| self.site.clone());
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
    /// Calibrates every camera that `options` asks for. A camera that cannot be solved does not keep
    /// the others from it.
    #[must_use]
    pub fn calibrate(&self, options: &Options) -> Report {
        let asked = |camera: &SiteCamera| options.cameras.as_ref().is_none_or(|ids| ids.contains(&camera.id));
        let cameras = self
            .cameras
            .iter()
            .enumerate()
            .filter(|(_, camera)| asked(camera))
            .map(|(index, camera)| (index, self.calibrate_camera(camera, options)))
            .collect();
        let warnings = self.unused_elements();
        let site = SiteSolution {
            components: Vec::new(),
            scale: None,
            loop_closure_m: None,
            overlaps: Vec::new(),
            warnings,
        };
        Report { cameras, site }
    }

    /// What ties cameras together is not used while every camera is solved by itself.
    fn unused_elements(&self) -> Vec<Warning> {
        let links = self.links.iter().filter(|link| !link.off && !link.seen.is_empty()).count();
        let marks = self.marks.iter().filter(|mark| !mark.off && !mark.seen.is_empty()).count();
        let distances = self.distances.iter().filter(|distance| !distance.off).count();
        let unused = |(count, what): (usize, &str)| {
            let message = format!("{count} {what} are not used: every camera is solved by itself.");
            let advice = "Place every camera by its polygon or by control points.";
            (count > 0).then(|| Warning::new(Code::UnusedAnnotation, message, advice))
        };
        let list = [(links, "links"), (marks, "marks tied to pixels"), (distances, "distances")];
        list.into_iter().filter_map(unused).collect()
    }

    fn calibrate_camera(&self, entry: &SiteCamera, options: &Options) -> Result<Solution, Failure> {
        if let Some(given) = &entry.solution
            && given.method == Method::Given
            && entry.annotations.is_empty()
        {
            return Ok(given.clone());
        }
        let optics = self.optics(entry);
        let (lens, held) = (optics.lens, self.held_of(entry, options)?);
        let evidence = Evidence::new(&entry.annotations, &lens, false);
        if evidence.is_empty() && optics.fit.is_some() {
            return check_finite(lens_only(entry, &optics));
        }
        let mut solution = match options.method {
            Method::Paper => paper(entry, &evidence, lens, held)?,
            Method::MaximumLikelihood | Method::Given => {
                likelihood(entry, &evidence, lens, held, options.prior)?
            }
        };
        let Some(first) = solution.camera() else { return Ok(solution) };
        let (camera, stage) = self.place(entry, first, &mut solution.warnings);
        solution.position_m = Some(camera.position);
        solution.yaw_deg = Some(camera.yaw.to_degrees());
        solution.stage = stage;
        if options.method != Method::Paper && stage > Stage::Partial {
            placed_uncertainty(entry, &camera, &mut solution);
        }
        solution.residuals.extend(listed(optics.straightness.iter().copied(), &[]));
        solution.residuals.sort_by_key(|residual| (residual.annotation, residual.segment));
        solution.warnings.extend(optics.warnings(&entry.annotations));
        mute(entry, &evidence, &mut solution.warnings);
        check_lens(entry, &camera, &mut solution.warnings);
        solution.efov_m = efov(entry, &camera, &mut solution.warnings);
        self.add_control_residuals(entry, &camera, &mut solution);
        check_finite(solution)
    }

    /// What is held of the orientation; the focal may be that of the camera this one is like.
    fn held_of(&self, entry: &SiteCamera, options: &Options) -> Result<Held, Failure> {
        let own = entry.held();
        let Some(like) = entry.lens.as_ref().and_then(|lens| lens.like.as_ref()) else { return Ok(own) };
        let Some(other) = self.camera(like) else { return Ok(own) };
        let focal = match other.held().focal {
            Some(focal) => focal,
            None => self.calibrate_camera(other, options).map(|solution| solution.focal_px).map_err(
                |failure| {
                    Failure::new(
                        FailureCode::MissingValue,
                        format!(
                            "The lens is that of camera \"{like}\", which has no result: {}",
                            failure.message
                        ),
                        format!("Complete camera \"{like}\" first, or give this camera a lens of its own."),
                    )
                },
            )?,
        };
        Ok(Held { focal: Some(focal), ..own })
    }
}

/// Stage 1 by the joint fit in pixels.
fn likelihood(
    entry: &SiteCamera,
    evidence: &Evidence,
    lens: Lens,
    held: Held,
    prior: bool,
) -> Result<Solution, Failure> {
    let keep: Vec<usize> = (0..entry.annotations.len()).filter(|&i| entry.annotations[i].keep).collect();
    let options = FitOptions {
        lens,
        size: entry.size(),
        efov: entry.efov_px.as_deref().unwrap_or_default(),
        held,
        // What is held needs no belief beside it.
        priors: Priors { focal: entry.priors().focal.filter(|_| held.focal.is_none()), ..entry.priors() },
        sigma: entry.sigma_px,
        weak_belief: prior,
        keep: &keep,
    };
    let fit = Fit::new(evidence, &options)?;
    let next = draw_next(&fit, evidence, &options);
    let mut solution = solution_of(&fit.camera, Method::MaximumLikelihood);
    solution.sigma = Some(Sigmas::of(&fit.camera, fit.floor_length_rel));
    solution.covariance = CovarianceEntry::of(&fit.camera);
    solution.sigma_px = Some(fit.sigma);
    solution.chi2 = Some(fit.chi2);
    solution.dof = usize::try_from(fit.dof).ok();
    solution.alternatives = fit.alternatives.iter().map(|other| alternative(other, entry)).collect();
    solution.warnings = warnings(&fit, &entry.annotations, next.as_ref());
    solution.draw_next = next;
    unused(&entry.annotations, "The fit does not use", |_| false, &mut solution.warnings);
    let off = Evidence::new(&entry.annotations, &lens, true);
    let at =
        criterion::Orientation { roll: fit.camera.roll, pitch: fit.camera.pitch, focal: fit.camera.focal };
    let residuals =
        fit.residuals.iter().copied().chain(residuals_at(&off, at, fit.camera.position.z, entry.size()[0]));
    solution.residuals = listed(residuals, &fit.outliers);
    solution.rms_px = rms(&entry.annotations, &solution.residuals);
    Ok(solution)
}

fn alternative(other: &Solved, entry: &SiteCamera) -> Alternative {
    let focal = other.orientation.focal;
    Alternative {
        focal_px: focal,
        hfov_deg: 2.0 * (0.5 * entry.size()[0] / focal).atan().to_degrees(),
        pitch_deg: other.orientation.pitch.to_degrees(),
        roll_deg: other.orientation.roll.to_degrees(),
        chi2: other.chi2,
    }
}

/// Stage 1 as the paper has it.
fn paper(entry: &SiteCamera, evidence: &Evidence, lens: Lens, held: Held) -> Result<Solution, Failure> {
    let width = entry.size()[0];
    let (at, _) = criterion::minimum(evidence, held, width)?;
    let height = held.height.unwrap_or(STAGE_1_HEIGHT);
    let camera = Camera {
        position: WorldPoint::new(0.0, 0.0, height),
        yaw: 0.0,
        pitch: at.pitch,
        roll: at.roll,
        focal: at.focal,
        lens,
        covariance: Covariance::EXACT,
    };
    let mut solution = solution_of(&camera, Method::Paper);
    let off = Evidence::new(&entry.annotations, &lens, true);
    let both = [evidence, &off].into_iter().flat_map(|evidence| residuals_at(evidence, at, height, width));
    solution.residuals = listed(both, &[]);
    solution.rms_px = rms(&entry.annotations, &solution.residuals);
    let unknown = |kind| matches!(kind, Kind::KnownLength | Kind::Upright);
    unused(&entry.annotations, "The paper's method does not use", unknown, &mut solution.warnings);
    priors_unused(entry, &mut solution.warnings);
    Ok(solution)
}

fn listed(residuals: impl Iterator<Item = (Source, f64)>, outliers: &[Source]) -> Vec<Residual> {
    let mut list: Vec<Residual> = residuals
        .filter(|(_, px)| px.is_finite())
        .map(|(source, px)| Residual {
            of: ResidualOf::Annotation,
            annotation: Some(source.annotation),
            segment: Some(source.segment),
            id: None,
            px,
            outlier: outliers.contains(&source),
        })
        .collect();
    list.sort_by_key(|residual| (residual.annotation, residual.segment));
    list
}

/// The solution of a camera whose straight edges are all that was drawn: its lens.
fn lens_only(entry: &SiteCamera, optics: &Optics) -> Solution {
    // Without a focal the width of the image is the unit of the coefficients.
    let focal =
        entry.lens.as_ref().and_then(|lens| lens.focal_px).map_or(entry.size()[0], |focal| focal.value);
    let camera = Camera {
        position: WorldPoint::default(),
        yaw: 0.0,
        pitch: 0.0,
        roll: 0.0,
        focal,
        lens: optics.lens,
        covariance: Covariance::EXACT,
    };
    let mut solution = Solution {
        position_m: None,
        yaw_deg: None,
        pitch_deg: None,
        roll_deg: None,
        stage: Stage::Lens,
        ..solution_of(&camera, Method::MaximumLikelihood)
    };
    solution.residuals = listed(optics.straightness.iter().copied(), &[]);
    solution.rms_px = rms(&entry.annotations, &solution.residuals);
    solution.warnings = optics.warnings(&entry.annotations);
    check_lens(entry, &camera, &mut solution.warnings);
    solution
}

/// The bare solution of a camera: pose and lens.
fn solution_of(camera: &Camera, method: Method) -> Solution {
    Solution {
        method,
        stage: Stage::Partial,
        position_m: Some(camera.position),
        yaw_deg: Some(camera.yaw.to_degrees()),
        pitch_deg: Some(camera.pitch.to_degrees()),
        roll_deg: Some(camera.roll.to_degrees()),
        focal_px: camera.focal,
        principal_point_px: camera.lens.principal_point,
        distortion: DistortionEntry::of(&camera.lens, camera.focal),
        sigma: None,
        covariance: None,
        sigma_px: None,
        rms_px: None,
        chi2: None,
        dof: None,
        efov_m: Vec::new(),
        residuals: Vec::new(),
        alternatives: Vec::new(),
        warnings: Vec::new(),
        draw_next: None,
    }
}

fn efov(entry: &SiteCamera, camera: &Camera, warnings: &mut Vec<Warning>) -> Vec<FloorPoint> {
    let Some(corners) = &entry.efov_px else { return default_efov(camera, entry.size()).polygon };
    let efov = efov_on_floor(camera, corners);
    if efov.clipped {
        let message = if efov.polygon.is_empty() {
            "The whole EFOV lies above the horizon or outside the lens."
        } else {
            "A part of the EFOV lies above the horizon, farther than 50 camera heights, or outside the lens; it was cut off."
        };
        let advice = "Draw the far edge of the EFOV lower, where the floor can still be told.";
        warnings.push(Warning::new(Code::EfovAboveHorizon, message, advice));
    }
    efov.polygon
}

/// Root mean square of the residuals of what was used.
fn rms(annotations: &[Annotation], residuals: &[Residual]) -> Option<f64> {
    let is_used = |r: &&Residual| !r.outlier && r.annotation.is_some_and(|index| !annotations[index].off);
    let squares: Vec<f64> = residuals.iter().filter(is_used).map(|r| r.px * r.px).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Warns when the lens folds back on itself inside the image.
fn check_lens(entry: &SiteCamera, camera: &Camera, warnings: &mut Vec<Warning>) {
    if camera.lens.distortion == Distortion::None {
        return;
    }
    let [w, h] = entry.size();
    let corners = [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]];
    let lost = corners.iter().filter(|&&corner| camera.undistort(corner.into()).is_none()).count();
    if lost > 0 {
        warnings.push(Warning::new(
            Code::DistortionNotInvertible,
            format!("The distortion folds back on itself inside the image: {lost} of 4 corners show no ray."),
            "Draw straight edges nearer to the corners, or fit fewer coefficients.",
        ));
    }
}

/// What a method cannot use is named, never dropped in silence.
fn unused(
    annotations: &[Annotation],
    who: &str,
    unknown: impl Fn(Kind) -> bool,
    warnings: &mut Vec<Warning>,
) {
    for (index, annotation) in annotations.iter().enumerate().filter(|(_, a)| !a.off) {
        let row = annotation.kind.row();
        let drawn = annotation.segments.as_ref().map_or(0, Vec::len);
        let tied = annotation.at_right_angles_to.is_some()
            || annotation.id.is_some() && annotations.iter().any(|a| a.at_right_angles_to == annotation.id);
        let (why, advice) = if unknown(annotation.kind) {
            (String::new(), "Switch it off, or use a method that does.")
        } else if row.shape == Shape::Segments && drawn < row.least && !(tied && drawn > 0) {
            (format!(": it has {drawn} segment(s) and needs {}", row.least), "Draw the missing segments.")
        } else {
            continue;
        };
        let message = format!("{who} {}{why}.", annotation.label(index));
        warnings.push(Warning::new(Code::UnusedAnnotation, message, advice));
    }
}

fn mute(entry: &SiteCamera, evidence: &Evidence, warnings: &mut Vec<Warning>) {
    for (source, why) in &evidence.mute {
        let label = entry.annotations[source.annotation].label(source.annotation);
        let (says, advice) = match why {
            Mute::OutsideLens => (
                "has a point where the lens shows nothing",
                "Move the point inward, or correct the distortion.",
            ),
            Mute::NoLength => ("has no length", "Draw it again, or delete it."),
        };
        let name = line_name(&entry.annotations, source.annotation, source.segment);
        let message = format!("{name} of {label} {says}.");
        warnings.push(Warning::new(Code::UnusedAnnotation, message, advice));
    }
}

/// A result with a number that is none is no result.
fn check_finite(solution: Solution) -> Result<Solution, Failure> {
    let pose = solution.camera().is_none_or(|camera| {
        let angles = [camera.roll, camera.pitch, camera.yaw, camera.focal];
        let known = camera.covariance.0.iter().flatten().all(|value| value.is_finite());
        known && camera.position.is_finite() && angles.iter().all(|value| value.is_finite())
    });
    let quality =
        [solution.rms_px, solution.chi2, solution.sigma_px].iter().flatten().all(|value| value.is_finite());
    let others = solution.alternatives.iter().all(|other| {
        [other.focal_px, other.pitch_deg, other.roll_deg, other.chi2].iter().all(|value| value.is_finite())
    });
    // What cannot be read again must not be written.
    let readable = check_solution(&At::root(), &solution).is_ok();
    if pose && quality && others && readable {
        return Ok(solution);
    }
    Err(Failure::new(
        FailureCode::NoSolution,
        "The numbers drawn and entered are too extreme to be calculated with.",
        "Look for a value that is thousands of times too large or too small.",
    ))
}

fn priors_unused(entry: &SiteCamera, warnings: &mut Vec<Warning>) {
    let lens = entry.lens.as_ref();
    let priors = [
        ("lens.focal_px", lens.and_then(|l| l.focal_px)),
        ("lens.pitch_deg", lens.and_then(|l| l.pitch_deg)),
        ("lens.roll_deg", lens.and_then(|l| l.roll_deg)),
        ("height_m", entry.height_m),
    ];
    for (field, _) in priors.iter().filter(|(_, known)| known.is_some_and(|known| !known.fixed)) {
        warnings.push(Warning::new(
            Code::UnusedAnnotation,
            format!("The paper's method does not use the prior {field}."),
            "Hold it with \"fixed\": true, or use --method ml.",
        ));
    }
}
