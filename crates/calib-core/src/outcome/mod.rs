//! How a solve ended: what was found out, or why nothing was, as values with a subject and numbers.
//!
//! Law: no words. Sentences are made of these values once, where they leave the core.

mod code;
mod subject;
mod suggestion;
mod finding;
mod failure;
mod residual;

pub use code::{Code, Severity};
pub use failure::{Failure, FailureCode};
pub use finding::{Apart, Estimator, Finding, Rival, Tie, WhyUnused};
pub use residual::{Residual, ResidualOf};
pub use subject::{Parameter, Source, Subject};
pub use suggestion::{Drawing, Suggestion};
