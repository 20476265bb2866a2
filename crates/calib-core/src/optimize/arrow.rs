//! Arrow-shaped normal equations: four core parameters, and any number of nuisance parameters in blocks. Each
//! block is coupled only with the core and with itself.
//!
//! With the step `c` of the core, the step `n_k` of block k, the residuals r and their Jacobian J, the damped
//! equations are
//!
//! ```text
//! A c + sum_k B_k' n_k = -g         A, g: J'J and J'r of the core
//! B_k c + D_k n_k      = -h_k       D_k, B_k: J'J of block k with itself and with the core; h_k: its J'r
//! ```
//!
//! This is an arrow of a 4 x 4 block, a border and a diagonal of small blocks. Elimination of
//! `n_k = -D_k^-1 (h_k + B_k c)` gives
//!
//! `(A - sum_k B_k' D_k^-1 B_k) c = -g + sum_k B_k' D_k^-1 h_k`.
//!
//! This Schur complement (see `schur_complement.rs`) is 4 x 4 for any number of annotations. With the
//! Cholesky factor L in `D_k = L L'`, `W = L^-1 B_k` and `w = L^-1 h_k`, the terms of both sums are `W' W`
//! and `W' w`. The reduced matrix without damping is the information matrix of the core. Its inverse is the
//! covariance of the core if the nuisance parameters are free.

use nalgebra::{Matrix4, SymmetricEigen};

/// Number of core parameters: roll, pitch, log focal length and log height.
const CORE: usize = 4;

/// Layout of the nuisance parameters in blocks.
#[derive(Clone, Debug, Default)]
pub(crate) struct NuisanceLayout {
    /// Block of every nuisance parameter, and the index of the parameter in the block.
    pub(crate) positions: Vec<(usize, usize)>,
    /// Number of parameters of every block.
    pub(crate) sizes: Vec<usize>,
}

/// Maximum number of nuisance parameters on which a residual depends.
const MAX_DERIVATIVES: usize = 5;

/// Derivatives of a residual with respect to at most [`MAX_DERIVATIVES`] nuisance parameters of one block, as
/// pairs of parameter index and derivative.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NuisanceJacobian {
    /// Number of pairs that are used.
    count: usize,
    /// Pairs of parameter index and derivative.
    by: [(usize, f64); MAX_DERIVATIVES],
}

impl NuisanceJacobian {
    /// Derivatives of a residual that depends on no nuisance parameter: an empty list.
    pub(crate) const NONE: Self = Self { count: 0, by: [(0, 0.0); MAX_DERIVATIVES] };

    /// Creates the list of a residual that depends on one nuisance parameter.
    #[inline]
    pub(crate) fn new(index: usize, derivative: f64) -> Self {
        Self::NONE.with_derivative(index, derivative)
    }

    /// Returns this list with one more derivative. Derivatives beyond [`MAX_DERIVATIVES`] are dropped.
    #[inline]
    pub(crate) fn with_derivative(mut self, index: usize, derivative: f64) -> Self {
        if let Some(entry) = self.by.get_mut(self.count) {
            *entry = (index, derivative);
            self.count += 1;
        }
        self
    }

    /// Returns this list with the derivatives of another list appended.
    #[inline]
    pub(crate) fn with_all(self, other: &Self) -> Self {
        other.entries().iter().fold(self, |all, &(index, derivative)| all.with_derivative(index, derivative))
    }

    /// Returns the pairs of parameter index and derivative.
    #[inline]
    pub(crate) fn entries(&self) -> &[(usize, f64)] {
        &self.by[..self.count]
    }
}

/// Arrow-shaped normal equations of stage 1 at a state. For the symbols, see the module documentation.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    /// Sum of squares of the residuals.
    pub(crate) cost: f64,
    /// Matrix A of the core, upper triangle.
    core: [[f64; CORE]; CORE],
    /// Gradient g of the core.
    gradient: [f64; CORE],
    /// Block of every nuisance parameter, and the index of the parameter in the block.
    places: Vec<(usize, usize)>,
    /// Sizes and offsets of the blocks of nuisance parameters.
    blocks: Vec<Block>,
    /// Rows of all blocks with core coupling and gradient, concatenated.
    rows: Vec<Row>,
    /// Matrices D of all blocks, concatenated, row by row.
    squares: Vec<f64>,
}

/// Size of a block of nuisance parameters, and the offsets of its data in [`Normal`].
#[derive(Clone, Copy, Debug)]
struct Block {
    /// Number of parameters of the block.
    size: usize,
    /// Index of its first row among the rows of all blocks.
    row: usize,
    /// Offset of its matrix D among the matrices of all blocks.
    square: usize,
}

/// Row of `B` and entry of `h` for one nuisance parameter. After the elimination: row of `W` and entry of
/// `w`.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    /// Coupling of the parameter with the core: row of `B` or `W`.
    cross: [f64; CORE],
    /// Gradient of the parameter: entry of `h` or `w`.
    gradient: f64,
}

/// Eliminated blocks of nuisance parameters, concatenated as in [`Normal`].
struct Eliminated {
    /// Cholesky factors `L` of all blocks, row by row.
    lower: Vec<f64>,
    /// Rows of `W` with entries of `w`.
    rows: Vec<Row>,
}

impl Normal {
    /// Creates empty normal equations, with all entries zero.
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

    /// Adds a residual to the normal equations. The first four entries of `gradient` are the derivatives of
    /// the residual with respect to the core parameters.
    #[inline]
    pub(crate) fn add(&mut self, residual: f64, gradient: &[f64], nuisance: &NuisanceJacobian) {
        self.add_weighted(1.0, residual, gradient, nuisance);
    }

    /// Removes a residual that was added to the normal equations before, with the same derivatives.
    pub(crate) fn remove(&mut self, residual: f64, gradient: &[f64], nuisance: &NuisanceJacobian) {
        self.add_weighted(-1.0, residual, gradient, nuisance);
    }

    /// Adds the products of a residual and its derivatives, multiplied by `weight`.
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

    /// Eliminates all blocks of nuisance parameters, with their diagonals multiplied by `scaling`. A
    /// parameter does not change in the step in two cases: no residual depends on it, or its row of D depends
    /// linearly on the rows before it.
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
                substitute_row(rows, &lower[i * size..i * size + i + 1]);
            }
        }
        Eliminated { lower, rows }
    }

    /// Returns the matrix and the right-hand side of the core with all nuisance parameters eliminated, and
    /// the eliminated blocks. The diagonal is multiplied by `1 + damping`. `free` flags the core parameters
    /// that are not fixed. The row of a fixed parameter is a row of the identity.
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

    /// Adds the damped step to the core parameters and the nuisance parameters. Returns the decrease of the
    /// cost that the linear model predicts, and the largest change of a parameter. Returns `None` if the
    /// equations have no unique solution.
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
            // Predicted decrease of the cost: d' (lambda diag(J'J) d - J'r), with the step d and the damping
            // lambda.
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

    /// Returns the steps n of all nuisance parameters for the step c of the core: the solutions of
    /// `L' n = -(w + W c)`.
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

    /// Returns the log of the determinant of the whole matrix `J'J`, without damping. Nuisance parameters on
    /// which no residual depends are left out.
    pub(crate) fn log_determinant(&self, free: [bool; CORE]) -> f64 {
        let (matrix, _, eliminated) = self.reduced(0.0, free);
        let core = Matrix4::from_fn(|i, j| matrix[i][j]).symmetric_eigenvalues();
        let pivots = self.blocks.iter().flat_map(|&Block { size, square, .. }| {
            (0..size).map(move |i| square + i * size + i).map(|at| eliminated.lower[at].powi(2))
        });
        core.iter().copied().chain(pivots).filter(|&value| value > 0.0).map(f64::ln).sum()
    }

    /// Returns the information matrix of the core, which is the inverse of its covariance matrix. The rows
    /// and columns of fixed parameters are zero.
    pub(crate) fn information(&self, free: [bool; CORE]) -> Matrix4<f64> {
        let (matrix, ..) = self.reduced(0.0, free);
        let mut information = Matrix4::from_fn(|i, j| matrix[i][j]);
        for i in (0..CORE).filter(|&i| !free[i]) {
            information[(i, i)] = 0.0;
        }
        information
    }
}

/// Replaces the last of the given rows of `B` and `h` by its row of `W` and `w`, by forward substitution. The
/// rows before it are already replaced. `lower` is the row of `L` with the same index.
#[inline]
fn substitute_row(rows: &mut [Row], lower: &[f64]) {
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

/// Uncertainty of the core parameters of stage 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertainty {
    /// Covariance of roll, pitch (radians), log focal length and log height; zero for fixed parameters. A
    /// direction that the residuals do not determine has a large, finite variance.
    pub(crate) covariance: Matrix4<f64>,
    /// Whether the residuals do not determine some direction in the space of the free parameters.
    pub(crate) is_singular: bool,
}

impl Uncertainty {
    /// Inverts an information matrix. The rows and columns of fixed parameters, for which `free` is false,
    /// are zero.
    pub(crate) fn new(information: &Matrix4<f64>, free: [bool; 4]) -> Self {
        /// Minimum ratio of an eigenvalue to the largest eigenvalue. Smaller eigenvalues are rounding errors,
        /// and are replaced by the minimum.
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
            // If no residual depends on a parameter, its standard deviation is 1000 radians or log units.
            covariance[(i, i)] = 1e6;
        }
        Self { covariance, is_singular }
    }

    /// Returns the standard deviation of a core parameter, in radians or log units.
    pub(crate) fn sigma(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }
}

/// Solves a symmetric system of four equations by Cholesky factorisation. Returns `None` if the matrix is not
/// positive definite.
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
