//! `calib project`: maps tables of pixels to the floor, or of 3D points to pixels, in batches, so that tables
//! may have any size.
//!
//! Also encodes the table of cameras as Apache Parquet for query engines, with the values of its JSON form.

use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

use arrow_array::builder::{Float64Builder, ListBuilder};
use arrow_array::types::Float64Type;
use arrow_array::{
    ArrayRef, Float64Array, Int32Array, ListArray, RecordBatch, RecordBatchOptions, StringArray,
};
use arrow_schema::{Field, Schema};
use calib_core::floor::Stream;
use calib_site::CoordinateSystem;
use calib_table::{
    AtColumn, AtUnit, BadCells, BadRows, Boxes, CalibrationRequest, Calibrations, CameraSource, Columns,
    Mapping, Rows, TableBoxForm, To, Wording,
};
use clap::builder::{PossibleValue, PossibleValuesParser};
use parquet::arrow::ArrowWriter;
use serde_json::{Map, Value};

use crate::archive::{FORMATS, Format, Input, Output, OutputOptions, ReadOptions, Sink, Source};
use crate::args::{Fit, PixelOrigin, SiteArgs, grid, size};
use crate::files;
use crate::progress::Progress;
use crate::stop::CommandError;

/// Encodes the table of cameras as Parquet. Fields outside the rows become metadata.
pub(crate) fn encode_parquet(json: &[u8]) -> Result<Vec<u8>, CommandError> {
    let mut about: Map<String, Value> = serde_json::from_slice(json)?;
    let Some(Value::Array(rows)) = about.remove("cameras") else { return Ok(Vec::new()) };
    let first = rows.first().and_then(Value::as_object).into_iter().flatten();
    let (fields, columns): (Vec<Field>, Vec<ArrayRef>) = first
        .map(|(key, value)| {
            let values = column(key, value, &rows);
            (Field::new(key, values.data_type().clone(), true), values)
        })
        .unzip();
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let about = about.iter().map(|(key, value)| (key.clone(), text(value))).collect();
    let schema = Arc::new(Schema::new(fields).with_metadata(about));
    let count = RecordBatchOptions::new().with_row_count(Some(rows.len()));
    let batch = RecordBatch::try_new_with_options(Arc::clone(&schema), columns, &count)?;
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, schema, None)?;
    writer.write(&batch)?;
    writer.close()?;
    Ok(bytes)
}

/// Builds the column of one key; the first row determines its type. Matrices are lists of numbers and
/// polygons are lists of points. A null value in the first row makes a text column.
fn column(key: &str, first: &Value, rows: &[Value]) -> ArrayRef {
    let values = rows.iter().map(|row| row.get(key));
    let numbers = |value: &Value| Some(value.as_array()?.iter().map(Value::as_f64).collect::<Vec<_>>());
    match first {
        Value::Number(number) if number.is_u64() => {
            Arc::new(values.map(|value| value?.as_i64()?.try_into().ok()).collect::<Int32Array>())
        }
        Value::Number(_) => Arc::new(values.map(|value| value?.as_f64()).collect::<Float64Array>()),
        Value::Array(_) if key.starts_with("valid_polygon") => {
            let mut polygons = ListBuilder::new(ListBuilder::new(Float64Builder::new()));
            for value in values {
                let points = value.and_then(Value::as_array);
                for point in points.into_iter().flatten() {
                    polygons.values().append_option(numbers(point));
                }
                polygons.append(points.is_some());
            }
            Arc::new(polygons.finish())
        }
        Value::Array(_) => {
            Arc::new(ListArray::from_iter_primitive::<Float64Type, _, _>(values.map(|value| numbers(value?))))
        }
        _ => Arc::new(values.map(|value| Some(value?.as_str()?.to_owned())).collect::<StringArray>()),
    }
}

/// Note about metadata at the end of the help.
const METADATA: &str = "Parquet and Arrow outputs contain metadata: calib.version, calib.site_sha256 (of the site \
file), and calib.calibrations (JSON). With a single calibration they also contain calib.camera, calib.valid_from and \
calib.valid_to. CSV and NDJSON have no metadata.";

/// Arguments of `calib project`.
#[derive(Debug, clap::Args)]
#[command(after_help = METADATA)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Camera of all rows
    #[arg(long, value_name = "ID", required_unless_present = "camera_column")]
    camera: Option<String>,
    /// Column with the camera of every row; rows of uncalibrated cameras get the status no-calibration
    #[arg(long, value_name = "NAME", conflicts_with = "camera")]
    camera_column: Option<String>,
    /// Column of times (timestamps, or RFC 3339 text; UTC if no offset is given): each row is mapped with
    /// the calibration valid at its time
    #[arg(long, value_name = "NAME", conflicts_with = "at")]
    at_column: Option<String>,
    /// Unit of numeric times, counted from 1970; by default taken from the end of the column's name (_s, _ms,
    /// _us, _ns)
    #[arg(long, value_enum, value_name = "UNIT", requires = "at_column")]
    at_unit: Option<AtUnit>,
    /// Direction of the mapping
    #[arg(long, value_enum)]
    to: To,
    /// Whether pixels are points or boxes
    #[arg(long, value_enum, default_value_t = Columns::Auto)]
    columns: Columns,
    /// Meaning of the four numbers of a box; by default taken from the names of the columns
    #[arg(long, value_enum, value_name = "FORM")]
    box_form: Option<TableBoxForm>,
    /// Origin of pixel coordinates
    #[arg(long, value_enum, default_value_t = PixelOrigin::Corner)]
    pixel_origin: PixelOrigin,
    /// Height of the plane above the floor, in metres; with --to pixel, used if the column `z_m` is missing
    #[arg(long, value_name = "H", default_value_t = 0.0, allow_negative_numbers = true)]
    height_m: f64,
    /// Width and height of the stream that the pixels belong to, if it differs from the image
    #[arg(long, value_name = "WxH", value_parser = size)]
    stream_size: Option<[u32; 2]>,
    /// Scaling of the image to the stream of --stream-size; required if the aspect ratios differ
    #[arg(long, value_enum, requires = "stream_size")]
    stream_fit: Option<Fit>,
    /// Standard deviation of a detection, in pixels of its stream: adds `sigma_x_m,sigma_y_m,rho` for the
    /// pixel and `calibration_sigma_x_m` and so on for the calibration; the latter are empty if unknown
    #[arg(long, value_name = "P")]
    sigma_px: Option<f64>,
    /// Add `lat_deg,lon_deg` (WGS84) of every floor point; needs a georeferenced site. With
    /// --sigma-px, also the standard deviations towards east and north
    #[arg(long)]
    geographic: bool,
    /// Add `easting,northing` of every floor point in a projected grid such as EPSG:25832, in the unit of the
    /// grid; needs a georeferenced site. With --sigma-px, also the standard deviations towards east and
    /// north
    #[arg(long, value_name = "EPSG:CODE", value_parser = grid)]
    crs: Option<CoordinateSystem>,
    /// Handling of rows with a cell that is not a number or not a time
    #[arg(long, value_enum, default_value_t = BadRows::Fail)]
    bad_rows: BadRows,
    /// Replace output columns that the table already has
    #[arg(long)]
    replace: bool,
    /// Input table; - is stdin
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    input: String,
    /// Format of the input; by default taken from its name or its first bytes
    #[arg(long, value_name = "FORMAT", value_parser = formats())]
    from: Option<String>,
    /// Output table; - is stdout
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    output: String,
    /// Format of the output; by default taken from its name, otherwise the same as the input
    #[arg(long, value_name = "FORMAT", value_parser = formats())]
    format: Option<String>,
    /// Keep this CSV column as text, even if its first cells look like numbers (repeat for more)
    #[arg(long, value_name = "NAME")]
    as_text: Vec<String>,
    /// Write CSV cells unchanged, even if a spreadsheet would read them as formulas
    #[arg(long)]
    verbatim: bool,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

fn formats() -> PossibleValuesParser {
    PossibleValuesParser::new(FORMATS.iter().map(|f| PossibleValue::new(f.name).help(f.about)))
}

/// Maps every row of a table.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    check(args)?;
    files::check_free(&args.output, args.force)?;
    let mut calibrations = calibrations(args)?;
    let mut input = Input::open(&args.input)?;
    let [from, to] = input_and_output_formats(args, &mut input)?;
    let packed = to.compression_for(&args.output)?;
    let (bytes, read) = (input.bytes, input.counter());
    let name = input.name.clone();
    let source = from.open(
        input,
        ReadOptions { to, as_text: &args.as_text, keeps_incomplete: args.bad_rows == BadRows::Status },
    )?;
    let mut table = Table { name, source, mapping: mapping(args), is_verbatim: args.verbatim };
    let mut progress = Progress::new(table.source.rows(), bytes, read);
    let mut pass = |output: Output<'_>| {
        let output = match packed {
            Some(packed) => packed.encoder(output)?,
            None => output,
        };
        table.convert(&mut calibrations, to, output, &mut progress)
    };
    if args.output == "-" {
        let stdout = files::Stdout::default();
        stdout.finish(pass(Box::new(BufWriter::with_capacity(1 << 16, stdout.clone()))))?;
    } else {
        let path = Path::new(&args.output);
        files::write_through(path, args.force, |file| {
            pass(Box::new(BufWriter::with_capacity(1 << 20, file)))
        })?;
    }
    drop(progress);
    let of_boxes = table.mapping.boxes.notes().map(str::to_owned);
    for note in of_boxes.chain(table.mapping.bad.notes()).chain(calibrations.uncalibrated_notes()) {
        files::print_message(format_args!("calib: {note}"));
    }
    Ok(())
}

/// Refuses invalid arguments, and arguments that contradict each other.
fn check(args: &Args) -> Result<(), CommandError> {
    let refused = |what: &str| Err(CommandError::Usage(what.into()));
    if !args.height_m.is_finite() {
        return refused("--height-m: expected a number of metres");
    }
    if args.to == To::Pixel && args.columns == Columns::Boxes {
        return refused("--columns boxes requires --to floor");
    }
    if args.box_form.is_some() && (args.to == To::Pixel || args.columns == Columns::Points) {
        return refused("--box-form requires --to floor, and boxes in the table");
    }
    if args.to == To::Pixel && args.geographic {
        return refused("--geographic requires --to floor");
    }
    if args.to == To::Pixel && args.crs.is_some() {
        return refused("--crs requires --to floor");
    }
    if args.to == To::Pixel && args.sigma_px.is_some() {
        return refused("--sigma-px requires --to floor");
    }
    if args.sigma_px.is_some_and(|sigma| !(sigma >= 0.0 && sigma.is_finite())) {
        return refused("--sigma-px: expected a number of pixels, 0 or more");
    }
    if args.site.is_stdin() && args.input == "-" {
        return refused("the site and the table cannot both come from stdin; give --input FILE");
    }
    Ok(())
}

/// Returns the formats of the input and of the output.
fn input_and_output_formats(args: &Args, input: &mut Input) -> Result<[&'static Format; 2], CommandError> {
    let from = match (&args.from, Format::from_path(&args.input)) {
        (Some(name), _) => Format::from_name(name)?,
        (None, Some(format)) => format,
        (None, None) => input.format()?,
    };
    let to = match (&args.format, Format::from_path(&args.output)) {
        (Some(name), _) => Format::from_name(name)?,
        (None, Some(format)) => format,
        (None, None) => from,
    };
    Ok([from, to])
}

fn mapping(args: &Args) -> Mapping {
    Mapping {
        to: args.to,
        columns: args.columns,
        boxes: Boxes::new(args.box_form),
        height: args.height_m,
        sigma: args.sigma_px,
        is_geographic: args.geographic,
        grid: args.crs.clone(),
        replaces: args.replace,
        bad: BadCells::new(args.bad_rows, Wording::Flags),
    }
}

fn calibrations(args: &Args) -> Result<Calibrations, CommandError> {
    let file = args.site.read()?;
    let camera = match (&args.camera, &args.camera_column) {
        (Some(id), _) => {
            if args.at_column.is_some() {
                file.has_camera(id)?;
            } else {
                file.camera(id)?;
            }
            CameraSource::Only(id.clone())
        }
        (None, column) => CameraSource::Column(column.clone().unwrap_or_default()),
    };
    let at = args.at_column.clone().map(|name| AtColumn::new(name, args.at_unit, Wording::Flags));
    let origin = args.pixel_origin.into();
    let stream = Stream { origin, size: args.stream_size, fit: args.stream_fit.map(Into::into), crop: None };
    let wanted = CalibrationRequest { camera, at, height: args.height_m, stream, wording: Wording::Flags };
    let calibrations = Calibrations::from_site(&file.site, file.sha256.clone(), wanted)
        .map_err(CommandError::from_table_error)?;
    calibrations.notes().iter().for_each(|note| files::print_message(format_args!("calib: {note}")));
    Ok(calibrations)
}

/// Table that is converted from one format to another.
struct Table {
    /// Name of the input, for messages.
    name: String,
    source: Box<dyn Source>,
    mapping: Mapping,
    is_verbatim: bool,
}

impl Table {
    fn convert(
        &mut self,
        calibrations: &mut Calibrations,
        to: &Format,
        output: Output<'_>,
        progress: &mut Progress,
    ) -> Result<(), CommandError> {
        let mut output = Some(output);
        let mut sink: Option<Box<dyn Sink + '_>> = None;
        while let Some(batch) = self.source.next() {
            let batch = batch?;
            let mapped = self.map(&batch, calibrations)?;
            if let Some(output) = output.take() {
                sink = Some((to.create)(output, &mapped.schema(), self.output_options())?);
            }
            if let Some(sink) = &mut sink {
                sink.write(&mapped)?;
            }
            progress.step(batch.num_rows());
        }
        if let Some(mut output) = output {
            // An empty table gets a header if the format has one.
            let Some(schema) = self.source.schema() else { return Ok(output.flush()?) };
            let mapped = self.map(&RecordBatch::new_empty(schema), calibrations)?;
            sink = Some((to.create)(output, &mapped.schema(), self.output_options())?);
        }
        sink.map_or(Ok(()), Sink::finish)
    }

    /// Returns the options of the output. Its compression is the same as the input's.
    fn output_options(&self) -> OutputOptions {
        let mut options = self.source.output_options();
        options.is_verbatim = self.is_verbatim;
        options
    }

    fn map(&self, batch: &RecordBatch, calibrations: &mut Calibrations) -> Result<RecordBatch, CommandError> {
        let row_name = |row: usize| self.source.row_name(row);
        let is_incomplete = |row: usize| self.source.is_incomplete(row);
        let rows = Rows { row_name: &row_name, is_incomplete: &is_incomplete };
        self.mapping.map(batch, calibrations, rows).map_err(|error| {
            match CommandError::from_table_error(error) {
                CommandError::Invalid(what) => CommandError::invalid(&self.name, what),
                other => other,
            }
        })
    }
}
