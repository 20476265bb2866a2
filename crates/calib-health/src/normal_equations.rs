//! Normal equations `H x = g` of unknowns of which evidence adds up, and what a change of them would be.

use nalgebra::{DMatrix, DVector};

/// Information `H` and score `g` of a few unknowns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NormalEquations {
    pub(crate) information: DMatrix<f64>,
    pub(crate) score: DVector<f64>,
}

impl NormalEquations {
    pub(crate) fn nothing(unknowns: usize) -> Self {
        Self { information: DMatrix::zeros(unknowns, unknowns), score: DVector::zeros(unknowns) }
    }

    pub(crate) fn len(&self) -> usize {
        self.score.len()
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.information += &other.information;
        self.score += &other.score;
    }

    pub(crate) fn without(&self, other: &Self) -> Self {
        Self { information: &self.information - &other.information, score: &self.score - &other.score }
    }

    /// Evidence whose score has another variance than its information claims: with `H = C C'` the variance is
    /// `C D C'`, with `D^-1` given, and what the evidence is worth is `C D^-1 C'`.
    pub(crate) fn calibrated(&self, inverse_dispersion: &DMatrix<f64>) -> Self {
        let Some(root) = self.root() else { return Self::nothing(self.len()) };
        let whitened = root.solve_lower_triangular(&self.score);
        let Some(whitened) = whitened else { return Self::nothing(self.len()) };
        let worth = &root * inverse_dispersion;
        Self { information: &worth * root.transpose(), score: worth * whitened }
    }

    /// `C` with `H = C C'`, lower triangular; a trace of what nothing is known of makes it exist.
    pub(crate) fn root(&self) -> Option<DMatrix<f64>> {
        /// Of the largest information.
        const TRACE: f64 = 1e-9;
        let largest = self.information.diagonal().max();
        if largest.is_nan() || largest <= 0.0 {
            return None;
        }
        let held = DMatrix::identity(self.len(), self.len()) * (TRACE * largest);
        Some((&self.information + held).cholesky()?.l())
    }

    /// What two spells of time tell of the change between them, of unknowns that are held by `held` (precisions) in
    /// both: those are eliminated,
    ///
    /// ```text
    /// H = H2 - H2 (H1 + H2 + held)^-1 H2,   g = g2 - H2 (H1 + H2 + held)^-1 (g1 + g2)
    /// ```
    pub(crate) fn change(before: &Self, after: &Self, held: &DVector<f64>) -> Self {
        let both = &before.information + &after.information + DMatrix::from_diagonal(held);
        let Some(both) = both.cholesky() else { return Self::nothing(before.len()) };
        let information = &after.information - &after.information * both.solve(&after.information);
        let score = &after.score - &after.information * both.solve(&(&before.score + &after.score));
        Self { information: 0.5 * (&information + information.transpose()), score }
    }

    /// The same of some of the unknowns, the others being zero.
    pub(crate) fn of(&self, some: &[usize]) -> Self {
        let information =
            DMatrix::from_fn(some.len(), some.len(), |i, j| self.information[(some[i], some[j])]);
        Self { information, score: DVector::from_fn(some.len(), |i, _| self.score[some[i]]) }
    }

    /// The same among more unknowns: those here are at these places.
    pub(crate) fn placed(&self, at: &[usize], unknowns: usize) -> Self {
        let mut all = Self::nothing(unknowns);
        for (i, &row) in at.iter().enumerate() {
            all.score[row] = self.score[i];
            at.iter().enumerate().for_each(|(j, &column)| {
                all.information[(row, column)] = self.information[(i, j)];
            });
        }
        all
    }

    /// Without the first unknown, of which `mean` is believed with this precision.
    pub(crate) fn without_first(&self, mean: f64, precision: f64) -> Self {
        let pivot = (self.information[(0, 0)] + precision).max(f64::MIN_POSITIVE);
        let score = self.score[0] + precision * mean;
        let rest = self.len() - 1;
        let by = |i: usize| self.information[(i + 1, 0)] / pivot;
        Self {
            information: DMatrix::from_fn(rest, rest, |i, j| {
                self.information[(i + 1, j + 1)] - by(i) * self.information[(0, j + 1)]
            }),
            score: DVector::from_fn(rest, |i, _| self.score[i + 1] - by(i) * score),
        }
    }

    /// Estimate and covariance, with these precisions about zero beside.
    pub(crate) fn solved(&self, held: &DVector<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let inverse = (&self.information + DMatrix::from_diagonal(held)).cholesky()?.inverse();
        Some((&inverse * &self.score, inverse))
    }

    /// `g' (H + held)^-1 g`: chi-square of the unknowns being zero, and how many of them the evidence is of.
    pub(crate) fn chi2(&self, held: &DVector<f64>) -> Option<(f64, f64)> {
        let (at, inverse) = self.solved(held)?;
        Some((self.score.dot(&at), (&inverse * &self.information).trace()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(information: f64, mean: f64) -> NormalEquations {
        NormalEquations {
            information: DMatrix::from_element(1, 1, information),
            score: DVector::from_element(1, information * mean),
        }
    }

    #[test]
    fn a_change_is_the_difference_of_two_means_with_the_variance_of_both() {
        let nothing = DVector::zeros(1);
        let change = NormalEquations::change(&of(4.0, 1.0), &of(12.0, 1.5), &nothing);
        let (at, variance) = change.solved(&nothing).unwrap();
        assert!((at[0] - 0.5).abs() < 1e-12);
        assert!((variance[(0, 0)] - (1.0 / 4.0 + 1.0 / 12.0)).abs() < 1e-12);
    }

    #[test]
    fn what_is_believed_of_one_unknown_tells_of_the_others() {
        // y = s + m, seen 100 times with a mean of 0.03; s is believed to be 0.02 and very surely so.
        let seen = NormalEquations {
            information: DMatrix::from_element(2, 2, 100.0),
            score: DVector::from_element(2, 3.0),
        };
        let (at, _) = seen.without_first(0.02, 1e12).solved(&DVector::zeros(1)).unwrap();
        assert!((at[0] - 0.01).abs() < 1e-9);
        let (_, open) = seen.without_first(0.0, 1e-9).solved(&DVector::from_element(1, 1.0)).unwrap();
        assert!((open[(0, 0)] - 1.0).abs() < 1e-6, "nothing is left");
    }
}
