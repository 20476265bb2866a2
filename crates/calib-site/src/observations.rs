//! Landmarks of the bundle adjustment from the shared observations of a site: control points, links, marks,
//! and the distances between them.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::document::{ControlPointEntry, Link, LinkKind, Mark, Site, SiteCamera};
use crate::geographic::SurveyedPosition;
use crate::single_step::SingleFit;
use calib_core::bundle::{DistanceMeasurement, Landmark, LandmarkModel, Observation};
use calib_core::camera::{Pixel, Plane, WorldPoint};
use calib_core::outcome::Failure;
use calib_core::single::{Known, PlanePrior, Prior};

/// Source of a landmark in the site file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LandmarkSource {
    /// Control point of a camera.
    ControlPoint {
        /// Index of the camera.
        camera: usize,
        /// Index of the control point in its camera.
        point: usize,
    },
    /// Link, by its index.
    Link(usize),
    /// Mark, by its index.
    Mark(usize),
}

/// Landmarks and distances of a site for the bundle adjustment.
#[derive(Clone, Debug, Default)]
pub(crate) struct SiteObservations {
    pub(crate) landmarks: Vec<(LandmarkSource, Landmark)>,
    /// Distances, each with its index in the site.
    pub(crate) measurements: Vec<(usize, DistanceMeasurement)>,
    pub(crate) unused: UnusedEvidence,
}

/// Landmarks and distances without information.
#[derive(Clone, Debug, Default)]
pub(crate) struct UnusedEvidence {
    /// Indices of landmarks that at most one camera observes, without known position, size or distance.
    pub(crate) landmarks: Vec<usize>,
    /// Distances, by their index in the site, with an end that is not a landmark, or without a known length.
    pub(crate) distances: Vec<usize>,
}

/// Standard deviation of a fixed length, in metres: the accuracy of a steel tape.
const EXACT_LENGTH_SIGMA_M: f64 = 1e-4;

/// Converts a known length to a prior; `None` if it is not fixed and has no standard deviation.
fn prior(known: Known) -> Option<Prior> {
    let sigma = if known.fixed { Some(EXACT_LENGTH_SIGMA_M) } else { known.sigma };
    sigma.map(|sigma| Prior { value: known.value, sigma: sigma.max(EXACT_LENGTH_SIGMA_M) })
}

impl Site {
    /// Collects the landmarks and distances of the site, including the items that are switched off. `is_there`
    /// selects the cameras whose observations are included.
    pub(crate) fn site_observations(
        &self,
        single_fits: &[Result<SingleFit, Failure>],
        planes: &[PlanePrior],
        is_there: &dyn Fn(usize) -> bool,
    ) -> SiteObservations {
        let mut index: HashMap<&str, usize> = HashMap::new();
        for (i, camera) in self.cameras.iter().enumerate() {
            index.entry(&camera.id).or_insert(i);
        }
        let camera = |id: &str| index.get(id).copied().filter(|&camera| is_there(camera));
        let noise: Vec<f64> = self
            .cameras
            .iter()
            .zip(single_fits)
            .map(|(entry, single)| annotation_sigma(entry, single))
            .collect();
        let mut landmarks = Vec::new();
        for (i, entry) in self.cameras.iter().enumerate().filter(|(i, _)| is_there(*i)) {
            for (k, point) in entry.control_points.iter().enumerate() {
                let of = LandmarkSource::ControlPoint { camera: i, point: k };
                let is_suspect =
                    single_fits[i].as_ref().is_ok_and(|single| single.suspect_points.contains(&k));
                let landmark = self.control_point_landmark(point, i, noise[i]);
                landmarks.extend(landmark.map(|landmark| (of, Landmark { is_suspect, ..landmark })));
            }
        }
        self.drop_single_points(&mut landmarks);
        self.merge_surveyed_points(&mut landmarks);
        let links = self.links.iter().enumerate();
        landmarks.extend(
            links.map(|(i, link)| {
                (LandmarkSource::Link(i), self.link_landmark(link, planes, &camera, &noise))
            }),
        );
        let marks = self.marks.iter().enumerate().filter(|(_, mark)| !mark.seen.is_empty());
        landmarks.extend(
            marks.map(|(i, mark)| (LandmarkSource::Mark(i), self.mark_landmark(mark, &camera, &noise))),
        );
        let measurements = self.distances_between(&landmarks);
        let is_used = |index: &usize| measurements.iter().any(|(measurement, _)| measurement == index);
        let distances =
            (0..self.distances.len()).filter(|i| !self.distances[*i].off && !is_used(i)).collect();
        let unused = UnusedEvidence { landmarks: Vec::new(), distances };
        let mut shared = SiteObservations { landmarks, measurements, unused };
        shared.switch_off_uninformative();
        shared
    }

    /// Returns the landmark of a control point; `None` if its position is unknown. `noise` is the standard deviation
    /// of its pixel coordinates if none is entered for the point, in pixels.
    pub(crate) fn control_point_landmark(
        &self,
        point: &ControlPointEntry,
        camera: usize,
        noise: f64,
    ) -> Option<Landmark> {
        let at = point.control_point(self)?.world;
        let sigma = Some(point.position_sigma()).filter(|sigma| *sigma > 0.0);
        let pixel_sigma = point.sigma_px.unwrap_or(noise);
        let seen = Observation { sigma: pixel_sigma, ..Observation::new(camera, point.px) };
        let measured = Landmark::measured(at, sigma, vec![seen]);
        let is_level = point.world_m.is_none() && point.alt_m.is_none();
        let landmark = if is_level { with_exact_height(measured) } else { measured };
        Some(Landmark { keep: point.keep, off: point.off, ..landmark })
    }

    /// Returns the landmark of a link. A link with geographic coordinates becomes a measured point. Its height is
    /// exact if no altitude is entered.
    fn link_landmark(
        &self,
        link: &Link,
        planes: &[PlanePrior],
        camera: &dyn Fn(&str) -> Option<usize>,
        noise: &[f64],
    ) -> Landmark {
        let landmark = link_landmark(link, planes, camera, noise);
        let at = self.world_of_survey(&SurveyedPosition::of_link(link));
        let Some((at, sigma)) = at.zip(link.sigma_m) else { return landmark };
        let measured = Landmark::measured(at, Some(sigma), landmark.observations);
        let measured = if link.alt_m.is_none() { with_exact_height(measured) } else { measured };
        Landmark { keep: link.keep, off: link.off, ..measured }
    }

    /// Returns the landmark of a mark. The geographic coordinates of a mark are measurements of its position.
    fn mark_landmark(&self, mark: &Mark, camera: &dyn Fn(&str) -> Option<usize>, noise: &[f64]) -> Landmark {
        let landmark = mark_landmark(mark, camera, noise);
        let at = self.world_of_survey(&SurveyedPosition::of_mark(mark));
        let Some((WorldPoint { x, y, .. }, sigma)) = at.zip(mark.sigma_m) else { return landmark };
        let [_, _, turn] = landmark.params;
        let priors = [x, y].map(|value| Prior { value, sigma }).into_iter().enumerate();
        let is_free = landmark.free[0];
        Landmark {
            params: [x, y, turn],
            priors: if is_free { priors.collect() } else { Vec::new() },
            ..landmark
        }
    }

    /// Removes the control point of every camera that has only one, because one point does not determine the yaw. The
    /// point is kept if the camera has a placement, a link or a mark.
    fn drop_single_points(&self, landmarks: &mut Vec<(LandmarkSource, Landmark)>) {
        let linked: HashSet<&str> = self
            .links
            .iter()
            .filter(|link| !link.off)
            .flat_map(|link| link.seen.iter().map(|seen| seen.camera.as_str()))
            .chain(
                self.marks
                    .iter()
                    .filter(|m| !m.off)
                    .flat_map(|m| m.seen.iter().map(|seen| seen.camera.as_str())),
            )
            .collect();
        let mut points: HashMap<usize, usize> = HashMap::new();
        for (of, landmark) in landmarks.iter().filter(|(_, landmark)| !landmark.off) {
            if let LandmarkSource::ControlPoint { camera, .. } = of {
                *points.entry(*camera).or_default() += landmark.observations.len();
            }
        }
        landmarks.retain(|(of, landmark)| {
            let LandmarkSource::ControlPoint { camera, .. } = of else { return true };
            let entry = &self.cameras[*camera];
            landmark.off
                || points[camera] > 1
                || entry.placement.is_some()
                || linked.contains(entry.id.as_str())
        });
    }

    /// Merges the clicks of several cameras on one surveyed point into one landmark. The error of the survey is
    /// common to all of these clicks.
    fn merge_surveyed_points(&self, landmarks: &mut Vec<(LandmarkSource, Landmark)>) {
        type Survey = (String, [Option<u64>; 2], Option<[u64; 2]>);
        let mut known: HashMap<Survey, usize> = HashMap::new();
        let mut merged: Vec<(LandmarkSource, Landmark)> = Vec::new();
        for (of, landmark) in landmarks.drain(..) {
            let survey = match of {
                LandmarkSource::ControlPoint { camera, point } if !landmark.off => {
                    let entry = &self.cameras[camera].control_points[point];
                    let position = SurveyedPosition::of_control_point(entry);
                    let is_surveyed = position.is_entered() && entry.site_coordinates(self).is_none();
                    let degrees = [position.lat_deg, position.lon_deg].map(|value| value.map(f64::to_bits));
                    let grid = position.crs_m.map(|grid| grid.map(f64::to_bits));
                    entry.id.clone().filter(|_| is_surveyed).map(|id| (id, degrees, grid))
                }
                _ => None,
            };
            let first = survey.as_ref().and_then(|survey| known.get(survey)).copied();
            match first {
                Some(first) => {
                    let together = &mut merged[first].1;
                    together.observations.extend(landmark.observations);
                    together.keep |= landmark.keep;
                    together.is_suspect |= landmark.is_suspect;
                }
                None => {
                    survey.and_then(|survey| known.insert(survey, merged.len()));
                    merged.push((of, landmark));
                }
            }
        }
        *landmarks = merged;
    }

    fn distances_between(
        &self,
        landmarks: &[(LandmarkSource, Landmark)],
    ) -> Vec<(usize, DistanceMeasurement)> {
        let mut by_id: BTreeMap<&str, usize> = BTreeMap::new();
        for (index, (of, landmark)) in landmarks.iter().enumerate() {
            let id = match of {
                LandmarkSource::Link(link) => self.links[*link].id.as_deref(),
                LandmarkSource::Mark(mark) => self.marks[*mark].id.as_deref(),
                LandmarkSource::ControlPoint { .. } => None,
            };
            if let Some(id) = id.filter(|_| !matches!(landmark.model, LandmarkModel::Line { .. })) {
                by_id.insert(id, index);
            }
        }
        let measurement = |(index, entry): (usize, &crate::document::Distance)| {
            let [a, b] = [&entry.between[0], &entry.between[1]].map(|id| by_id.get(id.as_str()).copied());
            let measurement = DistanceMeasurement {
                between: [a?, b?],
                length: prior(entry.length_m)?,
                keep: entry.keep,
                off: entry.off,
            };
            Some((index, measurement))
        };
        self.distances.iter().enumerate().filter_map(measurement).collect()
    }
}

impl SiteObservations {
    /// Switches off landmarks without information: only one camera observes them, and no position, size or
    /// distance is known.
    fn switch_off_uninformative(&mut self) {
        let measured: HashSet<usize> = self
            .measurements
            .iter()
            .filter(|(_, measurement)| !measurement.off)
            .flat_map(|(_, measurement)| measurement.between)
            .collect();
        for (index, (_, landmark)) in self.landmarks.iter_mut().enumerate() {
            let is_informative = match landmark.model {
                LandmarkModel::Measured => true,
                LandmarkModel::Mark { .. } => landmark.redundancy() > 0,
                LandmarkModel::Post => landmark.views().len() > 1 || landmark.redundancy() > 0,
                LandmarkModel::Point { .. } | LandmarkModel::Line { .. } => landmark.views().len() > 1,
            };
            let is_useless =
                landmark.observations.is_empty() || !(is_informative || measured.contains(&index));
            if is_useless && !landmark.off {
                landmark.off = true;
                self.unused.landmarks.push(index);
            }
        }
    }
}

/// Returns a measured point whose height above the floor is exact: on a map or plan, only the horizontal position
/// has the error of the survey.
fn with_exact_height(mut measured: Landmark) -> Landmark {
    measured.free[2] = false;
    measured.priors.retain(|(k, _)| *k < 2);
    measured
}

/// Returns the standard deviation of the annotations of a camera, in pixels.
fn annotation_sigma(entry: &SiteCamera, single: &Result<SingleFit, Failure>) -> f64 {
    let fit = single.as_ref().ok().and_then(|single| single.fit.as_ref());
    fit.map_or_else(|| entry.sigma_px.unwrap_or(1.0), |fit| fit.sigma)
}

fn link_landmark(
    link: &Link,
    planes: &[PlanePrior],
    camera: &dyn Fn(&str) -> Option<usize>,
    noise: &[f64],
) -> Landmark {
    let mut observations = Vec::new();
    for seen in &link.seen {
        let Some(view) = camera(&seen.camera) else { continue };
        let sigma = seen.sigma_px.unwrap_or(noise[view]);
        let mut add = |point: usize, pixel: Option<Pixel>| {
            observations.extend(pixel.map(|pixel| Observation { view, point, pixel, sigma }));
        };
        match link.kind {
            LinkKind::Point => add(0, seen.px),
            LinkKind::Post => {
                add(0, seen.foot);
                add(1, seen.head);
            }
            LinkKind::Line => {
                seen.segment.iter().flatten().enumerate().for_each(|(point, &pixel)| add(point, Some(pixel)));
            }
        }
    }
    let length = link.length_m.and_then(|known| Some((known, prior(known)?)));
    let model = match link.kind {
        LinkKind::Point => LandmarkModel::Point { height: link.height_m.unwrap_or(0.0) },
        LinkKind::Post => LandmarkModel::Post,
        LinkKind::Line => LandmarkModel::Line { origin: [0.0; 2] },
    };
    let named = |id: &String| planes.iter().position(|plane| plane.id == *id);
    let plane = link.plane.as_ref().and_then(named);
    let is_fixed = link.length_m.is_some_and(|known| known.fixed);
    Landmark {
        model,
        plane,
        ground: plane.map_or(Plane::FLOOR, |plane| planes[plane].plane),
        params: [0.0, 0.0, length.map_or(0.0, |(known, _)| known.value)],
        free: [true, true, link.kind == LinkKind::Post && !is_fixed],
        priors: length.filter(|_| !is_fixed).map(|(_, prior)| (2, prior)).into_iter().collect(),
        observations,
        keep: link.keep,
        off: link.off,
        is_suspect: false,
    }
}

fn mark_landmark(mark: &Mark, camera: &dyn Fn(&str) -> Option<usize>, noise: &[f64]) -> Landmark {
    let unrotated = mark.shape_at(WorldPoint::default(), 0.0);
    let mut names: Vec<&str> = Vec::new();
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut observations = Vec::new();
    for seen in &mark.seen {
        let (Some(view), Some(point)) = (camera(&seen.camera), unrotated.point(&seen.point)) else {
            continue;
        };
        let index = names.iter().position(|name| *name == seen.point).unwrap_or_else(|| {
            names.push(&seen.point);
            points.push(point.into());
            names.len() - 1
        });
        observations.push(Observation { view, point: index, pixel: seen.px, sigma: noise[view] });
    }
    // Points on the axis of a mark do not determine its rotation.
    let has_turn = points.iter().any(|[x, y, _]| x.hypot(*y) > 1e-9);
    let WorldPoint { x, y, z } = mark.at_m;
    Landmark {
        model: LandmarkModel::Mark { z, points },
        plane: None,
        ground: Plane::FLOOR,
        params: [x, y, mark.turn_deg.to_radians()],
        free: [!mark.fixed, !mark.fixed, !mark.fixed && has_turn],
        priors: Vec::new(),
        observations,
        keep: mark.keep,
        off: mark.off,
        is_suspect: false,
    }
}
