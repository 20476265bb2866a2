//! A Parquet file whose pages may not promise more than is read: memory is taken for what a header says, before
//! anything is unpacked.

use std::fs::File;
use std::io::{Cursor, Read as _};
use std::ops::Range;

use ::parquet::basic::Compression;
use ::parquet::errors::{ParquetError, Result};
use ::parquet::file::metadata::ParquetMetaData;
use ::parquet::file::reader::{ChunkReader, Length};
use bytes::Bytes;

use super::zstd_bound;

/// Most that a page may unpack to, in bytes: writers make pages of a megabyte.
const MOST: u64 = 256 << 20;
/// Most that a byte of gzip stands for.
const GZIP: u64 = 1032;
/// Most that the fields of a page's header take up to its sizes: three numbers of 32 bits with their names.
const HEAD: u64 = 24;

/// The pages of a file.
pub(super) struct PageGuard {
    file: File,
    /// Where the pages of every column chunk are, and how they are packed.
    chunks: Vec<(Range<u64>, Compression)>,
}

impl PageGuard {
    pub(super) fn new(file: File, about: &ParquetMetaData) -> Self {
        let columns = about.row_groups().iter().flat_map(|group| group.columns());
        let chunks = columns.map(|column| {
            let (start, length) = column.byte_range();
            (start..start.saturating_add(length), column.compression())
        });
        let mut chunks: Vec<_> = chunks.collect();
        chunks.sort_by_key(|(range, _)| range.start);
        Self { file, chunks }
    }

    /// How the chunk at a place is packed.
    fn packed(&self, at: u64) -> Option<Compression> {
        let index = self.chunks.partition_point(|(range, _)| range.start <= at).checked_sub(1)?;
        let (range, packed) = &self.chunks[index];
        range.contains(&at).then_some(*packed)
    }
}

impl Length for PageGuard {
    fn len(&self) -> u64 {
        Length::len(&self.file)
    }
}

impl ChunkReader for PageGuard {
    type T = std::io::Chain<Cursor<Vec<u8>>, <File as ChunkReader>::T>;

    /// From here a header is read.
    fn get_read(&self, start: u64) -> Result<Self::T> {
        let mut rest = self.file.get_read(start)?;
        let mut head = Vec::new();
        rest.by_ref().take(HEAD).read_to_end(&mut head)?;
        if self.packed(start).is_some_and(|packed| packed != Compression::UNCOMPRESSED) {
            let promised = promised(&head).ok_or_else(|| {
                ParquetError::General("the header of a page does not begin with its sizes".into())
            })?;
            check(promised)?;
        }
        Ok(Cursor::new(head).chain(rest))
    }

    /// The bytes of a page.
    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        let bytes = self.file.get_bytes(start, length)?;
        match self.packed(start) {
            Some(Compression::ZSTD(_)) => check(zstd_bound::unpacked(&bytes))?,
            Some(Compression::GZIP(_)) if GZIP * length as u64 > MOST => check(gunzipped(&bytes))?,
            _ => {}
        }
        Ok(bytes)
    }
}

fn check(unpacked: u64) -> Result<()> {
    if unpacked > MOST {
        let what = format!("a page unpacks to {unpacked} bytes; at most {MOST} are read");
        return Err(ParquetError::General(what));
    }
    calib_input::room_for(unpacked).map_err(|error| ParquetError::General(format!("a page {error}")))
}

/// How much a page unpacks to, by unpacking it into nothing.
fn gunzipped(bytes: &[u8]) -> u64 {
    let unpacked = flate2::read::MultiGzDecoder::new(bytes).take(MOST + 1);
    std::io::copy(&mut { unpacked }, &mut std::io::sink()).unwrap_or_default()
}

/// What a page unpacks to, by its header in Thrift's compact protocol: type, unpacked size, packed size are its
/// first fields, in this order, with every writer.
fn promised(head: &[u8]) -> Option<u64> {
    /// The next field, of 32 bits.
    const NEXT_NUMBER: u8 = 0x15;
    let mut rest = head;
    let mut values = [0; 2];
    for value in &mut values {
        rest = rest.strip_prefix(&[NEXT_NUMBER])?;
        let end = rest.iter().position(|byte| byte & 0x80 == 0)? + 1;
        *value = rest[..end].iter().rev().fold(0_u64, |number, byte| number << 7 | u64::from(byte & 0x7F));
        rest = &rest[end..];
    }
    // Signs alternate; a negative size is refused by the library.
    Some(values[1] >> 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_promise_of_a_page_is_read_from_its_header() {
        assert_eq!(
            promised(&[0x15, 0x00, 0x15, 0xFE, 0xFF, 0xFF, 0xFF, 0x0F, 0x15, 0x02]),
            Some(0x7FFF_FFFF)
        );
        assert_eq!(promised(&[0x15, 0x04, 0x15, 0x14, 0x15]), Some(10));
        assert_eq!(promised(&[0x2C, 0x15, 0x04]), None);
        assert_eq!(promised(&[]), None);
    }
}
