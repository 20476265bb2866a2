//! Whether the solutions that a site brings along are of what is drawn in it now.
//!
//! A solution says of every piece of evidence how far it is from the prediction. The same is worked out anew from
//! what is there now and the camera as the solution has it, and both are compared: numbers that were rounded agree,
//! a line that was drawn elsewhere does not. What a solution says no residuals of, as one that was typed or
//! imported, cannot be compared, and nothing is said of it.

use std::collections::HashMap;

use crate::document::{Link, LinkKind};
use crate::document::{Site, SiteCamera};
use crate::site_solution::ElementSolution;
use crate::solution::{Method, Solution, Stage};
use calib_core::camera::{Camera, Lens, Pixel, WorldPoint};
use calib_core::outcome::{Finding, Residual, ResidualOf, Subject};
use calib_core::single::{
    ConstraintKind, Constraints, Held, Orientation, Source, edges, residuals_at, residuals_held,
    straightness_rms,
};

/// Pixels by which a residual may differ: what cameras have in common, as the fall of a floor, is estimated of each
/// by itself here.
const MOST_PX: f64 = 3.0;
/// The same in standard deviations of what is drawn, and relative to the residual.
const MOST_SIGMAS: f64 = 3.0;
const MOST_RELATIVE: f64 = 0.25;
/// The same, in pixels and relative, of a point whose place is written, too: all that differs is rounding.
const MOST_PX_OF_POINT: f64 = 1.0;
const MOST_RELATIVE_OF_POINT: f64 = 0.01;

/// A piece of evidence that is not what the solution says.
#[derive(Clone, Copy, Debug)]
struct Difference {
    what: Subject,
    stored: Option<f64>,
    now: Option<f64>,
}

impl Difference {
    /// How far off: what only one of both knows differs most.
    fn size(&self) -> f64 {
        self.stored.zip(self.now).map_or(f64::INFINITY, |(stored, now)| (now - stored).abs())
    }
}

impl Site {
    /// The cameras, by their indices, whose solutions are not of what is drawn and entered now, each with the
    /// finding that says so.
    #[must_use]
    pub fn out_of_date(&self) -> Vec<(usize, Finding)> {
        let of_camera = |(index, entry): (usize, &SiteCamera)| {
            let differences = self.differences(entry).into_iter().chain(self.of_links(index, entry));
            let worst = differences.max_by(|a, b| a.size().total_cmp(&b.size()));
            worst.map(|Difference { what, stored, now }| (index, Finding::OutOfDate { what, stored, now }))
        };
        self.cameras.iter().enumerate().filter_map(of_camera).collect()
    }

    fn differences(&self, entry: &SiteCamera) -> Vec<Difference> {
        let Some(solution) = entry.solution.as_ref().filter(|solution| solution.method != Method::Given)
        else {
            return Vec::new();
        };
        let mut found = gone(entry, solution);
        found.extend(self.of_drawings(entry, solution));
        let camera = solution.camera();
        found.extend(camera.into_iter().flat_map(|camera| self.of_control_points(entry, solution, &camera)));
        found
    }

    /// Lines whose residuals are not those of the solution, and lines that it does not know.
    fn of_drawings(&self, entry: &SiteCamera, solution: &Solution) -> Vec<Difference> {
        let is_on = |source: Source| drawing_of(entry, source).is_some_and(|is_off| !is_off);
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

    /// The residuals of what is drawn now at a camera: with the noise that was assumed, and with that which the
    /// solution found, for the solution does not say with which the scene's own errors were told from it.
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
        // Of a camera that was placed by hand the residuals are those of before.
        let own_height = entry.fixed_parameters().height.filter(|_| !is_refined);
        let (height, width) = (own_height.unwrap_or(camera.position.z), entry.size()[0]);
        if solution.method == Method::Paper {
            let found = residuals_at(&constraints, at, height, width);
            return vec![found.into_iter().chain(straight).collect()];
        }
        let rejected: Vec<Source> =
            stored.iter().filter(|(_, residual)| residual.outlier).map(|(source, _)| *source).collect();
        let held = |sigma: f64| Held {
            orientation: at,
            height,
            height_is_free: !is_refined && own_height.is_none(),
            height_prior: entry.priors().height,
            sigma,
            rejected: &rejected,
            width,
        };
        let noises = [entry.sigma_px.unwrap_or(1.0), solution.sigma_px.unwrap_or(1.0)];
        let found = noises.map(|sigma| residuals_held(&constraints, &held(sigma)));
        found.into_iter().map(|found| found.into_iter().chain(straight.iter().copied()).collect()).collect()
    }

    /// Control points whose residuals are not those of the solution.
    fn of_control_points(&self, entry: &SiteCamera, solution: &Solution, camera: &Camera) -> Vec<Difference> {
        let points = entry.control_points.iter().enumerate();
        let now: HashMap<String, (usize, Option<f64>)> = points
            .map(|(index, point)| {
                let shown =
                    point.control_point(self.plan.as_ref()).and_then(|p| camera.world_to_pixel(p.world));
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

    /// Points and posts that cameras share whose residuals in this one are not those of the solution.
    fn of_links(&self, index: usize, entry: &SiteCamera) -> Vec<Difference> {
        let Some(camera) = entry.camera().filter(|_| self.has_shared(index)) else { return Vec::new() };
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

/// How far a link is from where it was found in what one camera shows of it; `None` of what has no place of its own
/// in the solution.
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

/// Whether the residual of a point is what it was, but for rounding.
fn is_same_point(stored: f64, now: f64) -> bool {
    (now - stored).abs() <= MOST_PX_OF_POINT + MOST_RELATIVE_OF_POINT * stored.abs()
}

/// Whether a residual is what it was, as far as it can be worked out anew.
fn is_same(stored: f64, now: f64, sigma: f64) -> bool {
    let most = MOST_PX.max(MOST_SIGMAS * sigma).max(MOST_RELATIVE * stored.abs().max(now.abs()));
    (now.abs() - stored.abs()).abs() <= most
}

/// Whether the residual of a line is that of the camera as the solution has it: of the paper's camera the height is
/// not known from sizes, below the floor nothing is, and where planes are stands elsewhere.
fn is_comparable(entry: &SiteCamera, solution: &Solution, source: Source) -> bool {
    let drawn = &entry.annotations[source.annotation];
    let is_size = matches!(drawn.kind.row().constraint, ConstraintKind::Length | ConstraintKind::Upright);
    let has_height = solution.position_m.is_none_or(|at| at.z > 0.0);
    drawn.plane.is_none() && has_height && !(solution.method == Method::Paper && is_size)
}

fn source(residual: &Residual) -> Option<Source> {
    let of_drawing = residual.of == ResidualOf::Annotation;
    let (annotation, segment) = residual.annotation.zip(residual.segment).filter(|_| of_drawing)?;
    Some(Source { annotation, segment })
}

/// Whether a drawing is switched off; `None` where it is not there.
fn drawing_of(entry: &SiteCamera, source: Source) -> Option<bool> {
    let annotation = entry.annotations.get(source.annotation)?;
    let count = annotation.segments.as_ref().map_or(1, Vec::len);
    (source.segment < count).then_some(annotation.off)
}

/// Lines that the solution has residuals of and that are not there.
fn gone(entry: &SiteCamera, solution: &Solution) -> Vec<Difference> {
    let sources = solution.residuals.iter().filter_map(|residual| Some((source(residual)?, residual.px)));
    let gone = sources.filter(|(source, _)| drawing_of(entry, *source).is_none());
    gone.map(|(source, px)| Difference { what: Subject::Line(source), stored: Some(px), now: None }).collect()
}

/// How far straight edges are from straight under a lens.
fn straight_residuals(entry: &SiteCamera, lens: &Lens) -> Vec<(Source, f64)> {
    let edges = edges(&entry.annotations);
    let straight = edges.iter().filter(|edge| entry.annotations[edge.source.annotation].is_straight_edge());
    straight.filter_map(|edge| Some((edge.source, straightness_rms(lens, &edge.points)?))).collect()
}
