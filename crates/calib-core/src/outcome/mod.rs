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
mod suggestion;
mod detail;
mod finding;
mod finding_subject;
mod failure;
mod residual;

pub use code::{Code, Severity};
pub use detail::{Estimator, OtherMinimum, SharedEvidence, WhyNotConnected, WhyUnused};
pub use failure::{Failure, FailureCode};
pub use finding::Finding;
pub use residual::{Residual, ResidualOf};
pub use subject::{Parameter, Source, Subject};
pub use suggestion::{Drawing, Suggestion};
