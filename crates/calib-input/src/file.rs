//! A file that is read whole, if it is one and not too long.

use std::fmt;
use std::fs::{File, Metadata};
use std::io::Read;
use std::path::Path;

use crate::memory::{OutOfMemory, reserved};

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

#[cfg(test)]
mod tests {
    use super::*;

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
}
