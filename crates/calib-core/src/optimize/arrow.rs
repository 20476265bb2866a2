//! Arrow-shaped normal equations: four core parameters, and any number of nuisance parameters in blocks. Each
//! block is coupled only with the core and with itself.
//!
//! With core steps `c` and the steps `n_k` of block k the damped equations are
//!
//! ```text
//! A c + sum_k B_k' n_k = -g         A, g: J'J and J'r of the core
//! B_k c + D_k n_k      = -h_k       D_k, B_k, h_k: of block k with itself, with the core, and J'r
//! ```
//!
//! This is an arrow of a 4 x 4 block, a border and a diagonal of small blocks. Elimination of
//! `n_k = -D_k^-1 (h_k + B_k c)` gives
//!
//! `(A - sum_k B_k' D_k^-1 B_k) c = -g + sum_k B_k' D_k^-1 h_k`.
//!
//! This Schur complement (see `schur_complement.rs`) is 4 x 4 for any number of annotations. With the
//! Cholesky factor `D_k = L L'`, `W = L^-1 B_k` and `w = L^-1 h_k` its terms are `W' W` and `W' w`. Its
//! matrix without damping is the information matrix of the core. The inverse is the covariance of the core
//! with free nuisance parameters.

use nalgebra::{Matrix4, SymmetricEigen};

/// Number of core parameters.
const CORE: usize = 4;

/// Blocks of the nuisance parameters.
#[derive(Clone, Debug, Default)]
pub(crate) struct NuisanceLayout {
    /// Block of every nuisance parameter, and its index in the block.
    pub(crate) positions: Vec<(usize, usize)>,
    /// Size of every block.
    pub(crate) sizes: Vec<usize>,
}

/// Largest number of nuisance parameters that a residual depends on.
const MAX_DERIVATIVES: usize = 5;

/// Derivatives of a residual by at most [`MAX_DERIVATIVES`] nuisance parameters of one block, as pairs of
/// index and derivative.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NuisanceJacobian {
    count: usize,
    by: [(usize, f64); MAX_DERIVATIVES],
}

impl NuisanceJacobian {
    /// Derivatives of a residual without nuisance parameters.
    pub(crate) const NONE: Self = Self { count: 0, by: [(0, 0.0); MAX_DERIVATIVES] };

    /// Creates the derivative of a residual that depends on one nuisance parameter.
    #[inline]
    pub(crate) fn new(index: usize, derivative: f64) -> Self {
        Self::NONE.with_derivative(index, derivative)
    }

    /// Adds one derivative. Derivatives beyond [`MAX_DERIVATIVES`] are dropped.
    #[inline]
    pub(crate) fn with_derivative(mut self, index: usize, derivative: f64) -> Self {
        if let Some(entry) = self.by.get_mut(self.count) {
            *entry = (index, derivative);
            self.count += 1;
        }
        self
    }

    /// Adds the derivatives of another list.
    #[inline]
    pub(crate) fn with_all(self, other: &Self) -> Self {
        other.entries().iter().fold(self, |all, &(index, derivative)| all.with_derivative(index, derivative))
    }

    #[inline]
    pub(crate) fn entries(&self) -> &[(usize, f64)] {
        &self.by[..self.count]
    }
}

/// Normal equations at a state.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    pub(crate) cost: f64,
    core: [[f64; CORE]; CORE],
    gradient: [f64; CORE],
    places: Vec<(usize, usize)>,
    blocks: Vec<Block>,
    /// Rows of all blocks, concatenated.
    rows: Vec<Row>,
    /// Square matrices of all blocks, concatenated, row by row.
    squares: Vec<f64>,
}

/// Offsets of the rows and of the square matrix of a block of nuisance parameters.
#[derive(Clone, Copy, Debug)]
struct Block {
    size: usize,
    row: usize,
    square: usize,
}

/// Row of `B` and entry of `h` for one nuisance parameter: its coupling with the core, and its gradient.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    cross: [f64; CORE],
    gradient: f64,
}

/// Eliminated blocks, concatenated as in [`Normal`]: `L`, row by row, and the rows of `W` with `w`.
struct Eliminated {
    lower: Vec<f64>,
    rows: Vec<Row>,
}

impl Normal {
    pub(crate) fn new(layout: NuisanceLayout) -> Self {
        let (mut row, mut square) = (0, 0);
        let place = |&size: &usize| {
            let block = Block { size, row, square };
            row += size;
            square += size * size;
            block
        };
        let blocks: Vec<Block> = layout.sizes.iter().map(place).collect();
        Self {
            cost: 0.0,
            core: [[0.0; CORE]; CORE],
            gradient: [0.0; CORE],
            places: layout.positions,
            blocks,
            rows: vec![Row::default(); row],
            squares: vec![0.0; square],
        }
    }

    /// Adds a residual with its derivatives. The first four entries of `gradient` are the derivatives by the
    /// core.
    #[inline]
    pub(crate) fn add(&mut self, residual: f64, gradient: &[f64], nuisance: &NuisanceJacobian) {
        self.add_weighted(1.0, residual, gradient, nuisance);
    }

    /// Removes a residual that was added before.
    pub(crate) fn remove(&mut self, residual: f64, gradient: &[f64], nuisance: &NuisanceJacobian) {
        self.add_weighted(-1.0, residual, gradient, nuisance);
    }

    #[inline]
    fn add_weighted(&mut self, weight: f64, residual: f64, gradient: &[f64], nuisance: &NuisanceJacobian) {
        self.cost += weight * residual * residual;
        for i in 0..CORE {
            let by = weight * gradient[i];
            self.gradient[i] += by * residual;
            for j in i..CORE {
                self.core[i][j] += by * gradient[j];
            }
        }
        for &(index, derivative) in nuisance.entries() {
            let by = weight * derivative;
            let (block, place) = self.places[index];
            let Block { size, row, square } = self.blocks[block];
            let sums = &mut self.rows[row + place];
            sums.gradient += by * residual;
            for i in 0..CORE {
                sums.cross[i] += by * gradient[i];
            }
            for &(other, by_other) in nuisance.entries() {
                let column = self.places[other].1;
                self.squares[square + place * size + column] += by * by_other;
            }
        }
    }

    /// Eliminates all blocks, with their diagonals multiplied by `scaling`. A parameter does not move if no
    /// residual depends on it, or if the others of its block determine it.
    fn eliminated(&self, scaling: f64) -> Eliminated {
        let (mut rows, mut lower) = (self.rows.clone(), self.squares.clone());
        for &Block { size, row, square } in &self.blocks {
            let rows = &mut rows[row..row + size];
            let lower = &mut lower[square..square + size * size];
            for i in 0..size {
                let whole = lower[i * size + i] * scaling;
                for j in 0..=i {
                    let sum: f64 = (0..j).map(|k| lower[i * size + k] * lower[j * size + k]).sum();
                    let pivot = lower[j * size + j];
                    lower[i * size + j] = match i == j {
                        true if whole - sum > 1e-14 * whole => (whole - sum).sqrt(),
                        false if pivot > 0.0 => (lower[i * size + j] - sum) / pivot,
                        _ => 0.0,
                    };
                }
                substitute(rows, &lower[i * size..i * size + i + 1]);
            }
        }
        Eliminated { lower, rows }
    }

    /// Returns the equations of the core with all nuisance parameters eliminated, and the eliminated blocks.
    /// The diagonal is multiplied by `1 + damping`. A fixed parameter has a row of the identity.
    fn reduced(&self, damping: f64, free: [bool; CORE]) -> ([[f64; CORE]; CORE], [f64; CORE], Eliminated) {
        let scaling = 1.0 + damping;
        let mut matrix = self.core;
        let mut right = self.gradient.map(|g| -g);
        (0..CORE).for_each(|i| matrix[i][i] *= scaling);
        let eliminated = self.eliminated(scaling);
        for Row { cross, gradient } in &eliminated.rows {
            for i in 0..CORE {
                right[i] += cross[i] * gradient;
                for j in i..CORE {
                    matrix[i][j] -= cross[i] * cross[j];
                }
            }
        }
        for i in 0..CORE {
            for j in 0..i {
                matrix[i][j] = matrix[j][i];
            }
        }
        for i in (0..CORE).filter(|&i| !free[i]) {
            for j in 0..CORE {
                matrix[i][j] = 0.0;
                matrix[j][i] = 0.0;
            }
            matrix[i][i] = 1.0;
            right[i] = 0.0;
        }
        (matrix, right, eliminated)
    }

    /// Applies the damped step to the core and the nuisance parameters. Returns the decrease of the cost that
    /// the linear model predicts, and the largest change. Returns `None` if there is no solution.
    pub(crate) fn step(
        &self,
        core: &mut [f64; CORE],
        nuisances: &mut [f64],
        damping: f64,
        free: [bool; CORE],
    ) -> Option<(f64, f64)> {
        let (matrix, right, eliminated) = self.reduced(damping, free);
        let step = solve_4(&matrix, &right)?;
        let (mut gain, mut size) = (0.0, 0.0_f64);
        for i in 0..CORE {
            core[i] += step[i];
            // Decrease of the linear model: d' (lambda D d - J'r).
            gain += step[i] * (damping * self.core[i][i] * step[i] - self.gradient[i]);
            size = size.max(step[i].abs());
        }
        let steps = self.back_substitute(&eliminated, &step);
        for (value, &(block, place)) in nuisances.iter_mut().zip(&self.places) {
            let Block { size: width, row, square } = self.blocks[block];
            let own = steps[row + place];
            *value += own;
            let diagonal = self.squares[square + place * width + place];
            gain += own * (damping * diagonal * own - self.rows[row + place].gradient);
            size = size.max(own.abs());
        }
        Some((gain, size))
    }

    /// Returns the steps of all blocks for the step of the core: `L' n = -(w + W c)`.
    fn back_substitute(&self, eliminated: &Eliminated, core: &[f64; CORE]) -> Vec<f64> {
        let Eliminated { lower, rows } = eliminated;
        let coupled = |row: &Row| row.cross.iter().zip(core).map(|(c, s)| c * s).sum::<f64>();
        let mut steps: Vec<f64> = rows.iter().map(|row| -(row.gradient + coupled(row))).collect();
        for &Block { size, row, square } in &self.blocks {
            let (steps, lower) = (&mut steps[row..row + size], &lower[square..square + size * size]);
            for i in (0..size).rev() {
                let sum: f64 = (i + 1..size).map(|k| lower[k * size + i] * steps[k]).sum();
                let pivot = lower[i * size + i];
                steps[i] = if pivot > 0.0 { (steps[i] - sum) / pivot } else { 0.0 };
            }
        }
        steps
    }

    /// Returns the log of the determinant of the whole matrix, over the core and the nuisance parameters that
    /// residuals depend on.
    pub(crate) fn log_determinant(&self, free: [bool; CORE]) -> f64 {
        let (matrix, _, eliminated) = self.reduced(0.0, free);
        let core = Matrix4::from_fn(|i, j| matrix[i][j]).symmetric_eigenvalues();
        let pivots = self.blocks.iter().flat_map(|&Block { size, square, .. }| {
            (0..size).map(move |i| square + i * size + i).map(|at| eliminated.lower[at].powi(2))
        });
        core.iter().copied().chain(pivots).filter(|&value| value > 0.0).map(f64::ln).sum()
    }

    /// Returns the information matrix of the core, the inverse of its covariance. Fixed parameters have zero
    /// rows.
    pub(crate) fn information(&self, free: [bool; CORE]) -> Matrix4<f64> {
        let (matrix, ..) = self.reduced(0.0, free);
        let mut information = Matrix4::from_fn(|i, j| matrix[i][j]);
        for i in (0..CORE).filter(|&i| !free[i]) {
            information[(i, i)] = 0.0;
        }
        information
    }
}

/// Applies forward substitution to the last of the given rows of `B` and `h`. `lower` is its row of `L`.
#[inline]
fn substitute(rows: &mut [Row], lower: &[f64]) {
    let i = lower.len() - 1;
    let mut own = rows[i];
    for (factor, row) in lower.iter().zip(&rows[..i]) {
        own.gradient -= factor * row.gradient;
        for k in 0..CORE {
            own.cross[k] -= factor * row.cross[k];
        }
    }
    let inverse = if lower[i] > 0.0 { lower[i].recip() } else { 0.0 };
    rows[i] = Row { cross: own.cross.map(|c| c * inverse), gradient: own.gradient * inverse };
}

/// Covariance of the core.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertainty {
    /// Covariance of roll, pitch, log focal length and log height; zero for fixed parameters. A direction
    /// that the residuals do not determine has a large, finite variance.
    pub(crate) covariance: Matrix4<f64>,
    /// Whether the residuals leave a direction undetermined.
    pub(crate) is_singular: bool,
}

impl Uncertainty {
    /// Inverts an information matrix with zero rows for fixed parameters.
    pub(crate) fn new(information: &Matrix4<f64>, free: [bool; 4]) -> Self {
        /// Minimum eigenvalue relative to the largest. Below it the inverse is dominated by rounding.
        const MIN_EIGENVALUE_RATIO: f64 = 1e-13;
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
        let least = MIN_EIGENVALUE_RATIO * most;
        let is_singular = is_unobserved || eigen.eigenvalues.min() < least;
        let inverse = eigen.eigenvectors
            * Matrix4::from_diagonal(&eigen.eigenvalues.map(|value| value.max(least).recip()))
            * eigen.eigenvectors.transpose();
        let mut covariance = Matrix4::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]);
        for i in (0..4).filter(|&i| free[i] && scale[i] == 0.0) {
            // No residual depends on the parameter: a standard deviation of 1000 radians or log units.
            covariance[(i, i)] = 1e6;
        }
        Self { covariance, is_singular }
    }

    pub(crate) fn sigma(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }
}

/// Solves a symmetric positive definite system by Cholesky. Returns `None` if the matrix is not positive
/// definite.
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
