//! A document of JSON, told from the other files that are handed over in its place.

use std::fmt;

/// A file that is no document, by what it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotADocument(&'static str);

impl fmt::Display for NotADocument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "is {}, expected a site file: JSON text that begins with {{", self.0)
    }
}

impl std::error::Error for NotADocument {}

/// What files of other kinds begin with.
const BEGINNINGS: [(&[u8], &str); 9] = [
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"RIFF", "a WebP image or a video"),
    (b"PAR1", "a Parquet table"),
    (b"ARROW1", "an Arrow table"),
    (b"SQLite format 3", "an SQLite database"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"%PDF", "a PDF document"),
];

/// The text of a file that holds an object of JSON, as far as its first character tells; without the mark of byte order
/// that some editors write.
///
/// # Errors
/// What the file is in its place.
pub fn document(bytes: Vec<u8>) -> Result<String, NotADocument> {
    if let Some((_, what)) = BEGINNINGS.iter().find(|(beginning, _)| bytes.starts_with(beginning)) {
        return Err(NotADocument(what));
    }
    let mut text = String::from_utf8(bytes).map_err(|_| NotADocument("no text"))?;
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    match of_text(&text) {
        Some(what) => Err(NotADocument(what)),
        None => Ok(text),
    }
}

/// What a text is that is no object of JSON.
fn of_text(text: &str) -> Option<&'static str> {
    let begin = text.trim_start();
    let first = begin.lines().next().unwrap_or_default();
    match begin.chars().next() {
        Some('{') => None,
        None => Some("empty"),
        Some('[') => Some("a JSON list"),
        Some('<') => Some("XML or HTML"),
        _ if [',', ';', '\t'].iter().any(|&separator| first.contains(separator)) => Some("a table (CSV)"),
        _ => Some("other text"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_is_a_document_and_anything_else_is_called_by_its_kind() {
        assert_eq!(document(b"\xef\xbb\xbf \n{}".to_vec()).as_deref(), Ok(" \n{}"));
        let others: [(&[u8], &str); 9] = [
            (b"\x89PNG\r\n\x1a\n", "a PNG image"),
            (b"PAR1\x15\x04", "a Parquet table"),
            (b"\xff\xd8\xff\xe0", "a JPEG image"),
            (b"u,v\n1,2\n", "a table (CSV)"),
            (b"u\tv\n", "a table (CSV)"),
            (b"[{}]", "a JSON list"),
            (b"", "empty"),
            (b"\xc3\x28", "no text"),
            (b"hello", "other text"),
        ];
        for (bytes, what) in others {
            let said = document(bytes.to_vec()).unwrap_err().to_string();
            assert!(said.starts_with(&format!("is {what}, expected a site file")), "{said}");
        }
    }
}
