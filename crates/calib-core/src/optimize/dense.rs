//! Arithmetic of small dense blocks, row by row in slices: a few rows each, where a matrix type with its
//! allocations costs more than the products.
//!
//! Products of dense matrices with a common inner dimension, in tiles that stay in registers.
//!
//! Both factors are packed in slabs of eight rows, column by column, so that what a tile of the product needs next
//! lies together (Goto and van de Geijn 2008, "Anatomy of High-Performance Matrix Multiplication", section 4).

use std::ops::Range;

use crate::camera::dispatch;

/// Rows of a slab; a tile of a product has as many rows and columns.
const SIDE: usize = 8;
/// Columns of a tile that are summed at a time: most processors have registers for their sums and what is added.
const AT_ONCE: usize = 4;

/// A matrix in slabs of rows, the last filled up with zeros.
#[derive(Debug, Default)]
pub(super) struct Packed {
    slabs: Vec<[f64; SIDE]>,
    columns: usize,
}

/// A product, column by column.
#[derive(Debug, Default)]
pub(super) struct Product {
    values: Vec<f64>,
    height: usize,
    /// Row and column of the first value.
    first: [usize; 2],
}

/// What of a product is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    All,
    /// Of one that is symmetric, from the diagonal down: what is above is left as it was.
    Lower,
}

impl Packed {
    /// Zeros of this size, in place of what was here.
    pub(super) fn clear(&mut self, rows: usize, columns: usize) {
        self.columns = columns;
        self.slabs.clear();
        self.slabs.resize(rows.div_ceil(SIDE) * columns, [0.0; SIDE]);
    }

    /// Packs the rows from `top` on of a matrix that is stored column by column.
    pub(super) fn pack(&mut self, matrix: &[f64], height: usize, top: usize) {
        self.clear(height - top, matrix.len() / height);
        for (j, column) in matrix.chunks_exact(height).enumerate() {
            let (whole, rest) = column[top..].as_chunks::<SIDE>();
            for (slab, rows) in self.slabs.chunks_exact_mut(self.columns).zip(whole) {
                slab[j] = *rows;
            }
            if let Some(slab) = self.slabs.chunks_exact_mut(self.columns).nth(whole.len()) {
                slab[j][..rest.len()].copy_from_slice(rest);
            }
        }
    }

    /// Packs the transpose of the rows from `top` on.
    pub(super) fn pack_transposed(&mut self, matrix: &[f64], height: usize, top: usize) {
        self.clear(matrix.len() / height, height - top);
        for (i, column) in matrix.chunks_exact(height).enumerate() {
            let slab = &mut self.slabs[i / SIDE * self.columns..][..self.columns];
            for (values, value) in slab.iter_mut().zip(&column[top..]) {
                values[i % SIDE] = *value;
            }
        }
    }

    #[inline]
    pub(super) fn set(&mut self, row: usize, column: usize, value: f64) {
        self.slabs[row / SIDE * self.columns + column][row % SIDE] = value;
    }

    #[inline(always)]
    fn slab(&self, index: usize) -> &[[f64; SIDE]] {
        &self.slabs[index * self.columns..][..self.columns]
    }
}

impl Product {
    /// Of `A B'` these rows, which are rows of A, and columns, which are rows of B.
    pub(super) fn multiply(&mut self, factors: [&Packed; 2], [rows, columns]: [Range<usize>; 2], part: Part) {
        let slabs = |of: Range<usize>| of.start / SIDE..of.end.div_ceil(SIDE);
        let (rows, columns) = (slabs(rows), slabs(columns));
        self.first = [rows.start * SIDE, columns.start * SIDE];
        self.height = rows.len() * SIDE;
        self.values.resize(self.height * columns.len() * SIDE, 0.0);
        dispatch(
            #[inline(always)]
            || self.multiply_tiles(factors, [rows, columns], part),
        );
    }

    #[inline(always)]
    fn multiply_tiles(&mut self, [a, b]: [&Packed; 2], [rows, columns]: [Range<usize>; 2], part: Part) {
        for (j, slab) in columns.enumerate().map(|(j, slab)| (j * SIDE, slab)) {
            let top = if part == Part::Lower { rows.start.max(slab) } else { rows.start };
            for i in top..rows.end {
                for first in (0..SIDE).step_by(AT_ONCE) {
                    let sums = tile(a.slab(i), b.slab(slab), first);
                    for (column, sums) in (j + first..).zip(&sums) {
                        let at = column * self.height + (i - rows.start) * SIDE;
                        self.values[at..at + SIDE].copy_from_slice(sums);
                    }
                }
            }
        }
    }

    /// What of a column is from row `row` on, and zeros behind its last.
    #[inline]
    pub(super) fn column(&self, column: usize, row: usize) -> &[f64] {
        &self.values[(column - self.first[1]) * self.height..][row - self.first[0]..self.height]
    }
}

/// Columns `first` and following of the product of a slab with another one.
#[inline(always)]
fn tile(a: &[[f64; SIDE]], b: &[[f64; SIDE]], first: usize) -> [[f64; SIDE]; AT_ONCE] {
    let mut sums = [[0.0; SIDE]; AT_ONCE];
    for (a, b) in a.iter().zip(b) {
        for (sums, b) in sums.iter_mut().zip(&b[first..first + AT_ONCE]) {
            sums.iter_mut().zip(a).for_each(|(sum, a)| *sum += a * b);
        }
    }
    sums
}

/// Adds `rows columns'` times a weight.
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

/// Makes a positive semidefinite matrix its inverse, by Gauss and Jordan with pivots down the diagonal. Rows and
/// columns without information (a pivot of rounding only) are 0 in the inverse: the parameter stays.
pub(crate) fn pseudo_invert(matrix: &mut [f64], size: usize) {
    /// Rows of most blocks: their copies lie on the stack.
    const MOST: usize = 3;
    if size <= MOST {
        let (mut left, mut right) = ([0.0; MOST * MOST], [0.0; MOST * MOST]);
        let (left, right) = (&mut left[..size * size], &mut right[..size * size]);
        pseudo_invert_in(matrix, [left, right], &mut [false; MOST][..size]);
    } else {
        let (mut left, mut right) = (vec![0.0; size * size], vec![0.0; size * size]);
        pseudo_invert_in(matrix, [&mut left, &mut right], &mut vec![false; size]);
    }
}

/// The same with room for two matrices, and for what is open of every row.
#[inline]
fn pseudo_invert_in(matrix: &mut [f64], [left, right]: [&mut [f64]; 2], is_open: &mut [bool]) {
    /// Share of the diagonal below which a pivot is rounding.
    const ROUNDING: f64 = 1e-13;
    let size = is_open.len();
    left.copy_from_slice(matrix);
    (0..size).for_each(|k| right[k * size + k] = 1.0);
    for k in 0..size {
        let pivot = left[k * size + k];
        if pivot.is_nan() || pivot <= ROUNDING * matrix[k * size + k] || pivot <= 0.0 {
            is_open[k] = true;
            continue;
        }
        eliminate([left, right], k, size);
    }
    for (k, value) in matrix.iter_mut().enumerate() {
        *value = if is_open[k / size] || is_open[k % size] { 0.0 } else { right[k] };
    }
}

/// Makes column `k` of the left matrix that of the identity, with the same row operations on the right.
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

/// `A B` of a square matrix of `size` rows and another, in place of what was found before.
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
