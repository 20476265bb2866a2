//! Minimisers and the linear algebra of their normal equations.
//!
//! Law: no geometry. Problems come as residuals with Jacobians; what they mean is known by who calls.

mod minimize;
mod sparse_cholesky;
mod schur_complement;
mod dual;
mod arrow;

pub(crate) use arrow::{Normal, Uncertainty};
pub(crate) use dual::{Dual, Number};
pub(crate) use minimize::{LeastSquares, Summary, least_squares, nelder_mead};
#[cfg(test)]
pub(crate) use minimize::{LevenbergMarquardt, Termination};
pub(crate) use schur_complement::{BlockCovariance, BlockStructure, JacobianBlock, NormalEquations};
