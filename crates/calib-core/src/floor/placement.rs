//! Stage 2 by hand: move, turn and scale of an EFOV polygon to x0, y0, yaw, z0, and back.

use crate::camera::{Camera, FloorPoint};

/// Height of the camera in stage 1, in metres, by the paper's convention.
pub const STAGE_1_HEIGHT: f64 = 3.0;

/// Change of the polygon that was projected with (0, 0, z0, roll, pitch, 0, focal): scaled and rotated about
/// the foot of the camera (0, 0), then translated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Translation, in metres; becomes x0, y0.
    pub by: FloorPoint,
    /// Counter-clockwise, in radians: becomes yaw.
    pub turn: f64,
    /// Multiplies [`STAGE_1_HEIGHT`] to become z0.
    pub scale: f64,
}

impl Placement {
    /// The polygon as stage 1 left it.
    pub const NONE: Self = Self { by: FloorPoint { x: 0.0, y: 0.0 }, turn: 0.0, scale: 1.0 };

    /// The camera of stage 1, placed (the paper's stage 2).
    #[must_use]
    pub fn apply(&self, camera: &Camera) -> Camera {
        Camera { position: self.by.at_height(STAGE_1_HEIGHT * self.scale), yaw: self.turn, ..*camera }
    }

    /// The placement that a camera has.
    #[must_use]
    pub fn of(camera: &Camera) -> Self {
        Self { by: camera.position.on_floor(), turn: camera.yaw, scale: camera.position.z / STAGE_1_HEIGHT }
    }

    /// Maps a point of the stage 1 floor (camera at height [`STAGE_1_HEIGHT`] above (0, 0), yaw 0) to the
    /// plan.
    #[must_use]
    pub fn carry(&self, point: FloorPoint) -> FloorPoint {
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
        fn placing_the_camera_carries_its_polygon(
            camera in any_camera(), x in -9.0..9.0_f64, y in -9.0..9.0_f64,
            turn in -3.0..3.0_f64, scale in 0.5..2.0_f64, u in 0.0..1920.0_f64, v in 0.0..1080.0_f64,
        ) {
            let placement = Placement { by: FloorPoint { x, y }, turn, scale };
            let stage_1 = Camera { position: WorldPoint::new(0.0, 0.0, STAGE_1_HEIGHT), yaw: 0.0, ..camera };
            let placed = placement.apply(&stage_1);
            prop_assert!((placed.position.z - 3.0 * scale).abs() < 1e-12);
            let back = Placement::of(&placed);
            prop_assert!((back.scale - scale).abs() < 1e-12 && back.turn == turn && back.by == placement.by);
            if let (Some(a), Some(b)) = (stage_1.pixel_to_floor(Pixel { u, v }, 0.0), placed.pixel_to_floor(Pixel { u, v }, 0.0)) {
                prop_assert!(placement.carry(a).distance(b) < 1e-9 * (1.0 + a.distance(FloorPoint::default())));
            }
        }
    }
}
