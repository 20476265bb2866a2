//! Columns of unparsed JSON values, as Arrow's canonical extension type `arrow.json`.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::{ArrayRef, StringArray};
use arrow_schema::{DataType, Field};

/// Metadata key of a field's extension type.
const EXTENSION_KEY: &str = "ARROW:extension:name";
/// Name of the extension type.
const JSON_EXTENSION: &str = "arrow.json";

/// Returns the field of a column of JSON values.
#[must_use]
pub fn json_field(name: &str) -> Field {
    Field::new(name, DataType::Utf8, true)
        .with_metadata(HashMap::from([(EXTENSION_KEY.to_owned(), JSON_EXTENSION.to_owned())]))
}

/// Whether a column contains JSON values.
#[must_use]
pub fn is_json(field: &Field) -> bool {
    field.data_type() == &DataType::Utf8
        && field.metadata().get(EXTENSION_KEY).is_some_and(|name| name == JSON_EXTENSION)
}

/// Converts JSON values to plain text: strings without quotes, null as null.
#[must_use]
pub fn plain(column: &ArrayRef) -> ArrayRef {
    let values = column.as_string::<i32>();
    let text = |value: &str| -> Option<String> {
        match value {
            "null" => None,
            quoted if quoted.starts_with('"') => serde_json::from_str(quoted).ok(),
            other => Some(other.to_owned()),
        }
    };
    if values.iter().flatten().all(|value| value != "null" && !value.starts_with('"')) {
        return Arc::clone(column);
    }
    Arc::new(values.iter().map(|value| value.and_then(text)).collect::<StringArray>())
}
