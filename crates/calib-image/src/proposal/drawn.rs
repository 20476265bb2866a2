//! Edges as annotations, as an operator would draw them, and what the solve makes of them.

use calib_core::{Annotation, Kind, Lens, Pixel, UndistortedPixel};

use calib_site::{DistortionEntry, LensEntry, Options, Site, SiteCamera, Solution};

use super::lies::Lies;
use super::line::Line;
use super::mixture::Mixture;
use super::strokes::Stroke;

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
