//! Minimisers and the linear algebra of their normal equations.
//!
//! Law: no geometry. Problems come as residuals with Jacobians; what they mean, the caller knows.
//!
//! - `nelder_mead` for the paper's criterion, which has no derivatives; `levenberg_marquardt` for every sum of
//!   squares ([`LeastSquares`], [`least_squares`]);
//! - `sparse_structure`, `packed_product`, `sparse_cholesky`, `selected_inverse` sparse systems in blocks: order,
//!   factor, solution, inverse; `dense_block`, `block_structure`, `schur_complement` the normal equations of a bundle
//!   adjustment in parameter blocks: elimination of landmarks, step, covariance;
//! - `dual` dual numbers, for the Jacobians of stage 1; `arrow` its normal equations, four core parameters and
//!   nuisance parameters in blocks.

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
pub(crate) use dense::{product, pseudo_invert};
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
