//! CSV tables. All columns are text and stay unchanged in CSV output. For typed formats, the types are
//! inferred from the first rows.

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

use super::arrow::to_utc;
use super::text::{CsvText, decimal_point};
use super::{
    BATCH_ROWS, CELL_BYTES, CONTINUE_HINT, Input, MAX_COLUMNS, MAX_ROW_BYTES, Output, OutputOptions,
    ReadOptions, Sink, Source, TYPE_INFERENCE_ROWS,
};
use crate::files::print_message;
use crate::stop::CommandError;

/// Size at which a batch ends, in bytes: its text, and [`CELL_BYTES`] for each cell.
const BATCH_BYTES: usize = 16 << 20;

struct Csv {
    name: String,
    reader: Reader<LimitedReader>,
    left: Rc<Cell<u64>>,
    /// Schema of the batches; all columns are text until the types are inferred.
    schema: SchemaRef,
    /// Whether the types must still be inferred, from the first batch.
    needs_types: bool,
    /// Columns that stay text.
    as_text: Vec<String>,
    keeps_incomplete: bool,
    /// Whether a comma in a number is a decimal point.
    has_decimal_commas: bool,
    record: ByteRecord,
    /// First batch; the types were inferred from it.
    first: Option<RecordBatch>,
    /// Line number of each row of the last batch.
    lines: Vec<u64>,
    /// Line numbers of the incomplete rows, in ascending order.
    incomplete: Vec<u64>,
}

/// Reader that fails if a row exceeds its maximum length.
struct LimitedReader {
    from: Box<dyn Read>,
    left: Rc<Cell<u64>>,
}

impl Read for LimitedReader {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.from.read(buffer)?;
        let left = self.left.get().checked_sub(count as u64);
        let too_long = "a row is longer than 64 MiB; check the quotation marks in the table";
        self.left.set(left.ok_or_else(|| std::io::Error::other(too_long))?);
        Ok(count)
    }
}

pub(super) fn open(input: Input, purpose: ReadOptions<'_>) -> Result<Box<dyn Source>, CommandError> {
    let (name, left) = (input.name.clone(), Rc::new(Cell::new(MAX_ROW_BYTES)));
    let CsvText { reader: text, separator, notes } = CsvText::new(input.into_read())?;
    for note in notes {
        print_message(format_args!("calib: {name}: {note}"));
    }
    let limited = LimitedReader { from: text, left: Rc::clone(&left) };
    let mut reader =
        ReaderBuilder::new().delimiter(separator).flexible(purpose.keeps_incomplete).from_reader(limited);
    let header = reader.headers().map_err(|error| CommandError::invalid(&name, error))?;
    if header.len() > MAX_COLUMNS {
        let what = format!("found {} columns, expected at most {MAX_COLUMNS}", header.len());
        return Err(CommandError::invalid(&name, what));
    }
    let fields: Vec<Field> =
        header.iter().map(|column| Field::new(column.trim(), DataType::Utf8, true)).collect();
    let schema = Arc::new(Schema::new(fields));
    check_column_names(&name, &schema, purpose.as_text)?;
    let (needs_types, as_text) = (purpose.to.is_typed, purpose.as_text.to_vec());
    let mut csv = Csv {
        name,
        reader,
        left,
        schema,
        needs_types,
        as_text,
        keeps_incomplete: purpose.keeps_incomplete,
        has_decimal_commas: separator != b',',
        record: ByteRecord::new(),
        first: None,
        lines: Vec::new(),
        incomplete: Vec::new(),
    };
    if needs_types {
        csv.first = csv.read()?;
    }
    Ok(Box::new(csv))
}

/// Refuses names in `as_text` that are not columns of the table.
fn check_column_names(name: &str, schema: &Schema, as_text: &[String]) -> Result<(), CommandError> {
    let Some(unknown) = as_text.iter().find(|column| schema.index_of(column).is_err()) else { return Ok(()) };
    let columns: Vec<&str> = schema.fields().iter().map(|field| field.name().as_str()).collect();
    Err(CommandError::invalid(
        name,
        format!("--as-text {unknown}: no such column; the table has the columns \"{}\"", columns.join(",")),
    ))
}

impl Csv {
    /// Reads the next batch.
    fn read(&mut self) -> Result<Option<RecordBatch>, CommandError> {
        let count = self.schema.fields().len();
        let rows = BATCH_ROWS.min(BATCH_BYTES / CELL_BYTES / count.max(1));
        let mut columns: Vec<StringBuilder> =
            (0..count).map(|_| StringBuilder::with_capacity(rows, 0)).collect();
        if !self.fill(&mut columns)? {
            return Ok(None);
        }
        let columns: Vec<ArrayRef> =
            columns.iter_mut().map(|column| Arc::new(column.finish()) as ArrayRef).collect();
        let columns = self.with_types(columns)?;
        Ok(Some(RecordBatch::try_new(Arc::clone(&self.schema), columns)?))
    }

    /// Converts the columns to the inferred types.
    fn with_types(&mut self, columns: Vec<ArrayRef>) -> Result<Vec<ArrayRef>, CommandError> {
        if std::mem::take(&mut self.needs_types) {
            let fields = self.schema.fields().iter().zip(&columns).map(|(field, column)| {
                let stays = self.as_text.contains(field.name());
                let kind = if stays { DataType::Utf8 } else { infer_type(column) };
                Field::new(field.name(), kind, true)
            });
            self.schema = Arc::new(Schema::new(fields.collect::<Vec<_>>()));
        }
        let typed = self.schema.fields().iter().zip(&columns).map(|(field, column)| {
            parse_as(column, field.data_type()).map_err(|(row, expected)| {
                let (name, text) = (field.name(), column.as_string::<i32>().value(row));
                let what = format!(
                    "{}, column {name}: found \"{text}\", expected {expected} as in the first rows; add \
                     --as-text {name} to keep the column as text",
                    self.row_name(row)
                );
                CommandError::invalid(&self.name, what)
            })
        });
        typed.collect()
    }

    /// Reads rows into the builders, and returns whether there were any.
    fn fill(&mut self, columns: &mut [StringBuilder]) -> Result<bool, CommandError> {
        self.lines.clear();
        self.incomplete.clear();
        let is_text_column = |index: usize| self.as_text.contains(self.schema.field(index).name());
        let has_decimal_commas: Vec<bool> =
            (0..columns.len()).map(|index| self.has_decimal_commas && !is_text_column(index)).collect();
        let mut bytes = 0;
        let most = if self.needs_types { TYPE_INFERENCE_ROWS } else { BATCH_ROWS };
        while self.lines.len() < most && bytes < BATCH_BYTES {
            self.left.set(MAX_ROW_BYTES);
            let more = self.reader.read_byte_record(&mut self.record);
            if !more.map_err(|error| self.read_error(&error))? {
                break;
            }
            let line = self.record.position().map_or(0, ::csv::Position::line);
            let is_text = self.record.iter().all(|cell| std::str::from_utf8(cell).is_ok());
            let is_whole = is_text && self.record.len() == columns.len();
            if !is_text && !self.keeps_incomplete {
                return Err(self.encoding_error(line));
            }
            // The cells of an incomplete row may be shifted, so typed columns must not contain them.
            let is_kept = is_whole || !(self.needs_types || self.has_types());
            for (index, column) in columns.iter_mut().enumerate() {
                let cell = self.record.get(index).filter(|cell| is_kept && !cell.is_empty());
                let number = cell.filter(|_| has_decimal_commas[index]).and_then(decimal_point);
                let text = number.as_deref().or(cell).map(String::from_utf8_lossy);
                bytes += text.as_ref().map_or(0, |text| text.len()) + CELL_BYTES;
                column.append_option(text);
            }
            if !is_whole {
                self.incomplete.push(line);
            }
            self.lines.push(line);
        }
        Ok(!self.lines.is_empty())
    }

    fn has_types(&self) -> bool {
        self.schema.fields().iter().any(|field| field.data_type() != &DataType::Utf8)
    }

    fn read_error(&self, error: &::csv::Error) -> CommandError {
        let is_of_length = matches!(error.kind(), ::csv::ErrorKind::UnequalLengths { .. });
        let hint = if is_of_length { format!("; {CONTINUE_HINT}") } else { String::new() };
        CommandError::invalid(&self.name, format!("{error}{hint}"))
    }

    fn encoding_error(&self, line: u64) -> CommandError {
        let at = self.record.iter().position(|cell| std::str::from_utf8(cell).is_err());
        let column = at.and_then(|at| self.schema.fields().get(at)).map_or("", |field| field.name());
        CommandError::invalid(
            &self.name,
            format!("line {line}, column {column}: not UTF-8 text; {CONTINUE_HINT}"),
        )
    }
}

impl Source for Csv {
    fn schema(&self) -> Option<SchemaRef> {
        Some(Arc::clone(&self.schema))
    }

    fn next(&mut self) -> Option<Result<RecordBatch, CommandError>> {
        match self.first.take() {
            Some(batch) => Some(Ok(batch)),
            None => self.read().transpose(),
        }
    }

    fn is_incomplete(&self, row: usize) -> bool {
        self.lines.get(row).is_some_and(|line| self.incomplete.binary_search(line).is_ok())
    }

    fn row_name(&self, row: usize) -> String {
        format!("line {}", self.lines.get(row).copied().unwrap_or_default())
    }
}

struct CsvSink<'a> {
    writer: Writer<Output<'a>>,
    is_verbatim: bool,
    /// Number of cells with a protective apostrophe.
    protected: usize,
}

pub(super) fn create<'a>(
    output: Output<'a>,
    schema: &Schema,
    options: OutputOptions,
) -> Result<Box<dyn Sink + 'a>, CommandError> {
    let writer = Writer::from_writer(output);
    let mut sink = CsvSink { writer, is_verbatim: options.is_verbatim, protected: 0 };
    for field in schema.fields() {
        sink.write_text(field.name().as_bytes())?;
    }
    sink.writer.write_record(None::<&[u8]>)?;
    Ok(Box::new(sink))
}

impl CsvSink<'_> {
    /// Writes a cell. A formula for spreadsheets gets an apostrophe in front, which makes it text.
    fn write_text(&mut self, text: &[u8]) -> Result<(), CommandError> {
        if self.is_verbatim || !is_spreadsheet_formula(text) {
            return Ok(self.writer.write_field(text)?);
        }
        self.protected += 1;
        Ok(self.writer.write_field([b"'", text].concat())?)
    }
}

impl Sink for CsvSink<'_> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), CommandError> {
        let batch = to_utc(batch)?;
        let options = FormatOptions::new();
        let cells: Vec<Cells<'_>> = batch
            .columns()
            .iter()
            .map(|column| Cells::new(column, &options))
            .collect::<Result<_, CommandError>>()?;
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

    fn finish(mut self: Box<Self>) -> Result<(), CommandError> {
        if self.protected > 0 {
            let cells = calib_site::counted(self.protected, "cell", "cells");
            print_message(format_args!(
                "calib: added an apostrophe to {cells} that a spreadsheet would read as a formula; add \
                 --verbatim to write cells unchanged"
            ));
        }
        Ok(self.writer.flush()?)
    }
}

/// Cells of a column, formatted in the shortest form that reads back as the same value.
enum Cells<'a> {
    Text(&'a arrow_array::StringArray),
    Double(&'a Float64Array),
    Single(&'a arrow_array::Float32Array),
    Other(&'a ArrayRef, ArrayFormatter<'a>),
}

impl<'a> Cells<'a> {
    fn new(column: &'a ArrayRef, options: &'a FormatOptions<'a>) -> Result<Self, CommandError> {
        Ok(match column.data_type() {
            DataType::Utf8 => Self::Text(column.as_string()),
            DataType::Float64 => Self::Double(column.as_primitive::<Float64Type>()),
            DataType::Float32 => Self::Single(column.as_primitive::<Float32Type>()),
            _ => Self::Other(column, ArrayFormatter::try_new(column, options)?),
        })
    }

    fn print(&self, row: usize, text: &mut Vec<u8>) -> Result<(), CommandError> {
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

/// Infers the type of a column from all its cells. Columns with mixed types stay text. So do numbers with leading
/// zeros, such as ids, and integers that exceed 64 bits.
pub(super) fn infer_type(column: &ArrayRef) -> DataType {
    let values = || column.as_string::<i32>().iter().flatten();
    let is_whole = |value: &str| value.parse::<i64>().is_ok_and(|number| number.to_string() == value);
    let has_zeros = |value: &str| {
        let digits = value.trim_start_matches('-');
        digits.starts_with('0') && digits[1..].starts_with(|c: char| c.is_ascii_digit())
    };
    let begins = |value: &str| value.starts_with(|c: char| matches!(c, '-' | '.') || c.is_ascii_digit());
    // An integer that exceeds 64 bits would lose its last digits as a double.
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

/// Parses the cells as a type. On failure, returns the first wrong row and a description of the expected
/// value.
pub(super) fn parse_as(column: &ArrayRef, kind: &DataType) -> Result<ArrayRef, (usize, &'static str)> {
    match kind {
        DataType::Int64 => parse_cells::<i64, Int64Array>(column, "a whole number"),
        DataType::Float64 => parse_cells::<f64, Float64Array>(column, "a number"),
        DataType::Boolean => parse_cells::<bool, BooleanArray>(column, "true or false"),
        _ => Ok(Arc::clone(column)),
    }
}

/// Parses every cell of a column as `T`. On failure, returns the first wrong row and `expected`.
fn parse_cells<T: FromStr, A: FromIterator<Option<T>> + Array + 'static>(
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

    fn inferred(cells: &[&str]) -> DataType {
        infer_type(&(Arc::new(StringArray::from_iter_values(cells)) as ArrayRef))
    }

    #[test]
    fn column_type_fits_all_cells() {
        assert_eq!(inferred(&["1", "-20"]), DataType::Int64);
        assert_eq!(inferred(&["1", "2.5", "-1e-3", ".5", "0.1"]), DataType::Float64);
        assert_eq!(inferred(&["true", "false"]), DataType::Boolean);
        for text in
            [&["007"][..], &["1", "n/a"], &["+1"], &["inf"], &["12345678901234567890"], &["00.5"], &[]]
        {
            assert_eq!(inferred(text), DataType::Utf8, "{text:?}");
        }
    }
}
