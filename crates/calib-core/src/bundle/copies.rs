//! Landmarks and distances that were annotated more than once, and count once.
//!
//! A landmark is a copy of another if each of its observations is close to an observation of the other
//! landmark in the same image. Copies of a control point must also have the same measured position.
//! Annotating an object twice repeats its systematic error. Each of `n` copies therefore gets `n` times the
//! variance, in its observations and priors. Together the copies then have the weight of one landmark. The
//! same applies to distances between the same two landmarks. The redundancy of copies (residuals minus
//! unknowns) is divided by `n`, too.

use std::collections::HashMap;

use crate::bundle::landmark::{DistanceMeasurement, Landmark, LandmarkModel, Observation};
use crate::camera::Pixel;
use crate::single::{MAX_OVERLAP_DISTANCE_PX, is_repeat_of};

/// Number of times that every landmark and every distance is annotated; 1 without copies.
#[derive(Clone, Debug, Default)]
pub(crate) struct Copies {
    landmarks: Vec<f64>,
    distances: Vec<f64>,
}

impl Copies {
    pub(crate) fn new(landmarks: &[Landmark], distances: &[DistanceMeasurement]) -> Self {
        let groups = IdenticalGroups::new(landmarks);
        let mut counts: HashMap<[usize; 2], f64> = HashMap::new();
        let ends = |distance: &DistanceMeasurement| {
            let [a, b] = distance.between.map(|landmark| groups.group_of_landmark[landmark]);
            [a.min(b), a.max(b)]
        };
        distances.iter().for_each(|distance| *counts.entry(ends(distance)).or_default() += 1.0);
        let count_of_group = groups.copy_counts(landmarks);
        Self {
            landmarks: groups.group_of_landmark.iter().map(|&group| count_of_group[group]).collect(),
            distances: distances.iter().map(|distance| counts[&ends(distance)]).collect(),
        }
    }

    /// Multiplies the variances of copied landmarks and distances by the number of copies.
    pub(crate) fn inflate(&self, landmarks: &mut [Landmark], distances: &mut [DistanceMeasurement]) {
        for (landmark, times) in landmarks.iter_mut().zip(&self.landmarks).filter(|(_, times)| **times > 1.0)
        {
            landmark.observations.iter_mut().for_each(|seen| seen.sigma *= times.sqrt());
            landmark.priors.iter_mut().for_each(|(_, prior)| prior.sigma *= times.sqrt());
        }
        for (distance, times) in distances.iter_mut().zip(&self.distances).filter(|(_, times)| **times > 1.0)
        {
            distance.length.sigma *= times.sqrt();
        }
    }

    /// Returns the redundancy (residuals minus unknowns) that is due to copies, among active landmarks and
    /// distances.
    pub(crate) fn redundant_dof(&self, landmarks: &[Landmark], distances: &[DistanceMeasurement]) -> i64 {
        let again = |times: &f64| 1.0 - times.recip();
        let on = landmarks.iter().zip(&self.landmarks).filter(|(landmark, _)| !landmark.off);
        let of_landmarks: f64 = on.map(|(landmark, times)| landmark.redundancy() as f64 * again(times)).sum();
        let on = distances.iter().zip(&self.distances).filter(|(distance, _)| !distance.off);
        let of_distances: f64 = on.map(|(_, times)| again(times)).sum();
        (of_landmarks + of_distances - 1e-9).ceil() as i64
    }
}

/// Groups of bit-identical landmarks.
struct IdenticalGroups {
    /// Group of every landmark.
    group_of_landmark: Vec<usize>,
    /// First landmark of every group, and the size of the group.
    members: Vec<(usize, f64)>,
}

impl IdenticalGroups {
    fn new(landmarks: &[Landmark]) -> Self {
        let mut known: HashMap<Vec<u64>, usize> = HashMap::new();
        let mut members: Vec<(usize, f64)> = Vec::new();
        let group = |(index, landmark): (usize, &Landmark)| {
            let group = *known.entry(distinguishing_bits(landmark)).or_insert_with(|| {
                members.push((index, 0.0));
                members.len() - 1
            });
            members[group].1 += 1.0;
            group
        };
        let group_of_landmark = landmarks.iter().enumerate().map(group).collect();
        Self { group_of_landmark, members }
    }

    /// Returns for each group the number of copies of its landmarks: the members of the group, and similar
    /// landmarks of other groups.
    fn copy_counts(&self, landmarks: &[Landmark]) -> Vec<f64> {
        let mut by_cell: HashMap<Cell, Vec<usize>> = HashMap::new();
        for (group, &(first, _)) in self.members.iter().enumerate() {
            let mut cells = cells(&landmarks[first]);
            cells.sort_unstable();
            cells.dedup();
            cells.into_iter().for_each(|cell| by_cell.entry(cell).or_default().push(group));
        }
        let copied = |group: usize| -> f64 {
            let own = &landmarks[self.members[group].0];
            let mut near: Vec<usize> = cells_around(own)
                .into_iter()
                .filter_map(|cell| by_cell.get(&cell))
                .flatten()
                .copied()
                .collect();
            near.sort_unstable();
            near.dedup();
            let others = near.into_iter().filter(|&other| other != group).map(|other| self.members[other]);
            others.filter(|&(first, _)| is_copy(own, &landmarks[first])).map(|(_, count)| count).sum()
        };
        (0..self.members.len()).map(|group| self.members[group].1 + copied(group)).collect()
    }
}

/// Cell of an image: view, point of the landmark, column and row.
type Cell = (usize, usize, [i64; 2]);

/// Side of a cell of points, in pixels; observations closer than this are in the same cell or in adjacent cells.
const POINT_CELL_PX: f64 = MAX_OVERLAP_DISTANCE_PX;
/// Side of a cell of lines, and the sampling distance along a line, in pixels.
const LINE_CELL_PX: f64 = 64.0;

/// Returns the cell of side `side` (pixels) that contains a pixel.
fn cell((view, point): (usize, usize), at: Pixel, side: f64) -> Cell {
    let index = |coordinate: f64| (coordinate / side).floor() as i64;
    (view, point, [index(at.u), index(at.v)])
}

/// Returns the cells that contain a landmark. A line is sampled along its length, because a copy may consist
/// of other points of the same line.
fn cells(landmark: &Landmark) -> Vec<Cell> {
    if !matches!(landmark.model, LandmarkModel::Line { .. }) {
        let of = |seen: &Observation| cell((seen.view, seen.point), seen.pixel, POINT_CELL_PX);
        return landmark.observations.iter().map(of).collect();
    }
    let along = |view: usize| {
        let ends = segment(landmark, view);
        let steps = ends.map_or(0.0, |[a, b]| (b[0] - a[0]).hypot(b[1] - a[1]) / LINE_CELL_PX).ceil();
        let at = move |i: usize| {
            Some(cell((view, 0), interpolate(ends?, i as f64 / steps.max(1.0)), LINE_CELL_PX))
        };
        (0..=steps as usize).filter_map(at)
    };
    landmark.views().into_iter().flat_map(along).collect()
}

/// Returns the cells to search for landmarks that this landmark repeats: the cells around its first point, or around
/// the middle of the first segment of a line.
fn cells_around(own: &Landmark) -> Vec<Cell> {
    let Some(seen) = own.observations.first() else { return Vec::new() };
    let middle = || Some(cell((seen.view, 0), interpolate(segment(own, seen.view)?, 0.5), LINE_CELL_PX));
    let cell = match own.model {
        LandmarkModel::Line { .. } => middle(),
        _ => Some(cell((seen.view, seen.point), seen.pixel, POINT_CELL_PX)),
    };
    let around = |(view, point, [u, v]): Cell| {
        (-1..=1).flat_map(move |i| (-1..=1).map(move |j| (view, point, [u + i, v + j])))
    };
    cell.into_iter().flat_map(around).collect()
}

/// Returns the pixel at the fraction `share` of the way from `a` to `b`.
fn interpolate([a, b]: [[f64; 2]; 2], share: f64) -> Pixel {
    Pixel::new(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
}

/// Returns the bits of all values that distinguish landmarks; identical landmarks have equal results.
fn distinguishing_bits(landmark: &Landmark) -> Vec<u64> {
    let observations = landmark.observations.iter();
    let of = |seen: &Observation| {
        [seen.view as u64, seen.point as u64, seen.pixel.u.to_bits(), seen.pixel.v.to_bits()]
    };
    let plane = landmark.plane.map_or(u64::MAX, |plane| plane as u64);
    let model = match &landmark.model {
        LandmarkModel::Point { height } => vec![0, height.to_bits()],
        LandmarkModel::Post => vec![1],
        LandmarkModel::Mark { z, points } => {
            let numbers = [*z].into_iter().chain(points.iter().flatten().copied());
            [2].into_iter().chain(numbers.map(f64::to_bits)).collect()
        }
        LandmarkModel::Measured => {
            [3].into_iter().chain(landmark.params.into_iter().map(f64::to_bits)).collect()
        }
        LandmarkModel::Line { .. } => vec![4],
    };
    [plane].into_iter().chain(model).chain(observations.flat_map(of)).collect()
}

/// Whether every observation of a landmark repeats an observation of another one.
fn is_copy(own: &Landmark, other: &Landmark) -> bool {
    std::mem::discriminant(&own.model) == std::mem::discriminant(&other.model)
        && own.plane == other.plane
        && has_same_position(own, other)
        && match own.model {
            LandmarkModel::Line { .. } => is_on_same_edge(own, other),
            _ => own
                .observations
                .iter()
                .all(|seen| other.observations.iter().any(|there| is_same_point(seen, there))),
        }
}

/// Whether two observations are of the same point of a landmark in the same view, at nearly the same pixel.
fn is_same_point(a: &Observation, b: &Observation) -> bool {
    (a.view, a.point) == (b.view, b.point) && a.pixel.distance(b.pixel) <= MAX_OVERLAP_DISTANCE_PX
}

/// Whether two measured points are at the same position, within 1 cm or within their uncertainty. Always true for
/// other landmarks.
fn has_same_position(own: &Landmark, other: &Landmark) -> bool {
    /// Distance below which two measured points count as the same point, in metres.
    const MAX_SAME_POINT_DISTANCE_M: f64 = 0.01;
    /// Largest difference of two measurements of the same point, in standard deviations.
    const MAX_SAME_POINT_SIGMAS: f64 = 3.0;
    let sigma = |landmark: &Landmark, k: usize| {
        landmark.priors.iter().find(|(index, _)| *index == k).map_or(0.0, |(_, prior)| prior.sigma)
    };
    let is_near = |k: usize| {
        let most =
            MAX_SAME_POINT_DISTANCE_M.max(MAX_SAME_POINT_SIGMAS * sigma(own, k).hypot(sigma(other, k)));
        (own.params[k] - other.params[k]).abs() <= most
    };
    own.model != LandmarkModel::Measured || (0..own.params.len()).all(is_near)
}

/// Whether in every view of a line its segment is part of the other line's segment.
fn is_on_same_edge(own: &Landmark, other: &Landmark) -> bool {
    own.views().into_iter().all(|view| {
        let there = segment(other, view);
        segment(own, view).zip(there).is_some_and(|(here, there)| is_repeat_of(&here, &there))
    })
}

/// Returns the first and last observed point of a line in a view.
fn segment(line: &Landmark, view: usize) -> Option<[[f64; 2]; 2]> {
    let mut seen = line.observations.iter().filter(|seen| seen.view == view).map(|seen| seen.pixel);
    let first: Pixel = seen.next()?;
    Some([first.into(), seen.next_back()?.into()])
}
