//! The blocks of the inverse of a sparse matrix, where its factor has some.
//!
//! Of the inverse `Z = S^-1` only the blocks where L has some are computed, the selected inverse (Takahashi, Fagan
//! and Chen 1973; Erisman and Tinney 1975). `S Z = I` is `Z L = L'^-1`, and L'^-1 is upper triangular; its column
//! j, with the rows R below the diagonal, reads
//!
//! - `Z_RR L_Rj + Z_Rj L_jj = 0`,
//! - `Z_jR L_Rj + Z_jj L_jj = L_jj'^-1`,
//!
//! so that the panels of Z follow from the last to the first. Any two rows of a column are an entry of L
//! themselves (elimination of j fills it in): whatever `Z_RR` asks for is there. The cost grows with the factor,
//! not with the square of the size. The covariance of coupled cameras lies within the pattern, for that of S does.

use std::sync::Arc;

use nalgebra::DMatrix;

use crate::camera::dispatch;
use crate::optimize::sparse_cholesky::{BlockColumn, CholeskyFactor, SparseStructure, add_scaled, dot};

/// The inverse where the factor has entries.
#[derive(Debug)]
pub(crate) struct SelectedInverse {
    sparse: Arc<SparseStructure>,
    values: Vec<f64>,
}

impl CholeskyFactor {
    /// The inverse, where the factor has entries.
    pub(crate) fn inverse(self) -> SelectedInverse {
        let mut values = vec![0.0; self.values.len()];
        dispatch(
            #[inline(always)]
            || self.invert(&mut values),
        );
        SelectedInverse { sparse: self.sparse, values }
    }

    #[inline(always)]
    fn invert(&self, values: &mut [f64]) {
        let mut sums = Vec::new();
        for column in self.sparse.columns.iter().rev() {
            let (width, height) = (column.width, column.height());
            let factor = self.panel(column);
            sums.clear();
            sums.resize(width * height, 0.0);
            for k in 1..column.rows.len() {
                let other = &self.sparse.columns[column.rows[k]];
                let inverse = &values[other.offset..][..other.width * other.height()];
                column.add_inverse_products(factor, k, other, inverse, &mut sums);
            }
            let panel = &mut values[column.offset..][..width * height];
            invert_panel(panel, factor, &sums, width);
        }
    }
}

impl BlockColumn {
    /// Adds the part of `Z_RR L_Rj` that the panel `k` of the inverse has, and its transpose.
    #[inline(always)]
    fn add_inverse_products(
        &self,
        factor: &[f64],
        k: usize,
        other: &Self,
        inverse: &[f64],
        sums: &mut [f64],
    ) {
        let height = self.height();
        let top = self.tops[k];
        for [here, there, length] in self.runs_in(k, other) {
            for (q, column) in inverse.chunks_exact(other.height()).enumerate() {
                let run = &column[there..there + length];
                // The block of the diagonal is whole: its transpose is itself.
                let beyond = if here == top { other.width } else { 0 };
                for (sums, factor) in sums.chunks_exact_mut(height).zip(factor.chunks_exact(height)) {
                    add_scaled(&mut sums[here..], factor[top + q], run);
                    sums[top + q] += dot(&factor[here + beyond..], &run[beyond..]);
                }
            }
        }
    }
}

/// `[Z_jj; Z_Rj]` from `[L_jj; L_Rj]` and `Z_RR L_Rj`.
#[inline(always)]
fn invert_panel(panel: &mut [f64], factor: &[f64], sums: &[f64], width: usize) {
    let height = panel.len() / width;
    for c in (0..width).rev() {
        let (own, behind) = panel[c * height..].split_at_mut(height);
        let diagonal = factor[c * height + c];
        for (value, sum) in own[width..].iter_mut().zip(&sums[c * height + width..]) {
            *value = -sum;
        }
        for (d, later) in behind.chunks_exact(height).enumerate() {
            let weight = -factor[c * height + c + 1 + d];
            add_scaled(&mut own[width..], weight, &later[width..]);
        }
        own[width..].iter_mut().for_each(|value| *value /= diagonal);
    }
    for c in (0..width).rev() {
        let diagonal = factor[c * height + c];
        for i in (c..width).rev() {
            let below = dot(&panel[i * height + width..(i + 1) * height], &factor[c * height + width..]);
            let beside: f64 = (c + 1..width).map(|d| panel[d * height + i] * factor[c * height + d]).sum();
            let right = if i == c { diagonal.recip() } else { 0.0 };
            let value = (right - below - beside) / diagonal;
            panel[c * height + i] = value;
            panel[i * height + c] = value;
        }
    }
}

impl SelectedInverse {
    /// A block, row by row; zeros for two blocks that nothing couples.
    pub(crate) fn block(&self, a: usize, b: usize) -> DMatrix<f64> {
        let size = |block: usize| self.sparse.columns[self.sparse.places[block]].width;
        let entry = self.sparse.entry([a, b]);
        DMatrix::from_fn(size(a), size(b), |i, j| entry.map_or(0.0, |entry| self.values[entry.at(i, j)]))
    }
}
