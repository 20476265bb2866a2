//! Arithmetic of small dense blocks, row by row in slices: a few rows each, where a matrix type with its
//! allocations costs more than the products.

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
