//! What is wrong with a site file: where, about whom, and what, in words once.

use std::fmt;

/// What is wrong with a site file, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteError {
    /// JSON pointer (RFC 6901) of the value that is wrong.
    pub pointer: String,
    /// What is wrong with it.
    pub fault: Fault,
    /// The camera whose entry it is in.
    pub about: Option<Box<About>>,
}

/// What is wrong with a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// It is not JSON, or not JSON of this document.
    Unreadable {
        /// What the JSON reader says.
        why: String,
        /// Where in the text, by line and column.
        at: Option<[usize; 2]>,
    },
    /// The document is longer than any that is read.
    TooLong {
        /// Its length, in bytes.
        bytes: usize,
        /// The longest that is read.
        most: usize,
    },
    /// The document has more values than any that is read.
    TooManyValues {
        /// About how many it has.
        values: usize,
        /// The most that are read.
        most: usize,
    },
    /// It is there and cannot be so.
    Unexpected {
        /// What was found.
        found: String,
        /// What can be so.
        expected: String,
    },
}

/// Whose entry something is in, by the names the operator gave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct About {
    /// Id of the camera.
    pub camera: String,
    /// The annotation of that camera.
    pub annotation: Option<NamedAnnotation>,
}

/// An annotation as its entry names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedAnnotation {
    /// What its kind is called.
    pub kind: String,
    /// Its name, or else its id.
    pub name: Option<String>,
    /// Its place in the list, as the pointer has it.
    pub place: String,
}

impl SiteError {
    /// An error about the document as a whole.
    pub(crate) const fn of_document(fault: Fault) -> Self {
        Self { pointer: String::new(), fault, about: None }
    }

    /// What was found and what is expected, and about whom.
    #[must_use]
    pub fn message(&self) -> String {
        match &self.about {
            Some(about) => format!("{} ({about})", self.fault),
            None => self.fault.to_string(),
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

impl fmt::Display for Fault {
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

impl fmt::Display for About {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "camera {}", quoted(&self.camera))?;
        let Some(NamedAnnotation { kind, name, place }) = &self.annotation else { return Ok(()) };
        write!(f, ", {kind}")?;
        if let Some(name) = name {
            write!(f, " {}", quoted(name))?;
        }
        write!(f, " (annotation {place})")
    }
}

/// A text from the document; a hostile one does not fill the screen.
pub(crate) fn quoted(text: &str) -> String {
    const MOST: usize = 60;
    let short: String = text.chars().take(MOST).collect();
    if short.len() < text.len() { format!("{short:?}...") } else { format!("{short:?}") }
}

/// What the JSON reader says, in the words of somebody who writes a site file.
///
/// This is the only place that looks into a sentence: the reader tells what it expected in its message and
/// nowhere else.
pub(crate) fn in_plain_words(error: &serde_json::Error) -> Fault {
    const WORDS: [(&str, &str); 9] = [
        ("expected f64", "expected a number, without quotes"),
        ("expected u32", "expected a whole number, without quotes"),
        (
            "expected struct Known",
            "expected {\"value\": ..., \"fixed\": true} or {\"value\": ..., \"sigma\": ...}",
        ),
        ("expected a string", "expected a text in quotes"),
        ("expected a sequence", "expected a list in [ ]"),
        ("expected a map", "expected an object in { }"),
        ("EOF while parsing", "the file ends too early, something is not closed:"),
        (
            "trailing characters",
            "more than there should be: a value too many, or a bracket closed too early or missing",
        ),
        ("invalid type:", "found"),
    ];
    let at = [error.line(), error.column()];
    let said = error.to_string();
    let what = said.strip_suffix(&format!(" at line {} column {}", at[0], at[1]));
    let why = WORDS.iter().fold(what.unwrap_or(&said).to_owned(), |said, (from, to)| said.replace(from, to));
    Fault::Unreadable { why, at: what.map(|_| at) }
}
