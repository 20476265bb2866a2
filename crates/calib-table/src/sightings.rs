//! Rows of a table as sightings of people.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use calib_core::Pixel;
use calib_core::floor::BoxForm;
use calib_health::Sighting;

use crate::boxes::{BOXES, BoxValues, Boxes, FEET_OR_BOXES};
use crate::calibrations::{Calibrations, Choice};
use crate::cast::texts;
use crate::columns::{BadCells, RowName, column, names, numbers};
use crate::mapping::{Columns, Rows};
use crate::table_error::TableError;

/// Usual names of a column with the camera, in order of preference.
const CAMERA_COLUMN_NAMES: [&str; 4] = ["camera", "camera_id", "cam", "sensor_id"];
/// Usual names of a column with the time, in order of preference.
const TIME_COLUMN_NAMES: [&str; 11] = [
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

/// Returns the camera column of a table, if it has a usual name.
#[must_use]
pub fn usual_camera_column(schema: &Schema) -> Option<&'static str> {
    CAMERA_COLUMN_NAMES.into_iter().find(|name| schema.column_with_name(name).is_some())
}

/// Returns the time column of a table, if it has a usual name.
#[must_use]
pub fn usual_at_column(schema: &Schema) -> Option<&'static str> {
    TIME_COLUMN_NAMES.into_iter().find(|name| schema.column_with_name(name).is_some())
}

/// Options for reading rows as sightings.
#[derive(Debug)]
pub struct SightingColumns {
    /// Whether rows are feet or boxes.
    pub columns: Columns,
    /// Reader of boxes.
    pub boxes: Boxes,
    /// Column with the person ids of a tracker.
    pub person: Option<String>,
    /// Handling of invalid cells.
    pub bad: BadCells,
}

impl SightingColumns {
    /// Reads the sightings of a batch, with cameras as indices into [`Calibrations::cameras`]. Incomplete rows, and
    /// rows without a calibration, a time or a foot point, are left out.
    ///
    /// # Errors
    ///
    /// Fails if the time column is unknown, or if a column is missing or has an invalid cell.
    pub fn read(
        &self,
        batch: &RecordBatch,
        calibrations: &mut Calibrations,
        rows: Rows<'_>,
    ) -> Result<Vec<Sighting>, TableError> {
        let times = calibrations.times(batch, rows.row_name, &self.bad)?;
        let Some(times) = times else {
            let what = "the time column is unknown; give its name with --at-column".into();
            return Err(TableError::Usage(what));
        };
        let choice = calibrations.choose_at(batch, Some(&times))?;
        let detections = self.detections(batch, calibrations, rows.row_name)?;
        let people = self.people(batch)?;
        let mut seen = Vec::with_capacity(batch.num_rows());
        for row in 0..batch.num_rows() {
            let index = match &choice {
                Choice::All(index) => *index,
                Choice::Rows(chosen) => chosen[row],
            };
            let Some(calibration) = calibrations.list.get(index as usize) else { continue };
            let (Some(at), false) = (times[row], (rows.is_incomplete)(row)) else { continue };
            let in_still = |[u, v]: [f64; 2]| {
                // Fractions count from the corner of the stream, whatever the pixel origin.
                let map = |axis: usize, value: f64| match detections.are_fractions() {
                    true => calibration.stream.corner_to_image(axis, value),
                    false => calibration.stream.to_image(axis, value),
                };
                Pixel::new(map(0, u), map(1, v))
            };
            let Detection { foot, head, width } = detections.at(row, calibration.stream_size);
            let [foot, head] = [foot, head].map(in_still);
            if foot.is_finite() {
                let width = (width * calibration.stream.max_pixel_size()).max(0.0);
                let head = head.is_finite().then_some(head);
                seen.push(Sighting { at, camera: index as usize, foot, head, width, person: people[row] });
            }
        }
        Ok(seen)
    }

    /// Reads the feet or boxes of a batch.
    fn detections(
        &self,
        batch: &RecordBatch,
        calibrations: &Calibrations,
        row_name: RowName<'_>,
    ) -> Result<Detections, TableError> {
        let columns = match self.columns {
            Columns::Points => None,
            Columns::Auto | Columns::Boxes => self.boxes.columns(batch),
        };
        if let Some(columns) = columns {
            let found = self.boxes.read(batch, &columns, calibrations, (row_name, &self.bad))?;
            return Ok(Detections::Boxes(found));
        }
        let are_boxes = self.columns == Columns::Boxes || self.boxes.is_stated();
        if are_boxes && self.columns != Columns::Points {
            // The columns of boxes are incomplete: `numbers` reports the missing ones.
            let values = numbers(batch, ["x", "y", "w", "h"], BOXES, row_name, &self.bad)?;
            let form = BoxForm::CornerSize;
            return Ok(Detections::Boxes(BoxValues { form, values, are_fractions: false }));
        }
        let expected = if self.columns == Columns::Auto { FEET_OR_BOXES } else { "u,v" };
        Ok(Detections::Feet(numbers(batch, ["u", "v"], expected, row_name, &self.bad)?))
    }

    /// Reads the id of the person of each row. The text of the id is mapped to a number by a stable hash. `None` for
    /// every row if there is no column for the person.
    fn people(&self, batch: &RecordBatch) -> Result<Vec<Option<u64>>, TableError> {
        let Some(name) = &self.person else { return Ok(vec![None; batch.num_rows()]) };
        let found = column(batch, name).ok_or_else(|| {
            let columns = names(batch);
            let what =
                format!("--person-column {name}: no such column; the table has the columns \"{columns}\"");
            TableError::Invalid(what)
        })?;
        let texts = texts(&found)?;
        // The FNV-1a hash (Fowler, Noll, Vo 1991) is the same in every build, so that saved ids stay valid.
        let number = |text: &str| {
            let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3);
            text.bytes().fold(0xCBF2_9CE4_8422_2325, step)
        };
        Ok(texts.iter().map(|text| text.map(number)).collect())
    }
}

/// Boxes or foot points of a batch, column by column, in pixels or as fractions of the stream.
enum Detections {
    Boxes(BoxValues),
    Feet([Vec<f64>; 2]),
}

/// Detection of a person: foot, head and box width, in pixels of the stream. An unknown foot or head is NaN, and an
/// unknown width is 0.
struct Detection {
    foot: [f64; 2],
    head: [f64; 2],
    width: f64,
}

impl Detections {
    const fn are_fractions(&self) -> bool {
        matches!(self, Self::Boxes(BoxValues { are_fractions: true, .. }))
    }

    /// Returns the detection of a row. `size` is the width and height of the stream, in pixels.
    fn at(&self, row: usize, size: [f64; 2]) -> Detection {
        match self {
            Self::Boxes(BoxValues { form, values: [a, b, c, d], are_fractions }) => {
                let [sx, sy] = if *are_fractions { size } else { [1.0; 2] };
                let numbers = [sx * a[row], sy * b[row], sx * c[row], sy * d[row]];
                let [_, top, width, _] = form.corner_and_size(numbers);
                let foot = form.foot(numbers);
                Detection { foot, head: [foot[0], top], width }
            }
            Self::Feet([u, v]) => Detection { foot: [u[row], v[row]], head: [f64::NAN; 2], width: 0.0 },
        }
    }
}
