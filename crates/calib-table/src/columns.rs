//! Columns of a table as numbers and times, and the handling of invalid cells.

use std::sync::atomic::{AtomicU64, Ordering};

use arrow_array::{Array as _, ArrayRef, RecordBatch, StringArray};
use arrow_cast::parse::string_to_timestamp_nanos;
use arrow_schema::DataType;

use crate::cast::{self, nanoseconds, texts, whole_numbers};
use crate::json_text::{is_json, plain};
use crate::table_error::TableError;
use crate::wording::Wording;

/// Function that names a row of a batch, for messages.
pub type RowName<'a> = &'a dyn Fn(usize) -> String;

/// Handling of incomplete rows, and of cells that are not a number or not a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum BadRows {
    /// The run stops, and no output file is written
    Fail,
    /// The row gets a status: `missing` if it is incomplete or a number is invalid, `no-calibration` if its time is
    /// invalid
    Status,
}

/// Counters of invalid cells and incomplete rows of a table, with their handling.
#[derive(Debug)]
pub struct BadCells {
    rows: BadRows,
    count: AtomicU64,
    /// Number of incomplete rows.
    incomplete: AtomicU64,
    wording: Wording,
}

impl BadCells {
    /// Creates counters with the value zero. `rows` is the handling of invalid cells and rows.
    #[must_use]
    pub const fn new(rows: BadRows, wording: Wording) -> Self {
        Self { rows, count: AtomicU64::new(0), incomplete: AtomicU64::new(0), wording }
    }

    pub(crate) const fn wording(&self) -> Wording {
        self.wording
    }

    /// Counts an invalid cell, or returns an error if invalid rows stop the run.
    fn count_cell(
        &self,
        row_name: &str,
        column: &str,
        found: &str,
        expected: &str,
    ) -> Result<(), TableError> {
        if self.rows == BadRows::Status {
            self.count.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        }
        Err(TableError::Invalid(format!(
            "{row_name}, column {column}: found \"{found}\", expected {expected}; use {} to continue",
            self.wording.with("bad-rows", "status")
        )))
    }

    /// Counts an incomplete row.
    pub(crate) fn count_incomplete_row(&self) {
        self.incomplete.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns messages about the invalid cells and rows.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let causes = " (wrong number of cells, not a JSON object, or not UTF-8)";
        let counts = [
            (&self.incomplete, ["row is incomplete", "rows are incomplete"], causes),
            (&self.count, ["cell is not a number or time", "cells are not numbers or times"], ""),
        ];
        let counts = counts.map(|(count, words, causes)| (count.load(Ordering::Relaxed), words, causes));
        let found = counts.into_iter().filter(|(count, ..)| *count > 0);
        found
            .map(|(count, [one, many], causes)| {
                let count = usize::try_from(count).unwrap_or(usize::MAX);
                let what = calib_site::counted(count, one, many);
                format!("{what}{causes}: status missing or no-calibration")
            })
            .collect()
    }
}

/// Returns the column with this name, otherwise a column whose name differs only in upper and lower case. JSON values
/// become plain text.
pub(crate) fn column(batch: &RecordBatch, name: &str) -> Option<ArrayRef> {
    let schema = batch.schema();
    let in_any_case = || schema.fields().iter().position(|field| field.name().eq_ignore_ascii_case(name));
    let index = schema.column_with_name(name).map(|(index, _)| index).or_else(in_any_case)?;
    let field = schema.field(index);
    let column = batch.column(index);
    Some(if is_json(field) { plain(column) } else { column.clone() })
}

/// Lists the names of all columns, for messages.
pub(crate) fn names(batch: &RecordBatch) -> String {
    let schema = batch.schema();
    schema.fields().iter().map(|field| field.name().as_str()).collect::<Vec<_>>().join(",")
}

/// Reads columns of numbers by their names; missing values are NaN.
pub(crate) fn numbers<const N: usize>(
    batch: &RecordBatch,
    wanted: [&str; N],
    expected: &str,
    row_name: RowName<'_>,
    bad: &BadCells,
) -> Result<[Vec<f64>; N], TableError> {
    let mut found = [const { Vec::new() }; N];
    for (values, name) in found.iter_mut().zip(wanted) {
        let Some(column) = column(batch, name) else {
            // CSV has its columns in the header line; JSON has them in each line.
            let is_csv = batch.num_rows() == 0
                || row_name(0).starts_with("line") && !batch.schema().fields().iter().any(|f| is_json(f));
            let row_name = if is_csv { "line 1".into() } else { row_name(0) };
            let what = format!("{row_name}: found the columns \"{}\", expected {expected}", names(batch));
            return Err(TableError::Invalid(what));
        };
        *values = doubles(&column, name, row_name, bad)?;
    }
    Ok(found)
}

fn doubles(
    column: &ArrayRef,
    name: &str,
    row_name: RowName<'_>,
    bad: &BadCells,
) -> Result<Vec<f64>, TableError> {
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
            let parsed = parse_cells(&texts, name, row_name, bad, "a number", number)?;
            Ok(parsed.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
        }
        _ => Err(refused()),
    }
}

fn is_text(kind: &DataType) -> bool {
    matches!(kind, DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View | DataType::Dictionary(..))
}

/// Parses the cells of a text column; empty and invalid cells are `None`.
fn parse_cells<T>(
    texts: &StringArray,
    name: &str,
    row_name: RowName<'_>,
    bad: &BadCells,
    expected: &str,
    value: impl Fn(&str) -> Option<T>,
) -> Result<Vec<Option<T>>, TableError> {
    let texts = texts.iter().enumerate();
    let parsed = texts.map(|(row, text)| match text.map(str::trim) {
        None | Some("") => Ok(None),
        Some(text) => match value(text) {
            Some(value) => Ok(Some(value)),
            None => bad.count_cell(&row_name(row), name, text, expected).map(|()| None),
        },
    });
    parsed.collect()
}

/// Unit of numbers in a column of times, counted from 1970-01-01 UTC.
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
    /// Returns the unit at the end of a column's name: `at_s`, `time_ms`.
    fn from_column_name(name: &str) -> Option<Self> {
        let (_, unit) = name.rsplit_once('_')?;
        Self::from_name(&unit.to_ascii_lowercase())
    }

    /// Returns the unit with this name: s, ms, us or ns.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
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

    /// Parses a number of units since 1970 as nanoseconds. Integers are parsed exactly, because a double
    /// cannot resolve nanoseconds since 1970.
    fn time(self, number: &str) -> Option<i64> {
        let whole = number.parse::<i64>().ok().and_then(|number| number.checked_mul(self.nanoseconds()));
        whole.or_else(|| self.time_from_double(number.parse().ok()?))
    }

    fn time_from_double(self, number: f64) -> Option<i64> {
        // The whole units and the fraction are converted separately, because their sum in nanoseconds has
        // more digits than a double.
        let in_range = (number * self.nanoseconds() as f64).abs() < i64::MAX as f64;
        let parts = (number.fract() * self.nanoseconds() as f64).round() as i64;
        (number.trunc() as i64).checked_mul(self.nanoseconds())?.checked_add(parts).filter(|_| in_range)
    }
}

/// Column with the time of each row.
#[derive(Clone, Debug)]
pub struct AtColumn {
    name: String,
    unit: Option<AtUnit>,
    wording: Wording,
}

impl AtColumn {
    /// Creates a column of times. Numbers in the column are in `unit`. If that is `None`, the end of the
    /// column's name determines their unit, for example `at_s`.
    #[must_use]
    pub fn new(name: String, unit: Option<AtUnit>, wording: Wording) -> Self {
        let unit = unit.or_else(|| AtUnit::from_column_name(&name));
        Self { name, unit, wording }
    }

    fn option_text(&self) -> String {
        self.wording.with("at-column", &self.name)
    }

    /// Reads times as nanoseconds since 1970; times without an offset are UTC.
    pub(crate) fn times(
        &self,
        batch: &RecordBatch,
        row_name: RowName<'_>,
        bad: &BadCells,
    ) -> Result<Vec<Option<i64>>, TableError> {
        let name = &self.name;
        let column = column(batch, name).ok_or_else(|| {
            TableError::Invalid(format!(
                "{}: no such column; the table has the columns \"{}\"",
                self.option_text(),
                names(batch)
            ))
        })?;
        if let Some(exact) = nanoseconds(&column) {
            return Ok(exact.iter().collect());
        }
        match column.data_type() {
            kind if is_text(kind) => self.times_from_text(&column, row_name, bad),
            kind if kind.is_numeric() => self.times_from_numbers(&column),
            other => Err(TableError::Invalid(format!(
                "{}: found {other}, expected timestamps, numbers, or text such as 2026-05-01T08:00:00Z",
                self.option_text()
            ))),
        }
    }

    fn units(&self) -> String {
        format!("{} s, ms, us or ns", self.wording.name("at-unit"))
    }

    fn times_from_text(
        &self,
        column: &ArrayRef,
        row_name: RowName<'_>,
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
        parse_cells(&texts, &self.name, row_name, bad, &expected, time)
    }

    fn times_from_numbers(&self, column: &ArrayRef) -> Result<Vec<Option<i64>>, TableError> {
        let Some(unit) = self.unit else {
            return Err(TableError::Invalid(format!(
                "{}: found numbers ({}) without a unit; give the unit with {}",
                self.option_text(),
                column.data_type(),
                self.units()
            )));
        };
        if let Some(whole) = whole_numbers(column) {
            return Ok(whole.iter().map(|time| time?.checked_mul(unit.nanoseconds())).collect());
        }
        let doubles = cast::doubles(column);
        Ok(doubles.iter().flatten().map(|time| unit.time_from_double(time?)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_from_1970_in_the_unit_of_their_name() {
        assert_eq!(AtUnit::from_column_name("at_s"), Some(AtUnit::S));
        assert_eq!(AtUnit::from_column_name("frame_time_ms"), Some(AtUnit::Ms));
        assert_eq!(AtUnit::from_column_name("seconds"), None);
        assert_eq!(AtUnit::S.time("1777622400"), Some(1_777_622_400_000_000_000));
        assert_eq!(AtUnit::Ms.time("1777622400000.5"), Some(1_777_622_400_000_500_000));
        assert_eq!(AtUnit::Ns.time("1777622400123456789"), Some(1_777_622_400_123_456_789));
        assert_eq!(AtUnit::S.time("nan"), None);
        assert_eq!(AtUnit::S.time("2026-05-01"), None);
    }
}
