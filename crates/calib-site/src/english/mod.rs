//! Findings, failures and suggestions in English, as files and reports have them.
//!
//! Law: the edge of the core. Nothing outside this folder makes a sentence of a result, and nothing looks
//! into one.

mod phrase;
mod finding;
#[cfg(test)]
mod tests;

pub(crate) use phrase::what_to_draw;
pub use phrase::{Names, counted};
