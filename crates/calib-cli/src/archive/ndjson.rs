//! NDJSON: values that are passed on to NDJSON stay as they were written; for other formats, the first
//! lines tell the types.

use std::borrow::Cow;
use std::io::{BufRead as _, BufReader, Read};
use std::sync::Arc;

use arrow_array::builder::StringBuilder;
use arrow_array::cast::AsArray as _;
use arrow_array::{
    Array, ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray, new_null_array,
};
use arrow_json::writer::{
    Encoder, EncoderFactory, EncoderOptions, LineDelimited, NullableEncoder, Writer, WriterBuilder,
};
use arrow_schema::ArrowError;
use arrow_schema::{DataType, Field, FieldRef, Schema, SchemaRef};
use serde::de::{Deserializer, Error as _, MapAccess, Visitor};
use serde_json::value::RawValue;

use super::arrow::in_utc;
use super::{
    BATCH_ROWS, CELL_BYTES, FIRST_ROWS, Format, GOES_ON, Input, MAX_COLUMNS, MAX_ROW_BYTES, Output, Packing,
    Purpose, Sink, Source, is_json, json_field, plain,
};
use crate::stop::Stop;

/// Text that a batch may have before it is handed on.
const BATCH_BYTES: usize = 64 << 20;

struct Lines {
    name: String,
    reader: BufReader<Box<dyn Read>>,
    to: &'static Format,
    keeps_broken: bool,
    /// The columns of a format that has the same ones in every row.
    types: Option<Vec<(String, DataType)>>,
    text: Vec<u8>,
    /// Of the last line read.
    line: u64,
    /// Line of every row of the last batch.
    lines: Vec<u64>,
    /// Of them, in the same order, those that are no JSON object.
    broken: Vec<u64>,
}

/// A column while its lines are read.
struct Column {
    name: String,
    values: StringBuilder,
}

pub(super) fn open(input: Input, purpose: Purpose<'_>) -> Result<Box<dyn Source>, Stop> {
    let Purpose { to, keeps_broken, .. } = purpose;
    let name = input.name.clone();
    let reader = BufReader::with_capacity(1 << 16, input.into_read());
    let (text, lines, broken) = (Vec::new(), Vec::new(), Vec::new());
    Ok(Box::new(Lines { name, reader, to, keeps_broken, types: None, text, line: 0, lines, broken }))
}

impl Lines {
    /// Whether every value can stay as it was written.
    fn passes_on(&self) -> bool {
        self.to.name == "ndjson"
    }

    /// Reads the next line that is not empty; whether there was one.
    fn read_line(&mut self) -> Result<bool, Stop> {
        loop {
            self.text.clear();
            self.line += 1;
            let count = self.reader.by_ref().take(MAX_ROW_BYTES).read_until(b'\n', &mut self.text);
            let count = count.map_err(|error| Stop::invalid(&self.name, error))?;
            if count as u64 == MAX_ROW_BYTES {
                let what = format!("line {}: longer than 64 MiB", self.line);
                return Err(Stop::invalid(&self.name, what));
            }
            if count == 0 || !self.text.trim_ascii().is_empty() {
                return Ok(count > 0);
            }
        }
    }

    /// Reads lines into columns.
    fn fill(&mut self) -> Result<Vec<Column>, Stop> {
        let most = if self.types.is_none() && !self.passes_on() { FIRST_ROWS } else { BATCH_ROWS };
        let mut columns = Vec::new();
        let mut bytes = 0;
        self.lines.clear();
        self.broken.clear();
        while self.lines.len() < most && bytes < BATCH_BYTES && self.read_line()? {
            let row = self.lines.len();
            let object = Object { columns: &mut columns, row };
            let mut json = serde_json::Deserializer::from_slice(&self.text);
            let read = json.deserialize_map(object).and_then(|()| json.end());
            if let Err(error) = read {
                if !self.keeps_broken {
                    let what =
                        format!("line {}: expected one JSON object a line: {error}; {GOES_ON}", self.line);
                    return Err(Stop::invalid(&self.name, what));
                }
                self.broken.push(self.line);
            }
            bytes += self.text.len() + CELL_BYTES * columns.len();
            self.lines.push(self.line);
        }
        for column in &mut columns {
            column.pad(self.lines.len());
        }
        Ok(columns)
    }

    /// Gives the columns the types that the first lines told.
    fn typed(&mut self, columns: Vec<(String, ArrayRef)>) -> Result<RecordBatch, Stop> {
        let has_types = self.to.is_typed;
        let types = self.types.get_or_insert_with(|| {
            let kind = |column| if has_types { kind(column) } else { DataType::Utf8 };
            columns.iter().map(|(name, column)| (name.clone(), kind(column))).collect()
        });
        if let Some((name, _)) = columns.iter().find(|(name, _)| types.iter().all(|(known, _)| known != name))
        {
            let what = format!(
                "{} or soon after: the key \"{name}\" is not in the first {FIRST_ROWS} lines, which tell the \
                 columns of {}; give it there as null, or write ndjson",
                self.place(0),
                self.to.name
            );
            return Err(Stop::invalid(&self.name, what));
        }
        let rows = self.lines.len();
        let mut fields = Vec::new();
        let mut arrays = Vec::new();
        for (name, kind) in types.iter() {
            let found = columns.iter().find(|(found, _)| found == name);
            fields.push(if kind == &DataType::Null {
                json_field(name)
            } else {
                Field::new(name, kind.clone(), true)
            });
            arrays.push(match found {
                None => new_null_array(fields[fields.len() - 1].data_type(), rows),
                Some((_, values)) => parsed(values, kind).map_err(|(row, expected)| {
                    let text = values.as_string::<i32>().value(row);
                    let what = format!(
                        "line {}, key {name}: found {text}, expected {expected} as in the first lines; write \
                         ndjson, or make the values one type",
                        self.lines[row]
                    );
                    Stop::invalid(&self.name, what)
                })?,
            });
        }
        Ok(RecordBatch::try_new(Arc::new(Schema::new(fields)), arrays)?)
    }
}

/// What the values of a column are; null where only JSON itself can say.
fn kind(column: &ArrayRef) -> DataType {
    let values = || column.as_string::<i32>().iter().flatten().filter(|value| *value != "null");
    let is_number = |value: &str| value.starts_with(|c: char| c == '-' || c.is_ascii_digit());
    let is_whole = |value: &str| value.parse::<i64>().is_ok();
    // A whole number that does not fit would lose its last digits as a double.
    let is_huge =
        |value: &str| value.bytes().all(|byte| byte == b'-' || byte.is_ascii_digit()) && !is_whole(value);
    if values().next().is_none() || values().any(is_huge) {
        DataType::Null
    } else if values().all(is_whole) {
        DataType::Int64
    } else if values().all(is_number) {
        DataType::Float64
    } else if values().all(|value| value.starts_with('"')) {
        DataType::Utf8
    } else if values().all(|value| matches!(value, "true" | "false")) {
        DataType::Boolean
    } else {
        DataType::Null
    }
}

/// JSON values as a type; else the first row that is not, and what it should be.
fn parsed(column: &ArrayRef, kind: &DataType) -> Result<ArrayRef, (usize, &'static str)> {
    let values = column.as_string::<i32>();
    fn all<'a, T: std::str::FromStr, A: FromIterator<Option<T>> + Array + 'static>(
        values: impl Iterator<Item = Option<&'a str>>,
        expected: &'static str,
    ) -> Result<ArrayRef, (usize, &'static str)> {
        let parsed = values.enumerate().map(|(row, value)| match value {
            None | Some("null") => Ok(None),
            Some(text) => text.parse().map(Some).map_err(|_| (row, expected)),
        });
        Ok(Arc::new(parsed.collect::<Result<A, _>>()?))
    }
    match kind {
        DataType::Int64 => all::<i64, Int64Array>(values.iter(), "a whole number"),
        DataType::Float64 => all::<f64, Float64Array>(values.iter(), "a number"),
        DataType::Boolean => all::<bool, BooleanArray>(values.iter(), "true or false"),
        DataType::Utf8 => Ok(plain(column)),
        _ => Ok(Arc::clone(column)),
    }
}

impl Source for Lines {
    fn schema(&self) -> Option<SchemaRef> {
        None
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        let columns = match self.fill() {
            Ok(_) if self.lines.is_empty() => return None,
            Ok(columns) => columns,
            Err(stop) => return Some(Err(stop)),
        };
        let columns: Vec<(String, ArrayRef)> = columns
            .into_iter()
            .map(|mut column| (column.name, Arc::new(column.values.finish()) as ArrayRef))
            .collect();
        if !self.passes_on() {
            return Some(self.typed(columns));
        }
        let fields: Vec<Field> = columns.iter().map(|(name, _)| json_field(name)).collect();
        let arrays = columns.into_iter().map(|(_, array)| array).collect();
        let options = arrow_array::RecordBatchOptions::new().with_row_count(Some(self.lines.len()));
        let batch = RecordBatch::try_new_with_options(Arc::new(Schema::new(fields)), arrays, &options);
        Some(batch.map_err(Stop::from))
    }

    fn is_broken(&self, row: usize) -> bool {
        self.lines.get(row).is_some_and(|line| self.broken.binary_search(line).is_ok())
    }

    fn place(&self, row: usize) -> String {
        format!("line {}", self.lines.get(row).copied().unwrap_or_default())
    }
}

impl Column {
    /// Rows that had no such key.
    fn pad(&mut self, rows: usize) {
        use arrow_array::builder::ArrayBuilder as _;
        let short = rows.saturating_sub(self.values.len());
        self.values.append_nulls(short);
    }
}

/// One line, read into the columns.
struct Object<'a> {
    columns: &'a mut Vec<Column>,
    row: usize,
}

impl<'de> Visitor<'de> for Object<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        use arrow_array::builder::ArrayBuilder as _;
        // Lines mostly have the same keys in the same order.
        let mut guess = 0;
        while let Some(key) = map.next_key::<Cow<'de, str>>()? {
            let value: &RawValue = map.next_value()?;
            let known = match self.columns.get(guess) {
                Some(column) if column.name == *key => Some(guess),
                _ => self.columns.iter().position(|column| column.name == *key),
            };
            let index = known.unwrap_or(self.columns.len());
            if known.is_none() {
                if index == MAX_COLUMNS {
                    return Err(A::Error::custom(format!("more than {MAX_COLUMNS} different keys")));
                }
                self.columns.push(Column { name: key.into_owned(), values: StringBuilder::new() });
            }
            let column = &mut self.columns[index];
            column.pad(self.row);
            if column.values.len() > self.row {
                return Err(A::Error::custom(format!("the key \"{}\" twice", column.name)));
            }
            column.values.append_value(value.get());
            guess = index + 1;
        }
        Ok(())
    }
}

struct NdjsonSink<'a>(Writer<Output<'a>, LineDelimited>);

pub(super) fn create<'a>(
    output: Output<'a>,
    _schema: &Schema,
    _packing: Packing,
) -> Result<Box<dyn Sink + 'a>, Stop> {
    let builder = WriterBuilder::new().with_encoder_factory(Arc::new(AsWritten));
    Ok(Box::new(NdjsonSink(builder.build(output))))
}

impl Sink for NdjsonSink<'_> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), Stop> {
        Ok(self.0.write(&in_utc(batch)?)?)
    }

    fn finish(mut self: Box<Self>) -> Result<(), Stop> {
        self.0.finish()?;
        Ok(self.0.get_mut().flush()?)
    }
}

/// Writes JSON values as they are.
#[derive(Debug)]
struct AsWritten;

impl EncoderFactory for AsWritten {
    fn make_default_encoder<'a>(
        &self,
        field: &'a FieldRef,
        array: &'a dyn Array,
        _options: &'a EncoderOptions,
    ) -> Result<Option<NullableEncoder<'a>>, ArrowError> {
        let values = array.as_string_opt::<i32>().filter(|_| is_json(field));
        Ok(values.map(|values| NullableEncoder::new(Box::new(Written(values)), values.nulls().cloned())))
    }
}

struct Written<'a>(&'a StringArray);

impl Encoder for Written<'_> {
    fn encode(&mut self, index: usize, out: &mut Vec<u8>) {
        out.extend_from_slice(self.0.value(index).as_bytes());
    }
}
