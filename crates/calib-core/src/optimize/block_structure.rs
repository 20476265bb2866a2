//! Normal equations in parameter blocks: the blocks, the pairs of blocks that residuals couple, and the sums
//! of products of Jacobians.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use crate::camera::dispatch;
use crate::optimize::dense::add_outer;
use crate::optimize::sparse_cholesky::{Entry, SparseStructure, running_sums, sort_and_dedup};

/// Parameter blocks, divided into kept and eliminated blocks, and the couplings between them. Two blocks are
/// coupled if they share a residual.
#[derive(Clone, Debug)]
pub(crate) struct BlockStructure {
    /// Number of parameters of every block.
    pub(crate) sizes: Vec<usize>,
    /// Index of the first parameter of every block, followed by the total number of parameters.
    pub(crate) offsets: Vec<usize>,
    /// Role of every block: kept or eliminated.
    pub(crate) roles: Vec<Role>,
    /// Indices of the kept blocks, in the order of the reduced system.
    pub(crate) kept: Vec<usize>,
    /// Eliminated blocks, in ascending order.
    pub(crate) eliminated: Vec<Eliminated>,
    /// Coupled pairs of kept blocks: first every kept block with itself, in order, then the pairs of
    /// different kept blocks.
    pub(crate) coupled: Vec<Coupled>,
    /// Index in `coupled` of every pair of different kept blocks. The block with the lower index comes first.
    coupling: HashMap<[usize; 2], usize>,
    /// Sparse structure of the reduced system.
    pub(crate) sparse: Arc<SparseStructure>,
}

/// Pair of kept blocks that share residuals, or one block with itself.
#[derive(Clone, Debug)]
pub(crate) struct Coupled {
    /// Range of the matrix of this pair in [`NormalEquations::kept`]; the matrix is stored row by row.
    pub(crate) at: Range<usize>,
    /// Number of columns of the matrix of this pair.
    pub(crate) width: usize,
    /// Position of the matrix in the reduced system.
    pub(crate) entry: Entry,
}

/// Role of a parameter block in the elimination.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Role {
    /// Kept block, with its index among the kept blocks.
    Kept(usize),
    /// Eliminated block, with its index among the eliminated blocks.
    Eliminated(usize),
}

/// Parameter block that is eliminated, for example a landmark.
#[derive(Clone, Debug)]
pub(crate) struct Eliminated {
    /// Index among all blocks.
    pub(crate) block: usize,
    /// Neighbours: indices, among the kept blocks, of the blocks that share residuals with this one,
    /// ascending.
    pub(crate) neighbours: Vec<usize>,
    /// Positions in the reduced system of all pairs of neighbours, including each neighbour with itself. The
    /// first neighbour of a pair is not after the second.
    pub(crate) entries: Vec<Entry>,
    /// Offset of the diagonal matrix of this block in [`NormalEquations::own`].
    pub(crate) own: usize,
    /// Offsets in [`NormalEquations::cross`] of the matrices of this block with each neighbour, followed by
    /// the end of the last matrix.
    pub(crate) cross: Vec<usize>,
}

/// Derivatives of one residual with respect to the parameters of one block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JacobianBlock<'a> {
    /// Index of the block.
    pub(crate) block: usize,
    /// Derivatives, in the order of the parameters of the block.
    pub(crate) by: &'a [f64],
}

/// Normal equations at a state: `J'J`, `J'r` and `r'r` of the residuals r and their Jacobian J.
#[derive(Clone, Debug)]
pub(crate) struct NormalEquations {
    /// Cost `r'r`: the sum of squares of the residuals.
    pub(crate) cost: f64,
    /// Number of residuals that are included.
    pub(crate) residuals: usize,
    /// Gradient `J'r` with respect to all parameters.
    pub(crate) gradient: Vec<f64>,
    /// Matrices of `J'J` for the coupled pairs of kept blocks, row by row.
    pub(crate) kept: Vec<f64>,
    /// Matrices of `J'J` for each eliminated block with itself, row by row.
    pub(crate) own: Vec<f64>,
    /// Matrices of `J'J` for each eliminated block (rows) with each of its neighbours (columns), row by row.
    pub(crate) cross: Vec<f64>,
}

impl BlockStructure {
    /// Creates the structure of blocks with the given numbers of parameters. Blocks that are flagged in
    /// `keep` are kept, the others eliminated. Each entry of `coupled` is a group of blocks that share
    /// residuals. A group contains at most one eliminated block.
    pub(crate) fn new(sizes: Vec<usize>, keep: &[bool], coupled: &[Vec<usize>]) -> Self {
        let offsets = running_sums(sizes.iter().copied());
        let (roles, kept, rest) = assign_roles(keep);
        let (neighbours, pairs) = couplings(&roles, rest.len(), coupled);
        let kept_sizes: Vec<usize> = kept.iter().map(|&block| sizes[block]).collect();
        let by_elimination = neighbours.iter().flat_map(|near| pairs_among(near));
        let sparse = SparseStructure::new(&kept_sizes, pairs.iter().copied().chain(by_elimination));
        let alone = (0..kept.len()).map(|i| [i, i]);
        let coupling = pairs.iter().enumerate().map(|(k, &pair)| (pair, kept.len() + k)).collect();
        let mut end = 0;
        let coupled = alone.chain(pairs.iter().copied()).filter_map(|[a, b]| {
            let (start, width) = (end, kept_sizes[b]);
            end += kept_sizes[a] * width;
            Some(Coupled { at: start..end, width, entry: sparse.entry([a, b])? })
        });
        let coupled = coupled.collect();
        let (mut own, mut cross) = (0, 0);
        let eliminated = rest.iter().zip(neighbours).map(|(&block, neighbours)| {
            let height = sizes[block];
            let mut crosses = vec![cross];
            crosses.extend(neighbours.iter().map(|&neighbour| {
                cross += height * kept_sizes[neighbour];
                cross
            }));
            own += height * height;
            let entries = pairs_among(&neighbours).filter_map(|pair| sparse.entry(pair)).collect();
            Eliminated { block, neighbours, entries, own: own - height * height, cross: crosses }
        });
        let eliminated = eliminated.collect();
        Self { sizes, offsets, roles, kept, eliminated, coupled, coupling, sparse }
    }

    /// Returns the number of parameters of all blocks.
    pub(crate) fn unknowns(&self) -> usize {
        self.offsets[self.sizes.len()]
    }

    /// Returns empty normal equations, with all entries zero.
    pub(crate) fn normal(&self) -> NormalEquations {
        let last = self.eliminated.last();
        let end = |out: &Eliminated| out.own + self.sizes[out.block].pow(2);
        NormalEquations {
            cost: 0.0,
            residuals: 0,
            gradient: vec![0.0; self.unknowns()],
            kept: vec![0.0; self.coupled.last().map_or(0, |last| last.at.end)],
            own: vec![0.0; last.map_or(0, end)],
            cross: vec![0.0; last.and_then(|out| out.cross.last().copied()).unwrap_or(0)],
        }
    }

    /// Adds one residual to the normal equations.
    pub(crate) fn add(&self, normal: &mut NormalEquations, residual: f64, jacobian: &[JacobianBlock]) {
        normal.residuals += 1;
        dispatch(
            #[inline(always)]
            || self.add_weighted(normal, 1.0, residual, jacobian),
        );
    }

    /// Removes a residual that was added to the normal equations before.
    pub(crate) fn remove(&self, normal: &mut NormalEquations, residual: f64, jacobian: &[JacobianBlock]) {
        normal.residuals -= 1;
        self.add_weighted(normal, -1.0, residual, jacobian);
    }

    /// Adds the contribution of a residual, multiplied by `weight`, to the cost, gradient and matrices of the
    /// normal equations.
    #[inline(always)]
    fn add_weighted(
        &self,
        normal: &mut NormalEquations,
        weight: f64,
        residual: f64,
        jacobian: &[JacobianBlock],
    ) {
        normal.cost += weight * residual * residual;
        for (k, a) in jacobian.iter().enumerate() {
            let offset = self.offsets[a.block];
            for (gradient, jacobian) in normal.gradient[offset..].iter_mut().zip(a.by) {
                *gradient += jacobian * (weight * residual);
            }
            for b in &jacobian[k..] {
                self.add_product(normal, weight, a, b);
            }
        }
    }

    /// Adds the product, multiplied by `weight`, of the derivatives with respect to two blocks. The blocks
    /// may be the same.
    #[inline(always)]
    fn add_product(&self, normal: &mut NormalEquations, weight: f64, a: &JacobianBlock, b: &JacobianBlock) {
        match (self.roles[a.block], self.roles[b.block]) {
            (Role::Kept(i), Role::Kept(j)) => {
                let [(i, rows), (j, columns)] =
                    if i > j { [(j, b.by), (i, a.by)] } else { [(i, a.by), (j, b.by)] };
                let known = if i == j { Some(i) } else { self.coupling.get(&[i, j]).copied() };
                if let Some(coupled) = known {
                    add_outer(&mut normal.kept[self.coupled[coupled].at.clone()], weight, rows, columns);
                }
            }
            (Role::Eliminated(e), Role::Eliminated(_)) => {
                add_outer(&mut normal.own[self.diagonal_range(&self.eliminated[e])], weight, a.by, b.by);
            }
            (Role::Eliminated(e), Role::Kept(i)) => self.add_cross(normal, [e, i], weight, [a.by, b.by]),
            (Role::Kept(i), Role::Eliminated(e)) => self.add_cross(normal, [e, i], weight, [b.by, a.by]),
        }
    }

    /// Adds the outer product `weight rows columns'` to the matrix of the eliminated block `e` and the kept
    /// block `i`. `rows` and `columns` are the derivatives with respect to these blocks.
    #[inline(always)]
    fn add_cross(
        &self,
        normal: &mut NormalEquations,
        [e, i]: [usize; 2],
        weight: f64,
        [rows, columns]: [&[f64]; 2],
    ) {
        let out = &self.eliminated[e];
        if let Some(at) = out.neighbours.iter().position(|&neighbour| neighbour == i) {
            add_outer(&mut normal.cross[out.cross_range(at)], weight, rows, columns);
        }
    }

    /// Returns the range of the diagonal matrix of an eliminated block in [`NormalEquations::own`].
    pub(crate) fn diagonal_range(&self, out: &Eliminated) -> Range<usize> {
        out.own..out.own + self.sizes[out.block].pow(2)
    }

    /// Returns the index of a parameter in a vector of all parameters. The argument is the block, and the
    /// index of the parameter in the block.
    pub(crate) fn parameter_index(&self, (block, place): (usize, usize)) -> usize {
        self.offsets[block] + place
    }

    /// Returns the values of a block from a vector of the values of all parameters.
    pub(crate) fn block_values<'a>(&self, values: &'a [f64], block: usize) -> &'a [f64] {
        &values[self.offsets[block]..][..self.sizes[block]]
    }
}

impl Eliminated {
    /// Returns the range in [`NormalEquations::cross`] of the matrix with one neighbour. `neighbour` is its
    /// index in `neighbours`.
    pub(crate) fn cross_range(&self, neighbour: usize) -> Range<usize> {
        self.cross[neighbour]..self.cross[neighbour + 1]
    }
}

/// Returns the role of every block, the indices of the kept blocks and the indices of the eliminated blocks.
fn assign_roles(keep: &[bool]) -> (Vec<Role>, Vec<usize>, Vec<usize>) {
    let (mut kept, mut rest) = (Vec::new(), Vec::new());
    let role = |(block, &is_kept): (usize, &bool)| {
        let list = if is_kept { &mut kept } else { &mut rest };
        list.push(block);
        let number = list.len() - 1;
        if is_kept { Role::Kept(number) } else { Role::Eliminated(number) }
    };
    let roles = keep.iter().enumerate().map(role).collect();
    (roles, kept, rest)
}

/// Returns the kept neighbours of every eliminated block, and all coupled pairs of different kept blocks.
/// Both contain indices among the kept blocks, in ascending order. `rest` is the number of eliminated blocks.
fn couplings(roles: &[Role], rest: usize, coupled: &[Vec<usize>]) -> (Vec<Vec<usize>>, Vec<[usize; 2]>) {
    let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); rest];
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for group in coupled {
        let of_kept = |&block: &usize| if let Role::Kept(i) = roles[block] { Some(i) } else { None };
        let mut among: Vec<usize> = group.iter().filter_map(of_kept).collect();
        sort_and_dedup(&mut among);
        pairs.extend(pairs_among(&among).filter(|[a, b]| a != b));
        for &block in group {
            if let Role::Eliminated(e) = roles[block] {
                neighbours[e].extend(&among);
            }
        }
    }
    neighbours.iter_mut().for_each(sort_and_dedup);
    sort_and_dedup(&mut pairs);
    (neighbours, pairs)
}

/// Iterates over all pairs of elements of a list, including each element with itself. The first element of a
/// pair is not after the second in the list.
fn pairs_among(list: &[usize]) -> impl Iterator<Item = [usize; 2]> + '_ {
    list.iter().enumerate().flat_map(|(i, &a)| list[i..].iter().map(move |&b| [a, b]))
}
