//! What is drawn again is one thing: its noise, the scene's own errors in it, and what is known of it count once.
//!
//! Of `n` copies each has `n` times the variance, in all that is its own: the noise of its ends, the spread of its
//! length, the height of its upright. What a group of copies has in common, as the deviation of a direction or the
//! prior of a length, has the variance over the share that the group is of all that draw the same: the shares of
//! groups that are alike add up to 1. A right angle is a relation of two sides, and is drawn again where both are, or
//! where one is that is at right angles to the same other one.
//!
//! The information of a sum of two variances is concave in the shares, so that no way of drawing a thing again says
//! more than drawing it once.

use crate::camera::Chart;
use crate::optimize::Number;
use crate::single::annotation::Known;
use crate::single::constraints::{Constraints, Direction};
use crate::single::endpoint::Endpoint;
use crate::single::overlaps::{Count, Overlaps};

/// Lets what is drawn again count once.
pub(crate) fn share_redrawn<E: Number>(drawn: &mut Constraints<E>) {
    share_lines(drawn);
    share_lengths(drawn);
    share_uprights(drawn);
}

fn share_lines<E: Number>(constraints: &mut Constraints<E>) {
    let drawn: Vec<_> =
        constraints.lines.iter().map(|line| polyline(line.chart.as_ref(), line.ends.each_ref())).collect();
    let group = |line: usize| match constraints.lines[line].direction {
        Direction::Floor { group, .. } => Some(group),
        Direction::Vertical => None,
    };
    let counts =
        Overlaps::new(&drawn).counts([&|_| Some(0), &group, &|line| constraints.lines[line].deviation]);
    // Of all that draw the same: in one group; and of the group's: with one deviation.
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
        let rest = directions.without(deviation.group, as_group.0[index]);
        let of_angle = in_group.of(index) * as_group.of(index).max(rest.unwrap_or(0.0));
        deviation.azimuth /= of_angle.sqrt();
        deviation.level /= as_level.of(index).sqrt();
    }
    constraints.repeats.note_directions(&directions.all());
    for (line, [Count { all: times, .. }, ..]) in constraints.lines.iter_mut().zip(&counts) {
        line.ends.iter_mut().for_each(|end| scale_variance(end, *times));
    }
    constraints
        .repeats
        .note(constraints.lines.iter().zip(&counts).map(|(line, [count, ..])| (line.source, count.all)));
}

fn share_lengths<E: Number>(constraints: &mut Constraints<E>) {
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
    constraints.repeats.note_lengths(&unknown.all());
    for (group, of) in constraints.length_groups.iter_mut().enumerate() {
        let sigma = of.as_mut().and_then(|of| of.sigma.as_mut());
        sigma.into_iter().for_each(|sigma| *sigma /= known.of(group).sqrt());
    }
    for (length, [Count { all: times, .. }, ..]) in constraints.lengths.iter_mut().zip(&counts) {
        length.ends.iter_mut().for_each(|end| scale_variance(end, *times));
        length.spread *= times.sqrt();
    }
    constraints.repeats.note(
        constraints.lengths.iter().zip(&counts).map(|(length, [count, ..])| (length.source, count.all)),
    );
}

fn share_uprights<E: Number>(constraints: &mut Constraints<E>) {
    let drawn: Vec<_> =
        constraints.uprights.iter().map(|of| polyline(of.chart.as_ref(), [&of.foot, &of.head])).collect();
    let times = Overlaps::new(&drawn).times();
    for (upright, times) in constraints.uprights.iter_mut().zip(&times) {
        [&mut upright.foot, &mut upright.head].into_iter().for_each(|end| scale_variance(end, *times));
        upright.height.sigma.iter_mut().for_each(|sigma| *sigma *= times.sqrt());
    }
    constraints.repeats.note(constraints.uprights.iter().map(|upright| upright.source).zip(times));
}

fn scale_variance<E: Number>(end: &mut Endpoint<E>, times: f64) {
    if times > 1.0 {
        end.covariance = end.covariance.map(|entry| entry * times);
    }
}

/// The ends in one image for all lines: undistorted, or of a wide lens equidistant.
fn polyline<E: Number>(chart: Option<&Chart>, ends: [&Endpoint<E>; 2]) -> Vec<[f64; 2]> {
    let points = ends.map(|end| end.point.map(Number::value));
    points.map(|point| chart.map_or(point, |chart| chart.flat(point))).to_vec()
}

/// For every group the sum of the shares of its members, and their number.
struct Shares(Vec<(f64, f64)>);

impl Shares {
    fn new(groups: usize, members: impl Iterator<Item = (Option<usize>, f64)>) -> Self {
        let mut sums = vec![(0.0, 0.0); groups];
        for (group, share) in members {
            if let Some(group) = group {
                sums[group] = (sums[group].0 + share, sums[group].1 + 1.0);
            }
        }
        Self(sums)
    }

    /// The mean share of the members of a group; 1 without any.
    fn of(&self, group: usize) -> f64 {
        mean(self.0[group]).unwrap_or(1.0)
    }

    /// The mean share of those members of a group that are not these.
    fn without(&self, group: usize, (sum, count): (f64, f64)) -> Option<f64> {
        let all = self.0[group];
        mean((all.0 - sum, all.1 - count))
    }

    fn all(&self) -> Vec<f64> {
        (0..self.0.len()).map(|group| self.of(group)).collect()
    }
}

fn mean((sum, count): (f64, f64)) -> Option<f64> {
    (count > 0.5).then(|| (sum / count).min(1.0))
}
