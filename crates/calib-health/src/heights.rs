//! What heights of people tell of one camera in one window of time: normal equations, which add up.
//!
//! Features of a row are those whose coefficients can change: the season (1), tilt, roll and zoom (by how a movement
//! changes the height, the other way round: the calibration is what stayed), and the pixels that a detector draws
//! around people (the inverse of how tall people are in the image there).

use nalgebra::{DMatrix, DVector};

use crate::normal_equations::NormalEquations;
use crate::stature::Cell;

/// Number of features.
pub(crate) const FEATURES: usize = 5;
/// Upper triangle of their products, row by row.
pub(crate) const PACKED: usize = FEATURES * (FEATURES + 1) / 2;
/// Index of the season.
pub(crate) const SEASON: usize = 0;
/// Index of the first of [`SEEN`](crate::stature::SEEN).
pub(crate) const MOVED: usize = 1;
/// Height in the image that has one unit of the last feature, in pixels.
const PADDED: f64 = 60.0;

/// Index in an upper triangle, for `i <= j`.
pub(crate) const fn packed(i: usize, j: usize) -> usize {
    i * FEATURES - i * (i + 1) / 2 + j
}

/// The features of a row, by where the foot is.
pub(crate) fn features(Cell { slopes: [tilt, roll, zoom], tall }: Cell) -> [f64; FEATURES] {
    [1.0, -tilt, -roll, -zoom, PADDED / tall]
}

/// Normal equations of the features.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Heights {
    /// Upper triangle, row by row.
    pub(crate) information: [f64; PACKED],
    pub(crate) score: [f64; FEATURES],
    /// Squares of the scores of tracks about the middle of all people: their true variance, whatever they claim (White
    /// 1982).
    pub(crate) squares: [f64; PACKED],
    pub(crate) tracks: u64,
}

impl Heights {
    pub(crate) fn add(&mut self, other: &Self) {
        self.information.iter_mut().zip(&other.information).for_each(|(a, b)| *a += b);
        self.score.iter_mut().zip(&other.score).for_each(|(a, b)| *a += b);
        self.squares.iter_mut().zip(&other.squares).for_each(|(a, b)| *a += b);
        self.tracks += other.tracks;
    }

    /// One track, whose people stand about a middle height.
    pub(crate) fn of_track(information: [f64; PACKED], score: [f64; FEATURES], middle: f64) -> Self {
        // The first feature is 1: its column is what the middle adds to the score.
        let about: [f64; FEATURES] = std::array::from_fn(|i| score[i] - middle * information[packed(0, i)]);
        let mut squares = [0.0; PACKED];
        for i in 0..FEATURES {
            (i..FEATURES).for_each(|j| squares[packed(i, j)] = about[i] * about[j]);
        }
        Self { information, score, squares, tracks: 1 }
    }

    pub(crate) fn equations(&self) -> NormalEquations {
        NormalEquations { information: full(&self.information), score: DVector::from_row_slice(&self.score) }
    }

    /// The true variance of the score.
    pub(crate) fn variance(&self) -> DMatrix<f64> {
        full(&self.squares)
    }
}

fn full(upper: &[f64; PACKED]) -> DMatrix<f64> {
    DMatrix::from_fn(FEATURES, FEATURES, |i, j| upper[packed(i.min(j), i.max(j))])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_upper_triangle_is_packed_row_by_row() {
        let mut next = 0;
        for i in 0..FEATURES {
            for j in i..FEATURES {
                assert_eq!(packed(i, j), next);
                next += 1;
            }
        }
        assert_eq!(next, PACKED);
    }
}
