//! Tables of any size in CSV, NDJSON, Arrow IPC and Parquet, read and written in batches.
//!
//! A reader never allocates memory for a size that the input only states. Files, in the order of the data:
//! - `input`: input files and pipes, with decompression
//! - `text`: encoding and separator of CSV text
//! - `csv`, `ndjson`, `arrow`, `parquet`: readers and writers of one format each
//! - `page_guard`, `zstd_bound`: limits for the decompressed size of Parquet pages

mod arrow;
mod text;
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
pub(crate) use input::{FileCompression, Input};
pub(crate) use parquet::OutputOptions;

use crate::stop::CommandError;

/// Number of rows of a batch: large enough for efficient columns, small enough for the cache.
pub(crate) const BATCH_ROWS: usize = 8192;

/// Maximum size of a row of text, in bytes.
const MAX_ROW_BYTES: u64 = 64 << 20;

/// Maximum number of columns of a text table.
const MAX_COLUMNS: usize = 10_000;
/// Number of first rows of a text table that determine the column types.
const TYPE_INFERENCE_ROWS: usize = 1 << 16;
/// Memory of a text cell in addition to its text, in bytes.
const CELL_BYTES: usize = 8;

/// Table reader.
pub(crate) trait Source {
    /// Returns the columns, if they are known before the first row.
    fn schema(&self) -> Option<SchemaRef>;

    /// Returns the next batch; its columns may differ from the previous batch if the format allows it.
    fn next(&mut self) -> Option<Result<RecordBatch, CommandError>>;

    /// Returns the name of a row of the last batch, for messages.
    fn row_name(&self, row: usize) -> String;

    /// Whether a row of the last batch is incomplete; its cells may be shifted.
    fn is_incomplete(&self, _row: usize) -> bool {
        false
    }

    /// Returns the total number of rows, if known.
    fn rows(&self) -> Option<u64> {
        None
    }

    /// Returns the compression of the table, for output in the same format.
    fn output_options(&self) -> OutputOptions {
        OutputOptions::default()
    }
}

/// Table writer.
pub(crate) trait Sink {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), CommandError>;

    /// Finishes the table.
    fn finish(self: Box<Self>) -> Result<(), CommandError>;
}

/// Options for reading a table.
#[derive(Clone, Copy)]
pub(crate) struct ReadOptions<'a> {
    /// Format of the output.
    pub(crate) to: &'static Format,
    /// Columns that stay text, even if their cells look like numbers.
    pub(crate) as_text: &'a [String],
    /// Whether incomplete rows are read ([`Source::is_incomplete`]) instead of ending the run.
    pub(crate) keeps_incomplete: bool,
}

/// Advice for an incomplete row.
const CONTINUE_HINT: &str = "use --bad-rows status to continue";

/// Writer of the output.
pub(crate) type Output<'a> = Box<dyn Write + Send + 'a>;

type Open = fn(Input, ReadOptions<'_>) -> Result<Box<dyn Source>, CommandError>;
type Create = for<'a> fn(Output<'a>, &Schema, OutputOptions) -> Result<Box<dyn Sink + 'a>, CommandError>;

/// Table format.
pub(crate) struct Format {
    /// Name of the format on the command line.
    pub(crate) name: &'static str,
    pub(crate) about: &'static str,
    /// File name extensions, without the dot.
    extensions: &'static [&'static str],
    /// First bytes of the format, which identify it in a file or a pipe.
    magic: &'static [&'static [u8]],
    /// Whether values have types; otherwise all are text.
    is_typed: bool,
    /// Whether the format is text, which is compressed as a whole or not at all.
    is_text: bool,
    open: Open,
    pub(crate) create: Create,
}

/// Supported formats. The first is the default for input with unknown first bytes and extension.
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
        about: "one JSON object per line",
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
    pub(crate) fn open(
        &self,
        input: Input,
        purpose: ReadOptions<'_>,
    ) -> Result<Box<dyn Source>, CommandError> {
        input::open(self, input, purpose)
    }

    /// Returns the format with this name on the command line; fails for an unknown name.
    pub(crate) fn from_name(name: &str) -> Result<&'static Self, CommandError> {
        let found = FORMATS.iter().find(|format| format.name == name);
        found.ok_or_else(|| CommandError::Usage(format!("{name}: unknown table format")))
    }

    /// Returns the format for a file name, ignoring the extension of a compression.
    pub(crate) fn from_path(path: &str) -> Option<&'static Self> {
        let path = FileCompression::from_file_name(path).map_or(path, |(_, inner)| inner);
        let extension = Path::new(path).extension()?.to_string_lossy().to_lowercase();
        FORMATS.iter().find(|format| format.extensions.contains(&extension.as_str()))
    }

    /// Returns the compression that the output's file name requests.
    pub(crate) fn compression_for(&self, path: &str) -> Result<Option<FileCompression>, CommandError> {
        let Some((packed, inner)) = FileCompression::from_file_name(path) else { return Ok(None) };
        if self.is_text {
            return Ok(Some(packed));
        }
        let what = format!("--output {path}: {} is compressed internally; name the file {inner}", self.name);
        Err(CommandError::Usage(what))
    }

    /// Detects the format from the first bytes of a table.
    pub(crate) fn from_first_bytes(bytes: &[u8]) -> &'static Self {
        let known = |format: &&Self| format.magic.iter().any(|magic| bytes.starts_with(magic));
        FORMATS.iter().find(known).unwrap_or(&FORMATS[0])
    }
}
