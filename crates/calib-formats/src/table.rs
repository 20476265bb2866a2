//! Table with one row for each camera, for trackers without a camera library. Each matrix has its direction
//! in its name.
//!
//! The matrices apply to undistorted pixels, and each row also contains the lens for the undistortion. Pixels
//! count from the corner of the image. A pixel shows the floor only if the third coordinate of
//! `floor_from_undistorted_px` is positive; elsewhere it is above the horizon.
//!
//! Planes other than the floor are in `planes`, or in `planes.csv`, with one row for each plane and camera.
//! `plane_from_undistorted_px` gives x and y of a point, and `plane_z_m + plane_slope . (x, y)` its height.
//! The row applies if `region_m` contains (x, y).

use calib_core::{FloorPoint, Pixel, Plane};

use calib_core::camera::Coefficient;

use calib_site::PlaneEntry;
use serde_json::{Map, Value, json};

use crate::export::{Export, Scene};
use crate::planes::{PlaneTreatment, covering};
use crate::tree::{digits, pretty};
use crate::view::View;

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let rows: Vec<Map<String, Value>> = scene.views.iter().map(row).collect();
    let planes = covering(scene.site);
    let of_view = |view| planes.iter().map(move |(entry, plane)| plane_row(view, entry, plane));
    let planes: Vec<Map<String, Value>> = scene.views.iter().flat_map(of_view).collect();
    if scene.extension == "csv" {
        export.push("cameras.csv", csv(&rows));
        match (planes.is_empty(), scene.options.embeds) {
            (true, _) => {}
            (false, false) => export.push("planes.csv", csv(&planes)),
            (false, true) => export.report_planes(scene.site, PlaneTreatment::Misleading),
        }
    } else {
        let mut document = json!({"format": "calib-table", "version": 1, "units": "m, px",
            "pixel_origin": "corner", "cameras": rows});
        if !planes.is_empty() {
            document["planes"] = json!(planes);
        }
        export.push("cameras.json", pretty(&document));
    }
}

/// Returns the table row for a plane and a camera. The row applies if the region of the plane contains the
/// point. Of two valid points on the viewing ray, the nearer one is visible: on the plane or on the floor.
fn plane_row(view: &View, entry: &PlaneEntry, plane: &Plane) -> Map<String, Value> {
    let region: Vec<[f64; 2]> = entry.region.iter().map(|&p| p.into()).collect();
    let fields = [
        ("plane_id", json!(entry.id)),
        ("camera_id", json!(view.id)),
        ("valid_from", json!(view.valid_from)),
        ("valid_to", json!(view.valid_to)),
        ("plane_z_m", json!(plane.height_at(FloorPoint::default()))),
        ("plane_slope", json!(plane.slope)),
        ("plane_from_undistorted_px", json!(view.plane_from_pixel(plane).concat())),
        ("region_m", json!(region)),
    ];
    fields.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

fn row(view: &View) -> Map<String, Value> {
    let polygon: Vec<[f64; 2]> = view.efov_px.iter().map(|&p: &Pixel| p.into()).collect();
    let floor: Vec<[f64; 2]> = view.efov_on_floor.iter().map(|&p| p.into()).collect();
    let p = view.projection(view.centre());
    let on_floor = p.map(|[a, b, _, d]| [a, b, d]);
    let lens = &view.camera.lens;
    let model = lens.distortion.model().map_or("none", |model| model.row().name);
    let names = lens.distortion.names();
    let focal = view.scale.map(|scale| scale * if names.is_empty() { view.camera.focal } else { lens.focal });
    let mut row = Map::new();
    let mut put = |key: &str, value: Value| row.insert(key.to_owned(), value);
    put(ID_COLUMN, json!(view.id));
    put("valid_from", json!(view.valid_from));
    put("valid_to", json!(view.valid_to));
    put("width", json!(view.size[0]));
    put("height", json!(view.size[1]));
    put("plane_z_m", json!(0.0));
    put("floor_from_undistorted_px", json!(view.floor_from_pixel().concat()));
    put("undistorted_px_from_floor", json!(on_floor.concat()));
    put("undistorted_px_from_world", json!(p.concat()));
    put("distortion_model", json!(model));
    put("distortion_focal_px", json!(focal));
    put("principal_point_px", json!(view.centre()));
    for which in Coefficient::ALL {
        let index = names.iter().position(|&name| name == which);
        put(which.name(), json!(index.map_or(0.0, |index| lens.distortion.coefficients()[index])));
    }
    put("valid_polygon_px", json!(polygon));
    put("valid_polygon_m", json!(floor));
    row
}

/// Name of the column with the camera's id.
const ID_COLUMN: &str = "camera_id";

/// Formats rows as CSV. A list becomes one cell with spaces between its numbers, and the camera's id is the
/// first column.
fn csv(rows: &[Map<String, Value>]) -> String {
    let Some(first) = rows.first() else { return String::new() };
    let mut names: Vec<&str> = first.keys().map(String::as_str).collect();
    names.sort_by_key(|&name| name != ID_COLUMN);
    let mut text = names.join(",") + "\n";
    for row in rows {
        let cells: Vec<String> = names.iter().map(|&name| cell(&row[name])).collect();
        text += &(cells.join(",") + "\n");
    }
    text
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// Whether a spreadsheet would run this CSV cell as a formula. Text that begins with a sign and is not a
/// number counts too.
#[must_use]
pub fn is_spreadsheet_formula(cell: &[u8]) -> bool {
    match cell {
        [b'=' | b'@' | b'\t' | b'\r', ..] => true,
        [b'+' | b'-', _, ..] => {
            std::str::from_utf8(cell).map_or(true, |text| text.trim().parse::<f64>().is_err())
        }
        _ => false,
    }
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) if is_spreadsheet_formula(text.as_bytes()) => quoted(&format!("'{text}")),
        Value::String(text) if text.contains([',', '"', '\n', '\r']) => quoted(text),
        Value::String(text) => text.clone(),
        Value::Array(items) => items.iter().map(cell).collect::<Vec<_>>().join(" "),
        number => match (number.as_u64(), number.as_f64()) {
            (Some(whole), _) => whole.to_string(),
            (_, Some(value)) => digits(value),
            _ => String::new(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_formula_is_escaped_in_a_cell_and_a_number_is_not() {
        for text in ["=1+1", "@SUM(A1)", "+cmd|' /C calc'!A0", "-2+3", "\t=1"] {
            assert!(is_spreadsheet_formula(text.as_bytes()), "{text}");
            assert!(cell(&json!(text)).starts_with("\"'"), "{text}");
        }
        for text in ["-1.5", "+3", "-1e-7", "door", "-", "", "2026-05-01"] {
            assert!(!is_spreadsheet_formula(text.as_bytes()), "{text}");
        }
    }
}
