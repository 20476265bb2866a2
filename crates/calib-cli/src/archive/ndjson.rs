//! NDJSON tables. Values stay unchanged in NDJSON output. For other formats, the types are inferred from the
//! first lines.

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

use super::arrow::to_utc;
use super::{
    BATCH_ROWS, CELL_BYTES, CONTINUE_HINT, Format, Input, MAX_COLUMNS, MAX_ROW_BYTES, Output, OutputOptions,
    ReadOptions, Sink, Source, TYPE_INFERENCE_ROWS, is_json, json_field, plain,
};
use crate::stop::CommandError;

/// Size at which a batch ends, in bytes: its text, and [`CELL_BYTES`] for each cell.
const BATCH_BYTES: usize = 64 << 20;

struct NdjsonSource {
    name: String,
    reader: BufReader<Box<dyn Read>>,
    to: &'static Format,
    keeps_incomplete: bool,
    /// Columns with types, for output formats with the same columns in every row.
    types: Option<Vec<(String, DataType)>>,
    text: Vec<u8>,
    /// Number of the last line read.
    line: u64,
    /// Line number of each row of the last batch.
    lines: Vec<u64>,
    /// Line numbers of the lines that are not JSON objects, in ascending order.
    incomplete: Vec<u64>,
}

/// Column of a batch while its lines are read.
struct Column {
    name: String,
    values: StringBuilder,
}

pub(super) fn open(input: Input, purpose: ReadOptions<'_>) -> Result<Box<dyn Source>, CommandError> {
    let ReadOptions { to, keeps_incomplete, .. } = purpose;
    let name = input.name.clone();
    let reader = BufReader::with_capacity(1 << 16, input.into_read());
    let (text, lines, broken) = (Vec::new(), Vec::new(), Vec::new());
    Ok(Box::new(NdjsonSource {
        name,
        reader,
        to,
        keeps_incomplete,
        types: None,
        text,
        line: 0,
        lines,
        incomplete: broken,
    }))
}

impl NdjsonSource {
    /// Whether the output keeps the text of every value.
    fn keeps_text(&self) -> bool {
        self.to.name == "ndjson"
    }

    /// Reads the next line that is not empty, and returns whether there was one.
    fn read_line(&mut self) -> Result<bool, CommandError> {
        loop {
            self.text.clear();
            self.line += 1;
            let count = self.reader.by_ref().take(MAX_ROW_BYTES).read_until(b'\n', &mut self.text);
            let count = count.map_err(|error| CommandError::invalid(&self.name, error))?;
            if count as u64 == MAX_ROW_BYTES {
                let what = format!("line {}: longer than 64 MiB; write one JSON object per line", self.line);
                return Err(CommandError::invalid(&self.name, what));
            }
            if count == 0 || !self.text.trim_ascii().is_empty() {
                return Ok(count > 0);
            }
        }
    }

    /// Reads the lines of a batch into columns.
    fn fill(&mut self) -> Result<Vec<Column>, CommandError> {
        let most = if self.types.is_none() && !self.keeps_text() { TYPE_INFERENCE_ROWS } else { BATCH_ROWS };
        let mut columns = Vec::new();
        let mut bytes = 0;
        self.lines.clear();
        self.incomplete.clear();
        while self.lines.len() < most && bytes < BATCH_BYTES && self.read_line()? {
            let row = self.lines.len();
            let object = LineVisitor { columns: &mut columns, row };
            let mut json = serde_json::Deserializer::from_slice(&self.text);
            let read = json.deserialize_map(object).and_then(|()| json.end());
            if let Err(error) = read {
                if !self.keeps_incomplete {
                    let what = format!(
                        "line {}: expected one JSON object per line: {error}; {CONTINUE_HINT}",
                        self.line
                    );
                    return Err(CommandError::invalid(&self.name, what));
                }
                self.incomplete.push(self.line);
            }
            bytes += self.text.len() + CELL_BYTES * columns.len();
            self.lines.push(self.line);
        }
        for column in &mut columns {
            column.pad(self.lines.len());
        }
        Ok(columns)
    }

    /// Converts the columns to the types inferred from the first lines.
    fn with_types(&mut self, columns: Vec<(String, ArrayRef)>) -> Result<RecordBatch, CommandError> {
        let has_types = self.to.is_typed;
        let types = self.types.get_or_insert_with(|| {
            let kind = |column| if has_types { infer_type(column) } else { DataType::Utf8 };
            columns.iter().map(|(name, column)| (name.clone(), kind(column))).collect()
        });
        if let Some((name, _)) = columns.iter().find(|(name, _)| types.iter().all(|(known, _)| known != name))
        {
            let what = format!(
                "{} or soon after: the key \"{name}\" is missing in the first {TYPE_INFERENCE_ROWS} lines, which \
                 determine the columns of the {} output; add it to the first line as null, or use --format ndjson",
                self.row_name(0),
                self.to.name
            );
            return Err(CommandError::invalid(&self.name, what));
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
                Some((_, values)) => parse_as(values, kind).map_err(|(row, expected)| {
                    let text = values.as_string::<i32>().value(row);
                    let what = format!(
                        "line {}, key {name}: found {text}, expected {expected} as in the first lines; use \
                         --format ndjson, or give all values the same type",
                        self.lines[row]
                    );
                    CommandError::invalid(&self.name, what)
                })?,
            });
        }
        Ok(RecordBatch::try_new(Arc::new(Schema::new(fields)), arrays)?)
    }
}

/// Infers the type of a column from its values; [`DataType::Null`] for a column that must stay JSON.
fn infer_type(column: &ArrayRef) -> DataType {
    let values = || column.as_string::<i32>().iter().flatten().filter(|value| *value != "null");
    let is_number = |value: &str| value.starts_with(|c: char| c == '-' || c.is_ascii_digit());
    let is_whole = |value: &str| value.parse::<i64>().is_ok();
    // An integer that exceeds 64 bits would lose its last digits as a double.
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

/// Parses JSON values as a type. On failure, returns the first wrong row and a description of the expected
/// value.
fn parse_as(column: &ArrayRef, kind: &DataType) -> Result<ArrayRef, (usize, &'static str)> {
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

impl Source for NdjsonSource {
    fn schema(&self) -> Option<SchemaRef> {
        None
    }

    fn next(&mut self) -> Option<Result<RecordBatch, CommandError>> {
        let columns = match self.fill() {
            Ok(_) if self.lines.is_empty() => return None,
            Ok(columns) => columns,
            Err(error) => return Some(Err(error)),
        };
        let columns: Vec<(String, ArrayRef)> = columns
            .into_iter()
            .map(|mut column| (column.name, Arc::new(column.values.finish()) as ArrayRef))
            .collect();
        if !self.keeps_text() {
            return Some(self.with_types(columns));
        }
        let fields: Vec<Field> = columns.iter().map(|(name, _)| json_field(name)).collect();
        let arrays = columns.into_iter().map(|(_, array)| array).collect();
        let options = arrow_array::RecordBatchOptions::new().with_row_count(Some(self.lines.len()));
        let batch = RecordBatch::try_new_with_options(Arc::new(Schema::new(fields)), arrays, &options);
        Some(batch.map_err(CommandError::from))
    }

    fn is_incomplete(&self, row: usize) -> bool {
        self.lines.get(row).is_some_and(|line| self.incomplete.binary_search(line).is_ok())
    }

    fn row_name(&self, row: usize) -> String {
        format!("line {}", self.lines.get(row).copied().unwrap_or_default())
    }
}

impl Column {
    /// Adds nulls for rows without this key.
    fn pad(&mut self, rows: usize) {
        use arrow_array::builder::ArrayBuilder as _;
        let short = rows.saturating_sub(self.values.len());
        self.values.append_nulls(short);
    }
}

/// Visitor that reads one line into the columns.
struct LineVisitor<'a> {
    columns: &'a mut Vec<Column>,
    row: usize,
}

impl<'de> Visitor<'de> for LineVisitor<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        use arrow_array::builder::ArrayBuilder as _;
        // Lines usually have the same keys in the same order, so the next column is tried first.
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
                return Err(A::Error::custom(format!("duplicate key \"{}\"", column.name)));
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
    _options: OutputOptions,
) -> Result<Box<dyn Sink + 'a>, CommandError> {
    let builder = WriterBuilder::new().with_encoder_factory(Arc::new(UnchangedJson));
    Ok(Box::new(NdjsonSink(builder.build(output))))
}

impl Sink for NdjsonSink<'_> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), CommandError> {
        Ok(self.0.write(&to_utc(batch)?)?)
    }

    fn finish(mut self: Box<Self>) -> Result<(), CommandError> {
        self.0.finish()?;
        Ok(self.0.get_mut().flush()?)
    }
}

/// Encoder factory that writes JSON columns unchanged.
#[derive(Debug)]
struct UnchangedJson;

impl EncoderFactory for UnchangedJson {
    fn make_default_encoder<'a>(
        &self,
        field: &'a FieldRef,
        array: &'a dyn Array,
        _options: &'a EncoderOptions,
    ) -> Result<Option<NullableEncoder<'a>>, ArrowError> {
        let values = array.as_string_opt::<i32>().filter(|_| is_json(field));
        Ok(values.map(|values| NullableEncoder::new(Box::new(JsonText(values)), values.nulls().cloned())))
    }
}

struct JsonText<'a>(&'a StringArray);

impl Encoder for JsonText<'_> {
    fn encode(&mut self, index: usize, out: &mut Vec<u8>) {
        out.extend_from_slice(self.0.value(index).as_bytes());
    }
}
