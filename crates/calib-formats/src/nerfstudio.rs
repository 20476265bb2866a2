//! nerfstudio's `transforms.json`.
//!
//! Camera to world, a camera's axes right, up, back. Pixels count from the corner, as ours: its rays
//! go through the pixel's index plus a half.

use serde_json::{Value, json};

use crate::export::{Export, Scene};
use crate::tree::pretty;
use crate::view::{Terms, View};

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut frames = Vec::new();
    for view in &scene.views {
        let terms = export.terms(view, scene.lenses);
        frames.push(frame(view, terms));
        if view.image.is_none() {
            export
                .notes
                .push(format!("camera {:?} has no image file; file_path is {}.png", view.id, view.file));
        }
    }
    export.push("transforms.json", pretty(&json!({ "frames": frames })));
}

fn frame(view: &View, terms: Terms) -> Value {
    let ([fx, fy], [cx, cy], [w, h]) = (view.focal(), view.centre(), view.size);
    let path = view.image.clone().unwrap_or_else(|| format!("{}.png", view.file));
    let mut frame = json!({
        "file_path": path, "w": w, "h": h, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
        "camera_model": "OPENCV",
        "transform_matrix": world_from_camera(view),
    });
    let named: Vec<(&str, f64)> = match terms {
        Terms::None => Vec::new(),
        Terms::Fisheye(k) => {
            frame["camera_model"] = json!("OPENCV_FISHEYE");
            ["k1", "k2", "k3", "k4"].into_iter().zip(k).collect()
        }
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => {
            vec![("k1", b.k1), ("k2", b.k2), ("k3", b.k3), ("p1", b.p1), ("p2", b.p2)]
        }
    };
    for (key, value) in named {
        frame[key] = json!(value);
    }
    frame
}

/// 4 x 4, columns right, up, back, position.
pub(crate) fn world_from_camera(view: &View) -> [[f64; 4]; 4] {
    let [right, down, forward] = view.camera.rotation();
    let centre = <[f64; 3]>::from(view.camera.position);
    let row = |i: usize| [right[i], -down[i], -forward[i], centre[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}
