//! The whole calibration of a site: every camera by itself, then placed.

use crate::annotation::Kind;
use crate::camera::Camera;
use crate::criterion::{self, Held, Orientation};
use crate::efov::{default_efov, efov_on_floor};
use crate::evidence::Evidence;
use crate::lens::{Distortion, Lens};
use crate::likelihood::residuals_at;
use crate::placement::{ControlPoint, STAGE_1_HEIGHT, from_control_points};
use crate::report::{Code, Failure, FailureCode, Residual, ResidualOf, Warning};
use crate::site::{DistortionEntry, Method, Site, SiteCamera, Solution, Stage};
use crate::space::WorldPoint;

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
        Self { method: Method::Paper, refine: true, prior: true, cameras: None }
    }
}

/// What calibrating a site found out.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// For every camera that was asked for: its index in the site, and the result.
    pub cameras: Vec<(usize, Result<Solution, Failure>)>,
}

impl Report {
    /// The site with these results written into it; what was drawn and entered stays as it is.
    #[must_use]
    pub fn write_into(&self, site: &Site) -> Site {
        let mut solved = site.clone();
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
        Report { cameras }
    }

    fn calibrate_camera(&self, entry: &SiteCamera, options: &Options) -> Result<Solution, Failure> {
        if let Some(given) = &entry.solution
            && given.method == Method::Given
            && entry.annotations.is_empty()
        {
            return Ok(given.clone());
        }
        let known = self.known_of(entry, options)?;
        let evidence = Evidence::new(&entry.annotations, &known.lens, false);
        let mut warnings = Vec::new();
        let width = entry.size()[0];
        let (orientation, _) = criterion::minimum(&evidence, known.held, width)?;
        unused_by_the_paper(entry, &evidence, &mut warnings);
        let height = entry.height_m.filter(|height| height.fixed).map_or(STAGE_1_HEIGHT, |height| height.value);
        let first = Camera {
            position: WorldPoint::new(0.0, 0.0, height),
            yaw: 0.0,
            pitch: orientation.pitch,
            roll: orientation.roll,
            focal: orientation.focal,
            lens: known.lens,
        };
        let (camera, stage) = self.place(entry, first, &mut warnings);
        check_lens(entry, &camera, &mut warnings);
        let residuals = self.residuals(entry, &camera, orientation);
        let mut solution = solution_of(&camera, Method::Paper, stage);
        solution.efov_m = efov(entry, &camera, &mut warnings);
        solution.rms_px = rms(&residuals);
        solution.residuals = residuals;
        solution.warnings = warnings;
        Ok(solution)
    }

    /// The lens, and what is held of the orientation, its own or that of the camera it is like.
    fn known_of(&self, entry: &SiteCamera, options: &Options) -> Result<KnownOf, Failure> {
        let own = KnownOf { lens: entry.lens(), held: entry.held() };
        let Some(like) = entry.lens.as_ref().and_then(|lens| lens.like.as_ref()) else { return Ok(own) };
        let Some(other) = self.camera(like) else { return Ok(own) };
        let focal = match other.held().focal {
            Some(focal) => focal,
            None => self.calibrate_camera(other, options).map(|solution| solution.focal_px).map_err(|failure| {
                Failure::new(
                    FailureCode::MissingValue,
                    format!("The lens is that of camera \"{like}\", which has no result: {}", failure.message),
                    format!("Complete camera \"{like}\" first, or give this camera a lens of its own."),
                )
            })?,
        };
        let lens = Lens { principal_point: entry.principal_point(), ..other.lens() };
        Ok(KnownOf { lens, held: Held { focal: Some(focal), ..own.held } })
    }

    /// Stage 2: by control points, by the operator's move, turn and scale, or not at all.
    fn place(&self, entry: &SiteCamera, first: Camera, warnings: &mut Vec<Warning>) -> (Camera, Stage) {
        let fixed = entry.placement.as_ref().is_some_and(|placement| placement.fixed);
        let points: Vec<ControlPoint> = entry
            .control_points
            .iter()
            .filter(|point| !point.off)
            .filter_map(|point| point.control_point(self.plan.as_ref()))
            .collect();
        if !fixed && points.len() >= 2 {
            if let Some(camera) = from_control_points(&first, &points) {
                scale_conflict(entry, camera.position.z, warnings);
                return (camera, Stage::Placed);
            }
        }
        if !fixed && !points.is_empty() {
            warnings.push(Warning::new(
                Code::UnusedAnnotation,
                format!("{} control point(s) do not place the camera.", points.len()),
                "Two points inside the lens are needed, and more make it sure.",
            ));
        }
        match &entry.placement {
            Some(placement) => {
                let placed = placement.placement().apply(&first);
                scale_conflict(entry, placed.position.z, warnings);
                (placed, Stage::Placed)
            }
            None => (first, Stage::Partial),
        }
    }

    fn residuals(&self, entry: &SiteCamera, camera: &Camera, at: Orientation) -> Vec<Residual> {
        let mut residuals: Vec<Residual> = [false, true]
            .into_iter()
            .flat_map(|off| {
                let evidence = Evidence::new(&entry.annotations, &camera.lens, off);
                residuals_at(&evidence, at, camera.position.z, entry.size()[0])
            })
            .map(|(source, px)| Residual {
                of: ResidualOf::Annotation,
                annotation: Some(source.annotation),
                segment: Some(source.segment),
                id: None,
                px,
                outlier: false,
            })
            .collect();
        residuals.sort_by_key(|residual| (residual.annotation, residual.segment));
        for (index, point) in entry.control_points.iter().enumerate() {
            let shown = point.control_point(self.plan.as_ref()).and_then(|p| camera.world_to_pixel(p.world));
            let Some(shown) = shown else { continue };
            residuals.push(Residual {
                of: ResidualOf::ControlPoint,
                annotation: None,
                segment: None,
                id: Some(point.id.clone().unwrap_or_else(|| index.to_string())),
                px: shown.distance(point.px),
                outlier: false,
            });
        }
        residuals
    }
}

/// What is known of a camera before its lines are looked at.
struct KnownOf {
    lens: Lens,
    held: Held,
}

/// The bare solution of a camera: pose and lens.
fn solution_of(camera: &Camera, method: Method, stage: Stage) -> Solution {
    Solution {
        method,
        stage,
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
    }
}

fn efov(entry: &SiteCamera, camera: &Camera, warnings: &mut Vec<Warning>) -> Vec<crate::space::FloorPoint> {
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

fn rms(residuals: &[Residual]) -> Option<f64> {
    let used: Vec<f64> = residuals.iter().filter(|r| r.of == ResidualOf::Annotation).map(|r| r.px * r.px).collect();
    (!used.is_empty()).then(|| (used.iter().sum::<f64>() / used.len() as f64).sqrt())
}

/// A height that was entered and the one that placement gave must be of one opinion.
fn scale_conflict(entry: &SiteCamera, placed: f64, warnings: &mut Vec<Warning>) {
    /// Relative: what a hand can tell by dragging a polygon over a plan.
    const HAND: f64 = 0.02;
    let Some(height) = entry.height_m else { return };
    let sigma = height.sigma.unwrap_or(0.0).hypot(HAND * placed);
    if (height.value - placed).abs() > 3.0 * sigma {
        warnings.push(Warning::new(
            Code::ScaleConflict,
            format!("The camera was entered as {} m high and is placed {placed:.2} m high.", height.value),
            "Check the scale of the plan, the height, and the size of the EFOV polygon.",
        ));
    }
}

/// Warns when the lens folds back on itself inside the image.
fn check_lens(entry: &SiteCamera, camera: &Camera, warnings: &mut Vec<Warning>) {
    if camera.lens.distortion == Distortion::None {
        return;
    }
    let [w, h] = entry.size();
    let lost = [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]]
        .iter()
        .filter(|&&corner| camera.undistort(corner.into()).is_none())
        .count();
    if lost > 0 {
        warnings.push(Warning::new(
            Code::DistortionNotInvertible,
            format!("The distortion folds back on itself inside the image: {lost} of 4 corners show no ray."),
            "Draw straight edges nearer to the corners, or fit fewer coefficients.",
        ));
    }
}

/// What the paper's criterion cannot use is named, never dropped in silence.
fn unused_by_the_paper(entry: &SiteCamera, evidence: &Evidence, warnings: &mut Vec<Warning>) {
    let mut unused = |what: String, advice: &str| {
        let message = format!("The paper's method does not use {what}.");
        warnings.push(Warning::new(Code::UnusedAnnotation, message, advice));
    };
    for (index, annotation) in entry.annotations.iter().enumerate().filter(|(_, a)| !a.off) {
        let speaks = match annotation.kind {
            Kind::KnownLength | Kind::Upright | Kind::Straight => false,
            Kind::Vertical => true,
            kind => annotation.segments.as_ref().map_or(0, Vec::len) >= kind.row().least,
        };
        if !speaks {
            unused(annotation.label(index), "Use --method ml, or switch it off.");
        }
    }
    for source in &evidence.outside_lens {
        let label = entry.annotations[source.annotation].label(source.annotation);
        unused(
            format!("segment {} of {label}: a point of it lies where the lens shows nothing", source.segment),
            "Move the point inward, or correct the distortion.",
        );
    }
    let lens = entry.lens.as_ref();
    let priors = [
        ("lens.focal_px", lens.and_then(|l| l.focal_px)),
        ("lens.pitch_deg", lens.and_then(|l| l.pitch_deg)),
        ("lens.roll_deg", lens.and_then(|l| l.roll_deg)),
        ("height_m", entry.height_m),
    ];
    for (field, known) in priors {
        if known.is_some_and(|known| !known.fixed) {
            unused(format!("the prior {field}"), "Hold it with \"fixed\": true, or use --method ml.");
        }
    }
}
