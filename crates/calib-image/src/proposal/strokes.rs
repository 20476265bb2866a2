//! Selection of the few most informative edges, and their conversion to annotations.
//!
//! An edge with the Jacobian row `J` adds `J' J` to the information about roll, pitch, log focal length and
//! the azimuths of the floor directions. This information is multiplied by the probability that the edge
//! belongs to its direction. Edges are selected one after the other, each time the edge that raises the log
//! determinant of the information the most (greedy D-optimal design). The result is long edges, far from each
//! other, of every relevant direction.
//!
//! The selected edges are called strokes. They become annotations, and are solved like annotations of an
//! operator.

use calib_core::{Annotation, Kind, Lens, Pixel, UndistortedPixel};
use calib_site::{DistortionEntry, LensEntry, Options, Site, SiteCamera, Solution};
use nalgebra::DMatrix;

use super::edge_class::EdgeClass;
use super::join::Line;
use super::mixture::Mixture;

/// Smallest probability that a selected edge belongs to its direction.
const MIN_PROBABILITY: f64 = 0.7;

/// Smallest number of selected edges in every direction, if available.
const MIN_STROKES_PER_DIRECTION: usize = 2;

/// Selected edge, assigned to a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    /// Index of the edge in the list of lines.
    pub(super) line: usize,
    /// Direction: 0 for the vertical, then the floor directions.
    pub(super) direction: usize,
    /// Probability that the edge belongs to this direction.
    pub(super) probability: f64,
}

/// Selects the most informative edges, at most `most`.
pub(super) fn select_strokes(mixture: &Mixture, lines: &[Line], most: usize) -> Vec<Stroke> {
    let mut left = candidates(mixture, lines);
    let unknowns = 3 + mixture.azimuths.len();
    // Prior information of the camera, so that the determinant is positive before the first edge.
    let mut information = DMatrix::identity(unknowns, unknowns) * 100.0;
    let mut chosen = Vec::new();
    while chosen.len() < most && !left.is_empty() {
        let Some(inverse) = information.clone().cholesky().map(|c| c.inverse()) else { break };
        let gain = |(_, row): &(Stroke, Vec<f64>)| {
            (0..unknowns)
                .map(|i| (0..unknowns).map(|j| row[i] * inverse[(i, j)] * row[j]).sum::<f64>())
                .sum::<f64>()
        };
        let first = underrepresented_direction(&chosen, &left);
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

/// Returns a direction with too few strokes to check their consistency, and with edges left to select.
fn underrepresented_direction(chosen: &[Stroke], left: &[(Stroke, Vec<f64>)]) -> Option<usize> {
    let drawn = |direction: usize| chosen.iter().filter(|stroke| stroke.direction == direction).count();
    let most = left.iter().map(|(stroke, _)| stroke.direction).max()?;
    (0..=most).find(|&k| {
        drawn(k) < MIN_STROKES_PER_DIRECTION && left.iter().any(|(stroke, _)| stroke.direction == k)
    })
}

/// Returns the edges assigned to a direction, with the derivatives of their residuals.
fn candidates(mixture: &Mixture, lines: &[Line]) -> Vec<(Stroke, Vec<f64>)> {
    let (points, derivatives) = (mixture.points(), mixture.point_derivatives());
    let memberships = mixture.memberships(lines);
    let of = |(index, (line, membership)): (usize, (&Line, &Vec<f64>))| {
        let (direction, &probability) = membership
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .filter(|(_, p)| **p > MIN_PROBABILITY)?;
        let evidence = line.evidence(points[direction])?;
        let mut row = vec![0.0; 3 + mixture.azimuths.len()];
        for (j, by) in &derivatives[direction] {
            row[*j] = probability.sqrt() * (0..3).map(|c| evidence.by_point[c] * by[c]).sum::<f64>();
        }
        Some((Stroke { line: index, direction, probability }, row))
    };
    lines.iter().zip(&memberships).enumerate().filter_map(of).collect()
}

/// Suggested annotation of the edges in one direction.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Group {
    /// Annotation, with the edges as segments.
    pub annotation: Annotation,
    /// Probability that each segment belongs to the direction, in the order of the segments.
    pub probabilities: Vec<f64>,
    /// Location class of each segment, in the order of the segments.
    pub classes: Vec<EdgeClass>,
}

impl Group {
    /// Returns the mean probability that a segment belongs to the direction.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probabilities.iter().sum::<f64>() / self.probabilities.len().max(1) as f64
    }
}

/// Converts the strokes to annotations: the vertical, then every floor direction with at least two strokes.
/// `draw` returns the raw pixels of a line, and `classes` contains the class of every line.
pub(super) fn groups(
    mixture: &Mixture,
    strokes: &[Stroke],
    draw: &dyn Fn(usize) -> Vec<Pixel>,
    classes: &[EdgeClass],
) -> Vec<Group> {
    let name = |direction: usize| format!("floor {direction}");
    let of = |direction: usize| strokes.iter().filter(move |stroke| stroke.direction == direction);
    let is_drawn = |direction: usize| of(direction).count() > usize::from(direction > 0);
    let group = |direction: usize| {
        let segments = of(direction).map(|stroke| draw(stroke.line)).collect();
        let kind = if direction == 0 { Kind::Vertical } else { Kind::Parallel };
        let mut annotation = Annotation::from_segments(kind, segments);
        if direction > 0 {
            annotation.id = Some(name(direction));
            let tie = mixture.right_angles.iter().find(|[_, b]| b + 1 == direction).map(|[a, _]| a + 1);
            annotation.at_right_angles_to = tie.filter(|&other| is_drawn(other)).map(name);
        }
        Group {
            annotation,
            probabilities: of(direction).map(|stroke| stroke.probability).collect(),
            classes: of(direction).map(|stroke| classes[stroke.line]).collect(),
        }
    };
    (0..=mixture.azimuths.len()).filter(|&direction| is_drawn(direction)).map(group).collect()
}

/// Returns the ends of a line in raw pixels, distorted by the lens.
pub(super) fn stroke(line: &Line, lens: &Lens) -> Vec<Pixel> {
    let Pixel { u, v } = lens.principal_point;
    line.ends.iter().filter_map(|p| lens.distort(UndistortedPixel { u: p[0] + u, v: p[1] + v })).collect()
}

/// Creates the camera entry of a site file from an image size, in pixels, the known values of the lens, an estimated
/// lens and annotations.
pub(super) fn entry(size: [u32; 2], known: &LensEntry, lens: &Lens, groups: &[Group]) -> SiteCamera {
    let distortion = DistortionEntry::from_lens(lens, lens.focal);
    let distortion = distortion.map(|entry| DistortionEntry { focal_px: Some(lens.focal), ..entry });
    let lens = LensEntry { distortion, ..known.clone() };
    SiteCamera {
        lens: (lens != LensEntry::default()).then_some(lens),
        annotations: groups.iter().map(|group| group.annotation.clone()).collect(),
        ..SiteCamera::new("still", size)
    }
}

/// Solves a camera entry from its annotations; `None` if the solver fails.
pub(super) fn solve_entry(entry: &SiteCamera) -> Option<Solution> {
    let site = Site { cameras: vec![entry.clone()], ..Site::new() };
    let mut report = site.calibrate(&Options::default());
    report.cameras.pop()?.1.ok()
}
