//! The table of cameras as Apache Parquet, for engines: what its JSON says, lists as lists.

use std::sync::Arc;

use arrow_array::builder::{Float64Builder, ListBuilder};
use arrow_array::types::Float64Type;
use arrow_array::{
    ArrayRef, Float64Array, Int32Array, ListArray, RecordBatch, RecordBatchOptions, StringArray,
};
use arrow_schema::{Field, Schema};
use parquet::arrow::ArrowWriter;
use serde_json::{Map, Value};

use crate::stop::Stop;

/// The rows of the table's document; what it says beside them becomes metadata.
pub(crate) fn encode(json: &[u8]) -> Result<Vec<u8>, Stop> {
    let mut about: Map<String, Value> = serde_json::from_slice(json)?;
    let Some(Value::Array(rows)) = about.remove("cameras") else { return Ok(Vec::new()) };
    let first = rows.first().and_then(Value::as_object).into_iter().flatten();
    let (fields, columns): (Vec<Field>, Vec<ArrayRef>) = first
        .map(|(key, value)| {
            let values = column(key, value, &rows);
            (Field::new(key, values.data_type().clone(), true), values)
        })
        .unzip();
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let about = about.iter().map(|(key, value)| (key.clone(), text(value))).collect();
    let schema = Arc::new(Schema::new(fields).with_metadata(about));
    let count = RecordBatchOptions::new().with_row_count(Some(rows.len()));
    let batch = RecordBatch::try_new_with_options(Arc::clone(&schema), columns, &count)?;
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, schema, None)?;
    writer.write(&batch)?;
    writer.close()?;
    Ok(bytes)
}

/// One value of every row; the first row's says what they are. Matrices are lists of numbers, polygons lists of
/// points; what is absent in the first row is text.
fn column(key: &str, first: &Value, rows: &[Value]) -> ArrayRef {
    let values = rows.iter().map(|row| row.get(key));
    let numbers = |value: &Value| Some(value.as_array()?.iter().map(Value::as_f64).collect::<Vec<_>>());
    match first {
        Value::Number(number) if number.is_u64() => {
            Arc::new(values.map(|value| value?.as_i64()?.try_into().ok()).collect::<Int32Array>())
        }
        Value::Number(_) => Arc::new(values.map(|value| value?.as_f64()).collect::<Float64Array>()),
        Value::Array(_) if key.starts_with("valid_polygon") => {
            let mut polygons = ListBuilder::new(ListBuilder::new(Float64Builder::new()));
            for value in values {
                let points = value.and_then(Value::as_array);
                for point in points.into_iter().flatten() {
                    polygons.values().append_option(numbers(point));
                }
                polygons.append(points.is_some());
            }
            Arc::new(polygons.finish())
        }
        Value::Array(_) => {
            Arc::new(ListArray::from_iter_primitive::<Float64Type, _, _>(values.map(|value| numbers(value?))))
        }
        _ => Arc::new(values.map(|value| Some(value?.as_str()?.to_owned())).collect::<StringArray>()),
    }
}
