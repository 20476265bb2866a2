//! Arithmetic of small dense blocks, row by row in slices: a few rows each, where a matrix type with its
//! allocations costs more than the products.

/// Adds `rows columns'`.
#[inline]
pub(crate) fn add_outer(matrix: &mut [f64], rows: &[f64], columns: &[f64]) {
    for (row, a) in matrix.chunks_exact_mut(columns.len()).zip(rows) {
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

/// Inverse of a positive semidefinite matrix by Gauss and Jordan with pivots down the diagonal. Rows and
/// columns without information (a pivot of rounding only) are 0 in the inverse: the parameter stays.
pub(crate) fn pseudo_inverse(matrix: &[f64], size: usize) -> Vec<f64> {
    /// Share of the diagonal below which a pivot is rounding.
    const ROUNDING: f64 = 1e-13;
    let mut left = matrix.to_vec();
    let mut right: Vec<f64> = (0..size * size).map(|k| f64::from(u8::from(k / size == k % size))).collect();
    let mut is_open = vec![false; size];
    for k in 0..size {
        let pivot = left[k * size + k];
        if pivot.is_nan() || pivot <= ROUNDING * matrix[k * size + k] || pivot <= 0.0 {
            is_open[k] = true;
            continue;
        }
        eliminate([&mut left, &mut right], k, size);
    }
    for k in (0..size).filter(|&k| is_open[k]) {
        for i in 0..size {
            right[k * size + i] = 0.0;
            right[i * size + k] = 0.0;
        }
    }
    right
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

/// `A B` of a square matrix of `size` rows and another.
pub(crate) fn product(a: &[f64], b: &[f64], size: usize) -> Vec<f64> {
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
