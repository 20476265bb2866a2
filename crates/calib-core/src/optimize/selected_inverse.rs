//! Selected inverse: the blocks of the inverse of a sparse matrix within the pattern of its factor.
//!
//! Only the blocks of `Z = S^-1` in the pattern of the factor L are computed (Takahashi, Fagan and Chen 1973;
//! Erisman and Tinney 1975). `S Z = I` is `Z L = L'^-1`, and L'^-1 is upper triangular. Its column j, with
//! the rows R below the diagonal, is
//!
//! - `Z_RR L_Rj + Z_Rj L_jj = 0`,
//! - `Z_jR L_Rj + Z_jj L_jj = L_jj'^-1`,
//!
//! so the panels of Z follow from the last to the first. Any two rows of a column are an entry of L, because
//! the elimination of j fills it in. `Z_RR` is therefore always within the pattern. The cost grows with the
//! size of the factor, not with the square of the matrix size. The covariance of coupled cameras is within
//! the pattern, as it is within the pattern of S.

use std::sync::Arc;

use nalgebra::DMatrix;

use crate::camera::dispatch;
use crate::optimize::dense::{Packed, Part, Product};
use crate::optimize::sparse_cholesky::{CholeskyFactor, add_scaled, dot};
use crate::optimize::sparse_cholesky::{SparseStructure, Supernode};

/// Inverse of a sparse matrix within the pattern of its factor.
#[derive(Debug)]
pub(crate) struct SelectedInverse {
    sparse: Arc<SparseStructure>,
    values: Vec<f64>,
}

impl CholeskyFactor {
    /// Returns the inverse within the pattern of the factor.
    pub(crate) fn inverse(self) -> SelectedInverse {
        let mut values = vec![0.0; self.values.len()];
        self.invert(&mut values);
        SelectedInverse { sparse: self.sparse, values }
    }

    fn invert(&self, values: &mut [f64]) {
        let (mut inverse, mut packed, mut product) =
            (Packed::default(), Packed::default(), Product::default());
        for supernode in self.sparse.supernodes.iter().rev() {
            let (width, height) = (supernode.width, supernode.height());
            let factor = self.panel(supernode);
            self.sparse.gather(supernode, values, &mut inverse);
            packed.pack_transposed(factor, height, width);
            product.multiply([&inverse, &packed], [0..height - width, 0..width], Part::All);
            let panel = &mut values[supernode.offset..supernode.end()];
            dispatch(
                #[inline(always)]
                || invert_panel(panel, factor, &product, width),
            );
        }
    }
}

impl SparseStructure {
    /// Gathers `Z_RR` for the rows R below a supernode. For a fully coupled matrix it is twice as large as
    /// the factor.
    fn gather(&self, supernode: &Supernode, values: &[f64], inverse: &mut Packed) {
        let width = supernode.width;
        inverse.clear(supernode.height() - width, supernode.height() - width);
        for (target, [k, end]) in self.targets(supernode) {
            let height = target.height();
            for row in k..end {
                let columns = target.columns(supernode.rows[row]);
                let panel = &values[target.offset..][columns.start * height..columns.end * height];
                let first = supernode.tops[row] - width;
                for [here, there, length] in supernode.runs_in(row, target) {
                    for (q, column) in panel.chunks_exact(height).enumerate() {
                        for (i, value) in column[there..there + length].iter().enumerate() {
                            inverse.set(here - width + i, first + q, *value);
                            inverse.set(first + q, here - width + i, *value);
                        }
                    }
                }
            }
        }
    }
}

/// Computes `[Z_jj; Z_Rj]` from `[L_jj; L_Rj]` and `Z_RR L_Rj`.
#[inline(always)]
fn invert_panel(panel: &mut [f64], factor: &[f64], products: &Product, width: usize) {
    let height = panel.len() / width;
    for c in (0..width).rev() {
        let (own, behind) = panel[c * height..].split_at_mut(height);
        let diagonal = factor[c * height + c];
        for (value, sum) in own[width..].iter_mut().zip(products.column(c, 0)) {
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
            // Known part of column i, which is also its row.
            let beside = dot(&panel[i * height + c + 1..i * height + width], &factor[c * height + c + 1..]);
            let right = if i == c { diagonal.recip() } else { 0.0 };
            let value = (right - below - beside) / diagonal;
            panel[c * height + i] = value;
            panel[i * height + c] = value;
        }
    }
}

impl SelectedInverse {
    /// Returns a block, row by row; zeros for two blocks without coupling.
    pub(crate) fn block(&self, a: usize, b: usize) -> DMatrix<f64> {
        let entry = self.sparse.entry([a, b]);
        DMatrix::from_fn(self.sparse.size(a), self.sparse.size(b), |i, j| {
            entry.map_or(0.0, |entry| self.values[entry.at(i, j)])
        })
    }
}
