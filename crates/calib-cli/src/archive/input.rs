//! A file or pipe that a table is read from.
//!
//! Text that is packed as a whole: gzip and Zstandard, known by their first bytes or by the name.
//!
//! Readers of libraries that may panic over broken input: that, too, is an input that is invalid.

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

use super::{Format, Output, Packing, Purpose, Source};
use crate::stop::Stop;

struct Guarded {
    name: String,
    source: Box<dyn Source>,
}

/// Opens a table.
pub(super) fn open(format: &Format, input: Input, purpose: Purpose<'_>) -> Result<Box<dyn Source>, Stop> {
    let name = input.name.clone();
    let source = guarded(&name, || (format.open)(input, purpose))?;
    Ok(Box::new(Guarded { name, source }))
}

/// Does `work` without a word on stderr if it panics.
fn guarded<T>(name: &str, work: impl FnOnce() -> Result<T, Stop>) -> Result<T, Stop> {
    let hook = take_hook();
    set_hook(Box::new(|_| {}));
    // What panicked is not used again.
    let done = catch_unwind(AssertUnwindSafe(work));
    set_hook(hook);
    done.unwrap_or_else(|_| Err(Stop::invalid(name, "not a whole table: it contradicts itself")))
}

impl Source for Guarded {
    fn schema(&self) -> Option<SchemaRef> {
        self.source.schema()
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        let Self { name, source } = self;
        guarded(name, || source.next().transpose()).transpose()
    }

    fn place(&self, row: usize) -> String {
        self.source.place(row)
    }

    fn is_broken(&self, row: usize) -> bool {
        self.source.is_broken(row)
    }

    fn rows(&self) -> Option<u64> {
        self.source.rows()
    }

    fn packing(&self) -> Packing {
        self.source.packing()
    }
}

/// How a file is packed as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packed {
    Gzip,
    Zstd,
}

impl Packed {
    /// As the first bytes say.
    pub(super) fn of_bytes(head: &[u8]) -> Option<Self> {
        match head {
            [0x1F, 0x8B, ..] => Some(Self::Gzip),
            [0x28, 0xB5, 0x2F, 0xFD, ..] => Some(Self::Zstd),
            _ => None,
        }
    }

    /// As the name says, and the name of what is packed.
    pub(super) fn of_path(path: &str) -> Option<(Self, &str)> {
        let extension = Path::new(path).extension()?.to_str()?;
        let packed = match extension.to_ascii_lowercase().as_str() {
            "gz" => Self::Gzip,
            "zst" => Self::Zstd,
            _ => return None,
        };
        Some((packed, &path[..path.len() - extension.len() - 1]))
    }

    /// What is read once it is unpacked.
    pub(super) fn unpack(self, from: Box<dyn Read>) -> std::io::Result<Box<dyn Read>> {
        Ok(match self {
            Self::Gzip => Box::new(MultiGzDecoder::new(from)),
            Self::Zstd => Box::new(zstd::Decoder::new(from)?),
        })
    }

    /// Packs what is written.
    pub(crate) fn pack(self, to: Output<'_>) -> Result<Output<'_>, Stop> {
        Ok(match self {
            Self::Gzip => Box::new(Ended(Some(GzEncoder::new(to, Compression::default())))),
            Self::Zstd => Box::new(Ended(Some(zstd::Encoder::new(to, zstd::DEFAULT_COMPRESSION_LEVEL)?))),
        })
    }
}

/// An encoder whose end is written with the last flush, where its failure is told: a table is flushed once.
struct Ended<E: End>(Option<E>);

trait End: Write {
    fn end(self) -> std::io::Result<()>;
}

impl End for GzEncoder<Output<'_>> {
    fn end(self) -> std::io::Result<()> {
        self.finish()?.flush()
    }
}

impl End for zstd::Encoder<'_, Output<'_>> {
    fn end(self) -> std::io::Result<()> {
        self.finish()?.flush()
    }
}

impl<E: End> Write for Ended<E> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.as_mut().map_or(Ok(0), |encoder| encoder.write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.take().map_or(Ok(()), End::end)
    }
}

/// First bytes that tell a format.
const HEAD: u64 = 8;

/// A file or pipe that a table is read from.
pub(crate) struct Input {
    /// For messages.
    pub(crate) name: String,
    from: From,
    /// Bytes read so far.
    read: Rc<Cell<u64>>,
    /// Bytes in all, of a file.
    pub(crate) bytes: Option<u64>,
    /// Whether it is packed as a whole.
    is_packed: bool,
}

enum From {
    File(File),
    Pipe(Box<dyn Read>),
}

impl Input {
    /// Opens a file or a named pipe; `-` is stdin. What is packed as a whole is unpacked as it is read.
    pub(crate) fn open(path: &str) -> Result<Self, Stop> {
        let mut input = if path == "-" { Self::stdin() } else { Self::of_path(path)? };
        let head = input.head()?;
        if let Some(packed) = Packed::of_bytes(&head) {
            let refused = |error| Stop::invalid(&input.name, error);
            let unpacked = packed.unpack(input.from.into_read(&input.read)).map_err(refused)?;
            input = Self { from: From::Pipe(unpacked), is_packed: true, ..input };
        }
        Ok(input)
    }

    fn stdin() -> Self {
        let read = Rc::default();
        let from = From::Pipe(counted(std::io::stdin().lock(), &read));
        Self { name: "stdin".into(), from, read, bytes: None, is_packed: false }
    }

    fn of_path(path: &str) -> Result<Self, Stop> {
        let refused = |error| Stop::invalid(path, error);
        let about = std::fs::metadata(path).map_err(refused)?;
        if about.is_dir() {
            return Err(Stop::invalid(path, "is a folder, expected a file"));
        }
        if is_device(&about) {
            return Err(Stop::invalid(path, "is a device, expected a file or a pipe"));
        }
        let file = File::open(path).map_err(refused)?;
        let read = Rc::default();
        // A named pipe cannot be gone back in.
        let (from, bytes) = match about.is_file() {
            true => (From::File(file), Some(about.len())),
            false => (From::Pipe(counted(file, &read)), None),
        };
        Ok(Self { name: path.into(), from, read, bytes, is_packed: false })
    }

    /// The first bytes, which are still to be read.
    fn head(&mut self) -> Result<Vec<u8>, Stop> {
        let mut head = Vec::new();
        let refused = |error| Stop::invalid(&self.name, error);
        match &mut self.from {
            From::File(file) => {
                file.take(HEAD).read_to_end(&mut head).map_err(refused)?;
                file.seek(SeekFrom::Start(0)).map_err(refused)?;
            }
            From::Pipe(pipe) => {
                pipe.take(HEAD).read_to_end(&mut head).map_err(refused)?;
                let rest = std::mem::replace(pipe, Box::new(std::io::empty()));
                *pipe = Box::new(Cursor::new(head.clone()).chain(rest));
            }
        }
        Ok(head)
    }

    /// The format that the first bytes tell.
    pub(crate) fn format(&mut self) -> Result<&'static Format, Stop> {
        Ok(Format::of_bytes(&self.head()?))
    }

    /// How many bytes have been read, whoever reads them.
    pub(crate) fn counter(&self) -> Rc<Cell<u64>> {
        Rc::clone(&self.read)
    }

    /// To be read from front to back.
    pub(crate) fn into_read(self) -> Box<dyn Read> {
        self.from.into_read(&self.read)
    }

    /// To be read anywhere; a pipe is kept in a temporary file that nobody sees.
    pub(crate) fn into_file(self) -> Result<File, Stop> {
        if self.is_packed {
            let what = "a table of this format is not packed as a whole; unpack it first";
            return Err(Stop::invalid(&self.name, what));
        }
        match self.from {
            From::File(file) => Ok(file),
            From::Pipe(mut pipe) => {
                let mut kept = tempfile::tempfile()?;
                std::io::copy(&mut pipe, &mut kept)?;
                kept.seek(SeekFrom::Start(0))?;
                Ok(kept)
            }
        }
    }
}

impl From {
    fn into_read(self, read: &Rc<Cell<u64>>) -> Box<dyn Read> {
        match self {
            Self::File(file) => counted(file, read),
            Self::Pipe(pipe) => pipe,
        }
    }
}

/// Whether a path leads to what has no end and no place: a disk, a terminal, a source of zeros.
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
