//! Errors in a site file: position, kind, and the camera and annotation concerned.

use std::fmt;

/// Error in a site file, with its position.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteError {
    /// JSON pointer (RFC 6901) to the invalid value.
    pub pointer: String,
    /// Kind of error.
    pub kind: SiteErrorKind,
    /// Camera and annotation that contain the value; `None` if the value does not belong to a camera.
    pub subject: Option<Box<ErrorSubject>>,
}

/// Kind of an error in a site file.
#[derive(Clone, Debug, PartialEq)]
pub enum SiteErrorKind {
    /// The text is not JSON, or not a site document.
    Unreadable {
        /// Message of the JSON reader.
        why: String,
        /// Line and column in the text.
        at: Option<[usize; 2]>,
    },
    /// The document is longer than the limit.
    TooLong {
        /// Length, in bytes.
        bytes: usize,
        /// Largest accepted length, in bytes.
        most: usize,
    },
    /// The document has more values than the limit.
    TooManyValues {
        /// Approximate number of values.
        values: usize,
        /// Largest accepted number of values.
        most: usize,
    },
    /// The value is not allowed at this position.
    Unexpected {
        /// Invalid value, as text.
        found: String,
        /// Description of the allowed values.
        expected: String,
    },
}

/// Camera and annotation that contain an invalid value, with the names that the operator gave them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ErrorSubject {
    /// Id of the camera.
    pub camera: String,
    /// Annotation of this camera that contains the value; `None` if no annotation contains it.
    pub annotation: Option<NamedAnnotation>,
}

/// Annotation that contains an invalid value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedAnnotation {
    /// Kind of the annotation.
    pub kind: String,
    /// Name of the annotation, or its id if it has no name.
    pub name: Option<String>,
    /// Index of the annotation in the list, as in the pointer.
    pub index: String,
}

impl SiteError {
    /// Creates an error about the document as a whole.
    pub(crate) const fn for_document(kind: SiteErrorKind) -> Self {
        Self { pointer: String::new(), kind, subject: None }
    }

    /// Returns the message: the value that was found, the expected value, and the camera and annotation.
    #[must_use]
    pub fn message(&self) -> String {
        match &self.subject {
            Some(subject) => format!("{} ({subject})", self.kind),
            None => self.kind.to_string(),
        }
    }
}

impl fmt::Display for SiteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let pointer = if self.pointer.is_empty() { "the document" } else { &self.pointer };
        write!(f, "{pointer}: {}", self.message())
    }
}

impl std::error::Error for SiteError {}

impl fmt::Display for SiteErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable { why, at: None } => f.write_str(why),
            Self::Unreadable { why, at: Some([line, column]) } => {
                write!(f, "{why} at line {line} column {column}")
            }
            Self::TooLong { bytes, most } => write!(f, "found {bytes} bytes, expected at most {most}"),
            Self::TooManyValues { values, most } => {
                write!(f, "found about {values} values, expected at most {most}")
            }
            Self::Unexpected { found, expected } => write!(f, "found {found}, expected {expected}"),
        }
    }
}

impl fmt::Display for ErrorSubject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "camera {}", quoted(&self.camera))?;
        let Some(NamedAnnotation { kind, name, index }) = &self.annotation else { return Ok(()) };
        write!(f, ", {kind}")?;
        if let Some(name) = name {
            write!(f, " {}", quoted(name))?;
        }
        write!(f, " (annotation {index})")
    }
}

/// Quotes a text from the document. Long texts are cut, so that a hostile file cannot fill the screen.
pub(crate) fn quoted(text: &str) -> String {
    const MAX_QUOTED_CHARS: usize = 60;
    let short: String = text.chars().take(MAX_QUOTED_CHARS).collect();
    if short.len() < text.len() { format!("{short:?}...") } else { format!("{short:?}") }
}

/// Translates an error of the JSON reader into terms of the site file.
///
/// This function has to parse the message, because the reader provides the expected type only there.
pub(crate) fn kind_from_json_error(error: &serde_json::Error) -> SiteErrorKind {
    const REPLACEMENTS: [(&str, &str); 9] = [
        ("expected f64", "expected a number, without quotes"),
        ("expected u32", "expected a whole number, without quotes"),
        (
            "expected struct Known",
            "expected {\"value\": ..., \"fixed\": true} or {\"value\": ..., \"sigma\": ...}",
        ),
        ("expected a string", "expected text in quotes"),
        ("expected a sequence", "expected a list in [ ]"),
        ("expected a map", "expected an object in { }"),
        ("EOF while parsing", "the file ends too early: a bracket or quote is not closed in"),
        (
            "trailing characters",
            "unexpected text: an extra value, or a bracket that is missing or closed too early",
        ),
        ("invalid type:", "found"),
    ];
    let at = [error.line(), error.column()];
    let message = error.to_string();
    let text = message.strip_suffix(&format!(" at line {} column {}", at[0], at[1]));
    let start = text.unwrap_or(&message).to_owned();
    let why = REPLACEMENTS.iter().fold(start, |why, (from, to)| why.replace(from, to));
    SiteErrorKind::Unreadable { why, at: text.map(|_| at) }
}
