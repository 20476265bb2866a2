//! Classification of edges: on the floor, above it, or undetermined.
//!
//! An edge that extends above the horizon is higher than the camera. An edge that crosses many horizontal
//! edges of other directions belongs to a pattern. The largest pattern of a scene is its floor (joints,
//! tiles, markings). If a vertical edge crosses a horizontal edge, or has its top on it, the horizontal edge
//! is on a wall or on an object. If a vertical edge has its foot on a horizontal edge, this does not
//! contradict the floor.

use super::join::Line;
use super::mixture::Mixture;

/// Location of a horizontal edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EdgeClass {
    /// On the floor.
    Floor,
    /// On a wall, or on an object on the floor.
    Above,
    /// Undetermined; only the direction of the edge is known.
    #[serde(rename = "open")]
    Undetermined,
}

/// Largest distance between an edge and the end of another edge that touches it, in pixels.
const MAX_TOUCH_DISTANCE_PX: f64 = 3.0;
/// Smallest probability for assigning an edge to a direction.
const MIN_PROBABILITY: f64 = 0.7;
/// Smallest number of horizontal edges of other directions that cross an edge of a floor pattern. Of rendered
/// edges classified as floor, 90 % are on the floor.
const MIN_PATTERN_CROSSINGS: usize = 5;
/// Largest number of vertical edges that cross an edge of a floor pattern, or have their top on it.
const MAX_CONTRADICTIONS: usize = 1;
/// Largest number of horizontal edges of other directions that cross an edge on a wall.
const MAX_WALL_CROSSINGS: usize = 1;

/// Classifies every line; lines without a horizontal direction are [`EdgeClass::Undetermined`].
pub(super) fn classify_edges(mixture: &Mixture, lines: &[Line]) -> Vec<EdgeClass> {
    let memberships = mixture.memberships(lines);
    let directions: Vec<Option<usize>> = memberships
        .iter()
        .map(|membership| membership.iter().position(|&probability| probability > MIN_PROBABILITY))
        .collect();
    let of = |index: usize| match directions[index] {
        Some(own) if own > 0 => classify_edge(index, own, mixture, lines, &directions),
        _ => EdgeClass::Undetermined,
    };
    (0..lines.len()).map(of).collect()
}

/// Classifies the line with this index and the floor direction `own`. `directions` contains the direction of
/// every line, 0 for the vertical.
fn classify_edge(
    index: usize,
    own: usize,
    mixture: &Mixture,
    lines: &[Line],
    directions: &[Option<usize>],
) -> EdgeClass {
    let line = &lines[index];
    if line.ends.iter().any(|&end| below_horizon(mixture, end) < 0.0) {
        return EdgeClass::Above;
    }
    let (mut crossed, mut feet, mut others) = (0, 0, 0);
    for (other, direction) in lines.iter().zip(directions) {
        match direction {
            Some(0) => match find_contact(line, vertical_ends(mixture, other)) {
                Contact::Foot => feet += 1,
                Contact::Top | Contact::Crossing => others += 1,
                Contact::None => {}
            },
            Some(direction) if *direction != own => {
                crossed += usize::from(find_contact(line, other.ends) != Contact::None);
            }
            _ => {}
        }
    }
    match () {
        () if crossed >= MIN_PATTERN_CROSSINGS && others <= MAX_CONTRADICTIONS => EdgeClass::Floor,
        () if crossed <= MAX_WALL_CROSSINGS && others > feet => EdgeClass::Above,
        () => EdgeClass::Undetermined,
    }
}

/// Returns the signed distance of a point below the horizon, in pixels times the cosine of the pitch; negative
/// above the horizon.
fn below_horizon(mixture: &Mixture, [x, y]: [f64; 2]) -> f64 {
    let [a, b, c] = super::frame::nadir(&mixture.camera);
    let focal = mixture.camera.focal;
    (a * x + b * y) / focal + c * focal
}

/// Returns the ends of a vertical edge, the upper end first.
fn vertical_ends(mixture: &Mixture, line: &Line) -> [[f64; 2]; 2] {
    let [a, b] = line.ends;
    if below_horizon(mixture, a) < below_horizon(mixture, b) { [a, b] } else { [b, a] }
}

/// Contact of another edge with a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Contact {
    /// Top of the other edge on the line.
    Top,
    /// Foot of the other edge on the line.
    Foot,
    /// Crossing of the other edge and the line.
    Crossing,
    /// No contact, or both ends of the other edge on the line.
    None,
}

/// Returns the contact of the edge between `top` and `foot` with a line.
fn find_contact(line: &Line, [top, foot]: [[f64; 2]; 2]) -> Contact {
    let [top, foot] = [top, foot].map(|end| line_coordinates(line, end));
    let is_along =
        |along: f64| (-MAX_TOUCH_DISTANCE_PX..line.length + MAX_TOUCH_DISTANCE_PX).contains(&along);
    let is_near = |(along, off): (f64, f64)| off.abs() < MAX_TOUCH_DISTANCE_PX && is_along(along);
    let share = top.1 / (top.1 - foot.1);
    match [is_near(top), is_near(foot)] {
        [true, false] => Contact::Top,
        [false, true] => Contact::Foot,
        [false, false] if (0.0..1.0).contains(&share) && is_along(top.0 + share * (foot.0 - top.0)) => {
            Contact::Crossing
        }
        _ => Contact::None,
    }
}

/// Returns the coordinates of a point along a line from its first end, and across the line, in pixels.
fn line_coordinates(line: &Line, p: [f64; 2]) -> (f64, f64) {
    let [a, b] = line.ends;
    let [x, y] = [0, 1].map(|k| (b[k] - a[k]) / line.length);
    let [s, t] = [p[0] - a[0], p[1] - a[1]];
    (x * s + y * t, x * t - y * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_meet_at_the_top_at_the_foot_and_between() {
        let line = Line::new([[0.0, 0.0], [100.0, 0.0]], 0.5, vec![0]).unwrap();
        let met = |top: f64, foot: f64| find_contact(&line, [[50.0, top], [52.0, foot]]);
        assert_eq!(met(-80.0, -1.0), Contact::Foot);
        assert_eq!(met(1.0, 80.0), Contact::Top);
        assert_eq!(met(-40.0, 40.0), Contact::Crossing);
        assert_eq!(met(-40.0, -20.0), Contact::None);
        assert_eq!(find_contact(&line, [[150.0, -40.0], [150.0, 40.0]]), Contact::None);
    }
}
