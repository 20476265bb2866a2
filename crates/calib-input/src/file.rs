//! Files that are read completely within a size limit, memory that is checked before it is allocated, and the
//! detection of JSON documents.

use std::fmt;
use std::fs::{File, Metadata};
use std::io::Read;
use std::path::Path;

/// Error for a file that is not a JSON document, with a description of its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DocumentError(&'static str);

impl fmt::Display for DocumentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "is {}, expected a site file: JSON text that begins with {{", self.0)
    }
}

impl std::error::Error for DocumentError {}

/// First bytes of file types other than JSON, with a description of each type.
const FILE_SIGNATURES: [(&[u8], &str); 9] = [
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

/// Returns the text of a file whose first character starts a JSON object, without the byte order mark that
/// some editors write.
///
/// # Errors
///
/// Returns the type of the file if it is not a JSON document.
pub fn json_document(bytes: Vec<u8>) -> Result<String, DocumentError> {
    if let Some((_, what)) = FILE_SIGNATURES.iter().find(|(beginning, _)| bytes.starts_with(beginning)) {
        return Err(DocumentError(what));
    }
    let mut text = String::from_utf8(bytes).map_err(|_| DocumentError("not text"))?;
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    match describe_text(&text) {
        Some(what) => Err(DocumentError(what)),
        None => Ok(text),
    }
}

/// Describes a text that is not a JSON object.
fn describe_text(text: &str) -> Option<&'static str> {
    let begin = text.trim_start();
    let first = begin.lines().next().unwrap_or_default();
    match begin.chars().next() {
        Some('{') => None,
        None => Some("empty"),
        Some('[') => Some("a JSON list"),
        Some('<') => Some("XML or HTML"),
        _ if [',', ';', '\t'].iter().any(|&separator| first.contains(separator)) => Some("a table (CSV)"),
        _ => Some("plain text"),
    }
}

/// Reason why a file is not read.
#[derive(Debug)]
pub enum FileError {
    /// Error of the operating system.
    System(std::io::Error),
    /// Not a regular file: a folder, a pipe, or a device.
    NotAFile(&'static str),
    /// File longer than the limit.
    TooLong {
        /// Limit, in bytes.
        max_bytes: u64,
    },
    /// File that does not fit in memory.
    Memory(OutOfMemory),
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System(error) => error.fmt(f),
            Self::NotAFile(what) => write!(f, "is {what}, expected a regular file"),
            Self::TooLong { max_bytes } => write!(f, "is larger than the limit of {} MiB", max_bytes >> 20),
            Self::Memory(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for FileError {}

/// Reads a regular file of at most `max_bytes` bytes.
///
/// # Errors
///
/// Fails if it is not a regular file, is longer, or cannot be read.
pub fn read(path: &Path, max_bytes: u64) -> Result<Vec<u8>, FileError> {
    // The type is checked before opening, because opening a pipe waits for its other end.
    check_is_regular(&path.metadata().map_err(FileError::System)?)?;
    let file = File::open(path).map_err(FileError::System)?;
    // The file may have been replaced after the check.
    let about = file.metadata().map_err(FileError::System)?;
    check_is_regular(&about)?;
    if about.len() > max_bytes {
        return Err(FileError::TooLong { max_bytes });
    }
    read_into(allocate(about.len() + 1).map_err(FileError::Memory)?, file, max_bytes)
}

/// Reads a stream of at most `max_bytes` bytes.
///
/// # Errors
///
/// Fails if the stream is longer or cannot be read.
pub fn read_from(stream: impl Read, max_bytes: u64) -> Result<Vec<u8>, FileError> {
    read_into(Vec::new(), stream, max_bytes)
}

fn read_into(mut bytes: Vec<u8>, from: impl Read, max_bytes: u64) -> Result<Vec<u8>, FileError> {
    from.take(max_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(|error| match error.kind() {
        std::io::ErrorKind::OutOfMemory => FileError::Memory(OutOfMemory { bytes: bytes.len() as u64 }),
        _ => FileError::System(error),
    })?;
    if bytes.len() as u64 > max_bytes { Err(FileError::TooLong { max_bytes }) } else { Ok(bytes) }
}

/// Refuses a file system entry that is not a regular file.
fn check_is_regular(about: &Metadata) -> Result<(), FileError> {
    if about.is_file() { Ok(()) } else { Err(FileError::NotAFile(kind(about))) }
}

/// Describes a file system entry that is not a regular file.
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

/// Error for a failed memory allocation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfMemory {
    /// Requested memory, in bytes.
    pub bytes: u64,
}

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "needs {} MiB of memory, more than is available", self.bytes >> 20)
    }
}

impl std::error::Error for OutOfMemory {}

/// Checks whether `bytes` of memory can be allocated. A library that allocates without checking would end the
/// whole program. A system that overcommits memory may still fail later.
///
/// # Errors
///
/// Fails if the memory is not available.
pub fn check_memory(bytes: u64) -> Result<(), OutOfMemory> {
    allocate(bytes).map(drop)
}

/// Returns an empty buffer with a capacity of `bytes`.
pub(crate) fn allocate(bytes: u64) -> Result<Vec<u8>, OutOfMemory> {
    let mut buffer = Vec::new();
    let count = usize::try_from(bytes).map_err(|_| OutOfMemory { bytes })?;
    buffer.try_reserve_exact(count).map_err(|_| OutOfMemory { bytes })?;
    Ok(buffer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_object_is_a_document_and_other_types_are_named() {
        assert_eq!(json_document(b"\xef\xbb\xbf \n{}".to_vec()).as_deref(), Ok(" \n{}"));
        let others: [(&[u8], &str); 9] = [
            (b"\x89PNG\r\n\x1a\n", "a PNG image"),
            (b"PAR1\x15\x04", "a Parquet table"),
            (b"\xff\xd8\xff\xe0", "a JPEG image"),
            (b"u,v\n1,2\n", "a table (CSV)"),
            (b"u\tv\n", "a table (CSV)"),
            (b"[{}]", "a JSON list"),
            (b"", "empty"),
            (b"\xc3\x28", "not text"),
            (b"hello", "plain text"),
        ];
        for (bytes, what) in others {
            let message = json_document(bytes.to_vec()).unwrap_err().to_string();
            assert!(message.starts_with(&format!("is {what}, expected a site file")), "{message}");
        }
    }

    #[test]
    fn a_file_is_read_up_to_its_limit() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        let length = path.metadata().map(|about| about.len()).unwrap_or_default();
        assert!(read(&path, length).is_ok_and(|bytes| bytes.len() as u64 == length));
        assert!(matches!(read(&path, length - 1), Err(FileError::TooLong { .. })));
        assert!(matches!(read_from(&b"four"[..], 3), Err(FileError::TooLong { max_bytes: 3 })));
    }

    #[test]
    fn folder_and_device_are_refused() {
        let folder = read(Path::new(env!("CARGO_MANIFEST_DIR")), 10);
        assert!(matches!(folder, Err(FileError::NotAFile("a folder"))), "{folder:?}");
        #[cfg(unix)]
        {
            let device = read(Path::new("/dev/zero"), 10);
            assert!(matches!(device, Err(FileError::NotAFile("a device"))), "{device:?}");
        }
    }

    #[test]
    fn unavailable_memory_is_an_error() {
        assert_eq!(check_memory(u64::MAX), Err(OutOfMemory { bytes: u64::MAX }));
        assert_eq!(check_memory(1 << 20), Ok(()));
    }
}
