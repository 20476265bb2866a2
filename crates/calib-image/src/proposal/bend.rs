//! The distortion under which the grouping of the edges is likeliest.
//!
//! A lens that bends turns every edge by what depends on where it is: under the right distortion more edges lead to
//! common points. One number is sought, k1 with coordinates divided by half the diagonal of the image, with k2 the
//! square of a barrel's k1, as lenses have it (`single/lens_prior.rs` of the core); the annotations that are
//! proposed have inner points, from which the solve fits what coefficients they support.

use calib_core::{BrownConrady, Distortion, Lens, Pixel};

/// Standard deviation of k1 among lenses.
const K1: f64 = 0.2;
/// Distortions that are tried at first, none before all.
pub(super) const COARSE: [f64; 4] = [0.0, -0.08, -0.16, -0.26];
/// By how much the log evidence must rise for a bent lens to be believed.
pub(super) const LEAST_GAIN: f64 = 6.0;
/// Halvings of the step about the best.
const HALVINGS: usize = 3;

/// The lens of this k1.
pub(super) fn lens(k1: f64, principal_point: Pixel, size: [f64; 2]) -> Lens {
    if k1 == 0.0 {
        return Lens::pinhole(principal_point);
    }
    let brown = BrownConrady { k1, k2: k1.min(0.0).powi(2), ..BrownConrady::default() };
    Lens {
        principal_point,
        focal: 0.5 * size[0].hypot(size[1]),
        distortion: Distortion::BrownConrady(brown),
        image_circle: None,
    }
}

/// Log density of k1 before an edge is seen, up to a constant.
pub(super) fn log_density(k1: f64) -> f64 {
    -0.5 * (k1 / K1).powi(2)
}

/// The best of a coarse step, and its neighbourhood, halved again and again; `score` is none where there is no
/// answer.
pub(super) fn refined(mut best: (f64, f64), mut score: impl FnMut(f64) -> Option<f64>) -> (f64, f64) {
    let mut step = 0.5 * (COARSE[1] - COARSE[0]).abs();
    for _ in 0..HALVINGS {
        for k1 in [best.0 - step, best.0 + step] {
            if let Some(found) = score(k1).filter(|found| *found > best.1) {
                best = (k1, found);
            }
        }
        step *= 0.5;
    }
    best
}
