//! A sparse symmetric positive definite system in blocks: its factor, and its solution.
//!
//! The blocks are ordered for little fill by approximate minimum degree (Amestoy, Davis and Duff 1996). Matrix,
//! factor and inverse have one layout: for every block column j, in this order, a panel of the rows where the
//! factor has entries, column by column, the block of the diagonal first. Below the diagonal these are the rows of
//! the matrix and of every column whose first block below its own is j (Davis 2006, "Direct Methods for Sparse
//! Linear Systems", section 4.1).
//!
//! The factor, `S = L L'`, is computed in place, panel by panel: that of column j becomes
//! `[L_jj; S_Rj L_jj'^-1]`, and `L_Rj L_Rj'` is subtracted from the panels of its rows R. Unlike a factorisation
//! entry by entry, this works on dense panels of some hundred numbers at a time (a supernodal factorisation whose
//! supernodes are the cameras; Ng and Peyton 1993, "Block Sparse Cholesky Algorithms on Advanced Uniprocessor
//! Computers").

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::camera::dispatch;

/// The pattern of the factor of a matrix of blocks.
#[derive(Clone, Debug)]
pub(crate) struct SparseStructure {
    /// Of every block, its place in the order of the factor.
    pub(super) places: Vec<usize>,
    /// In the order of the factor.
    pub(super) columns: Vec<BlockColumn>,
}

/// Where the factor has entries in the columns of one block.
#[derive(Clone, Debug)]
pub(super) struct BlockColumn {
    /// First unknown in the order of the factor.
    start: usize,
    pub(super) width: usize,
    /// First value of its panel.
    pub(super) offset: usize,
    /// Places of the blocks of its rows, ascending; itself first.
    pub(super) rows: Vec<usize>,
    /// First row of each in the panel, and the height of the panel.
    pub(super) tops: Vec<usize>,
}

/// Where in the values the block of two blocks is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    offset: usize,
    /// From one column of the panel to the next.
    stride: usize,
    /// Whether the second block is the column.
    is_transposed: bool,
}

/// The factor L of one matrix.
#[derive(Clone, Debug)]
pub(crate) struct CholeskyFactor {
    pub(super) sparse: Arc<SparseStructure>,
    pub(super) values: Vec<f64>,
}

impl Entry {
    /// Where the value of a row of the first block and a column of the second is.
    #[inline]
    pub(super) fn at(self, row: usize, column: usize) -> usize {
        let (across, down) = if self.is_transposed { (column, row) } else { (row, column) };
        self.offset + across * self.stride + down
    }

    /// Adds a matrix of so many columns, row by row.
    pub(crate) fn add(self, values: &mut [f64], matrix: &[f64], width: usize) {
        for (i, row) in matrix.chunks_exact(width).enumerate() {
            for (j, value) in row.iter().enumerate() {
                values[self.at(i, j)] += value;
            }
        }
    }

    /// Adds `factor` times the product of a column of the first block and a row of the second.
    #[inline(always)]
    pub(crate) fn add_outer(self, values: &mut [f64], factor: f64, first: &[f64], second: &[f64]) {
        let (across, down) = if self.is_transposed { (second, first) } else { (first, second) };
        for (column, a) in values[self.offset..].chunks_mut(self.stride).zip(across) {
            let factor = factor * a;
            for (value, b) in column.iter_mut().zip(down) {
                *value += factor * b;
            }
        }
    }
}

impl SparseStructure {
    /// The structure of a matrix of blocks of these sizes that couples these pairs of blocks.
    pub(crate) fn new(sizes: &[usize], pairs: impl Iterator<Item = [usize; 2]>) -> Arc<Self> {
        let mut neighbours: Vec<BTreeSet<usize>> =
            (0..sizes.len()).map(|block| BTreeSet::from([block])).collect();
        for [a, b] in pairs {
            neighbours[a].insert(b);
            neighbours[b].insert(a);
        }
        let order = order(&neighbours);
        let mut places = vec![0; sizes.len()];
        order.iter().enumerate().for_each(|(place, &block)| places[block] = place);
        let mut below: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); sizes.len()];
        let mut columns: Vec<BlockColumn> = Vec::with_capacity(sizes.len());
        let (mut start, mut offset) = (0, 0);
        for (place, &block) in order.iter().enumerate() {
            let mut own = std::mem::take(&mut below[place]);
            own.extend(neighbours[block].iter().map(|&other| places[other]).filter(|&other| other > place));
            let rows: Vec<usize> = std::iter::once(place).chain(own.iter().copied()).collect();
            if let Some(parent) = own.pop_first() {
                below[parent].append(&mut own);
            }
            let mut tops = vec![0];
            tops.extend(rows.iter().scan(0, |height, &row| {
                *height += sizes[order[row]];
                Some(*height)
            }));
            let width = sizes[block];
            let column = BlockColumn { start, width, offset, rows, tops };
            start += width;
            offset += width * column.height();
            columns.push(column);
        }
        Arc::new(Self { places, columns })
    }

    /// Room for the values of a matrix.
    pub(crate) fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.columns.last().map_or(0, |column| column.offset + column.width * column.height())]
    }

    /// Where the block of two blocks is, if they are coupled.
    pub(crate) fn entry(&self, [a, b]: [usize; 2]) -> Option<Entry> {
        let (first, second) = (self.places[a], self.places[b]);
        let column = &self.columns[first.min(second)];
        let row = column.rows.binary_search(&first.max(second)).ok()?;
        let (offset, stride) = (column.offset + column.tops[row], column.height());
        Some(Entry { offset, stride, is_transposed: second < first })
    }

    /// Where the diagonal of a block is.
    pub(crate) fn diagonal(&self, block: usize) -> impl Iterator<Item = usize> + use<> {
        let column = &self.columns[self.places[block]];
        let (offset, step) = (column.offset, column.height() + 1);
        (0..column.width).map(move |i| offset + i * step)
    }

    /// `None` when the matrix is not positive definite. Of the blocks of the diagonal the lower triangle counts.
    pub(crate) fn factor(self: &Arc<Self>, mut values: Vec<f64>) -> Option<CholeskyFactor> {
        dispatch(
            #[inline(always)]
            || self.factor_in_place(&mut values),
        )?;
        Some(CholeskyFactor { sparse: Arc::clone(self), values })
    }

    #[inline(always)]
    fn factor_in_place(&self, values: &mut [f64]) -> Option<()> {
        for column in &self.columns {
            let (panel, behind) = values[column.offset..].split_at_mut(column.width * column.height());
            factor_panel(panel, column.width, column.height())?;
            let end = column.offset + panel.len();
            for k in 1..column.rows.len() {
                let target = &self.columns[column.rows[k]];
                let values = &mut behind[target.offset - end..][..target.width * target.height()];
                column.subtract_products(panel, k, target, values);
            }
        }
        Some(())
    }

    /// Values of all unknowns as the blocks are numbered, in the order of the factor.
    fn ordered(&self, values: &[f64]) -> Vec<f64> {
        let mut ordered = vec![0.0; values.len()];
        let mut rest = values;
        for &place in &self.places {
            let BlockColumn { start, width, .. } = self.columns[place];
            let (own, others) = rest.split_at(width);
            ordered[start..start + width].copy_from_slice(own);
            rest = others;
        }
        ordered
    }

    /// The unknowns of all rows below the diagonal block of a column, from first to last.
    fn unknowns_below<'a>(&'a self, column: &'a BlockColumn) -> impl Iterator<Item = usize> + 'a {
        column.rows[1..].iter().flat_map(|&row| {
            let BlockColumn { start, width, .. } = self.columns[row];
            start..start + width
        })
    }
}

impl BlockColumn {
    pub(super) fn height(&self) -> usize {
        self.tops[self.rows.len()]
    }

    /// Rows of this panel from its block row `k` on, as runs that another panel, which has them all, has in one
    /// piece: first row here, first row there, length.
    pub(super) fn runs_in<'a>(&'a self, k: usize, other: &'a Self) -> impl Iterator<Item = [usize; 3]> + 'a {
        let (mut from, mut at) = (k, 0);
        std::iter::from_fn(move || {
            let first = *self.rows.get(from)?;
            at += other.rows[at..].iter().position(|&row| row == first)?;
            let common = self.rows[from..].iter().zip(&other.rows[at..]).take_while(|(a, b)| a == b).count();
            let run = [self.tops[from], other.tops[at], self.tops[from + common] - self.tops[from]];
            (from, at) = (from + common, at + common);
            Some(run)
        })
    }

    /// Subtracts `L_Rj L_kj'`, of the rows R from `k` on, from the panel of `k`.
    #[inline(always)]
    fn subtract_products(&self, panel: &[f64], k: usize, target: &Self, values: &mut [f64]) {
        let (top, height) = (self.tops[k], self.height());
        for [here, there, length] in self.runs_in(k, target) {
            for (q, to) in values.chunks_exact_mut(target.height()).enumerate() {
                let to = &mut to[there..there + length];
                // Several columns in one pass: what they are subtracted from is loaded and stored once.
                for columns in panel.chunks(MOST_AT_ONCE * height) {
                    match columns.len() / height {
                        1 => subtract::<1>(to, columns, height, top + q, here),
                        2 => subtract::<2>(to, columns, height, top + q, here),
                        3 => subtract::<3>(to, columns, height, top + q, here),
                        4 => subtract::<4>(to, columns, height, top + q, here),
                        5 => subtract::<5>(to, columns, height, top + q, here),
                        6 => subtract::<6>(to, columns, height, top + q, here),
                        7 => subtract::<7>(to, columns, height, top + q, here),
                        _ => subtract::<MOST_AT_ONCE>(to, columns, height, top + q, here),
                    }
                }
            }
        }
    }
}

/// Columns of a panel in one pass: those of most cameras.
const MOST_AT_ONCE: usize = 8;

/// Subtracts N columns of a panel from row `here` on, each times its value in row `by`.
#[inline(always)]
fn subtract<const N: usize>(to: &mut [f64], columns: &[f64], height: usize, by: usize, here: usize) {
    let length = to.len();
    let factors: [f64; N] = std::array::from_fn(|d| columns[d * height + by]);
    let columns: [&[f64]; N] = std::array::from_fn(|d| &columns[d * height + here..][..length]);
    for i in 0..length {
        let mut sum = 0.0;
        for d in 0..N {
            sum += factors[d] * columns[d][i];
        }
        to[i] -= sum;
    }
}

/// Adds `factor` times values to as many.
#[inline(always)]
pub(super) fn add_scaled(to: &mut [f64], factor: f64, values: &[f64]) {
    for (to, value) in to.iter_mut().zip(values) {
        *to += factor * value;
    }
}

#[inline(always)]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `[S_jj; S_Rj]` becomes `[L_jj; S_Rj L_jj'^-1]`; `None` when `S_jj` is not positive definite.
#[inline(always)]
fn factor_panel(panel: &mut [f64], width: usize, height: usize) -> Option<()> {
    for c in 0..width {
        let (before, this) = panel.split_at_mut(c * height);
        let this = &mut this[c..height];
        for earlier in before.chunks_exact(height) {
            add_scaled(this, -earlier[c], &earlier[c..]);
        }
        let pivot = this[0];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let scale = pivot.sqrt().recip();
        this.iter_mut().for_each(|value| *value *= scale);
    }
    Some(())
}

/// An order of the blocks with little fill.
fn order(neighbours: &[BTreeSet<usize>]) -> Vec<usize> {
    let mut offsets = vec![0];
    let mut rows = Vec::new();
    for others in neighbours {
        rows.extend(others);
        offsets.push(rows.len());
    }
    let found = amd::order::<usize>(neighbours.len(), &offsets, &rows, &amd::Control::default());
    // The pattern is valid by construction; the order as it is would be right, too, only slower.
    found.map_or_else(|_| (0..neighbours.len()).collect(), |(order, _, _)| order)
}

impl CholeskyFactor {
    /// Number of unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        self.sparse.columns.iter().map(|column| column.width).sum()
    }

    pub(super) fn panel(&self, column: &BlockColumn) -> &[f64] {
        &self.values[column.offset..][..column.width * column.height()]
    }

    /// The solution for a right-hand side with the blocks one after the other as they are numbered.
    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let SparseStructure { places, columns } = &*self.sparse;
        let mut found = self.sparse.ordered(right);
        for column in columns {
            for (c, values) in self.panel(column).chunks_exact(column.height()).enumerate() {
                let own = column.start + c;
                found[own] /= values[c];
                let factor = -found[own];
                add_scaled(&mut found[own + 1..column.start + column.width], factor, &values[c + 1..]);
                for (row, value) in self.sparse.unknowns_below(column).zip(&values[column.width..]) {
                    found[row] += factor * value;
                }
            }
        }
        for column in columns.iter().rev() {
            for (c, values) in self.panel(column).chunks_exact(column.height()).enumerate().rev() {
                let own = column.start + c;
                let rows = self.sparse.unknowns_below(column).zip(&values[column.width..]);
                let below: f64 = rows.map(|(row, value)| found[row] * value).sum();
                let beside = dot(&found[own + 1..column.start + column.width], &values[c + 1..column.width]);
                found[own] = (found[own] - below - beside) / values[c];
            }
        }
        let of_block = |&place: &usize| found[columns[place].start..][..columns[place].width].to_vec();
        places.iter().flat_map(of_block).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn solution_and_inverse_are_those_of_the_dense_matrix(
            sizes in proptest::collection::vec(1..4_usize, 1..12),
            pairs in proptest::collection::vec((0..12_usize, 0..12_usize), 0..25),
            seed in 0_u64..1000,
        ) {
            use rand::{Rng as _, SeedableRng as _};
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let count = sizes.len();
            let pairs: Vec<_> = pairs.iter().map(|(a, b)| (a % count, b % count)).filter(|(a, b)| a < b).collect::<BTreeSet<_>>().into_iter().collect();
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
                    values[at] += 40.0;
                    dense[(offset(block) + i, offset(block) + i)] += 40.0;
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
