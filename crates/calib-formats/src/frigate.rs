//! Frigate configuration: one zone for each camera, the EFOV, with the lengths of its sides for speed
//! estimates.
//!
//! Coordinates are fractions of the image, so they apply to every stream of the camera. `distances` are the
//! lengths of the sides, in metres; they are written only for a zone with four corners.

use calib_core::{Pixel, WorldPoint};

use crate::export::{Export, Scene};
use crate::tree::quote;
use crate::view::View;

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut text = String::from(
        "# Merge this into Frigate's configuration. Lengths are in metres: set ui.unit_system to metric.\ncameras:\n",
    );
    for view in &scene.views {
        let corners = corners(view);
        if corners.len() < 3 {
            export.add_loss(view, "its zone: no part of the EFOV is in the image");
            continue;
        }
        let share = |px: &Pixel, i: usize| {
            let value = [px.u, px.v][i] / f64::from(view.size[i]);
            format!("{:.4}", value.clamp(0.0, 1.0))
        };
        let coordinates: Vec<String> = corners.iter().flat_map(|px| [share(px, 0), share(px, 1)]).collect();
        text += &format!(
            "  {}:\n    zones:\n      floor:\n        coordinates: {}\n",
            quote(&view.id),
            coordinates.join(",")
        );
        match distances(view, &corners) {
            Some(sides) => {
                let sides: Vec<String> = sides.iter().map(|side| format!("{side:.2}")).collect();
                text += &format!("        distances: {}\n", sides.join(","));
            }
            None => export.notes.push(format!(
                "camera {:?}: no distances, because Frigate needs four corners on the floor; the zone has {}",
                view.id,
                corners.len()
            )),
        }
    }
    export.push(format!("zones.{}", scene.extension), text);
}

/// Returns the corners of the part of the EFOV inside the image, in pixels of the stream. The polygon is
/// clipped at one border of the image after the other.
pub(crate) fn corners(view: &View) -> Vec<Pixel> {
    let [w, h] = view.size.map(f64::from);
    let sides: [fn(Pixel, f64, f64) -> f64; 4] =
        [|p, _, _| p.u, |p, w, _| w - p.u, |p, _, _| p.v, |p, _, h| h - p.v];
    sides.iter().fold(view.efov_px.clone(), |polygon, inside| {
        let mut kept = Vec::new();
        for (i, &b) in polygon.iter().enumerate() {
            let a = polygon[(i + polygon.len() - 1) % polygon.len()];
            let (da, db) = (inside(a, w, h), inside(b, w, h));
            if (da < 0.0) != (db < 0.0) {
                let t = da / (da - db);
                kept.push(Pixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) });
            }
            if db >= 0.0 {
                kept.push(b);
            }
        }
        kept
    })
}

fn distances(view: &View, corners: &[Pixel]) -> Option<[f64; 4]> {
    let corners: &[Pixel; 4] = corners.try_into().ok()?;
    let [sx, sy] = view.scale;
    let floor = |p: Pixel| view.camera.pixel_to_plane(Pixel { u: p.u / sx, v: p.v / sy }, &view.efov_plane);
    let points: Vec<WorldPoint> = corners.iter().map(|&p| floor(p)).collect::<Option<_>>()?;
    Some(std::array::from_fn(|i| points[i].distance(points[(i + 1) % 4])))
}
