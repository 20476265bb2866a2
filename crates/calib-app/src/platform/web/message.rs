//! What the page and its workers say to each other, in JSON.

use serde::de::DeserializeOwned;

/// Reads what was said, as text: a reader of bytes would have every type in the program a second time.
pub(crate) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let text = str::from_utf8(bytes).map_err(|error| error.to_string())?;
    serde_json::from_str(text).map_err(|error| error.to_string())
}
