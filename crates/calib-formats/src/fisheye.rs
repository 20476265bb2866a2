//! Fit of the nearest Kannala-Brandt lens to a lens of another model.
//!
//! Also conversions of rotations to and from the forms of other programs: Rodrigues vectors and quaternions.

use calib_core::Distortion;

/// Rotation matrix, as three rows.
pub(crate) type Rotation = [[f64; 3]; 3];

/// Returns the quaternion `(w, x, y, z)` of a rotation matrix, with w not below 0. Uses Shepperd's method,
/// which never divides by a small number.
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

/// Returns the matrix of a quaternion `(w, x, y, z)` of any length; `None` if the length is 0 or not finite.
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

/// Returns the Rodrigues vector of a rotation matrix: the rotation axis times the angle, in radians.
pub(crate) fn rodrigues(r: &Rotation) -> [f64; 3] {
    let [w, x, y, z] = quaternion(r);
    let sine = (x * x + y * y + z * z).sqrt();
    let factor = if sine < 1e-12 { 2.0 } else { 2.0 * sine.atan2(w) / sine };
    [factor * x, factor * y, factor * z]
}

/// Returns the matrix of a Rodrigues vector, the axis times the angle in radians; `None` if it is not finite.
pub(crate) fn from_rodrigues([x, y, z]: [f64; 3]) -> Option<Rotation> {
    let angle = (x * x + y * y + z * z).sqrt();
    let factor = if angle < 1e-12 { 0.5 } else { (0.5 * angle).sin() / angle };
    from_quaternion([(0.5 * angle).cos(), factor * x, factor * y, factor * z])
}

/// Returns the transposed matrix, which is the inverse of a rotation.
pub(crate) fn transpose(r: &Rotation) -> Rotation {
    std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]))
}

/// Returns the product of a matrix and a vector.
pub(crate) fn rotate(r: &Rotation, v: [f64; 3]) -> [f64; 3] {
    r.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Whether a matrix is a rotation: its rows are orthogonal unit vectors in right-handed order, within 1e-4.
pub(crate) fn is_rotation(r: &Rotation) -> bool {
    let dot = |i: usize, j: usize| -> f64 { (0..3).map(|k| r[i][k] * r[j][k]).sum() };
    let is_unit = (0..3).all(|i| (0..3).all(|j| (dot(i, j) - f64::from(u8::from(i == j))).abs() < 1e-4));
    let [a, b, c] = r;
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    is_unit && cross[0] * c[0] + cross[1] * c[1] + cross[2] * c[2] > 0.0
}

/// Largest angle from the optical axis at which lenses are compared, in radians (110 degrees).
pub(crate) const MAX_ANGLE: f64 = 110.0 * std::f64::consts::PI / 180.0;

/// Largest accepted error, in pixels, of a lens that was fitted to another lens model.
pub(crate) const MAX_FIT_ERROR_PX: f64 = 1.0;

/// Fitted Kannala-Brandt lens.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FittedLens {
    /// Focal length, in pixels.
    pub(crate) focal: f64,
    pub(crate) distortion: Distortion,
    /// Largest error of the radius over the samples, in pixels; infinite if the lens cannot show one of the
    /// samples.
    pub(crate) max_error_px: f64,
}

/// Returns the error text for a lens without an accepted fit. `what` names the original model or its terms;
/// `off` is the error of the fit, in pixels.
pub(crate) fn fit_error_text(what: &str, off: f64) -> String {
    match off.is_finite() {
        true => format!("{what}; the nearest Kannala-Brandt lens has an error of {off:.2} px"),
        false => format!("{what}; no Kannala-Brandt lens is close enough"),
    }
}

/// Fits f and k1 to k4 by least squares of `f theta (1 + k1 theta^2 + ... + k4 theta^8) - radius`, over pairs
/// of theta (angle from the axis, radians) and radius (pixels). f is the focal length in pixels. The problem
/// is linear in f and in the products f k1 to f k4. Returns `None` if the samples do not determine a lens.
pub(crate) fn fit_lens(samples: &[[f64; 2]]) -> Option<FittedLens> {
    let widest = samples.iter().map(|[theta, _]| *theta).fold(0.0, f64::max);
    let row = |theta: f64| [1, 3, 5, 7, 9].map(|power| (theta / widest).powi(power));
    let value = |terms: &[f64; 5], theta: f64| row(theta).iter().zip(terms).map(|(a, b)| a * b).sum::<f64>();
    let mut terms = [0.0; 5];
    // Iterative refinement on the residuals: the normal equations keep only half of the digits.
    for _ in 0..3 {
        let (mut square, mut right) = ([[0.0; 5]; 5], [0.0; 5]);
        for &[theta, radius] in samples {
            let (row, left) = (row(theta), radius - value(&terms, theta));
            for i in 0..5 {
                right[i] += row[i] * left;
                (0..5).for_each(|j| square[i][j] += row[i] * row[j]);
            }
        }
        let more = solve_5x5(square, right)?;
        terms.iter_mut().zip(more).for_each(|(term, more)| *term += more);
    }
    let focal = terms[0] / widest;
    if !(focal > 0.0 && terms.iter().all(|term| term.is_finite())) {
        return None;
    }
    let k = [1, 2, 3, 4].map(|i| terms[i] / terms[0] / widest.powi(2 * i as i32));
    let distortion = Distortion::KannalaBrandt { k };
    let off = |&[theta, radius]: &[f64; 2]| {
        let shown = distortion.ray_to_distorted([theta.sin(), 0.0, theta.cos()]);
        shown.map_or(f64::INFINITY, |[at, _]| (focal * at - radius).abs())
    };
    Some(FittedLens { focal, distortion, max_error_px: samples.iter().map(off).fold(0.0, f64::max) })
}

/// Solves five linear equations by Gaussian elimination with pivoting; `None` if they are singular.
fn solve_5x5(mut square: [[f64; 5]; 5], mut right: [f64; 5]) -> Option<[f64; 5]> {
    for column in 0..5 {
        let largest = |a: &usize, b: &usize| square[*a][column].abs().total_cmp(&square[*b][column].abs());
        let pivot = (column..5).max_by(largest)?;
        square.swap(column, pivot);
        right.swap(column, pivot);
        if square[column][column].abs() < 1e-300 || !square[column][column].is_finite() {
            return None;
        }
        for row in column + 1..5 {
            let share = square[row][column] / square[column][column];
            let above = square[column];
            square[row].iter_mut().zip(above).for_each(|(value, above)| *value -= share * above);
            right[row] -= share * right[column];
        }
    }
    for row in (0..5).rev() {
        let known: f64 = (row + 1..5).map(|j| square[row][j] * right[j]).sum();
        right[row] = (right[row] - known) / square[row][row];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_form_of_a_rotation_converts_back(v in [-3.2..3.2_f64, -3.2..3.2_f64, -3.2..3.2_f64]) {
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
    fn rotations_by_180_degrees_have_an_axis() {
        for r in [
            [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
            [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
            [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
        ] {
            let again = from_rodrigues(rodrigues(&r)).unwrap();
            assert!(again.iter().flatten().zip(r.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    #[test]
    fn a_kannala_brandt_lens_is_fitted_exactly() {
        let k = [0.03, -0.012, 0.004, -0.0006];
        let lens = Distortion::KannalaBrandt { k };
        let sample = |i: u32| {
            let theta = MAX_ANGLE * f64::from(i) / 300.0;
            lens.ray_to_distorted([theta.sin(), 0.0, theta.cos()]).map(|[at, _]| [theta, 400.0 * at])
        };
        let samples: Option<Vec<[f64; 2]>> = (0..=300).map(sample).collect();
        let found =
            samples.and_then(|samples| fit_lens(&samples)).map(|found| (found.focal, found.max_error_px));
        assert!(found.is_some_and(|(focal, off)| (focal - 400.0).abs() < 1e-9 && off < 1e-9), "{found:?}");
    }

    #[test]
    fn unusable_samples_give_no_lens() {
        assert!(
            fit_lens(&[]).is_none()
                && fit_lens(&[[1.0, 2.0]; 9]).is_none_or(|found| found.max_error_px > 1e-6)
        );
        assert!(fit_lens(&[[f64::NAN, 1.0], [1.0, f64::INFINITY]]).is_none());
    }
}
