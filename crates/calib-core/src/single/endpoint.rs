//! Where a segment ends, undistorted.

/// An end point of a segment with the covariance of its noise, in numbers `E`: values, or values with their
/// derivatives by the coefficients of the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Endpoint<E = f64> {
    /// Undistorted pixel relative to the principal point; of a wide lens the point of a chart.
    pub point: [E; 2],
    /// Covariance of `point` for a variance of 1 px^2 of each raw coordinate: `[uu, uv, vv]`.
    pub covariance: [E; 3],
}
