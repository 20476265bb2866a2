//! A straight line of the floor or of a plane, and where an image shows it beside a pixel.

use crate::camera::{Camera, FloorPoint, Pixel, Plane};

/// A straight line, seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorLine {
    /// A point of it, in metres.
    pub through: FloorPoint,
    /// From world +x, counter-clockwise, in radians.
    pub turn: f64,
}

impl FloorLine {
    /// The line through two points; `None` where they are one.
    #[must_use]
    pub fn between(a: FloorPoint, b: FloorPoint) -> Option<Self> {
        (a.distance(b) > 0.0).then(|| Self { through: a, turn: (b.y - a.y).atan2(b.x - a.x) })
    }

    /// The point of the line that is nearest to where a camera puts a pixel on a plane, and the pixel of the line's
    /// image that is nearest to that pixel.
    ///
    /// `None` where the pixel or the line beside it is not seen.
    #[must_use]
    pub fn nearest(&self, camera: &Camera, pixel: Pixel, plane: &Plane) -> Option<(FloorPoint, Pixel)> {
        /// Half of a piece of the line, in metres, so short that no lens bends it.
        const PIECE: f64 = 1e-3;
        /// Pieces that are looked at, each about where the one before is nearest.
        const STEPS: usize = 40;
        /// A step, in halves of a piece, after which no other follows.
        const NEAR: f64 = 1e-3;
        let put = camera.pixel_to_plane(pixel, plane)?.on_floor();
        let (sin, cos) = self.turn.sin_cos();
        let along = (put.x - self.through.x) * cos + (put.y - self.through.y) * sin;
        let on_line =
            |along: f64| FloorPoint { x: self.through.x + along * cos, y: self.through.y + along * sin };
        let shown = |along: f64| {
            let at = on_line(along);
            camera.world_to_pixel(at.at_height(plane.height_at(at)))
        };
        let mut middle = along;
        let mut nearest = pixel;
        for _ in 0..STEPS {
            let (a, b) = (shown(middle - PIECE)?, shown(middle + PIECE)?);
            let (du, dv) = (b.u - a.u, b.v - a.v);
            let t = ((pixel.u - a.u) * du + (pixel.v - a.v) * dv) / (du * du + dv * dv);
            nearest = Pixel { u: a.u + t * du, v: a.v + t * dv };
            middle += (2.0 * t - 1.0) * PIECE;
            if (2.0 * t - 1.0).abs() < NEAR {
                break;
            }
        }
        nearest.is_finite().then_some((on_line(along), nearest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_pixel_shows_the_line_and_is_at_right_angles_to_it(
            camera in any_camera(), u in 200.0..1700.0_f64, v in 500.0..1000.0_f64, turn in -3.0..3.0_f64, off in -0.3..0.3_f64,
        ) {
            let pixel = Pixel { u, v };
            let Some(put) = camera.pixel_to_floor(pixel, 0.0) else { return Ok(()) };
            let range = put.distance(camera.position.on_floor()) / camera.position.z;
            prop_assume!(range < 4.0);
            let line = FloorLine { through: FloorPoint { x: put.x - off * turn.sin(), y: put.y + off * turn.cos() }, turn };
            let Some((at, shown)) = line.nearest(&camera, pixel, &Plane::FLOOR) else { return Ok(()) };
            // Both are on the line, the one on the floor and the other in the image.
            let across = |p: FloorPoint| (p.y - line.through.y) * turn.cos() - (p.x - line.through.x) * turn.sin();
            prop_assert!(across(at).abs() < 1e-9 && (at.distance(put) - off.abs()).abs() < 1e-9);
            let back = camera.pixel_to_floor(shown, 0.0).unwrap();
            prop_assert!(across(back).abs() < 1e-4, "{} of {off}", across(back));
            // None beside it is nearer.
            for beside in [-0.1, 0.1] {
                let beside = FloorPoint { x: back.x + beside * turn.cos(), y: back.y + beside * turn.sin() };
                let Some(other) = camera.world_to_pixel(beside.at_height(0.0)) else { continue };
                prop_assert!(other.distance(pixel) > shown.distance(pixel) - 1e-3, "{other:?} {shown:?} {pixel:?}");
            }
        }
    }
}
