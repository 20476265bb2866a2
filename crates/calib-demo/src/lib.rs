//! The demonstration site.
