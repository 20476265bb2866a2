//! From what was drawn to what is fitted: annotations as constraints, undistorted by a lens.

use crate::camera::{Chart, Lens, Pixel};
use crate::optimize::{ByLens, Number};
use crate::outcome::Source;
use crate::single::annotation::{Annotation, ConstraintKind};
use crate::single::constraints::{
    Constraints, Direction, DrawnPlane, Endpoint, InvalidSegment, Length, Line, Upright,
};
use crate::single::plane_prior::PlanePrior;
use crate::single::redrawing::share_redrawn;
use crate::single::scene_errors::{Deviation, SceneErrors};

/// Least length of a segment that has a direction, in pixels.
const MIN_LENGTH: f64 = 1e-3;
impl Constraints {
    /// The constraints of the annotations that are switched on, undistorted by `lens`.
    #[must_use]
    pub fn new(annotations: &[Annotation], lens: &Lens, scene: SceneErrors) -> Self {
        Self::on_planes(annotations, lens, scene, &[])
    }

    /// As [`Self::new`], of annotations that may lie on these planes; one that names none of them lies on the
    /// floor.
    #[must_use]
    pub fn on_planes(
        annotations: &[Annotation],
        lens: &Lens,
        scene: SceneErrors,
        planes: &[PlanePrior],
    ) -> Self {
        Self::in_charts_of(lens, annotations, lens, scene, planes)
    }

    /// The constraints of the annotations that are switched off: not fitted, but their residuals are
    /// reported.
    #[must_use]
    pub fn switched_off(annotations: &[Annotation], lens: &Lens, planes: &[PlanePrior]) -> Self {
        Builder::build(annotations, [lens; 2], SceneErrors::EXACT, planes, |annotation| annotation.off)
    }
}

#[expect(
    private_bounds,
    reason = "what is drawn becomes numbers of two kinds: values, and values with derivatives"
)]
impl<E: OfLens> Constraints<E> {
    /// As [`Constraints::on_planes`], in the charts of a lens from which `lens` is estimated; of [`ByLens`] with the
    /// derivatives by the parameters of the lens.
    pub(crate) fn in_charts_of(
        start: &Lens,
        annotations: &[Annotation],
        lens: &Lens,
        scene: SceneErrors,
        planes: &[PlanePrior],
    ) -> Self {
        Builder::build(annotations, [lens, start], scene, planes, |annotation| !annotation.off)
    }
}

/// Constraints in the making.
struct Builder<'a, E> {
    annotations: &'a [Annotation],
    lens: &'a Lens,
    /// The lens whose charts are used.
    charts: &'a Lens,
    planes: &'a [PlanePrior],
    constraints: Constraints<E>,
    /// Floor directions that are known so far: group, and whether at right angles to it.
    directions: Vec<Option<(usize, bool)>>,
}

impl<'a, E: OfLens> Builder<'a, E> {
    fn build(
        annotations: &'a [Annotation],
        [lens, charts]: [&'a Lens; 2],
        scene: SceneErrors,
        planes: &'a [PlanePrior],
        is_used: impl Fn(&Annotation) -> bool,
    ) -> Constraints<E> {
        let directions = vec![None; annotations.len()];
        let sigma_px = annotations.iter().map(|annotation| annotation.sigma_px).collect();
        let constraints = Constraints { scene, sigma_px, ..Constraints::default() };
        let mut builder = Self { annotations, lens, charts, planes, constraints, directions };
        for (index, annotation) in annotations.iter().enumerate() {
            if is_used(annotation) {
                builder.add(index, annotation);
            }
        }
        share_redrawn(&mut builder.constraints);
        builder.constraints
    }

    fn add(&mut self, index: usize, annotation: &Annotation) {
        let segments = annotation.segments.as_deref().unwrap_or_default();
        match annotation.kind.row().constraint {
            ConstraintKind::StraightEdge => {}
            ConstraintKind::Vertical => self.add_lines(index, segments, |_| (Direction::Vertical, None)),
            ConstraintKind::Parallel => self.add_parallels(index, annotation, segments),
            ConstraintKind::RightAngle => self.add_right_angles(index, annotation, segments),
            ConstraintKind::Length => self.add_lengths(index, annotation, segments),
            ConstraintKind::Upright => self.add_upright(index, annotation),
        }
    }

    fn add_parallels(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>]) {
        let groups = &mut self.constraints.groups;
        let (group, orthogonal) = direction_of(self.annotations, index, &mut self.directions, groups);
        let scene = self.constraints.scene.of(annotation);
        // The annotation that others are tied to gives the group its direction.
        let azimuth = if annotation.at_right_angles_to.is_some() { scene.angle } else { 0.0 };
        let plane = self.plane(annotation);
        let deviation = self.deviation(Deviation { group, orthogonal, azimuth, level: scene.level(), plane });
        self.add_lines(index, segments, |_| (Direction::Floor { group, orthogonal }, deviation));
    }

    fn add_right_angles(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>]) {
        let group = self.constraints.groups;
        self.constraints.groups += 1;
        let scene = self.constraints.scene.of(annotation);
        let azimuth = |i: usize| if i > 0 { scene.angle } else { 0.0 };
        let plane = self.plane(annotation);
        let deviation = |i: usize| {
            let (orthogonal, azimuth, level) = (i > 0, azimuth(i), scene.level());
            self.deviation(Deviation { group, orthogonal, azimuth, level, plane })
        };
        let deviations: Vec<Option<usize>> = (0..segments.len()).map(deviation).collect();
        self.add_lines(index, segments, |i| (Direction::Floor { group, orthogonal: i > 0 }, deviations[i]));
    }

    /// The deviation of a drawn direction, if it deviates or lies on a plane.
    fn deviation(&mut self, deviation: Deviation) -> Option<usize> {
        let Deviation { azimuth, level, plane, .. } = deviation;
        (azimuth > 0.0 || level > 0.0 || plane.is_some()).then(|| {
            self.constraints.deviations.push(deviation);
            self.constraints.deviations.len() - 1
        })
    }

    /// The plane that an annotation names, as one that something was drawn on.
    fn plane(&mut self, annotation: &Annotation) -> Option<usize> {
        let named = annotation.plane.as_ref()?;
        let index = self.planes.iter().position(|plane| plane.id == *named)?;
        let drawn = &mut self.constraints.planes;
        Some(drawn.iter().position(|plane| plane.index == index).unwrap_or_else(|| {
            drawn.push(DrawnPlane { index, prior: self.planes[index].clone() });
            drawn.len() - 1
        }))
    }

    fn add_lines(
        &mut self,
        annotation: usize,
        segments: &[Vec<Pixel>],
        direction: impl Fn(usize) -> (Direction, Option<usize>),
    ) {
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation, segment };
            let chart = Chart::toward(self.charts, points);
            let ends = line_ends(points, self.lens, chart.as_ref());
            match ends.ok_or(InvalidSegment::OutsideLens).and_then(with_length) {
                Ok(ends) => {
                    let (direction, deviation) = direction(segment);
                    self.constraints.lines.push(Line { chart, ends, direction, deviation, source });
                }
                Err(reason) => self.constraints.invalid.push((source, reason)),
            }
        }
    }

    fn add_lengths(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>]) {
        let group = self.constraints.length_groups.len();
        let known = annotation.length();
        let spread = if known.is_some() { 0.0 } else { self.constraints.scene.of(annotation).length };
        self.constraints.length_groups.push(known);
        let plane = self.plane(annotation);
        // What has a usual size lies as it happens to, and one length alone is a measured distance.
        let is_along = annotation.usual().is_none_or(|usual| usual.lies_along);
        let is_mark = is_along && segments.len() > 1 && plane.is_none();
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation: index, segment };
            let chart = Chart::toward(self.charts, points);
            let end = |pixel: Pixel| E::endpoint(pixel, self.lens, chart.as_ref());
            let ends = points.first().zip(points.last()).and_then(|(&a, &b)| Some([end(a)?, end(b)?]));
            match ends.ok_or(InvalidSegment::OutsideLens).and_then(with_length) {
                Ok(ends) => {
                    self.constraints.lengths.push(Length {
                        chart,
                        ends,
                        group,
                        spread,
                        is_mark,
                        plane,
                        source,
                    });
                }
                Err(reason) => self.constraints.invalid.push((source, reason)),
            }
        }
    }

    fn add_upright(&mut self, index: usize, annotation: &Annotation) {
        let source = Source { annotation: index, segment: 0 };
        let (Some(foot), Some(head), Some(height)) = (annotation.foot, annotation.head, annotation.height())
        else {
            return;
        };
        let plane = self.plane(annotation);
        let chart = Chart::toward(self.charts, &[foot, head]);
        let end = |pixel: Pixel| E::endpoint(pixel, self.lens, chart.as_ref());
        match (end(foot), end(head)) {
            (Some(foot), Some(head)) => {
                self.constraints.uprights.push(Upright { chart, foot, head, height, plane, source });
            }
            _ => self.constraints.invalid.push((source, InvalidSegment::OutsideLens)),
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

/// What the coordinates of an end point may be.
trait OfLens: Number {
    /// Where a raw pixel is undistorted or in a chart, with the covariance of unit noise there.
    fn endpoint(pixel: Pixel, lens: &Lens, chart: Option<&Chart>) -> Option<Endpoint<Self>>;
}

impl OfLens for f64 {
    fn endpoint(pixel: Pixel, lens: &Lens, chart: Option<&Chart>) -> Option<Endpoint> {
        let point = lens.in_chart(pixel, chart)?;
        Some(Endpoint { point: point.at, covariance: covariance_of_unit_noise(point.jacobian) })
    }
}

impl OfLens for ByLens {
    fn endpoint(pixel: Pixel, lens: &Lens, chart: Option<&Chart>) -> Option<Endpoint<Self>> {
        let found = lens.in_chart(pixel, chart)?;
        let by = lens.in_chart_by_parameters(pixel, &found, chart);
        let point = [0, 1].map(|axis| Self { value: found.at[axis], gradient: by.map(|by| by.at[axis]) });
        let jacobian = [0, 1].map(|row| {
            [0, 1].map(|column| Self {
                value: found.jacobian[row][column],
                gradient: by.map(|by| by.jacobian[row][column]),
            })
        });
        Some(Endpoint { point, covariance: covariance_of_unit_noise(jacobian) })
    }
}

/// `J J'`.
fn covariance_of_unit_noise<E: Number>([[a, b], [c, d]]: [[E; 2]; 2]) -> [E; 3] {
    [a * a + b * b, a * c + b * d, c * c + d * d]
}

fn with_length<E: Number>(ends: [Endpoint<E>; 2]) -> Result<[Endpoint<E>; 2], InvalidSegment> {
    let [a, b] = ends.map(|end| end.point.map(Number::value));
    if (a[0] - b[0]).hypot(a[1] - b[1]) < MIN_LENGTH { Err(InvalidSegment::NoLength) } else { Ok(ends) }
}

/// Two points that determine the line as all its points do: the centroid plus and minus the standard
/// deviation along the line, each with half of the weight of them all. Their moments of first and second
/// order along the line are those of the polyline.
fn line_ends<E: OfLens>(points: &[Pixel], lens: &Lens, chart: Option<&Chart>) -> Option<[Endpoint<E>; 2]> {
    let ends: Vec<Endpoint<E>> =
        points.iter().map(|&pixel| E::endpoint(pixel, lens, chart)).collect::<Option<_>>()?;
    if let [first, last] = ends[..] {
        return Some([first, last]);
    }
    let share = (ends.len() as f64).recip();
    let sum = |value: &dyn Fn(&Endpoint<E>) -> E| {
        ends.iter().map(value).fold(E::constant(0.0), |sum, value| sum + value)
    };
    let mean = |value: &dyn Fn(&Endpoint<E>) -> E| sum(value) * share;
    let centre = [0, 1].map(|axis| mean(&|end| end.point[axis]));
    let moment = |i: usize, j: usize| {
        sum(&|end: &Endpoint<E>| (end.point[i] - centre[i]) * (end.point[j] - centre[j]))
    };
    let (uu, uv, vv) = (moment(0, 0), moment(0, 1), moment(1, 1));
    let (sin, cos) = ((uv * 2.0).atan2(uu - vv) * 0.5).sin_cos();
    let moment = (uu * cos * cos + uv * sin * cos * 2.0 + vv * sin * sin).at_least(0.0);
    let deviation = (moment * share).sqrt();
    let covariance = [0, 1, 2].map(|k| mean(&|end| end.covariance[k]) * (2.0 * share));
    let at = |sign: f64| Endpoint {
        point: [centre[0] + deviation * cos * sign, centre[1] + deviation * sin * sign],
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
        let constraints = Constraints::new(&annotations, &lens, SceneErrors::EXACT);
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
        let [a, b] = line_ends::<f64>(&points, &lens, None).unwrap();
        assert!((a.point[1] - 3.0).abs() < 1e-12 && (b.point[0] - a.point[0]) > 40.0);
        assert!((a.covariance[0] - 2.0 / 9.0).abs() < 1e-12);
    }
}
