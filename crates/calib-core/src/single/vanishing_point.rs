//! Vanishing point of several image lines, and roll from the vanishing point of the verticals (the paper's
//! stage 1, step 1).

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::optimize::Number;
use crate::single::constraints::LineConstraint;

/// Returns the homogeneous line through two points: their cross product.
pub(crate) fn line_through<E: Number>([x1, y1]: [E; 2], [x2, y2]: [E; 2]) -> [E; 3] {
    [y1 - y2, x2 - x1, x1 * y2 - y1 * x2]
}

/// Returns the homogeneous line of bearings through the ends of a segment.
fn bearing_line(line: &LineConstraint) -> [f64; 3] {
    let through = line_through(line.ends[0].point, line.ends[1].point);
    line.chart.map_or(through, |chart| chart.line_to_bearings(through))
}

/// Returns the homogeneous line through the ends of a segment, rotated to compensate the roll of the camera. The
/// array contains the sine and cosine of the roll.
pub(crate) fn unrolled(line: &LineConstraint, [sin, cos]: [f64; 2]) -> [f64; 3] {
    if line.chart.is_some() {
        let [a, b, c] = bearing_line(line);
        return [a * cos - b * sin, a * sin + b * cos, c];
    }
    let [a, b] = line.ends.map(|end| end.point).map(|[x, y]| [x * cos - y * sin, x * sin + y * cos]);
    line_through(a, b)
}

/// Returns the homogeneous point with the smallest sum of squared distances from all lines.
///
/// The result is the eigenvector with the smallest eigenvalue of the scatter matrix of the lines. The lines
/// have unit normals, in coordinates scaled to magnitude 1. The point may be at infinity (third coordinate
/// 0). `None` for fewer than two lines, or for lines that coincide.
pub(crate) fn vanishing_point<'a>(lines: impl Iterator<Item = &'a LineConstraint>) -> Option<[f64; 3]> {
    let lines: Vec<&LineConstraint> = lines.collect();
    if lines.len() < 2 {
        return None;
    }
    // Coordinates of magnitude 1 keep the eigenvalues comparable.
    let size = lines
        .iter()
        .flat_map(|line| line.ends)
        .fold(0.0_f64, |most, end| most.max(end.point[0].abs()).max(end.point[1].abs()));
    let scatter = lines.iter().fold(Matrix3::zeros(), |sum, drawn| {
        let [a, b, c] = bearing_line(drawn);
        let line = Vector3::new(a * size, b * size, c);
        // A line beside the camera has no normal in a pinhole image, so the norm of the plane through the
        // bearings is used.
        let of_normal = if drawn.chart.is_some() { line.norm_squared() } else { line.xy().norm_squared() };
        sum + line * line.transpose() / of_normal.max(f64::MIN_POSITIVE)
    });
    let eigen = SymmetricEigen::try_new(scatter, f64::EPSILON, 200)?;
    let (least, _) = eigen.eigenvalues.argmin();
    let mut sorted: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
    sorted.sort_by(f64::total_cmp);
    // If all lines coincide, every point of the line is a minimum.
    if sorted[1] <= 1e-24 * sorted[2] {
        return None;
    }
    let point = eigen.eigenvectors.column(least);
    Some([point[0] * size, point[1] * size, point[2]])
}

/// Returns the roll of the camera, in radians, from the vanishing point of the verticals.
///
/// The roll is `atan2(vx, vy)`, from the direction toward the nadir. A vanishing point above the principal point is
/// the zenith, so its direction is reversed. The result is between -pi/2 and pi/2.
pub(crate) fn roll_from_verticals([x, y, _]: [f64; 3]) -> f64 {
    if y < 0.0 { (-x).atan2(-y) } else { x.atan2(y) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::single::constraints::{Direction, Endpoint, Source};

    fn line(a: [f64; 2], b: [f64; 2]) -> LineConstraint {
        let end = |point| Endpoint { point, covariance: [1.0, 0.0, 1.0] };
        LineConstraint {
            chart: None,
            ends: [end(a), end(b)],
            direction: Direction::Vertical,
            deviation: None,
            source: Source { annotation: 0, segment: 0 },
        }
    }

    #[test]
    fn lines_intersect_at_their_common_point() {
        let at = [120.0, 900.0];
        let direction = |x: f64, y: f64| line([x, y], [x + 0.3 * (at[0] - x), y + 0.3 * (at[1] - y)]);
        let lines = [direction(-500.0, -20.0), direction(40.0, 10.0), direction(700.0, 300.0)];
        let [x, y, w] = vanishing_point(lines.iter()).unwrap();
        assert!((x / w - at[0]).hypot(y / w - at[1]) < 1e-8, "{} {}", x / w, y / w);
    }

    #[test]
    fn parallel_lines_intersect_at_infinity_and_determine_the_roll() {
        let lines = [line([0.0, 0.0], [10.0, 100.0]), line([50.0, 0.0], [60.0, 100.0])];
        let [x, y, w] = vanishing_point(lines.iter()).unwrap();
        assert!(w.abs() < 1e-12 && (roll_from_verticals([x, y, w]) - 0.1_f64.atan()).abs() < 1e-12);
    }

    #[test]
    fn repeated_line_has_no_vanishing_point() {
        let twice = line([0.0, 0.0], [10.0, 100.0]);
        assert_eq!(vanishing_point([twice, twice].iter()), None);
    }
}
