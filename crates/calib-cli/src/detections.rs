//! Tables of detections, read as sightings of people, for `calib watch` and `calib walk`.

use arrow_array::RecordBatch;
use calib_health::Sighting;
use calib_table::{
    AtColumn, AtUnit, BadCells, BadRows, Boxes, CalibrationRequest, Calibrations, CameraSource, Columns,
    Rows, SightingColumns, TableBoxForm, Wording, usual_at_column, usual_camera_column,
};
use clap::builder::{PossibleValue, PossibleValuesParser};

use crate::archive::{FORMATS, Format, Input, ReadOptions, Source};
use crate::args::size;
use crate::args::{Fit, PixelOrigin};
use crate::files::print_message;
use crate::progress::Progress;
use crate::site_file::SiteFile;
use crate::stop::CommandError;

/// Arguments for the table of detections.
#[derive(Debug, clap::Args)]
pub(crate) struct DetectionArgs {
    /// Table of detections: boxes (`x,y,w,h`, `x1,y1,x2,y2`), or feet `u,v`, each with a camera and a time; - is
    /// stdin
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    pub(crate) input: String,
    #[command(flatten)]
    pub(crate) table: TableArgs,
}

/// Arguments for reading a table of detections.
#[derive(Debug, clap::Args)]
pub(crate) struct TableArgs {
    /// Format of the input; by default taken from its name or its first bytes
    #[arg(long, value_name = "FORMAT", value_parser = formats())]
    from: Option<String>,
    /// Column with the camera of every row; by default camera, `camera_id`, cam or `sensor_id`
    #[arg(long, value_name = "NAME")]
    camera_column: Option<String>,
    /// Camera of all rows
    #[arg(long, value_name = "ID", conflicts_with = "camera_column")]
    camera: Option<String>,
    /// Column of times (timestamps, or RFC 3339 text; UTC if no offset is given); by default at, time or
    /// timestamp, also with a unit (such as `at_s`), or `seen_at`
    #[arg(long, value_name = "NAME")]
    at_column: Option<String>,
    /// Unit of numeric times, counted from 1970; by default taken from the end of the column's name (_s, _ms,
    /// _us, _ns)
    #[arg(long, value_enum, value_name = "UNIT")]
    at_unit: Option<AtUnit>,
    /// Column with the person ids of a tracker; by default people are distinguished by their positions
    #[arg(long, value_name = "NAME")]
    person_column: Option<String>,
    /// Whether rows are feet or boxes
    #[arg(long, value_enum, default_value_t = Columns::Auto)]
    columns: Columns,
    /// Meaning of the four numbers of a box; by default taken from the names of the columns
    #[arg(long, value_enum, value_name = "FORM")]
    box_form: Option<TableBoxForm>,
    /// Origin of pixel coordinates
    #[arg(long, value_enum, default_value_t = PixelOrigin::Corner)]
    pixel_origin: PixelOrigin,
    /// Width and height of the stream that the pixels belong to, if it differs from the image
    #[arg(long, value_name = "WxH", value_parser = size)]
    stream_size: Option<[u32; 2]>,
    /// Scaling of the image to the stream of --stream-size; required if the aspect ratios differ
    #[arg(long, value_enum, requires = "stream_size")]
    stream_fit: Option<Fit>,
    /// Handling of rows with a cell that is not a number or not a time: stop the run, or leave the rows out
    #[arg(long, value_enum, default_value_t = BadRows::Fail)]
    bad_rows: BadRows,
}

fn formats() -> PossibleValuesParser {
    PossibleValuesParser::new(FORMATS.iter().map(|f| PossibleValue::new(f.name).help(f.about)))
}

/// Table of detections, read in batches.
pub(crate) struct Detections {
    name: String,
    source: Box<dyn Source>,
    /// First batch, which was read to find the column names.
    first: Option<RecordBatch>,
    pub(crate) calibrations: Calibrations,
    columns: SightingColumns,
    progress: Progress,
}

impl DetectionArgs {
    /// Opens the table for the cameras of a site.
    pub(crate) fn open(&self, file: &SiteFile) -> Result<Detections, CommandError> {
        self.table.open(&self.input, file)
    }
}

impl TableArgs {
    /// Opens a table for the cameras of a site.
    pub(crate) fn open(&self, table: &str, file: &SiteFile) -> Result<Detections, CommandError> {
        let mut input = Input::open(table)?;
        let format = match (&self.from, Format::from_path(table)) {
            (Some(name), _) => Format::from_name(name)?,
            (None, Some(format)) => format,
            (None, None) => input.format()?,
        };
        let (bytes, read, name) = (input.bytes, input.counter(), input.name.clone());
        let keeps_incomplete = self.bad_rows == BadRows::Status;
        let mut source = format.open(input, ReadOptions { to: format, as_text: &[], keeps_incomplete })?;
        let progress = Progress::new(source.rows(), bytes, read);
        let first = source.next().transpose()?;
        let calibrations = self.calibrations(file, first.as_ref(), &name)?;
        let bad = BadCells::new(self.bad_rows, Wording::Flags);
        let columns = SightingColumns {
            columns: self.columns,
            boxes: Boxes::new(self.box_form),
            person: self.person_column.clone(),
            bad,
        };
        Ok(Detections { name, source, first, calibrations, columns, progress })
    }

    fn calibrations(
        &self,
        file: &SiteFile,
        first: Option<&RecordBatch>,
        name: &str,
    ) -> Result<Calibrations, CommandError> {
        let schema = first.map(RecordBatch::schema);
        let usual = |of: fn(&arrow_schema::Schema) -> Option<&'static str>| {
            schema.as_ref().and_then(|schema| of(schema)).map(str::to_owned)
        };
        let column = self.camera_column.clone().or_else(|| usual(usual_camera_column));
        let camera = match (&self.camera, column, &file.site.cameras[..]) {
            (Some(id), ..) => {
                file.has_camera(id)?;
                CameraSource::Only(id.clone())
            }
            (None, Some(column), _) => CameraSource::Column(column),
            (None, None, [only]) => CameraSource::Only(only.id.clone()),
            (None, None, _) if first.is_none() => CameraSource::Column(String::new()),
            (None, None, _) => {
                let what = "the camera column is unknown; give its name with --camera-column, or choose one camera with --camera";
                return Err(CommandError::invalid(name, what));
            }
        };
        let at = self.at_column.clone().or_else(|| usual(usual_at_column));
        if at.is_none() && first.is_some() {
            return Err(CommandError::invalid(
                name,
                "the time column is unknown; give its name with --at-column",
            ));
        }
        let at = at.unwrap_or_default();
        let at = Some(AtColumn::new(at, self.at_unit, Wording::Flags));
        let (origin, fit) = (self.pixel_origin.into(), self.stream_fit.map(Into::into));
        let stream = calib_core::floor::Stream { origin, size: self.stream_size, fit, crop: None };
        let wanted = CalibrationRequest { camera, at, height: 0.0, stream, wording: Wording::Flags };
        let found = Calibrations::from_site(&file.site, file.sha256.clone(), wanted)
            .map_err(CommandError::from_table_error)?;
        found.notes().iter().for_each(|note| print_message(format_args!("calib: {note}")));
        Ok(found)
    }
}

impl Detections {
    /// Reads all rows after the first `skip`. `each` receives the sightings of a batch and the number of rows
    /// read so far.
    pub(crate) fn each(
        &mut self,
        skip: u64,
        mut each: impl FnMut(&[Sighting], u64) -> Result<(), CommandError>,
    ) -> Result<(), CommandError> {
        let mut rows = 0;
        let mut first = self.first.take();
        while let Some(batch) = first.take().map(Ok).or_else(|| self.source.next()) {
            let batch = batch?;
            let count = batch.num_rows() as u64;
            rows += count;
            self.progress.step(batch.num_rows());
            if rows <= skip {
                continue;
            }
            // Number of rows at the start of this batch that an earlier run already processed.
            let old = (skip + count).saturating_sub(rows).min(count) as usize;
            let batch = batch.slice(old, batch.num_rows() - old);
            let row_name = |row: usize| self.source.row_name(row + old);
            let is_incomplete = |row: usize| self.source.is_incomplete(row + old);
            let source_rows = Rows { row_name: &row_name, is_incomplete: &is_incomplete };
            let sightings = self.columns.read(&batch, &mut self.calibrations, source_rows);
            let sightings = sightings.map_err(|error| match CommandError::from_table_error(error) {
                CommandError::Invalid(what) => CommandError::invalid(&self.name, what),
                other => other,
            })?;
            each(&sightings, rows)?;
        }
        for note in self.columns.boxes.notes() {
            print_message(format_args!("calib: {note}"));
        }
        for note in self.columns.bad.notes().into_iter().chain(self.calibrations.uncalibrated_notes()) {
            print_message(format_args!("calib: {note}"));
        }
        Ok(())
    }

    /// Returns the camera id of each period; an id repeats if its camera has several periods.
    pub(crate) fn names(&self) -> Vec<String> {
        self.calibrations.cameras().map(|camera| camera.id.to_owned()).collect()
    }
}

/// Formats a time as RFC 3339, rounded to seconds.
pub(crate) fn instant(at: i64) -> String {
    jiff::Timestamp::from_nanosecond(i128::from(at))
        .and_then(|at| at.round(jiff::Unit::Second))
        .map_or_else(|_| at.to_string(), |at| at.to_string())
}
