//! Which edges an operator is shown: the few that tell most.
//!
//! An edge adds `J' J` to the information about roll, pitch, focal and the azimuths of the floor directions, times the
//! probability that it belongs. One after the other the edge is taken that raises the log determinant most
//! (D-optimal, greedily): long edges, far from each other, of every direction that matters.
//!
//! Edges as annotations, as an operator would draw them, and what the solve makes of them.

use calib_core::{Annotation, Kind, Lens, Pixel, UndistortedPixel};
use calib_site::{DistortionEntry, LensEntry, Options, Site, SiteCamera, Solution};
use nalgebra::DMatrix;

use super::join::Line;
use super::lies::Lies;
use super::mixture::Mixture;

/// Edges that belong less surely are not shown.
const LEAST: f64 = 0.7;

/// Strokes of every direction at least, where there are.
const LEAST_EACH: usize = 2;

/// An edge that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    /// Index of the line.
    pub(super) line: usize,
    /// 0 for the verticals, then the floor directions.
    pub(super) direction: usize,
    /// That it belongs.
    pub(super) probability: f64,
}

/// At most so many edges.
pub(super) fn strokes(mixture: &Mixture, lines: &[Line], most: usize) -> Vec<Stroke> {
    let mut left = candidates(mixture, lines);
    let unknowns = 3 + mixture.azimuths.len();
    // What is believed of cameras, so that there is a determinant from the first edge on.
    let mut information = DMatrix::identity(unknowns, unknowns) * 100.0;
    let mut chosen = Vec::new();
    while chosen.len() < most && !left.is_empty() {
        let Some(inverse) = information.clone().cholesky().map(|c| c.inverse()) else { break };
        let gain = |(_, row): &(Stroke, Vec<f64>)| {
            (0..unknowns)
                .map(|i| (0..unknowns).map(|j| row[i] * inverse[(i, j)] * row[j]).sum::<f64>())
                .sum::<f64>()
        };
        let first = wanting(&chosen, &left);
        let may = |i: &usize| first.is_none_or(|direction| left[*i].0.direction == direction);
        let best = (0..left.len()).filter(may).max_by(|&a, &b| gain(&left[a]).total_cmp(&gain(&left[b])));
        let Some(best) = best else { break };
        let (stroke, row) = left.swap_remove(best);
        for i in 0..unknowns {
            for j in 0..unknowns {
                information[(i, j)] += row[i] * row[j];
            }
        }
        chosen.push(stroke);
    }
    chosen
}

/// A direction that has not yet as many strokes as it takes to see that they belong together.
fn wanting(chosen: &[Stroke], left: &[(Stroke, Vec<f64>)]) -> Option<usize> {
    let drawn = |direction: usize| chosen.iter().filter(|stroke| stroke.direction == direction).count();
    let most = left.iter().map(|(stroke, _)| stroke.direction).max()?;
    (0..=most).find(|&k| drawn(k) < LEAST_EACH && left.iter().any(|(stroke, _)| stroke.direction == k))
}

/// The edges that belong somewhere, with the derivatives of their residuals.
fn candidates(mixture: &Mixture, lines: &[Line]) -> Vec<(Stroke, Vec<f64>)> {
    let (points, derivatives) = (mixture.points(), mixture.point_derivatives());
    let memberships = mixture.memberships(lines);
    let of = |(index, (line, membership)): (usize, (&Line, &Vec<f64>))| {
        let (direction, &probability) =
            membership.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).filter(|(_, p)| **p > LEAST)?;
        let evidence = line.evidence(points[direction])?;
        let mut row = vec![0.0; 3 + mixture.azimuths.len()];
        for (j, by) in &derivatives[direction] {
            row[*j] = probability.sqrt() * (0..3).map(|c| evidence.by_point[c] * by[c]).sum::<f64>();
        }
        Some((Stroke { line: index, direction, probability }, row))
    };
    lines.iter().zip(&memberships).enumerate().filter_map(of).collect()
}

/// Edges of one direction.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Group {
    /// As they would be drawn.
    pub annotation: Annotation,
    /// That a segment belongs, in the order of the segments.
    pub probabilities: Vec<f64>,
    /// Where they lie, in the order of the segments.
    pub lies: Vec<Lies>,
}

impl Group {
    /// That all of it belongs: the mean over its segments.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probabilities.iter().sum::<f64>() / self.probabilities.len().max(1) as f64
    }
}

/// The strokes as annotations: verticals, then every floor direction that two of them have.
pub(super) fn groups(
    mixture: &Mixture,
    strokes: &[Stroke],
    draw: &dyn Fn(usize) -> Vec<Pixel>,
    lies: &[Lies],
) -> Vec<Group> {
    let name = |direction: usize| format!("floor {direction}");
    let of = |direction: usize| strokes.iter().filter(move |stroke| stroke.direction == direction);
    let is_drawn = |direction: usize| of(direction).count() > usize::from(direction > 0);
    let group = |direction: usize| {
        let segments = of(direction).map(|stroke| draw(stroke.line)).collect();
        let kind = if direction == 0 { Kind::Vertical } else { Kind::Parallel };
        let mut annotation = Annotation::of_segments(kind, segments);
        if direction > 0 {
            annotation.id = Some(name(direction));
            let tie = mixture.tied.iter().find(|[_, b]| b + 1 == direction).map(|[a, _]| a + 1);
            annotation.at_right_angles_to = tie.filter(|&other| is_drawn(other)).map(name);
        }
        Group {
            annotation,
            probabilities: of(direction).map(|stroke| stroke.probability).collect(),
            lies: of(direction).map(|stroke| lies[stroke.line]).collect(),
        }
    };
    (0..=mixture.azimuths.len()).filter(|&direction| is_drawn(direction)).map(group).collect()
}

/// The ends of a line as the lens shows them.
pub(super) fn stroke(line: &Line, lens: &Lens) -> Vec<Pixel> {
    let Pixel { u, v } = lens.principal_point;
    line.ends.iter().filter_map(|p| lens.distort(UndistortedPixel { u: p[0] + u, v: p[1] + v })).collect()
}

/// The camera with this lens and these annotations.
pub(super) fn entry(size: [u32; 2], lens: &Lens, groups: &[Group]) -> SiteCamera {
    let centre = Pixel::new(0.5 * f64::from(size[0]), 0.5 * f64::from(size[1]));
    let principal_point_px = Some(lens.principal_point).filter(|point| *point != centre);
    let distortion = DistortionEntry::of(lens, lens.focal);
    let distortion = distortion.map(|entry| DistortionEntry { focal_px: Some(lens.focal), ..entry });
    let lens = LensEntry { principal_point_px, distortion, ..LensEntry::default() };
    SiteCamera {
        lens: (lens != LensEntry::default()).then_some(lens),
        annotations: groups.iter().map(|group| group.annotation.clone()).collect(),
        ..SiteCamera::new("still", size)
    }
}

/// What the whole solve makes of a camera; none where it fails.
pub(super) fn solved(entry: &SiteCamera) -> Option<Solution> {
    let site = Site { cameras: vec![entry.clone()], ..Site::new() };
    let mut report = site.calibrate(&Options::default());
    report.cameras.pop()?.1.ok()
}
