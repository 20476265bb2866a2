//! Normal equations of a core of four unknowns and of one unknown at a time beside it, which is
//! eliminated: what is solved is 4 x 4 however many there are.

use nalgebra::{Matrix4, SymmetricEigen};

use crate::optimize::dual::Gradient;

/// Normal equations with one unknown beside the core per block.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    pub(crate) cost: f64,
    core: [[f64; 4]; 4],
    gradient: [f64; 4],
    blocks: Vec<Block>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Block {
    square: f64,
    cross: [f64; 4],
    gradient: f64,
}

impl Normal {
    pub(crate) fn new(nuisances: usize) -> Self {
        Self { cost: 0.0, core: [[0.0; 4]; 4], gradient: [0.0; 4], blocks: vec![Block::default(); nuisances] }
    }

    #[inline]
    pub(crate) fn add(&mut self, residual: f64, gradient: &Gradient, nuisance: Option<(usize, f64)>) {
        self.cost += residual * residual;
        for i in 0..4 {
            self.gradient[i] += gradient[i] * residual;
            for j in i..4 {
                self.core[i][j] += gradient[i] * gradient[j];
            }
        }
        if let Some((index, derivative)) = nuisance {
            let block = &mut self.blocks[index];
            block.square += derivative * derivative;
            block.gradient += derivative * residual;
            for i in 0..4 {
                block.cross[i] += derivative * gradient[i];
            }
        }
    }

    /// The core's equations with every block eliminated; damping multiplies the diagonal.
    fn reduced(&self, damping: f64, free: [bool; 4]) -> ([[f64; 4]; 4], [f64; 4]) {
        let grow = 1.0 + damping;
        let mut matrix = [[0.0; 4]; 4];
        let mut right = self.gradient.map(|g| -g);
        for i in 0..4 {
            for j in i..4 {
                matrix[i][j] = self.core[i][j] * if i == j { grow } else { 1.0 };
            }
        }
        for block in self.blocks.iter().filter(|block| block.square > 0.0) {
            let pivot = block.square * grow;
            for i in 0..4 {
                right[i] += block.cross[i] * block.gradient / pivot;
                for j in i..4 {
                    matrix[i][j] -= block.cross[i] * block.cross[j] / pivot;
                }
            }
        }
        for i in 0..4 {
            for j in 0..i {
                matrix[i][j] = matrix[j][i];
            }
        }
        for i in (0..4).filter(|&i| !free[i]) {
            for j in 0..4 {
                matrix[i][j] = 0.0;
                matrix[j][i] = 0.0;
            }
            matrix[i][i] = 1.0;
            right[i] = 0.0;
        }
        (matrix, right)
    }

    /// Moves core and blocks by the step with `damping` times the diagonal added. What the linear model
    /// gains by it, and the largest change; `None` where it has no solution.
    pub(crate) fn step(
        &self,
        core: &mut [f64; 4],
        beside: &mut [f64],
        damping: f64,
        free: [bool; 4],
    ) -> Option<(f64, f64)> {
        let (matrix, right) = self.reduced(damping, free);
        let by = solve_4(&matrix, &right)?;
        let grow = 1.0 + damping;
        let (mut gain, mut size) = (0.0, 0.0_f64);
        for i in 0..4 {
            core[i] += by[i];
            // Gain of the linear model under damping: step' (damping D step - gradient).
            gain += by[i] * (damping * self.core[i][i] * by[i] - self.gradient[i]);
            size = size.max(by[i].abs());
        }
        for (value, block) in beside.iter_mut().zip(&self.blocks) {
            if block.square > 0.0 {
                let coupled: f64 = block.cross.iter().zip(&by).map(|(c, s)| c * s).sum();
                let step = -(block.gradient + coupled) / (block.square * grow);
                *value += step;
                gain += step * (damping * block.square * step - block.gradient);
                size = size.max(step.abs());
            }
        }
        Some((gain, size))
    }

    /// Information about the core: the inverse of its covariance, held unknowns with rows of zeros.
    pub(crate) fn information(&self, free: [bool; 4]) -> Matrix4<f64> {
        let (matrix, _) = self.reduced(0.0, free);
        let mut information = Matrix4::from_fn(|i, j| matrix[i][j]);
        for i in (0..4).filter(|&i| !free[i]) {
            information[(i, i)] = 0.0;
        }
        information
    }
}

/// The covariance of the free unknowns and its weakest direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertainty {
    /// Of roll, pitch, log focal, log height; zeros for those held. Where the evidence leaves a
    /// direction open, its variance is large, not infinite.
    pub(crate) covariance: Matrix4<f64>,
    /// Whether the evidence leaves a direction open.
    pub(crate) singular: bool,
}

impl Uncertainty {
    /// From information with rows of zeros for what is held.
    pub(crate) fn new(information: &Matrix4<f64>, free: [bool; 4]) -> Self {
        /// Relative to the best-known direction: below it the inverse is rounding.
        const OPEN: f64 = 1e-13;
        let scale: [f64; 4] = std::array::from_fn(|i| {
            let diagonal = information[(i, i)];
            if free[i] && diagonal > 0.0 { diagonal.sqrt().recip() } else { 0.0 }
        });
        let untouched = (0..4).any(|i| free[i] && scale[i] == 0.0);
        let scaled = Matrix4::from_fn(|i, j| {
            if scale[i] == 0.0 || scale[j] == 0.0 {
                f64::from(u8::from(i == j))
            } else {
                information[(i, j)] * scale[i] * scale[j]
            }
        });
        let eigen = SymmetricEigen::new(scaled);
        let most = eigen.eigenvalues.max();
        let least = OPEN * most;
        let singular = untouched || eigen.eigenvalues.min() < least;
        let inverse = eigen.eigenvectors
            * Matrix4::from_diagonal(&eigen.eigenvalues.map(|value| value.max(least).recip()))
            * eigen.eigenvectors.transpose();
        let mut covariance = Matrix4::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]);
        for i in (0..4).filter(|&i| free[i] && scale[i] == 0.0) {
            // Nothing at all is known of it: as uncertain as a factor of e^1000.
            covariance[(i, i)] = 1e6;
        }
        Self { covariance, singular }
    }

    pub(crate) fn sigma(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }
}

/// Solves a symmetric positive system by Cholesky; `None` when it is not positive.
fn solve_4(matrix: &[[f64; 4]; 4], right: &[f64; 4]) -> Option<[f64; 4]> {
    let mut lower = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - sum;
            if i == j {
                if rest <= 1e-15 * matrix[i][i] || rest.is_nan() {
                    return None;
                }
                lower[i][i] = rest.sqrt();
            } else {
                lower[i][j] = rest / lower[j][j];
            }
        }
    }
    let mut x = *right;
    for i in 0..4 {
        let sum: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    for i in (0..4).rev() {
        let sum: f64 = (i + 1..4).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    Some(x)
}
