//! Tables of any size, read and written batch by batch: one format a file, and the list of them.

mod arrow;
mod csv;
mod input;
mod ndjson;
mod zstd_bound;
mod page_guard;
mod parquet;

use std::io::Write;
use std::path::Path;

use arrow_array::RecordBatch;
use arrow_schema::{Schema, SchemaRef};

use calib_table::{is_json, json_field, plain};
pub(crate) use input::{Input, Packed};
pub(crate) use parquet::Packing;

use crate::stop::Stop;

/// Rows of a batch: enough to keep the columns busy, few enough to stay in the cache.
pub(crate) const BATCH_ROWS: usize = 8192;

/// Most bytes that one row of text may have: what is longer is not a table.
const MAX_ROW_BYTES: u64 = 64 << 20;

/// Most columns of a table of text: what has more is a bag of anything.
const MAX_COLUMNS: usize = 10_000;
/// Rows of a table of text that tell the types of its columns.
const FIRST_ROWS: usize = 1 << 16;
/// What a cell of a table of text takes beside its text, in bytes: empty cells count, too.
const CELL_BYTES: usize = 8;

/// A table that is read.
pub(crate) trait Source {
    /// The columns, where they are known before the first row.
    fn schema(&self) -> Option<SchemaRef>;

    /// The next rows; columns may differ from batch to batch where the format allows it.
    fn next(&mut self) -> Option<Result<RecordBatch, Stop>>;

    /// What a row of the batch read last is called in messages.
    fn place(&self, row: usize) -> String;

    /// Whether a row of the batch read last is not whole: what is in its cells may be of others.
    fn is_broken(&self, _row: usize) -> bool {
        false
    }

    /// Rows in all, where that is known.
    fn rows(&self) -> Option<u64> {
        None
    }

    /// How the table is packed, in the terms of the format that says so.
    fn packing(&self) -> Packing {
        Packing::default()
    }
}

/// A table that is written.
pub(crate) trait Sink {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), Stop>;

    /// Ends the table.
    fn finish(self: Box<Self>) -> Result<(), Stop>;
}

/// What a table is read for.
#[derive(Clone, Copy)]
pub(crate) struct Purpose<'a> {
    /// In which it is to be written.
    pub(crate) to: &'static Format,
    /// Columns that stay text, whatever their cells look like.
    pub(crate) as_text: &'a [String],
    /// Whether rows that are not whole are handed on ([`Source::is_broken`]), and do not end the run.
    pub(crate) keeps_broken: bool,
}

/// What to do about a row that is not whole.
const GOES_ON: &str = "--bad-rows status goes on with the others";

/// Where a table is written to.
pub(crate) type Output<'a> = Box<dyn Write + Send + 'a>;

type Open = fn(Input, Purpose<'_>) -> Result<Box<dyn Source>, Stop>;
type Create = for<'a> fn(Output<'a>, &Schema, Packing) -> Result<Box<dyn Sink + 'a>, Stop>;

/// A format of tables.
pub(crate) struct Format {
    /// By which it is asked for.
    pub(crate) name: &'static str,
    pub(crate) about: &'static str,
    /// Of file names, without the dot.
    extensions: &'static [&'static str],
    /// First bytes by which it is known in a pipe.
    magic: &'static [&'static [u8]],
    /// Whether values have types; where they have none, all are text.
    is_typed: bool,
    /// Whether it is text, which is packed as a whole or not at all.
    is_text: bool,
    open: Open,
    pub(crate) create: Create,
}

/// The list is the registry; what has no magic and no extension is the first.
pub(crate) const FORMATS: &[Format] = &[
    Format {
        name: "csv",
        about: "comma-separated text with a header",
        extensions: &["csv"],
        magic: &[],
        is_typed: false,
        is_text: true,
        open: csv::open,
        create: csv::create,
    },
    Format {
        name: "ndjson",
        about: "one JSON object a line",
        extensions: &["ndjson", "jsonl"],
        magic: &[b"{"],
        is_typed: true,
        is_text: true,
        open: ndjson::open,
        create: ndjson::create,
    },
    Format {
        name: "arrow",
        about: "Arrow IPC stream",
        extensions: &["arrows"],
        magic: &[&[0xff, 0xff, 0xff, 0xff]],
        is_typed: true,
        is_text: false,
        open: arrow::open,
        create: arrow::create_stream,
    },
    Format {
        name: "arrow-file",
        about: "Arrow IPC file (Feather)",
        extensions: &["arrow", "feather", "ipc"],
        magic: &[b"ARROW1"],
        is_typed: true,
        is_text: false,
        open: arrow::open,
        create: arrow::create_file,
    },
    Format {
        name: "parquet",
        about: "Apache Parquet",
        extensions: &["parquet", "pq"],
        magic: &[b"PAR1"],
        is_typed: true,
        is_text: false,
        open: parquet::open,
        create: parquet::create,
    },
];

impl Format {
    /// Opens a table.
    pub(crate) fn open(&self, input: Input, purpose: Purpose<'_>) -> Result<Box<dyn Source>, Stop> {
        input::open(self, input, purpose)
    }

    /// The format of a name that was checked already.
    pub(crate) fn named(name: &str) -> Result<&'static Self, Stop> {
        let found = FORMATS.iter().find(|format| format.name == name);
        found.ok_or_else(|| Stop::Usage(format!("{name}: no such format of tables")))
    }

    /// The format that the name of a file asks for, however that is packed.
    pub(crate) fn of_path(path: &str) -> Option<&'static Self> {
        let path = Packed::of_path(path).map_or(path, |(_, inner)| inner);
        let extension = Path::new(path).extension()?.to_string_lossy().to_lowercase();
        FORMATS.iter().find(|format| format.extensions.contains(&extension.as_str()))
    }

    /// How the name of a file asks a table of this format to be packed as a whole.
    pub(crate) fn packed(&self, path: &str) -> Result<Option<Packed>, Stop> {
        let Some((packed, inner)) = Packed::of_path(path) else { return Ok(None) };
        if self.is_text {
            return Ok(Some(packed));
        }
        let what = format!("--output {path}: {} is packed inside; name it {inner}", self.name);
        Err(Stop::Usage(what))
    }

    /// The format of a table that begins with these bytes.
    pub(crate) fn of_bytes(bytes: &[u8]) -> &'static Self {
        let known = |format: &&Self| format.magic.iter().any(|magic| bytes.starts_with(magic));
        FORMATS.iter().find(known).unwrap_or(&FORMATS[0])
    }
}
