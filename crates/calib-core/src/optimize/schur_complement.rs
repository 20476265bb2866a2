//! Normal equations in blocks: what touches few others is eliminated (Schur complement), the rest is
//! factored sparsely.

use std::collections::{BTreeSet, HashMap};

use nalgebra::DMatrix;

use crate::optimize::sparse_cholesky::{SelectedInverse, SparseStructure};

/// Which unknowns stand together, and which blocks have common residuals.
#[derive(Clone, Debug)]
pub(crate) struct BlockStructure {
    pub(crate) sizes: Vec<usize>,
    /// First unknown of every block.
    pub(crate) offsets: Vec<usize>,
    places: Vec<Role>,
    kept: Vec<usize>,
    eliminated: Vec<Eliminated>,
    /// Pairs of kept blocks, the first not behind the second.
    pairs: Vec<[usize; 2]>,
    pair_of: HashMap<[usize; 2], usize>,
    sparse: SparseStructure,
}

#[derive(Clone, Copy, Debug)]
enum Role {
    Kept(usize),
    Eliminated(usize),
}

#[derive(Clone, Debug)]
struct Eliminated {
    block: usize,
    /// Kept blocks that it shares residuals with.
    neighbours: Vec<usize>,
    /// Of every two neighbours, the first not behind the second.
    pairs: Vec<usize>,
}

/// Derivatives of one residual by the unknowns of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JacobianBlock<'a> {
    pub(crate) block: usize,
    pub(crate) by: &'a [f64],
}

/// Normal equations at a state.
#[derive(Clone, Debug)]
pub(crate) struct NormalEquations {
    pub(crate) cost: f64,
    pub(crate) gradient: Vec<f64>,
    /// For every pair of kept blocks, row by row.
    kept: Vec<Vec<f64>>,
    /// For every eliminated block.
    own: Vec<Vec<f64>>,
    /// For every eliminated block and its neighbours, rows by the eliminated one.
    cross: Vec<Vec<Vec<f64>>>,
}

impl BlockStructure {
    /// Blocks of these sizes, the flagged ones kept; `common` lists blocks that have residuals in
    /// common. Two eliminated blocks must have none.
    pub(crate) fn new(sizes: Vec<usize>, keep: &[bool], common: &[Vec<usize>]) -> Self {
        let mut offsets = vec![0; sizes.len()];
        for block in 1..sizes.len() {
            offsets[block] = offsets[block - 1] + sizes[block - 1];
        }
        let kept: Vec<usize> = (0..sizes.len()).filter(|&b| keep[b]).collect();
        let rest: Vec<usize> = (0..sizes.len()).filter(|&b| !keep[b]).collect();
        let mut places = vec![Role::Kept(0); sizes.len()];
        kept.iter().enumerate().for_each(|(i, &b)| places[b] = Role::Kept(i));
        rest.iter().enumerate().for_each(|(i, &b)| places[b] = Role::Eliminated(i));
        let mut neighbours: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); rest.len()];
        let mut coupled: BTreeSet<[usize; 2]> = (0..kept.len()).map(|i| [i, i]).collect();
        for group in common {
            let among: BTreeSet<usize> = group
                .iter()
                .filter_map(|&b| if let Role::Kept(i) = places[b] { Some(i) } else { None })
                .collect();
            coupled.extend(among.iter().flat_map(|&a| among.range(a..).map(move |&b| [a, b])));
            for &block in group {
                if let Role::Eliminated(i) = places[block] {
                    neighbours[i].extend(&among);
                }
            }
        }
        for near in &neighbours {
            coupled.extend(near.iter().flat_map(|&a| near.range(a..).map(move |&b| [a, b])));
        }
        let pairs: Vec<[usize; 2]> = coupled.into_iter().collect();
        let pair_of: HashMap<[usize; 2], usize> =
            pairs.iter().copied().enumerate().map(|(i, p)| (p, i)).collect();
        let among = |near: &BTreeSet<usize>| -> Vec<usize> {
            let both = near.iter().flat_map(|&a| near.range(a..).map(move |&b| [a, b]));
            both.filter_map(|pair| pair_of.get(&pair).copied()).collect()
        };
        let eliminated = rest
            .iter()
            .zip(&neighbours)
            .map(|(&block, near)| Eliminated {
                block,
                neighbours: near.iter().copied().collect(),
                pairs: among(near),
            })
            .collect();
        let kept_sizes = kept.iter().map(|&b| sizes[b]).collect();
        let sparse = SparseStructure::new(kept_sizes, pairs.iter().map(|&[a, b]| (a, b)));
        Self { sizes, offsets, places, kept, eliminated, pairs, pair_of, sparse }
    }

    /// Number of unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        self.sizes.iter().sum()
    }

    pub(crate) fn normal(&self) -> NormalEquations {
        let kept_size = |i: usize| self.sizes[self.kept[i]];
        NormalEquations {
            cost: 0.0,
            gradient: vec![0.0; self.unknowns()],
            kept: self.pairs.iter().map(|&[a, b]| vec![0.0; kept_size(a) * kept_size(b)]).collect(),
            own: self.eliminated.iter().map(|e| vec![0.0; self.sizes[e.block].pow(2)]).collect(),
            cross: self
                .eliminated
                .iter()
                .map(|e| {
                    e.neighbours.iter().map(|&n| vec![0.0; self.sizes[e.block] * kept_size(n)]).collect()
                })
                .collect(),
        }
    }

    /// Adds one residual.
    pub(crate) fn add(&self, normal: &mut NormalEquations, residual: f64, jacobian: &[JacobianBlock]) {
        normal.cost += residual * residual;
        for (k, a) in jacobian.iter().enumerate() {
            let offset = self.offsets[a.block];
            for (gradient, jacobian) in normal.gradient[offset..].iter_mut().zip(a.by) {
                *gradient += jacobian * residual;
            }
            for b in &jacobian[k..] {
                match (self.places[a.block], self.places[b.block]) {
                    (Role::Kept(i), Role::Kept(j)) => {
                        let (pair, rows, columns) =
                            if i <= j { ([i, j], a.by, b.by) } else { ([j, i], b.by, a.by) };
                        if let Some(&at) = self.pair_of.get(&pair) {
                            add_outer(&mut normal.kept[at], rows, columns);
                        }
                    }
                    (Role::Eliminated(i), Role::Eliminated(_)) => add_outer(&mut normal.own[i], a.by, b.by),
                    (Role::Eliminated(e), Role::Kept(i)) => self.add_cross(normal, [e, i], a.by, b.by),
                    (Role::Kept(i), Role::Eliminated(e)) => self.add_cross(normal, [e, i], b.by, a.by),
                }
            }
        }
    }

    fn add_cross(&self, normal: &mut NormalEquations, [e, i]: [usize; 2], rows: &[f64], columns: &[f64]) {
        if let Some(at) = self.eliminated[e].neighbours.iter().position(|&n| n == i) {
            add_outer(&mut normal.cross[e][at], rows, columns);
        }
    }

    /// The reduced matrix and right-hand side; `damping` multiplies the diagonal. With the inverse of
    /// every eliminated block's own matrix.
    fn reduced(&self, normal: &NormalEquations, damping: f64) -> (Vec<f64>, Vec<f64>, Vec<Vec<f64>>) {
        let mut values = self.sparse.zeros();
        for (&[a, b], block) in self.pairs.iter().zip(&normal.kept) {
            let mut block = block.clone();
            if a == b {
                grow_diagonal(&mut block, damping);
            }
            self.sparse.add(&mut values, [a, b], &block, 1.0);
        }
        let mut right: Vec<f64> =
            self.kept.iter().flat_map(|&b| self.of(&normal.gradient, b).iter().map(|g| -g)).collect();
        let starts = self.starts();
        let mut inverses = Vec::with_capacity(self.eliminated.len());
        for (e, out) in self.eliminated.iter().enumerate() {
            let size = self.sizes[out.block];
            let mut own = normal.own[e].clone();
            grow_diagonal(&mut own, damping);
            let inverse = inverse_of_few(&own, size);
            let weighed: Vec<Vec<f64>> =
                normal.cross[e].iter().map(|cross| product(&inverse, cross, size)).collect();
            let gradient = self.of(&normal.gradient, out.block);
            let mut pairs = out.pairs.iter();
            for (k, &a) in out.neighbours.iter().enumerate() {
                let width = self.sizes[self.kept[a]];
                for j in 0..width {
                    right[starts[a] + j] +=
                        (0..size).map(|i| weighed[k][i * width + j] * gradient[i]).sum::<f64>();
                }
                for l in k..out.neighbours.len() {
                    let (Some(&pair), other) = (pairs.next(), &normal.cross[e][l]) else { continue };
                    let block = transposed_product(&weighed[k], other, size);
                    self.sparse.add(&mut values, self.pairs[pair], &block, -1.0);
                }
            }
            inverses.push(inverse);
        }
        (values, right, inverses)
    }

    /// The step in every unknown and the gain that the linear model promises for it.
    pub(crate) fn step(&self, normal: &NormalEquations, damping: f64) -> Option<(Vec<f64>, f64)> {
        let (values, right, inverses) = self.reduced(normal, damping);
        let solution = self.sparse.factor(&values)?.solve(&right);
        let mut step = vec![0.0; self.unknowns()];
        let mut at = 0;
        for &block in &self.kept {
            let size = self.sizes[block];
            step[self.offsets[block]..][..size].copy_from_slice(&solution[at..at + size]);
            at += size;
        }
        for (e, out) in self.eliminated.iter().enumerate() {
            let size = self.sizes[out.block];
            let mut right: Vec<f64> = self.of(&normal.gradient, out.block).iter().map(|g| -g).collect();
            for (&n, cross) in out.neighbours.iter().zip(&normal.cross[e]) {
                let moved = &step[self.offsets[self.kept[n]]..][..self.sizes[self.kept[n]]];
                for (value, row) in right.iter_mut().zip(cross.chunks_exact(moved.len())) {
                    *value -= row.iter().zip(moved).map(|(c, m)| c * m).sum::<f64>();
                }
            }
            let solved = product(&inverses[e], &right, size);
            step[self.offsets[out.block]..][..size].copy_from_slice(&solved);
        }
        // Gain of the linear model under damping: step' (damping D step - gradient).
        let diagonal = self.diagonal(normal);
        let promised =
            (0..step.len()).map(|i| step[i] * (damping * diagonal[i] * step[i] - normal.gradient[i])).sum();
        Some((step, promised))
    }

    fn diagonal(&self, normal: &NormalEquations) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.unknowns()];
        for block in 0..self.sizes.len() {
            let size = self.sizes[block];
            let own = match self.places[block] {
                Role::Kept(i) => self.pair_of.get(&[i, i]).map(|&at| &normal.kept[at]),
                Role::Eliminated(e) => Some(&normal.own[e]),
            };
            for i in 0..size {
                diagonal[self.offsets[block] + i] = own.map_or(0.0, |own| own[i * size + i]);
            }
        }
        diagonal
    }

    fn of<'a>(&self, values: &'a [f64], block: usize) -> &'a [f64] {
        &values[self.offsets[block]..][..self.sizes[block]]
    }

    /// The covariance of blocks that have residuals in common.
    ///
    /// What the residuals leave open has a large variance, not an infinite one: its own information is
    /// raised by a share of `open` of the best that any residual gives it.
    pub(crate) fn covariance(&self, normal: NormalEquations, open: f64) -> Option<BlockCovariance> {
        let (mut values, _, own) = self.reduced(&normal, 0.0);
        for (i, &block) in self.kept.iter().enumerate() {
            let size = self.sizes[block];
            let Some(&at) = self.pair_of.get(&[i, i]) else { continue };
            let mut raised = vec![0.0; size * size];
            for k in 0..size {
                raised[k * size + k] = (open * normal.kept[at][k * size + k]).max(1e-18);
            }
            self.sparse.add(&mut values, [i, i], &raised, 1.0);
        }
        let inverse = self.sparse.factor(&values)?.inverse();
        Some(BlockCovariance { normal, own, inverse })
    }

    /// First row of every kept block in the reduced system.
    fn starts(&self) -> Vec<usize> {
        let mut starts = vec![0; self.kept.len()];
        for i in 1..self.kept.len() {
            starts[i] = starts[i - 1] + self.sizes[self.kept[i - 1]];
        }
        starts
    }
}

/// Covariance of blocks, as far as they have residuals in common.
#[derive(Debug)]
pub(crate) struct BlockCovariance {
    normal: NormalEquations,
    own: Vec<Vec<f64>>,
    inverse: SelectedInverse,
}

impl BlockCovariance {
    /// Of two blocks that are coupled and kept, or of one.
    ///
    /// Of an eliminated block with own matrix D and neighbours' cross matrices C:
    /// `D^-1 + D^-1 C Z C' D^-1`, and with a neighbour `-D^-1 C Z`.
    pub(crate) fn block(&self, blocks: &BlockStructure, a: usize, b: usize) -> DMatrix<f64> {
        match (blocks.places[a], blocks.places[b]) {
            (Role::Kept(i), Role::Kept(j)) => self.inverse.block(i, j),
            (Role::Eliminated(e), Role::Kept(i)) => -self.gain(blocks, e) * self.toward(blocks, e, i),
            (Role::Kept(i), Role::Eliminated(e)) => {
                -(self.gain(blocks, e) * self.toward(blocks, e, i)).transpose()
            }
            (Role::Eliminated(e), Role::Eliminated(other)) => {
                let size = blocks.sizes[a];
                if e != other {
                    return DMatrix::zeros(size, blocks.sizes[b]);
                }
                let gain = self.gain(blocks, e);
                let near = &blocks.eliminated[e].neighbours;
                let columns: Vec<DMatrix<f64>> = near.iter().map(|&n| self.toward(blocks, e, n)).collect();
                let mut found = DMatrix::from_row_slice(size, size, &self.own[e]);
                let mut at = 0;
                for column in columns {
                    let width = column.ncols();
                    found += &gain * column * gain.columns(at, width).transpose();
                    at += width;
                }
                found
            }
        }
    }

    /// `D^-1 C` over all neighbours.
    fn gain(&self, blocks: &BlockStructure, e: usize) -> DMatrix<f64> {
        let size = blocks.sizes[blocks.eliminated[e].block];
        let own = DMatrix::from_row_slice(size, size, &self.own[e]);
        let parts = self.normal.cross[e].iter().map(|c| DMatrix::from_row_slice(size, c.len() / size, c));
        let parts: Vec<DMatrix<f64>> = parts.collect();
        let width = parts.iter().map(DMatrix::ncols).sum();
        let mut all = DMatrix::zeros(size, width);
        let mut at = 0;
        for part in parts {
            all.columns_mut(at, part.ncols()).copy_from(&part);
            at += part.ncols();
        }
        own * all
    }

    /// Covariance of all neighbours of an eliminated block with one kept block.
    fn toward(&self, blocks: &BlockStructure, e: usize, kept: usize) -> DMatrix<f64> {
        let near = &blocks.eliminated[e].neighbours;
        let parts: Vec<DMatrix<f64>> = near.iter().map(|&n| self.inverse.block(n, kept)).collect();
        let height = parts.iter().map(DMatrix::nrows).sum();
        let width = blocks.sizes[blocks.kept[kept]];
        let mut all = DMatrix::zeros(height, width);
        let mut at = 0;
        for part in parts {
            all.rows_mut(at, part.nrows()).copy_from(&part);
            at += part.nrows();
        }
        all
    }
}

#[inline]
fn add_outer(matrix: &mut [f64], rows: &[f64], columns: &[f64]) {
    for (row, a) in matrix.chunks_exact_mut(columns.len()).zip(rows) {
        for (value, b) in row.iter_mut().zip(columns) {
            *value += a * b;
        }
    }
}

fn grow_diagonal(matrix: &mut [f64], damping: f64) {
    let size = matrix.len().isqrt();
    for i in 0..size {
        matrix[i * size + i] *= 1.0 + damping;
    }
}

/// Inverse of a small positive matrix by Gauss and Jordan, pivots down the diagonal; what nothing is
/// known of stays where it is: its row and column are 0.
fn inverse_of_few(matrix: &[f64], size: usize) -> Vec<f64> {
    /// Of the diagonal that was there: below it the pivot is rounding.
    const OPEN: f64 = 1e-13;
    let mut left = matrix.to_vec();
    let mut right: Vec<f64> = (0..size * size).map(|k| f64::from(u8::from(k / size == k % size))).collect();
    let mut is_open = vec![false; size];
    for k in 0..size {
        let pivot = left[k * size + k];
        if pivot.is_nan() || pivot <= OPEN * matrix[k * size + k] || pivot <= 0.0 {
            is_open[k] = true;
            continue;
        }
        for j in 0..size {
            left[k * size + j] /= pivot;
            right[k * size + j] /= pivot;
        }
        for i in (0..size).filter(|&i| i != k) {
            let factor = left[i * size + k];
            for j in 0..size {
                left[i * size + j] -= factor * left[k * size + j];
                right[i * size + j] -= factor * right[k * size + j];
            }
        }
    }
    for k in (0..size).filter(|&k| is_open[k]) {
        for i in 0..size {
            right[k * size + i] = 0.0;
            right[i * size + k] = 0.0;
        }
    }
    right
}

/// `A B` of a square and another matrix.
fn product(a: &[f64], b: &[f64], size: usize) -> Vec<f64> {
    let width = b.len() / size;
    let mut found = vec![0.0; b.len()];
    for i in 0..size {
        for k in 0..size {
            let factor = a[i * size + k];
            for j in 0..width {
                found[i * width + j] += factor * b[k * width + j];
            }
        }
    }
    found
}

/// `A' B` of two matrices of `height` rows.
fn transposed_product(a: &[f64], b: &[f64], height: usize) -> Vec<f64> {
    let (rows, columns) = (a.len() / height, b.len() / height);
    let mut found = vec![0.0; rows * columns];
    for k in 0..height {
        for i in 0..rows {
            let factor = a[k * rows + i];
            for j in 0..columns {
                found[i * columns + j] += factor * b[k * columns + j];
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn elimination_changes_neither_the_step_nor_the_covariance(
            kept in proptest::collection::vec(1..4_usize, 1..6),
            rest in proptest::collection::vec((1..4_usize, 0..6_usize, 0..6_usize), 0..8),
            seed in 0_u64..1000, damping in 0.0..1.0_f64,
        ) {
            use rand::{Rng as _, SeedableRng as _};
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let count = kept.len();
            let sizes: Vec<usize> = kept.iter().copied().chain(rest.iter().map(|r| r.0)).collect();
            let keep: Vec<bool> = (0..sizes.len()).map(|i| i < count).collect();
            let mut common: Vec<Vec<usize>> = rest.iter().enumerate().map(|(i, r)| {
                BTreeSet::from([r.1 % count, r.2 % count, count + i]).into_iter().collect()
            }).collect();
            common.extend((0..count).map(|i| vec![i]));
            let blocks = BlockStructure::new(sizes.clone(), &keep, &common);
            let total = blocks.unknowns();
            let mut normal = blocks.normal();
            let (mut square, mut gradient) = (DMatrix::zeros(total, total), DVector::zeros(total));
            for group in &common {
                for _ in 0..12 {
                    let jacobian: Vec<Vec<f64>> = group.iter().map(|&b| (0..sizes[b]).map(|_| random.random_range(-1.0..1.0)).collect()).collect();
                    let residual: f64 = random.random_range(-1.0..1.0);
                    let by: Vec<JacobianBlock> = group.iter().zip(&jacobian).map(|(&block, by)| JacobianBlock { block, by }).collect();
                    blocks.add(&mut normal, residual, &by);
                    let mut row = DVector::zeros(total);
                    for (&b, jacobian) in group.iter().zip(&jacobian) {
                        row.rows_mut(blocks.offsets[b], sizes[b]).copy_from_slice(jacobian);
                    }
                    square += &row * row.transpose();
                    gradient += row * residual;
                }
            }
            let mut damped = square.clone();
            for i in 0..total {
                damped[(i, i)] *= 1.0 + damping;
            }
            let exact = -(damped.cholesky().unwrap().solve(&gradient));
            let (step, _) = blocks.step(&normal, damping).unwrap();
            for (found, exact) in step.iter().zip(exact.iter()) {
                prop_assert!((found - exact).abs() < 1e-9, "{found} not {exact}");
            }
            let exact = square.cholesky().unwrap().inverse();
            let covariance = blocks.covariance(normal.clone(), 0.0).unwrap();
            for group in &common {
                for &a in group {
                    for &b in group {
                        let found = covariance.block(&blocks, a, b);
                        let exact = exact.view((blocks.offsets[a], blocks.offsets[b]), (sizes[a], sizes[b]));
                        prop_assert!((found - exact).amax() < 1e-9);
                    }
                }
            }
        }
    }
}
