//! Comparing a newer image with the calibrated one: its canvas and its panel.

pub(crate) mod panel;
