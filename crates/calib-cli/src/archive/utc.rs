//! Times of any zone as times of UTC: text has offsets and no names of zones.

use std::sync::Arc;

use arrow_array::{RecordBatch, RecordBatchOptions};
use arrow_cast::cast;
use arrow_schema::{DataType, Field, FieldRef, Schema};

use crate::stop::Stop;

/// The same instants, with the offset that is written.
pub(super) fn in_utc(batch: &RecordBatch) -> Result<RecordBatch, Stop> {
    let schema = batch.schema();
    if schema.fields().iter().all(|field| utc(field.data_type()) == *field.data_type()) {
        return Ok(batch.clone());
    }
    let fields: Vec<FieldRef> = schema.fields().iter().map(utc_field).collect();
    let columns = batch.columns().iter().zip(&fields).map(|(column, field)| cast(column, field.data_type()));
    let columns = columns.collect::<Result<_, _>>()?;
    let options = RecordBatchOptions::new().with_row_count(Some(batch.num_rows()));
    let schema = Arc::new(Schema::new(fields).with_metadata(schema.metadata().clone()));
    Ok(RecordBatch::try_new_with_options(schema, columns, &options)?)
}

fn utc_field(field: &FieldRef) -> FieldRef {
    Arc::new(Field::clone(field).with_data_type(utc(field.data_type())))
}

fn utc(kind: &DataType) -> DataType {
    match kind {
        DataType::Timestamp(unit, Some(_)) => DataType::Timestamp(*unit, Some("+00:00".into())),
        DataType::List(item) => DataType::List(utc_field(item)),
        DataType::LargeList(item) => DataType::LargeList(utc_field(item)),
        DataType::FixedSizeList(item, size) => DataType::FixedSizeList(utc_field(item), *size),
        DataType::Struct(fields) => DataType::Struct(fields.iter().map(utc_field).collect()),
        other => other.clone(),
    }
}
