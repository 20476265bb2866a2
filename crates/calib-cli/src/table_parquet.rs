//! The table of cameras as Apache Parquet, for engines: what its JSON says, lists as lists.

use std::sync::Arc;

use arrow_json::ReaderBuilder;
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use serde_json::{Map, Value};

use crate::stop::Stop;

/// The rows of the table's document; what it says beside them becomes metadata.
pub(crate) fn encode(json: &[u8]) -> Result<Vec<u8>, Stop> {
    let mut about: Map<String, Value> = serde_json::from_slice(json)?;
    let Some(Value::Array(rows)) = about.remove("cameras") else { return Ok(Vec::new()) };
    let columns: Vec<Field> =
        rows.first().and_then(Value::as_object).into_iter().flatten().map(column).collect();
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let about = about.iter().map(|(key, value)| (key.clone(), text(value))).collect();
    let schema = Arc::new(Schema::new(columns).with_metadata(about));
    let mut decoder = ReaderBuilder::new(Arc::clone(&schema)).build_decoder()?;
    decoder.serialize(&rows)?;
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, schema, None)?;
    if let Some(batch) = decoder.flush()? {
        writer.write(&batch)?;
    }
    writer.close()?;
    Ok(bytes)
}

/// Matrices are lists of numbers, polygons lists of points; what is absent in the first row is text.
fn column((key, value): (&String, &Value)) -> Field {
    let list = |of| DataType::new_list(of, true);
    let kind = match value {
        Value::Number(number) if number.is_u64() => DataType::Int32,
        Value::Number(_) => DataType::Float64,
        Value::Array(_) if key.starts_with("valid_polygon") => list(list(DataType::Float64)),
        Value::Array(_) => list(DataType::Float64),
        _ => DataType::Utf8,
    };
    Field::new(key, kind, true)
}
