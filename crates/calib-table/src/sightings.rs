//! Rows of a table as people that cameras saw.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use calib_core::Pixel;
use calib_core::floor::BoxForm;
use calib_health::Sighting;

use crate::calibrations::{Calibrations, Choice};
use crate::cast::texts;
use crate::columns::{BadCells, Place, column, names, numbers};
use crate::mapping::{Columns, Rows};
use crate::table_error::TableError;

/// Names that columns of cameras usually have, and those of times.
const CAMERAS: [&str; 4] = ["camera", "camera_id", "cam", "sensor_id"];
const TIMES: [&str; 11] = [
    "at",
    "at_s",
    "at_ms",
    "at_us",
    "at_ns",
    "time",
    "time_s",
    "time_ms",
    "timestamp",
    "timestamp_ms",
    "seen_at",
];

/// The column of a table that names cameras, if it has a usual name.
#[must_use]
pub fn usual_camera_column(schema: &Schema) -> Option<&'static str> {
    CAMERAS.into_iter().find(|name| schema.column_with_name(name).is_some())
}

/// The column of times of a table, if it has a usual name.
#[must_use]
pub fn usual_at_column(schema: &Schema) -> Option<&'static str> {
    TIMES.into_iter().find(|name| schema.column_with_name(name).is_some())
}

/// How rows are read as people.
#[derive(Debug)]
pub struct SightingColumns {
    /// Whether rows are feet or boxes.
    pub columns: Columns,
    /// The column that a tracker names people in.
    pub person: Option<String>,
    /// What becomes of cells that are no numbers and no times.
    pub bad: BadCells,
}

impl SightingColumns {
    /// The people of a batch, of cameras by the index of their calibration ([`Calibrations::cameras`]); rows without a
    /// calibration, a time or a number are left out.
    ///
    /// # Errors
    /// When a column is absent, or has a cell that cannot be read.
    pub fn read(
        &self,
        batch: &RecordBatch,
        calibrations: &mut Calibrations,
        rows: Rows<'_>,
    ) -> Result<Vec<Sighting>, TableError> {
        let times = calibrations.times(batch, rows.place, &self.bad)?;
        let Some(times) = times else {
            let what = "no column of times: name it with --at-column".into();
            return Err(TableError::Usage(what));
        };
        let choice = calibrations.choose_at(batch, Some(&times))?;
        let boxes = self.boxes(batch, rows.place)?;
        let people = self.people(batch)?;
        let mut seen = Vec::with_capacity(batch.num_rows());
        for row in 0..batch.num_rows() {
            let index = match &choice {
                Choice::All(index) => *index,
                Choice::Rows(chosen) => chosen[row],
            };
            let Some(calibration) = calibrations.list.get(index as usize) else { continue };
            let (Some(at), false) = (times[row], (rows.is_broken)(row)) else { continue };
            let in_still = |[u, v]: [f64; 2]| {
                Pixel::new(calibration.stream.in_still(0, u), calibration.stream.in_still(1, v))
            };
            let Seen { foot, head, width } = boxes.at(row);
            let [foot, head] = [foot, head].map(in_still);
            if foot.is_finite() {
                let width = (width * calibration.stream.still_pixels()).max(0.0);
                let head = head.is_finite().then_some(head);
                seen.push(Sighting { at, camera: index as usize, foot, head, width, person: people[row] });
            }
        }
        Ok(seen)
    }

    fn boxes(&self, batch: &RecordBatch, place: Place<'_>) -> Result<Boxes, TableError> {
        let schema = batch.schema();
        let has = |name: &str| schema.column_with_name(name).is_some();
        let are_boxes = match self.columns {
            Columns::Auto => ["x", "y", "w", "h"].into_iter().all(has) || !(has("u") && has("v")),
            columns => columns == Columns::Boxes,
        };
        let expected = if self.columns == Columns::Auto { "x,y,w,h or u,v" } else { "x,y,w,h" };
        Ok(if are_boxes {
            Boxes::Whole(numbers(batch, ["x", "y", "w", "h"], expected, place, &self.bad)?)
        } else {
            Boxes::Feet(numbers(batch, ["u", "v"], "u,v", place, &self.bad)?)
        })
    }

    /// Numbers of people, row by row.
    fn people(&self, batch: &RecordBatch) -> Result<Vec<Option<u64>>, TableError> {
        let Some(name) = &self.person else { return Ok(vec![None; batch.num_rows()]) };
        let found = column(batch, name).ok_or_else(|| {
            let what = format!("--person-column {name}: the table has the columns \"{}\"", names(batch));
            TableError::Invalid(what)
        })?;
        let texts = texts(&found)?;
        // FNV-1a, for what is remembered has to mean the same person in any build: Fowler, Noll, Vo 1991.
        let number = |text: &str| {
            let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3);
            text.bytes().fold(0xCBF2_9CE4_8422_2325, step)
        };
        Ok(texts.iter().map(|text| text.map(number)).collect())
    }
}

/// Boxes of a batch, or feet.
enum Boxes {
    Whole([Vec<f64>; 4]),
    Feet([Vec<f64>; 2]),
}

/// One of them; NaN for what is not known.
struct Seen {
    foot: [f64; 2],
    head: [f64; 2],
    width: f64,
}

impl Boxes {
    fn at(&self, row: usize) -> Seen {
        match self {
            Self::Whole([x, y, w, h]) => {
                let foot = BoxForm::CornerSize.foot([x[row], y[row], w[row], h[row]]);
                Seen { foot, head: [foot[0], y[row]], width: w[row] }
            }
            Self::Feet([u, v]) => Seen { foot: [u[row], v[row]], head: [f64::NAN; 2], width: 0.0 },
        }
    }
}
