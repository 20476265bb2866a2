//! Dependence of floor lengths on the slope of the ground.
//!
//! Verticals are plumb and the ground may slope. Roads and yards slope by up to 6 %, much more than the usual
//! floor of [`SceneErrors`](crate::SceneErrors). The fit is repeated with a floor that may slope by 6 %. If the
//! floor lengths then are much less certain, the annotations do not determine the slope.

use crate::outcome::Finding;
use crate::single::constraints::Constraints;
use crate::single::fit::{Fit, FitOptions};

/// Slope of steep ground: rise divided by distance. Design guides allow 6 % on main roads and ramps of yards.
pub const STEEP_GRADE: f64 = 0.06;

/// Smallest relative error of floor lengths, due to the slope alone, that is reported.
pub const MIN_SLOPE_EFFECT_REL: f64 = 0.05;

/// Returns a finding if floor lengths depend on the slope of the ground. `sloping` are the constraints of the
/// fit on a floor that may slope by [`STEEP_GRADE`].
#[must_use]
pub fn slope_finding(fit: &Fit, sloping: &Constraints, options: &FitOptions) -> Option<Finding> {
    let usual = fit.floor_length_rel?;
    let sloping = Fit::new(sloping, options).ok().and_then(|fit| fit.floor_length_rel);
    let effect = |sloping: f64| (sloping * sloping - usual * usual).max(0.0).sqrt();
    let is_large = sloping.is_none_or(|sloping| effect(sloping) > MIN_SLOPE_EFFECT_REL);
    is_large.then_some(Finding::UnknownSlope { usual, sloping })
}
