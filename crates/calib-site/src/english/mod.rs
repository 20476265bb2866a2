//! Findings, failures and suggestions in English, as files and reports have them.
//!
//! Law: the edge of the core. Nothing outside this folder makes a sentence of a result, and nothing looks
//! into one.

mod count;
mod suggestion;
mod phrase;
mod finding;
mod failure;

pub use count::counted;
pub use phrase::Names;

pub(crate) use suggestion::what_to_draw;

#[cfg(test)]
mod tests;
