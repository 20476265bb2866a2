//! Results of a solve as values: findings about a result, or the reason why there is no result.
//!
//! Rule: no sentences. The text is made from these values in one place, `calib_site::english`.
//!
//! - `code`: the closed list of finding codes, with their severities;
//! - `subject`: subjects of findings, and the residual of one observation as reports contain it;
//! - `finding`: findings about a result, with suggested annotations;
//! - `failure`: reasons why a camera has no result.
//!
//! Residuals are computed in `single/residual.rs` for annotations and in `bundle/landmark.rs` for landmarks.

mod code;
mod subject;
mod finding;
mod failure;

pub use code::{Code, Severity};
pub use failure::{Failure, FailureCode};
pub use finding::{
    DisconnectionReason, Estimator, Finding, OtherMinimum, SharedEvidence, SuggestedAnnotation, Suggestion,
    UnusedReason,
};
pub use subject::{Parameter, Residual, ResidualOf, Source, Subject, is_unchecked};
