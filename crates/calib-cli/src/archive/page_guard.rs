//! Parquet file reader that limits the decompressed size of pages. The library allocates the size in a page's
//! header before it decompresses, so the header is checked first.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Cursor, Read};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use ::parquet::basic::Compression;
use ::parquet::errors::{ParquetError, Result};
use ::parquet::file::metadata::ParquetMetaData;
use ::parquet::file::reader::{ChunkReader, Length};
use bytes::Bytes;

use super::zstd_bound;

/// Maximum decompressed size of a page, in bytes; writers make pages of about a megabyte.
const MAX_PAGE_BYTES: u64 = 256 << 20;
/// Maximum compression ratio of gzip.
const MAX_GZIP_RATIO: u64 = 1032;
/// Maximum number of values in the lists of one column in a row group. A single row may contain all of them,
/// so all values are in memory at once. The file size does not limit them, because null values take no bytes.
const MAX_LIST_VALUES: u64 = 64 << 20;
/// Memory of a value in a list, in bytes: the value and two levels.
const LIST_VALUE_BYTES: u64 = 12;
/// Maximum size of a page header up to its number of values, in bytes: five 32-bit numbers with their field
/// headers, and the start of a struct.
const MAX_HEADER_BYTES: u64 = 40;

/// Parquet file with checked pages.
pub(super) struct PageGuard {
    file: File,
    chunks: Arc<[Chunk]>,
}

/// Reader at the possible start of a page. The first read checks the header.
pub(super) struct PageReader {
    file: <File as ChunkReader>::T,
    begin: u64,
    /// Chunks to check against, until the first byte is read. The library also seeks to page starts without
    /// reading.
    chunks: Option<Arc<[Chunk]>>,
    head: Cursor<Vec<u8>>,
}

impl Read for PageReader {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        if let Some(chunks) = self.chunks.take() {
            self.file.by_ref().take(MAX_HEADER_BYTES).read_to_end(self.head.get_mut())?;
            let chunk = chunk_at(&chunks, self.begin);
            let checked = chunk.map_or(Ok(()), |chunk| chunk.check(self.begin, self.head.get_ref()));
            checked.map_err(std::io::Error::other)?;
        }
        let count = self.head.read(to)?;
        if count > 0 { Ok(count) } else { self.file.read(to) }
    }
}

/// Returns the chunk that contains a file offset.
fn chunk_at(chunks: &[Chunk], at: u64) -> Option<&Chunk> {
    let index = chunks.partition_point(|chunk| chunk.range.start <= at).checked_sub(1)?;
    chunks.get(index).filter(|chunk| chunk.range.contains(&at))
}

/// Pages of a column in a row group.
struct Chunk {
    range: Range<u64>,
    codec: Compression,
    /// Stated number of values of each page, by file offset; only for list columns.
    list_values: Option<Mutex<BTreeMap<u64, u64>>>,
}

impl PageGuard {
    pub(super) fn new(file: File, about: &ParquetMetaData) -> Self {
        let columns = about.row_groups().iter().flat_map(|group| group.columns());
        let chunks = columns.map(|column| {
            let (start, length) = column.byte_range();
            let has_lists = column.column_descr().max_rep_level() > 0;
            Chunk {
                range: start..start.saturating_add(length),
                codec: column.compression(),
                list_values: has_lists.then(Mutex::default),
            }
        });
        let mut chunks: Vec<_> = chunks.collect();
        chunks.sort_by_key(|chunk| chunk.range.start);
        Self { file, chunks: chunks.into() }
    }
}

impl Chunk {
    /// Refuses a page if its size, or the number of values of its column so far, exceeds the limit.
    fn check(&self, at: u64, head: &[u8]) -> Result<()> {
        let header = || {
            PageHeader::parse(head).ok_or_else(|| {
                ParquetError::General("a page header is damaged: the sizes of the page are missing".into())
            })
        };
        if self.codec != Compression::UNCOMPRESSED {
            check(header()?.decompressed_size)?;
        }
        let Some(list_values) = &self.list_values else { return Ok(()) };
        let mut pages = list_values.lock().unwrap_or_else(PoisonError::into_inner);
        pages.insert(at, header()?.values);
        check_list_values(pages.values().sum())
    }
}

impl Length for PageGuard {
    fn len(&self) -> u64 {
        Length::len(&self.file)
    }
}

impl ChunkReader for PageGuard {
    type T = PageReader;

    fn get_read(&self, start: u64) -> Result<Self::T> {
        let (file, chunks) = (self.file.get_read(start)?, Some(Arc::clone(&self.chunks)));
        Ok(PageReader { file, begin: start, chunks, head: Cursor::default() })
    }

    /// Reads the bytes of a page, and checks the decompressed size from the data.
    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        let bytes = self.file.get_bytes(start, length)?;
        match chunk_at(&self.chunks, start).map(|chunk| chunk.codec) {
            Some(Compression::ZSTD(_)) => check(zstd_bound::decompressed_size(&bytes))?,
            Some(Compression::GZIP(_)) if MAX_GZIP_RATIO * length as u64 > MAX_PAGE_BYTES => {
                check(gzip_decompressed_size(&bytes))?;
            }
            _ => {}
        }
        Ok(bytes)
    }
}

fn check(unpacked: u64) -> Result<()> {
    if unpacked > MAX_PAGE_BYTES {
        let what = format!(
            "a page decompresses to {unpacked} bytes, more than the limit of {MAX_PAGE_BYTES} bytes; \
             write the file with smaller pages"
        );
        return Err(ParquetError::General(what));
    }
    calib_input::check_memory(unpacked).map_err(|error| ParquetError::General(format!("a page {error}")))
}

fn check_list_values(values: u64) -> Result<()> {
    if values > MAX_LIST_VALUES {
        let what = format!(
            "the lists of a column contain {values} values in one row group, more than the limit of {MAX_LIST_VALUES}; \
             write the file with smaller row groups, or without that column"
        );
        return Err(ParquetError::General(what));
    }
    let room = calib_input::check_memory(LIST_VALUE_BYTES * values);
    room.map_err(|error| ParquetError::General(format!("a column of lists {error}")))
}

/// Returns the decompressed size of a page, by decompressing it without storing the result.
fn gzip_decompressed_size(bytes: &[u8]) -> u64 {
    let unpacked = flate2::read::MultiGzDecoder::new(bytes).take(MAX_PAGE_BYTES + 1);
    std::io::copy(&mut { unpacked }, &mut std::io::sink()).unwrap_or_default()
}

/// Sizes stated in a page header.
#[derive(Debug, PartialEq)]
struct PageHeader {
    /// Decompressed size, in bytes.
    decompressed_size: u64,
    /// Number of values, including nulls.
    values: u64,
}

impl PageHeader {
    /// Parses a page header in Thrift's compact protocol. All writers use the same order: type, decompressed
    /// size, compressed size, optional checksum, and a struct for the page type. The first field of that
    /// struct is the number of values.
    fn parse(head: &[u8]) -> Option<Self> {
        const STRUCT: u8 = 0x0C;
        let (_, rest) = parse_number(head)?;
        let (unpacked, rest) = parse_number(rest)?;
        let (_, rest) = parse_number(rest)?;
        let rest = parse_number(rest).map_or(rest, |(_, rest)| rest);
        let (_, inside) = rest.split_first().filter(|(begin, _)| **begin & 0x0F == STRUCT)?;
        let (values, _) = parse_number(inside)?;
        Some(Self { decompressed_size: unpacked, values })
    }
}

/// Parses the next 32-bit field, and returns it with the remaining bytes. Numbers are zigzag encoded; the
/// library refuses negative ones.
fn parse_number(head: &[u8]) -> Option<(u64, &[u8])> {
    const NEXT_NUMBER: u8 = 0x15;
    let rest = head.strip_prefix(&[NEXT_NUMBER])?;
    let end = rest.iter().position(|byte| byte & 0x80 == 0)? + 1;
    let (digits, rest) = rest.split_at(end);
    let value = digits.iter().rev().fold(0_u64, |number, byte| number << 7 | u64::from(byte & 0x7F));
    Some((value >> 1, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_sizes_are_parsed_from_the_header() {
        const SIZES: [u8; 10] = [0x15, 0x00, 0x15, 0xFE, 0xFF, 0xFF, 0xFF, 0x0F, 0x15, 0x02];
        let expected = Some(PageHeader { decompressed_size: 0x7FFF_FFFF, values: 5 });
        assert_eq!(PageHeader::parse(&[&SIZES[..], &[0x2C, 0x15, 0x0A]].concat()), expected);
        let with_checksum = [&SIZES[..], &[0x15, 0xFE, 0x01, 0x4C, 0x15, 0x0A]].concat();
        assert_eq!(PageHeader::parse(&with_checksum), expected);
        assert_eq!(PageHeader::parse(&SIZES), None);
        assert_eq!(PageHeader::parse(&[0x2C, 0x15, 0x04]), None);
        assert_eq!(PageHeader::parse(&[]), None);
    }
}
