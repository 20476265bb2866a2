//! Conversion of columns to the few types used for computing: doubles, integers, text, nanoseconds.
//!
//! Arrow's own `cast` converts between all types, but is not used: its code is larger than the rest of this crate,
//! including the dependencies.

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    Date32Type, Date64Type, Decimal32Type, Decimal64Type, Decimal128Type, Decimal256Type, Float16Type,
    Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, RunEndIndexType,
    TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType,
    UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef, ArrowPrimitiveType, Float64Array, Int64Array, StringArray, UInt64Array};
use arrow_cast::display::{ArrayFormatter, FormatOptions};
use arrow_schema::{ArrowError, DataType, TimeUnit};
use arrow_select::take::take;

/// Converts numbers of any type to doubles; `None` for a column of another type.
pub(crate) fn doubles(column: &ArrayRef) -> Option<Float64Array> {
    fn each<T: ArrowPrimitiveType>(column: &ArrayRef, value: impl Fn(T::Native) -> f64) -> Float64Array {
        column.as_primitive::<T>().unary(value)
    }
    fn scaled<T: ArrowPrimitiveType>(
        column: &ArrayRef,
        scale: i8,
        value: impl Fn(T::Native) -> f64,
    ) -> Float64Array {
        let tens = 10_f64.powi(i32::from(scale));
        each::<T>(column, |decimal| value(decimal) / tens)
    }
    Some(match *column.data_type() {
        DataType::Int8 => each::<Int8Type>(column, f64::from),
        DataType::Int16 => each::<Int16Type>(column, f64::from),
        DataType::Int32 => each::<Int32Type>(column, f64::from),
        DataType::Int64 => each::<Int64Type>(column, |value| value as f64),
        DataType::UInt8 => each::<UInt8Type>(column, f64::from),
        DataType::UInt16 => each::<UInt16Type>(column, f64::from),
        DataType::UInt32 => each::<UInt32Type>(column, f64::from),
        DataType::UInt64 => each::<UInt64Type>(column, |value| value as f64),
        DataType::Float16 => each::<Float16Type>(column, f64::from),
        DataType::Float32 => each::<Float32Type>(column, f64::from),
        DataType::Float64 => column.as_primitive::<Float64Type>().clone(),
        DataType::Decimal32(_, scale) => scaled::<Decimal32Type>(column, scale, f64::from),
        DataType::Decimal64(_, scale) => scaled::<Decimal64Type>(column, scale, |value| value as f64),
        DataType::Decimal128(_, scale) => scaled::<Decimal128Type>(column, scale, |value| value as f64),
        DataType::Decimal256(..) => {
            let decimals = column.as_primitive::<Decimal256Type>();
            let value = |row| decimals.is_valid(row).then(|| decimals.value_as_string(row).parse().ok());
            (0..decimals.len()).map(|row| value(row).flatten()).collect()
        }
        _ => return None,
    })
}

/// Converts integers of any type; `None` for a column of another type. Values that exceed 64 bits become
/// null.
pub(crate) fn whole_numbers(column: &ArrayRef) -> Option<Int64Array> {
    fn each<T: ArrowPrimitiveType<Native: Into<i64>>>(column: &ArrayRef) -> Int64Array {
        column.as_primitive::<T>().unary(Into::into)
    }
    Some(match column.data_type() {
        DataType::Int8 => each::<Int8Type>(column),
        DataType::Int16 => each::<Int16Type>(column),
        DataType::Int32 => each::<Int32Type>(column),
        DataType::Int64 => column.as_primitive::<Int64Type>().clone(),
        DataType::UInt8 => each::<UInt8Type>(column),
        DataType::UInt16 => each::<UInt16Type>(column),
        DataType::UInt32 => each::<UInt32Type>(column),
        DataType::UInt64 => column.as_primitive::<UInt64Type>().unary_opt(|value| i64::try_from(value).ok()),
        _ => return None,
    })
}

/// Converts times and dates to nanoseconds since 1970; `None` for a column of another type. Values that
/// exceed 64 bits become null.
pub(crate) fn nanoseconds(column: &ArrayRef) -> Option<Int64Array> {
    /// Length of a day, in nanoseconds.
    const DAY_NS: i64 = 86_400_000_000_000;
    fn each<T: ArrowPrimitiveType<Native: Into<i64>>>(column: &ArrayRef, unit: i64) -> Int64Array {
        column.as_primitive::<T>().unary_opt(|value| value.into().checked_mul(unit))
    }
    Some(match column.data_type() {
        DataType::Timestamp(TimeUnit::Second, _) => each::<TimestampSecondType>(column, 1_000_000_000),
        DataType::Timestamp(TimeUnit::Millisecond, _) => each::<TimestampMillisecondType>(column, 1_000_000),
        DataType::Timestamp(TimeUnit::Microsecond, _) => each::<TimestampMicrosecondType>(column, 1000),
        DataType::Timestamp(TimeUnit::Nanosecond, _) => each::<TimestampNanosecondType>(column, 1),
        DataType::Date32 => each::<Date32Type>(column, DAY_NS),
        DataType::Date64 => each::<Date64Type>(column, 1_000_000),
        _ => return None,
    })
}

/// Converts the values of a column to their printed text; fails for columns of lists or records.
pub(crate) fn texts(column: &ArrayRef) -> Result<StringArray, ArrowError> {
    fn utf8(bytes: Option<&[u8]>) -> Option<&str> {
        str::from_utf8(bytes?).ok()
    }
    if let Some(dictionary) = column.as_any_dictionary_opt() {
        let of_rows = take(&texts(dictionary.values())?, dictionary.keys(), None)?;
        return Ok(of_rows.as_string::<i32>().clone());
    }
    Ok(match column.data_type() {
        DataType::Utf8 => column.as_string::<i32>().clone(),
        DataType::LargeUtf8 => column.as_string::<i64>().iter().collect(),
        DataType::Utf8View => column.as_string_view().iter().collect(),
        DataType::Binary => column.as_binary::<i32>().iter().map(utf8).collect(),
        DataType::LargeBinary => column.as_binary::<i64>().iter().map(utf8).collect(),
        DataType::BinaryView => column.as_binary_view().iter().map(utf8).collect(),
        DataType::Null => StringArray::new_null(column.len()),
        DataType::RunEndEncoded(ends, _) => match ends.data_type() {
            DataType::Int16 => texts(&expand_runs::<Int16Type>(column)?)?,
            DataType::Int32 => texts(&expand_runs::<Int32Type>(column)?)?,
            _ => texts(&expand_runs::<Int64Type>(column)?)?,
        },
        kind if kind.is_nested() => {
            return Err(ArrowError::CastError(format!("found values of type {kind}")));
        }
        _ => {
            let options = FormatOptions::new();
            let printed = ArrayFormatter::try_new(column, &options)?;
            let text = |row| column.is_valid(row).then(|| printed.value(row).try_to_string()).transpose();
            (0..column.len()).map(text).collect::<Result<_, _>>()?
        }
    })
}

/// Expands a run-length encoded column to a column with one value per row.
fn expand_runs<E: RunEndIndexType>(column: &ArrayRef) -> Result<ArrayRef, ArrowError> {
    let runs = column.as_run::<E>();
    let of_row = (0..runs.len()).map(|row| runs.get_physical_index(row) as u64);
    take(runs.values(), &UInt64Array::from_iter_values(of_row), None)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::{
        BooleanArray, Date32Array, Decimal128Array, Decimal256Array, DictionaryArray, FixedSizeBinaryArray,
        Int32RunArray, RunArray, TimestampSecondArray, UInt8Array,
    };

    use super::*;

    fn printed(column: ArrayRef) -> Vec<Option<String>> {
        let texts = texts(&column).expect("values can be printed");
        texts.iter().map(|text| text.map(str::to_owned)).collect()
    }

    fn some(texts: [&str; 3]) -> Vec<Option<String>> {
        texts.map(|text| Some(text.to_owned())).to_vec()
    }

    #[test]
    fn all_number_types_convert_to_doubles() {
        let decimals = Decimal128Array::from(vec![Some(150), None, Some(-25)]);
        let decimals: ArrayRef = Arc::new(decimals.with_precision_and_scale(5, 2).expect("a decimal"));
        let expected = Float64Array::from(vec![Some(1.5), None, Some(-0.25)]);
        assert_eq!(doubles(&decimals), Some(expected.clone()));
        let wide = Decimal256Array::from(vec![Some(150.into()), None, Some((-25).into())]);
        let wide: ArrayRef = Arc::new(wide.with_precision_and_scale(50, 2).expect("a decimal"));
        assert_eq!(doubles(&wide), Some(expected));
        let small: ArrayRef = Arc::new(UInt8Array::from(vec![Some(255), None]));
        assert_eq!(doubles(&small), Some(Float64Array::from(vec![Some(255.0), None])));
        let flags: ArrayRef = Arc::new(BooleanArray::from(vec![true]));
        assert_eq!(doubles(&flags), None);
    }

    #[test]
    fn values_beyond_64_bits_are_null() {
        let huge: ArrayRef = Arc::new(UInt64Array::from(vec![7, u64::MAX]));
        assert_eq!(whole_numbers(&huge), Some(Int64Array::from(vec![Some(7), None])));
        let late: ArrayRef = Arc::new(TimestampSecondArray::from(vec![1, i64::MAX]));
        assert_eq!(nanoseconds(&late), Some(Int64Array::from(vec![Some(1_000_000_000), None])));
        let days: ArrayRef = Arc::new(Date32Array::from(vec![-1, i32::MAX]));
        assert_eq!(nanoseconds(&days), Some(Int64Array::from(vec![Some(-86_400_000_000_000), None])));
    }

    #[test]
    fn ids_of_all_types_convert_to_text() {
        assert_eq!(printed(Arc::new(Int64Array::from(vec![-1, 2, 30]))), some(["-1", "2", "30"]));
        let named: DictionaryArray<Int8Type> = ["door", "hall", "door"].into_iter().collect();
        assert_eq!(printed(Arc::new(named)), some(["door", "hall", "door"]));
        let numbers = DictionaryArray::<Int8Type>::new(
            vec![1, 0, 1].into(),
            Arc::new(Int64Array::from(vec![5, 6])) as ArrayRef,
        );
        assert_eq!(printed(Arc::new(numbers)), some(["6", "5", "6"]));
        let runs: Int32RunArray = ["door", "door", "hall"].into_iter().collect();
        assert_eq!(printed(Arc::new(runs.slice(0, 3))), some(["door", "door", "hall"]));
        let cut: RunArray<Int32Type> = ["gate", "door", "door", "hall"].into_iter().collect();
        assert_eq!(printed(Arc::new(cut.slice(1, 3))), some(["door", "door", "hall"]));
        let keys = FixedSizeBinaryArray::try_from_iter([[1_u8, 0xAB]].into_iter()).expect("two bytes");
        assert_eq!(printed(Arc::new(keys)), [Some("01ab".to_owned())]);
        let lists = arrow_array::ListArray::from_iter_primitive::<Int64Type, _, _>([Some([Some(1)])]);
        assert!(texts(&(Arc::new(lists) as ArrayRef)).is_err());
    }
}
