//! Archives of detections as people that cameras saw, for commands that watch.

use arrow_array::RecordBatch;
use calib_health::Sighting;
use calib_table::{
    AtColumn, AtUnit, BadCells, BadRows, ByCamera, Calibrations, Columns, Rows, SightingColumns, Wanted,
    Wording, usual_at_column, usual_camera_column,
};
use clap::builder::{PossibleValue, PossibleValuesParser};

use crate::archive::{FORMATS, Format, Input, Purpose, Source};
use crate::args::size;
use crate::args::{Fit, PixelOrigin};
use crate::files::say;
use crate::progress::Progress;
use crate::site_file::SiteFile;
use crate::stop::Stop;

/// The table of detections that a command reads.
#[derive(Debug, clap::Args)]
pub(crate) struct DetectionArgs {
    /// Table of detections: boxes `x,y,w,h`, or feet `u,v`, each with a camera and a time; - is stdin
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    pub(crate) input: String,
    #[command(flatten)]
    pub(crate) table: TableArgs,
}

/// How a table of detections is read.
#[derive(Debug, clap::Args)]
pub(crate) struct TableArgs {
    /// Format of the input; by default that of its name, or what its first bytes look like
    #[arg(long, value_name = "FORMAT", value_parser = formats())]
    from: Option<String>,
    /// Column that names the camera of every row; by default camera, `camera_id`, cam or `sensor_id`
    #[arg(long, value_name = "NAME")]
    camera_column: Option<String>,
    /// Camera that all rows are of
    #[arg(long, value_name = "ID", conflicts_with = "camera_column")]
    camera: Option<String>,
    /// Column of times (timestamps, or RFC 3339 text; without an offset they count as UTC); by default at, time, timestamp, also with a unit (`at_s`), or `seen_at`
    #[arg(long, value_name = "NAME")]
    at_column: Option<String>,
    /// What numbers of that column count from 1970; by default what its name ends with (_s, _ms, _us, _ns)
    #[arg(long, value_enum, value_name = "UNIT")]
    at_unit: Option<AtUnit>,
    /// Column in which a tracker names people; without it they are told apart by where they are
    #[arg(long, value_name = "NAME")]
    person_column: Option<String>,
    /// Whether rows are feet or boxes
    #[arg(long, value_enum, default_value_t = Columns::Auto)]
    columns: Columns,
    /// Where pixels are counted from
    #[arg(long, value_enum, default_value_t = PixelOrigin::Corner)]
    pixel_origin: PixelOrigin,
    /// Width and height of the stream that the pixels are of, where it is not the still's
    #[arg(long, value_name = "WxH", value_parser = size)]
    stream_size: Option<[u32; 2]>,
    /// How the image was fitted into that stream; needed where their sides are in different proportions
    #[arg(long, value_enum, requires = "stream_size")]
    stream_fit: Option<Fit>,
    /// Rows with a cell that is no number or no time: the run ends, or they are left out
    #[arg(long, value_enum, default_value_t = BadRows::Fail)]
    bad_rows: BadRows,
}

fn formats() -> PossibleValuesParser {
    PossibleValuesParser::new(FORMATS.iter().map(|f| PossibleValue::new(f.name).help(f.about)))
}

/// A table of detections that is read batch by batch.
pub(crate) struct Detections {
    name: String,
    source: Box<dyn Source>,
    /// The first batch, that told the names of the columns.
    first: Option<RecordBatch>,
    pub(crate) calibrations: Calibrations,
    columns: SightingColumns,
    progress: Progress,
}

impl DetectionArgs {
    /// Opens the table for the cameras of a site.
    pub(crate) fn open(&self, file: &SiteFile) -> Result<Detections, Stop> {
        self.table.open(&self.input, file)
    }
}

impl TableArgs {
    /// Opens a table for the cameras of a site.
    pub(crate) fn open(&self, table: &str, file: &SiteFile) -> Result<Detections, Stop> {
        let mut input = Input::open(table)?;
        let format = match (&self.from, Format::of_path(table)) {
            (Some(name), _) => Format::named(name)?,
            (None, Some(format)) => format,
            (None, None) => input.format()?,
        };
        let (bytes, read, name) = (input.bytes, input.counter(), input.name.clone());
        let keeps_broken = self.bad_rows == BadRows::Status;
        let mut source = format.open(input, Purpose { to: format, as_text: &[], keeps_broken })?;
        let progress = Progress::new(source.rows(), bytes, read);
        let first = source.next().transpose()?;
        let calibrations = self.calibrations(file, first.as_ref(), &name)?;
        let bad = BadCells::new(self.bad_rows, Wording::Flags);
        let columns = SightingColumns { columns: self.columns, person: self.person_column.clone(), bad };
        Ok(Detections { name, source, first, calibrations, columns, progress })
    }

    fn calibrations(
        &self,
        file: &SiteFile,
        first: Option<&RecordBatch>,
        name: &str,
    ) -> Result<Calibrations, Stop> {
        let schema = first.map(RecordBatch::schema);
        let usual = |of: fn(&arrow_schema::Schema) -> Option<&'static str>| {
            schema.as_ref().and_then(|schema| of(schema)).map(str::to_owned)
        };
        let column = self.camera_column.clone().or_else(|| usual(usual_camera_column));
        let camera = match (&self.camera, column, &file.site.cameras[..]) {
            (Some(id), ..) => {
                file.has_camera(id)?;
                ByCamera::Only(id.clone())
            }
            (None, Some(column), _) => ByCamera::Column(column),
            (None, None, [only]) => ByCamera::Only(only.id.clone()),
            (None, None, _) if first.is_none() => ByCamera::Column(String::new()),
            (None, None, _) => {
                let what =
                    "no column of cameras; name it with --camera-column, or the one camera with --camera";
                return Err(Stop::invalid(name, what));
            }
        };
        let at = self.at_column.clone().or_else(|| usual(usual_at_column));
        if at.is_none() && first.is_some() {
            return Err(Stop::invalid(name, "no column of times; name it with --at-column"));
        }
        let at = at.unwrap_or_default();
        let at = Some(AtColumn::new(at, self.at_unit, Wording::Flags));
        let (origin, fit) = (self.pixel_origin.into(), self.stream_fit.map(Into::into));
        let stream = calib_core::floor::Stream { origin, size: self.stream_size, fit, crop: None };
        let wanted = Wanted { camera, at, height: 0.0, stream, wording: Wording::Flags };
        let found = Calibrations::of(&file.site, file.sha256.clone(), wanted).map_err(Stop::of_table)?;
        found.notes().iter().for_each(|note| say(format_args!("calib: {note}")));
        Ok(found)
    }
}

impl Detections {
    /// Goes through all rows after the first `skip`; `each` gets the people of a batch, and how many rows of the table
    /// have been read with it.
    pub(crate) fn each(
        &mut self,
        skip: u64,
        mut each: impl FnMut(&[Sighting], u64) -> Result<(), Stop>,
    ) -> Result<(), Stop> {
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
            // What was read before is the begin of this batch.
            let old = (skip + count).saturating_sub(rows).min(count) as usize;
            let batch = batch.slice(old, batch.num_rows() - old);
            let place = |row: usize| self.source.place(row + old);
            let is_broken = |row: usize| self.source.is_broken(row + old);
            let of = Rows { place: &place, is_broken: &is_broken };
            let seen = self.columns.read(&batch, &mut self.calibrations, of);
            let seen = seen.map_err(|error| match Stop::of_table(error) {
                Stop::Invalid(what) => Stop::invalid(&self.name, what),
                stop => stop,
            })?;
            each(&seen, rows)?;
        }
        for note in self.columns.bad.notes().into_iter().chain(self.calibrations.lost()) {
            say(format_args!("calib: {note}"));
        }
        Ok(())
    }

    /// What the cameras are called, every period by itself.
    pub(crate) fn names(&self) -> Vec<String> {
        self.calibrations.cameras().map(|camera| camera.id.to_owned()).collect()
    }
}

/// A time as files have it.
pub(crate) fn instant(at: i64) -> String {
    jiff::Timestamp::from_nanosecond(i128::from(at))
        .and_then(|at| at.round(jiff::Unit::Second))
        .map_or_else(|_| at.to_string(), |at| at.to_string())
}
