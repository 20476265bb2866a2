//! Stage 1 as in the paper (A. Abramov): roll from the verticals, then pitch and focal length by minimising
//! the criterion C.
//!
//! `C = V + sum over directions of mean |1 - |dot|| + mean |dot| + sum over groups of std / mean`
//!
//! The camera is at (0, 0, 3 m) with yaw 0. V is the mean sine of the angle between the viewing plane of a
//! vertical and the vertical. The first dot products are between floor directions that must be parallel, the
//! second between directions at right angles. The last term (option 2) compares lengths on the floor,
//! independently of their scale. The direction of a floor line is the intersection of its viewing plane with
//! the floor, which also exists above the horizon.

use crate::camera::Chart;
use crate::optimize::nelder_mead;
use crate::outcome::Failure;
use crate::single::constraints::{Constraints, Direction, LineConstraint};
use crate::single::parameters::FixedParameters;
use crate::single::parameters::Orientation;
use crate::single::vanishing_point::{roll_from_verticals, unrolled, vanishing_point};

/// Start values of the pitch, in degrees.
const START_PITCHES_DEG: [f64; 14] =
    [3.0, 8.0, 13.0, 18.0, 24.0, 30.0, 36.0, 42.0, 48.0, 54.0, 60.0, 67.0, 74.0, 82.0];
/// Start values of the horizontal field of view, in degrees.
const START_FIELDS_OF_VIEW_DEG: [f64; 12] =
    [24.0, 32.0, 40.0, 48.0, 56.0, 64.0, 72.0, 80.0, 90.0, 100.0, 110.0, 120.0];

/// Returns roll, pitch and focal length at the minimum of the paper's C, and the value of C.
///
/// `width` is the width of the image, in pixels.
///
/// # Errors
/// If there are fewer lines than the method needs, or if no pitch and focal length are possible.
pub fn minimum(
    constraints: &Constraints,
    fixed: FixedParameters,
    width: f64,
) -> Result<(Orientation, f64), Failure> {
    let roll = match fixed.roll {
        Some(roll) => roll,
        None => roll_from_constraints(constraints)?,
    };
    if let (Some(pitch), Some(focal)) = (fixed.pitch, fixed.focal) {
        let orientation = Orientation { roll, pitch, focal };
        return Ok((orientation, Criterion::new(constraints, roll).value(pitch, focal)));
    }
    let criterion = Criterion::new(constraints, roll);
    criterion.check(fixed)?;
    // Log focal and pitch in radians are of comparable magnitude.
    let cost = |[pitch, log_focal]: [f64; 2]| criterion.value(pitch, log_focal.exp());
    let size =
        [if fixed.pitch.is_some() { 0.0 } else { 0.05 }, if fixed.focal.is_some() { 0.0 } else { 0.1 }];
    let best = starts(&criterion, fixed, width)
        .into_iter()
        .filter_map(|start| nelder_mead(cost, start, size))
        .min_by(|a, b| a.1.total_cmp(&b.1));
    let ([pitch, log_focal], c) = best.ok_or(Failure::NoPitchAndFocal)?;
    Ok((Orientation { roll, pitch, focal: log_focal.exp() }, c))
}

/// Returns roll, pitch and focal length from two vanishing points, by `f^2 = -v . h`.
///
/// `v` is the vanishing point of the verticals, and `h` that of a group of parallel floor lines, both
/// relative to the principal point. If there are several groups, the group with the largest spread of image
/// directions is used. Returns `None` if the verticals have no vanishing point, or if no group gives a focal
/// length.
#[must_use]
pub fn closed_form(constraints: &Constraints) -> Option<Orientation> {
    let nadir =
        vanishing_point(constraints.lines.iter().filter(|line| line.direction == Direction::Vertical))?;
    let [x, y, w] = if nadir[1] < 0.0 { nadir.map(|c| -c) } else { nadir };
    let focal = (0..2 * constraints.groups)
        .filter_map(|class| {
            let direction = Direction::Floor { group: class / 2, orthogonal: class % 2 == 1 };
            let lines = || constraints.lines.iter().filter(move |line| line.direction == direction);
            let h = vanishing_point(lines())?;
            let square = -(x * h[0] + y * h[1]) / (w * h[2]);
            (square > 0.0 && square.is_finite()).then(|| (spread(lines()), square.sqrt()))
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))?
        .1;
    Some(Orientation { roll: roll_from_verticals([x, y, w]), pitch: (focal * w).atan2(x.hypot(y)), focal })
}

/// Returns the end of a segment as an undistorted pixel relative to the principal point, if a pinhole camera
/// can show it.
fn pinhole_point(chart: Option<&Chart>, point: [f64; 2]) -> Option<[f64; 2]> {
    chart.map_or(Some(point), |chart| chart.undistorted(point))
}

/// Returns the spread of the image directions of lines, times their mean length.
fn spread<'a>(lines: impl Iterator<Item = &'a LineConstraint>) -> f64 {
    let (mut cos, mut sin, mut total, mut count) = (0.0, 0.0, 0.0, 0.0);
    for line in lines {
        let [a, b] = line.ends.map(|end| end.point);
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let (length, angle) = (dx.hypot(dy), 2.0 * dy.atan2(dx));
        cos += length * angle.cos();
        sin += length * angle.sin();
        total += length;
        count += 1.0;
    }
    (total - cos.hypot(sin)) / count
}

/// Returns the roll, in radians, from the vanishing point of the verticals.
fn roll_from_constraints(constraints: &Constraints) -> Result<f64, Failure> {
    let verticals = constraints.lines.iter().filter(|line| line.direction == Direction::Vertical);
    let count = verticals.clone().count();
    let why = if count < 2 { Failure::TooFewVerticals { count } } else { Failure::CoincidentVerticals };
    vanishing_point(verticals).map(roll_from_verticals).ok_or(why)
}

/// Returns the lowest local minima of C on a grid, as (pitch, log focal length).
fn starts(criterion: &Criterion, fixed: FixedParameters, width: f64) -> Vec<[f64; 2]> {
    /// Maximum number of start values.
    const MAX_STARTS: usize = 3;
    let pitches: Vec<f64> = match fixed.pitch {
        Some(pitch) => vec![pitch],
        None => START_PITCHES_DEG.iter().map(|degrees| degrees.to_radians()).collect(),
    };
    let focals: Vec<f64> = match fixed.focal {
        Some(focal) => vec![focal],
        None => START_FIELDS_OF_VIEW_DEG
            .iter()
            .map(|degrees| 0.5 * width / (0.5 * degrees.to_radians()).tan())
            .collect(),
    };
    let cost: Vec<Vec<f64>> = pitches
        .iter()
        .map(|&pitch| focals.iter().map(|&focal| criterion.value(pitch, focal)).collect())
        .collect();
    let mut lowest = Vec::new();
    for i in 0..pitches.len() {
        for j in 0..focals.len() {
            let rows = i.saturating_sub(1)..(i + 2).min(pitches.len());
            let is_lowest = rows
                .flat_map(|a| cost[a][j.saturating_sub(1)..(j + 2).min(focals.len())].iter())
                .all(|&neighbour| cost[i][j] <= neighbour);
            if is_lowest && cost[i][j].is_finite() {
                lowest.push((cost[i][j], [pitches[i], focals[j].ln()]));
            }
        }
    }
    lowest.sort_by(|a, b| a.0.total_cmp(&b.0));
    lowest.into_iter().take(MAX_STARTS).map(|(_, start)| start).collect()
}

/// Criterion C of the paper for one camera. All lines are rotated to compensate the roll of the camera.
struct Criterion {
    /// Vertical lines in homogeneous coordinates, rotated to compensate the roll of the camera.
    verticals: Vec<[f64; 3]>,
    /// Floor lines in homogeneous coordinates, rotated to compensate the roll of the camera, with their floor
    /// directions.
    floor: Vec<FloorLine>,
    /// End points of lengths by group, rotated to compensate the roll.
    lengths: Vec<Vec<[[f64; 2]; 2]>>,
}

/// Floor line: its homogeneous line in axes without roll, and its floor direction.
struct FloorLine {
    line: [f64; 3],
    group: usize,
    orthogonal: bool,
}

impl Criterion {
    fn new(constraints: &Constraints, roll: f64) -> Self {
        let (sin, cos) = roll.sin_cos();
        let unroll = |[x, y]: [f64; 2]| [x * cos - y * sin, x * sin + y * cos];
        let line = |line: &LineConstraint| unrolled(line, [sin, cos]);
        let mut criterion = Self {
            verticals: Vec::new(),
            floor: Vec::new(),
            lengths: vec![Vec::new(); constraints.length_groups.len()],
        };
        for drawn in &constraints.lines {
            match drawn.direction {
                Direction::Vertical => criterion.verticals.push(line(drawn)),
                Direction::Floor { group, orthogonal } => {
                    criterion.floor.push(FloorLine { line: line(drawn), group, orthogonal });
                }
            }
        }
        for length in &constraints.lengths {
            // The criterion cannot use points at or behind the plane of the camera.
            if let [Some(a), Some(b)] = length.ends.map(|end| pinhole_point(length.chart.as_ref(), end.point))
            {
                criterion.lengths[length.group].push([unroll(a), unroll(b)]);
            }
        }
        criterion
    }

    /// Checks that the annotations determine pitch and focal length, unless these are fixed.
    fn check(&self, fixed: FixedParameters) -> Result<(), Failure> {
        let pairs = self.pairs().count();
        let lengths = self.lengths.iter().filter(|group| group.len() > 1).count();
        let by_verticals = !self.verticals.is_empty() && (fixed.focal.is_some() || fixed.pitch.is_some());
        if pairs + lengths > 0 || by_verticals { Ok(()) } else { Err(Failure::NoFloorAnnotations) }
    }

    /// Returns the pairs of floor lines of the same group, by index. The flag is `false` if the lines must be
    /// parallel, and `true` if they must be at right angles.
    fn pairs(&self) -> impl Iterator<Item = (usize, usize, bool)> + '_ {
        let count = self.floor.len();
        (0..count).flat_map(move |i| (i + 1..count).map(move |j| (i, j))).filter_map(|(i, j)| {
            let (a, b) = (&self.floor[i], &self.floor[j]);
            (a.group == b.group).then_some((i, j, a.orthogonal != b.orthogonal))
        })
    }

    /// Returns the criterion C at a pitch in radians and a focal length in pixels. It is infinite if the
    /// geometry is impossible.
    fn value(&self, pitch: f64, focal: f64) -> f64 {
        if pitch.abs() >= std::f64::consts::FRAC_PI_2 || focal.is_nan() || focal <= 1.0 || focal > 1e9 {
            return f64::INFINITY;
        }
        let (sin, cos) = pitch.sin_cos();
        self.verticality(sin, cos, focal)
            + self.directions(sin, cos, focal)
            + self.length_dispersion(sin, cos, focal)
    }

    /// Returns V: the mean sine of the angle between the viewing planes of the verticals and the vertical.
    ///
    /// The sine is `|n . z| / |n|`, with the normal `n = (f a, f b, c)` of the viewing plane of the line (a,
    /// b, c).
    fn verticality(&self, sin: f64, cos: f64, focal: f64) -> f64 {
        let sum: f64 = self
            .verticals
            .iter()
            .map(|&[a, b, c]| {
                let (a, b) = (focal * a, focal * b);
                (cos * b + sin * c).abs() / (a * a + b * b + c * c).sqrt()
            })
            .sum();
        if self.verticals.is_empty() { 0.0 } else { sum / self.verticals.len() as f64 }
    }

    /// Returns the mean `1 - |cos|` of the angles between parallels, summed over all directions, plus the mean
    /// `|cos|` between lines at right angles.
    fn directions(&self, sin: f64, cos: f64, focal: f64) -> f64 {
        let unit: Vec<[f64; 2]> = self
            .floor
            .iter()
            .map(|FloorLine { line: [a, b, c], .. }| {
                let (x, y) = (cos * c - sin * focal * b, -focal * a);
                let length = x.hypot(y).max(f64::MIN_POSITIVE);
                [x / length, y / length]
            })
            .collect();
        let mut parallel: Vec<(f64, f64)> = Vec::new();
        let mut square = (0.0, 0.0);
        for (i, j, right_angle) in self.pairs() {
            let dot = (unit[i][0] * unit[j][0] + unit[i][1] * unit[j][1]).abs();
            if right_angle {
                square = (square.0 + dot, square.1 + 1.0);
            } else {
                let class = 2 * self.floor[i].group + usize::from(self.floor[i].orthogonal);
                if parallel.len() <= class {
                    parallel.resize(class + 1, (0.0, 0.0));
                }
                parallel[class].0 += (1.0 - dot).abs();
                parallel[class].1 += 1.0;
            }
        }
        parallel
            .iter()
            .chain([&square])
            .filter(|(_, count)| *count > 0.0)
            .map(|(sum, count)| sum / count)
            .sum()
    }

    /// Returns the standard deviation divided by the mean of the lengths of every group, summed. The sum does
    /// not depend on the scale of the floor.
    fn length_dispersion(&self, sin: f64, cos: f64, focal: f64) -> f64 {
        let to_floor = |[u, v]: [f64; 2]| {
            let depth = cos * v + sin * focal;
            (depth > 1e-6 * focal).then(|| [u / depth, (cos * focal - sin * v) / depth])
        };
        let mut sum = 0.0;
        for group in self.lengths.iter().filter(|group| group.len() > 1) {
            let mut lengths = Vec::with_capacity(group.len());
            for [a, b] in group {
                let (Some(a), Some(b)) = (to_floor(*a), to_floor(*b)) else { return f64::INFINITY };
                lengths.push((a[0] - b[0]).hypot(a[1] - b[1]));
            }
            let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
            let variance =
                lengths.iter().map(|l| (l - mean) * (l - mean)).sum::<f64>() / lengths.len() as f64;
            sum += variance.sqrt() / mean;
        }
        sum
    }
}
