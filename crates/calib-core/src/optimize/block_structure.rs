//! Normal equations in parameter blocks: which blocks there are, which of them residuals couple, and the
//! sums of products of Jacobians.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use crate::camera::dispatch;
use crate::optimize::dense::add_outer;
use crate::optimize::sparse_cholesky::{Entry, SparseStructure, make_set, running_sums};

/// Parameter blocks, which of them are eliminated, and which have residuals in common.
#[derive(Clone, Debug)]
pub(crate) struct BlockStructure {
    pub(crate) sizes: Vec<usize>,
    /// First parameter of every block in the state, and how many there are.
    pub(crate) offsets: Vec<usize>,
    pub(crate) roles: Vec<Role>,
    /// Kept blocks in the order of the reduced system.
    pub(crate) kept: Vec<usize>,
    pub(crate) eliminated: Vec<Eliminated>,
    /// Pairs of kept blocks that have residuals in common: every one with itself, in their order, and then others.
    pub(crate) coupled: Vec<Coupled>,
    /// Which of these two different blocks are, the lower first.
    coupling: HashMap<[usize; 2], usize>,
    /// Of the reduced system.
    pub(crate) sparse: Arc<SparseStructure>,
}

/// Two kept blocks that have residuals in common, or one with itself.
#[derive(Clone, Debug)]
pub(crate) struct Coupled {
    /// Where their matrix, row by row, is among those of all.
    pub(crate) at: Range<usize>,
    /// Columns of it.
    pub(crate) width: usize,
    /// Where it is in the reduced system.
    pub(crate) entry: Entry,
}

/// Whether a block stays in the reduced system, and its number there or among those that do not.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Role {
    Kept(usize),
    Eliminated(usize),
}

/// A block that is eliminated.
#[derive(Clone, Debug)]
pub(crate) struct Eliminated {
    pub(crate) block: usize,
    /// Kept blocks that it has residuals in common with, ascending.
    pub(crate) neighbours: Vec<usize>,
    /// Where in the reduced system every two neighbours are, each with itself, too, the first not behind the second,
    /// in this order.
    pub(crate) entries: Vec<Entry>,
    /// First value of its own matrix among those of all.
    pub(crate) own: usize,
    /// First value of its matrix with each of its neighbours among those of all, and the end of the last.
    pub(crate) cross: Vec<usize>,
}

/// Derivatives of one residual by the parameters of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JacobianBlock<'a> {
    pub(crate) block: usize,
    pub(crate) by: &'a [f64],
}

/// `J'J`, `J'r` and `r'r` at a state.
#[derive(Clone, Debug)]
pub(crate) struct NormalEquations {
    pub(crate) cost: f64,
    /// Number of residuals.
    pub(crate) residuals: usize,
    pub(crate) gradient: Vec<f64>,
    /// Of the kept blocks that are coupled, row by row.
    pub(crate) kept: Vec<f64>,
    /// Of every eliminated block with itself, row by row.
    pub(crate) own: Vec<f64>,
    /// Of every eliminated block (rows) with each of its neighbours, row by row.
    pub(crate) cross: Vec<f64>,
}

impl BlockStructure {
    /// Blocks of these sizes, the flagged ones kept; `coupled` lists groups of blocks that have residuals
    /// in common. No two eliminated blocks may be in one group.
    pub(crate) fn new(sizes: Vec<usize>, keep: &[bool], coupled: &[Vec<usize>]) -> Self {
        let offsets = running_sums(sizes.iter().copied());
        let (roles, kept, rest) = roles(keep);
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

    /// Number of parameters.
    pub(crate) fn unknowns(&self) -> usize {
        self.offsets[self.sizes.len()]
    }

    /// Normal equations of no residuals.
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

    /// Adds one residual.
    pub(crate) fn add(&self, normal: &mut NormalEquations, residual: f64, jacobian: &[JacobianBlock]) {
        normal.residuals += 1;
        dispatch(
            #[inline(always)]
            || self.add_weighted(normal, 1.0, residual, jacobian),
        );
    }

    /// Takes a residual out again that was added.
    pub(crate) fn remove(&self, normal: &mut NormalEquations, residual: f64, jacobian: &[JacobianBlock]) {
        normal.residuals -= 1;
        self.add_weighted(normal, -1.0, residual, jacobian);
    }

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

    /// Adds the product of the derivatives by two blocks, or by one with itself.
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
                add_outer(&mut normal.own[self.own(&self.eliminated[e])], weight, a.by, b.by);
            }
            (Role::Eliminated(e), Role::Kept(i)) => self.add_cross(normal, [e, i], weight, [a.by, b.by]),
            (Role::Kept(i), Role::Eliminated(e)) => self.add_cross(normal, [e, i], weight, [b.by, a.by]),
        }
    }

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
            add_outer(&mut normal.cross[out.cross(at)], weight, rows, columns);
        }
    }

    /// Where the own matrix of an eliminated block is.
    pub(crate) fn own(&self, out: &Eliminated) -> Range<usize> {
        out.own..out.own + self.sizes[out.block].pow(2)
    }

    /// Where a place of a block is in a vector over all parameters.
    pub(crate) fn at(&self, (block, place): (usize, usize)) -> usize {
        self.offsets[block] + place
    }

    /// The values of a block in a vector over all parameters.
    pub(crate) fn of<'a>(&self, values: &'a [f64], block: usize) -> &'a [f64] {
        &values[self.offsets[block]..][..self.sizes[block]]
    }
}

impl Eliminated {
    /// Where the matrix with one of its neighbours is.
    pub(crate) fn cross(&self, neighbour: usize) -> Range<usize> {
        self.cross[neighbour]..self.cross[neighbour + 1]
    }
}

/// The role of every block, and the blocks of either role.
fn roles(keep: &[bool]) -> (Vec<Role>, Vec<usize>, Vec<usize>) {
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

/// The kept neighbours of every eliminated block, and all pairs of different kept blocks that residuals couple, each
/// ascending.
fn couplings(roles: &[Role], rest: usize, coupled: &[Vec<usize>]) -> (Vec<Vec<usize>>, Vec<[usize; 2]>) {
    let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); rest];
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for group in coupled {
        let of_kept = |&block: &usize| if let Role::Kept(i) = roles[block] { Some(i) } else { None };
        let mut among: Vec<usize> = group.iter().filter_map(of_kept).collect();
        make_set(&mut among);
        pairs.extend(pairs_among(&among).filter(|[a, b]| a != b));
        for &block in group {
            if let Role::Eliminated(e) = roles[block] {
                neighbours[e].extend(&among);
            }
        }
    }
    neighbours.iter_mut().for_each(make_set);
    make_set(&mut pairs);
    (neighbours, pairs)
}

/// Every two of a list, and every one with itself, the first not behind the second.
fn pairs_among(list: &[usize]) -> impl Iterator<Item = [usize; 2]> + '_ {
    list.iter().enumerate().flat_map(|(i, &a)| list[i..].iter().map(move |&b| [a, b]))
}
