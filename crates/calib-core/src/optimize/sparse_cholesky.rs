//! A sparse symmetric positive definite system in blocks: its factor, and its solution.
//!
//! The factor, `S = L L'`, is computed in place, supernode by supernode: the panel of supernode j becomes
//! `[L_jj; S_Rj L_jj'^-1]`, and `L_Rj L_Rj'` is subtracted from the panels of its rows R. Unlike a factorisation
//! entry by entry, this works on dense panels (Ng and Peyton 1993, "Block Sparse Cholesky Algorithms on Advanced
//! Uniprocessor Computers").

use std::sync::Arc;

use crate::camera::dispatch;
use crate::optimize::packed_product::{Packed, Part, Product};
use crate::optimize::sparse_structure::{SparseStructure, Supernode};

/// The factor L of one matrix.
#[derive(Clone, Debug)]
pub(crate) struct CholeskyFactor {
    pub(super) sparse: Arc<SparseStructure>,
    pub(super) values: Vec<f64>,
}

impl SparseStructure {
    /// `None` when the matrix is not positive definite. Of a block of the diagonal its upper triangle counts.
    pub(crate) fn factor(self: &Arc<Self>, mut values: Vec<f64>) -> Option<CholeskyFactor> {
        self.factor_in_place(&mut values)?;
        Some(CholeskyFactor { sparse: Arc::clone(self), values })
    }

    fn factor_in_place(&self, values: &mut [f64]) -> Option<()> {
        let (mut packed, mut product) = (Packed::default(), Product::default());
        for supernode in &self.supernodes {
            let (before, behind) = values.split_at_mut(supernode.end());
            let panel = &mut before[supernode.offset..];
            dispatch(
                #[inline(always)]
                || factor_panel(panel, supernode.height()),
            )?;
            packed.pack(panel, supernode.height(), supernode.width);
            for (target, [k, end]) in self.targets(supernode) {
                let below = |row: usize| supernode.tops[row] - supernode.width;
                let rows = below(k)..below(supernode.rows.len());
                product.multiply([&packed, &packed], [rows, below(k)..below(end)], Part::Lower);
                let values = &mut behind[target.offset - supernode.end()..][..target.width * target.height()];
                supernode.subtract(&product, [k, end], target, values);
            }
        }
        Some(())
    }
}

impl Supernode {
    /// Subtracts `L_Rj L_kj'`, of the rows R from those between `k` and `end` on, from the panel of these.
    fn subtract(&self, product: &Product, [k, end]: [usize; 2], target: &Self, values: &mut [f64]) {
        let height = target.height();
        for row in k..end {
            let first = self.tops[row];
            let columns = target.columns(self.rows[row]);
            let to = &mut values[columns.start * height..columns.end * height];
            for [here, there, length] in self.runs_in(row, target) {
                for (q, to) in to.chunks_exact_mut(height).enumerate() {
                    let from = product.column(first + q - self.width, here - self.width);
                    to[there..there + length].iter_mut().zip(from).for_each(|(to, from)| *to -= from);
                }
            }
        }
    }
}

/// Adds `factor` times values to as many.
#[inline(always)]
pub(super) fn add_scaled(to: &mut [f64], factor: f64, values: &[f64]) {
    for (to, value) in to.iter_mut().zip(values) {
        *to += factor * value;
    }
}

/// The sum of products, in eight parts.
#[inline(always)]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let length = a.len().min(b.len());
    let ((a, rest), (b, other)) = (a[..length].as_chunks::<8>(), b[..length].as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for i in 0..8 {
            sums[i] += a[i] * b[i];
        }
    }
    sums.iter().sum::<f64>() + rest.iter().zip(other).map(|(a, b)| a * b).sum::<f64>()
}

/// `[S_jj; S_Rj]` becomes `[L_jj; S_Rj L_jj'^-1]`; `None` when `S_jj` is not positive definite.
#[inline(always)]
fn factor_panel(panel: &mut [f64], height: usize) -> Option<()> {
    for c in 0..panel.len() / height {
        let (before, this) = panel.split_at_mut(c * height);
        let this = &mut this[c..height];
        subtract_columns(this, before, height, c);
        let pivot = this[0];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let scale = pivot.sqrt().recip();
        this.iter_mut().for_each(|value| *value *= scale);
    }
    Some(())
}

/// Subtracts columns from row `top` on, each times its value there.
#[inline(always)]
fn subtract_columns(to: &mut [f64], columns: &[f64], height: usize, top: usize) {
    // Several in one pass: what they are subtracted from is loaded and stored once.
    let mut several = columns.chunks_exact(4 * height);
    for four in &mut several {
        let [a, b, c, d] = [0, 1, 2, 3].map(|q| &four[q * height + top..(q + 1) * height]);
        let [p, q, r, s] = [a[0], b[0], c[0], d[0]];
        for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *to -= p * a + q * b + (r * c + s * d);
        }
    }
    for column in several.remainder().chunks_exact(height) {
        add_scaled(to, -column[top], &column[top..]);
    }
}

impl CholeskyFactor {
    /// Number of unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        self.sparse.unknowns()
    }

    pub(super) fn panel(&self, supernode: &Supernode) -> &[f64] {
        &self.values[supernode.offset..supernode.end()]
    }

    /// The solution for a right-hand side with the blocks one after the other as they are numbered.
    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut found = self.sparse.ordered(right);
        dispatch(
            #[inline(always)]
            || self.solve_in_place(&mut found),
        );
        self.sparse.numbered(&found)
    }

    #[inline(always)]
    fn solve_in_place(&self, found: &mut [f64]) {
        let mut below = Vec::new();
        for supernode in &self.sparse.supernodes {
            let (height, start) = (supernode.height(), self.sparse.starts[supernode.rows[0]]);
            let own = &mut found[start..start + supernode.width];
            below.clear();
            below.resize(height - supernode.width, 0.0);
            for (c, column) in self.panel(supernode).chunks_exact(height).enumerate() {
                let value = own[c] / column[c];
                own[c] = value;
                add_scaled(&mut own[c + 1..], -value, &column[c + 1..supernode.width]);
                add_scaled(&mut below, value, &column[supernode.width..]);
            }
            let mut rest = &below[..];
            for &row in &supernode.rows[supernode.blocks..] {
                let to = &mut found[self.sparse.starts[row]..self.sparse.starts[row + 1]];
                to.iter_mut().zip(rest).for_each(|(to, value)| *to -= value);
                rest = &rest[to.len()..];
            }
        }
        for supernode in self.sparse.supernodes.iter().rev() {
            let (height, start) = (supernode.height(), self.sparse.starts[supernode.rows[0]]);
            below.clear();
            for &row in &supernode.rows[supernode.blocks..] {
                below.extend_from_slice(&found[self.sparse.starts[row]..self.sparse.starts[row + 1]]);
            }
            let own = &mut found[start..start + supernode.width];
            for (c, column) in self.panel(supernode).chunks_exact(height).enumerate().rev() {
                let beside = dot(&own[c + 1..], &column[c + 1..supernode.width]);
                own[c] = (own[c] - beside - dot(&below, &column[supernode.width..])) / column[c];
            }
        }
    }
}

impl SparseStructure {
    /// Values of all unknowns as the blocks are numbered, in the order of the factor.
    fn ordered(&self, values: &[f64]) -> Vec<f64> {
        let mut ordered = vec![0.0; values.len()];
        let mut rest = values;
        for block in 0..self.blocks() {
            let (own, others) = rest.split_at(self.size(block));
            ordered[self.start(block)..][..own.len()].copy_from_slice(own);
            rest = others;
        }
        ordered
    }

    /// The same back.
    fn numbered(&self, ordered: &[f64]) -> Vec<f64> {
        let mut values = Vec::with_capacity(ordered.len());
        for block in 0..self.blocks() {
            values.extend_from_slice(&ordered[self.start(block)..][..self.size(block)]);
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn solution_and_inverse_are_those_of_the_dense_matrix(
            // Some alone, and several together, wider than a supernode.
            sizes in proptest::collection::vec(prop_oneof![20 => 1..10_usize, 1 => 57..60_usize], 0..14),
            pairs in proptest::collection::vec((0..14_usize, 0..14_usize), 0..60),
            seed in 0_u64..1000,
        ) {
            use rand::{Rng as _, SeedableRng as _};
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let count = sizes.len();
            let pairs: Vec<_> = pairs.iter().filter(|_| count > 0).map(|(a, b)| (a % count, b % count)).filter(|(a, b)| a < b).collect::<BTreeSet<_>>().into_iter().collect();
            let sparse = SparseStructure::new(&sizes, pairs.iter().map(|&(a, b)| [a, b]));
            let offset = |block: usize| sizes[..block].iter().sum::<usize>();
            let total = offset(count);
            let mut dense = DMatrix::zeros(total, total);
            let mut values = sparse.zeros();
            for &(a, b) in &pairs {
                let block: Vec<f64> = (0..sizes[a] * sizes[b]).map(|_| random.random_range(-1.0..1.0)).collect();
                for (i, row) in block.chunks_exact(sizes[b]).enumerate() {
                    let unit: Vec<f64> = (0..sizes[a]).map(|k| f64::from(u8::from(k == i))).collect();
                    sparse.entry([a, b]).unwrap().add_outer(&mut values, 1.0, &unit, row);
                }
                for i in 0..sizes[a] {
                    for j in 0..sizes[b] {
                        dense[(offset(a) + i, offset(b) + j)] += block[i * sizes[b] + j];
                        dense[(offset(b) + j, offset(a) + i)] += block[i * sizes[b] + j];
                    }
                }
            }
            // More than the sum of what stands beside it: positive.
            for block in 0..count {
                for (i, at) in sparse.diagonal(block).enumerate() {
                    values[at] += 300.0;
                    dense[(offset(block) + i, offset(block) + i)] += 300.0;
                }
            }
            let right: Vec<f64> = (0..total).map(|_| random.random_range(-1.0..1.0)).collect();
            let expected = dense.clone().cholesky().unwrap();
            let factor = sparse.factor(values).unwrap();
            let solution = factor.solve(&right);
            let exact = expected.solve(&nalgebra::DVector::from_vec(right));
            for (found, exact) in solution.iter().zip(exact.iter()) {
                prop_assert!((found - exact).abs() < 1e-12);
            }
            let (inverse, exact) = (factor.inverse(), expected.inverse());
            for (a, b) in pairs.iter().copied().chain((0..count).map(|block| (block, block))) {
                let block = inverse.block(a, b);
                for i in 0..sizes[a] {
                    for j in 0..sizes[b] {
                        prop_assert!((block[(i, j)] - exact[(offset(a) + i, offset(b) + j)]).abs() < 1e-12);
                    }
                }
            }
        }
    }
}
