//! Rotations as other programs write them: a Rodrigues vector, or a quaternion.

/// Rows.
pub(crate) type Rotation = [[f64; 3]; 3];

/// `(w, x, y, z)` of a rotation matrix, with w not below 0: Shepperd's method, which divides by no
/// small number.
pub(crate) fn quaternion(r: &Rotation) -> [f64; 4] {
    let trace = r[0][0] + r[1][1] + r[2][2];
    let squares = [trace, r[0][0], r[1][1], r[2][2]];
    let largest = (0..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
    let q = match largest {
        0 => [1.0 + trace, r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]],
        1 => [r[2][1] - r[1][2], 1.0 + 2.0 * r[0][0] - trace, r[0][1] + r[1][0], r[0][2] + r[2][0]],
        2 => [r[0][2] - r[2][0], r[0][1] + r[1][0], 1.0 + 2.0 * r[1][1] - trace, r[1][2] + r[2][1]],
        _ => [r[1][0] - r[0][1], r[0][2] + r[2][0], r[1][2] + r[2][1], 1.0 + 2.0 * r[2][2] - trace],
    };
    let length = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    let sign = if q[0] < 0.0 { -length } else { length };
    q.map(|c| c / sign)
}

/// The matrix of a quaternion `(w, x, y, z)` of any length; `None` for that of length 0.
pub(crate) fn from_quaternion(q: [f64; 4]) -> Option<Rotation> {
    let length = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    if !(length.is_finite() && length > 1e-9) {
        return None;
    }
    let [w, x, y, z] = q.map(|c| c / length);
    Some([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ])
}

/// The axis times the angle, in radians.
pub(crate) fn rodrigues(r: &Rotation) -> [f64; 3] {
    let [w, x, y, z] = quaternion(r);
    let sine = (x * x + y * y + z * z).sqrt();
    let factor = if sine < 1e-12 { 2.0 } else { 2.0 * sine.atan2(w) / sine };
    [factor * x, factor * y, factor * z]
}

/// The matrix of the axis times the angle, in radians.
pub(crate) fn from_rodrigues([x, y, z]: [f64; 3]) -> Option<Rotation> {
    let angle = (x * x + y * y + z * z).sqrt();
    let factor = if angle < 1e-12 { 0.5 } else { (0.5 * angle).sin() / angle };
    from_quaternion([(0.5 * angle).cos(), factor * x, factor * y, factor * z])
}

pub(crate) fn transposed(r: &Rotation) -> Rotation {
    std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]))
}

pub(crate) fn turned(r: &Rotation, v: [f64; 3]) -> [f64; 3] {
    r.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Whether the rows are at right angles and of length 1, to a ten-thousandth, and right-handed.
pub(crate) fn is_rotation(r: &Rotation) -> bool {
    let dot = |i: usize, j: usize| -> f64 { (0..3).map(|k| r[i][k] * r[j][k]).sum() };
    let is_unit = (0..3).all(|i| (0..3).all(|j| (dot(i, j) - f64::from(u8::from(i == j))).abs() < 1e-4));
    let [a, b, c] = r;
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    is_unit && cross[0] * c[0] + cross[1] * c[1] + cross[2] * c[2] > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_way_to_write_a_rotation_gives_it_back(v in [-3.2..3.2_f64, -3.2..3.2_f64, -3.2..3.2_f64]) {
            let r = from_rodrigues(v).unwrap();
            prop_assert!(is_rotation(&r));
            for again in [from_rodrigues(rodrigues(&r)).unwrap(), from_quaternion(quaternion(&r)).unwrap()] {
                for (a, b) in again.iter().flatten().zip(r.iter().flatten()) {
                    prop_assert!((a - b).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn half_turns_have_an_axis() {
        for r in [
            [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
            [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
            [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
        ] {
            let again = from_rodrigues(rodrigues(&r)).unwrap();
            assert!(again.iter().flatten().zip(r.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }
}
