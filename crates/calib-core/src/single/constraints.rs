//! Constraints of one camera: the undistorted annotations.
//!
//! The constraints are lines toward a vanishing point, lengths on the floor, and uprights of known height.
//! Their end points are undistorted pixels relative to the principal point, with the propagated covariance of
//! the noise. The residuals of stage 1 are computed from constraints (`residual.rs`). Constraints depend on
//! the lens and are recomputed when it changes.
//!
//! # Repeated annotations
//!
//! A line that is drawn several times counts once. This applies to its noise, to the scene's own errors in
//! it, and to its priors.
//!
//! Each of `n` copies has `n` times the variance in all its own quantities. These are the noise of its ends,
//! the spread of its length, and the height of its upright. A group of copies may share a quantity, for
//! example the deviation of a direction or the prior of a length. Its variance is divided by the group's
//! share of all copies of the same line. The shares of equal groups add up to 1. A right angle is a relation
//! between two sides. It is a repeat if both sides are repeated, or if one side is repeated and both angles
//! share the other side.
//!
//! The information of a sum of two variances is concave in the shares. So repeated annotations never add
//! information to a single one.

use crate::camera::{Chart, Lens, Pixel};
use crate::optimize::{ByLens, Number};
use crate::single::annotation::{Annotation, ConstraintKind, Known};
use crate::single::overlaps::Repeats;
use crate::single::overlaps::{Count, Overlaps};
use crate::single::parameters::PlanePrior;
use crate::single::scene_errors::{Deviation, SceneErrors};

pub use crate::outcome::Source;

/// End point of a segment with the covariance of its noise.
///
/// The number type `E` is a plain value, or a value with its derivatives with respect to the lens parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Endpoint<E = f64> {
    /// Undistorted pixel relative to the principal point; for a wide lens, the point in a chart.
    pub point: [E; 2],
    /// Covariance of `point` for a variance of 1 px^2 of each raw coordinate: `[uu, uv, vv]`.
    pub covariance: [E; 3],
}

/// Direction of a line in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// Vertical: the line passes through the vanishing point of the nadir.
    Vertical,
    /// Horizontal: parallel or at right angles to the direction of a group.
    Floor {
        /// Index of the group, less than [`Constraints::groups`].
        group: usize,
        /// Whether the line is at right angles to the direction of the group.
        orthogonal: bool,
    },
}

/// Segment whose direction in space is constrained.
#[derive(Clone, Copy, Debug)]
pub struct LineConstraint<E = f64> {
    /// Chart (virtual pinhole view) of the ends, for a wide lens; `None` for undistorted pixels.
    pub chart: Option<Chart>,
    /// The two ends. A polyline of three or more points is replaced by two points with equal first and second
    /// moments.
    pub ends: [Endpoint<E>; 2],
    /// Direction of the line in space.
    pub direction: Direction,
    /// Deviation from the direction of the group, as an index into [`Constraints::deviations`].
    pub deviation: Option<usize>,
    /// Annotated segment.
    pub source: Source,
}

/// Floor segment whose length is known, or equal to the length of others.
#[derive(Clone, Copy, Debug)]
pub struct LengthConstraint<E = f64> {
    /// Chart (virtual pinhole view) of the ends, for a wide lens; `None` for undistorted pixels.
    pub chart: Option<Chart>,
    /// First and last point.
    pub ends: [Endpoint<E>; 2],
    /// Group of equal lengths, as an index into [`Constraints::length_groups`].
    pub group: usize,
    /// Standard deviation of the difference between the true log length and the log length of the group. It does not
    /// include the noise of the ends.
    pub spread: f64,
    /// Whether the segment is one of several floor marks of equal length, for example lane marks. Ground with such
    /// marks may slope across them (`crossfall.rs`).
    pub is_mark: bool,
    /// Plane of the segment, as an index into [`Constraints::planes`]; `None` for the floor.
    pub plane: Option<usize>,
    /// Annotated segment.
    pub source: Source,
}

/// Vertical object of known height on the floor: a person or a post.
#[derive(Clone, Copy, Debug)]
pub struct UprightConstraint<E = f64> {
    /// Chart (virtual pinhole view) of foot and head, for a wide lens; `None` for undistorted pixels.
    pub chart: Option<Chart>,
    /// Foot, on the floor.
    pub foot: Endpoint<E>,
    /// Head, vertically above the foot.
    pub head: Endpoint<E>,
    /// Height from foot to head, in metres.
    pub height: Known,
    /// Plane of the foot, as an index into [`Constraints::planes`]; `None` for the floor.
    pub plane: Option<usize>,
    /// Annotated segment, from foot to head.
    pub source: Source,
}

/// Plane that at least one annotation refers to.
#[derive(Clone, Debug, PartialEq)]
pub struct AnnotatedPlane {
    /// Index among all planes of the scene.
    pub index: usize,
    /// Prior on the height and slope of the plane.
    pub prior: PlanePrior,
}

/// Constraints of one camera.
#[derive(Clone, Debug)]
pub struct Constraints<E = f64> {
    /// Segments whose direction is constrained.
    pub lines: Vec<LineConstraint<E>>,
    /// Number of groups of floor directions; the angle of each group is a nuisance parameter.
    pub groups: usize,
    /// Segments whose length is constrained.
    pub lengths: Vec<LengthConstraint<E>>,
    /// Known length of every group, in metres. Lengths that are unknown or have a standard deviation are
    /// nuisance parameters.
    pub length_groups: Vec<Option<Known>>,
    /// Persons and posts.
    pub uprights: Vec<UprightConstraint<E>>,
    /// Deviations of annotated directions from the directions of their groups.
    pub deviations: Vec<Deviation>,
    /// Planes other than the floor that annotations refer to.
    pub planes: Vec<AnnotatedPlane>,
    /// Standard deviations of the scene's own errors.
    pub scene: SceneErrors,
    /// Repeat counts: factors of the variances of repeated segments.
    pub repeats: Repeats,
    /// Standard deviation of the coordinates of every annotation, in pixels; `None` for the camera's
    /// value.
    pub sigma_px: Vec<Option<f64>>,
    /// Segments that give no constraint, with the reason.
    pub invalid: Vec<(Source, InvalidSegment)>,
}

/// Reason why a segment gives no constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InvalidSegment {
    /// A point of the segment cannot be undistorted.
    OutsideLens,
    /// The ends of the segment coincide.
    NoLength,
}

impl<E> Default for Constraints<E> {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl<E> Constraints<E> {
    /// Constraints of an image without annotations.
    pub const EMPTY: Self = Self {
        lines: Vec::new(),
        groups: 0,
        lengths: Vec::new(),
        length_groups: Vec::new(),
        uprights: Vec::new(),
        deviations: Vec::new(),
        planes: Vec::new(),
        scene: SceneErrors::EXACT,
        repeats: Repeats::NONE,
        sigma_px: Vec::new(),
        invalid: Vec::new(),
    };

    /// Whether the list of constraints is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty() && self.lengths.is_empty() && self.uprights.is_empty()
    }
}

/// Scales the variances of repeated annotations so that all copies together count once.
pub(crate) fn weight_repeats<E: Number>(drawn: &mut Constraints<E>) {
    weight_repeated_lines(drawn);
    weight_repeated_lengths(drawn);
    weight_repeated_uprights(drawn);
}

/// Scales the noise of repeated lines so that all copies together count once. Scales the variances of their
/// direction deviations likewise.
fn weight_repeated_lines<E: Number>(constraints: &mut Constraints<E>) {
    let drawn: Vec<_> =
        constraints.lines.iter().map(|line| polyline(line.chart.as_ref(), line.ends.each_ref())).collect();
    let group = |line: usize| match constraints.lines[line].direction {
        Direction::Floor { group, .. } => Some(group),
        Direction::Vertical => None,
    };
    let counts =
        Overlaps::new(&drawn).counts([&|_| Some(0), &group, &|line| constraints.lines[line].deviation]);
    // Shares within all copies of a line: the share of the group, and the share of one deviation within the
    // group.
    let [of_all, of_group] = [
        |[_, group, _]: &[Count; 3]| group.share(),
        |[_, group, own]: &[Count; 3]| if group.own > 0.0 { own.own / group.own } else { 1.0 },
    ];
    let directions =
        Shares::new(constraints.groups, counts.iter().enumerate().map(|(i, of)| (group(i), of_all(of))));
    let by_deviation = |share: &dyn Fn(&[Count; 3]) -> f64| {
        let own = counts.iter().zip(&constraints.lines).map(|(of, line)| (line.deviation, share(of)));
        Shares::new(constraints.deviations.len(), own)
    };
    let [as_group, in_group] = [by_deviation(&of_all), by_deviation(&of_group)];
    let as_level = by_deviation(&|[.., own]| own.share());
    for (index, deviation) in constraints.deviations.iter_mut().enumerate() {
        let rest = directions.mean_share_without(deviation.group, as_group.0[index]);
        let of_angle = in_group.mean_share(index) * as_group.mean_share(index).max(rest.unwrap_or(0.0));
        deviation.azimuth /= of_angle.sqrt();
        deviation.level /= as_level.mean_share(index).sqrt();
    }
    constraints.repeats.set_direction_shares(&directions.mean_shares());
    for (line, [Count { all: times, .. }, ..]) in constraints.lines.iter_mut().zip(&counts) {
        line.ends.iter_mut().for_each(|end| scale_variance(end, *times));
    }
    constraints
        .repeats
        .insert(constraints.lines.iter().zip(&counts).map(|(line, [count, ..])| (line.source, count.all)));
}

/// Scales the noise and spread of repeated lengths so that all copies together count once. Scales the variances
/// of the length priors of their groups likewise.
fn weight_repeated_lengths<E: Number>(constraints: &mut Constraints<E>) {
    let drawn: Vec<_> = constraints
        .lengths
        .iter()
        .map(|length| polyline(length.chart.as_ref(), length.ends.each_ref()))
        .collect();
    let of_group = |length: usize, is_of: fn(&Option<Known>) -> bool| {
        Some(constraints.lengths[length].group).filter(|&group| is_of(&constraints.length_groups[group]))
    };
    let unknown = |length: usize| of_group(length, |known| known.is_none());
    let known = |length: usize| of_group(length, |known| known.is_some_and(|known| known.sigma.is_some()));
    let counts = Overlaps::new(&drawn).counts([&|_| Some(0), &unknown, &known]);
    let of = |k: usize| {
        counts.iter().zip(&constraints.lengths).map(move |(of, length)| (Some(length.group), of[k].share()))
    };
    let [unknown, known] = [1, 2].map(|k| Shares::new(constraints.length_groups.len(), of(k)));
    constraints.repeats.set_length_shares(&unknown.mean_shares());
    for (group, of) in constraints.length_groups.iter_mut().enumerate() {
        let sigma = of.as_mut().and_then(|of| of.sigma.as_mut());
        sigma.into_iter().for_each(|sigma| *sigma /= known.mean_share(group).sqrt());
    }
    for (length, [Count { all: times, .. }, ..]) in constraints.lengths.iter_mut().zip(&counts) {
        length.ends.iter_mut().for_each(|end| scale_variance(end, *times));
        length.spread *= times.sqrt();
    }
    constraints.repeats.insert(
        constraints.lengths.iter().zip(&counts).map(|(length, [count, ..])| (length.source, count.all)),
    );
}

/// Scales the noise of repeated uprights, and the variances of their heights.
fn weight_repeated_uprights<E: Number>(constraints: &mut Constraints<E>) {
    let drawn: Vec<_> =
        constraints.uprights.iter().map(|of| polyline(of.chart.as_ref(), [&of.foot, &of.head])).collect();
    let times = Overlaps::new(&drawn).repeat_counts();
    for (upright, times) in constraints.uprights.iter_mut().zip(&times) {
        [&mut upright.foot, &mut upright.head].into_iter().for_each(|end| scale_variance(end, *times));
        upright.height.sigma.iter_mut().for_each(|sigma| *sigma *= times.sqrt());
    }
    constraints.repeats.insert(constraints.uprights.iter().map(|upright| upright.source).zip(times));
}

/// Multiplies the noise covariance of an end point by a repeat count.
fn scale_variance<E: Number>(end: &mut Endpoint<E>, times: f64) {
    if times > 1.0 {
        end.covariance = end.covariance.map(|entry| entry * times);
    }
}

/// Returns both ends of a segment in coordinates that do not depend on its chart, so that segments can be compared.
/// They are undistorted pixels, or equidistant pixels for a wide lens, relative to the principal point.
fn polyline<E: Number>(chart: Option<&Chart>, ends: [&Endpoint<E>; 2]) -> Vec<[f64; 2]> {
    let points = ends.map(|end| end.point.map(Number::value));
    points.map(|point| chart.map_or(point, |chart| chart.equidistant_point(point))).to_vec()
}

/// Sum of the shares of the members of every group, and the number of members. A share is a fraction of the copies of
/// a line, between 0 and 1 ([`Count::share`]).
struct Shares(Vec<(f64, f64)>);

impl Shares {
    /// Sums the shares of members, given as pairs of group and share; members without a group are ignored.
    fn new(groups: usize, members: impl Iterator<Item = (Option<usize>, f64)>) -> Self {
        let mut sums = vec![(0.0, 0.0); groups];
        for (group, share) in members {
            if let Some(group) = group {
                sums[group] = (sums[group].0 + share, sums[group].1 + 1.0);
            }
        }
        Self(sums)
    }

    /// Returns the mean share of the members of a group; 1 for an empty group.
    fn mean_share(&self, group: usize) -> f64 {
        mean(self.0[group]).unwrap_or(1.0)
    }

    /// Returns the mean share of a group without some of its members; `None` if no member remains. `sum` is the sum
    /// of the shares of the excluded members, and `count` is their number.
    fn mean_share_without(&self, group: usize, (sum, count): (f64, f64)) -> Option<f64> {
        let all = self.0[group];
        mean((all.0 - sum, all.1 - count))
    }

    /// Returns the mean share of the members of every group.
    fn mean_shares(&self) -> Vec<f64> {
        (0..self.0.len()).map(|group| self.mean_share(group)).collect()
    }
}

/// Returns the mean of `count` shares with this sum, at most 1; `None` without shares.
fn mean((sum, count): (f64, f64)) -> Option<f64> {
    (count > 0.5).then(|| (sum / count).min(1.0))
}

/// Minimum distance of the ends of a segment with a defined direction, in undistorted pixels.
const MIN_SEGMENT_LENGTH_PX: f64 = 1e-3;
impl Constraints {
    /// Computes the constraints of the annotations that are switched on, undistorted by `lens`.
    #[must_use]
    pub fn new(annotations: &[Annotation], lens: &Lens, scene: SceneErrors) -> Self {
        Self::on_planes(annotations, lens, scene, &[])
    }

    /// Computes constraints like [`Self::new`], for annotations that may be on these planes. An annotation
    /// that names no plane is on the floor.
    #[must_use]
    pub fn on_planes(
        annotations: &[Annotation],
        lens: &Lens,
        scene: SceneErrors,
        planes: &[PlanePrior],
    ) -> Self {
        Self::in_charts_of(lens, annotations, lens, scene, planes)
    }

    /// Computes the constraints of the annotations that are switched off, to report their residuals.
    #[must_use]
    pub fn switched_off(annotations: &[Annotation], lens: &Lens, planes: &[PlanePrior]) -> Self {
        Builder::build(annotations, [lens; 2], SceneErrors::EXACT, planes, |annotation| annotation.off)
    }
}

#[expect(
    private_bounds,
    reason = "constraints exist with two number types: plain values, and values with derivatives"
)]
impl<E: LensNumber> Constraints<E> {
    /// Computes constraints as [`Constraints::on_planes`] does, but in the charts (virtual pinhole views) of `start`,
    /// the initial lens of the estimation of `lens`.
    ///
    /// With numbers of type [`ByLens`], they include the derivatives with respect to the parameters of the lens.
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

/// Builder of the constraints.
struct Builder<'a, E> {
    annotations: &'a [Annotation],
    lens: &'a Lens,
    /// Lens that defines the charts (virtual pinhole views). It is the initial lens if `lens` is being estimated.
    charts: &'a Lens,
    planes: &'a [PlanePrior],
    constraints: Constraints<E>,
    /// Floor direction of every annotation of parallel lines: its group, and whether it is at right angles to the
    /// direction of the group. `None` until it is computed.
    directions: Vec<Option<(usize, bool)>>,
}

impl<'a, E: LensNumber> Builder<'a, E> {
    /// Computes the constraints of the annotations for which `is_used` holds.
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
        weight_repeats(&mut builder.constraints);
        builder.constraints
    }

    /// Adds the constraints of an annotation, according to its kind.
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

    /// Adds the lines of an annotation of parallel floor lines.
    fn add_parallels(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>]) {
        let groups = &mut self.constraints.groups;
        let (group, orthogonal) = direction_of(self.annotations, index, &mut self.directions, groups);
        let scene = self.constraints.scene.for_annotation(annotation);
        // The first annotation of a tied chain defines the direction of the group.
        let azimuth = if annotation.at_right_angles_to.is_some() { scene.angle } else { 0.0 };
        let plane = self.plane(annotation);
        let deviation = self.deviation(Deviation { group, orthogonal, azimuth, level: scene.level(), plane });
        self.add_lines(index, segments, |_| (Direction::Floor { group, orthogonal }, deviation));
    }

    /// Adds the lines of a right angle on the floor.
    fn add_right_angles(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>]) {
        let group = self.constraints.groups;
        self.constraints.groups += 1;
        let scene = self.constraints.scene.for_annotation(annotation);
        let azimuth = |i: usize| if i > 0 { scene.angle } else { 0.0 };
        let plane = self.plane(annotation);
        let deviation = |i: usize| {
            let (orthogonal, azimuth, level) = (i > 0, azimuth(i), scene.level());
            self.deviation(Deviation { group, orthogonal, azimuth, level, plane })
        };
        let deviations: Vec<Option<usize>> = (0..segments.len()).map(deviation).collect();
        self.add_lines(index, segments, |i| (Direction::Floor { group, orthogonal: i > 0 }, deviations[i]));
    }

    /// Adds the deviation of an annotated direction from the direction of its group, and returns the index of the
    /// deviation. Returns `None` for an exact direction on the floor.
    fn deviation(&mut self, deviation: Deviation) -> Option<usize> {
        let Deviation { azimuth, level, plane, .. } = deviation;
        (azimuth > 0.0 || level > 0.0 || plane.is_some()).then(|| {
            self.constraints.deviations.push(deviation);
            self.constraints.deviations.len() - 1
        })
    }

    /// Returns the index of the plane that an annotation names, and adds the plane if it is new.
    fn plane(&mut self, annotation: &Annotation) -> Option<usize> {
        let named = annotation.plane.as_ref()?;
        let index = self.planes.iter().position(|plane| plane.id == *named)?;
        let drawn = &mut self.constraints.planes;
        Some(drawn.iter().position(|plane| plane.index == index).unwrap_or_else(|| {
            drawn.push(AnnotatedPlane { index, prior: self.planes[index].clone() });
            drawn.len() - 1
        }))
    }

    /// Adds one line for every segment; `direction` maps the index of a segment to its direction and deviation.
    fn add_lines(
        &mut self,
        annotation: usize,
        segments: &[Vec<Pixel>],
        direction: impl Fn(usize) -> (Direction, Option<usize>),
    ) {
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation, segment };
            let chart = Chart::centred_on(self.charts, points);
            let ends = equivalent_ends(points, self.lens, chart.as_ref());
            match ends.ok_or(InvalidSegment::OutsideLens).and_then(with_distinct_ends) {
                Ok(ends) => {
                    let (direction, deviation) = direction(segment);
                    self.constraints.lines.push(LineConstraint { chart, ends, direction, deviation, source });
                }
                Err(reason) => self.constraints.invalid.push((source, reason)),
            }
        }
    }

    /// Adds the lengths of an annotation as one group.
    fn add_lengths(&mut self, index: usize, annotation: &Annotation, segments: &[Vec<Pixel>]) {
        let group = self.constraints.length_groups.len();
        let known = annotation.length();
        let spread =
            if known.is_some() { 0.0 } else { self.constraints.scene.for_annotation(annotation).length };
        self.constraints.length_groups.push(known);
        let plane = self.plane(annotation);
        // Objects of usual size have any direction, unless the table states that they are along the road. A
        // single length is a measured distance.
        let is_along = annotation.usual_size().is_none_or(|usual| usual.is_along_road);
        let is_mark = is_along && segments.len() > 1 && plane.is_none();
        for (segment, points) in segments.iter().enumerate() {
            let source = Source { annotation: index, segment };
            let chart = Chart::centred_on(self.charts, points);
            let end = |pixel: Pixel| E::endpoint(pixel, self.lens, chart.as_ref());
            let ends = points.first().zip(points.last()).and_then(|(&a, &b)| Some([end(a)?, end(b)?]));
            match ends.ok_or(InvalidSegment::OutsideLens).and_then(with_distinct_ends) {
                Ok(ends) => {
                    self.constraints.lengths.push(LengthConstraint {
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

    /// Adds an upright with a known height.
    fn add_upright(&mut self, index: usize, annotation: &Annotation) {
        let source = Source { annotation: index, segment: 0 };
        let (Some(foot), Some(head), Some(height)) = (annotation.foot, annotation.head, annotation.height())
        else {
            return;
        };
        let plane = self.plane(annotation);
        let chart = Chart::centred_on(self.charts, &[foot, head]);
        let end = |pixel: Pixel| E::endpoint(pixel, self.lens, chart.as_ref());
        match (end(foot), end(head)) {
            (Some(foot), Some(head)) => {
                self.constraints.uprights.push(UprightConstraint {
                    chart,
                    foot,
                    head,
                    height,
                    plane,
                    source,
                });
            }
            _ => self.constraints.invalid.push((source, InvalidSegment::OutsideLens)),
        }
    }
}

/// Returns the floor direction of a parallel annotation: its own, or the tied annotation's, rotated by 90
/// degrees.
fn direction_of(
    annotations: &[Annotation],
    index: usize,
    directions: &mut [Option<(usize, bool)>],
    groups: &mut usize,
) -> (usize, bool) {
    // Follows the ties to the end of the chain. A checked site has no cycles; the loop also ends for an
    // unchecked one.
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
            .and_then(|id| annotations.iter().position(|a| a.can_be_tied() && a.id.as_ref() == Some(id)));
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

/// Number type of the coordinates of an end point.
trait LensNumber: Number {
    /// Returns the undistorted point or chart point of a raw pixel, with the covariance of unit noise.
    fn endpoint(pixel: Pixel, lens: &Lens, chart: Option<&Chart>) -> Option<Endpoint<Self>>;
}

impl LensNumber for f64 {
    fn endpoint(pixel: Pixel, lens: &Lens, chart: Option<&Chart>) -> Option<Endpoint> {
        let point = lens.pixel_to_chart(pixel, chart)?;
        Some(Endpoint { point: point.at, covariance: covariance_of_unit_noise(point.jacobian) })
    }
}

impl LensNumber for ByLens {
    fn endpoint(pixel: Pixel, lens: &Lens, chart: Option<&Chart>) -> Option<Endpoint<Self>> {
        let found = lens.pixel_to_chart(pixel, chart)?;
        let by = lens.pixel_to_chart_by_parameters(pixel, &found, chart);
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

/// Returns the covariance `J J'` of an undistorted point for unit noise of the raw pixel, as `[uu, uv, vv]`.
/// J is the Jacobian of the undistortion.
fn covariance_of_unit_noise<E: Number>([[a, b], [c, d]]: [[E; 2]; 2]) -> [E; 3] {
    [a * a + b * b, a * c + b * d, c * c + d * d]
}

/// Returns the ends if they are at least [`MIN_SEGMENT_LENGTH_PX`] apart.
fn with_distinct_ends<E: Number>(ends: [Endpoint<E>; 2]) -> Result<[Endpoint<E>; 2], InvalidSegment> {
    let [a, b] = ends.map(|end| end.point.map(Number::value));
    if (a[0] - b[0]).hypot(a[1] - b[1]) < MIN_SEGMENT_LENGTH_PX {
        Err(InvalidSegment::NoLength)
    } else {
        Ok(ends)
    }
}

/// Returns two points that are equivalent to a polyline: its centroid plus and minus the standard deviation
/// along the line.
///
/// Each point has half the weight of all points. The first and second moments along the line equal those of
/// the polyline.
fn equivalent_ends<E: LensNumber>(
    points: &[Pixel],
    lens: &Lens,
    chart: Option<&Chart>,
) -> Option<[Endpoint<E>; 2]> {
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
            ..Annotation::from_segments(Kind::Parallel, vec![segment])
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
        assert_eq!(is_orthogonal, [false, false, true], "c is tied to b and b to a, so c is parallel to a");
    }

    #[test]
    fn polyline_has_the_weight_of_all_its_points() {
        let lens = Lens::pinhole(Pixel::new(0.0, 0.0));
        let points: Vec<Pixel> = (0..9).map(|i| Pixel::new(f64::from(i) * 10.0, 3.0)).collect();
        let [a, b] = equivalent_ends::<f64>(&points, &lens, None).unwrap();
        assert!((a.point[1] - 3.0).abs() < 1e-12 && (b.point[0] - a.point[0]) > 40.0);
        assert!((a.covariance[0] - 2.0 / 9.0).abs() < 1e-12);
    }
}
