//! A file that is read whole, if it is one and not too long.
//!
//! Memory that is asked for before it is taken.
//!
//! A document of JSON, told from the other files that are handed over in its place.

use std::fmt;
use std::fs::{File, Metadata};
use std::io::Read;
use std::path::Path;

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

/// Why a file is not read.
#[derive(Debug)]
pub enum FileError {
    /// The system does not give it.
    System(std::io::Error),
    /// It is something else: a folder, a pipe, a device.
    NotAFile(&'static str),
    /// It is longer than what is read.
    TooLong {
        /// The most that is read, in bytes.
        most: u64,
    },
    /// It does not fit in memory.
    Memory(OutOfMemory),
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System(error) => error.fmt(f),
            Self::NotAFile(what) => write!(f, "is {what}, expected a regular file"),
            Self::TooLong { most } => write!(f, "larger than {} MiB, the most that is read", most >> 20),
            Self::Memory(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for FileError {}

/// Reads a regular file of at most so many bytes.
///
/// # Errors
/// When it is none, is longer, or cannot be read.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, FileError> {
    // Before it is opened: opening a pipe waits for its other end.
    regular(&path.metadata().map_err(FileError::System)?)?;
    let file = File::open(path).map_err(FileError::System)?;
    // What was opened may be something else than what was looked at.
    let about = file.metadata().map_err(FileError::System)?;
    regular(&about)?;
    if about.len() > most {
        return Err(FileError::TooLong { most });
    }
    read_into(reserved(about.len() + 1).map_err(FileError::Memory)?, file, most)
}

/// Reads a stream of at most so many bytes.
///
/// # Errors
/// When there are more, or it cannot be read.
pub fn read_from(stream: impl Read, most: u64) -> Result<Vec<u8>, FileError> {
    read_into(Vec::new(), stream, most)
}

fn read_into(mut bytes: Vec<u8>, from: impl Read, most: u64) -> Result<Vec<u8>, FileError> {
    from.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(|error| match error.kind() {
        std::io::ErrorKind::OutOfMemory => FileError::Memory(OutOfMemory { bytes: bytes.len() as u64 }),
        _ => FileError::System(error),
    })?;
    if bytes.len() as u64 > most { Err(FileError::TooLong { most }) } else { Ok(bytes) }
}

fn regular(about: &Metadata) -> Result<(), FileError> {
    if about.is_file() { Ok(()) } else { Err(FileError::NotAFile(kind(about))) }
}

/// What a thing on the disk is that is no file.
fn kind(about: &Metadata) -> &'static str {
    if about.is_dir() {
        return "a folder";
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt as _;
        let kind = about.file_type();
        if kind.is_fifo() {
            return "a pipe";
        }
        if kind.is_char_device() || kind.is_block_device() {
            return "a device";
        }
    }
    "neither a file nor a folder"
}

/// There is not as much memory as is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfMemory {
    /// What was asked for, in bytes.
    pub bytes: u64,
}

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "needs {} MiB of memory, more than there is", self.bytes >> 20)
    }
}

impl std::error::Error for OutOfMemory {}

/// Whether so many bytes are there to be taken: a library that takes them without asking would end the
/// whole program. Where the system promises more than it has, this is its promise.
///
/// # Errors
/// When they are not.
pub fn room_for(bytes: u64) -> Result<(), OutOfMemory> {
    reserved(bytes).map(drop)
}

/// An empty buffer with room for so many bytes.
pub(crate) fn reserved(bytes: u64) -> Result<Vec<u8>, OutOfMemory> {
    let mut buffer = Vec::new();
    let count = usize::try_from(bytes).map_err(|_| OutOfMemory { bytes })?;
    buffer.try_reserve_exact(count).map_err(|_| OutOfMemory { bytes })?;
    Ok(buffer)
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

    #[test]
    fn a_file_is_read_up_to_its_limit() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        let length = path.metadata().map(|about| about.len()).unwrap_or_default();
        assert!(read(&path, length).is_ok_and(|bytes| bytes.len() as u64 == length));
        assert!(matches!(read(&path, length - 1), Err(FileError::TooLong { .. })));
        assert!(matches!(read_from(&b"four"[..], 3), Err(FileError::TooLong { most: 3 })));
    }

    #[test]
    fn a_folder_and_a_device_are_no_files() {
        let folder = read(Path::new(env!("CARGO_MANIFEST_DIR")), 10);
        assert!(matches!(folder, Err(FileError::NotAFile("a folder"))), "{folder:?}");
        #[cfg(unix)]
        {
            let device = read(Path::new("/dev/zero"), 10);
            assert!(matches!(device, Err(FileError::NotAFile("a device"))), "{device:?}");
        }
    }

    #[test]
    fn what_no_machine_has_is_an_error() {
        assert_eq!(room_for(u64::MAX), Err(OutOfMemory { bytes: u64::MAX }));
        assert_eq!(room_for(1 << 20), Ok(()));
    }
}
