//! How a solve ended, as values with a subject and numbers: findings about a result, or the failure to give
//! one.
//!
//! Law: no words. Sentences are made of these values once, where they leave the core (`site/english`).
//!
//! - `code` the closed lists of codes, and their severity;
//! - `subject` what a finding is about; `suggestion` the drawing that would improve a result;
//! - `finding` what an operator should know about a result; `failure` why there is none;
//! - `residual` the residual of one observation, as reports have it. Where residuals are computed:
//!   `single/residual.rs` for drawings, `bundle/landmark.rs` for landmarks.

mod code;
mod subject;
mod finding;
mod failure;

pub use code::{Code, Severity};
pub use failure::{Failure, FailureCode};
pub use finding::{
    Drawing, Estimator, Finding, OtherMinimum, SharedEvidence, Suggestion, WhyNotConnected, WhyUnused,
};
pub use subject::{Parameter, Residual, ResidualOf, Source, Subject};
