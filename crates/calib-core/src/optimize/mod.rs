//! Minimisers and the linear algebra of their normal equations.
//!
//! Law: no geometry. Problems come as residuals with Jacobians; what they mean is known by who calls.

mod nelder_mead;
mod levenberg_marquardt;
mod sparse_cholesky;
mod dense_block;
mod block_structure;
mod schur_complement;
mod dual;
mod arrow;

pub(crate) use arrow::{Normal, Uncertainty};
pub(crate) use block_structure::{BlockStructure, JacobianBlock, NormalEquations};
pub(crate) use dual::{Dual, Number};
pub(crate) use levenberg_marquardt::{LeastSquares, Summary, least_squares};
#[cfg(test)]
pub(crate) use levenberg_marquardt::{LevenbergMarquardt, Termination};
pub(crate) use nelder_mead::nelder_mead;
pub(crate) use schur_complement::BlockCovariance;
