//! A Parquet file whose pages may not promise more than is read: memory is taken for what a header says, before
//! anything is unpacked.

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

/// Most that a page may unpack to, in bytes: writers make pages of a megabyte.
const MOST: u64 = 256 << 20;
/// Most that a byte of gzip stands for.
const GZIP: u64 = 1032;
/// Most values that the lists of one column may hold in a group of rows: a single row may have all of them, and
/// nothing takes no bytes.
const MOST_LISTED: u64 = 64 << 20;
/// What a value of a list takes, in bytes: itself, and two levels.
const LISTED_BYTES: u64 = 12;
/// Most that the fields of a page's header take up to its number of values: five numbers of 32 bits with their
/// names, and a struct's beginning.
const HEAD: u64 = 40;

/// The pages of a file.
pub(super) struct PageGuard {
    file: File,
    chunks: Arc<[Chunk]>,
}

/// A file from where a page may begin: whoever reads on reads its header.
pub(super) struct FromPage {
    file: <File as ChunkReader>::T,
    begin: u64,
    /// Until the first byte is wanted: the library goes to where pages begin without reading, too.
    chunks: Option<Arc<[Chunk]>>,
    head: Cursor<Vec<u8>>,
}

impl Read for FromPage {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        if let Some(chunks) = self.chunks.take() {
            self.file.by_ref().take(HEAD).read_to_end(self.head.get_mut())?;
            let chunk = chunk_at(&chunks, self.begin);
            let checked = chunk.map_or(Ok(()), |chunk| chunk.check(self.begin, self.head.get_ref()));
            checked.map_err(std::io::Error::other)?;
        }
        let count = self.head.read(to)?;
        if count > 0 { Ok(count) } else { self.file.read(to) }
    }
}

/// The chunk at a place.
fn chunk_at(chunks: &[Chunk], at: u64) -> Option<&Chunk> {
    let index = chunks.partition_point(|chunk| chunk.range.start <= at).checked_sub(1)?;
    chunks.get(index).filter(|chunk| chunk.range.contains(&at))
}

/// The pages of a column in a group of rows.
struct Chunk {
    range: Range<u64>,
    packed: Compression,
    /// How many values every page says it has, by where it begins; of lists.
    listed: Option<Mutex<BTreeMap<u64, u64>>>,
}

impl PageGuard {
    pub(super) fn new(file: File, about: &ParquetMetaData) -> Self {
        let columns = about.row_groups().iter().flat_map(|group| group.columns());
        let chunks = columns.map(|column| {
            let (start, length) = column.byte_range();
            let has_lists = column.column_descr().max_rep_level() > 0;
            Chunk {
                range: start..start.saturating_add(length),
                packed: column.compression(),
                listed: has_lists.then(Mutex::default),
            }
        });
        let mut chunks: Vec<_> = chunks.collect();
        chunks.sort_by_key(|chunk| chunk.range.start);
        Self { file, chunks: chunks.into() }
    }
}

impl Chunk {
    /// Refuses a page that begins there if it, or its column so far, promises too much.
    fn check(&self, at: u64, head: &[u8]) -> Result<()> {
        let header = || {
            PageHeader::of(head).ok_or_else(|| {
                ParquetError::General("the header of a page does not begin with its sizes".into())
            })
        };
        if self.packed != Compression::UNCOMPRESSED {
            check(header()?.unpacked)?;
        }
        let Some(listed) = &self.listed else { return Ok(()) };
        let mut pages = listed.lock().unwrap_or_else(PoisonError::into_inner);
        pages.insert(at, header()?.values);
        check_listed(pages.values().sum())
    }
}

impl Length for PageGuard {
    fn len(&self) -> u64 {
        Length::len(&self.file)
    }
}

impl ChunkReader for PageGuard {
    type T = FromPage;

    fn get_read(&self, start: u64) -> Result<Self::T> {
        let (file, chunks) = (self.file.get_read(start)?, Some(Arc::clone(&self.chunks)));
        Ok(FromPage { file, begin: start, chunks, head: Cursor::default() })
    }

    /// The bytes of a page.
    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        let bytes = self.file.get_bytes(start, length)?;
        match chunk_at(&self.chunks, start).map(|chunk| chunk.packed) {
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

fn check_listed(values: u64) -> Result<()> {
    if values > MOST_LISTED {
        let what = format!(
            "the lists of a column hold {values} values in one group of rows; at most {MOST_LISTED} are read: write \
             the file with smaller groups, or without that column"
        );
        return Err(ParquetError::General(what));
    }
    let room = calib_input::room_for(LISTED_BYTES * values);
    room.map_err(|error| ParquetError::General(format!("a column of lists {error}")))
}

/// How much a page unpacks to, by unpacking it into nothing.
fn gunzipped(bytes: &[u8]) -> u64 {
    let unpacked = flate2::read::MultiGzDecoder::new(bytes).take(MOST + 1);
    std::io::copy(&mut { unpacked }, &mut std::io::sink()).unwrap_or_default()
}

/// What a page promises.
#[derive(Debug, PartialEq)]
struct PageHeader {
    /// In bytes.
    unpacked: u64,
    /// How many there are, with those that are nothing.
    values: u64,
}

impl PageHeader {
    /// In Thrift's compact protocol, with every writer: type, unpacked size, packed size, perhaps a checksum, then
    /// a struct for the kind of page, whose first field is the number of values.
    fn of(head: &[u8]) -> Option<Self> {
        const STRUCT: u8 = 0x0C;
        let (_, rest) = number(head)?;
        let (unpacked, rest) = number(rest)?;
        let (_, rest) = number(rest)?;
        let rest = number(rest).map_or(rest, |(_, rest)| rest);
        let (_, inside) = rest.split_first().filter(|(begin, _)| **begin & 0x0F == STRUCT)?;
        let (values, _) = number(inside)?;
        Some(Self { unpacked, values })
    }
}

/// The next field, of 32 bits, and what follows. Signs alternate; a negative one is refused by the library.
fn number(head: &[u8]) -> Option<(u64, &[u8])> {
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
    fn the_promise_of_a_page_is_read_from_its_header() {
        const SIZES: [u8; 10] = [0x15, 0x00, 0x15, 0xFE, 0xFF, 0xFF, 0xFF, 0x0F, 0x15, 0x02];
        let told = Some(PageHeader { unpacked: 0x7FFF_FFFF, values: 5 });
        assert_eq!(PageHeader::of(&[&SIZES[..], &[0x2C, 0x15, 0x0A]].concat()), told);
        let with_checksum = [&SIZES[..], &[0x15, 0xFE, 0x01, 0x4C, 0x15, 0x0A]].concat();
        assert_eq!(PageHeader::of(&with_checksum), told);
        assert_eq!(PageHeader::of(&SIZES), None);
        assert_eq!(PageHeader::of(&[0x2C, 0x15, 0x04]), None);
        assert_eq!(PageHeader::of(&[]), None);
    }
}
