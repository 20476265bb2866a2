//! Manual stage 2: translation, rotation and scale of an EFOV polygon, converted to the position (x0, y0, z0)
//! and yaw of the camera, and back.

use crate::camera::{Camera, FloorPoint};

/// Assumed height of the camera in stage 1, in metres (the paper's convention).
pub const STAGE_1_HEIGHT: f64 = 3.0;

/// Transformation that the operator applied to the EFOV polygon of stage 1. The camera of stage 1 is above
/// (0, 0) at the height [`STAGE_1_HEIGHT`], with yaw 0. The polygon is first scaled and rotated about the
/// camera's foot (0, 0), then translated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Translation, in metres. It equals x and y of the placed camera.
    pub by: FloorPoint,
    /// Rotation, counter-clockwise, in radians. It equals the yaw of the placed camera.
    pub turn: f64,
    /// Scale factor: the height of the placed camera divided by [`STAGE_1_HEIGHT`].
    pub scale: f64,
}

impl Placement {
    /// Identity transformation: it leaves the polygon of stage 1 unchanged.
    pub const NONE: Self = Self { by: FloorPoint { x: 0.0, y: 0.0 }, turn: 0.0, scale: 1.0 };

    /// Fits the placement that maps the first points of the pairs to the second ones with least squares (Umeyama,
    /// "Least-squares estimation of transformation parameters", 1991, in two dimensions). With complex numbers,
    /// `scale e^(i turn) = sum conj(a) b / sum |a|^2`, with a and b relative to their centroids. Returns `None` if
    /// the pairs do not determine the placement.
    #[must_use]
    pub fn fit(pairs: &[(FloorPoint, FloorPoint)]) -> Option<Self> {
        /// Smallest scale that is accepted.
        const MIN_SCALE: f64 = 1e-6;
        if pairs.len() < 2 {
            return None;
        }
        let count = pairs.len() as f64;
        let mean = |of: fn(&(FloorPoint, FloorPoint)) -> f64| pairs.iter().map(of).sum::<f64>() / count;
        let (ax, ay) = (mean(|pair| pair.0.x), mean(|pair| pair.0.y));
        let (bx, by) = (mean(|pair| pair.1.x), mean(|pair| pair.1.y));
        let (mut re, mut im, mut square) = (0.0, 0.0, 0.0);
        for (a, b) in pairs {
            let (a, b) = ([a.x - ax, a.y - ay], [b.x - bx, b.y - by]);
            re += a[0] * b[0] + a[1] * b[1];
            im += a[0] * b[1] - a[1] * b[0];
            square += a[0] * a[0] + a[1] * a[1];
        }
        let (c, s) = (re / square, im / square);
        let scale = c.hypot(s);
        let by = FloorPoint::new(bx - (c * ax - s * ay), by - (s * ax + c * ay));
        (scale.is_finite() && scale > MIN_SCALE && by.is_finite()).then(|| Self {
            by,
            turn: s.atan2(c),
            scale,
        })
    }

    /// Returns the camera of stage 1 with this placement (the paper's stage 2).
    #[must_use]
    pub fn apply(&self, camera: &Camera) -> Camera {
        Camera { position: self.by.at_height(STAGE_1_HEIGHT * self.scale), yaw: self.turn, ..*camera }
    }

    /// Returns the placement that maps the camera of stage 1 to `camera`.
    #[must_use]
    pub fn from_camera(camera: &Camera) -> Self {
        Self { by: camera.position.on_floor(), turn: camera.yaw, scale: camera.position.z / STAGE_1_HEIGHT }
    }

    /// Maps a point of the stage 1 floor (camera at height [`STAGE_1_HEIGHT`] over (0, 0), yaw 0) to its
    /// placed position.
    #[must_use]
    pub fn map_point(&self, point: FloorPoint) -> FloorPoint {
        let (sin, cos) = self.turn.sin_cos();
        FloorPoint {
            x: self.by.x + self.scale * (cos * point.x - sin * point.y),
            y: self.by.y + self.scale * (sin * point.x + cos * point.y),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Pixel, WorldPoint, any_camera};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn placed_camera_and_placed_polygon_agree(
            camera in any_camera(), x in -9.0..9.0_f64, y in -9.0..9.0_f64,
            turn in -3.0..3.0_f64, scale in 0.5..2.0_f64, u in 0.0..1920.0_f64, v in 0.0..1080.0_f64,
        ) {
            let placement = Placement { by: FloorPoint { x, y }, turn, scale };
            let stage_1 = Camera { position: WorldPoint::new(0.0, 0.0, STAGE_1_HEIGHT), yaw: 0.0, ..camera };
            let placed = placement.apply(&stage_1);
            prop_assert!((placed.position.z - 3.0 * scale).abs() < 1e-12);
            let back = Placement::from_camera(&placed);
            prop_assert!((back.scale - scale).abs() < 1e-12 && back.turn == turn && back.by == placement.by);
            if let (Some(a), Some(b)) = (stage_1.pixel_to_floor(Pixel { u, v }, 0.0), placed.pixel_to_floor(Pixel { u, v }, 0.0)) {
                prop_assert!(placement.map_point(a).distance(b) < 1e-9 * (1.0 + a.distance(FloorPoint::default())));
            }
        }
    }
}
