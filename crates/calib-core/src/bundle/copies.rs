//! Landmarks and distances that are there more than once, and count once.
//!
//! A landmark is a copy of another where each of its observations is beside one of the other's in the same image,
//! and, of control points, where both have the same place: whoever shows the same thing again repeats what is wrong
//! with it. Of `n` copies each has `n` times the variance, in its observations and in its priors, so that together
//! they say what one of them says; distances between the same two things likewise. What they have more of residuals
//! than of unknowns is divided by `n`, too.

use std::collections::HashMap;

use crate::bundle::landmark::{DistanceMeasurement, Landmark, LandmarkModel, Observation};
use crate::camera::Pixel;
use crate::single::{BESIDE, lies_on};

/// How often landmarks and distances are there.
#[derive(Clone, Debug, Default)]
pub(crate) struct Copies {
    landmarks: Vec<f64>,
    distances: Vec<f64>,
}

impl Copies {
    pub(crate) fn of(landmarks: &[Landmark], distances: &[DistanceMeasurement]) -> Self {
        let sorts = Sorts::new(landmarks);
        let mut counts: HashMap<[usize; 2], f64> = HashMap::new();
        let ends = |distance: &DistanceMeasurement| {
            let [a, b] = distance.between.map(|landmark| sorts.of[landmark]);
            [a.min(b), a.max(b)]
        };
        distances.iter().for_each(|distance| *counts.entry(ends(distance)).or_default() += 1.0);
        let of_sort = sorts.times(landmarks);
        Self {
            landmarks: sorts.of.iter().map(|&sort| of_sort[sort]).collect(),
            distances: distances.iter().map(|distance| counts[&ends(distance)]).collect(),
        }
    }

    /// Widens what is there more than once.
    pub(crate) fn widen(&self, landmarks: &mut [Landmark], distances: &mut [DistanceMeasurement]) {
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

    /// What of residuals less unknowns is of copies alone, of the landmarks and distances that are on.
    pub(crate) fn repeated(&self, landmarks: &[Landmark], distances: &[DistanceMeasurement]) -> i64 {
        let again = |times: &f64| 1.0 - times.recip();
        let on = landmarks.iter().zip(&self.landmarks).filter(|(landmark, _)| !landmark.off);
        let of_landmarks: f64 = on.map(|(landmark, times)| landmark.redundancy() as f64 * again(times)).sum();
        let on = distances.iter().zip(&self.distances).filter(|(distance, _)| !distance.off);
        let of_distances: f64 = on.map(|(_, times)| again(times)).sum();
        (of_landmarks + of_distances - 1e-9).ceil() as i64
    }
}

/// Landmarks that are alike to the last bit, as one sort.
struct Sorts {
    /// Of every landmark.
    of: Vec<usize>,
    /// The first landmark of every sort, and how many there are.
    members: Vec<(usize, f64)>,
}

impl Sorts {
    fn new(landmarks: &[Landmark]) -> Self {
        let mut known: HashMap<Vec<u64>, usize> = HashMap::new();
        let mut members: Vec<(usize, f64)> = Vec::new();
        let sort = |(index, landmark): (usize, &Landmark)| {
            let sort = *known.entry(bits(landmark)).or_insert_with(|| {
                members.push((index, 0.0));
                members.len() - 1
            });
            members[sort].1 += 1.0;
            sort
        };
        let of = landmarks.iter().enumerate().map(sort).collect();
        Self { of, members }
    }

    /// How often each sort is there, with the others that it is a copy of.
    fn times(&self, landmarks: &[Landmark]) -> Vec<f64> {
        let mut by_cell: HashMap<Cell, Vec<usize>> = HashMap::new();
        for (sort, &(first, _)) in self.members.iter().enumerate() {
            let mut cells = cells(&landmarks[first]);
            cells.sort_unstable();
            cells.dedup();
            cells.into_iter().for_each(|cell| by_cell.entry(cell).or_default().push(sort));
        }
        let copied = |sort: usize| -> f64 {
            let own = &landmarks[self.members[sort].0];
            let mut near: Vec<usize> = cells_around(own)
                .into_iter()
                .filter_map(|cell| by_cell.get(&cell))
                .flatten()
                .copied()
                .collect();
            near.sort_unstable();
            near.dedup();
            let others = near.into_iter().filter(|&other| other != sort).map(|other| self.members[other]);
            others.filter(|&(first, _)| is_copy(own, &landmarks[first])).map(|(_, count)| count).sum()
        };
        (0..self.members.len()).map(|sort| self.members[sort].1 + copied(sort)).collect()
    }
}

/// A part of an image: view, point of the landmark, column and row.
type Cell = (usize, usize, [i64; 2]);

/// The side of a cell of points: what is beside each other is in cells that touch.
const OF_POINTS: f64 = BESIDE;
/// The side of a cell of lines, in pixels, and the distance of the places on a line whose cells it is in.
const OF_LINES: f64 = 64.0;

fn cell((view, point): (usize, usize), at: Pixel, side: f64) -> Cell {
    let index = |coordinate: f64| (coordinate / side).floor() as i64;
    (view, point, [index(at.u), index(at.v)])
}

/// The cells in which a landmark is found; a line all along, for its copies may be set to other points of it.
fn cells(landmark: &Landmark) -> Vec<Cell> {
    if !matches!(landmark.model, LandmarkModel::Line { .. }) {
        let of = |seen: &Observation| cell((seen.view, seen.point), seen.pixel, OF_POINTS);
        return landmark.observations.iter().map(of).collect();
    }
    let along = |view: usize| {
        let ends = segment(landmark, view);
        let steps = ends.map_or(0.0, |[a, b]| (b[0] - a[0]).hypot(b[1] - a[1]) / OF_LINES).ceil();
        let at = move |i: usize| Some(cell((view, 0), between(ends?, i as f64 / steps.max(1.0)), OF_LINES));
        (0..=steps as usize).filter_map(at)
    };
    landmark.views().into_iter().flat_map(along).collect()
}

/// The cells in one of which a landmark is that this one is a copy of: around its first point, or the middle of
/// its first segment.
fn cells_around(own: &Landmark) -> Vec<Cell> {
    let Some(seen) = own.observations.first() else { return Vec::new() };
    let middle = || Some(cell((seen.view, 0), between(segment(own, seen.view)?, 0.5), OF_LINES));
    let cell = match own.model {
        LandmarkModel::Line { .. } => middle(),
        _ => Some(cell((seen.view, seen.point), seen.pixel, OF_POINTS)),
    };
    let around = |(view, point, [u, v]): Cell| {
        (-1..=1).flat_map(move |i| (-1..=1).map(move |j| (view, point, [u + i, v + j])))
    };
    cell.into_iter().flat_map(around).collect()
}

fn between([a, b]: [[f64; 2]; 2], share: f64) -> Pixel {
    Pixel::new(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
}

/// All that tells two landmarks apart.
fn bits(landmark: &Landmark) -> Vec<u64> {
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
            [3].into_iter().chain(landmark.place.into_iter().map(f64::to_bits)).collect()
        }
        LandmarkModel::Line { .. } => vec![4],
    };
    [plane].into_iter().chain(model).chain(observations.flat_map(of)).collect()
}

/// Whether a landmark shows nothing but what another one shows, too.
fn is_copy(own: &Landmark, other: &Landmark) -> bool {
    std::mem::discriminant(&own.model) == std::mem::discriminant(&other.model)
        && own.plane == other.plane
        && is_one_place(own, other)
        && match own.model {
            LandmarkModel::Line { .. } => is_one_edge(own, other),
            _ => own
                .observations
                .iter()
                .all(|seen| other.observations.iter().any(|there| is_beside(seen, there))),
        }
}

fn is_beside(a: &Observation, b: &Observation) -> bool {
    (a.view, a.point) == (b.view, b.point) && a.pixel.distance(b.pixel) <= BESIDE
}

/// Whether measured points are at one place, as far as they were measured.
fn is_one_place(own: &Landmark, other: &Landmark) -> bool {
    /// In metres: what is nearer is measured twice, not two things.
    const SAME: f64 = 0.01;
    /// So many standard deviations apart two measurements may be.
    const SIGMAS: f64 = 3.0;
    let sigma = |landmark: &Landmark, k: usize| {
        landmark.priors.iter().find(|(index, _)| *index == k).map_or(0.0, |(_, prior)| prior.sigma)
    };
    let is_near = |k: usize| {
        let most = SAME.max(SIGMAS * sigma(own, k).hypot(sigma(other, k)));
        (own.place[k] - other.place[k]).abs() <= most
    };
    own.model != LandmarkModel::Measured || (0..own.place.len()).all(is_near)
}

/// Whether every view of a line shows a part of what another line shows there.
fn is_one_edge(own: &Landmark, other: &Landmark) -> bool {
    own.views().into_iter().all(|view| {
        let there = segment(other, view);
        segment(own, view).zip(there).is_some_and(|(here, there)| lies_on(&here, &there))
    })
}

/// From the first to the last point of a line in a view.
fn segment(line: &Landmark, view: usize) -> Option<[[f64; 2]; 2]> {
    let mut seen = line.observations.iter().filter(|seen| seen.view == view).map(|seen| seen.pixel);
    let first: Pixel = seen.next()?;
    Some([first.into(), seen.next_back()?.into()])
}
