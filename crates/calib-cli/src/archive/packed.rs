//! Text that is packed as a whole: gzip and Zstandard, known by their first bytes or by the name.

use std::io::{Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;

use super::Output;
use crate::stop::Stop;

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
