//! Detection of stored solutions that no longer match the annotations.
//!
//! A solution contains the residual of every piece of evidence. These residuals are computed again from the
//! current annotations and the stored camera, and compared. They agree up to rounding unless a line was
//! changed. Entered or imported solutions have no residuals, so they cannot be checked.

use std::collections::HashMap;

use crate::document::{Link, LinkKind};
use crate::document::{Site, SiteCamera};
use crate::site_solution::ElementSolution;
use crate::solution::{Method, Solution, Stage};
use calib_core::camera::{Camera, Lens, Pixel, WorldPoint};
use calib_core::outcome::{Finding, Residual, ResidualOf, Subject};
use calib_core::single::{
    ConstraintKind, Constraints, Orientation, Source, StoredCamera, edges, residuals_at, residuals_of_stored,
    straightness_rms,
};

/// Largest accepted difference of a residual, in pixels. Small differences are not changes of the annotations: the
/// recomputation estimates quantities that several lines share, such as the slope of the floor, separately for every
/// line.
const MAX_DIFFERENCE_PX: f64 = 3.0;
/// Largest accepted difference of a residual, in standard deviations of the annotations.
const MAX_DIFFERENCE_SIGMAS: f64 = 3.0;
/// Largest accepted difference of a residual, relative to its value.
const MAX_DIFFERENCE_REL: f64 = 0.25;
/// Largest accepted difference for a point with a stored position, in pixels. Only rounding differs.
const MAX_POINT_DIFFERENCE_PX: f64 = 1.0;
/// Largest accepted difference for a point with a stored position, relative to its residual.
const MAX_POINT_DIFFERENCE_REL: f64 = 0.01;

/// Evidence whose stored residual does not match its recomputed residual; residuals in pixels.
#[derive(Clone, Copy, Debug)]
struct Difference {
    what: Subject,
    stored: Option<f64>,
    now: Option<f64>,
}

impl Difference {
    /// Returns the size of the difference, in pixels; infinite if one of the residuals is missing.
    fn size(&self) -> f64 {
        self.stored.zip(self.now).map_or(f64::INFINITY, |(stored, now)| (now - stored).abs())
    }
}

impl Site {
    /// Returns the indices of cameras whose solutions do not match the current annotations and values, each
    /// with its finding.
    #[must_use]
    pub fn out_of_date(&self) -> Vec<(usize, Finding)> {
        let of_camera = |(index, entry): (usize, &SiteCamera)| {
            let differences = self.differences(entry).into_iter().chain(self.link_differences(index, entry));
            let worst = differences.max_by(|a, b| a.size().total_cmp(&b.size()));
            worst.map(|Difference { what, stored, now }| {
                (index, Finding::OutOfDate { subject: what, stored, now })
            })
        };
        self.cameras.iter().enumerate().filter_map(of_camera).collect()
    }

    /// Returns the evidence of a camera that does not match its solution, without links.
    fn differences(&self, entry: &SiteCamera) -> Vec<Difference> {
        let Some(solution) = entry.solution.as_ref().filter(|solution| solution.method != Method::Given)
        else {
            return Vec::new();
        };
        let mut found = removed_lines(entry, solution);
        found.extend(self.line_differences(entry, solution));
        let camera = solution.camera();
        found.extend(
            camera.into_iter().flat_map(|camera| self.control_point_differences(entry, solution, &camera)),
        );
        found
    }

    /// Returns lines whose residuals differ from the solution, and lines that it does not contain.
    fn line_differences(&self, entry: &SiteCamera, solution: &Solution) -> Vec<Difference> {
        let is_on = |source: Source| is_switched_off(entry, source).is_some_and(|is_off| !is_off);
        let known = solution.residuals.iter().filter_map(|residual| Some((source(residual)?, residual)));
        let stored: HashMap<Source, &Residual> = known.filter(|(source, _)| is_on(*source)).collect();
        if stored.is_empty() {
            return Vec::new();
        }
        let now = self.residuals_now(entry, solution, &stored);
        let sigma = solution.sigma_px.unwrap_or(1.0);
        let comparable = |source: &Source| is_comparable(entry, solution, *source);
        let difference = |(&source, known): (&Source, &&Residual)| {
            let nearest = now.iter().filter_map(|now| now.get(&source)).copied().min_by(|a, b| {
                let off = |px: &f64| (px.abs() - known.px.abs()).abs();
                off(a).total_cmp(&off(b))
            });
            let difference = Difference { what: Subject::Line(source), stored: Some(known.px), now: nearest };
            (!nearest.is_some_and(|now| is_same(known.px, now, sigma))).then_some(difference)
        };
        let mut found: Vec<Difference> =
            stored.iter().filter(|(source, _)| comparable(source)).filter_map(difference).collect();
        let drawn = now.first().into_iter().flatten();
        let new = drawn.filter(|(source, _)| !stored.contains_key(*source) && comparable(source));
        found.extend(new.map(|(&source, &px)| Difference {
            what: Subject::Line(source),
            stored: None,
            now: Some(px),
        }));
        found
    }

    /// Computes the residuals of the current annotations under the stored camera, with the assumed and with
    /// the estimated noise. The file does not record which of the two separated scene errors from annotation
    /// noise.
    fn residuals_now(
        &self,
        entry: &SiteCamera,
        solution: &Solution,
        stored: &HashMap<Source, &Residual>,
    ) -> Vec<HashMap<Source, f64>> {
        let straight = straight_residuals(entry, &solution.lens());
        let Some(camera) = solution.camera() else { return vec![straight.into_iter().collect()] };
        let (scene, planes) = (self.scene_errors(entry), self.plane_priors());
        let constraints = Constraints::on_planes(&entry.annotations, &camera.lens, scene, &planes);
        let at = Orientation { roll: camera.roll, pitch: camera.pitch, focal: camera.focal };
        let is_refined = solution.stage == Stage::Refined;
        // For a camera placed by hand, the residuals were computed before the placement.
        let own_height = entry.fixed_parameters(&entry.lens()).height.filter(|_| !is_refined);
        let (height, width) = (own_height.unwrap_or(camera.position.z), entry.size()[0]);
        if solution.method == Method::Paper {
            let found = residuals_at(&constraints, at, height, width);
            return vec![found.into_iter().chain(straight).collect()];
        }
        let rejected: Vec<Source> =
            stored.iter().filter(|(_, residual)| residual.outlier).map(|(source, _)| *source).collect();
        let held = |sigma: f64| StoredCamera {
            orientation: at,
            height,
            is_height_free: !is_refined && own_height.is_none(),
            height_prior: entry.priors(&entry.lens()).height,
            sigma,
            rejected: &rejected,
            width,
        };
        let noises = [entry.sigma_px.unwrap_or(1.0), solution.sigma_px.unwrap_or(1.0)];
        let found = noises.map(|sigma| residuals_of_stored(&constraints, &held(sigma)));
        found.into_iter().map(|found| found.into_iter().chain(straight.iter().copied()).collect()).collect()
    }

    /// Returns control points whose residuals differ from the solution.
    fn control_point_differences(
        &self,
        entry: &SiteCamera,
        solution: &Solution,
        camera: &Camera,
    ) -> Vec<Difference> {
        let points = entry.control_points.iter().enumerate();
        let now: HashMap<String, (usize, Option<f64>)> = points
            .map(|(index, point)| {
                let shown = point.control_point(self).and_then(|p| camera.world_to_pixel(p.world));
                (point.label(index), (index, shown.map(|shown| shown.distance(point.px))))
            })
            .collect();
        let stored = solution.residuals.iter().filter(|residual| residual.of == ResidualOf::ControlPoint);
        let difference = |residual: &Residual| {
            let &(index, now) = now.get(residual.id.as_ref()?)?;
            let what = Subject::OwnControlPoint(index);
            let is_same = now.is_some_and(|now| is_same_point(residual.px, now));
            (!is_same).then_some(Difference { what, stored: Some(residual.px), now })
        };
        stored.filter_map(difference).collect()
    }

    /// Returns links (points and posts) whose residuals in this camera differ from the solution.
    fn link_differences(&self, index: usize, entry: &SiteCamera) -> Vec<Difference> {
        let Some(camera) = entry.camera().filter(|_| self.owns_links(index)) else { return Vec::new() };
        let of_link = |(index, link): (usize, &Link)| {
            let found = link.solution.as_ref()?;
            let of_camera = found.residuals.iter().filter(|seen| seen.camera == entry.id);
            let stored: Vec<f64> = of_camera.map(|seen| seen.px).collect();
            let now = link_residuals(link, found, &entry.id, &camera)?;
            let pairs = || stored.iter().copied().zip(now.iter().copied());
            let differs = pairs().find(|&(stored, now)| !is_same_point(stored, now)).unzip();
            let (stored_px, now_px) = if stored.len() == now.len() { differs } else { (None, None) };
            let what = Subject::Link(index);
            stored_px.map(|stored| Difference { what, stored: Some(stored), now: now_px })
        };
        self.links.iter().enumerate().filter_map(of_link).collect()
    }
}

/// Computes the residuals of a link in one camera, in pixels. Returns `None` for a line, for a link on a
/// plane, and for a point that the camera cannot see.
fn link_residuals(link: &Link, found: &ElementSolution, id: &str, camera: &Camera) -> Option<Vec<f64>> {
    let foot = found.at_m;
    let head = WorldPoint { z: foot.z + found.length_m.unwrap_or(0.0), ..foot };
    let is_placed = link.plane.is_none() && link.kind != LinkKind::Line;
    let seen = link.seen.iter().filter(|seen| seen.camera == id);
    let points = seen.flat_map(|seen| [(seen.px, foot), (seen.foot, foot), (seen.head, head)]);
    let drawn = points.filter_map(|(pixel, at)| Some((pixel?, at)));
    let off = |(pixel, at): (Pixel, WorldPoint)| Some(camera.world_to_pixel(at)?.distance(pixel));
    is_placed.then(|| drawn.map(off).collect())?
}

/// Whether the residual of a point is unchanged, up to rounding.
fn is_same_point(stored: f64, now: f64) -> bool {
    (now - stored).abs() <= MAX_POINT_DIFFERENCE_PX + MAX_POINT_DIFFERENCE_REL * stored.abs()
}

/// Whether the residual of a line is unchanged, as far as it can be recomputed.
fn is_same(stored: f64, now: f64, sigma: f64) -> bool {
    let most = MAX_DIFFERENCE_PX
        .max(MAX_DIFFERENCE_SIGMAS * sigma)
        .max(MAX_DIFFERENCE_REL * stored.abs().max(now.abs()));
    (now.abs() - stored.abs()).abs() <= most
}

/// Whether the residual of a line can be recomputed from the stored camera. Exceptions are sizes with the
/// paper's method, which does not estimate the height, and all lines of cameras below the floor. Lines on
/// planes are also excluded, because the position of a plane is not stored with the camera.
fn is_comparable(entry: &SiteCamera, solution: &Solution, source: Source) -> bool {
    let drawn = &entry.annotations[source.annotation];
    let is_size = matches!(drawn.kind.row().constraint, ConstraintKind::Length | ConstraintKind::Upright);
    let has_height = solution.position_m.is_none_or(|at| at.z > 0.0);
    drawn.plane.is_none() && has_height && !(solution.method == Method::Paper && is_size)
}

/// Returns the annotated line of a residual; `None` for other evidence.
fn source(residual: &Residual) -> Option<Source> {
    let of_drawing = residual.of == ResidualOf::Annotation;
    let (annotation, segment) = residual.annotation.zip(residual.segment).filter(|_| of_drawing)?;
    Some(Source { annotation, segment })
}

/// Returns whether the annotation of a line is switched off; `None` if the line does not exist.
fn is_switched_off(entry: &SiteCamera, source: Source) -> Option<bool> {
    let annotation = entry.annotations.get(source.annotation)?;
    let count = annotation.segments.as_ref().map_or(1, Vec::len);
    (source.segment < count).then_some(annotation.off)
}

/// Returns lines with residuals in the solution that no longer exist.
fn removed_lines(entry: &SiteCamera, solution: &Solution) -> Vec<Difference> {
    let sources = solution.residuals.iter().filter_map(|residual| Some((source(residual)?, residual.px)));
    let gone = sources.filter(|(source, _)| is_switched_off(entry, *source).is_none());
    gone.map(|(source, px)| Difference { what: Subject::Line(source), stored: Some(px), now: None }).collect()
}

/// Computes the RMS deviations of straight edges from straight lines under a lens, in raw pixels.
fn straight_residuals(entry: &SiteCamera, lens: &Lens) -> Vec<(Source, f64)> {
    let edges = edges(&entry.annotations);
    let straight = edges.iter().filter(|edge| entry.annotations[edge.source.annotation].is_straight_edge());
    straight.filter_map(|edge| Some((edge.source, straightness_rms(lens, &edge.points)?))).collect()
}
