//! The parameters of planes that views and landmarks share.

use crate::camera::Plane;
use crate::single::PlanePrior;

/// Parameters of a plane: height, slope along x, slope along y.
pub(crate) const PLANE_PARAMS: usize = 3;

/// Height and slope of a plane.
pub(crate) fn parameters_of_plane(plane: &Plane) -> [f64; PLANE_PARAMS] {
    [plane.height, plane.slope[0], plane.slope[1]]
}

/// Which planes are estimated: those that something is drawn on or stands on, and that are not held.
pub(crate) fn is_estimated(planes: &[PlanePrior], on_planes: impl Iterator<Item = usize>) -> Vec<bool> {
    let mut estimated = vec![false; planes.len()];
    for plane in on_planes {
        if let (Some(estimated), Some(prior)) = (estimated.get_mut(plane), planes.get(plane)) {
            *estimated = !prior.is_held();
        }
    }
    estimated
}
