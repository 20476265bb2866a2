//! Minimisers of cost functions, and the linear algebra of their normal equations.
//!
//! Rule: no geometry. A problem consists of residuals with Jacobians; only the caller interprets it. The
//! files:
//!
//! - `statistics`: scores, quantiles and tails of the normal and chi-square distributions.
//! - `nelder_mead`: minimiser without derivatives, for the criterion of the paper.
//! - `levenberg_marquardt`: minimiser for sums of squares (`LeastSquares`, `least_squares`).
//! - `dense`: arithmetic of small dense blocks, and products of large matrices.
//! - `sparse_cholesky`: Cholesky factorisation and solution of sparse systems in blocks.
//! - `selected_inverse`: the blocks of the inverse of a sparse matrix within the pattern of its factor.
//! - `block_structure`: the normal equations of a bundle adjustment, in parameter blocks.
//! - `schur_complement`: elimination of landmarks, and the step and covariance of a bundle adjustment.
//! - `dual`: dual numbers for the Jacobians of stage 1.
//! - `arrow`: the normal equations of stage 1, with four core parameters and blocks of nuisance parameters.

mod statistics;
mod nelder_mead;
mod levenberg_marquardt;
mod dense;
mod sparse_cholesky;
mod selected_inverse;
mod block_structure;
mod schur_complement;
mod dual;
mod arrow;

pub(crate) use arrow::{Normal, NuisanceJacobian, NuisanceLayout, Uncertainty};
pub(crate) use block_structure::{BlockStructure, JacobianBlock, NormalEquations};
pub(crate) use dense::{damp_diagonal, product, pseudo_invert};
pub(crate) use dual::{ByLens, Dual, Gradient, Number, NumberOver};
#[cfg(test)]
pub(crate) use levenberg_marquardt::Termination;
pub(crate) use levenberg_marquardt::{
    LeastSquares, LevenbergMarquardt, Summary, least_squares, least_squares_unless,
};
pub(crate) use nelder_mead::nelder_mead;
pub(crate) use schur_complement::BlockCovariance;
pub(crate) use sparse_cholesky::{CholeskyFactor, SparseStructure};
pub use statistics::{
    MISFIT_SCORE, chi2_median_per_dof, chi2_score, is_misfit, two_sided_quantile, two_sided_tail,
};
