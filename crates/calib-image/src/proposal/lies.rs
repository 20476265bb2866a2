//! Where edges lie: on the floor, above it, or where edges alone do not tell.
//!
//! An edge that reaches above the horizon is higher than the camera. What crosses many level edges of other directions is
//! of a pattern, and the largest pattern of a place is its floor: joints, tiles, marks. A plumb edge that passes a level
//! edge, or hangs from it, has it on a wall or on what stands before one; one that ends there from above has its foot
//! there, and says nothing against the floor.

use super::join::Line;
use super::mixture::Mixture;

/// Where an edge of a level direction lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Lies {
    /// On the floor.
    Floor,
    /// On a wall, or on what stands on the floor.
    Above,
    /// Nothing tells: it speaks of its direction only.
    Open,
}

/// How far from an edge an end still touches it, in pixels.
const TOUCH: f64 = 3.0;
/// An edge belongs to a direction from this probability on.
const BELONGS: f64 = 0.7;
/// So many level edges of other directions that cross an edge make a pattern, in spite of so many plumb ones. Of rendered
/// edges that are said to lie on the floor nine of ten do.
const PATTERN: usize = 5;
const IN_SPITE_OF: usize = 1;
/// More of them than this, and a plumb edge is not believed to have the edge on a wall.
const PLAIN: usize = 1;

/// Of every line; [`Lies::Open`] of those that are of no level direction.
pub(super) fn lies(mixture: &Mixture, lines: &[Line]) -> Vec<Lies> {
    let memberships = mixture.memberships(lines);
    let directions: Vec<Option<usize>> = memberships
        .iter()
        .map(|membership| membership.iter().position(|&probability| probability > BELONGS))
        .collect();
    let of = |index: usize| match directions[index] {
        Some(own) if own > 0 => lies_of(index, own, mixture, lines, &directions),
        _ => Lies::Open,
    };
    (0..lines.len()).map(of).collect()
}

fn lies_of(
    index: usize,
    own: usize,
    mixture: &Mixture,
    lines: &[Line],
    directions: &[Option<usize>],
) -> Lies {
    let line = &lines[index];
    if line.ends.iter().any(|&end| below_horizon(mixture, end) < 0.0) {
        return Lies::Above;
    }
    let (mut crossed, mut feet, mut others) = (0, 0, 0);
    for (other, direction) in lines.iter().zip(directions) {
        match direction {
            Some(0) => match meeting(line, upright(mixture, other)) {
                Meeting::AtItsFoot => feet += 1,
                Meeting::AtItsTop | Meeting::Through => others += 1,
                Meeting::None => {}
            },
            Some(direction) if *direction != own => {
                crossed += usize::from(meeting(line, other.ends) != Meeting::None);
            }
            _ => {}
        }
    }
    match () {
        () if crossed >= PATTERN && others <= IN_SPITE_OF => Lies::Floor,
        () if crossed <= PLAIN && others > feet => Lies::Above,
        () => Lies::Open,
    }
}

/// How far below the horizon a point is, in pixels times the focal; above it less than nothing.
fn below_horizon(mixture: &Mixture, [x, y]: [f64; 2]) -> f64 {
    let [a, b, c] = super::frame::nadir(&mixture.camera);
    let focal = mixture.camera.focal;
    (a * x + b * y) / focal + c * focal
}

/// The ends of a plumb edge, the upper one first.
fn upright(mixture: &Mixture, line: &Line) -> [[f64; 2]; 2] {
    let [a, b] = line.ends;
    if below_horizon(mixture, a) < below_horizon(mixture, b) { [a, b] } else { [b, a] }
}

/// How another edge meets a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meeting {
    AtItsTop,
    AtItsFoot,
    Through,
    None,
}

fn meeting(line: &Line, [top, foot]: [[f64; 2]; 2]) -> Meeting {
    let [top, foot] = [top, foot].map(|end| beside(line, end));
    let is_along = |along: f64| (-TOUCH..line.length + TOUCH).contains(&along);
    let is_near = |(along, off): (f64, f64)| off.abs() < TOUCH && is_along(along);
    let share = top.1 / (top.1 - foot.1);
    match [is_near(top), is_near(foot)] {
        [true, false] => Meeting::AtItsTop,
        [false, true] => Meeting::AtItsFoot,
        [false, false] if (0.0..1.0).contains(&share) && is_along(top.0 + share * (foot.0 - top.0)) => {
            Meeting::Through
        }
        _ => Meeting::None,
    }
}

/// How far along a line from its first end, and how far beside it, a point is.
fn beside(line: &Line, p: [f64; 2]) -> (f64, f64) {
    let [a, b] = line.ends;
    let [x, y] = [0, 1].map(|k| (b[k] - a[k]) / line.length);
    let [s, t] = [p[0] - a[0], p[1] - a[1]];
    (x * s + y * t, x * t - y * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_is_met_at_the_top_at_the_foot_and_between() {
        let line = Line::new([[0.0, 0.0], [100.0, 0.0]], 0.5, vec![0]).unwrap();
        let met = |top: f64, foot: f64| meeting(&line, [[50.0, top], [52.0, foot]]);
        assert_eq!(met(-80.0, -1.0), Meeting::AtItsFoot);
        assert_eq!(met(1.0, 80.0), Meeting::AtItsTop);
        assert_eq!(met(-40.0, 40.0), Meeting::Through);
        assert_eq!(met(-40.0, -20.0), Meeting::None);
        assert_eq!(meeting(&line, [[150.0, -40.0], [150.0, 40.0]]), Meeting::None);
    }
}
