//! A sparse symmetric positive definite system in blocks: its solution, and the blocks of its inverse.
//!
//! The blocks are ordered for little fill by approximate minimum degree (Amestoy, Davis and Duff 1996), and
//! `nalgebra-sparse` factors the matrix, `S = L L'`.
//!
//! Of the inverse `Z = S^-1` only the entries where L has some are computed, the selected inverse (Takahashi,
//! Fagan and Chen 1973; Erisman and Tinney 1975). `S Z = I` is `L' Z = L^-1`, and L^-1 is lower triangular
//! with `1 / L_jj` on its diagonal; so, for i >= j, row j of `L' Z` reads
//!
//! `L_jj Z_ij + sum_{k > j} L_kj Z_ik = (i = j ? 1 / L_jj : 0)`,
//!
//! and the columns of Z follow from the last to the first:
//!
//! - `Z_ij = -sum_{k > j} L_kj Z_ik / L_jj` for i > j,
//! - `Z_jj = (1 / L_jj - sum_{k > j} L_kj Z_kj) / L_jj`.
//!
//! Both i and k run over the rows of column j of L, and any two rows i >= k > j of a column are an entry of L
//! themselves (elimination of j fills it in): whatever a sum asks for is there. The cost grows with the
//! factor, not with the square of the size. The covariance of coupled cameras lies within the pattern, for
//! that of S does.

use std::collections::{BTreeSet, HashMap};

use nalgebra::DMatrix;
use nalgebra_sparse::factorization::{CscCholesky, CscSymbolicCholesky};
use nalgebra_sparse::pattern::SparsityPattern;

/// The pattern of a matrix of blocks, columns in the order of the factor, rows in every column ascending.
#[derive(Clone, Debug)]
pub(crate) struct SparseStructure {
    sizes: Vec<usize>,
    /// First row of every block in the order of the factor.
    starts: Vec<usize>,
    /// First value of every column.
    columns: Vec<usize>,
    /// Of the rows of the first block, the number of entries above them in the columns of the second.
    row_offsets: HashMap<(usize, usize), usize>,
    symbolic: CscSymbolicCholesky,
}

/// The factor L of one matrix.
#[derive(Debug)]
pub(crate) struct CholeskyFactor<'a> {
    sparse: &'a SparseStructure,
    cholesky: CscCholesky<f64>,
}

/// The inverse where the factor has entries.
#[derive(Debug)]
pub(crate) struct SelectedInverse {
    sizes: Vec<usize>,
    starts: Vec<usize>,
    pattern: SparsityPattern,
    values: Vec<f64>,
}

impl SparseStructure {
    /// The structure of a matrix of blocks of these sizes that couples these pairs of blocks.
    pub(crate) fn new(sizes: Vec<usize>, pairs: impl Iterator<Item = (usize, usize)>) -> Self {
        let count = sizes.len();
        let mut neighbours: Vec<BTreeSet<usize>> = (0..count).map(|block| BTreeSet::from([block])).collect();
        for (a, b) in pairs {
            neighbours[a].insert(b);
            neighbours[b].insert(a);
        }
        let order = order(&neighbours);
        let mut rank = vec![0; count];
        let mut starts = vec![0; count];
        let mut total = 0;
        for (place, &block) in order.iter().enumerate() {
            rank[block] = place;
            starts[block] = total;
            total += sizes[block];
        }
        let mut row_offsets = HashMap::new();
        let (mut columns, mut rows) = (vec![0], Vec::new());
        for &block in &order {
            let mut coupled: Vec<usize> = neighbours[block].iter().copied().collect();
            coupled.sort_by_key(|&other| rank[other]);
            let mut height = 0;
            for &other in &coupled {
                row_offsets.insert((other, block), height);
                height += sizes[other];
            }
            for _ in 0..sizes[block] {
                rows.extend(coupled.iter().flat_map(|&o| starts[o]..starts[o] + sizes[o]));
                columns.push(rows.len());
            }
        }
        // Offsets ascend and every column's rows do, by construction.
        let pattern = SparsityPattern::try_from_offsets_and_indices(total, total, columns.clone(), rows)
            .unwrap_or_else(|_| SparsityPattern::zeros(total, total));
        Self { sizes, starts, columns, row_offsets, symbolic: CscSymbolicCholesky::factor(pattern) }
    }

    /// Room for the values of a matrix.
    pub(crate) fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.columns.last().copied().unwrap_or(0)]
    }

    /// Adds `factor` times a block, row by row, and its transpose on the other side of the diagonal.
    pub(crate) fn add(&self, values: &mut [f64], [a, b]: [usize; 2], block: &[f64], factor: f64) {
        let width = self.sizes[b];
        let (Some(&above), Some(&left)) = (self.row_offsets.get(&(a, b)), self.row_offsets.get(&(b, a)))
        else {
            return;
        };
        for (i, row) in block.chunks_exact(width).enumerate() {
            for (j, value) in row.iter().enumerate() {
                values[self.columns[self.starts[b] + j] + above + i] += factor * value;
                if a != b {
                    values[self.columns[self.starts[a] + i] + left + j] += factor * value;
                }
            }
        }
    }

    /// `None` when the matrix is not positive definite.
    pub(crate) fn factor(&self, values: &[f64]) -> Option<CholeskyFactor<'_>> {
        let cholesky = CscCholesky::factor_numerical(self.symbolic.clone(), values).ok()?;
        Some(CholeskyFactor { sparse: self, cholesky })
    }
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

impl CholeskyFactor<'_> {
    /// The solution for a right-hand side with the blocks one after the other as they are numbered.
    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let SparseStructure { sizes, starts, .. } = self.sparse;
        let mut ordered = DMatrix::zeros(right.len(), 1);
        let mut offset = 0;
        for (&size, &start) in sizes.iter().zip(starts) {
            ordered.as_mut_slice()[start..start + size].copy_from_slice(&right[offset..offset + size]);
            offset += size;
        }
        self.cholesky.solve_mut(&mut ordered);
        let blocks = sizes.iter().zip(starts);
        blocks.flat_map(|(&size, &start)| ordered.as_slice()[start..start + size].to_vec()).collect()
    }

    /// The inverse, where the factor has entries.
    pub(crate) fn inverse(self) -> SelectedInverse {
        let SparseStructure { sizes, starts, .. } = self.sparse;
        let factor = self.cholesky.take_l();
        let (pattern, lower) = factor.into_pattern_and_values();
        let size = pattern.major_dim();
        let offsets = pattern.major_offsets();
        let rows = pattern.minor_indices();
        let mut values = vec![0.0; lower.len()];
        let mut sums = Vec::new();
        for j in (0..size).rev() {
            let below = offsets[j] + 1..offsets[j + 1];
            let (column, weights) = (&rows[below.clone()], &lower[below.clone()]);
            sums.clear();
            sums.resize(column.len(), 0.0);
            for (k, &row) in column.iter().enumerate() {
                // The rows of this column below are rows of that column, too; both are sorted.
                let theirs = offsets[row]..offsets[row + 1];
                let mut entries = rows[theirs.clone()].iter().zip(&values[theirs]);
                let mut own = 0.0;
                for (i, &wanted) in column.iter().enumerate().skip(k) {
                    let Some((_, value)) = entries.find(|(at, _)| **at == wanted) else { break };
                    sums[i] += weights[k] * value;
                    if i > k {
                        own += weights[i] * value;
                    }
                }
                sums[k] += own;
            }
            let diagonal = lower[offsets[j]];
            let own: f64 = weights.iter().zip(&sums).map(|(weight, sum)| weight * -sum / diagonal).sum();
            values[offsets[j]] = (diagonal.recip() - own) / diagonal;
            for (value, sum) in values[below].iter_mut().zip(&sums) {
                *value = -sum / diagonal;
            }
        }
        SelectedInverse { sizes: sizes.clone(), starts: starts.clone(), pattern, values }
    }
}

impl SelectedInverse {
    /// A block, row by row; zeros for two blocks that nothing couples.
    pub(crate) fn block(&self, a: usize, b: usize) -> DMatrix<f64> {
        let Self { sizes, starts, .. } = self;
        DMatrix::from_fn(sizes[a], sizes[b], |i, j| self.at(starts[a] + i, starts[b] + j))
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        let (row, column) = (i.max(j), i.min(j));
        let offset = self.pattern.major_offsets()[column];
        self.pattern.lane(column).binary_search(&row).map_or(0.0, |place| self.values[offset + place])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
            let sparse = SparseStructure::new(sizes.clone(), pairs.iter().copied());
            let offset = |block: usize| sizes[..block].iter().sum::<usize>();
            let total = offset(count);
            let mut dense = DMatrix::zeros(total, total);
            let mut values = sparse.zeros();
            for &(a, b) in &pairs {
                let block: Vec<f64> = (0..sizes[a] * sizes[b]).map(|_| random.random_range(-1.0..1.0)).collect();
                sparse.add(&mut values, [a, b], &block, 1.0);
                for i in 0..sizes[a] {
                    for j in 0..sizes[b] {
                        dense[(offset(a) + i, offset(b) + j)] += block[i * sizes[b] + j];
                        dense[(offset(b) + j, offset(a) + i)] += block[i * sizes[b] + j];
                    }
                }
            }
            // More than the sum of what stands beside it: positive.
            for block in 0..count {
                let mut diagonal = vec![0.0; sizes[block] * sizes[block]];
                for i in 0..sizes[block] {
                    diagonal[i * sizes[block] + i] = 40.0;
                    dense[(offset(block) + i, offset(block) + i)] += 40.0;
                }
                sparse.add(&mut values, [block, block], &diagonal, 1.0);
            }
            let right: Vec<f64> = (0..total).map(|_| random.random_range(-1.0..1.0)).collect();
            let expected = dense.clone().cholesky().unwrap();
            let factor = sparse.factor(&values).unwrap();
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
