//! English sentences for findings, failures and suggestions, as used in files, reports and the app.
//!
//! This module is the only one that phrases results. No code may parse these sentences: use the codes
//! instead.
//!
//! - `data_sheet`: the text of a data sheet that is not understood;
//! - `finding`: the message and the advice of every finding and failure;
//! - `phrase`: names of annotations and links, longer phrases, plural forms, suggestions.

mod data_sheet;
mod phrase;
mod finding;
#[cfg(test)]
mod tests;

pub(crate) use phrase::suggestion_text;
pub use phrase::{Names, counted};
