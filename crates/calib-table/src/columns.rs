//! Columns of a table as numbers and times, and what becomes of cells that are neither.

use std::sync::atomic::{AtomicU64, Ordering};

use arrow_array::{Array as _, ArrayRef, RecordBatch, StringArray};
use arrow_cast::parse::string_to_timestamp_nanos;
use arrow_schema::DataType;

use crate::cast::{self, nanoseconds, texts, whole_numbers};
use crate::json_text::{is_json, plain};
use crate::table_error::TableError;
use crate::wording::Wording;

/// Says which row of a batch is meant.
pub type Place<'a> = &'a dyn Fn(usize) -> String;

/// What becomes of a row that is not whole, or with a cell that is no number, or no time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum BadRows {
    /// The run ends and writes nothing
    Fail,
    /// Its status says so: missing without a number and where it is not whole, no-calibration without a time
    Status,
}

/// Cells that are no numbers and no times.
#[derive(Debug)]
pub struct BadCells {
    rows: BadRows,
    count: AtomicU64,
    /// Rows that are not whole.
    broken: AtomicU64,
    wording: Wording,
}

impl BadCells {
    /// None yet; what becomes of those that are met.
    #[must_use]
    pub const fn new(rows: BadRows, wording: Wording) -> Self {
        Self { rows, count: AtomicU64::new(0), broken: AtomicU64::new(0), wording }
    }

    pub(crate) const fn wording(&self) -> Wording {
        self.wording
    }

    /// One more; an error where they end the run.
    fn met(&self, place: &str, column: &str, found: &str, expected: &str) -> Result<(), TableError> {
        if self.rows == BadRows::Status {
            self.count.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        }
        Err(TableError::Invalid(format!(
            "{place}, column {column}: found \"{found}\", expected {expected}; {} goes on with the others",
            self.wording.with("bad-rows", "status")
        )))
    }

    /// Another row that is not whole.
    pub(crate) fn met_broken(&self) {
        self.broken.fetch_add(1, Ordering::Relaxed);
    }

    /// What is to be said of them, if there were any.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let whole = "are not whole (too few or too many cells, no JSON object, or not UTF-8)";
        let told = [
            (&self.broken, format!("rows {whole}: they have")),
            (&self.count, "cells are no numbers or no times: their rows have".to_owned()),
        ];
        let met = told.into_iter().map(|(count, what)| (count.load(Ordering::Relaxed), what));
        met.filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what} the status missing or no-calibration"))
            .collect()
    }
}

/// The column of a name, as plain text where it holds JSON.
pub(crate) fn column(batch: &RecordBatch, name: &str) -> Option<ArrayRef> {
    let schema = batch.schema();
    let (index, field) = schema.column_with_name(name)?;
    let column = batch.column(index);
    Some(if is_json(field) { plain(column) } else { column.clone() })
}

/// The names of all columns, as they are said.
pub(crate) fn names(batch: &RecordBatch) -> String {
    let schema = batch.schema();
    schema.fields().iter().map(|field| field.name().as_str()).collect::<Vec<_>>().join(",")
}

/// Columns of numbers, NaN where there is none.
pub(crate) fn numbers<const N: usize>(
    batch: &RecordBatch,
    wanted: [&str; N],
    expected: &str,
    place: Place<'_>,
    bad: &BadCells,
) -> Result<[Vec<f64>; N], TableError> {
    let mut found = [const { Vec::new() }; N];
    for (values, name) in found.iter_mut().zip(wanted) {
        let Some(column) = column(batch, name) else {
            // The columns of CSV are in its header; JSON has them line by line.
            let is_csv = batch.num_rows() == 0
                || place(0).starts_with("line") && !batch.schema().fields().iter().any(|f| is_json(f));
            let place = if is_csv { "line 1".into() } else { place(0) };
            let what = format!("{place}: found the columns \"{}\", expected {expected}", names(batch));
            return Err(TableError::Invalid(what));
        };
        *values = doubles(&column, name, place, bad)?;
    }
    Ok(found)
}

fn doubles(column: &ArrayRef, name: &str, place: Place<'_>, bad: &BadCells) -> Result<Vec<f64>, TableError> {
    let refused = || {
        TableError::Invalid(format!(
            "column {name}: found values of type {}, expected numbers",
            column.data_type()
        ))
    };
    if let Some(exact) = cast::doubles(column) {
        return Ok(match exact.nulls() {
            None => exact.values().to_vec(),
            Some(_) => exact.iter().map(|value| value.unwrap_or(f64::NAN)).collect(),
        });
    }
    match column.data_type() {
        DataType::Null => Ok(vec![f64::NAN; column.len()]),
        kind if is_text(kind) => {
            let texts = texts(column).map_err(|_| refused())?;
            let number = |text: &str| text.parse().ok();
            let parsed = parsed(&texts, name, place, bad, "a number", number)?;
            Ok(parsed.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
        }
        _ => Err(refused()),
    }
}

fn is_text(kind: &DataType) -> bool {
    matches!(kind, DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View | DataType::Dictionary(..))
}

/// The cells of a column of text as values; none where there is no text, or not such a one.
fn parsed<T>(
    texts: &StringArray,
    name: &str,
    place: Place<'_>,
    bad: &BadCells,
    expected: &str,
    value: impl Fn(&str) -> Option<T>,
) -> Result<Vec<Option<T>>, TableError> {
    let texts = texts.iter().enumerate();
    let parsed = texts.map(|(row, text)| match text.map(str::trim) {
        None | Some("") => Ok(None),
        Some(text) => match value(text) {
            Some(value) => Ok(Some(value)),
            None => bad.met(&place(row), name, text, expected).map(|()| None),
        },
    });
    parsed.collect()
}

/// What numbers of a column of times count, from 1970-01-01 UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum AtUnit {
    /// Seconds
    S,
    /// Milliseconds
    Ms,
    /// Microseconds
    Us,
    /// Nanoseconds
    Ns,
}

impl AtUnit {
    /// Columns of numbers have their unit in their name: `at_s`, `time_ms`.
    fn of_name(name: &str) -> Option<Self> {
        let (_, unit) = name.rsplit_once('_')?;
        Self::named(&unit.to_ascii_lowercase())
    }

    /// The one of this name: s, ms, us or ns.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "s" => Self::S,
            "ms" => Self::Ms,
            "us" => Self::Us,
            "ns" => Self::Ns,
            _ => return None,
        })
    }

    const fn nanoseconds(self) -> i64 {
        match self {
            Self::S => 1_000_000_000,
            Self::Ms => 1_000_000,
            Self::Us => 1000,
            Self::Ns => 1,
        }
    }

    /// Whole numbers as they are: a double has no nanoseconds of this century.
    fn time(self, number: &str) -> Option<i64> {
        let whole = number.parse::<i64>().ok().and_then(|number| number.checked_mul(self.nanoseconds()));
        whole.or_else(|| self.of_double(number.parse().ok()?))
    }

    fn of_double(self, number: f64) -> Option<i64> {
        // Whole units and their parts by themselves: their product has more digits than a double.
        let in_range = (number * self.nanoseconds() as f64).abs() < i64::MAX as f64;
        let parts = (number.fract() * self.nanoseconds() as f64).round() as i64;
        (number.trunc() as i64).checked_mul(self.nanoseconds())?.checked_add(parts).filter(|_| in_range)
    }
}

/// The column that says when a row was.
#[derive(Clone, Debug)]
pub struct AtColumn {
    name: String,
    unit: Option<AtUnit>,
    wording: Wording,
}

impl AtColumn {
    /// The column of a name; numbers in it count in the unit, or in that of its name.
    #[must_use]
    pub fn new(name: String, unit: Option<AtUnit>, wording: Wording) -> Self {
        let unit = unit.or_else(|| AtUnit::of_name(&name));
        Self { name, unit, wording }
    }

    fn asked(&self) -> String {
        self.wording.with("at-column", &self.name)
    }

    /// Times as nanoseconds since 1970; times without an offset count as UTC.
    pub(crate) fn times(
        &self,
        batch: &RecordBatch,
        place: Place<'_>,
        bad: &BadCells,
    ) -> Result<Vec<Option<i64>>, TableError> {
        let name = &self.name;
        let column = column(batch, name).ok_or_else(|| {
            TableError::Invalid(format!("{}: the table has the columns \"{}\"", self.asked(), names(batch)))
        })?;
        if let Some(exact) = nanoseconds(&column) {
            return Ok(exact.iter().collect());
        }
        match column.data_type() {
            kind if is_text(kind) => self.of_text(&column, place, bad),
            kind if kind.is_numeric() => self.of_numbers(&column),
            other => Err(TableError::Invalid(format!(
                "{}: found {other}, expected timestamps, numbers, or text such as 2026-05-01T08:00:00Z",
                self.asked()
            ))),
        }
    }

    fn units(&self) -> String {
        format!("{} s, ms, us or ns", self.wording.name("at-unit"))
    }

    fn of_text(
        &self,
        column: &ArrayRef,
        place: Place<'_>,
        bad: &BadCells,
    ) -> Result<Vec<Option<i64>>, TableError> {
        let texts = texts(column)?;
        let time = |text: &str| {
            let number = self.unit.and_then(|unit| unit.time(text));
            number.or_else(|| string_to_timestamp_nanos(text).ok())
        };
        let expected = match self.unit {
            Some(_) => "a number or a time such as 2026-05-01T08:00:00Z".to_owned(),
            None => format!("a time such as 2026-05-01T08:00:00Z, or numbers with {}", self.units()),
        };
        parsed(&texts, &self.name, place, bad, &expected, time)
    }

    fn of_numbers(&self, column: &ArrayRef) -> Result<Vec<Option<i64>>, TableError> {
        let Some(unit) = self.unit else {
            return Err(TableError::Invalid(format!(
                "{}: found {}; say with {} what it counts from 1970",
                self.asked(),
                column.data_type(),
                self.units()
            )));
        };
        if let Some(whole) = whole_numbers(column) {
            return Ok(whole.iter().map(|time| time?.checked_mul(unit.nanoseconds())).collect());
        }
        let doubles = cast::doubles(column);
        Ok(doubles.iter().flatten().map(|time| unit.of_double(time?)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_from_1970_in_the_unit_of_their_name() {
        assert_eq!(AtUnit::of_name("at_s"), Some(AtUnit::S));
        assert_eq!(AtUnit::of_name("frame_time_ms"), Some(AtUnit::Ms));
        assert_eq!(AtUnit::of_name("seconds"), None);
        assert_eq!(AtUnit::S.time("1777622400"), Some(1_777_622_400_000_000_000));
        assert_eq!(AtUnit::Ms.time("1777622400000.5"), Some(1_777_622_400_000_500_000));
        assert_eq!(AtUnit::Ns.time("1777622400123456789"), Some(1_777_622_400_123_456_789));
        assert_eq!(AtUnit::S.time("nan"), None);
        assert_eq!(AtUnit::S.time("2026-05-01"), None);
    }
}
