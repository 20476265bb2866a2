//! Sparse Cholesky factorisation of a symmetric positive definite matrix of blocks: pattern, factor and
//! solution.
//!
//! # Pattern
//!
//! The pattern is the set of blocks of the factor that are not zero. The blocks of the matrix are ordered for
//! little fill by approximate minimum degree (Amestoy, Davis and Duff 1996). In this order, the rows of a
//! block are the union of two sets. The first contains the rows of the matrix below the diagonal of the
//! block. The second contains the rows of every block whose first row below the diagonal is this block (Davis
//! 2006, "Direct Methods for Sparse Linear Systems", section 4.1). Consecutive blocks with the same further
//! rows form a supernode (Liu, Ng and Peyton 1993, "On Finding Supernodes for Sparse Matrix Computations").
//!
//! Matrix, factor and inverse have the same layout: a dense panel for every supernode. The columns of a panel
//! are the parameters of the supernode. Its rows are the rows of the supernode, its own blocks first. It is
//! stored column by column.
//!
//! # Factor
//!
//! The factor L of the matrix `S = L L'` is computed in place, supernode by supernode. Let R be the rows of
//! supernode j below its own blocks. The panel of j is replaced by `[L_jj; L_Rj]` with
//! `L_Rj = S_Rj L_jj'^-1`. Then `L_Rj L_Rj'` is subtracted from the panels of the supernodes that own R.
//! Unlike a factorisation of single entries, this method works on dense panels (Ng and Peyton 1993, "Block
//! Sparse Cholesky Algorithms on Advanced Uniprocessor Computers").

use std::ops::Range;
use std::sync::Arc;

use crate::camera::dispatch;
use crate::optimize::dense::{Packed, Part, Product};

/// Pattern of the factor of a matrix of blocks.
#[derive(Clone, Debug)]
pub(crate) struct SparseStructure {
    /// Position of every block in the elimination order.
    positions: Vec<usize>,
    /// Index of the first parameter of the block at each position of the elimination order; the last entry is the
    /// total number of parameters.
    pub(super) starts: Vec<usize>,
    /// Index of the supernode that contains each position in the order of the factor.
    owners: Vec<usize>,
    /// Supernodes, in the order of the factor.
    pub(super) supernodes: Vec<Supernode>,
}

/// Supernode: consecutive blocks, in the order of the factor, with the same rows of the factor below them.
#[derive(Clone, Debug)]
pub(super) struct Supernode {
    /// Number of parameters: columns of the panel.
    pub(super) width: usize,
    /// Offset of the panel of this supernode among the values of the matrix.
    pub(super) offset: usize,
    /// Number of blocks of this supernode.
    pub(super) blocks: usize,
    /// Block rows of the panel, as ascending positions in the order of the factor. The blocks of the
    /// supernode itself come first.
    pub(super) rows: Vec<usize>,
    /// Index of the first panel row of each block row; the last entry is the number of rows of the panel.
    pub(super) tops: Vec<usize>,
}

/// Location of the submatrix of a pair of blocks in the array of stored values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    /// Index of the first value of the submatrix.
    offset: usize,
    /// Offset between consecutive columns of the panel, in values; equal to its number of rows.
    stride: usize,
    /// Whether the submatrix is stored transposed. If so, the panel columns belong to the second block; otherwise
    /// to the first.
    is_transposed: bool,
}

impl Entry {
    /// Returns the index of the value for a row of the first block and a column of the second block.
    #[inline]
    pub(super) fn at(self, row: usize, column: usize) -> usize {
        let (across, down) = if self.is_transposed { (column, row) } else { (row, column) };
        self.offset + across * self.stride + down
    }

    /// Adds a matrix with `width` columns, stored row by row, to this submatrix of `values`.
    pub(crate) fn add(self, values: &mut [f64], matrix: &[f64], width: usize) {
        for (i, row) in matrix.chunks_exact(width).enumerate() {
            for (j, value) in row.iter().enumerate() {
                values[self.at(i, j)] += value;
            }
        }
    }

    /// Adds an outer product to this submatrix of `values`: `factor` times a column of the first block times
    /// a row of the second block.
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
    /// Creates the pattern of a matrix of blocks. `sizes` contains the number of parameters of every block,
    /// at least 1. `pairs` contains the pairs of coupled blocks, whose submatrix is not zero.
    pub(crate) fn new(sizes: &[usize], pairs: impl Iterator<Item = [usize; 2]>) -> Arc<Self> {
        let mut neighbours: Vec<Vec<usize>> = (0..sizes.len()).map(|block| vec![block]).collect();
        for [a, b] in pairs {
            neighbours[a].push(b);
            neighbours[b].push(a);
        }
        neighbours.iter_mut().for_each(sort_and_dedup);
        let order = order_for_little_fill(&neighbours);
        let mut places = vec![0; sizes.len()];
        order.iter().enumerate().for_each(|(place, &block)| places[block] = place);
        let starts = running_sums(order.iter().map(|&block| sizes[block]));
        let rows = factor_rows(&neighbours, &order, &places);
        let mut owners = Vec::with_capacity(sizes.len());
        let mut supernodes: Vec<Supernode> = Vec::new();
        for places in supernode_positions(&rows, &starts) {
            owners.resize(places.end, supernodes.len());
            let offset = supernodes.last().map_or(0, Supernode::end);
            supernodes.push(Supernode::new(places.len(), &rows[places.start], &starts, offset));
        }
        Arc::new(Self { positions: places, starts, owners, supernodes })
    }

    /// Returns the values of a zero matrix with this pattern.
    pub(crate) fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.supernodes.last().map_or(0, Supernode::end)]
    }

    /// Returns the number of parameters of all blocks.
    pub(super) fn unknowns(&self) -> usize {
        self.starts[self.blocks()]
    }

    /// Returns the number of parameters of a block.
    pub(super) fn size(&self, block: usize) -> usize {
        let place = self.positions[block];
        self.starts[place + 1] - self.starts[place]
    }

    /// Returns the index of the first parameter of a block, in the order of the factor.
    pub(super) fn start(&self, block: usize) -> usize {
        self.starts[self.positions[block]]
    }

    /// Returns the number of blocks.
    pub(super) fn blocks(&self) -> usize {
        self.positions.len()
    }

    /// Returns the location of the submatrix of a pair of blocks in the array of stored values; `None` if it is
    /// outside the pattern.
    pub(crate) fn entry(&self, [a, b]: [usize; 2]) -> Option<Entry> {
        let (first, second) = (self.positions[a], self.positions[b]);
        let supernode = &self.supernodes[self.owners[first.min(second)]];
        let row = supernode.rows.binary_search(&first.max(second)).ok()?;
        let column = supernode.tops[first.min(second) - supernode.rows[0]];
        let stride = supernode.height();
        let offset = supernode.offset + column * stride + supernode.tops[row];
        Some(Entry { offset, stride, is_transposed: second < first })
    }

    /// Iterates over the indices, in the array of stored values, of the diagonal entries of a block.
    pub(crate) fn diagonal(&self, block: usize) -> impl Iterator<Item = usize> + use<> {
        let supernode = &self.supernodes[self.owners[self.positions[block]]];
        let first = supernode.tops[self.positions[block] - supernode.rows[0]];
        let (offset, step) = (supernode.offset, supernode.height() + 1);
        (first..first + self.size(block)).map(move |i| offset + i * step)
    }

    /// Iterates over the supernodes that own the rows below a supernode. Each item contains the supernode,
    /// and the range of its block rows in the panel of the given supernode.
    pub(super) fn targets<'a>(
        &'a self,
        supernode: &'a Supernode,
    ) -> impl Iterator<Item = (&'a Supernode, [usize; 2])> + 'a {
        let mut k = supernode.blocks;
        std::iter::from_fn(move || {
            let owner = self.owners[*supernode.rows.get(k)?];
            let first = k;
            k += supernode.rows[k..].iter().take_while(|&&row| self.owners[row] == owner).count();
            Some((&self.supernodes[owner], [first, k]))
        })
    }
}

impl Supernode {
    /// Creates a supernode with the given number of blocks. `rows` are the block rows of its first block,
    /// `starts` the first parameter of every position, and `offset` the offset of its panel.
    fn new(blocks: usize, rows: &[usize], starts: &[usize], offset: usize) -> Self {
        let tops = running_sums(rows.iter().map(|&row| starts[row + 1] - starts[row]));
        Self { width: tops[blocks], offset, blocks, rows: rows.to_vec(), tops }
    }

    /// Returns the number of rows of the panel.
    pub(super) fn height(&self) -> usize {
        self.tops[self.rows.len()]
    }

    /// Returns the end of the panel among the values of the matrix.
    pub(super) fn end(&self) -> usize {
        self.offset + self.width * self.height()
    }

    /// Returns the columns of the panel for one of the blocks of this supernode. `place` is the position of
    /// the block in the order of the factor.
    pub(super) fn columns(&self, place: usize) -> Range<usize> {
        let own = place - self.rows[0];
        self.tops[own]..self.tops[own + 1]
    }

    /// Iterates over the rows of this panel from block row `k` on, in runs that are contiguous in the panel
    /// `other` too. The other panel must contain all of these rows. Each item contains the first row of a run
    /// in this panel, its first row in the other panel, and its number of rows.
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
}

/// Returns the block rows of the factor for every position, in ascending order. The first row is the position
/// itself. `places` contains the position of every block, `order` the block at every position.
fn factor_rows(neighbours: &[Vec<usize>], order: &[usize], places: &[usize]) -> Vec<Vec<usize>> {
    let mut rows: Vec<Vec<usize>> = vec![Vec::new(); order.len()];
    for (place, &block) in order.iter().enumerate() {
        let mut own = std::mem::take(&mut rows[place]);
        own.extend(neighbours[block].iter().map(|&other| places[other]).filter(|&other| other >= place));
        sort_and_dedup(&mut own);
        if let [_, parent, others @ ..] = &own[..] {
            rows[*parent].extend(others);
        }
        rows[place] = own;
    }
    rows
}

/// Sorts a list and removes duplicates.
pub(super) fn sort_and_dedup<T: Ord>(list: &mut Vec<T>) {
    list.sort_unstable();
    list.dedup();
}

/// Returns the ranges of positions that form supernodes. In a range, each position is the first row below the
/// previous position and has all other rows of the previous position.
fn supernode_positions(rows: &[Vec<usize>], starts: &[usize]) -> Vec<Range<usize>> {
    /// Maximum number of parameters of a supernode. With this limit, the work within a panel is small
    /// compared with the updates of other panels.
    const MAX_WIDTH: usize = 56;
    let mut found: Vec<Range<usize>> = Vec::new();
    for (place, own) in rows.iter().enumerate() {
        let follows = |last: &Range<usize>| {
            let before = &rows[place - 1];
            before.get(1) == Some(&place)
                && before.len() == own.len() + 1
                && starts[place + 1] - starts[last.start] <= MAX_WIDTH
        };
        match found.last_mut() {
            Some(last) if follows(last) => last.end = place + 1,
            _ => found.push(place..place + 1),
        }
    }
    found
}

/// Returns the running sums of the sizes: for each size the sum of the sizes before it, then the total.
pub(super) fn running_sums(sizes: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sums = vec![0];
    let mut end = 0;
    sums.extend(sizes.map(|size| {
        end += size;
        end
    }));
    sums
}

/// Computes an elimination order with little fill, by approximate minimum degree. Returns the index of the block at
/// each position.
fn order_for_little_fill(neighbours: &[Vec<usize>]) -> Vec<usize> {
    let mut offsets = vec![0];
    let mut rows = Vec::new();
    for others in neighbours {
        rows.extend(others);
        offsets.push(rows.len());
    }
    let found = amd::order::<usize>(neighbours.len(), &offsets, &rows, &amd::Control::default());
    // The pattern is valid by construction. The original order would also be correct, only slower.
    found.map_or_else(|_| (0..neighbours.len()).collect(), |(order, _, _)| order)
}

/// Cholesky factor L of a sparse matrix `S = L L'`.
#[derive(Clone, Debug)]
pub(crate) struct CholeskyFactor {
    /// Pattern of the factor.
    pub(super) sparse: Arc<SparseStructure>,
    /// Values of the factor, panel by panel.
    pub(super) values: Vec<f64>,
}

impl SparseStructure {
    /// Computes the Cholesky factor of the matrix with the given values. Returns `None` if the matrix is not
    /// positive definite. Only the upper triangle of each diagonal block is read.
    pub(crate) fn factor(self: &Arc<Self>, mut values: Vec<f64>) -> Option<CholeskyFactor> {
        self.factor_in_place(&mut values)?;
        Some(CholeskyFactor { sparse: Arc::clone(self), values })
    }

    /// Replaces the values of a matrix by the values of its Cholesky factor. Returns `None` if the matrix is
    /// not positive definite.
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
                supernode.subtract_product(&product, [k, end], target, values);
            }
        }
        Some(())
    }
}

impl Supernode {
    /// Subtracts the product `L_Rj L_Tj'` from the panel `values` of the supernode `target`. T are the block
    /// rows from `k` to `end` of this supernode j, which are the columns of the target. R are the rows from
    /// block row `k` on.
    fn subtract_product(&self, product: &Product, [k, end]: [usize; 2], target: &Self, values: &mut [f64]) {
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

/// Adds `factor` times `values` to the vector `to`.
#[inline(always)]
pub(super) fn add_scaled(to: &mut [f64], factor: f64, values: &[f64]) {
    for (to, value) in to.iter_mut().zip(values) {
        *to += factor * value;
    }
}

/// Returns the dot product of two vectors. The sum has eight independent parts, for vector instructions.
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

/// Factors one panel: replaces `[S_jj; S_Rj]` by `[L_jj; S_Rj L_jj'^-1]`. Returns `None` if `S_jj` is not
/// positive definite.
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

/// Subtracts multiples of columns from the column `to`, which starts at row `top`. Each column is multiplied
/// by its value in row `top`.
#[inline(always)]
fn subtract_columns(to: &mut [f64], columns: &[f64], height: usize, top: usize) {
    // Four columns are subtracted in one pass, so that the target is loaded and stored only once.
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
    /// Returns the number of parameters of all blocks.
    pub(crate) fn unknowns(&self) -> usize {
        self.sparse.unknowns()
    }

    /// Returns the panel of a supernode, column by column.
    pub(super) fn panel(&self, supernode: &Supernode) -> &[f64] {
        &self.values[supernode.offset..supernode.end()]
    }

    /// Solves `S x = right`. The blocks of both vectors are in the original order, not in the order of the
    /// factor.
    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut found = self.sparse.to_factor_order(right);
        dispatch(
            #[inline(always)]
            || self.solve_in_place(&mut found),
        );
        self.sparse.to_original_order(&found)
    }

    /// Replaces a right-hand side, in the order of the factor, by the solution.
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
                let within = dot(&own[c + 1..], &column[c + 1..supernode.width]);
                own[c] = (own[c] - within - dot(&below, &column[supernode.width..])) / column[c];
            }
        }
    }
}

impl SparseStructure {
    /// Permutes the values of all parameters from the original order to the order of the factor.
    fn to_factor_order(&self, values: &[f64]) -> Vec<f64> {
        let mut ordered = vec![0.0; values.len()];
        let mut rest = values;
        for block in 0..self.blocks() {
            let (own, others) = rest.split_at(self.size(block));
            ordered[self.start(block)..][..own.len()].copy_from_slice(own);
            rest = others;
        }
        ordered
    }

    /// Permutes the values of all parameters from the order of the factor to the original order.
    fn to_original_order(&self, ordered: &[f64]) -> Vec<f64> {
        let mut values = Vec::with_capacity(ordered.len());
        for block in 0..self.blocks() {
            values.extend_from_slice(&ordered[self.start(block)..][..self.size(block)]);
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use nalgebra::DMatrix;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn solution_and_inverse_agree_with_the_dense_matrix(
            // Most blocks are small, and some are wider than the maximum of a supernode.
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
            // The diagonal exceeds the sum of the other values of its row, so the matrix is positive
            // definite.
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
