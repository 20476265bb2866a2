//! Blender script that creates the cameras.
//!
//! Poses are camera to world, with camera axes right, up, back. Blender's sensor width applies to the longer
//! side of the image. Shifts of the principal point are fractions of the longer side.

use serde_json::json;

use crate::export::{Export, Scene};
use crate::nerfstudio::world_from_camera;
use crate::tree::quote;
use crate::view::View;

/// Width of the sensor in the script, in millimetres. Any width is correct, because the focal length in
/// millimetres is proportional to it.
const SENSOR_WIDTH_MM: f64 = 36.0;

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut rows = String::new();
    for view in &scene.views {
        export.report_distortion(view);
        if (view.scale[0] / view.scale[1] - 1.0).abs() > 1e-3 {
            export.add_loss(view, "its non-square pixels: a Blender camera has only one focal length");
        }
        rows += &row(view);
    }
    export.push("cameras.py", format!("{HEAD}CAMERAS = [\n{rows}]\n{TAIL}"));
}

fn row(view: &View) -> String {
    let ([fx, _], [cx, cy]) = (view.focal(), view.centre());
    let [w, h] = view.size.map(f64::from);
    let longest = w.max(h);
    let camera = json!({
        "size": view.size,
        "lens": SENSOR_WIDTH_MM * fx / longest,
        "shift": [(0.5 * w - cx) / longest, (cy - 0.5 * h) / longest],
        "matrix": world_from_camera(view),
    });
    format!("    ({}, {camera}),\n", quote(&view.id))
}

const HEAD: &str = "# Run this in Blender's text editor, or with: blender --python cameras.py\nimport bpy\nfrom mathutils import Matrix\n\n";

const TAIL: &str = "
scene = bpy.context.scene
for name, values in CAMERAS:
    data = bpy.data.cameras.new(name)
    data.sensor_fit = 'AUTO'
    data.sensor_width = 36.0
    data.lens = values['lens']
    data.shift_x, data.shift_y = values['shift']
    camera = bpy.data.objects.new(name, data)
    camera.matrix_world = Matrix(values['matrix'])
    scene.collection.objects.link(camera)
    scene.camera = scene.camera or camera

scene.render.resolution_x, scene.render.resolution_y = CAMERAS[0][1]['size']
";
