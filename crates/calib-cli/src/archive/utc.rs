//! Times of any zone as times of UTC: text has offsets and no names of zones.

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType,
};
use arrow_array::{
    Array as _, ArrayRef, FixedSizeListArray, LargeListArray, ListArray, RecordBatch, RecordBatchOptions,
    StructArray,
};
use arrow_schema::{ArrowError, DataType, Field, FieldRef, Schema, TimeUnit};

use crate::stop::Stop;

/// As it is written in text.
const UTC: &str = "+00:00";

/// The same instants, with the offset that is written.
pub(super) fn in_utc(batch: &RecordBatch) -> Result<RecordBatch, Stop> {
    let schema = batch.schema();
    let columns = batch.columns().iter().map(column_in_utc).collect::<Result<Vec<_>, _>>()?;
    let fields: Vec<FieldRef> =
        schema.fields().iter().zip(&columns).map(|(field, column)| field_of(field, column)).collect();
    let options = RecordBatchOptions::new().with_row_count(Some(batch.num_rows()));
    let schema = Arc::new(Schema::new(fields).with_metadata(schema.metadata().clone()));
    Ok(RecordBatch::try_new_with_options(schema, columns, &options)?)
}

/// Times of a zone are counted in UTC as they lie: only what is said of them changes.
fn column_in_utc(column: &ArrayRef) -> Result<ArrayRef, ArrowError> {
    Ok(match column.data_type() {
        DataType::Timestamp(unit, Some(_)) => match unit {
            TimeUnit::Second => {
                Arc::new(column.as_primitive::<TimestampSecondType>().clone().with_timezone(UTC))
            }
            TimeUnit::Millisecond => {
                Arc::new(column.as_primitive::<TimestampMillisecondType>().clone().with_timezone(UTC))
            }
            TimeUnit::Microsecond => {
                Arc::new(column.as_primitive::<TimestampMicrosecondType>().clone().with_timezone(UTC))
            }
            TimeUnit::Nanosecond => {
                Arc::new(column.as_primitive::<TimestampNanosecondType>().clone().with_timezone(UTC))
            }
        },
        DataType::List(_) => {
            let (item, ends, values, nulls) = column.as_list::<i32>().clone().into_parts();
            let values = column_in_utc(&values)?;
            Arc::new(ListArray::try_new(field_of(&item, &values), ends, values, nulls)?)
        }
        DataType::LargeList(_) => {
            let (item, ends, values, nulls) = column.as_list::<i64>().clone().into_parts();
            let values = column_in_utc(&values)?;
            Arc::new(LargeListArray::try_new(field_of(&item, &values), ends, values, nulls)?)
        }
        DataType::FixedSizeList(..) => {
            let (item, size, values, nulls) = column.as_fixed_size_list().clone().into_parts();
            let values = column_in_utc(&values)?;
            let item = field_of(&item, &values);
            Arc::new(FixedSizeListArray::try_new_with_length(item, size, values, nulls, column.len())?)
        }
        DataType::Struct(_) => {
            let (fields, columns, nulls) = column.as_struct().clone().into_parts();
            let columns = columns.iter().map(column_in_utc).collect::<Result<Vec<_>, _>>()?;
            let fields = fields.iter().zip(&columns).map(|(field, column)| field_of(field, column)).collect();
            Arc::new(StructArray::try_new_with_length(fields, columns, nulls, column.len())?)
        }
        _ => Arc::clone(column),
    })
}

/// A field that says what its column holds now.
fn field_of(field: &FieldRef, column: &ArrayRef) -> FieldRef {
    Arc::new(Field::clone(field).with_data_type(column.data_type().clone()))
}

#[cfg(test)]
mod tests {
    use arrow_array::types::Int32Type;
    use arrow_array::{DictionaryArray, TimestampMillisecondArray};
    use arrow_buffer::OffsetBuffer;

    use super::*;

    fn times(zone: &str) -> ArrayRef {
        Arc::new(TimestampMillisecondArray::from(vec![Some(0), None, Some(-5)]).with_timezone(zone))
    }

    #[test]
    fn times_of_a_zone_are_the_same_instants_of_utc_however_deep_they_lie() {
        let nested = |zone: &str| -> ArrayRef {
            let item = Arc::new(Field::new("item", times(zone).data_type().clone(), true));
            let ends = OffsetBuffer::from_lengths([2, 0, 1]);
            let lists: ArrayRef = Arc::new(ListArray::new(item, ends, times(zone), None));
            let item = Arc::new(Field::new("item", times(zone).data_type().clone(), true));
            let none = FixedSizeListArray::try_new_with_length(item, 0, times(zone).slice(0, 0), None, 3);
            let none: ArrayRef = Arc::new(none.expect("three lists of nothing"));
            let named = |name: &str, of: &ArrayRef| Arc::new(Field::new(name, of.data_type().clone(), true));
            Arc::new(StructArray::from(vec![
                (named("at", &times(zone)), times(zone)),
                (named("all", &lists), lists),
                (named("none", &none), none),
            ]))
        };
        let kept: ArrayRef = Arc::new(["a", "b", "a"].into_iter().collect::<DictionaryArray<Int32Type>>());
        let batch = |zone| RecordBatch::try_from_iter([("seen", nested(zone)), ("door", Arc::clone(&kept))]);
        let found = in_utc(&batch("Asia/Kathmandu").expect("a batch")).ok();
        assert_eq!(found, batch(UTC).ok());
    }
}
