//! Elimination of parameter blocks by the Schur complement: the reduced system, the step and the covariance.
//!
//! Landmarks and nuisance parameters of stage 1 are numerous. Each is coupled with a few cameras, and with no
//! other landmark or nuisance block. Let `y` be the steps of the kept parameters (cameras, shared lenses),
//! and `z` the steps of the eliminated parameters. With the residuals r and their Jacobians `J_y` and `J_z`,
//! the normal equations are
//!
//! ```text
//! [ A   C' ] [ y ]   [ a ]      A: kept blocks            a = -J_y' r
//! [ C   D  ] [ z ] = [ b ]      D: eliminated blocks      b = -J_z' r
//! ```
//!
//! D is block diagonal, and its small blocks are inverted separately. Elimination of
//! `z = D^-1 (b - C y)` gives the reduced system
//!
//! `(A - C' D^-1 C) y = a - C' D^-1 b`.
//!
//! Its matrix S is the Schur complement of D. The block of S for the cameras i and j is
//! `A_ij - sum_e C_ei' D_e^-1 C_ej` over the landmarks e that both observe. S is as sparse as the view graph,
//! and is factored by sparse Cholesky. S and D are positive definite exactly if the whole matrix is (Triggs
//! et al. 1999, "Bundle Adjustment - A Modern Synthesis", section 6).
//!
//! With the damping lambda, the diagonals of A and D are first multiplied by `1 + lambda`.
//!
//! The covariance is the inverse of the whole matrix and has the same structure. With `Z = S^-1` and
//! `G = D^-1 C`, its blocks are
//!
//! - kept with kept: `Z`;
//! - eliminated with kept: `-G Z`;
//! - eliminated with itself: `D^-1 + G Z G'`.
//!
//! Only the blocks of Z for neighbours of the same eliminated block and for coupled cameras are needed. The
//! selected inverse contains all of them. The covariance of cameras without a direct coupling is computed on
//! request, by one solution for each column.

use std::collections::HashMap;

use nalgebra::DMatrix;

use crate::camera::dispatch;
use crate::optimize::block_structure::{BlockStructure, Eliminated, NormalEquations, Role};
use crate::optimize::dense::{damp_diagonal, product, pseudo_invert};
use crate::optimize::selected_inverse::SelectedInverse;
use crate::optimize::sparse_cholesky::running_sums;

/// Reduced system of the kept blocks.
struct Reduced {
    /// Matrix S, in the layout of its Cholesky factor.
    values: Vec<f64>,
    /// Right-hand side `a - C' D^-1 b`.
    right: Vec<f64>,
    /// Inverse `D^-1` of the diagonal matrix of every eliminated block, in the layout of
    /// [`NormalEquations::own`].
    inverses: Vec<f64>,
}

impl BlockStructure {
    /// Returns the reduced system of the kept blocks. The diagonals of A and D are multiplied by
    /// `1 + damping`.
    fn reduced(&self, normal: &NormalEquations, damping: f64) -> Reduced {
        dispatch(
            #[inline(always)]
            || self.reduce(normal, damping),
        )
    }

    /// Computes the reduced system; see [`Self::reduced`], which calls it with vector instructions.
    #[inline(always)]
    fn reduce(&self, normal: &NormalEquations, damping: f64) -> Reduced {
        let mut values = self.sparse.zeros();
        for coupled in &self.coupled {
            coupled.entry.add(&mut values, &normal.kept[coupled.at.clone()], coupled.width);
        }
        for block in 0..self.kept.len() {
            self.sparse.diagonal(block).for_each(|at| values[at] *= 1.0 + damping);
        }
        let right: Vec<f64> = self
            .kept
            .iter()
            .flat_map(|&b| self.block_values(&normal.gradient, b).iter().map(|g| -g))
            .collect();
        let mut reduced = Reduced { values, right, inverses: normal.own.clone() };
        let (starts, mut weighed) = (self.row_starts(), Vec::new());
        for out in &self.eliminated {
            let own = &mut reduced.inverses[self.diagonal_range(out)];
            damp_diagonal(own, damping);
            pseudo_invert(own, self.sizes[out.block]);
            self.eliminate_block(normal, out, &starts, (&mut reduced, &mut weighed));
        }
        reduced
    }

    /// Eliminates one block: subtracts its `C' D^-1 C` from the reduced matrix, and adds `C' D^-1` times its
    /// gradient to the right-hand side. `starts` contains the first row of every kept block. `weighed` is a
    /// buffer for the product of D^-1 and C.
    #[inline(always)]
    fn eliminate_block(
        &self,
        normal: &NormalEquations,
        out: &Eliminated,
        starts: &[usize],
        (reduced, weighed): (&mut Reduced, &mut Vec<f64>),
    ) {
        let size = self.sizes[out.block];
        let gradient = self.block_values(&normal.gradient, out.block);
        let mut entries = out.entries.iter();
        for (k, &a) in out.neighbours.iter().enumerate() {
            product(
                &reduced.inverses[self.diagonal_range(out)],
                &normal.cross[out.cross_range(k)],
                size,
                weighed,
            );
            let width = self.sizes[self.kept[a]];
            for j in 0..width {
                let sum: f64 = (0..size).map(|i| weighed[i * width + j] * gradient[i]).sum();
                reduced.right[starts[a] + j] += sum;
            }
            for (other, entry) in (k..out.neighbours.len()).zip(&mut entries) {
                let other = &normal.cross[out.cross_range(other)];
                let rows = weighed.chunks_exact(width).zip(other.chunks_exact(other.len() / size));
                rows.for_each(|(a, b)| entry.add_outer(&mut reduced.values, -1.0, a, b));
            }
        }
    }

    /// Returns the damped step of all parameters, and the decrease of the cost that the linear model
    /// predicts. Returns `None` if the reduced matrix is not positive definite.
    pub(crate) fn step(&self, normal: &NormalEquations, damping: f64) -> Option<(Vec<f64>, f64)> {
        let Reduced { values, right, inverses } = self.reduced(normal, damping);
        let solution = self.sparse.factor(values)?.solve(&right);
        let mut step = vec![0.0; self.unknowns()];
        let mut at = 0;
        for &block in &self.kept {
            let size = self.sizes[block];
            step[self.offsets[block]..][..size].copy_from_slice(&solution[at..at + size]);
            at += size;
        }
        let (mut right, mut solved) = (Vec::new(), Vec::new());
        for out in &self.eliminated {
            self.right_side_of_eliminated(normal, out, &step, &mut right);
            product(&inverses[self.diagonal_range(out)], &right, right.len(), &mut solved);
            step[self.offsets[out.block]..][..solved.len()].copy_from_slice(&solved);
        }
        // Predicted decrease of the cost: d' (lambda diag(J'J) d - J'r), with the step d and the damping
        // lambda.
        let diagonal = self.diagonal(normal);
        let predicted =
            (0..step.len()).map(|i| step[i] * (damping * diagonal[i] * step[i] - normal.gradient[i])).sum();
        Some((step, predicted))
    }

    /// Computes the right-hand side `b - C y` of one eliminated block. The result replaces the contents of
    /// `right`.
    fn right_side_of_eliminated(
        &self,
        normal: &NormalEquations,
        out: &Eliminated,
        step: &[f64],
        right: &mut Vec<f64>,
    ) {
        right.clear();
        right.extend(self.block_values(&normal.gradient, out.block).iter().map(|g| -g));
        for (k, &neighbour) in out.neighbours.iter().enumerate() {
            let (moved, cross) =
                (self.block_values(step, self.kept[neighbour]), &normal.cross[out.cross_range(k)]);
            for (value, row) in right.iter_mut().zip(cross.chunks_exact(moved.len())) {
                *value -= row.iter().zip(moved).map(|(c, m)| c * m).sum::<f64>();
            }
        }
    }

    /// Returns the diagonal of `J'J` for all parameters.
    fn diagonal(&self, normal: &NormalEquations) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.unknowns()];
        for block in 0..self.sizes.len() {
            let size = self.sizes[block];
            let to = &mut diagonal[self.offsets[block]..][..size];
            match self.roles[block] {
                Role::Kept(i) => {
                    let own = normal.kept[self.coupled[i].at.clone()].iter().step_by(size + 1);
                    to.iter_mut().zip(own).for_each(|(to, own)| *to = *own);
                }
                Role::Eliminated(e) => {
                    let own = normal.own[self.diagonal_range(&self.eliminated[e])].iter().step_by(size + 1);
                    to.iter_mut().zip(own).for_each(|(to, own)| *to = *own);
                }
            }
        }
        diagonal
    }

    /// Returns the covariances of all pairs of blocks that share residuals. Returns `None` if the reduced
    /// matrix is not positive definite.
    ///
    /// The diagonal of `J'J` is multiplied by `1 + regularization` for the kept blocks. A direction that the
    /// residuals do not determine therefore has a large, finite variance.
    pub(crate) fn covariance(
        &self,
        normal: &NormalEquations,
        regularization: f64,
    ) -> Option<BlockCovariance> {
        let (values, inverses) = self.regularized(normal, regularization);
        let inverse = self.sparse.factor(values)?.inverse();
        Some(BlockCovariance { cross: normal.cross.clone(), inverses, inverse })
    }

    /// Returns the covariances of all pairs of the blocks `wanted`, coupled or not; keys are pairs of block
    /// indices. Eliminated blocks are ignored. The covariances are computed from columns of the inverse, with
    /// the regularisation of [`Self::covariance`].
    pub(crate) fn covariance_between(
        &self,
        normal: &NormalEquations,
        regularization: f64,
        wanted: &[usize],
    ) -> Option<HashMap<[usize; 2], DMatrix<f64>>> {
        let (values, _) = self.regularized(normal, regularization);
        let factor = self.sparse.factor(values)?;
        let starts = self.row_starts();
        let place = |&block: &usize| match self.roles[block] {
            Role::Kept(i) => Some((block, starts[i], self.sizes[block])),
            Role::Eliminated(_) => None,
        };
        let places: Vec<(usize, usize, usize)> = wanted.iter().filter_map(place).collect();
        let total: usize = self.kept.iter().map(|&block| self.sizes[block]).sum();
        let mut found = HashMap::new();
        for &(of, start, width) in &places {
            let unit = |column: usize| {
                let mut unit = vec![0.0; total];
                unit[start + column] = 1.0;
                factor.solve(&unit)
            };
            let columns: Vec<Vec<f64>> = (0..width).map(unit).collect();
            for &(with, row, height) in &places {
                found.insert([with, of], DMatrix::from_fn(height, width, |i, j| columns[j][row + i]));
            }
        }
        Some(found)
    }

    /// Returns the values of the regularised reduced matrix, and the inverse `D^-1` of every eliminated
    /// block.
    fn regularized(&self, normal: &NormalEquations, regularization: f64) -> (Vec<f64>, Vec<f64>) {
        let Reduced { mut values, inverses, .. } = self.reduced(normal, 0.0);
        for (block, coupled) in self.coupled[..self.kept.len()].iter().enumerate() {
            let own = normal.kept[coupled.at.clone()].iter().step_by(coupled.width + 1);
            for (at, own) in self.sparse.diagonal(block).zip(own) {
                values[at] += (regularization * own).max(1e-18);
            }
        }
        (values, inverses)
    }

    /// Returns the first row of every kept block in the reduced system, followed by the number of rows.
    fn row_starts(&self) -> Vec<usize> {
        running_sums(self.kept.iter().map(|&block| self.sizes[block]))
    }
}

/// Covariances of all pairs of blocks that share residuals.
#[derive(Debug)]
pub(crate) struct BlockCovariance {
    /// Matrices C of every eliminated block (rows) with each of its neighbours, as in
    /// [`NormalEquations::cross`].
    cross: Vec<f64>,
    /// Inverse `D^-1` of the diagonal matrix of every eliminated block.
    inverses: Vec<f64>,
    /// Inverse `Z` of the reduced matrix, within the pattern of its factor.
    inverse: SelectedInverse,
}

impl BlockCovariance {
    /// Returns the covariance of two coupled blocks, or of one block with itself. Rows belong to block `a`,
    /// columns to block `b`. Returns zeros for two different eliminated blocks, whose covariance is not
    /// computed.
    pub(crate) fn block(&self, blocks: &BlockStructure, a: usize, b: usize) -> DMatrix<f64> {
        match (blocks.roles[a], blocks.roles[b]) {
            (Role::Kept(i), Role::Kept(j)) => self.inverse.block(i, j),
            (Role::Eliminated(e), Role::Kept(i)) => {
                -self.gain(blocks, e) * self.neighbours_with(blocks, e, i)
            }
            (Role::Kept(i), Role::Eliminated(e)) => {
                -(self.gain(blocks, e) * self.neighbours_with(blocks, e, i)).transpose()
            }
            (Role::Eliminated(e), Role::Eliminated(other)) if e == other => {
                self.covariance_of_eliminated(blocks, e)
            }
            _ => DMatrix::zeros(blocks.sizes[a], blocks.sizes[b]),
        }
    }

    /// Returns the covariance `D^-1 + G Z G'` of an eliminated block with itself.
    fn covariance_of_eliminated(&self, blocks: &BlockStructure, e: usize) -> DMatrix<f64> {
        let out = &blocks.eliminated[e];
        let size = blocks.sizes[out.block];
        let gain = self.gain(blocks, e);
        let mut found = DMatrix::from_row_slice(size, size, &self.inverses[blocks.diagonal_range(out)]);
        let mut at = 0;
        for &neighbour in &out.neighbours {
            let columns = self.neighbours_with(blocks, e, neighbour);
            let width = columns.ncols();
            found += &gain * columns * gain.columns(at, width).transpose();
            at += width;
        }
        found
    }

    /// Returns the matrix `G = D^-1 C` of an eliminated block (rows) with all its neighbours (columns).
    fn gain(&self, blocks: &BlockStructure, e: usize) -> DMatrix<f64> {
        let out = &blocks.eliminated[e];
        let size = blocks.sizes[out.block];
        let own = DMatrix::from_row_slice(size, size, &self.inverses[blocks.diagonal_range(out)]);
        let width = out.neighbours.iter().map(|&neighbour| blocks.sizes[blocks.kept[neighbour]]).sum();
        let mut all = DMatrix::zeros(size, width);
        let mut at = 0;
        for k in 0..out.neighbours.len() {
            let cross = &self.cross[out.cross_range(k)];
            let part = DMatrix::from_row_slice(size, cross.len() / size, cross);
            all.columns_mut(at, part.ncols()).copy_from(&part);
            at += part.ncols();
        }
        own * all
    }

    /// Returns the covariance of all neighbours of an eliminated block (rows) with one kept block (columns).
    fn neighbours_with(&self, blocks: &BlockStructure, e: usize, kept: usize) -> DMatrix<f64> {
        let near = &blocks.eliminated[e].neighbours;
        let parts: Vec<DMatrix<f64>> = near.iter().map(|&n| self.inverse.block(n, kept)).collect();
        let height = parts.iter().map(DMatrix::nrows).sum();
        let mut all = DMatrix::zeros(height, blocks.sizes[blocks.kept[kept]]);
        let mut at = 0;
        for part in parts {
            all.rows_mut(at, part.nrows()).copy_from(&part);
            at += part.nrows();
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimize::block_structure::JacobianBlock;
    use nalgebra::DVector;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn elimination_preserves_step_and_covariance(
            kept in proptest::collection::vec(1..4_usize, 1..6),
            rest in proptest::collection::vec((1..4_usize, 0..6_usize, 0..6_usize), 0..8),
            seed in 0_u64..1000, damping in 0.0..1.0_f64,
        ) {
            use rand::{Rng as _, SeedableRng as _};
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let count = kept.len();
            let sizes: Vec<usize> = kept.iter().copied().chain(rest.iter().map(|r| r.0)).collect();
            let keep: Vec<bool> = (0..sizes.len()).map(|i| i < count).collect();
            // Kept blocks are coupled directly in one group, or only by the elimination.
            let mut common: Vec<Vec<usize>> = rest.iter().enumerate().flat_map(|(i, r)| {
                let (near, out) = (BTreeSet::from([r.1 % count, r.2 % count]), count + i);
                if i % 2 == 0 {
                    vec![near.into_iter().rev().chain([out]).collect()]
                } else {
                    near.into_iter().map(|near| vec![out, near]).collect()
                }
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
            let covariance = blocks.covariance(&normal, 0.0).unwrap();
            for group in &common {
                for &a in group {
                    for &b in group {
                        let found = covariance.block(&blocks, a, b);
                        let exact = exact.view((blocks.offsets[a], blocks.offsets[b]), (sizes[a], sizes[b]));
                        prop_assert!((found - exact).amax() < 1e-9);
                    }
                }
            }
            let between = blocks.covariance_between(&normal, 0.0, &(0..sizes.len()).collect::<Vec<_>>()).unwrap();
            prop_assert_eq!(between.len(), count * count, "of all pairs that are kept");
            for (&[a, b], found) in &between {
                let exact = exact.view((blocks.offsets[a], blocks.offsets[b]), (sizes[a], sizes[b]));
                prop_assert!((found - exact).amax() < 1e-9);
            }
        }
    }
}
