//! The Kannala-Brandt lens that comes nearest to one that a program describes otherwise.

use calib_core::Distortion;

/// Largest angle from the axis at which lenses are compared, in radians: 110 degrees.
pub(crate) const WIDEST: f64 = 110.0 * std::f64::consts::PI / 180.0;

/// Pixels by which a lens may be off after it was taken in other terms.
pub(crate) const MOST_OFF: f64 = 1.0;

/// A lens in the terms of Kannala and Brandt.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    /// In pixels.
    pub(crate) focal: f64,
    pub(crate) distortion: Distortion,
    /// How far it is off at most, in pixels; infinite where it shows nothing.
    pub(crate) off: f64,
}

/// What is found where no lens is near enough: `what` is of other terms.
pub(crate) fn too_far(what: &str, off: f64) -> String {
    match off.is_finite() {
        true => format!("{what} that no Kannala-Brandt lens comes nearer to than {off:.2} px"),
        false => format!("{what} that no Kannala-Brandt lens is near"),
    }
}

/// The least squares of `f theta (1 + k1 theta^2 + ... + k4 theta^8) - radius` over pairs of theta (radians) and radius
/// (pixels), linear in f and f k. `None` where they determine no lens.
pub(crate) fn nearest(samples: &[[f64; 2]]) -> Option<Nearest> {
    let widest = samples.iter().map(|[theta, _]| *theta).fold(0.0, f64::max);
    let row = |theta: f64| [1, 3, 5, 7, 9].map(|power| (theta / widest).powi(power));
    let value = |terms: &[f64; 5], theta: f64| row(theta).iter().zip(terms).map(|(a, b)| a * b).sum::<f64>();
    let mut terms = [0.0; 5];
    // Once more with what is left: the normal equations have half of the digits.
    for _ in 0..3 {
        let (mut square, mut right) = ([[0.0; 5]; 5], [0.0; 5]);
        for &[theta, radius] in samples {
            let (row, left) = (row(theta), radius - value(&terms, theta));
            for i in 0..5 {
                right[i] += row[i] * left;
                (0..5).for_each(|j| square[i][j] += row[i] * row[j]);
            }
        }
        let more = solved(square, right)?;
        terms.iter_mut().zip(more).for_each(|(term, more)| *term += more);
    }
    let focal = terms[0] / widest;
    if !(focal > 0.0 && terms.iter().all(|term| term.is_finite())) {
        return None;
    }
    let k = [1, 2, 3, 4].map(|i| terms[i] / terms[0] / widest.powi(2 * i as i32));
    let distortion = Distortion::KannalaBrandt { k };
    let off = |&[theta, radius]: &[f64; 2]| {
        let shown = distortion.shown([theta.sin(), 0.0, theta.cos()]);
        shown.map_or(f64::INFINITY, |[at, _]| (focal * at - radius).abs())
    };
    Some(Nearest { focal, distortion, off: samples.iter().map(off).fold(0.0, f64::max) })
}

/// Gaussian elimination with pivots.
fn solved(mut square: [[f64; 5]; 5], mut right: [f64; 5]) -> Option<[f64; 5]> {
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
    use super::*;

    #[test]
    fn a_lens_of_these_terms_is_found_again() {
        let k = [0.03, -0.012, 0.004, -0.0006];
        let lens = Distortion::KannalaBrandt { k };
        let sample = |i: u32| {
            let theta = WIDEST * f64::from(i) / 300.0;
            lens.shown([theta.sin(), 0.0, theta.cos()]).map(|[at, _]| [theta, 400.0 * at])
        };
        let samples: Option<Vec<[f64; 2]>> = (0..=300).map(sample).collect();
        let found = samples.and_then(|samples| nearest(&samples)).map(|found| (found.focal, found.off));
        assert!(found.is_some_and(|(focal, off)| (focal - 400.0).abs() < 1e-9 && off < 1e-9), "{found:?}");
    }

    #[test]
    fn nothing_makes_no_lens() {
        assert!(nearest(&[]).is_none() && nearest(&[[1.0, 2.0]; 9]).is_none_or(|found| found.off > 1e-6));
        assert!(nearest(&[[f64::NAN, 1.0], [1.0, f64::INFINITY]]).is_none());
    }
}
