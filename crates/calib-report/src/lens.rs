//! What is known of a lens, and whether it was found here.

use calib_core::{Distortion, Lens};

use calib_site::{Method, SiteCamera, Solution};

/// The lens of a camera, which may be known where its pose is not.
#[must_use]
pub fn lens_of(entry: &SiteCamera) -> Lens {
    entry.solution.as_ref().map_or_else(|| entry.lens(), Solution::lens)
}

/// Whether the lens of a camera was found from what is drawn on its image, or on that of its like.
#[must_use]
pub fn is_fitted(entry: &SiteCamera) -> bool {
    let solved = entry.solution.as_ref().is_some_and(|solution| solution.method != Method::Given);
    solved && lens_of(entry).distortion != Distortion::None && entry.lens().distortion == Distortion::None
}
