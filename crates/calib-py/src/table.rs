//! Mapping of whole tables, as `calib project` does for files. Tables of any library with Arrow's C interface
//! work.

use std::ffi::CString;

use arrow_array::{RecordBatch, RecordBatchReader};
use calib_core::floor::Stream;
use calib_site::CoordinateSystem;
use calib_table::{
    AtColumn, AtUnit, BadCells, BadRows, Boxes, CalibrationRequest, Calibrations, CameraSource, Columns,
    Mapping, RowName, Rows, TableBoxForm, TableError, To, Wording,
};
use pyo3::exceptions::{PyTypeError, PyUserWarning};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use pyo3_arrow::{PyRecordBatchReader, PyTable};
use sha2::{Digest as _, Sha256};

use crate::array::real;
use crate::error::value_error;
use crate::site::{Site, time};
use crate::stream::{KEYWORDS, stream_of};

/// Options of `Site.project`, from its keywords.
#[derive(Debug)]
struct TableOptions {
    camera: Option<String>,
    camera_column: Option<String>,
    at: Option<String>,
    at_column: Option<String>,
    at_unit: Option<AtUnit>,
    to: To,
    columns: Columns,
    box_form: Option<TableBoxForm>,
    height: f64,
    sigma: Option<f64>,
    is_geographic: bool,
    grid: Option<CoordinateSystem>,
    replaces: bool,
    bad_rows: BadRows,
    stream: Stream,
}

const OPTIONS: &str = "camera, camera_column, at, at_column, at_unit, to, columns, box_form, height, sigma_px, geographic, crs, \
     replace, bad_rows";

const TO: [(&str, To); 2] = [("floor", To::Floor), ("pixel", To::Pixel)];
const COLUMNS: [(&str, Columns); 3] =
    [("auto", Columns::Auto), ("points", Columns::Points), ("boxes", Columns::Boxes)];
const BAD_ROWS: [(&str, BadRows); 2] = [("fail", BadRows::Fail), ("status", BadRows::Status)];

fn in_list<T: Copy>(list: &[(&str, T)], name: &str) -> Option<T> {
    list.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
}

impl TableOptions {
    fn read(py: Python<'_>, keywords: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let (mut asked, pixels) = (Self::defaults(), PyDict::new(py));
        for (keyword, value) in keywords.into_iter().flatten() {
            if value.is_none() {
                continue;
            }
            match keyword.extract::<String>()?.as_str() {
                "camera" => asked.camera = value.extract()?,
                "camera_column" => asked.camera_column = value.extract()?,
                "at" => asked.at = Some(time(&value, None)?),
                "at_column" => asked.at_column = value.extract()?,
                "at_unit" => {
                    asked.at_unit = Some(choice(
                        &value,
                        "at_unit",
                        AtUnit::from_name,
                        "\"s\", \"ms\", \"us\" or \"ns\"",
                    )?);
                }
                "to" => asked.to = choice(&value, "to", |name| in_list(&TO, name), "\"floor\" or \"pixel\"")?,
                "columns" => {
                    asked.columns = choice(
                        &value,
                        "columns",
                        |name| in_list(&COLUMNS, name),
                        "\"auto\", \"points\" or \"boxes\"",
                    )?;
                }
                "box_form" => {
                    asked.box_form = Some(choice(
                        &value,
                        "box_form",
                        TableBoxForm::from_name,
                        "\"xyxy\", \"xywh\", \"cxcywh\" or \"yolo\"",
                    )?);
                }
                "height" => asked.height = real(Some(&value), "height", 0.0)?,
                "sigma_px" => asked.sigma = Some(real(Some(&value), "sigma_px", 1.0)?),
                "geographic" => asked.is_geographic = value.extract()?,
                "crs" => asked.grid = Some(grid(&value)?),
                "replace" => asked.replaces = value.extract()?,
                "bad_rows" => {
                    asked.bad_rows = choice(
                        &value,
                        "bad_rows",
                        |name| in_list(&BAD_ROWS, name),
                        "\"fail\" or \"status\"",
                    )?;
                }
                "origin" | "stream_size" | "fit" | "crop" => pixels.set_item(keyword, value)?,
                other => {
                    let what = format!("unexpected keyword {other:?}, expected {OPTIONS}, {KEYWORDS}");
                    return Err(PyTypeError::new_err(what));
                }
            }
        }
        asked.stream = stream_of(&pixels)?;
        asked.check(py)?;
        Ok(asked)
    }

    const fn defaults() -> Self {
        Self {
            camera: None,
            camera_column: None,
            at: None,
            at_column: None,
            at_unit: None,
            to: To::Floor,
            columns: Columns::Auto,
            box_form: None,
            height: 0.0,
            sigma: None,
            is_geographic: false,
            grid: None,
            replaces: false,
            bad_rows: BadRows::Fail,
            stream: Stream {
                origin: calib_core::floor::PixelOrigin::Corner,
                size: None,
                fit: None,
                crop: None,
            },
        }
    }

    /// Rejects options that contradict each other.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        let both = |field: &str| {
            format!(
                "found {field} and {field}_column, expected one of them: one {field} for all rows, or one for each row"
            )
        };
        match (&self.camera, &self.camera_column) {
            (Some(_), Some(_)) => return Err(value_error(py, None, "camera", both("camera"))),
            (None, None) => {
                let what = "expected camera= with the id of a camera, or camera_column= with the name of a column of ids";
                return Err(value_error(py, None, "camera", what));
            }
            _ => {}
        }
        if self.at.is_some() && self.at_column.is_some() {
            return Err(value_error(py, None, "at", both("at")));
        }
        if self.to == To::Pixel && self.sigma.is_some() {
            return Err(value_error(py, None, "sigma_px", "requires to=\"floor\""));
        }
        if self.to == To::Pixel && self.is_geographic {
            return Err(value_error(py, None, "geographic", "requires to=\"floor\""));
        }
        if self.to == To::Pixel && self.grid.is_some() {
            return Err(value_error(py, None, "crs", "requires to=\"floor\""));
        }
        Ok(())
    }

    /// Returns the calibrations of the requested cameras at the requested time.
    fn calibrations(&self, py: Python<'_>, site: &Site) -> PyResult<Calibrations> {
        let text = site.0.to_json();
        if let Some(id) =
            self.camera.as_ref().filter(|id| site.0.cameras.iter().all(|entry| entry.id != **id))
        {
            return Err(crate::error::camera_error(py, id, calib_site::CameraLookupError::Unknown));
        }
        let site = match &self.at {
            Some(at) => site.valid_at(py, at)?,
            None => site.0.clone(),
        };
        let camera = match (&self.camera, &self.camera_column) {
            (Some(id), _) => CameraSource::Only(id.clone()),
            (None, column) => CameraSource::Column(column.clone().unwrap_or_default()),
        };
        let at = self.at_column.clone().map(|name| AtColumn::new(name, self.at_unit, Wording::Keywords));
        let wanted = CalibrationRequest {
            camera,
            at,
            height: self.height,
            stream: self.stream,
            wording: Wording::Keywords,
        };
        let digest: String =
            Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        Calibrations::from_site(&site, digest, wanted).map_err(|why| table_error(py, &why))
    }

    fn mapping(&self) -> Mapping {
        Mapping {
            to: self.to,
            columns: self.columns,
            boxes: Boxes::new(self.box_form),
            height: self.height,
            sigma: self.sigma,
            is_geographic: self.is_geographic,
            grid: self.grid.clone(),
            replaces: self.replaces,
            bad: BadCells::new(self.bad_rows, Wording::Keywords),
        }
    }
}

/// Reads the keyword `crs`.
fn grid(value: &Bound<'_, PyAny>) -> PyResult<CoordinateSystem> {
    let read = |name: &str| CoordinateSystem::new(name).ok();
    choice(value, "crs", read, "the EPSG code of a grid, such as \"EPSG:25832\"")
}

fn choice<T>(
    value: &Bound<'_, PyAny>,
    field: &str,
    from_name: impl Fn(&str) -> Option<T>,
    expected: &str,
) -> PyResult<T> {
    let name: String = value.extract()?;
    from_name(&name).ok_or_else(|| {
        value_error(value.py(), None, field, format_args!("found {name:?}, expected {expected}"))
    })
}

fn table_error(py: Python<'_>, why: &TableError) -> PyErr {
    value_error(py, None, "table", why)
}

#[pymethods]
impl Site {
    /// Maps a whole table. Each row uses its camera, and the calibration that was valid at its time.
    ///
    /// Other columns pass through unchanged. The added columns are x_m, y_m and status (or u, v and status).
    /// With sigma_px there are also sigma_x_m, sigma_y_m and rho for the part of the pixel, and
    /// calibration_sigma_x_m and so on for the part of the calibration. Missing results are null.
    ///
    /// Args: table: table of any library with Arrow's C stream interface: Polars, pandas, PyArrow, DuckDB.
    /// camera: id of the camera of all rows; alternative to camera_column. camera_column: name of the column with
    /// the camera's id. at: time of all rows (RFC 3339, or a datetime with a time zone); alternative to
    /// at_column. at_column: name of the column with the time. at_unit: unit of numbers in that column, counted
    /// from 1970: "s", "ms", "us" or "ns"; by default from the ending of the name of the column. to: "floor"
    /// (columns u, v, or the boxes x, y, w, h) or "pixel" (columns x_m, y_m, z_m). columns: "points", "boxes" or
    /// "auto" (points if there are u and v, otherwise boxes). box_form: "xyxy" (two corners), "xywh" (upper left
    /// corner, width and height), "cxcywh" (centre, width and height) or "yolo" (the same as fractions of the
    /// stream); by default from the names of the columns. height: height of the plane above the floor, in metres.
    /// sigma_px: standard deviation of a detection, in pixels of the stream. geographic: whether to add lat_deg
    /// and lon_deg, for a site with a georeference; with sigma_px also sigma_east_m and so on, in metres. crs:
    /// EPSG code of a grid, such as "EPSG:25832", in which easting and northing are added. replace: whether to
    /// replace existing columns of the table. bad_rows: "fail" raises for a cell that is not a number; "status"
    /// reports it in the status of its row. origin, stream_size, fit, crop: kind of pixels, see `Camera`.
    ///
    /// Returns: A table for `polars.DataFrame`, `pyarrow.table` or `pandas.DataFrame.from_arrow`.
    #[pyo3(
        signature = (table, **options),
        text_signature = "($self, table, *, camera=None, camera_column=None, at=None, at_column=None, at_unit=None, to='floor', columns='auto', box_form=None, height=0.0, sigma_px=None, geographic=False, crs=None, replace=False, bad_rows='fail', origin=None, stream_size=None, fit=None, crop=None)"
    )]
    fn project(&self, table: &Bound<'_, PyAny>, options: Option<&Bound<'_, PyDict>>) -> PyResult<PyTable> {
        let py = table.py();
        let asked = TableOptions::read(py, options)?;
        let mut calibrations = asked.calibrations(py, self)?;
        for note in calibrations.notes() {
            warn(py, note)?;
        }
        let unreadable = |why: PyErr| {
            value_error(
                py,
                None,
                "table",
                format_args!(
                    "expected a table of Polars, PyArrow, DuckDB or pandas (which needs PyArrow): {}",
                    why.value(py)
                ),
            )
        };
        let reader = table.extract::<PyRecordBatchReader>().map_err(unreadable)?.into_reader()?;
        let (mapping, schema) = (asked.mapping(), reader.schema());
        let (mut mapped, mut before): (Vec<RecordBatch>, usize) = (Vec::new(), 0);
        for batch in reader {
            let batch = batch.map_err(|why| value_error(py, None, "table", why))?;
            let found = py.detach(|| {
                mapping.map(&batch, &mut calibrations, complete_rows(&|row| format!("row {}", before + row)))
            });
            mapped.push(found.map_err(|why| table_error(py, &why))?);
            before += batch.num_rows();
        }
        if mapped.is_empty() {
            let none = mapping.map(
                &RecordBatch::new_empty(schema),
                &mut calibrations,
                complete_rows(&|_| "row 0".into()),
            );
            mapped.push(none.map_err(|why| table_error(py, &why))?);
        }
        for note in mapping.bad.notes().into_iter().chain(calibrations.uncalibrated_notes()) {
            warn(py, &note)?;
        }
        let schema = mapped[0].schema();
        PyTable::try_new(mapped, schema)
    }
}

fn warn(py: Python<'_>, note: &str) -> PyResult<()> {
    let text = CString::new(note.replace('\0', " ")).unwrap_or_default();
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
}

/// Creates row information for an Arrow table, whose rows are always complete.
fn complete_rows<'a>(place: RowName<'a>) -> Rows<'a> {
    Rows { row_name: place, is_incomplete: &|_| false }
}
