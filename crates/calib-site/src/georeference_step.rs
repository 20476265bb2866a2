//! Georeference of a site with other coordinates, such as a plan, from geographic control points in the images of
//! its solved cameras.

use std::collections::HashSet;

use calib_core::floor::{GeographicPair, GeoreferenceFit, Ruler, RulerPoint};
use calib_core::outcome::{Finding, Subject, UnusedReason};
use calib_core::{Camera, FloorPoint};
use nalgebra::DMatrix;

use crate::document::{ControlPointEntry, Site, SiteCamera};
use crate::frame::Frame;
use crate::geographic::SurveyedPosition;
use crate::site_solution::GeoreferenceSolution;
use crate::solution::{FailureEntry, Solution};

/// Distance of a camera from the origin of the map above which a finding is reported, in metres. At this distance the
/// ground is 2 m below the plane of the floor.
const MAX_SITE_RADIUS: f64 = 5e3;

/// Georeference of a site, and findings about its points.
#[derive(Debug, Default)]
pub(crate) struct MapResult {
    pub(crate) georeference: Option<GeoreferenceSolution>,
    pub(crate) findings: Vec<Finding>,
}

/// Control points in use that have map coordinates, and also site coordinates that are entered or computed from the
/// cameras.
#[derive(Debug, Default)]
struct MappedPoints {
    /// Index of the camera, and index of the control point in this camera, for every point.
    indices: Vec<[usize; 2]>,
    pairs: Vec<GeographicPair>,
    /// Standard deviation of the difference between the site position and the map position of every point, for each
    /// coordinate, in metres.
    sigmas: Vec<f64>,
}

impl MappedPoints {
    /// Reports the control point whose map coordinates contradict the other points, if there is one. It is the point
    /// without which the others agree best. At least three points are needed.
    fn far_from_map(&self) -> Option<Finding> {
        /// Largest distance of a correct point, in standard deviations of a coordinate.
        const MAX_SIGMAS: f64 = 5.0;
        let worst_of = |fit: &GeoreferenceFit, skipped: Option<usize>| {
            let scaled = fit.distances(&self.pairs).into_iter().zip(&self.sigmas).enumerate();
            let used = scaled.filter(|(index, _)| Some(*index) != skipped);
            used.map(|(_, (distance, sigma))| distance / sigma).fold(0.0, f64::max)
        };
        if self.pairs.len() < 3 || worst_of(&GeoreferenceFit::new(&self.pairs)?, None) < MAX_SIGMAS {
            return None;
        }
        let without = |skipped: usize| {
            let mut others = self.pairs.clone();
            others.remove(skipped);
            let fit = GeoreferenceFit::new(&others)?;
            Some((worst_of(&fit, Some(skipped)), skipped, fit.distances(&self.pairs)[skipped]))
        };
        let (_, worst, distance) =
            (0..self.pairs.len()).filter_map(without).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let [camera, point] = self.indices[worst];
        Some(Finding::FarFromMap { camera, point, distance })
    }
}

impl Site {
    /// Returns the georeference from the control points with coordinates on the map, and findings about them.
    /// `solved` returns the site with its solved cameras.
    pub(crate) fn solve_georeference(&self, solved: impl FnOnce() -> Self) -> MapResult {
        if self.entered_georeference().is_some() || self.surveyed_count() == 0 {
            return MapResult::default();
        }
        if let Some(known) = self.georeference_of_points() {
            let findings = self.points_of_both_frames().far_from_map().into_iter().collect();
            return MapResult { georeference: Some(known), findings };
        }
        let solved = solved();
        let (points, covariance) = solved.points_in_cameras();
        let fit =
            covariance.as_ref().and_then(|errors| GeoreferenceFit::with_world_errors(&points.pairs, errors));
        match fit {
            Some(fit) => MapResult {
                georeference: Some(GeoreferenceSolution::from_fit(&fit)),
                findings: points.far_from_map().into_iter().collect(),
            },
            None => {
                MapResult { georeference: None, findings: self.points_off_the_map().into_iter().collect() }
            }
        }
    }

    /// Reports the camera that is farthest from the point at which the floor touches the ellipsoid, if it is more
    /// than [`MAX_SITE_RADIUS`] away.
    ///
    /// A plane at the distance d is d^2 / 2R above the ground, with the radius R of the earth, and its vertical
    /// differs by d / R.
    pub(crate) fn far_from_origin(
        &self,
        solved: Option<&GeoreferenceSolution>,
        cameras: &[(usize, Result<Solution, FailureEntry>)],
    ) -> Option<Finding> {
        let georeference =
            solved.map(GeoreferenceSolution::as_entered).or_else(|| self.entered_georeference().cloned())?;
        let position = |(index, camera): &(usize, Result<Solution, FailureEntry>)| {
            Some((*index, camera.as_ref().ok()?.position_m?.on_floor()))
        };
        let distance = |at: FloorPoint| at.x.hypot(at.y);
        let placed = || cameras.iter().filter_map(position);
        let (camera, at) = placed().max_by(|a, b| distance(a.1).total_cmp(&distance(b.1)))?;
        let ground = georeference.tangent_plane().to_geographic(at.at_height(0.0));
        let drop = ground.height - georeference.alt_m.unwrap_or(0.0);
        let distance = distance(at);
        let is_compact = placed().all(|(_, other)| other.distance(at) <= MAX_SITE_RADIUS);
        (distance > MAX_SITE_RADIUS).then_some(Finding::LargeSite { camera, distance, drop, is_compact })
    }

    /// Reports the control points that have only map coordinates and are not used, because the site has no
    /// georeference.
    fn points_off_the_map(&self) -> Option<Finding> {
        let is_used = |point: &ControlPointEntry| {
            !point.off
                && point.site_coordinates(self).is_none()
                && SurveyedPosition::of_control_point(point).is_entered()
        };
        let of_camera = |(camera, entry): (usize, &SiteCamera)| {
            let points = entry.control_points.iter().enumerate();
            let subject = move |(point, _)| Subject::ControlPoint { camera, point };
            points.filter(|(_, point)| is_used(point)).map(subject).collect::<Vec<_>>()
        };
        let subjects: Vec<Subject> = self.cameras.iter().enumerate().flat_map(of_camera).collect();
        let reason = UnusedReason::NoGeoreference;
        (!subjects.is_empty()).then_some(Finding::Unused { subjects, reason })
    }

    /// Returns the control points in use that have both site coordinates and map coordinates.
    fn points_of_both_frames(&self) -> MappedPoints {
        let system = self.coordinate_system();
        let mut found = MappedPoints::default();
        for (camera, entry) in self.cameras.iter().enumerate() {
            for (point, control) in entry.control_points.iter().enumerate().filter(|(_, point)| !point.off) {
                let position = SurveyedPosition::of_control_point(control);
                let survey = position.geographic(system.as_ref()).zip(position.sigma_m);
                let (Some((geographic, sigma)), Some(world)) = (survey, control.site_coordinates(self))
                else {
                    continue;
                };
                found.indices.push([camera, point]);
                found.pairs.push(GeographicPair { world: world.on_floor(), geographic, sigma });
                found.sigmas.push(sigma);
            }
        }
        found
    }

    /// Returns the control points of a solved site with coordinates on the map, at the world coordinates that follow
    /// from their cameras. Also returns the joint covariance of these world coordinates. If the uncertainty of a
    /// camera is unknown, returns no points, and `None` as the covariance.
    ///
    /// The errors of the annotations and of the joint calibration are included. The error of a placement by hand
    /// is not: the georeference refers to the plan as drawn.
    fn points_in_cameras(&self) -> (MappedPoints, Option<DMatrix<f64>>) {
        let system = self.coordinate_system();
        let mut found = MappedPoints::default();
        let (mut entries, mut cameras): (Vec<&SiteCamera>, Vec<Camera>) = Default::default();
        let (mut points, mut surveyed, mut used) = (Vec::new(), Vec::new(), HashSet::new());
        let on_site = |(_, entry): &(usize, &SiteCamera)| self.frame(entry) == Frame::Site;
        for (index, entry) in self.cameras.iter().enumerate().filter(on_site) {
            let Ok(view) = self.view_of(entry) else { continue };
            for (number, point) in entry.control_points.iter().enumerate().filter(|(_, point)| !point.off) {
                let position = SurveyedPosition::of_control_point(point);
                let Some((at, sigma)) = position.geographic(system.as_ref()).zip(position.sigma_m) else {
                    continue;
                };
                // One survey of a point has one error, also if several cameras see the point.
                if point.id.as_ref().is_some_and(|id| !used.insert(id)) {
                    continue;
                }
                let entered = point.site_coordinates(self).map(|world| world.z);
                let height = entered.or(point.height_m).unwrap_or(0.0);
                if view.camera().pixel_to_floor(point.px, height).is_none() {
                    continue;
                }
                let sigma_px = point.sigma_px.or(entry.sigma_px).unwrap_or(1.0);
                points.push(RulerPoint { camera: entries.len(), pixel: point.px, height, sigma: sigma_px });
                surveyed.push((at, sigma));
                found.indices.push([index, number]);
            }
            entries.push(entry);
            cameras.push(*view.camera());
        }
        let between = |a: usize, b: usize| {
            let ids = [entries[a].id.as_str(), entries[b].id.as_str()];
            self.covariance_between(ids, [&cameras[a], &cameras[b]]).map(|covariance| *covariance)
        };
        let ruler = Ruler { cameras: &cameras, covariance_between: &between };
        let Some((world, covariance)) = ruler.positions(&points) else {
            return (MappedPoints::default(), None);
        };
        for (i, (world, (geographic, sigma))) in world.into_iter().zip(surveyed).enumerate() {
            let of_world = 0.5 * (covariance[(2 * i, 2 * i)] + covariance[(2 * i + 1, 2 * i + 1)]);
            found.pairs.push(GeographicPair { world, geographic, sigma });
            found.sigmas.push(sigma.hypot(of_world.max(0.0).sqrt()));
        }
        (found, Some(covariance))
    }
}
