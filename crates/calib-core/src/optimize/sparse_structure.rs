//! The pattern of a sparse symmetric matrix of blocks, and of its factor.
//!
//! The blocks are ordered for little fill by approximate minimum degree (Amestoy, Davis and Duff 1996). In this
//! order the rows of a block are those that the matrix has below its diagonal, and those of every block whose
//! first row below its diagonal this one is (Davis 2006, "Direct Methods for Sparse Linear Systems", section 4.1).
//! Blocks that follow each other and have all further rows in common make a supernode (Liu, Ng and Peyton 1993, "On
//! Finding Supernodes for Sparse Matrix Computations").
//!
//! Matrix, factor and inverse have one layout: for every supernode a panel of its rows, column by column, its own
//! blocks first.

use std::ops::Range;
use std::sync::Arc;

/// The pattern of the factor of a matrix of blocks.
#[derive(Clone, Debug)]
pub(crate) struct SparseStructure {
    /// Of every block, its place in the order of the factor.
    places: Vec<usize>,
    /// First unknown of every place, in the order of the factor, and their number.
    pub(super) starts: Vec<usize>,
    /// Of every place, its supernode.
    owners: Vec<usize>,
    /// In the order of the factor.
    pub(super) supernodes: Vec<Supernode>,
}

/// Blocks that have their rows in common.
#[derive(Clone, Debug)]
pub(super) struct Supernode {
    /// Unknowns.
    pub(super) width: usize,
    /// First value of its panel.
    pub(super) offset: usize,
    /// How many blocks it has.
    pub(super) blocks: usize,
    /// Places of the blocks of its rows, ascending; its own first.
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
    /// The structure of a matrix of blocks of these sizes, one unknown at least, that couples these pairs of blocks.
    pub(crate) fn new(sizes: &[usize], pairs: impl Iterator<Item = [usize; 2]>) -> Arc<Self> {
        let mut neighbours: Vec<Vec<usize>> = (0..sizes.len()).map(|block| vec![block]).collect();
        for [a, b] in pairs {
            neighbours[a].push(b);
            neighbours[b].push(a);
        }
        neighbours.iter_mut().for_each(make_set);
        let order = order(&neighbours);
        let mut places = vec![0; sizes.len()];
        order.iter().enumerate().for_each(|(place, &block)| places[block] = place);
        let starts = running_sums(order.iter().map(|&block| sizes[block]));
        let rows = factor_rows(&neighbours, &order, &places);
        let mut owners = Vec::with_capacity(sizes.len());
        let mut supernodes: Vec<Supernode> = Vec::new();
        for places in supernode_places(&rows, &starts) {
            owners.resize(places.end, supernodes.len());
            let offset = supernodes.last().map_or(0, Supernode::end);
            supernodes.push(Supernode::new(places.len(), &rows[places.start], &starts, offset));
        }
        Arc::new(Self { places, starts, owners, supernodes })
    }

    /// Room for the values of a matrix.
    pub(crate) fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.supernodes.last().map_or(0, Supernode::end)]
    }

    /// Number of unknowns.
    pub(super) fn unknowns(&self) -> usize {
        self.starts[self.blocks()]
    }

    /// Unknowns of a block.
    pub(super) fn size(&self, block: usize) -> usize {
        let place = self.places[block];
        self.starts[place + 1] - self.starts[place]
    }

    /// First unknown of a block in the order of the factor.
    pub(super) fn start(&self, block: usize) -> usize {
        self.starts[self.places[block]]
    }

    /// How many blocks there are.
    pub(super) fn blocks(&self) -> usize {
        self.places.len()
    }

    /// Where the block of two blocks is, if they are coupled.
    pub(crate) fn entry(&self, [a, b]: [usize; 2]) -> Option<Entry> {
        let (first, second) = (self.places[a], self.places[b]);
        let supernode = &self.supernodes[self.owners[first.min(second)]];
        let row = supernode.rows.binary_search(&first.max(second)).ok()?;
        let column = supernode.tops[first.min(second) - supernode.rows[0]];
        let stride = supernode.height();
        let offset = supernode.offset + column * stride + supernode.tops[row];
        Some(Entry { offset, stride, is_transposed: second < first })
    }

    /// Where the diagonal of a block is.
    pub(crate) fn diagonal(&self, block: usize) -> impl Iterator<Item = usize> + use<> {
        let supernode = &self.supernodes[self.owners[self.places[block]]];
        let first = supernode.tops[self.places[block] - supernode.rows[0]];
        let (offset, step) = (supernode.offset, supernode.height() + 1);
        (first..first + self.size(block)).map(move |i| offset + i * step)
    }

    /// The supernodes of the rows below one, each with the first of its blocks there and the one behind the last.
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
    /// Of so many blocks, with the rows of the first.
    fn new(blocks: usize, rows: &[usize], starts: &[usize], offset: usize) -> Self {
        let tops = running_sums(rows.iter().map(|&row| starts[row + 1] - starts[row]));
        Self { width: tops[blocks], offset, blocks, rows: rows.to_vec(), tops }
    }

    pub(super) fn height(&self) -> usize {
        self.tops[self.rows.len()]
    }

    /// The value behind the last of its panel.
    pub(super) fn end(&self) -> usize {
        self.offset + self.width * self.height()
    }

    /// Columns of one of its own blocks, by its place.
    pub(super) fn columns(&self, place: usize) -> Range<usize> {
        let own = place - self.rows[0];
        self.tops[own]..self.tops[own + 1]
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
}

/// Of every place the places of the rows that the factor has in its columns, ascending, itself first.
fn factor_rows(neighbours: &[Vec<usize>], order: &[usize], places: &[usize]) -> Vec<Vec<usize>> {
    let mut rows: Vec<Vec<usize>> = vec![Vec::new(); order.len()];
    for (place, &block) in order.iter().enumerate() {
        let mut own = std::mem::take(&mut rows[place]);
        own.extend(neighbours[block].iter().map(|&other| places[other]).filter(|&other| other >= place));
        make_set(&mut own);
        if let [_, parent, others @ ..] = &own[..] {
            rows[*parent].extend(others);
        }
        rows[place] = own;
    }
    rows
}

/// Sorts a list, each once.
pub(super) fn make_set<T: Ord>(list: &mut Vec<T>) {
    list.sort_unstable();
    list.dedup();
}

/// Runs of places that make a supernode: each place the first row below the one before it, and with all its others.
fn supernode_places(rows: &[Vec<usize>], starts: &[usize]) -> Vec<Range<usize>> {
    /// Unknowns of a supernode: what is done within a panel stays little beside what is subtracted from others.
    const WIDEST: usize = 56;
    let mut found: Vec<Range<usize>> = Vec::new();
    for (place, own) in rows.iter().enumerate() {
        let follows = |last: &Range<usize>| {
            let before = &rows[place - 1];
            before.get(1) == Some(&place)
                && before.len() == own.len() + 1
                && starts[place + 1] - starts[last.start] <= WIDEST
        };
        match found.last_mut() {
            Some(last) if follows(last) => last.end = place + 1,
            _ => found.push(place..place + 1),
        }
    }
    found
}

/// From 0, where each of these sizes starts, and where the last ends.
pub(super) fn running_sums(sizes: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sums = vec![0];
    let mut end = 0;
    sums.extend(sizes.map(|size| {
        end += size;
        end
    }));
    sums
}

/// An order of the blocks with little fill.
fn order(neighbours: &[Vec<usize>]) -> Vec<usize> {
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
