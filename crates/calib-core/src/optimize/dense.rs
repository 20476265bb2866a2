//! Dense linear algebra for the blocks of sparse systems.
//!
//! - Small blocks of a few rows are stored row by row in slices. A matrix type with allocations would cost
//!   more than the products.
//! - Products of large matrices with a common inner dimension are computed in tiles that stay in registers.
//!   Both factors are packed in slabs of eight rows, column by column. The next values of a tile are
//!   therefore adjacent in memory (Goto and van de Geijn 2008, "Anatomy of High-Performance Matrix
//!   Multiplication", section 4).

use std::ops::Range;

use crate::camera::dispatch;

/// Number of rows of a slab, and of rows and columns of a tile of a product.
const TILE_SIZE: usize = 8;
/// Number of columns of a tile that are summed at a time. Most processors have enough registers for the sums
/// and the addends.
const COLUMNS_AT_ONCE: usize = 4;

/// Matrix in slabs of rows; the last slab is padded with zeros.
#[derive(Debug, Default)]
pub(super) struct Packed {
    slabs: Vec<[f64; TILE_SIZE]>,
    columns: usize,
}

/// Product of two packed matrices, column by column.
#[derive(Debug, Default)]
pub(super) struct Product {
    values: Vec<f64>,
    height: usize,
    /// Row and column of the first value.
    first: [usize; 2],
}

/// Part of a product that is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    All,
    /// Lower triangle of a symmetric product, with the diagonal. The values above keep their old contents.
    Lower,
}

impl Packed {
    /// Resizes the matrix and fills it with zeros.
    pub(super) fn clear(&mut self, rows: usize, columns: usize) {
        self.columns = columns;
        self.slabs.clear();
        self.slabs.resize(rows.div_ceil(TILE_SIZE) * columns, [0.0; TILE_SIZE]);
    }

    /// Packs the rows from `top` of a matrix that is stored column by column.
    pub(super) fn pack(&mut self, matrix: &[f64], height: usize, top: usize) {
        self.clear(height - top, matrix.len() / height);
        for (j, column) in matrix.chunks_exact(height).enumerate() {
            let (whole, rest) = column[top..].as_chunks::<TILE_SIZE>();
            for (slab, rows) in self.slabs.chunks_exact_mut(self.columns).zip(whole) {
                slab[j] = *rows;
            }
            if let Some(slab) = self.slabs.chunks_exact_mut(self.columns).nth(whole.len()) {
                slab[j][..rest.len()].copy_from_slice(rest);
            }
        }
    }

    /// Packs the transpose of the rows from `top`.
    pub(super) fn pack_transposed(&mut self, matrix: &[f64], height: usize, top: usize) {
        self.clear(matrix.len() / height, height - top);
        for (i, column) in matrix.chunks_exact(height).enumerate() {
            let slab = &mut self.slabs[i / TILE_SIZE * self.columns..][..self.columns];
            for (values, value) in slab.iter_mut().zip(&column[top..]) {
                values[i % TILE_SIZE] = *value;
            }
        }
    }

    #[inline]
    pub(super) fn set(&mut self, row: usize, column: usize, value: f64) {
        self.slabs[row / TILE_SIZE * self.columns + column][row % TILE_SIZE] = value;
    }

    #[inline(always)]
    fn slab(&self, index: usize) -> &[[f64; TILE_SIZE]] {
        &self.slabs[index * self.columns..][..self.columns]
    }
}

impl Product {
    /// Computes the given rows and columns of `A B'`. The rows are rows of A, the columns are rows of B.
    pub(super) fn multiply(&mut self, factors: [&Packed; 2], [rows, columns]: [Range<usize>; 2], part: Part) {
        let slabs = |of: Range<usize>| of.start / TILE_SIZE..of.end.div_ceil(TILE_SIZE);
        let (rows, columns) = (slabs(rows), slabs(columns));
        self.first = [rows.start * TILE_SIZE, columns.start * TILE_SIZE];
        self.height = rows.len() * TILE_SIZE;
        self.values.resize(self.height * columns.len() * TILE_SIZE, 0.0);
        dispatch(
            #[inline(always)]
            || self.multiply_tiles(factors, [rows, columns], part),
        );
    }

    #[inline(always)]
    fn multiply_tiles(&mut self, [a, b]: [&Packed; 2], [rows, columns]: [Range<usize>; 2], part: Part) {
        for (j, slab) in columns.enumerate().map(|(j, slab)| (j * TILE_SIZE, slab)) {
            let top = if part == Part::Lower { rows.start.max(slab) } else { rows.start };
            for i in top..rows.end {
                for first in (0..TILE_SIZE).step_by(COLUMNS_AT_ONCE) {
                    let sums = tile(a.slab(i), b.slab(slab), first);
                    for (column, sums) in (j + first..).zip(&sums) {
                        let at = column * self.height + (i - rows.start) * TILE_SIZE;
                        self.values[at..at + TILE_SIZE].copy_from_slice(sums);
                    }
                }
            }
        }
    }

    /// Returns a column from row `row` on, padded with zeros after its last row.
    #[inline]
    pub(super) fn column(&self, column: usize, row: usize) -> &[f64] {
        &self.values[(column - self.first[1]) * self.height..][row - self.first[0]..self.height]
    }
}

/// Returns the columns from `first` of the product of two slabs.
#[inline(always)]
fn tile(a: &[[f64; TILE_SIZE]], b: &[[f64; TILE_SIZE]], first: usize) -> [[f64; TILE_SIZE]; COLUMNS_AT_ONCE] {
    let mut sums = [[0.0; TILE_SIZE]; COLUMNS_AT_ONCE];
    for (a, b) in a.iter().zip(b) {
        for (sums, b) in sums.iter_mut().zip(&b[first..first + COLUMNS_AT_ONCE]) {
            sums.iter_mut().zip(a).for_each(|(sum, a)| *sum += a * b);
        }
    }
    sums
}

/// Adds `weight rows columns'` to a matrix.
#[inline]
pub(crate) fn add_outer(matrix: &mut [f64], weight: f64, rows: &[f64], columns: &[f64]) {
    for (row, a) in matrix.chunks_exact_mut(columns.len()).zip(rows) {
        let a = weight * a;
        for (value, b) in row.iter_mut().zip(columns) {
            *value += a * b;
        }
    }
}

/// Multiplies the diagonal of a square matrix by `1 + damping`.
pub(crate) fn damp_diagonal(matrix: &mut [f64], damping: f64) {
    let size = matrix.len().isqrt();
    for i in 0..size {
        matrix[i * size + i] *= 1.0 + damping;
    }
}

/// Replaces a positive semidefinite matrix by its inverse, with Gauss-Jordan elimination and pivots down the
/// diagonal. Rows and columns without information (a pivot of the size of rounding errors) are 0 in the
/// inverse, so their parameters do not move.
pub(crate) fn pseudo_invert(matrix: &mut [f64], size: usize) {
    /// Largest size of a block with buffers on the stack; most blocks are smaller.
    const MAX_STACK_SIZE: usize = 3;
    if size <= MAX_STACK_SIZE {
        let (mut left, mut right) =
            ([0.0; MAX_STACK_SIZE * MAX_STACK_SIZE], [0.0; MAX_STACK_SIZE * MAX_STACK_SIZE]);
        let (left, right) = (&mut left[..size * size], &mut right[..size * size]);
        pseudo_invert_in(matrix, [left, right], &mut [false; MAX_STACK_SIZE][..size]);
    } else {
        let (mut left, mut right) = (vec![0.0; size * size], vec![0.0; size * size]);
        pseudo_invert_in(matrix, [&mut left, &mut right], &mut vec![false; size]);
    }
}

/// Inverts as [`pseudo_invert`], with buffers for two matrices and for the flags of undetermined rows.
#[inline]
fn pseudo_invert_in(matrix: &mut [f64], [left, right]: [&mut [f64]; 2], is_open: &mut [bool]) {
    /// Ratio of a pivot to the diagonal below which the pivot is a rounding error.
    const MIN_PIVOT_RATIO: f64 = 1e-13;
    let size = is_open.len();
    left.copy_from_slice(matrix);
    (0..size).for_each(|k| right[k * size + k] = 1.0);
    for k in 0..size {
        let pivot = left[k * size + k];
        if pivot.is_nan() || pivot <= MIN_PIVOT_RATIO * matrix[k * size + k] || pivot <= 0.0 {
            is_open[k] = true;
            continue;
        }
        eliminate([left, right], k, size);
    }
    for (k, value) in matrix.iter_mut().enumerate() {
        *value = if is_open[k / size] || is_open[k % size] { 0.0 } else { right[k] };
    }
}

/// Reduces column `k` of the left matrix to a column of the identity, with the same row operations on the
/// right matrix.
fn eliminate([left, right]: [&mut [f64]; 2], k: usize, size: usize) {
    let pivot = left[k * size + k];
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

/// Computes `A B`, where A is a square matrix of `size` rows. The result replaces the contents of `found`.
#[inline]
pub(crate) fn product(a: &[f64], b: &[f64], size: usize, found: &mut Vec<f64>) {
    let width = b.len() / size;
    found.clear();
    found.resize(b.len(), 0.0);
    for i in 0..size {
        for k in 0..size {
            let factor = a[i * size + k];
            for j in 0..width {
                found[i * width + j] += factor * b[k * width + j];
            }
        }
    }
}
