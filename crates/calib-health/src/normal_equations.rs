//! Normal equations `H x = g` that accumulate evidence, and the change of their unknowns between two periods.

use nalgebra::{DMatrix, DVector};

/// Normal equations `H x = g` of a few unknowns `x`: the information `H` and the score `g`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NormalEquations {
    pub(crate) information: DMatrix<f64>,
    pub(crate) score: DVector<f64>,
}

impl NormalEquations {
    pub(crate) fn zeros(unknowns: usize) -> Self {
        Self { information: DMatrix::zeros(unknowns, unknowns), score: DVector::zeros(unknowns) }
    }

    pub(crate) fn len(&self) -> usize {
        self.score.len()
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.information += &other.information;
        self.score += &other.score;
    }

    pub(crate) fn minus(&self, other: &Self) -> Self {
        Self { information: &self.information - &other.information, score: &self.score - &other.score }
    }

    /// Returns the evidence rescaled to the true variance of its score. With `H = C C'` and the true variance
    /// `C D C'`, the information becomes `C D^-1 C'`. `inverse_dispersion` is `D^-1`.
    pub(crate) fn rescaled(&self, inverse_dispersion: &DMatrix<f64>) -> Self {
        let Some(root) = self.root() else { return Self::zeros(self.len()) };
        let whitened = root.solve_lower_triangular(&self.score);
        let Some(whitened) = whitened else { return Self::zeros(self.len()) };
        let worth = &root * inverse_dispersion;
        Self { information: &worth * root.transpose(), score: worth * whitened }
    }

    /// Returns the lower triangular Cholesky factor `C` of the information, `H = C C'`. A small value is added to the
    /// diagonal, so that `C` exists for undetermined unknowns, too. Returns `None` without any information.
    pub(crate) fn root(&self) -> Option<DMatrix<f64>> {
        /// Value added to the diagonal of the information, relative to its largest diagonal element.
        const REGULARIZATION: f64 = 1e-9;
        let largest = self.information.diagonal().max();
        if largest.is_nan() || largest <= 0.0 {
            return None;
        }
        let regularization = DMatrix::identity(self.len(), self.len()) * (REGULARIZATION * largest);
        Some((&self.information + regularization).cholesky()?.l())
    }

    /// Returns the evidence of two periods about the change of the unknowns between them. Both periods share
    /// constant errors with the prior precisions `P` (`prior_precisions`), which are eliminated:
    ///
    /// ```text
    /// H = H2 - H2 (H1 + H2 + P)^-1 H2,   g = g2 - H2 (H1 + H2 + P)^-1 (g1 + g2)
    /// ```
    ///
    /// Index 1 is the period `before` the change, index 2 the period `after` it.
    pub(crate) fn change(before: &Self, after: &Self, prior_precisions: &DVector<f64>) -> Self {
        let both = &before.information + &after.information + DMatrix::from_diagonal(prior_precisions);
        let Some(both) = both.cholesky() else { return Self::zeros(before.len()) };
        let information = &after.information - &after.information * both.solve(&after.information);
        let score = &after.score - &after.information * both.solve(&(&before.score + &after.score));
        Self { information: 0.5 * (&information + information.transpose()), score }
    }

    /// Returns the normal equations of the unknowns at `indices`; the other unknowns are fixed at zero.
    pub(crate) fn subset(&self, indices: &[usize]) -> Self {
        let information =
            DMatrix::from_fn(indices.len(), indices.len(), |i, j| self.information[(indices[i], indices[j])]);
        Self { information, score: DVector::from_fn(indices.len(), |i, _| self.score[indices[i]]) }
    }

    /// Returns the normal equations of a larger number of unknowns. `at` contains the index of each present
    /// unknown in the larger set.
    pub(crate) fn expanded(&self, at: &[usize], unknowns: usize) -> Self {
        let mut all = Self::zeros(unknowns);
        for (i, &row) in at.iter().enumerate() {
            all.score[row] = self.score[i];
            at.iter().enumerate().for_each(|(j, &column)| {
                all.information[(row, column)] = self.information[(i, j)];
            });
        }
        all
    }

    /// Returns the normal equations without the first unknown, which is eliminated with a prior of this mean
    /// and precision.
    pub(crate) fn eliminate_first(&self, mean: f64, precision: f64) -> Self {
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

    /// Returns the estimate of the unknowns and its covariance, with zero-mean priors of these precisions.
    pub(crate) fn solve(&self, prior_precisions: &DVector<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let inverse = (&self.information + DMatrix::from_diagonal(prior_precisions)).cholesky()?.inverse();
        Some((&inverse * &self.score, inverse))
    }

    /// Returns the chi-square of the hypothesis that all unknowns are zero, and its effective degrees of
    /// freedom. The chi-square is `g' (H + P)^-1 g` with the prior precisions `P`.
    pub(crate) fn chi2(&self, prior_precisions: &DVector<f64>) -> Option<(f64, f64)> {
        let (at, inverse) = self.solve(prior_precisions)?;
        Some((self.score.dot(&at), (&inverse * &self.information).trace()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_unknown(information: f64, mean: f64) -> NormalEquations {
        NormalEquations {
            information: DMatrix::from_element(1, 1, information),
            score: DVector::from_element(1, information * mean),
        }
    }

    #[test]
    fn change_is_the_difference_of_means_with_summed_variance() {
        let nothing = DVector::zeros(1);
        let change = NormalEquations::change(&one_unknown(4.0, 1.0), &one_unknown(12.0, 1.5), &nothing);
        let (at, variance) = change.solve(&nothing).unwrap();
        assert!((at[0] - 0.5).abs() < 1e-12);
        assert!((variance[(0, 0)] - (1.0 / 4.0 + 1.0 / 12.0)).abs() < 1e-12);
    }

    #[test]
    fn prior_on_one_unknown_constrains_the_others() {
        // y = s + m, observed 100 times with a mean of 0.03; the prior on s is 0.02 with a high precision.
        let seen = NormalEquations {
            information: DMatrix::from_element(2, 2, 100.0),
            score: DVector::from_element(2, 3.0),
        };
        let (at, _) = seen.eliminate_first(0.02, 1e12).solve(&DVector::zeros(1)).unwrap();
        assert!((at[0] - 0.01).abs() < 1e-9);
        let (_, open) = seen.eliminate_first(0.0, 1e-9).solve(&DVector::from_element(1, 1.0)).unwrap();
        assert!((open[(0, 0)] - 1.0).abs() < 1e-6, "only the prior is left");
    }
}
