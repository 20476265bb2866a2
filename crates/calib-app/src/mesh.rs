//! Areas as triangles: fields that are filled, and images laid on the floor.

use calib_core::{Camera, FloorPoint, Pixel};
use egui::{Color32, Mesh, Painter, Pos2, Shape};

use crate::canvas::Mapping;
use crate::picture::Picture;

/// Cells of the mesh on which an image is laid on the floor.
const CELLS: usize = 12;
/// The image inside its field: the field cut into small triangles, each corner looked up in the image.
pub(crate) fn lay(
    painter: &Painter,
    mapping: &Mapping,
    picture: &Picture,
    pose: &Camera,
    field: &[FloorPoint],
    [w, h]: [f64; 2],
    tint: Color32,
) {
    let mut mesh = Mesh::with_texture(picture.overview.id());
    let corners: Vec<[f64; 2]> = field.iter().map(|&point| point.into()).collect();
    for triangle in triangles(&corners) {
        let base = mesh.vertices.len() as u32;
        let at = |s: f64, t: f64| -> [f64; 2] {
            let [a, b, c] = triangle;
            std::array::from_fn(|i| a[i] + s * (b[i] - a[i]) + t * (c[i] - a[i]))
        };
        let mut is_whole = true;
        for i in 0..=CELLS {
            for j in 0..=CELLS - i {
                let point = at(i as f64 / CELLS as f64, j as f64 / CELLS as f64);
                let seen = pose.world_to_pixel(FloorPoint::from(point).at_height(0.0));
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
        let index = |i: usize, j: usize| base + (i * (CELLS + 1) - i * i.saturating_sub(1) / 2 + j) as u32;
        for i in 0..CELLS {
            for j in 0..CELLS - i {
                mesh.add_triangle(index(i, j), index(i + 1, j), index(i, j + 1));
                if j + 1 < CELLS - i {
                    mesh.add_triangle(index(i + 1, j), index(i + 1, j + 1), index(i, j + 1));
                }
            }
        }
    }
    painter.add(Shape::mesh(mesh));
}

/// Fills a polygon that need not be convex.
pub(crate) fn fill(painter: &Painter, points: &[Pos2], colour: Color32) {
    let corners: Vec<[f64; 2]> = points.iter().map(|p| [f64::from(p.x), f64::from(p.y)]).collect();
    let mut mesh = Mesh::default();
    for triangle in triangles(&corners) {
        let base = mesh.vertices.len() as u32;
        for [x, y] in triangle {
            mesh.colored_vertex(Pos2::new(x as f32, y as f32), colour);
        }
        mesh.add_triangle(base, base + 1, base + 2);
    }
    painter.add(Shape::mesh(mesh));
}

/// A simple polygon as triangles, cut off at its ears (Meisters 1975).
fn triangles(polygon: &[[f64; 2]]) -> Vec<[[f64; 2]; 3]> {
    let mut ring = polygon.to_vec();
    if ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
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
        // A polygon that crosses itself has no ear at some point: then any corner goes.
        let i = (0..count).find(is_ear).unwrap_or(0);
        found.push(around(i));
        ring.remove(i);
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
        let total: f64 = triangles(&polygon).into_iter().map(area).sum();
        assert!((total - 10.0).abs() < 1e-12, "{total}");
    }
}
