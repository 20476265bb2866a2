//! Vanishing points of the vertical and of the floor directions, for a camera orientation.

use calib_core::Orientation;

/// Vanishing point in the undistorted image, in homogeneous pixels relative to the principal point.
pub(super) type Point = [f64; 3];

/// Returns the vanishing point of the vertical: `(f cos p sin r, f cos p cos r, sin p)`, with focal length f,
/// pitch p and roll r.
pub(super) fn nadir(at: &Orientation) -> Point {
    let ((sr, cr), (sp, cp)) = (at.roll.sin_cos(), at.pitch.sin_cos());
    [at.focal * cp * sr, at.focal * cp * cr, sp]
}

/// Returns the vanishing point of the floor direction at `azimuth`, in radians counter-clockwise from the
/// camera's right.
pub(super) fn level(at: &Orientation, azimuth: f64) -> Point {
    let ((sr, cr), (sp, cp), (sa, ca)) = (at.roll.sin_cos(), at.pitch.sin_cos(), azimuth.sin_cos());
    let (x, y) = (ca, -sp * sa);
    [at.focal * (cr * x + sr * y), at.focal * (cr * y - sr * x), cp * sa]
}

/// Returns the azimuth of the intersection of an image line with the horizon, in radians counter-clockwise
/// from the camera's right. If the line is horizontal in the scene, this is its floor direction. `through`
/// contains the homogeneous coordinates of the line.
pub(super) fn azimuth(at: &Orientation, through: [f64; 3]) -> f64 {
    let [across, ahead] = [0.0, std::f64::consts::FRAC_PI_2].map(|azimuth| {
        let point = level(at, azimuth);
        (0..3).map(|k| through[k] * point[k]).sum::<f64>()
    });
    (-across).atan2(ahead)
}

/// Returns the orientation of the upright camera with this vertical vanishing point and this focal length, in
/// pixels.
pub(super) fn with_nadir([x, y, w]: Point, focal: f64) -> Orientation {
    // In the image of an upright camera, the direction down is towards positive y.
    let sign = if y < 0.0 { -1.0 } else { 1.0 };
    let (x, y, w) = (sign * x, sign * y, sign * w);
    Orientation { roll: x.atan2(y), pitch: (focal * w).atan2(x.hypot(y)), focal }
}
