//! What annotations say once the lens is taken out: lines toward a direction, lengths, uprights,
//! in undistorted pixels relative to the principal point.

use crate::camera::{Lens, Pixel};
pub(crate) use crate::outcome::Source;
use crate::single::annotation::{Annotation, Evidence, Known};

/// Where a line leads in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// To the nadir.
    Vertical,
    /// Along the floor direction of a group, or at right angles to it.
    Floor {
        /// Index of the direction.
        group: usize,
        /// Turned by a right angle.
        orthogonal: bool,
    },
}

/// An end point of a segment with the shape of its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Endpoint {
    /// Undistorted pixel relative to the principal point.
    pub at: [f64; 2],
    /// Covariance of `at` for a variance of 1 px^2 of each raw coordinate: `[uu, uv, vv]`.
    pub covariance: [f64; 3],
}

/// A segment that leads toward a direction.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Its two ends; of a polyline, two points with the same moments along its line.
    pub ends: [Endpoint; 2],
    /// Where it leads.
    pub direction: Direction,
    /// Where it comes from.
    pub source: Source,
}

/// A segment of the floor whose length says something.
#[derive(Clone, Copy, Debug)]
pub struct Length {
    /// First and last point.
    pub ends: [Endpoint; 2],
    /// Index into [`Constraints::length_groups`].
    pub group: usize,
    /// Where it comes from.
    pub source: Source,
}

/// Something plumb of known height that stands on the floor.
#[derive(Clone, Copy, Debug)]
pub struct Upright {
    /// On the floor.
    pub foot: Endpoint,
    /// Straight above.
    pub head: Endpoint,
    /// In metres.
    pub height: Known,
    /// Where it comes from.
    pub source: Source,
}

/// Everything the annotations of one camera say.
#[derive(Clone, Debug, Default)]
pub struct Constraints {
    /// Segments that lead toward a direction.
    pub lines: Vec<Line>,
    /// Number of floor directions.
    pub groups: usize,
    /// Segments whose length says something.
    pub lengths: Vec<Length>,
    /// Length of every group of lengths in metres, where it is known.
    pub length_groups: Vec<Option<f64>>,
    /// Persons and posts.
    pub uprights: Vec<Upright>,
    /// Drawings that say nothing, and why.
    pub unusable: Vec<(Source, Unusable)>,
}

/// Why a drawing says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unusable {
    /// A point of it lies where the lens shows nothing.
    OutsideLens,
    /// Its ends coincide.
    NoLength,
}

/// Least length of a segment that has a direction, in pixels.
const LEAST: f64 = 1e-3;

impl Constraints {
    /// What `annotations` say through `lens`. Those switched off are left out unless `off` is asked for.
    #[must_use]
    pub fn new(annotations: &[Annotation], lens: &Lens, off: bool) -> Self {
        let mut constraints = Self::default();
        let mut directions: Vec<Option<(usize, bool)>> = vec![None; annotations.len()];
        for (index, annotation) in annotations.iter().enumerate() {
            if annotation.off == off {
                constraints.take(annotations, index, lens, &mut directions);
            }
        }
        constraints
    }

    /// Whether there is nothing to fit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty() && self.lengths.is_empty() && self.uprights.is_empty()
    }

    fn take(
        &mut self,
        annotations: &[Annotation],
        index: usize,
        lens: &Lens,
        directions: &mut [Option<(usize, bool)>],
    ) {
        let annotation = &annotations[index];
        let segments = annotation.segments.as_deref().unwrap_or_default();
        match annotation.kind.row().evidence {
            Evidence::Straight => {}
            Evidence::Plumb => self.take_lines(index, segments, lens, |_| Direction::Vertical),
            Evidence::Parallel => {
                let (group, orthogonal) = direction_of(annotations, index, directions, &mut self.groups);
                self.take_lines(index, segments, lens, |_| Direction::Floor { group, orthogonal });
            }
            Evidence::RightAngle => {
                let group = self.groups;
                self.groups += 1;
                self.take_lines(index, segments, lens, |i| Direction::Floor { group, orthogonal: i > 0 });
            }
            Evidence::Length => self.take_lengths(index, annotation, segments, lens),
            Evidence::Standing => self.take_upright(index, annotation, lens),
        }
    }

    fn take_lines(
        &mut self,
        annotation: usize,
        segments: &[Vec<Pixel>],
        lens: &Lens,
        direction: impl Fn(usize) -> Direction,
    ) {
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation, segment };
            match line_ends(points, lens).ok_or(Unusable::OutsideLens).and_then(with_length) {
                Ok(ends) => self.lines.push(Line { ends, direction: direction(segment), source }),
                Err(unusable) => self.unusable.push((source, unusable)),
            }
        }
    }

    fn take_lengths(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>], lens: &Lens) {
        let group = self.length_groups.len();
        self.length_groups.push(annotation.length_m);
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation: index, segment };
            let ends =
                points.first().zip(points.last()).and_then(|(&a, &b)| Some([end(a, lens)?, end(b, lens)?]));
            match ends.ok_or(Unusable::OutsideLens).and_then(with_length) {
                Ok(ends) => self.lengths.push(Length { ends, group, source }),
                Err(unusable) => self.unusable.push((source, unusable)),
            }
        }
    }

    fn take_upright(&mut self, index: usize, annotation: &Annotation, lens: &Lens) {
        let source = Source { annotation: index, segment: 0 };
        let (Some(foot), Some(head), Some(height)) = (annotation.foot, annotation.head, annotation.height_m)
        else {
            return;
        };
        match (end(foot, lens), end(head, lens)) {
            (Some(foot), Some(head)) => self.uprights.push(Upright { foot, head, height, source }),
            _ => self.unusable.push((source, Unusable::OutsideLens)),
        }
    }
}

/// The floor direction of a parallel annotation: its own, or that of the one it is tied to, turned.
fn direction_of(
    annotations: &[Annotation],
    index: usize,
    directions: &mut [Option<(usize, bool)>],
    groups: &mut usize,
) -> (usize, bool) {
    // Follow the ties to the end of the chain; a checked site has no cycles, an unchecked one ends too.
    let mut chain = vec![index];
    let mut seen = std::collections::HashSet::from([index]);
    let found = loop {
        let last = chain[chain.len() - 1];
        if let Some(direction) = directions[last] {
            break direction;
        }
        let tied = annotations[last]
            .at_right_angles_to
            .as_ref()
            .and_then(|id| annotations.iter().position(|a| a.may_be_tied() && a.id.as_ref() == Some(id)));
        match tied {
            Some(next) if seen.insert(next) => chain.push(next),
            _ => {
                *groups += 1;
                break (*groups - 1, false);
            }
        }
    };
    let mut direction = found;
    for (step, &link) in chain.iter().rev().enumerate() {
        if step > 0 {
            direction.1 = !direction.1;
        }
        directions[link] = Some(direction);
    }
    directions[index].unwrap_or(direction)
}

fn end(pixel: Pixel, lens: &Lens) -> Option<Endpoint> {
    let (straight, [[a, b], [c, d]]) = lens.undistort_with_jacobian(pixel)?;
    let Pixel { u: cu, v: cv } = lens.principal_point;
    Some(Endpoint {
        at: [straight.u - cu, straight.v - cv],
        covariance: [a * a + b * b, a * c + b * d, c * c + d * d],
    })
}

fn with_length(ends: [Endpoint; 2]) -> Result<[Endpoint; 2], Unusable> {
    let [a, b] = ends.map(|end| end.at);
    if (a[0] - b[0]).hypot(a[1] - b[1]) < LEAST { Err(Unusable::NoLength) } else { Ok(ends) }
}

/// Two points that say about the line's direction and place what all its points say: the centroid
/// plus and minus the spread along the line, each with half of the weight of them all.
fn line_ends(points: &[Pixel], lens: &Lens) -> Option<[Endpoint; 2]> {
    let ends: Vec<Endpoint> = points.iter().map(|&pixel| end(pixel, lens)).collect::<Option<_>>()?;
    if let [first, last] = ends[..] {
        return Some([first, last]);
    }
    let count = ends.len() as f64;
    let mean = |value: fn(&Endpoint) -> f64| ends.iter().map(value).sum::<f64>() / count;
    let centre = [mean(|e| e.at[0]), mean(|e| e.at[1])];
    let (mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0);
    for Endpoint { at: [u, v], .. } in &ends {
        let (du, dv) = (u - centre[0], v - centre[1]);
        uu += du * du;
        uv += du * dv;
        vv += dv * dv;
    }
    let angle = 0.5 * (2.0 * uv).atan2(uu - vv);
    let (sin, cos) = angle.sin_cos();
    let along = (uu * cos * cos + 2.0 * uv * sin * cos + vv * sin * sin).max(0.0);
    let reach = (along / count).sqrt();
    let covariance = [mean(|e| e.covariance[0]), mean(|e| e.covariance[1]), mean(|e| e.covariance[2])]
        .map(|s| s * 2.0 / count);
    let at = |sign: f64| Endpoint {
        at: [centre[0] + sign * reach * cos, centre[1] + sign * reach * sin],
        covariance,
    };
    Some([at(-1.0), at(1.0)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::single::annotation::Kind;

    fn parallel(id: &str, tied: Option<&str>) -> Annotation {
        let segment = vec![Pixel::new(0.0, 0.0), Pixel::new(10.0, 5.0)];
        Annotation {
            id: Some(id.into()),
            at_right_angles_to: tied.map(Into::into),
            ..Annotation::of_segments(Kind::Parallel, vec![segment])
        }
    }

    #[test]
    fn directions_tied_at_right_angles_share_one_group_in_any_order() {
        let lens = Lens::pinhole(Pixel::new(0.0, 0.0));
        let annotations = [parallel("c", Some("b")), parallel("a", None), parallel("b", Some("a"))];
        let constraints = Constraints::new(&annotations, &lens, false);
        assert_eq!(constraints.groups, 1);
        let quarters: Vec<_> = constraints
            .lines
            .iter()
            .map(|line| matches!(line.direction, Direction::Floor { orthogonal: true, .. }))
            .collect();
        assert_eq!(quarters, [false, false, true], "c is tied to b, b to a: c leads along a");
    }

    #[test]
    fn a_polyline_of_many_points_weighs_as_much_as_its_points() {
        let lens = Lens::pinhole(Pixel::new(0.0, 0.0));
        let points: Vec<Pixel> = (0..9).map(|i| Pixel::new(f64::from(i) * 10.0, 3.0)).collect();
        let [a, b] = line_ends(&points, &lens).unwrap();
        assert!((a.at[1] - 3.0).abs() < 1e-12 && (b.at[0] - a.at[0]) > 40.0);
        assert!((a.covariance[0] - 2.0 / 9.0).abs() < 1e-12);
    }
}
