//! Maps one Arrow batch of detections to the floor, as an engine would do inside a user-defined function.
//!
//! `cargo run --example map_batches -- solved.json CAMERA`

use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray};
use calib_core::floor::Stream;
use calib_site::Site;
use calib_table::{
    BadCells, BadRows, Boxes, CalibrationRequest, Calibrations, CameraSource, Columns, Mapping, Rows, To,
    Wording,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [_, path, camera] =
        std::env::args().collect::<Vec<_>>().try_into().map_err(|_| "usage: SITE CAMERA")?;
    let site = Site::from_json(&std::fs::read_to_string(path)?)?;
    let wording = Wording::Keywords;
    let camera_column = CameraSource::Column("camera".into());
    let wanted = CalibrationRequest {
        camera: camera_column,
        at: None,
        height: 0.0,
        stream: Stream::default(),
        wording,
    };
    let mut calibrations = Calibrations::from_site(&site, String::new(), wanted)?;
    let bad = BadCells::new(BadRows::Fail, wording);
    let mapping = Mapping {
        to: To::Floor,
        columns: Columns::Points,
        boxes: Boxes::default(),
        height: 0.0,
        sigma: Some(2.0),
        is_geographic: false,
        grid: None,
        replaces: false,
        bad,
    };
    let batch = RecordBatch::try_from_iter([
        ("camera", Arc::new(StringArray::from(vec![camera.as_str(), camera.as_str()])) as ArrayRef),
        ("u", Arc::new(Float64Array::from(vec![960.0, 700.0]))),
        ("v", Arc::new(Float64Array::from(vec![800.0, 900.0]))),
    ])?;
    let rows = Rows { row_name: &|row| format!("row {row}"), is_incomplete: &|_| false };
    println!("{:#?}", mapping.map(&batch, &mut calibrations, rows)?);
    Ok(())
}
