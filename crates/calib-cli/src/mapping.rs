//! The columns that a table is mapped by, and those that it gets.

use std::sync::Arc;

use arrow::array::{
    Array as _, ArrayRef, AsArray as _, Float64Array, RecordBatch, RecordBatchOptions, StringBuilder,
};
use arrow::compute::cast;
use arrow::datatypes::{DataType, Field, Float64Type, Schema};
use calib_core::{Pixel, Status, WorldPoint};
use clap::ValueEnum;

use crate::archive::{is_json, plain};
use crate::calibrations::{Calibration, Calibrations, Choice};
use crate::stop::Stop;

/// Which way to map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum To {
    /// Columns `u,v` (or the boxes `x,y,w,h`) to `x_m,y_m,status`
    Floor,
    /// Columns `x_m,y_m,z_m` to `u,v,status`
    Pixel,
}

/// What the pixels of a table are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Columns {
    /// Points if there are `u` and `v`, else boxes
    Auto,
    /// Points: `u,v`
    Points,
    /// Boxes: `x,y` of the upper left corner, and `w,h`; the foot is the middle of the lower edge
    Boxes,
}

/// Where pixels are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelOrigin {
    /// From the corner of the image: the centre of the first pixel is (0.5, 0.5)
    Corner,
    /// From the centre of the first pixel, which is (0, 0)
    Centre,
}

/// How a table is mapped.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mapping {
    pub(crate) to: To,
    pub(crate) columns: Columns,
    pub(crate) origin: PixelOrigin,
    /// Of the plane, in metres, where the table does not say.
    pub(crate) height: f64,
}

/// Says which row of a batch is meant.
type Place<'a> = &'a dyn Fn(usize) -> String;

impl Mapping {
    /// The batch with the columns that were mapped; one that is there already is written anew in its place.
    pub(crate) fn map(
        &self,
        batch: &RecordBatch,
        calibrations: &mut Calibrations,
        place: Place<'_>,
    ) -> Result<RecordBatch, Stop> {
        let points = self.points(batch, place)?;
        let choice = calibrations.choose(batch, place)?;
        let mapped = points.mapped(self, calibrations, &choice);
        let names = match self.to {
            To::Floor => ["x_m", "y_m", "status"],
            To::Pixel => ["u", "v", "status"],
        };
        let schema = batch.schema();
        let mut fields: Vec<Arc<Field>> = schema.fields().iter().cloned().collect();
        let mut columns = batch.columns().to_vec();
        for (name, column) in names.into_iter().zip(mapped) {
            let field = Arc::new(Field::new(name, column.data_type().clone(), true));
            match schema.index_of(name) {
                Ok(index) => (fields[index], columns[index]) = (field, column),
                Err(_) => {
                    fields.push(field);
                    columns.push(column);
                }
            }
        }
        let schema = Schema::new(fields).with_metadata(calibrations.describe(&schema));
        let options = RecordBatchOptions::new().with_row_count(Some(batch.num_rows()));
        Ok(RecordBatch::try_new_with_options(Arc::new(schema), columns, &options)?)
    }

    /// What is to be mapped: pixels counted from the corner, or points of space.
    fn points(&self, batch: &RecordBatch, place: Place<'_>) -> Result<Points, Stop> {
        let schema = batch.schema();
        let has = |name: &str| schema.column_with_name(name).is_some();
        let half = if self.origin == PixelOrigin::Centre { 0.5 } else { 0.0 };
        let boxes = match (self.to, self.columns) {
            (To::Pixel, _) => {
                let [a, b] = numbers(batch, ["x_m", "y_m"], "x_m,y_m,z_m", place)?;
                let c = if has("z_m") {
                    let [c] = numbers(batch, ["z_m"], "z_m", place)?;
                    c
                } else {
                    vec![self.height; a.len()]
                };
                return Ok(Points { a, b, c });
            }
            (_, Columns::Auto) => !(has("u") && has("v")) && has("w") && has("h"),
            (_, columns) => columns == Columns::Boxes,
        };
        let [mut a, mut b] = if boxes {
            let [mut x, mut y, w, h] = numbers(batch, ["x", "y", "w", "h"], "x,y,w,h", place)?;
            x.iter_mut().zip(w).for_each(|(x, w)| *x += 0.5 * w);
            y.iter_mut().zip(h).for_each(|(y, h)| *y += h);
            [x, y]
        } else {
            numbers(
                batch,
                ["u", "v"],
                if self.columns == Columns::Auto { "u,v or x,y,w,h" } else { "u,v" },
                place,
            )?
        };
        if half != 0.0 {
            a.iter_mut().chain(&mut b).for_each(|value| *value += half);
        }
        Ok(Points { a, b, c: Vec::new() })
    }
}

/// What is to be mapped, column by column; NaN where there is nothing.
struct Points {
    a: Vec<f64>,
    b: Vec<f64>,
    /// Heights, of points of space.
    c: Vec<f64>,
}

impl Points {
    fn mapped(&self, mapping: &Mapping, calibrations: &Calibrations, choice: &Choice) -> [ArrayRef; 3] {
        let rows = self.a.len();
        let (mut x, mut y) = (vec![f64::NAN; rows], vec![f64::NAN; rows]);
        let mut status = vec![Status::NoCalibration; rows];
        match choice {
            Choice::All(index) => {
                let calibration = &calibrations.list[*index as usize];
                self.map(mapping, calibration, [&mut x, &mut y], &mut status);
            }
            Choice::Rows(chosen) => {
                let mut of_each = vec![Vec::new(); calibrations.list.len() + 1];
                for (row, &index) in chosen.iter().enumerate() {
                    of_each[index as usize].push(row);
                }
                for (calibration, rows) in calibrations.list.iter().zip(&of_each) {
                    if rows.is_empty() {
                        continue;
                    }
                    let some = self.some(rows);
                    let (mut some_x, mut some_y) = (vec![0.0; rows.len()], vec![0.0; rows.len()]);
                    let mut some_status = vec![Status::Ok; rows.len()];
                    some.map(mapping, calibration, [&mut some_x, &mut some_y], &mut some_status);
                    for (i, &row) in rows.iter().enumerate() {
                        (x[row], y[row], status[row]) = (some_x[i], some_y[i], some_status[i]);
                    }
                }
            }
        }
        if mapping.to == To::Pixel && mapping.origin == PixelOrigin::Centre {
            x.iter_mut().chain(&mut y).for_each(|value| *value -= 0.5);
        }
        [known(x), known(y), names(&status)]
    }

    fn some(&self, rows: &[usize]) -> Self {
        let pick = |values: &[f64]| match values {
            [] => Vec::new(),
            _ => rows.iter().map(|&row| values[row]).collect(),
        };
        Self { a: pick(&self.a), b: pick(&self.b), c: pick(&self.c) }
    }

    fn map(
        &self,
        mapping: &Mapping,
        calibration: &Calibration,
        [x, y]: [&mut [f64]; 2],
        status: &mut [Status],
    ) {
        if mapping.to == To::Floor {
            let pixels = [&self.a[..], &self.b[..]];
            calibration.projector.pixels_to_floor_within(&calibration.extent(), pixels, [x, y], status);
            return;
        }
        for i in 0..self.a.len() {
            let point = WorldPoint { x: self.a[i], y: self.b[i], z: self.c[i] };
            let (pixel, what) = to_pixel(calibration, point);
            (x[i], y[i]) = pixel.map_or((f64::NAN, f64::NAN), |pixel| (pixel.u, pixel.v));
            status[i] = what;
        }
    }
}

fn to_pixel(calibration: &Calibration, point: WorldPoint) -> (Option<Pixel>, Status) {
    let camera = calibration.projector.camera();
    if !point.is_finite() {
        return (None, Status::Missing);
    }
    let Some(straight) = camera.world_to_undistorted(point) else { return (None, Status::BehindCamera) };
    match camera.distort(straight) {
        None => (None, Status::OutsideLens),
        Some(pixel) if calibration.extent().shows(pixel) => (Some(pixel), Status::Ok),
        Some(pixel) => (Some(pixel), Status::OutsideImage),
    }
}

/// Columns of numbers, NaN where there is none.
fn numbers<const N: usize>(
    batch: &RecordBatch,
    names: [&str; N],
    expected: &str,
    place: Place<'_>,
) -> Result<[Vec<f64>; N], Stop> {
    let schema = batch.schema();
    let mut found = [const { Vec::new() }; N];
    for (values, name) in found.iter_mut().zip(names) {
        let Some((index, field)) = schema.column_with_name(name) else {
            let columns: Vec<&str> = schema.fields().iter().map(|field| field.name().as_str()).collect();
            // The columns of CSV are in its header; JSON has them line by line.
            let is_csv = batch.num_rows() == 0
                || place(0).starts_with("line") && !schema.fields().iter().any(|f| is_json(f));
            let place = if is_csv { "line 1".into() } else { place(0) };
            let what = format!("{place}: found the columns \"{}\", expected {expected}", columns.join(","));
            return Err(Stop::Invalid(what));
        };
        let column = batch.column(index);
        let column = if is_json(field) { plain(column) } else { column.clone() };
        *values = doubles(&column, name, place)?;
    }
    Ok(found)
}

fn doubles(column: &ArrayRef, name: &str, place: Place<'_>) -> Result<Vec<f64>, Stop> {
    let refused = || {
        Stop::Invalid(format!("column {name}: found values of type {}, expected numbers", column.data_type()))
    };
    match column.data_type() {
        kind if kind.is_numeric() => {
            let exact = cast(column, &DataType::Float64).map_err(|_| refused())?;
            let exact = exact.as_primitive::<Float64Type>();
            Ok(match exact.nulls() {
                None => exact.values().to_vec(),
                Some(_) => exact.iter().map(|value| value.unwrap_or(f64::NAN)).collect(),
            })
        }
        DataType::Null => Ok(vec![f64::NAN; column.len()]),
        DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View | DataType::Dictionary(..) => {
            let texts = cast(column, &DataType::Utf8).map_err(|_| refused())?;
            let texts = texts.as_string::<i32>().iter().enumerate();
            let parsed = texts.map(|(row, text)| match text.map(str::trim) {
                None | Some("") => Ok(f64::NAN),
                Some(text) => text.parse().map_err(|_| {
                    let place = place(row);
                    Stop::Invalid(format!("{place}, column {name}: found \"{text}\", expected a number"))
                }),
            });
            parsed.collect()
        }
        _ => Err(refused()),
    }
}

/// NaN becomes null.
fn known(values: Vec<f64>) -> ArrayRef {
    if values.iter().all(|value| !value.is_nan()) {
        return Arc::new(Float64Array::from(values));
    }
    Arc::new(values.into_iter().map(|value| (!value.is_nan()).then_some(value)).collect::<Float64Array>())
}

fn names(status: &[Status]) -> ArrayRef {
    let mut names = StringBuilder::with_capacity(status.len(), 4 * status.len());
    status.iter().for_each(|status| names.append_value(status.name()));
    Arc::new(names.finish())
}
