//! The constraints of one camera: annotations, undistorted. Lines toward a vanishing point, lengths on the
//! floor, and uprights of known height, their end points in undistorted pixels relative to the principal
//! point with the covariance that the undistortion gives their noise.
//!
//! Annotations say *what* was drawn; constraints are what the residuals of stage 1 are computed from
//! (`residual.rs`). They depend on the lens, and are made anew when it changes.

use crate::camera::{Lens, Pixel};
pub(crate) use crate::outcome::Source;
use crate::single::annotation::{Annotation, ConstraintKind, Known};

/// The direction of a line in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// Vertical: the line passes through the nadir's vanishing point.
    Vertical,
    /// Horizontal: along the direction of a group, or at right angles to it.
    Floor {
        /// Index of the group, below [`Constraints::groups`].
        group: usize,
        /// At right angles to the direction of the group.
        orthogonal: bool,
    },
}

/// An end point of a segment with the covariance of its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Endpoint {
    /// Undistorted pixel relative to the principal point.
    pub point: [f64; 2],
    /// Covariance of `point` for a variance of 1 px^2 of each raw coordinate: `[uu, uv, vv]`.
    pub covariance: [f64; 3],
}

/// A segment whose direction in space is constrained.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Its two ends; of a polyline of three points and more, two points of the same first and second moments.
    pub ends: [Endpoint; 2],
    /// Its direction in space.
    pub direction: Direction,
    /// The drawing that it comes from.
    pub source: Source,
}

/// A segment of the floor whose length is known, or equal to that of others.
#[derive(Clone, Copy, Debug)]
pub struct Length {
    /// First and last point.
    pub ends: [Endpoint; 2],
    /// Index into [`Constraints::length_groups`].
    pub group: usize,
    /// The drawing that it comes from.
    pub source: Source,
}

/// A vertical object of known height that stands on the floor: a person, a post.
#[derive(Clone, Copy, Debug)]
pub struct Upright {
    /// Its foot, on the floor.
    pub foot: Endpoint,
    /// Its head, vertically above the foot.
    pub head: Endpoint,
    /// From foot to head, in metres.
    pub height: Known,
    /// The drawing that it comes from.
    pub source: Source,
}

/// The constraints of one camera.
#[derive(Clone, Debug, Default)]
pub struct Constraints {
    /// Segments whose direction is constrained.
    pub lines: Vec<Line>,
    /// Number of groups of floor directions: each is a nuisance parameter, an angle.
    pub groups: usize,
    /// Segments whose length is constrained.
    pub lengths: Vec<Length>,
    /// Length of every group in metres, where it is known; else it is a nuisance parameter.
    pub length_groups: Vec<Option<f64>>,
    /// Persons and posts.
    pub uprights: Vec<Upright>,
    /// Segments that give no constraint, and why.
    pub invalid: Vec<(Source, InvalidSegment)>,
}

/// Why a segment gives no constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InvalidSegment {
    /// One of its points cannot be undistorted.
    OutsideLens,
    /// Its ends coincide.
    NoLength,
}

/// Least length of a segment that has a direction, in pixels.
const MIN_LENGTH: f64 = 1e-3;

impl Constraints {
    /// The constraints of the annotations that are switched on, undistorted by `lens`.
    #[must_use]
    pub fn new(annotations: &[Annotation], lens: &Lens) -> Self {
        Self::of(annotations, lens, |annotation| !annotation.off)
    }

    /// The constraints of the annotations that are switched off: not fitted, but their residuals are
    /// reported.
    #[must_use]
    pub fn switched_off(annotations: &[Annotation], lens: &Lens) -> Self {
        Self::of(annotations, lens, |annotation| annotation.off)
    }

    fn of(annotations: &[Annotation], lens: &Lens, is_used: impl Fn(&Annotation) -> bool) -> Self {
        let mut constraints = Self::default();
        let mut directions: Vec<Option<(usize, bool)>> = vec![None; annotations.len()];
        for (index, annotation) in annotations.iter().enumerate() {
            if is_used(annotation) {
                constraints.add(annotations, index, lens, &mut directions);
            }
        }
        constraints
    }

    /// Whether there is nothing to fit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty() && self.lengths.is_empty() && self.uprights.is_empty()
    }

    fn add(
        &mut self,
        annotations: &[Annotation],
        index: usize,
        lens: &Lens,
        directions: &mut [Option<(usize, bool)>],
    ) {
        let annotation = &annotations[index];
        let segments = annotation.segments.as_deref().unwrap_or_default();
        match annotation.kind.row().constraint {
            ConstraintKind::StraightEdge => {}
            ConstraintKind::Vertical => self.add_lines(index, segments, lens, |_| Direction::Vertical),
            ConstraintKind::Parallel => {
                let (group, orthogonal) = direction_of(annotations, index, directions, &mut self.groups);
                self.add_lines(index, segments, lens, |_| Direction::Floor { group, orthogonal });
            }
            ConstraintKind::RightAngle => {
                let group = self.groups;
                self.groups += 1;
                self.add_lines(index, segments, lens, |i| Direction::Floor { group, orthogonal: i > 0 });
            }
            ConstraintKind::Length => self.add_lengths(index, annotation, segments, lens),
            ConstraintKind::Upright => self.add_upright(index, annotation, lens),
        }
    }

    fn add_lines(
        &mut self,
        annotation: usize,
        segments: &[Vec<Pixel>],
        lens: &Lens,
        direction: impl Fn(usize) -> Direction,
    ) {
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation, segment };
            match line_ends(points, lens).ok_or(InvalidSegment::OutsideLens).and_then(with_length) {
                Ok(ends) => self.lines.push(Line { ends, direction: direction(segment), source }),
                Err(reason) => self.invalid.push((source, reason)),
            }
        }
    }

    fn add_lengths(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>], lens: &Lens) {
        let group = self.length_groups.len();
        self.length_groups.push(annotation.length_m);
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation: index, segment };
            let ends = points
                .first()
                .zip(points.last())
                .and_then(|(&a, &b)| Some([endpoint(a, lens)?, endpoint(b, lens)?]));
            match ends.ok_or(InvalidSegment::OutsideLens).and_then(with_length) {
                Ok(ends) => self.lengths.push(Length { ends, group, source }),
                Err(reason) => self.invalid.push((source, reason)),
            }
        }
    }

    fn add_upright(&mut self, index: usize, annotation: &Annotation, lens: &Lens) {
        let source = Source { annotation: index, segment: 0 };
        let (Some(foot), Some(head), Some(height)) = (annotation.foot, annotation.head, annotation.height_m)
        else {
            return;
        };
        match (endpoint(foot, lens), endpoint(head, lens)) {
            (Some(foot), Some(head)) => self.uprights.push(Upright { foot, head, height, source }),
            _ => self.invalid.push((source, InvalidSegment::OutsideLens)),
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
    let root = loop {
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
    let mut direction = root;
    for (step, &link) in chain.iter().rev().enumerate() {
        if step > 0 {
            direction.1 = !direction.1;
        }
        directions[link] = Some(direction);
    }
    directions[index].unwrap_or(direction)
}

fn endpoint(pixel: Pixel, lens: &Lens) -> Option<Endpoint> {
    let (undistorted, [[a, b], [c, d]]) = lens.undistort_with_jacobian(pixel)?;
    let Pixel { u: cu, v: cv } = lens.principal_point;
    Some(Endpoint {
        point: [undistorted.u - cu, undistorted.v - cv],
        covariance: [a * a + b * b, a * c + b * d, c * c + d * d],
    })
}

fn with_length(ends: [Endpoint; 2]) -> Result<[Endpoint; 2], InvalidSegment> {
    let [a, b] = ends.map(|end| end.point);
    if (a[0] - b[0]).hypot(a[1] - b[1]) < MIN_LENGTH { Err(InvalidSegment::NoLength) } else { Ok(ends) }
}

/// Two points that determine the line as all its points do: the centroid plus and minus the standard
/// deviation along the line, each with half of the weight of them all. Their moments of first and second
/// order along the line are those of the polyline.
fn line_ends(points: &[Pixel], lens: &Lens) -> Option<[Endpoint; 2]> {
    let ends: Vec<Endpoint> = points.iter().map(|&pixel| endpoint(pixel, lens)).collect::<Option<_>>()?;
    if let [first, last] = ends[..] {
        return Some([first, last]);
    }
    let count = ends.len() as f64;
    let mean = |value: fn(&Endpoint) -> f64| ends.iter().map(value).sum::<f64>() / count;
    let centre = [mean(|e| e.point[0]), mean(|e| e.point[1])];
    let (mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0);
    for Endpoint { point: [u, v], .. } in &ends {
        let (du, dv) = (u - centre[0], v - centre[1]);
        uu += du * du;
        uv += du * dv;
        vv += dv * dv;
    }
    let angle = 0.5 * (2.0 * uv).atan2(uu - vv);
    let (sin, cos) = angle.sin_cos();
    let moment = (uu * cos * cos + 2.0 * uv * sin * cos + vv * sin * sin).max(0.0);
    let deviation = (moment / count).sqrt();
    let covariance = [mean(|e| e.covariance[0]), mean(|e| e.covariance[1]), mean(|e| e.covariance[2])]
        .map(|s| s * 2.0 / count);
    let at = |sign: f64| Endpoint {
        point: [centre[0] + sign * deviation * cos, centre[1] + sign * deviation * sin],
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
        let constraints = Constraints::new(&annotations, &lens);
        assert_eq!(constraints.groups, 1);
        let is_orthogonal: Vec<_> = constraints
            .lines
            .iter()
            .map(|line| matches!(line.direction, Direction::Floor { orthogonal: true, .. }))
            .collect();
        assert_eq!(is_orthogonal, [false, false, true], "c is tied to b, b to a: c leads along a");
    }

    #[test]
    fn a_polyline_of_many_points_weighs_as_much_as_its_points() {
        let lens = Lens::pinhole(Pixel::new(0.0, 0.0));
        let points: Vec<Pixel> = (0..9).map(|i| Pixel::new(f64::from(i) * 10.0, 3.0)).collect();
        let [a, b] = line_ends(&points, &lens).unwrap();
        assert!((a.point[1] - 3.0).abs() < 1e-12 && (b.point[0] - a.point[0]) > 40.0);
        assert!((a.covariance[0] - 2.0 / 9.0).abs() < 1e-12);
    }
}
