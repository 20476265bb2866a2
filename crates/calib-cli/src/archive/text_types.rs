//! What the cells of a column of text are, for formats whose columns have types.

use std::str::FromStr;
use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::{Array, ArrayRef, BooleanArray, Float64Array, Int64Array};
use arrow_schema::DataType;

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
