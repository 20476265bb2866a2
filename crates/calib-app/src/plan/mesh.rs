//! Triangle meshes: filled fields of view, and images projected onto the floor.

use std::hash::{Hash, Hasher};
use std::sync::Arc;

use calib_core::{Camera, FloorPoint, Pixel, Plane};
use egui::cache::{ComputerMut, FrameCache};
use egui::{Color32, Context, Mesh, Painter, Pos2, Shape};

use crate::canvas::Mapping;
use crate::picture::Picture;

/// Largest number of mesh cells along a side of a triangle.
const MAX_CELLS_PER_SIDE: usize = 12;
/// Smallest side of a mesh cell, in points.
const MIN_CELL_SIDE: f32 = 24.0;

/// Returns the number of mesh cells along each side of a triangle, from the size of the triangle on the
/// screen.
fn cells(mapping: &Mapping, triangle: &[[f64; 2]; 3]) -> usize {
    let [a, b, c] = triangle.map(|corner| mapping.screen(corner));
    let side = a.distance(b).max(b.distance(c)).max(c.distance(a));
    ((side / MIN_CELL_SIDE).ceil() as usize).clamp(1, MAX_CELLS_PER_SIDE)
}

/// Paints the part of an image that shows a field of view on a plane, as seen from above. Small triangles
/// fill the field, and their corners are projected into the image.
pub(crate) fn paint_projected(
    painter: &Painter,
    mapping: &Mapping,
    picture: &Picture,
    (pose, plane): (&Camera, &Plane),
    field: &[FloorPoint],
    [w, h]: [f64; 2],
    tint: Color32,
) {
    let mut mesh = Mesh::with_texture(picture.overview.id());
    let corners: Vec<[f64; 2]> = field.iter().map(|&point| point.into()).collect();
    for triangle in triangles_of(painter.ctx(), &corners).iter().map(|corner| corner.map(|i| corners[i])) {
        let cells = cells(mapping, &triangle);
        let base = mesh.vertices.len() as u32;
        let at = |s: f64, t: f64| -> [f64; 2] {
            let [a, b, c] = triangle;
            std::array::from_fn(|i| a[i] + s * (b[i] - a[i]) + t * (c[i] - a[i]))
        };
        let mut is_whole = true;
        for i in 0..=cells {
            for j in 0..=cells - i {
                let point = at(i as f64 / cells as f64, j as f64 / cells as f64);
                let at = FloorPoint::from(point);
                let seen = pose.world_to_pixel(at.at_height(plane.height_at(at)));
                is_whole &= seen.is_some();
                let Pixel { u, v } = seen.unwrap_or_default();
                let uv = Pos2::new((u / w) as f32, (v / h) as f32);
                let pos = mapping.screen(point);
                mesh.vertices.push(egui::epaint::Vertex { pos, uv, color: tint });
            }
        }
        if !is_whole {
            mesh.vertices.truncate(base as usize);
            continue;
        }
        let index = |i: usize, j: usize| base + (i * (cells + 1) - i * i.saturating_sub(1) / 2 + j) as u32;
        for i in 0..cells {
            for j in 0..cells - i {
                mesh.add_triangle(index(i, j), index(i + 1, j), index(i, j + 1));
                if j + 1 < cells - i {
                    mesh.add_triangle(index(i + 1, j), index(i + 1, j + 1), index(i, j + 1));
                }
            }
        }
    }
    painter.add(Shape::mesh(mesh));
}

/// Fills a floor polygon, convex or not; `points` are the screen positions of its corners.
pub(crate) fn fill(painter: &Painter, polygon: &[FloorPoint], points: &[Pos2], colour: Color32) {
    let corners: Vec<[f64; 2]> = polygon.iter().map(|&point| point.into()).collect();
    let mut mesh = Mesh::default();
    for corner in triangles_of(painter.ctx(), &corners).iter() {
        let base = mesh.vertices.len() as u32;
        for at in corner.iter().filter_map(|&i| points.get(i)) {
            mesh.colored_vertex(*at, colour);
        }
        mesh.add_triangle(base, base + 1, base + 2);
    }
    painter.add(Shape::mesh(mesh));
}

/// Corners of a polygon, the key of the triangle cache.
#[derive(Clone, Copy)]
struct Corners<'a>(&'a [[f64; 2]]);

impl Hash for Corners<'_> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.0.iter().flatten().for_each(|value| value.to_bits().hash(state));
    }
}

/// Computation of triangles for the triangle cache.
#[derive(Default)]
struct Triangulator;

impl ComputerMut<Corners<'_>, Arc<Vec<[usize; 3]>>> for Triangulator {
    fn compute(&mut self, corners: Corners<'_>) -> Arc<Vec<[usize; 3]>> {
        Arc::new(triangles(corners.0))
    }
}

/// Returns the triangles of a polygon as indices of corners. The triangles are cached, because pan and zoom
/// do not change them.
fn triangles_of(ctx: &Context, corners: &[[f64; 2]]) -> Arc<Vec<[usize; 3]>> {
    type Cache = FrameCache<Arc<Vec<[usize; 3]>>, Triangulator>;
    ctx.memory_mut(|memory| Arc::clone(memory.caches.cache::<Cache>().get(Corners(corners))))
}

/// Triangulates a simple polygon by ear clipping (Meisters 1975); each triangle is three indices of corners.
fn triangles(polygon: &[[f64; 2]]) -> Vec<[usize; 3]> {
    let mut left: Vec<usize> = (0..polygon.len()).collect();
    let mut ring = polygon.to_vec();
    if ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
        left.pop();
    }
    let cross =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let sign: f64 =
        ring.iter().zip(ring.iter().cycle().skip(1)).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
    let mut found = Vec::new();
    while ring.len() >= 3 {
        let count = ring.len();
        let around = |i: usize| [ring[(i + count - 1) % count], ring[i], ring[(i + 1) % count]];
        let is_ear = |i: &usize| {
            let [a, b, c] = around(*i);
            let holds = |p: &&[f64; 2]| {
                **p != a
                    && **p != b
                    && **p != c
                    && [(a, b), (b, c), (c, a)].iter().all(|(p0, p1)| cross(*p0, *p1, **p) * sign >= 0.0)
            };
            cross(a, b, c) * sign > 0.0 && !ring.iter().any(|p| holds(&p))
        };
        // A polygon that crosses itself may have no ear; any corner is cut then.
        let i = (0..count).find(is_ear).unwrap_or(0);
        found.push([(i + count - 1) % count, i, (i + 1) % count].map(|i| left[i]));
        ring.remove(i);
        left.remove(i);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_cover_a_polygon_with_a_dent() {
        let polygon = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]];
        let area = |[a, b, c]: [[f64; 2]; 3]| {
            0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
        };
        let total: f64 = triangles(&polygon).into_iter().map(|corner| area(corner.map(|i| polygon[i]))).sum();
        assert!((total - 10.0).abs() < 1e-12, "{total}");
    }
}
