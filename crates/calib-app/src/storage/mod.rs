//! Storage below the app's state: site files, autosaves, recent sites, file choosers, thumbnails, the
//! demonstration.

pub mod files;
pub mod autosave;
pub mod demo;
pub mod dialog;
