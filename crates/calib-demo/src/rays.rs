//! The rays of an image: exact at the nodes of a mesh, in between by blending.

use calib_core::{Camera, Lens, Pixel};

use crate::shape::Line;
use crate::vector::Vec3;

/// Pixels between the nodes. The bend of a lens over so short a way is below 0.01 pixels.
const PITCH: usize = 4;

/// The rays of one camera.
#[derive(Debug)]
pub(crate) struct Rays {
    origin: Vec3,
    /// Directions at the nodes, row by row; not numbers outside the lens.
    nodes: Vec<Vec3>,
    columns: usize,
    /// Middle and radius of the image circle of a fisheye, in pixels.
    rim: Option<[f32; 3]>,
}

impl Rays {
    pub(crate) fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let columns = width as usize / PITCH + 2;
        let rows = height as usize / PITCH + 2;
        let node = |i: usize| Pixel::new(((i % columns) * PITCH) as f64, ((i / columns) * PITCH) as f64);
        // A node outside the image circle is at the corner of a cell that reaches into it.
        let beyond = Camera { lens: Lens { image_circle: None, ..camera.lens }, ..*camera };
        let direction = |i: usize| {
            let [x, y, z] = beyond.pixel_to_ray(node(i))?.direction;
            // Equal depth, not equal length, is what blends linearly; beside a fisheye there is no depth.
            let ahead = camera.rotation()[2];
            let depth = x * ahead[0] + y * ahead[1] + z * ahead[2];
            let depth = if camera.lens.distortion.is_wide() { 1.0 } else { depth };
            Some(Vec3 { x: (x / depth) as f32, y: (y / depth) as f32, z: (z / depth) as f32 })
        };
        let nowhere = Vec3::grey(f32::NAN);
        let nodes = (0..columns * rows).map(|i| direction(i).unwrap_or(nowhere)).collect();
        let rim = camera.lens.image_circle.map(|circle| <[f64; 3]>::from(circle).map(|side| side as f32));
        Self { origin: camera.position.into(), nodes, columns, rim }
    }

    /// The ray through a point of the image, in pixels; `None` outside the lens.
    pub(crate) fn through(&self, u: f32, v: f32) -> Option<Line> {
        if self.rim.is_some_and(|[cu, cv, radius]| (u - cu).hypot(v - cv) > radius) {
            return None;
        }
        let (x, y) = (u / PITCH as f32, v / PITCH as f32);
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let at = |di: usize, dj: usize| self.nodes[(j + dj) * self.columns + i + di];
        let upper = at(0, 0).towards(at(1, 0), fx);
        let lower = at(0, 1).towards(at(1, 1), fx);
        let direction = upper.towards(lower, fy).unit();
        (!direction.x.is_nan()).then(|| Line::new(self.origin, direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mesh_shows_what_the_camera_shows() {
        for (_, camera, size) in crate::cameras::cameras() {
            let rays = Rays::new(&camera, size);
            for i in 0..200 {
                let (u, v) = (9.37 * i as f64 % f64::from(size[0]), 5.11 * i as f64 % f64::from(size[1]));
                if camera.lens.image_circle.is_some_and(|circle| !circle.holds(Pixel::new(u, v))) {
                    assert!(rays.through(u as f32, v as f32).is_none());
                    continue;
                }
                let exact = camera.pixel_to_ray(Pixel::new(u, v)).unwrap().direction;
                let exact = Vec3 { x: exact[0] as f32, y: exact[1] as f32, z: exact[2] as f32 };
                let off = (rays.through(u as f32, v as f32).unwrap().direction - exact).length();
                assert!(off * (camera.focal as f32) < 0.01, "{off} at {u}, {v}");
            }
        }
    }
}
