//! The normal equations of a turn: block by block of the image, what moves all edges of a block alike eliminated.
//!
//! With the precisions P of the places of a block (`turn_fit.rs`), N the directions that their offsets count along, and a
//! vector of the variance `b^2` either way that moves them all,
//!
//! ```text
//! (P^-1 + b^2 N N')^-1 = P - P N (1 / b^2 + N' P N)^-1 N' P
//! ```
//!
//! (Woodbury 1950).

use nalgebra::{DMatrix, DVector, Matrix2, OMatrix, Vector2};

use crate::compare::edge_offset::{EdgeOffset, TONE};
use calib_core::camera::Turn;

/// What light moves an edge by, in pixels for a contrast of 1 in the logarithm of brightness: standard deviation.
const LIGHT: f64 = 0.3;

/// Derivatives by what is estimated, of a vector that moves a block.
type ByMotion = OMatrix<f64, nalgebra::Dyn, nalgebra::U2>;

/// The normal equations of the edges of one block.
#[derive(Clone, Debug)]
pub(super) struct BlockSum {
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// `A' P N`, `N' P N` and `N' P d`.
    cross: ByMotion,
    motion: Matrix2<f64>,
    motion_score: Vector2<f64>,
    /// Of an offset that all places have in common.
    pub(super) precision: f64,
}

/// The normal equations of some blocks.
#[derive(Clone, Debug)]
pub(super) struct Sum {
    information: DMatrix<f64>,
    score: DVector<f64>,
}

impl BlockSum {
    pub(super) fn nothing(unknowns: usize) -> Self {
        Self {
            information: DMatrix::zeros(unknowns, unknowns),
            score: DVector::zeros(unknowns),
            cross: ByMotion::zeros(unknowns),
            motion: Matrix2::zeros(),
            motion_score: Vector2::zeros(),
            precision: 0.0,
        }
    }

    /// The places of one edge, whose offset in common has the standard deviation `shared`.
    pub(super) fn add(&mut self, edge: &[EdgeOffset], precisions: &[f64], shared: f64) {
        // A' W 1, N' W 1, d' W 1 and 1' W 1.
        let (mut total, mut offset) = (0.0, 0.0);
        let (mut together, mut way) = (DVector::zeros(self.score.len()), Vector2::zeros());
        for (row, &precision) in edge.iter().zip(precisions).filter(|(_, precision)| **precision > 0.0) {
            let by = DVector::from_fn(self.score.len(), |k, _| row.by(k));
            let across = Vector2::from(row.across);
            self.score.axpy(precision * row.offset, &by, 1.0);
            self.information.ger(precision, &by, &by, 1.0);
            self.cross.ger(precision, &by, &across, 1.0);
            self.motion.ger(precision, &across, &across, 1.0);
            self.motion_score += precision * row.offset * across;
            together.axpy(precision, &by, 1.0);
            way += precision * across;
            offset += precision * row.offset;
            total += precision;
        }
        let known = shared * shared / (1.0 + shared * shared * total);
        self.score.axpy(-known * offset, &together, 1.0);
        self.information.ger(-known, &together, &together, 1.0);
        self.cross.ger(-known, &together, &way, 1.0);
        self.motion.ger(-known, &way, &way, 1.0);
        self.motion_score -= known * offset * way;
        self.precision += total - known * total * total;
    }

    /// With what moves the block eliminated: a vector of this standard deviation either way.
    fn closed(&self, block: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        if block <= 0.0 {
            return Some((self.information.clone(), self.score.clone()));
        }
        let known = (Matrix2::identity() / (block * block) + self.motion).try_inverse()?;
        let carried = &self.cross * known;
        Some((
            &self.information - &carried * self.cross.transpose(),
            &self.score - carried * self.motion_score,
        ))
    }
}

impl Sum {
    /// Of blocks, each moved by a vector of this standard deviation.
    pub(super) fn of(blocks: &[BlockSum], block: f64) -> Option<Self> {
        let unknowns = blocks.first()?.score.len();
        let (mut information, mut score) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        for one in blocks {
            let (own, own_score) = one.closed(block)?;
            information += own;
            score += own_score;
        }
        Some(Self { information, score })
    }

    /// The inverse of what all tell.
    pub(super) fn bound(&self) -> Option<DMatrix<f64>> {
        Some(self.believed().cholesky()?.inverse())
    }

    /// The covariance that blocks bear out, each by itself: with the information I of all, `I_k` and score `s_k` of one, and
    /// `H_k = I^-1/2 I_k I^-1/2`, the sum of the squares of `I^-1/2 (1 - H_k)^-1/2 I^-1/2 s_k` (Bell and `McCaffrey` 2002);
    /// and what the belief P about light may be off by, `I^-1 P I^-1`. Where one block tells nearly all, nothing is borne
    /// out, and it counts as what is expected, 1. `slope` is the mean slope of psi over the mean weight.
    pub(super) fn borne_out(
        &self,
        blocks: &[BlockSum],
        block: f64,
        estimate: &DVector<f64>,
        slope: f64,
    ) -> Option<DMatrix<f64>> {
        /// Share that is nearly all.
        const ALL: f64 = 0.95;
        let root = self.believed().cholesky()?.l().try_inverse()?;
        let bound = root.transpose() * &root;
        let belief = DMatrix::from_diagonal(&(self.believed().diagonal() - self.information.diagonal()));
        let mut covariance = &bound * belief * &bound;
        for one in blocks {
            let (information, score) = one.closed(block)?;
            let told = &root * (score - &information * estimate);
            let eigen = (&root * information * root.transpose()).symmetric_eigen();
            let mut along = eigen.eigenvectors.transpose() * told;
            for (along, &share) in along.iter_mut().zip(&eigen.eigenvalues) {
                *along = if share > ALL {
                    along.abs().max(1.0).copysign(*along)
                } else {
                    *along / ((1.0 - share).sqrt() * slope)
                };
            }
            let moved = root.transpose() * (eigen.eigenvectors * along);
            covariance.ger(1.0, &moved, &moved, 1.0);
        }
        Some(covariance)
    }

    /// With what is believed of light before it is seen.
    fn believed(&self) -> DMatrix<f64> {
        let mut believed = self.information.clone();
        let tone = (Turn::SIZE..Turn::SIZE + TONE).filter(|&i| i < self.score.len());
        tone.for_each(|i| believed[(i, i)] += LIGHT.powi(-2));
        believed
    }

    pub(super) fn solved(&self) -> Option<DVector<f64>> {
        /// A parameter that edges tell less of than this share of what they tell of it alone is not told.
        const TOLD: f64 = 1e-9;
        // In units of what each is told by itself, so that radians and shares are alike.
        let information = self.believed();
        let units = information.diagonal().map(|value| value.max(f64::MIN_POSITIVE).sqrt().recip());
        let scaled =
            DMatrix::from_fn(units.len(), units.len(), |i, j| information[(i, j)] * units[i] * units[j]);
        let cholesky = scaled.cholesky()?;
        let is_told = cholesky.l_dirty().diagonal().iter().all(|pivot| pivot * pivot > TOLD);
        is_told.then(|| cholesky.solve(&self.score.component_mul(&units)).component_mul(&units))
    }
}
