//! Selected inverse: the blocks of the inverse of a sparse matrix within the pattern of its factor.
//!
//! Let S be the matrix, `S = L L'` its Cholesky factorisation and `Z = S^-1` its inverse. Only the blocks of
//! Z in the pattern of L are computed (Takahashi, Fagan and Chen 1973; Erisman and Tinney 1975). `S Z = I` is
//! equivalent to `Z L = L'^-1`, and L'^-1 is upper triangular. Block column j of this equation, with the rows
//! R of L below the diagonal, is
//!
//! - `Z_RR L_Rj + Z_Rj L_jj = 0`,
//! - `Z_jR L_Rj + Z_jj L_jj = L_jj'^-1`,
//!
//! so the panels of Z are computed from the last to the first. Any two rows in R are coupled in L, because
//! the elimination of j fills in their entry. `Z_RR` is therefore always within the pattern. The cost grows
//! with the size of the factor, not with the square of the matrix size. The covariance of coupled cameras is
//! within the pattern of L, because it is within the pattern of S.

use std::sync::Arc;

use nalgebra::DMatrix;

use crate::camera::dispatch;
use crate::optimize::dense::{Packed, Part, Product};
use crate::optimize::sparse_cholesky::{CholeskyFactor, add_scaled, dot};
use crate::optimize::sparse_cholesky::{SparseStructure, Supernode};

/// Inverse of a sparse matrix within the pattern of its factor.
#[derive(Debug)]
pub(crate) struct SelectedInverse {
    /// Pattern of the factor.
    sparse: Arc<SparseStructure>,
    /// Values of the inverse, in the layout of the factor.
    values: Vec<f64>,
}

impl CholeskyFactor {
    /// Returns the inverse of the factored matrix, within the pattern of the factor.
    pub(crate) fn inverse(self) -> SelectedInverse {
        let mut values = vec![0.0; self.values.len()];
        self.compute_inverse(&mut values);
        SelectedInverse { sparse: self.sparse, values }
    }

    /// Computes the values of the inverse, panel by panel from the last to the first.
    fn compute_inverse(&self, values: &mut [f64]) {
        let (mut inverse, mut packed, mut product) =
            (Packed::default(), Packed::default(), Product::default());
        for supernode in self.sparse.supernodes.iter().rev() {
            let (width, height) = (supernode.width, supernode.height());
            let factor = self.panel(supernode);
            self.sparse.gather_inverse_below(supernode, values, &mut inverse);
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
    /// Copies `Z_RR`, for the rows R below a supernode, from the panels of the inverse to a dense matrix. For
    /// a fully coupled matrix, `Z_RR` is two times as large as the factor.
    fn gather_inverse_below(&self, supernode: &Supernode, values: &[f64], inverse: &mut Packed) {
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

/// Computes a panel `[Z_jj; Z_Rj]` of the inverse from the panel `[L_jj; L_Rj]` of the factor and the product
/// `Z_RR L_Rj`. The supernode j has `width` columns.
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
            // Sum over the known part of column i, which is also row i.
            let within = dot(&panel[i * height + c + 1..i * height + width], &factor[c * height + c + 1..]);
            let right = if i == c { diagonal.recip() } else { 0.0 };
            let value = (right - below - within) / diagonal;
            panel[c * height + i] = value;
            panel[i * height + c] = value;
        }
    }
}

impl SelectedInverse {
    /// Returns the matrix of the inverse for the blocks `a` (rows) and `b` (columns). Returns zeros if their
    /// entry is outside the pattern.
    pub(crate) fn block(&self, a: usize, b: usize) -> DMatrix<f64> {
        let entry = self.sparse.entry([a, b]);
        DMatrix::from_fn(self.sparse.size(a), self.sparse.size(b), |i, j| {
            entry.map_or(0.0, |entry| self.values[entry.at(i, j)])
        })
    }
}
