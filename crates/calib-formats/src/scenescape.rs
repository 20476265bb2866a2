//! Intel SceneScape's camera objects.
//!
//! Poses are camera to world, with the w of quaternions last. Camera axes are right, down, forward. Pixels
//! count from the centre of the first pixel, as in `OpenCV`: our principal point minus 0.5.

use serde_json::{Value, json};

use crate::export::{Export, Scene};
use crate::fisheye::{quaternion, transpose};
use crate::tree::pretty;
use crate::view::{Terms, View};

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut cameras = Vec::new();
    for view in &scene.views {
        let terms = export.terms(view, scene.lenses);
        cameras.push(camera(view, terms));
    }
    export.notes.push(
        "SceneScape's map has its origin at the bottom left; place the map so that this is world (0, 0)"
            .into(),
    );
    export.push("cameras.json", pretty(&Value::Array(cameras)));
}

fn camera(view: &View, terms: Terms) -> Value {
    let ([fx, fy], [cx, cy]) = (view.focal(), view.centre_from_pixel_centre());
    let brown = match terms {
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => b,
        Terms::None | Terms::Fisheye(_) | Terms::Rational(_) => Default::default(),
    };
    let [w, x, y, z] = quaternion(&transpose(&view.camera.rotation()));
    json!({
        "name": view.id,
        "intrinsics": {"fx": fx, "fy": fy, "cx": cx, "cy": cy},
        "distortion": {"k1": brown.k1, "k2": brown.k2, "p1": brown.p1, "p2": brown.p2, "k3": brown.k3},
        "transform_type": "quaternion",
        "translation": <[f64; 3]>::from(view.camera.position),
        "rotation": [x, y, z, w],
        "scale": [1.0, 1.0, 1.0],
        "resolution": view.size,
    })
}
