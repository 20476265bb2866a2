//! The calibrations of a site, ready to project with, and which of them holds for a row.

use std::collections::{BTreeMap, HashMap};

use arrow_array::{Array as _, RecordBatch, StringArray};
use arrow_schema::Schema;
use calib_core::floor::{Stream, StreamError, StreamMap};
use calib_core::{Camera, Extent, FloorPoint, FloorProjector, Surface};
use calib_site::{Site, SiteCamera};
use serde_json::json;

use crate::cast::texts;
use crate::columns::{AtColumn, BadCells, Place, column, names};
use crate::table_error::TableError;
use crate::wording::Wording;

/// A calibrated camera of a table.
#[derive(Clone, Debug)]
pub struct TableCamera<'a> {
    /// In the site.
    pub id: &'a str,
    /// From when its calibration holds, where that is said.
    pub valid_from: Option<&'a str>,
    /// The camera.
    pub camera: Camera,
    /// Width and height of its still, in pixels.
    pub size: [f64; 2],
}

/// One calibrated camera, for the time that it holds.
#[derive(Debug)]
pub(crate) struct Calibration {
    pub(crate) projector: FloorProjector,
    /// In which detections are made.
    pub(crate) stream: StreamMap,
    size: [f64; 2],
    efov: Vec<FloorPoint>,
    entry: Entry,
}

/// What is said of a calibration.
#[derive(Debug)]
struct Entry {
    camera: String,
    from: Option<String>,
    to: Option<String>,
    /// The same as nanoseconds since 1970.
    period: [i64; 2],
}

/// The calibrations that a table is projected with.
#[derive(Debug)]
pub struct Calibrations {
    pub(crate) list: Vec<Calibration>,
    pub(crate) planes: Planes,
    /// Indices of every camera's.
    of_camera: HashMap<String, Vec<u32>>,
    camera: ByCamera,
    at: Option<AtColumn>,
    /// SHA-256 of the site file.
    sha256: String,
    wording: Wording,
    notes: Vec<String>,
    /// Rows without a calibration, by camera: of so many cameras as one would look through.
    lost: BTreeMap<String, u64>,
    /// Such rows of further cameras.
    lost_more: u64,
}

/// The planes of a site besides the floor, if any of them covers a part of the plan.
#[derive(Debug)]
pub(crate) struct Planes {
    pub(crate) surfaces: Vec<Surface>,
    /// Of each, in the same order.
    pub(crate) ids: Vec<String>,
}

impl Planes {
    fn of(site: &Site) -> Self {
        let surfaces = site.covering_surfaces();
        let ids = site.planes.iter().map(|plane| plane.id.clone()).take(surfaces.len()).collect();
        Self { surfaces, ids }
    }
}

/// Whoever names a column that is none of cameras has an id in every row.
const MOST_LOST: usize = 1000;

/// Whose rows there are.
#[derive(Clone, Debug)]
pub enum ByCamera {
    /// All of one camera.
    Only(String),
    /// Of the camera that this column names.
    Column(String),
}

/// Which calibrations are wanted, and for what.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// Whose rows.
    pub camera: ByCamera,
    /// The column of times, where rows have one.
    pub at: Option<AtColumn>,
    /// Of the plane, in metres.
    pub height: f64,
    /// In which detections are made.
    pub stream: Stream,
    /// For messages.
    pub wording: Wording,
}

/// Which calibration every row has; the number of calibrations is none of them.
pub(crate) enum Choice {
    All(u32),
    Rows(Vec<u32>),
}

impl Calibration {
    fn of(site: &Site, entry: &SiteCamera, wanted: &Wanted) -> Result<Self, TableError> {
        let camera = site.camera_for_use(entry).ok_or_else(|| {
            let why =
                entry.error.as_ref().map_or_else(|| "only its lens is known".into(), ToString::to_string);
            TableError::Unsolved(format!("camera \"{}\" is not calibrated: {why}", entry.id))
        })?;
        let period = entry.period_ns().map_err(|error| TableError::Invalid(error.to_string()))?;
        let stream = map_of(wanted, entry)?;
        let (from, to) = (entry.valid_from.clone(), entry.valid_to.clone());
        Ok(Self {
            projector: FloorProjector::new(&camera, wanted.height),
            stream,
            size: entry.size(),
            efov: site.efov_on_floor(entry),
            entry: Entry { camera: entry.id.clone(), from, to, period },
        })
    }

    pub(crate) fn extent(&self) -> Extent<'_> {
        Extent { size: self.size, efov: &self.efov }
    }
}

impl Calibrations {
    /// The calibrations that are wanted; a camera that is not calibrated among them is told.
    ///
    /// # Errors
    /// When none of them is calibrated, when a time is needed to tell them apart, and when the stream does not go
    /// with a still.
    pub fn of(site: &Site, sha256: String, wanted: Wanted) -> Result<Self, TableError> {
        let mut notes = Vec::new();
        let is_wanted = |entry: &&SiteCamera| match &wanted.camera {
            ByCamera::Only(id) => entry.id == *id,
            ByCamera::Column(_) => true,
        };
        if site.cameras.iter().any(SiteCamera::is_placed) {
            let loose =
                site.cameras.iter().filter(is_wanted).filter(|c| c.camera().is_some() && !c.is_placed());
            for entry in loose {
                notes.push(format!(
                    "camera \"{}\" is not placed: its metres are from its own foot, not of the site",
                    entry.id
                ));
            }
        }
        let (mut list, mut refused) = (Vec::new(), None);
        for entry in site.cameras.iter().filter(is_wanted) {
            match Calibration::of(site, entry, &wanted) {
                Ok(calibration) => list.push(calibration),
                Err(TableError::Unsolved(why)) => {
                    notes.extend(refused.replace(why));
                }
                Err(stop) => return Err(stop),
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
                "camera \"{id}\": several periods have this id; choose one with {at} TIME, or name the column of times with {column} NAME"
            );
            return Err(TableError::Usage(what));
        }
        let Wanted { camera, at, wording, .. } = wanted;
        let (lost, planes) = (BTreeMap::new(), Planes::of(site));
        Ok(Self { list, planes, of_camera, camera, at, sha256, wording, notes, lost, lost_more: 0 })
    }

    /// What the output says of them, beside what the input said.
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

    /// Which calibration every row of a batch has.
    pub(crate) fn choose(
        &mut self,
        batch: &RecordBatch,
        place: Place<'_>,
        bad: &BadCells,
    ) -> Result<Choice, TableError> {
        let times = self.times(batch, place, bad)?;
        self.choose_at(batch, times.as_deref())
    }

    /// The times of all rows, where there is a column of them.
    pub(crate) fn times(
        &self,
        batch: &RecordBatch,
        place: Place<'_>,
        bad: &BadCells,
    ) -> Result<Option<Vec<Option<i64>>>, TableError> {
        self.at.as_ref().map(|at| at.times(batch, place, bad)).transpose()
    }

    /// Which calibration every row of a batch has, whose rows are of these times.
    pub(crate) fn choose_at(
        &mut self,
        batch: &RecordBatch,
        times: Option<&[Option<i64>]>,
    ) -> Result<Choice, TableError> {
        if let (ByCamera::Only(_), None) = (&self.camera, &times) {
            return Ok(Choice::All(0));
        }
        let ids = match &self.camera {
            ByCamera::Only(_) => None,
            ByCamera::Column(name) => Some(ids(batch, name, self.wording)?),
        };
        let only = match &self.camera {
            ByCamera::Only(id) => id.clone(),
            ByCamera::Column(_) => String::new(),
        };
        let none = self.list.len() as u32;
        let mut rows = Vec::with_capacity(batch.num_rows());
        // Rows of a camera often follow each other.
        let mut last: Option<(&str, &[u32])> = None;
        for row in 0..batch.num_rows() {
            let id = match &ids {
                Some(ids) if ids.is_null(row) => "",
                Some(ids) => ids.value(row),
                None => &only,
            };
            let periods = match last {
                Some((before, periods)) if before == id => periods,
                _ => self.of_camera.get(id).map_or(&[][..], Vec::as_slice),
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
                if let Some(count) = self.lost.get_mut(id) {
                    *count += 1;
                } else if self.lost.len() < MOST_LOST {
                    self.lost.insert(id.to_owned(), 1);
                } else {
                    self.lost_more += 1;
                }
            }
            rows.push(found.copied().unwrap_or(none));
        }
        Ok(Choice::Rows(rows))
    }

    /// The calibrated cameras, every period by itself, in the order of their indices.
    pub fn cameras(&self) -> impl Iterator<Item = TableCamera<'_>> {
        self.list.iter().map(|calibration| TableCamera {
            id: &calibration.entry.camera,
            valid_from: calibration.entry.from.as_deref(),
            camera: *calibration.projector.camera(),
            size: calibration.size,
        })
    }

    /// The corners of what each of them covers of the floor, in metres.
    pub fn efovs(&self) -> impl Iterator<Item = &[FloorPoint]> {
        self.list.iter().map(|calibration| calibration.efov.as_slice())
    }

    /// What is to be said of the cameras, before rows are mapped.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// What is to be said of the rows that had no calibration.
    #[must_use]
    pub fn lost(&self) -> Vec<String> {
        const MOST: usize = 5;
        let mut notes = Vec::new();
        for (id, count) in self.lost.iter().take(MOST) {
            let why = if self.of_camera.contains_key(id) {
                "are at times at which no calibration holds"
            } else {
                "are of a camera that has no calibration"
            };
            notes.push(format!("{count} rows of camera \"{id}\" {why}: status no-calibration"));
        }
        let more = self.lost_more + self.lost.values().skip(MOST).sum::<u64>();
        if more > 0 {
            notes.push(format!("and {more} rows of other cameras; is that the column of cameras?"));
        }
        notes
    }
}

/// Where the pixels of the stream lie in the still of a camera.
fn map_of(wanted: &Wanted, entry: &SiteCamera) -> Result<StreamMap, TableError> {
    wanted.stream.map(entry.size()).map_err(|why| {
        let (id, said) = (&entry.id, wanted.wording.name("stream-size"));
        TableError::Usage(match (why, wanted.wording) {
            (StreamError::Proportion { size: [w, h], shown: [sw, sh] }, Wording::Flags) => format!(
                "{said} {w}x{h}: the sides of camera \"{id}\", {sw} x {sh} pixels, are in another proportion; say \
                 how the image was fitted, with --stream-fit stretch or --stream-fit letterbox"
            ),
            (why, _) => format!("{said}: camera \"{id}\": {why}"),
        })
    })
}

/// The ids in a column: text, numbers, or a dictionary of either.
fn ids(batch: &RecordBatch, name: &str, wording: Wording) -> Result<StringArray, TableError> {
    let asked = wording.with("camera-column", name);
    let found = column(batch, name).ok_or_else(|| {
        TableError::Invalid(format!("{asked}: the table has the columns \"{}\"", names(batch)))
    })?;
    texts(&found)
        .map_err(|error| TableError::Invalid(format!("{asked}: expected ids as text or numbers: {error}")))
}
