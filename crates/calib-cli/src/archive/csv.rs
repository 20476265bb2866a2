//! CSV: every column is text, and stays as it is in CSV; for formats whose columns have types, the first rows
//! tell them.
//!
//! What the cells of a column of text are, for formats whose columns have types.

use std::cell::Cell;
use std::io::{Read, Write as _};
use std::rc::Rc;
use std::str::FromStr;
use std::sync::Arc;

use ::csv::{ByteRecord, Reader, ReaderBuilder, Writer};
use arrow_array::builder::StringBuilder;
use arrow_array::cast::AsArray as _;
use arrow_array::types::{Float32Type, Float64Type};
use arrow_array::{Array, ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch};
use arrow_cast::display::{ArrayFormatter, FormatOptions};
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use calib_formats::is_spreadsheet_formula;

use super::arrow::in_utc;
use super::{
    BATCH_ROWS, CELL_BYTES, FIRST_ROWS, GOES_ON, Input, MAX_COLUMNS, MAX_ROW_BYTES, Output, Packing, Purpose,
    Sink, Source,
};
use crate::files::say;
use crate::stop::Stop;

/// Text that a batch may have before it is handed on.
const BATCH_BYTES: usize = 16 << 20;

struct Csv {
    name: String,
    reader: Reader<Limited>,
    left: Rc<Cell<u64>>,
    /// As it is handed on; of text until the types are known.
    schema: SchemaRef,
    /// Whether the first rows are still to tell the types.
    is_untold: bool,
    /// Columns that stay text.
    as_text: Vec<String>,
    keeps_broken: bool,
    record: ByteRecord,
    /// The rows that told the types.
    first: Option<RecordBatch>,
    /// Line of every row of the last batch.
    lines: Vec<u64>,
    /// Of them, in the same order, those that are not whole.
    broken: Vec<u64>,
}

/// Reads until a row has become too long.
struct Limited {
    from: Box<dyn Read>,
    left: Rc<Cell<u64>>,
}

impl Read for Limited {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.from.read(buffer)?;
        let left = self.left.get().checked_sub(count as u64);
        self.left.set(left.ok_or_else(|| std::io::Error::other("a row longer than 64 MiB"))?);
        Ok(count)
    }
}

pub(super) fn open(input: Input, purpose: Purpose<'_>) -> Result<Box<dyn Source>, Stop> {
    let (name, left) = (input.name.clone(), Rc::new(Cell::new(MAX_ROW_BYTES)));
    let limited = Limited { from: input.into_read(), left: Rc::clone(&left) };
    let mut reader = ReaderBuilder::new().flexible(purpose.keeps_broken).from_reader(limited);
    let header = reader.headers().map_err(|error| Stop::invalid(&name, error))?;
    if header.len() > MAX_COLUMNS {
        let what = format!("found {} columns, expected at most {MAX_COLUMNS}", header.len());
        return Err(Stop::invalid(&name, what));
    }
    let fields: Vec<Field> =
        header.iter().map(|column| Field::new(column.trim(), DataType::Utf8, true)).collect();
    let schema = Arc::new(Schema::new(fields));
    check_columns(&name, &schema, purpose.as_text)?;
    let (is_untold, as_text) = (purpose.to.is_typed, purpose.as_text.to_vec());
    let mut csv = Csv {
        name,
        reader,
        left,
        schema,
        is_untold,
        as_text,
        keeps_broken: purpose.keeps_broken,
        record: ByteRecord::new(),
        first: None,
        lines: Vec::new(),
        broken: Vec::new(),
    };
    if is_untold {
        csv.first = csv.read()?;
    }
    Ok(Box::new(csv))
}

/// Refuses a name that no column has.
fn check_columns(name: &str, schema: &Schema, as_text: &[String]) -> Result<(), Stop> {
    let Some(unknown) = as_text.iter().find(|column| schema.index_of(column).is_err()) else { return Ok(()) };
    let columns: Vec<&str> = schema.fields().iter().map(|field| field.name().as_str()).collect();
    Err(Stop::invalid(
        name,
        format!("--as-text {unknown}: the table has the columns \"{}\"", columns.join(",")),
    ))
}

impl Csv {
    /// The next rows, if there are any.
    fn read(&mut self) -> Result<Option<RecordBatch>, Stop> {
        let count = self.schema.fields().len();
        let rows = BATCH_ROWS.min(BATCH_BYTES / CELL_BYTES / count.max(1));
        let mut columns: Vec<StringBuilder> =
            (0..count).map(|_| StringBuilder::with_capacity(rows, 0)).collect();
        if !self.fill(&mut columns)? {
            return Ok(None);
        }
        let columns: Vec<ArrayRef> =
            columns.iter_mut().map(|column| Arc::new(column.finish()) as ArrayRef).collect();
        let columns = self.typed(columns)?;
        Ok(Some(RecordBatch::try_new(Arc::clone(&self.schema), columns)?))
    }

    /// The columns with the types that the first rows told.
    fn typed(&mut self, columns: Vec<ArrayRef>) -> Result<Vec<ArrayRef>, Stop> {
        if std::mem::take(&mut self.is_untold) {
            let fields = self.schema.fields().iter().zip(&columns).map(|(field, column)| {
                let stays = self.as_text.contains(field.name());
                let kind = if stays { DataType::Utf8 } else { kind(column) };
                Field::new(field.name(), kind, true)
            });
            self.schema = Arc::new(Schema::new(fields.collect::<Vec<_>>()));
        }
        let typed = self.schema.fields().iter().zip(&columns).map(|(field, column)| {
            parsed(column, field.data_type()).map_err(|(row, expected)| {
                let (name, text) = (field.name(), column.as_string::<i32>().value(row));
                let what = format!(
                    "{}, column {name}: found \"{text}\", expected {expected} as in the first rows; --as-text {name} \
                     keeps the column as text",
                    self.place(row)
                );
                Stop::invalid(&self.name, what)
            })
        });
        typed.collect()
    }

    /// Reads rows into the builders; whether there were any.
    fn fill(&mut self, columns: &mut [StringBuilder]) -> Result<bool, Stop> {
        self.lines.clear();
        self.broken.clear();
        let mut bytes = 0;
        let most = if self.is_untold { FIRST_ROWS } else { BATCH_ROWS };
        while self.lines.len() < most && bytes < BATCH_BYTES {
            self.left.set(MAX_ROW_BYTES);
            let more = self.reader.read_byte_record(&mut self.record);
            if !more.map_err(|error| self.unreadable(&error))? {
                break;
            }
            let line = self.record.position().map_or(0, ::csv::Position::line);
            let is_text = self.record.iter().all(|cell| std::str::from_utf8(cell).is_ok());
            let is_whole = is_text && self.record.len() == columns.len();
            if !is_text && !self.keeps_broken {
                return Err(self.not_text(line));
            }
            // In a column of a type, what is in the cells of a broken row may be of another one.
            let is_kept = is_whole || !(self.is_untold || self.has_types());
            for (index, column) in columns.iter_mut().enumerate() {
                let cell = self.record.get(index).filter(|cell| is_kept && !cell.is_empty());
                let text = cell.map(String::from_utf8_lossy);
                bytes += text.as_ref().map_or(0, |text| text.len()) + CELL_BYTES;
                column.append_option(text);
            }
            if !is_whole {
                self.broken.push(line);
            }
            self.lines.push(line);
        }
        Ok(!self.lines.is_empty())
    }

    fn has_types(&self) -> bool {
        self.schema.fields().iter().any(|field| field.data_type() != &DataType::Utf8)
    }

    fn unreadable(&self, error: &::csv::Error) -> Stop {
        let is_of_length = matches!(error.kind(), ::csv::ErrorKind::UnequalLengths { .. });
        let hint = if is_of_length { format!("; {GOES_ON}") } else { String::new() };
        Stop::invalid(&self.name, format!("{error}{hint}"))
    }

    fn not_text(&self, line: u64) -> Stop {
        let at = self.record.iter().position(|cell| std::str::from_utf8(cell).is_err());
        let column = at.and_then(|at| self.schema.fields().get(at)).map_or("", |field| field.name());
        Stop::invalid(&self.name, format!("line {line}, column {column}: not UTF-8 text; {GOES_ON}"))
    }
}

impl Source for Csv {
    fn schema(&self) -> Option<SchemaRef> {
        Some(Arc::clone(&self.schema))
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        match self.first.take() {
            Some(batch) => Some(Ok(batch)),
            None => self.read().transpose(),
        }
    }

    fn is_broken(&self, row: usize) -> bool {
        self.lines.get(row).is_some_and(|line| self.broken.binary_search(line).is_ok())
    }

    fn place(&self, row: usize) -> String {
        format!("line {}", self.lines.get(row).copied().unwrap_or_default())
    }
}

struct CsvSink<'a> {
    writer: Writer<Output<'a>>,
    is_verbatim: bool,
    /// Cells that got an apostrophe.
    quoted: usize,
}

pub(super) fn create<'a>(
    output: Output<'a>,
    schema: &Schema,
    packing: Packing,
) -> Result<Box<dyn Sink + 'a>, Stop> {
    let writer = Writer::from_writer(output);
    let mut sink = CsvSink { writer, is_verbatim: packing.is_verbatim, quoted: 0 };
    for field in schema.fields() {
        sink.write_text(field.name().as_bytes())?;
    }
    sink.writer.write_record(None::<&[u8]>)?;
    Ok(Box::new(sink))
}

impl CsvSink<'_> {
    /// Writes a cell that a spreadsheet would run with an apostrophe before it, which makes it text there.
    fn write_text(&mut self, text: &[u8]) -> Result<(), Stop> {
        if self.is_verbatim || !is_spreadsheet_formula(text) {
            return Ok(self.writer.write_field(text)?);
        }
        self.quoted += 1;
        Ok(self.writer.write_field([b"'", text].concat())?)
    }
}

impl Sink for CsvSink<'_> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), Stop> {
        let batch = in_utc(batch)?;
        let options = FormatOptions::new();
        let cells: Vec<Cells<'_>> =
            batch.columns().iter().map(|column| Cells::of(column, &options)).collect::<Result<_, Stop>>()?;
        let mut text = Vec::new();
        for row in 0..batch.num_rows() {
            for cell in &cells {
                text.clear();
                cell.print(row, &mut text)?;
                self.write_text(&text)?;
            }
            self.writer.write_record(None::<&[u8]>)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), Stop> {
        if self.quoted > 0 {
            let cells = calib_site::counted(self.quoted, "cell", "cells");
            say(format_args!(
                "calib: an apostrophe was put before {cells} that a spreadsheet would take for a formula; --verbatim \
                 leaves it out"
            ));
        }
        Ok(self.writer.flush()?)
    }
}

/// The cells of a column, in the shortest form that is read back as the same value.
enum Cells<'a> {
    Text(&'a arrow_array::StringArray),
    Double(&'a Float64Array),
    Single(&'a arrow_array::Float32Array),
    Other(&'a ArrayRef, ArrayFormatter<'a>),
}

impl<'a> Cells<'a> {
    fn of(column: &'a ArrayRef, options: &'a FormatOptions<'a>) -> Result<Self, Stop> {
        Ok(match column.data_type() {
            DataType::Utf8 => Self::Text(column.as_string()),
            DataType::Float64 => Self::Double(column.as_primitive::<Float64Type>()),
            DataType::Float32 => Self::Single(column.as_primitive::<Float32Type>()),
            _ => Self::Other(column, ArrayFormatter::try_new(column, options)?),
        })
    }

    fn print(&self, row: usize, text: &mut Vec<u8>) -> Result<(), Stop> {
        match self {
            Self::Text(column) if column.is_valid(row) => {
                text.extend_from_slice(column.value(row).as_bytes());
            }
            Self::Double(column) if column.is_valid(row) => write!(text, "{}", column.value(row))?,
            Self::Single(column) if column.is_valid(row) => write!(text, "{}", column.value(row))?,
            Self::Other(column, formatter) if column.is_valid(row) => {
                write!(text, "{}", formatter.value(row).try_to_string()?)?;
            }
            _ => {}
        }
        Ok(())
    }
}

/// What all cells are; text where they are not of one kind, or would be read back as another text: a zero that
/// leads is part of an id.
pub(super) fn kind(column: &ArrayRef) -> DataType {
    let values = || column.as_string::<i32>().iter().flatten();
    let is_whole = |value: &str| value.parse::<i64>().is_ok_and(|number| number.to_string() == value);
    let has_zeros = |value: &str| {
        let digits = value.trim_start_matches('-');
        digits.starts_with('0') && digits[1..].starts_with(|c: char| c.is_ascii_digit())
    };
    let begins = |value: &str| value.starts_with(|c: char| matches!(c, '-' | '.') || c.is_ascii_digit());
    // A whole number that does not fit would lose its last digits as a double.
    let is_huge = |value: &str| value.parse::<i64>().is_err() && value.bytes().all(|b| b.is_ascii_digit());
    let is_number =
        |value: &str| begins(value) && value.parse::<f64>().is_ok() && !has_zeros(value) && !is_huge(value);
    if values().next().is_none() {
        DataType::Utf8
    } else if values().all(is_whole) {
        DataType::Int64
    } else if values().all(is_number) {
        DataType::Float64
    } else if values().all(|value| matches!(value, "true" | "false")) {
        DataType::Boolean
    } else {
        DataType::Utf8
    }
}

/// The cells as a type; else the first row that is not, and what it should be.
pub(super) fn parsed(column: &ArrayRef, kind: &DataType) -> Result<ArrayRef, (usize, &'static str)> {
    match kind {
        DataType::Int64 => all::<i64, Int64Array>(column, "a whole number"),
        DataType::Float64 => all::<f64, Float64Array>(column, "a number"),
        DataType::Boolean => all::<bool, BooleanArray>(column, "true or false"),
        _ => Ok(Arc::clone(column)),
    }
}

fn all<T: FromStr, A: FromIterator<Option<T>> + Array + 'static>(
    column: &ArrayRef,
    expected: &'static str,
) -> Result<ArrayRef, (usize, &'static str)> {
    let parsed = column.as_string::<i32>().iter().enumerate().map(|(row, value)| match value {
        None => Ok(None),
        Some(text) => text.parse().map(Some).map_err(|_| (row, expected)),
    });
    Ok(Arc::new(parsed.collect::<Result<A, _>>()?))
}

#[cfg(test)]
mod tests {
    use arrow_array::StringArray;

    use super::*;

    fn of(cells: &[&str]) -> DataType {
        kind(&(Arc::new(StringArray::from_iter_values(cells)) as ArrayRef))
    }

    #[test]
    fn a_column_is_what_all_its_cells_are() {
        assert_eq!(of(&["1", "-20"]), DataType::Int64);
        assert_eq!(of(&["1", "2.5", "-1e-3", ".5", "0.1"]), DataType::Float64);
        assert_eq!(of(&["true", "false"]), DataType::Boolean);
        for text in
            [&["007"][..], &["1", "n/a"], &["+1"], &["inf"], &["12345678901234567890"], &["00.5"], &[]]
        {
            assert_eq!(of(text), DataType::Utf8, "{text:?}");
        }
    }
}
