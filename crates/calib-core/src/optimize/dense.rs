//! Dense linear algebra for the blocks of sparse systems.
//!
//! - Small blocks of a few rows are stored row by row in slices. The allocations of a matrix type would take
//!   longer than the products.
//! - Products of large matrices with a common inner dimension are computed in tiles that stay in registers.
//!   Both factors are packed in slabs of eight rows, column by column. The next values of a tile are
//!   therefore adjacent in memory (Goto and van de Geijn 2008, "Anatomy of High-Performance Matrix
//!   Multiplication", section 4).

use std::ops::Range;

use crate::camera::dispatch;

/// Number of rows of a slab. Also the number of rows and columns of a tile of a product.
const TILE_SIZE: usize = 8;
/// Number of columns of a tile that are computed together. Most processors have enough registers for their
/// sums and addends.
const COLUMNS_AT_ONCE: usize = 4;

/// Matrix that is stored in slabs of [`TILE_SIZE`] rows, each slab column by column. The last slab is padded
/// with zeros.
#[derive(Debug, Default)]
pub(super) struct Packed {
    /// Columns of all slabs, slab by slab.
    slabs: Vec<[f64; TILE_SIZE]>,
    /// Number of columns of the matrix.
    columns: usize,
}

/// Part of the product of two packed matrices, stored column by column.
#[derive(Debug, Default)]
pub(super) struct Product {
    /// Values of the computed part.
    values: Vec<f64>,
    /// Number of rows of the computed part, padded to whole slabs.
    height: usize,
    /// Row and column of the first computed value in the whole product.
    first: [usize; 2],
}

/// Part of a product that [`Product::multiply`] computes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    /// All values of the product.
    All,
    /// Lower triangle of a symmetric product, with the diagonal. Values above the diagonal are not defined.
    Lower,
}

impl Packed {
    /// Resizes the matrix and fills it with zeros.
    pub(super) fn clear(&mut self, rows: usize, columns: usize) {
        self.columns = columns;
        self.slabs.clear();
        self.slabs.resize(rows.div_ceil(TILE_SIZE) * columns, [0.0; TILE_SIZE]);
    }

    /// Packs the rows from row `top` to the end of a matrix. The matrix has `height` rows and is stored
    /// column by column.
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

    /// Packs the transpose of the rows from row `top` to the end of a matrix. The matrix has `height` rows
    /// and is stored column by column.
    pub(super) fn pack_transposed(&mut self, matrix: &[f64], height: usize, top: usize) {
        self.clear(matrix.len() / height, height - top);
        for (i, column) in matrix.chunks_exact(height).enumerate() {
            let slab = &mut self.slabs[i / TILE_SIZE * self.columns..][..self.columns];
            for (values, value) in slab.iter_mut().zip(&column[top..]) {
                values[i % TILE_SIZE] = *value;
            }
        }
    }

    /// Sets one value of the matrix.
    #[inline]
    pub(super) fn set(&mut self, row: usize, column: usize, value: f64) {
        self.slabs[row / TILE_SIZE * self.columns + column][row % TILE_SIZE] = value;
    }

    /// Returns the columns of one slab.
    #[inline(always)]
    fn slab(&self, index: usize) -> &[[f64; TILE_SIZE]] {
        &self.slabs[index * self.columns..][..self.columns]
    }
}

impl Product {
    /// Computes the given rows and columns of the product `A B'` of the matrices A and B in `factors`. Its
    /// rows belong to rows of A, its columns to rows of B. The ranges are extended to whole slabs.
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

    /// Computes the tiles of the product for ranges of slabs of both factors.
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

    /// Returns a column of the product from row `row` on, padded with zeros after its last row.
    #[inline]
    pub(super) fn column(&self, column: usize, row: usize) -> &[f64] {
        &self.values[(column - self.first[1]) * self.height..][row - self.first[0]..self.height]
    }
}

/// Returns [`COLUMNS_AT_ONCE`] columns, from column `first` on, of the product of a slab and a transposed
/// slab.
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

/// Adds the outer product of two vectors, `weight rows columns'`, to a matrix that is stored row by row.
#[inline]
pub(crate) fn add_outer(matrix: &mut [f64], weight: f64, rows: &[f64], columns: &[f64]) {
    for (row, a) in matrix.chunks_exact_mut(columns.len()).zip(rows) {
        let a = weight * a;
        for (value, b) in row.iter_mut().zip(columns) {
            *value += a * b;
        }
    }
}

/// Multiplies the diagonal of a square matrix, stored row by row, by `1 + damping`.
pub(crate) fn damp_diagonal(matrix: &mut [f64], damping: f64) {
    let size = matrix.len().isqrt();
    for i in 0..size {
        matrix[i * size + i] *= 1.0 + damping;
    }
}

/// Replaces a positive semidefinite matrix, stored row by row, by its inverse. The method is Gauss-Jordan
/// elimination with pivots down the diagonal. If a pivot is of the size of rounding errors, its parameter is
/// undetermined. The row and column of such a parameter are 0 in the inverse, so it does not change in a
/// step.
pub(crate) fn pseudo_invert(matrix: &mut [f64], size: usize) {
    /// Largest number of rows of a matrix whose buffers are on the stack. Most blocks are not larger.
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

/// Inverts a matrix as [`pseudo_invert`] does, with zero-filled buffers for two matrices and for the flags of
/// undetermined rows.
#[inline]
fn pseudo_invert_in(matrix: &mut [f64], [left, right]: [&mut [f64]; 2], is_undetermined: &mut [bool]) {
    /// Minimum ratio of a pivot to the original diagonal value. At or below it, the pivot is a rounding
    /// error.
    const MIN_PIVOT_RATIO: f64 = 1e-13;
    let size = is_undetermined.len();
    left.copy_from_slice(matrix);
    (0..size).for_each(|k| right[k * size + k] = 1.0);
    for k in 0..size {
        let pivot = left[k * size + k];
        if pivot.is_nan() || pivot <= MIN_PIVOT_RATIO * matrix[k * size + k] || pivot <= 0.0 {
            is_undetermined[k] = true;
            continue;
        }
        eliminate_column([left, right], k, size);
    }
    for (k, value) in matrix.iter_mut().enumerate() {
        *value = if is_undetermined[k / size] || is_undetermined[k % size] { 0.0 } else { right[k] };
    }
}

/// Reduces column `k` of the left matrix to a column of the identity by row operations. Applies the same row
/// operations to the right matrix.
fn eliminate_column([left, right]: [&mut [f64]; 2], k: usize, size: usize) {
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

/// Computes the matrix product `A B`, where A is a square matrix with `size` rows. All matrices are stored
/// row by row. The result replaces the contents of `found`.
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
