//! SQL views: a table of coefficients and the expression that maps detections to the floor, as every
//! engine with doubles evaluates it. Pixels count from the corner, as ours.
//!
//! Exact without distortion and for the division model, whose inverse is a quotient.

use calib_core::Distortion;

use crate::export::{Export, Scene};
use crate::tree::digits;
use crate::view::View;

const COLUMNS: &str = "camera_id, h11, h12, h13, h21, h22, h23, h31, h32, h33, cx, cy, fx, fy, division";

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut rows = Vec::new();
    for view in &scene.views {
        let lambda = match view.camera.lens.distortion {
            Distortion::Division { lambda } => lambda,
            _ => {
                export.lose_distortion(view);
                0.0
            }
        };
        rows.push(row(view, lambda));
    }
    export.push("floor.sql", text(&rows.join(",\n")));
    export.notes.push("floor.sql expects a table or view detections(camera_id, u, v)".into());
}

fn row(view: &View, lambda: f64) -> String {
    let focal = view.scale.map(|scale| scale * view.camera.lens.focal);
    let numbers = [&view.floor_from_pixel().concat()[..], &view.centre(), &focal, &[lambda]].concat();
    let cells: Vec<String> = numbers.iter().map(|&value| double(value)).collect();
    format!("  ('{}', {})", view.id.replace('\'', "''"), cells.join(", "))
}

/// A plain literal may be a decimal of few digits; one with an exponent is a double in every engine.
fn double(value: f64) -> String {
    let text = digits(value);
    if text.contains('e') { text } else { text + "e0" }
}

fn text(rows: &str) -> String {
    format!(
        "-- Pixels (u, v) count from the corner of the image. No row: above the horizon, or outside the lens.\n\
         CREATE VIEW calib_cameras AS\nSELECT * FROM (VALUES\n{rows}\n) AS c({COLUMNS});\n\n\
         CREATE VIEW calib_straight AS\nSELECT d.*, c.h11, c.h12, c.h13, c.h21, c.h22, c.h23, c.h31, c.h32, c.h33,\n  \
         c.cx + (d.u - c.cx) / {divisor} AS su,\n  c.cy + (d.v - c.cy) / {divisor} AS sv\n\
         FROM detections AS d JOIN calib_cameras AS c ON d.camera_id = c.camera_id\nWHERE {divisor} > 0;\n\n\
         CREATE VIEW calib_floor AS\nSELECT s.*,\n  \
         (s.h11 * s.su + s.h12 * s.sv + s.h13) / (s.h31 * s.su + s.h32 * s.sv + s.h33) AS x_m,\n  \
         (s.h21 * s.su + s.h22 * s.sv + s.h23) / (s.h31 * s.su + s.h32 * s.sv + s.h33) AS y_m\n\
         FROM calib_straight AS s\nWHERE s.h31 * s.su + s.h32 * s.sv + s.h33 > 0;\n",
        divisor = "(1.0 + c.division * (((d.u - c.cx) / c.fx) * ((d.u - c.cx) / c.fx) + ((d.v - c.cy) / c.fy) * ((d.v - c.cy) / c.fy)))",
    )
}
