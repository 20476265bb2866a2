//! CSV: every column is text, and stays as it is.

use std::cell::Cell;
use std::io::{Read, Write as _};
use std::rc::Rc;
use std::sync::Arc;

use ::arrow::array::{Array, ArrayRef, AsArray as _, RecordBatch, StringBuilder};
use ::arrow::datatypes::{DataType, Field, Float32Type, Float64Type, Schema, SchemaRef};
use ::arrow::util::display::{ArrayFormatter, FormatOptions};
use ::csv::{ByteRecord, Reader, Writer};

use calib_formats::runs_in_spreadsheets;

use super::utc::in_utc;
use super::{
    BATCH_ROWS, CELL_BYTES, Format, Input, MAX_COLUMNS, MAX_ROW_BYTES, Output, Packing, Sink, Source,
};
use crate::files::say;
use crate::stop::Stop;

/// Text that a batch may have before it is handed on.
const BATCH_BYTES: usize = 16 << 20;

struct Csv {
    name: String,
    reader: Reader<Limited>,
    left: Rc<Cell<u64>>,
    schema: SchemaRef,
    record: ByteRecord,
    /// Line of every row of the last batch.
    lines: Vec<u64>,
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

pub(super) fn open(input: Input, _to: &'static Format) -> Result<Box<dyn Source>, Stop> {
    let (name, left) = (input.name.clone(), Rc::new(Cell::new(MAX_ROW_BYTES)));
    let limited = Limited { from: input.into_read(), left: Rc::clone(&left) };
    let mut reader = Reader::from_reader(limited);
    let header = reader.headers().map_err(|error| Stop::invalid(&name, error))?;
    if header.len() > MAX_COLUMNS {
        let what = format!("found {} columns, expected at most {MAX_COLUMNS}", header.len());
        return Err(Stop::invalid(&name, what));
    }
    let fields: Vec<Field> =
        header.iter().map(|column| Field::new(column.trim(), DataType::Utf8, true)).collect();
    let schema = Arc::new(Schema::new(fields));
    Ok(Box::new(Csv { name, reader, left, schema, record: ByteRecord::new(), lines: Vec::new() }))
}

impl Csv {
    /// Reads rows into the builders; whether there were any.
    fn fill(&mut self, columns: &mut [StringBuilder]) -> Result<bool, Stop> {
        self.lines.clear();
        let mut bytes = 0;
        while self.lines.len() < BATCH_ROWS && bytes < BATCH_BYTES {
            self.left.set(MAX_ROW_BYTES);
            let more = self.reader.read_byte_record(&mut self.record);
            if !more.map_err(|error| Stop::invalid(&self.name, error))? {
                break;
            }
            let line = self.record.position().map_or(0, ::csv::Position::line);
            for (index, (column, cell)) in columns.iter_mut().zip(&self.record).enumerate() {
                let text = std::str::from_utf8(cell).map_err(|_| {
                    let column = self.schema.field(index).name();
                    Stop::invalid(&self.name, format!("line {line}, column {column}: not UTF-8 text"))
                })?;
                column.append_option((!text.is_empty()).then_some(text));
                bytes += text.len() + CELL_BYTES;
            }
            self.lines.push(line);
        }
        Ok(!self.lines.is_empty())
    }
}

impl Source for Csv {
    fn schema(&self) -> Option<SchemaRef> {
        Some(Arc::clone(&self.schema))
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        let count = self.schema.fields().len();
        let rows = BATCH_ROWS.min(BATCH_BYTES / CELL_BYTES / count.max(1));
        let mut columns: Vec<StringBuilder> =
            (0..count).map(|_| StringBuilder::with_capacity(rows, 0)).collect();
        match self.fill(&mut columns) {
            Ok(true) => {}
            Ok(false) => return None,
            Err(stop) => return Some(Err(stop)),
        }
        let columns = columns.iter_mut().map(|column| Arc::new(column.finish()) as ArrayRef).collect();
        Some(RecordBatch::try_new(Arc::clone(&self.schema), columns).map_err(Stop::from))
    }

    fn place(&self, row: usize) -> String {
        format!("line {}", self.lines.get(row).copied().unwrap_or_default())
    }
}

struct CsvSink<'a> {
    writer: Writer<Output<'a>>,
    is_verbatim: bool,
    /// Cells that got an apostrophe.
    quoted: u64,
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
        if self.is_verbatim || !runs_in_spreadsheets(text) {
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
            say(format_args!(
                "calib: {} cells that a spreadsheet would take for a formula begin with an apostrophe; --verbatim \
                 writes them as they are",
                self.quoted
            ));
        }
        Ok(self.writer.flush()?)
    }
}

/// The cells of a column, in the shortest form that is read back as the same value.
enum Cells<'a> {
    Text(&'a ::arrow::array::StringArray),
    Double(&'a ::arrow::array::Float64Array),
    Single(&'a ::arrow::array::Float32Array),
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
