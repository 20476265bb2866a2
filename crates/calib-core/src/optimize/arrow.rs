//! Arrow-shaped normal equations: four core parameters, and any number of nuisance parameters each of which
//! is coupled with the core only.
//!
//! With core steps `c` and nuisance steps `n_k` the damped equations are
//!
//! ```text
//! A c + sum_k b_k n_k = -g          A, g: J'J and J'r of the core
//! b_k' c + d_k n_k    = -h_k        d_k, b_k, h_k: of nuisance k with itself, with the core, and J'r
//! ```
//!
//! an arrow of a 4 x 4 block, a border and a diagonal. Elimination of `n_k = -(h_k + b_k' c) / d_k` leaves
//!
//! `(A - sum_k b_k b_k' / d_k) c = -g + sum_k b_k h_k / d_k`,
//!
//! 4 x 4 whatever was drawn: the Schur complement (see `schur_complement.rs`) with blocks of one, without
//! allocation. Its matrix without damping is the information about the core; the inverse is the covariance
//! of the core with the nuisances free.

use nalgebra::{Matrix4, SymmetricEigen};

use crate::optimize::dual::Gradient;

/// Normal equations at a state.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    pub(crate) cost: f64,
    core: [[f64; 4]; 4],
    gradient: [f64; 4],
    nuisances: Vec<Nuisance>,
}

/// Sums of one nuisance parameter: `d`, `b` and `h`.
#[derive(Clone, Copy, Debug, Default)]
struct Nuisance {
    square: f64,
    cross: [f64; 4],
    gradient: f64,
}

impl Normal {
    pub(crate) fn new(nuisances: usize) -> Self {
        Self {
            cost: 0.0,
            core: [[0.0; 4]; 4],
            gradient: [0.0; 4],
            nuisances: vec![Nuisance::default(); nuisances],
        }
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
            let sums = &mut self.nuisances[index];
            sums.square += derivative * derivative;
            sums.gradient += derivative * residual;
            for i in 0..4 {
                sums.cross[i] += derivative * gradient[i];
            }
        }
    }

    /// The equations of the core with every nuisance parameter eliminated, `damping` times the diagonal
    /// added; a fixed parameter has a row of the identity.
    fn reduced(&self, damping: f64, free: [bool; 4]) -> ([[f64; 4]; 4], [f64; 4]) {
        let scaling = 1.0 + damping;
        let mut matrix = [[0.0; 4]; 4];
        let mut right = self.gradient.map(|g| -g);
        for i in 0..4 {
            for j in i..4 {
                matrix[i][j] = self.core[i][j] * if i == j { scaling } else { 1.0 };
            }
        }
        for nuisance in self.nuisances.iter().filter(|nuisance| nuisance.square > 0.0) {
            let pivot = nuisance.square * scaling;
            for i in 0..4 {
                right[i] += nuisance.cross[i] * nuisance.gradient / pivot;
                for j in i..4 {
                    matrix[i][j] -= nuisance.cross[i] * nuisance.cross[j] / pivot;
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

    /// Moves core and nuisances by the step with `damping` times the diagonal added. The decrease of the cost
    /// that the linear model predicts for it, and the largest change; `None` where there is no solution.
    pub(crate) fn step(
        &self,
        core: &mut [f64; 4],
        nuisances: &mut [f64],
        damping: f64,
        free: [bool; 4],
    ) -> Option<(f64, f64)> {
        let (matrix, right) = self.reduced(damping, free);
        let step = solve_4(&matrix, &right)?;
        let scaling = 1.0 + damping;
        let (mut gain, mut size) = (0.0, 0.0_f64);
        for i in 0..4 {
            core[i] += step[i];
            // d' (lambda D d - J'r), the decrease of the linear model.
            gain += step[i] * (damping * self.core[i][i] * step[i] - self.gradient[i]);
            size = size.max(step[i].abs());
        }
        for (value, sums) in nuisances.iter_mut().zip(&self.nuisances) {
            if sums.square > 0.0 {
                let coupled: f64 = sums.cross.iter().zip(&step).map(|(c, s)| c * s).sum();
                let own = -(sums.gradient + coupled) / (sums.square * scaling);
                *value += own;
                gain += own * (damping * sums.square * own - sums.gradient);
                size = size.max(own.abs());
            }
        }
        Some((gain, size))
    }

    /// Information matrix of the core, the inverse of its covariance; rows of zeros for fixed parameters.
    pub(crate) fn information(&self, free: [bool; 4]) -> Matrix4<f64> {
        let (matrix, _) = self.reduced(0.0, free);
        let mut information = Matrix4::from_fn(|i, j| matrix[i][j]);
        for i in (0..4).filter(|&i| !free[i]) {
            information[(i, i)] = 0.0;
        }
        information
    }
}

/// The covariance of the core.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertainty {
    /// Of roll, pitch, log focal, log height; zeros for those that are not free. A direction that the
    /// residuals do not determine has a large variance, not an infinite one.
    pub(crate) covariance: Matrix4<f64>,
    /// Whether a direction is not determined by the residuals.
    pub(crate) singular: bool,
}

impl Uncertainty {
    /// From information with rows of zeros for what is not free.
    pub(crate) fn new(information: &Matrix4<f64>, free: [bool; 4]) -> Self {
        /// Least eigenvalue relative to the largest: below it the inverse is rounding.
        const SINGULAR: f64 = 1e-13;
        let scale: [f64; 4] = std::array::from_fn(|i| {
            let diagonal = information[(i, i)];
            if free[i] && diagonal > 0.0 { diagonal.sqrt().recip() } else { 0.0 }
        });
        let is_unobserved = (0..4).any(|i| free[i] && scale[i] == 0.0);
        let scaled = Matrix4::from_fn(|i, j| {
            if scale[i] == 0.0 || scale[j] == 0.0 {
                f64::from(u8::from(i == j))
            } else {
                information[(i, j)] * scale[i] * scale[j]
            }
        });
        let eigen = SymmetricEigen::new(scaled);
        let most = eigen.eigenvalues.max();
        let least = SINGULAR * most;
        let singular = is_unobserved || eigen.eigenvalues.min() < least;
        let inverse = eigen.eigenvectors
            * Matrix4::from_diagonal(&eigen.eigenvalues.map(|value| value.max(least).recip()))
            * eigen.eigenvectors.transpose();
        let mut covariance = Matrix4::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]);
        for i in (0..4).filter(|&i| free[i] && scale[i] == 0.0) {
            // No residual depends on it: a standard deviation of 1000 radians or log units.
            covariance[(i, i)] = 1e6;
        }
        Self { covariance, singular }
    }

    pub(crate) fn sigma(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }
}

/// Solves a symmetric positive definite system by Cholesky; `None` when it is not positive definite.
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
