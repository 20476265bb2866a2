//! Input file or pipe of a table, with decompression (gzip and Zstandard, recognised by their first bytes).
//! Panics of the table readers are reported as invalid input.

use std::cell::Cell;
use std::fs::File;
use std::io::{Cursor, Read, Seek as _, SeekFrom, Write};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::rc::Rc;

use arrow_array::RecordBatch;
use arrow_schema::SchemaRef;
use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;

use super::{Format, Output, OutputOptions, ReadOptions, Source};
use crate::stop::CommandError;

struct PanicGuard {
    name: String,
    source: Box<dyn Source>,
}

/// Opens a table. Panics of its reader become errors.
pub(super) fn open(
    format: &Format,
    input: Input,
    purpose: ReadOptions<'_>,
) -> Result<Box<dyn Source>, CommandError> {
    let name = input.name.clone();
    let source = catch_panics(&name, || (format.open)(input, purpose))?;
    Ok(Box::new(PanicGuard { name, source }))
}

/// Runs `work`; a panic becomes an error and prints nothing.
fn catch_panics<T>(name: &str, work: impl FnOnce() -> Result<T, CommandError>) -> Result<T, CommandError> {
    let hook = take_hook();
    set_hook(Box::new(|_| {}));
    // A reader is not used again after a panic.
    let done = catch_unwind(AssertUnwindSafe(work));
    set_hook(hook);
    let what = "the table is damaged and cannot be read; write it again";
    done.unwrap_or_else(|_| Err(CommandError::invalid(name, what)))
}

impl Source for PanicGuard {
    fn schema(&self) -> Option<SchemaRef> {
        self.source.schema()
    }

    fn next(&mut self) -> Option<Result<RecordBatch, CommandError>> {
        let Self { name, source } = self;
        catch_panics(name, || source.next().transpose()).transpose()
    }

    fn row_name(&self, row: usize) -> String {
        self.source.row_name(row)
    }

    fn is_incomplete(&self, row: usize) -> bool {
        self.source.is_incomplete(row)
    }

    fn rows(&self) -> Option<u64> {
        self.source.rows()
    }

    fn output_options(&self) -> OutputOptions {
        self.source.output_options()
    }
}

/// Compression of a whole file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileCompression {
    Gzip,
    Zstd,
}

impl FileCompression {
    /// Detects the compression from the first bytes.
    pub(super) fn from_first_bytes(head: &[u8]) -> Option<Self> {
        match head {
            [0x1F, 0x8B, ..] => Some(Self::Gzip),
            [0x28, 0xB5, 0x2F, 0xFD, ..] => Some(Self::Zstd),
            _ => None,
        }
    }

    /// Detects the compression from the file name, and returns the name without the compression's extension.
    pub(super) fn from_file_name(path: &str) -> Option<(Self, &str)> {
        let extension = Path::new(path).extension()?.to_str()?;
        let packed = match extension.to_ascii_lowercase().as_str() {
            "gz" => Self::Gzip,
            "zst" => Self::Zstd,
            _ => return None,
        };
        Some((packed, &path[..path.len() - extension.len() - 1]))
    }

    /// Returns a reader of the decompressed bytes.
    pub(super) fn decoder(self, from: Box<dyn Read>) -> std::io::Result<Box<dyn Read>> {
        Ok(match self {
            Self::Gzip => Box::new(MultiGzDecoder::new(from)),
            Self::Zstd => Box::new(zstd::Decoder::new(from)?),
        })
    }

    /// Returns a writer that compresses to `to`.
    pub(crate) fn encoder(self, to: Output<'_>) -> Result<Output<'_>, CommandError> {
        Ok(match self {
            Self::Gzip => Box::new(FinishOnFlush(Some(GzEncoder::new(to, Compression::default())))),
            Self::Zstd => {
                Box::new(FinishOnFlush(Some(zstd::Encoder::new(to, zstd::DEFAULT_COMPRESSION_LEVEL)?)))
            }
        })
    }
}

/// Encoder that finishes its compressed stream on the first flush, so that an error at its end is reported. A table
/// writer flushes once, at its end.
struct FinishOnFlush<E: Finish>(Option<E>);

trait Finish: Write {
    fn finish_encoding(self) -> std::io::Result<()>;
}

impl Finish for GzEncoder<Output<'_>> {
    fn finish_encoding(self) -> std::io::Result<()> {
        self.finish()?.flush()
    }
}

impl Finish for zstd::Encoder<'_, Output<'_>> {
    fn finish_encoding(self) -> std::io::Result<()> {
        self.finish()?.flush()
    }
}

impl<E: Finish> Write for FinishOnFlush<E> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.as_mut().map_or(Ok(0), |encoder| encoder.write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.take().map_or(Ok(()), Finish::finish_encoding)
    }
}

/// Number of first bytes that identify a format.
const HEAD_BYTES: u64 = 8;

/// Input file or pipe of a table.
pub(crate) struct Input {
    /// Name for messages.
    pub(crate) name: String,
    from: Origin,
    /// Number of bytes read so far, before decompression.
    read: Rc<Cell<u64>>,
    /// Size of the file, in bytes; absent for a pipe.
    pub(crate) bytes: Option<u64>,
    /// Whether the whole file is compressed.
    is_compressed: bool,
}

enum Origin {
    File(File),
    Pipe(Box<dyn Read>),
}

impl Input {
    /// Opens a file or a named pipe, with decompression; `-` is stdin.
    pub(crate) fn open(path: &str) -> Result<Self, CommandError> {
        let mut input = if path == "-" { Self::stdin() } else { Self::open_path(path)? };
        let head = input.head()?;
        if let Some(packed) = FileCompression::from_first_bytes(&head) {
            let refused = |error| CommandError::invalid(&input.name, error);
            let unpacked = packed.decoder(input.from.into_read(&input.read)).map_err(refused)?;
            input = Self { from: Origin::Pipe(unpacked), is_compressed: true, ..input };
        }
        Ok(input)
    }

    fn stdin() -> Self {
        let read = Rc::default();
        let from = Origin::Pipe(counted(std::io::stdin().lock(), &read));
        Self { name: "stdin".into(), from, read, bytes: None, is_compressed: false }
    }

    fn open_path(path: &str) -> Result<Self, CommandError> {
        let refused = |error| CommandError::invalid(path, error);
        let about = std::fs::metadata(path).map_err(refused)?;
        if about.is_dir() {
            return Err(CommandError::invalid(path, "is a folder, expected a file"));
        }
        if is_device(&about) {
            return Err(CommandError::invalid(path, "is a device, expected a file or a pipe"));
        }
        let file = File::open(path).map_err(refused)?;
        let read = Rc::default();
        // A named pipe does not support seeking.
        let (from, bytes) = match about.is_file() {
            true => (Origin::File(file), Some(about.len())),
            false => (Origin::Pipe(counted(file, &read)), None),
        };
        Ok(Self { name: path.into(), from, read, bytes, is_compressed: false })
    }

    /// Returns the first bytes without consuming them.
    fn head(&mut self) -> Result<Vec<u8>, CommandError> {
        let mut head = Vec::new();
        let refused = |error| CommandError::invalid(&self.name, error);
        match &mut self.from {
            Origin::File(file) => {
                file.take(HEAD_BYTES).read_to_end(&mut head).map_err(refused)?;
                file.seek(SeekFrom::Start(0)).map_err(refused)?;
            }
            Origin::Pipe(pipe) => {
                pipe.take(HEAD_BYTES).read_to_end(&mut head).map_err(refused)?;
                let rest = std::mem::replace(pipe, Box::new(std::io::empty()));
                *pipe = Box::new(Cursor::new(head.clone()).chain(rest));
            }
        }
        Ok(head)
    }

    /// Detects the format from the first bytes.
    pub(crate) fn format(&mut self) -> Result<&'static Format, CommandError> {
        Ok(Format::from_first_bytes(&self.head()?))
    }

    /// Returns the counter of bytes read so far.
    pub(crate) fn counter(&self) -> Rc<Cell<u64>> {
        Rc::clone(&self.read)
    }

    /// Returns a sequential reader.
    pub(crate) fn into_read(self) -> Box<dyn Read> {
        self.from.into_read(&self.read)
    }

    /// Returns a seekable file; a pipe is copied to an anonymous temporary file.
    pub(crate) fn into_file(self) -> Result<File, CommandError> {
        if self.is_compressed {
            let what = "compressed files of this format are not supported; decompress the file first";
            return Err(CommandError::invalid(&self.name, what));
        }
        match self.from {
            Origin::File(file) => Ok(file),
            Origin::Pipe(mut pipe) => {
                let mut kept = tempfile::tempfile()?;
                std::io::copy(&mut pipe, &mut kept)?;
                kept.seek(SeekFrom::Start(0))?;
                Ok(kept)
            }
        }
    }
}

impl Origin {
    fn into_read(self, read: &Rc<Cell<u64>>) -> Box<dyn Read> {
        match self {
            Self::File(file) => counted(file, read),
            Self::Pipe(pipe) => pipe,
        }
    }
}

/// Whether a file is a character or block device, such as a terminal, a disk or a source of zeros.
fn is_device(about: &std::fs::Metadata) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt as _;
        about.file_type().is_char_device() || about.file_type().is_block_device()
    }
    #[cfg(not(unix))]
    {
        let _ = about;
        false
    }
}

fn counted(from: impl Read + 'static, read: &Rc<Cell<u64>>) -> Box<dyn Read> {
    Box::new(Counted { from: Box::new(from), read: Rc::clone(read) })
}

struct Counted {
    from: Box<dyn Read>,
    read: Rc<Cell<u64>>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.from.read(buffer)?;
        self.read.set(self.read.get() + count as u64);
        Ok(count)
    }
}
