//! Calibrations of a site, prepared for mapping, and the selection of the valid calibration of each row.

use std::collections::{BTreeMap, HashMap};

use arrow_array::{Array as _, RecordBatch, StringArray};
use arrow_schema::Schema;
use calib_core::floor::{Stream, StreamError, StreamMap, TangentPlane};
use calib_core::{Camera, Extent, FloorPoint, FloorProjector, Surface};
use calib_site::{GeoreferenceSolution, Site, SiteCamera};
use serde_json::json;

use crate::cast::texts;
use crate::columns::{AtColumn, BadCells, RowName, column, names};
use crate::table_error::TableError;
use crate::wording::Wording;

/// Calibrated camera of a table.
#[derive(Clone, Debug)]
pub struct TableCamera<'a> {
    /// Id of the camera in the site.
    pub id: &'a str,
    /// Start of validity of its calibration, if limited.
    pub valid_from: Option<&'a str>,
    /// Camera parameters.
    pub camera: Camera,
    /// Width and height of its image, in pixels.
    pub size: [f64; 2],
}

/// Calibrated camera for one period of validity.
#[derive(Debug)]
pub(crate) struct Calibration {
    pub(crate) projector: FloorProjector,
    /// Mapping between the stream of the detections and the image.
    pub(crate) stream: StreamMap,
    /// Width and height of the stream, in its pixels.
    pub(crate) stream_size: [f64; 2],
    size: [f64; 2],
    efov: Vec<FloorPoint>,
    entry: CalibrationPeriod,
}

/// Camera id and period of validity of a calibration.
#[derive(Debug)]
struct CalibrationPeriod {
    camera: String,
    from: Option<String>,
    to: Option<String>,
    /// Start and end of the period of validity, in nanoseconds since 1970.
    period: [i64; 2],
}

/// Calibrations for mapping a table.
#[derive(Debug)]
pub struct Calibrations {
    pub(crate) list: Vec<Calibration>,
    pub(crate) planes: Planes,
    /// Map from the site to geographic coordinates, if the site has a georeference.
    pub(crate) tangent_plane: Option<TangentPlane>,
    /// Estimated georeference of the site, with its errors; `None` if it is entered.
    pub(crate) georeference: Option<GeoreferenceSolution>,
    /// Indices of the calibrations, by camera id.
    by_camera: HashMap<String, Vec<u32>>,
    camera: CameraSource,
    at: Option<AtColumn>,
    /// SHA-256 of the site file.
    sha256: String,
    wording: Wording,
    /// Whether the size of the stream is given.
    has_stream_size: bool,
    notes: Vec<String>,
    /// Number of rows without a calibration, by camera id; limited to [`MAX_UNCALIBRATED_IDS`] ids.
    uncalibrated: BTreeMap<String, u64>,
    /// Number of rows without a calibration whose camera id is not in `uncalibrated`.
    uncalibrated_others: u64,
}

/// Planes of a site other than the floor, if any of them covers a part of the plan.
#[derive(Debug)]
pub(crate) struct Planes {
    pub(crate) surfaces: Vec<Surface>,
    /// Ids of the planes, in the order of `surfaces`.
    pub(crate) ids: Vec<String>,
}

impl Planes {
    fn from_site(site: &Site) -> Self {
        let surfaces = site.covering_surfaces();
        let ids = site.planes.iter().map(|plane| plane.id.clone()).take(surfaces.len()).collect();
        Self { surfaces, ids }
    }
}

/// Maximum number of ids without a calibration that are counted separately. A wrongly chosen column may have
/// another id in every row.
const MAX_UNCALIBRATED_IDS: usize = 1000;

/// Source of the camera ids of the rows.
#[derive(Clone, Debug)]
pub enum CameraSource {
    /// One camera for all rows.
    Only(String),
    /// Column with the camera's id.
    Column(String),
}

/// Selection of the calibrations for a table, and of the pixels that they map.
#[derive(Clone, Debug)]
pub struct CalibrationRequest {
    /// Source of the camera of each row.
    pub camera: CameraSource,
    /// Column of times, if rows have one.
    pub at: Option<AtColumn>,
    /// Height of the plane above the floor, in metres.
    pub height: f64,
    /// Stream of the detections.
    pub stream: Stream,
    /// Style of option names in messages.
    pub wording: Wording,
}

/// Indices of the calibrations of the rows: one index for all rows, or one for each row. A row without a
/// calibration has the number of calibrations as its index.
pub(crate) enum Choice {
    All(u32),
    Rows(Vec<u32>),
}

impl Calibration {
    fn new(site: &Site, entry: &SiteCamera, wanted: &CalibrationRequest) -> Result<Self, TableError> {
        let camera = site.camera_for_use(entry).ok_or_else(|| {
            let why =
                entry.error.as_ref().map_or_else(|| "only its lens is known".into(), ToString::to_string);
            TableError::Unsolved(format!("camera \"{}\" is not calibrated: {why}", entry.id))
        })?;
        let period = entry.period_ns().map_err(|error| TableError::Invalid(error.to_string()))?;
        let stream = stream_map(wanted, entry)?;
        let (from, to) = (entry.valid_from.clone(), entry.valid_to.clone());
        Ok(Self {
            projector: FloorProjector::new(&camera, wanted.height),
            stream,
            stream_size: match (wanted.stream.size, wanted.stream.crop) {
                (Some(size), _) => size.map(f64::from),
                (None, Some([_, _, width, height])) => [width, height],
                (None, None) => entry.size(),
            },
            size: entry.size(),
            efov: site.efov_on_floor(entry),
            entry: CalibrationPeriod { camera: entry.id.clone(), from, to, period },
        })
    }

    pub(crate) fn extent(&self) -> Extent<'_> {
        Extent { size: self.size, efov: &self.efov }
    }
}

impl Calibrations {
    /// Collects the requested calibrations. Cameras that are not calibrated are reported in [`Self::notes`].
    ///
    /// # Errors
    ///
    /// Fails if no requested camera is calibrated, or if the stream does not match an image. Also fails if a
    /// camera has several periods but the rows have no time.
    pub fn from_site(site: &Site, sha256: String, wanted: CalibrationRequest) -> Result<Self, TableError> {
        let is_wanted = |entry: &&SiteCamera| match &wanted.camera {
            CameraSource::Only(id) => entry.id == *id,
            CameraSource::Column(_) => true,
        };
        let mut notes = position_notes(site, is_wanted);
        let (mut list, mut refused) = (Vec::new(), None);
        for entry in site.cameras.iter().filter(is_wanted) {
            match Calibration::new(site, entry, &wanted) {
                Ok(calibration) => list.push(calibration),
                Err(TableError::Unsolved(why)) => {
                    notes.extend(refused.replace(why));
                }
                Err(error) => return Err(error),
            }
        }
        if let Some(why) = refused {
            if list.is_empty() {
                return Err(TableError::Unsolved(why));
            }
            notes.push(why);
        }
        let mut of_camera: HashMap<String, Vec<u32>> = HashMap::new();
        for (index, calibration) in (0..).zip(&list) {
            of_camera.entry(calibration.entry.camera.clone()).or_default().push(index);
        }
        if wanted.at.is_none()
            && let Some((id, _)) = of_camera.iter().find(|(_, periods)| periods.len() > 1)
        {
            let [at, column] = ["at", "at-column"].map(|option| wanted.wording.name(option));
            let what = format!(
                "camera \"{id}\": several periods have this id; choose one with {at} TIME, or name the \
                 time column with {column} NAME"
            );
            return Err(TableError::Usage(what));
        }
        let CalibrationRequest { camera, at, wording, stream, .. } = wanted;
        let (lost, planes) = (BTreeMap::new(), Planes::from_site(site));
        Ok(Self {
            list,
            planes,
            tangent_plane: site.tangent_plane(),
            georeference: site.estimated_georeference(),
            by_camera: of_camera,
            camera,
            at,
            sha256,
            wording,
            has_stream_size: stream.size.is_some(),
            notes,
            uncalibrated: lost,
            uncalibrated_others: 0,
        })
    }

    /// Whether the size of the stream is given.
    pub(crate) const fn has_stream_size(&self) -> bool {
        self.has_stream_size
    }

    /// Returns the largest width and height of all streams, in their pixels.
    pub(crate) fn largest_stream(&self) -> [f64; 2] {
        self.list.iter().fold([0.0; 2], |[w, h]: [f64; 2], calibration| {
            [w.max(calibration.stream_size[0]), h.max(calibration.stream_size[1])]
        })
    }

    /// Returns the metadata of the output table: the metadata of the input, and a description of the
    /// calibrations.
    pub(crate) fn describe(&self, schema: &Schema) -> HashMap<String, String> {
        let mut about = schema.metadata().clone();
        let mut put = |key: &str, value: String| about.insert(format!("calib.{key}"), value);
        put("version", env!("CARGO_PKG_VERSION").into());
        put("site_sha256", self.sha256.clone());
        let list: Vec<_> = self.list.iter().map(|calibration| &calibration.entry).collect();
        if let [only] = list[..] {
            put("camera", only.camera.clone());
            put("valid_from", only.from.clone().unwrap_or_default());
            put("valid_to", only.to.clone().unwrap_or_default());
        }
        let list = list.into_iter();
        let list = list.map(|e| json!({"camera": e.camera, "valid_from": e.from, "valid_to": e.to}));
        put("calibrations", serde_json::Value::from_iter(list).to_string());
        about
    }

    /// Selects the calibration of every row of a batch.
    pub(crate) fn choose(
        &mut self,
        batch: &RecordBatch,
        row_name: RowName<'_>,
        bad: &BadCells,
    ) -> Result<Choice, TableError> {
        let times = self.times(batch, row_name, bad)?;
        self.choose_at(batch, times.as_deref())
    }

    /// Reads the times of all rows, if there is a column of times.
    pub(crate) fn times(
        &self,
        batch: &RecordBatch,
        row_name: RowName<'_>,
        bad: &BadCells,
    ) -> Result<Option<Vec<Option<i64>>>, TableError> {
        self.at.as_ref().map(|at| at.times(batch, row_name, bad)).transpose()
    }

    /// Selects the calibration of every row of a batch, given the times of the rows.
    pub(crate) fn choose_at(
        &mut self,
        batch: &RecordBatch,
        times: Option<&[Option<i64>]>,
    ) -> Result<Choice, TableError> {
        if let (CameraSource::Only(_), None) = (&self.camera, &times) {
            return Ok(Choice::All(0));
        }
        let ids = match &self.camera {
            CameraSource::Only(_) => None,
            CameraSource::Column(name) => Some(ids(batch, name, self.wording)?),
        };
        let only = match &self.camera {
            CameraSource::Only(id) => id.clone(),
            CameraSource::Column(_) => String::new(),
        };
        let none = self.list.len() as u32;
        let mut rows = Vec::with_capacity(batch.num_rows());
        // Consecutive rows often belong to the same camera.
        let mut last: Option<(&str, &[u32])> = None;
        for row in 0..batch.num_rows() {
            let id = match &ids {
                Some(ids) if ids.is_null(row) => "",
                Some(ids) => ids.value(row),
                None => &only,
            };
            let periods = match last {
                Some((before, periods)) if before == id => periods,
                _ => self.by_camera.get(id).map_or(&[][..], Vec::as_slice),
            };
            last = Some((id, periods));
            let found = match &times {
                None => periods.first(),
                Some(times) => periods.iter().find(|&&index| {
                    let [from, to] = self.list[index as usize].entry.period;
                    times[row].is_some_and(|time| from <= time && time < to)
                }),
            };
            if found.is_none() {
                if let Some(count) = self.uncalibrated.get_mut(id) {
                    *count += 1;
                } else if self.uncalibrated.len() < MAX_UNCALIBRATED_IDS {
                    self.uncalibrated.insert(id.to_owned(), 1);
                } else {
                    self.uncalibrated_others += 1;
                }
            }
            rows.push(found.copied().unwrap_or(none));
        }
        Ok(Choice::Rows(rows))
    }

    /// Returns the calibrated cameras in the order of their indices, each period separately.
    pub fn cameras(&self) -> impl Iterator<Item = TableCamera<'_>> {
        self.list.iter().map(|calibration| TableCamera {
            id: &calibration.entry.camera,
            valid_from: calibration.entry.from.as_deref(),
            camera: *calibration.projector.camera(),
            size: calibration.size,
        })
    }

    /// Returns the corners of each camera's EFOV on the floor, in metres.
    pub fn efovs(&self) -> impl Iterator<Item = &[FloorPoint]> {
        self.list.iter().map(|calibration| calibration.efov.as_slice())
    }

    /// Returns messages about the requested cameras, for the operator. They do not depend on the rows.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns messages about the rows without a calibration.
    #[must_use]
    pub fn uncalibrated_notes(&self) -> Vec<String> {
        const MAX_IDS: usize = 5;
        let mut notes = Vec::new();
        for (id, count) in self.uncalibrated.iter().take(MAX_IDS) {
            let why = match (self.by_camera.contains_key(id), *count) {
                (true, 1) => "has no calibration that is valid at its time",
                (true, _) => "have no calibration that is valid at their times",
                (false, 1) => "has no calibration",
                (false, _) => "have no calibration",
            };
            notes.push(format!("{} of camera \"{id}\" {why}: status no-calibration", rows_text(*count)));
        }
        let more = self.uncalibrated_others + self.uncalibrated.values().skip(MAX_IDS).sum::<u64>();
        if more > 0 {
            let has = if more == 1 { "has" } else { "have" };
            notes.push(format!(
                "{} of other cameras {has} no calibration; check the name of the camera column",
                rows_text(more)
            ));
        }
        notes
    }
}

/// Formats a number of rows: "1 row", "2 rows".
fn rows_text(count: u64) -> String {
    calib_site::counted(usize::try_from(count).unwrap_or(usize::MAX), "row", "rows")
}

/// Returns notes about cameras whose coordinates have another origin or another scale than the site.
fn position_notes(site: &Site, is_wanted: impl Fn(&&SiteCamera) -> bool) -> Vec<String> {
    let has_places = site.cameras.iter().any(SiteCamera::is_placed);
    let mut notes = Vec::new();
    for entry in site.cameras.iter().filter(is_wanted) {
        if has_places && entry.camera().is_some() && !entry.is_placed() {
            let id = &entry.id;
            notes.push(format!(
                "camera \"{id}\" is not placed: its coordinates are relative to the floor point below it, not to the site"
            ));
        }
        notes.extend(site.scale_note(entry));
    }
    notes
}

/// Returns the mapping between the stream and the image of a camera.
fn stream_map(wanted: &CalibrationRequest, entry: &SiteCamera) -> Result<StreamMap, TableError> {
    wanted.stream.map(entry.size()).map_err(|why| {
        let (id, option) = (&entry.id, wanted.wording.name("stream-size"));
        TableError::Usage(match (why, wanted.wording) {
            (StreamError::Proportion { size: [w, h], shown: [sw, sh] }, Wording::Flags) => format!(
                "{option} {w}x{h}: camera \"{id}\" has another aspect ratio ({sw} x {sh} pixels); choose \
                 --stream-fit stretch or --stream-fit letterbox"
            ),
            (why, _) => format!("{option}: camera \"{id}\": {why}"),
        })
    })
}

/// Reads a column of ids: text, numbers, or a dictionary of either.
fn ids(batch: &RecordBatch, name: &str, wording: Wording) -> Result<StringArray, TableError> {
    let option = wording.with("camera-column", name);
    let found = column(batch, name).ok_or_else(|| {
        let columns = names(batch);
        TableError::Invalid(format!("{option}: no such column; the table has the columns \"{columns}\""))
    })?;
    texts(&found)
        .map_err(|error| TableError::Invalid(format!("{option}: expected ids as text or numbers: {error}")))
}
