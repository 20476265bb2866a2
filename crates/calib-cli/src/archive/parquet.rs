//! Apache Parquet tables: row groups are read page by page.

use std::sync::Arc;

use ::parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder,
};
use ::parquet::arrow::{ARROW_SCHEMA_META_KEY, ArrowWriter};
use ::parquet::basic::{Compression, Encoding, ZstdLevel};
use ::parquet::file::metadata::{ColumnChunkMetaData, KeyValue, ParquetMetaData};
use ::parquet::file::properties::{EnabledStatistics, WriterProperties};
use ::parquet::schema::types::ColumnPath;
use arrow_array::RecordBatch;
use arrow_schema::{DataType, Schema, SchemaRef};

use super::page_guard::PageGuard;
use super::{BATCH_ROWS, Input, Output, ReadOptions, Sink, Source};
use crate::stop::CommandError;

/// Number of rows of a written row group, which stays encoded in memory until it is complete.
const GROUP_ROWS: usize = 1 << 18;

/// Options of the output file. A Parquet output keeps the compression of a Parquet input.
#[derive(Clone, Debug, Default)]
pub(crate) struct OutputOptions {
    /// Whether text cells stay unchanged, even if a spreadsheet would read them as formulas.
    pub(crate) is_verbatim: bool,
    codec: Option<Compression>,
    /// Columns that have no dictionary in the input, because a dictionary did not reduce their size.
    plain: Vec<ColumnPath>,
}

impl OutputOptions {
    /// Returns the output options that reproduce the compression of the first row group of the input.
    fn from_metadata(about: &ParquetMetaData) -> Self {
        let Some(group) = about.row_groups().first() else { return Self::default() };
        let has_dictionary = |column: &ColumnChunkMetaData| {
            column.encodings().any(|e| matches!(e, Encoding::RLE_DICTIONARY | Encoding::PLAIN_DICTIONARY))
        };
        let plain = group.columns().iter().filter(|column| !has_dictionary(column));
        let plain = plain.map(|column| column.column_path().clone()).collect();
        Self {
            is_verbatim: false,
            codec: group.columns().first().map(ColumnChunkMetaData::compression),
            plain,
        }
    }
}

struct ParquetSource {
    name: String,
    reader: ParquetRecordBatchReader,
    schema: SchemaRef,
    packing: OutputOptions,
    row_count: u64,
    /// Number of rows before the last batch, for messages; `rows` is the number in that batch.
    rows_before: usize,
    rows: usize,
}

pub(super) fn open(input: Input, _purpose: ReadOptions<'_>) -> Result<Box<dyn Source>, CommandError> {
    let name = input.name.clone();
    let broken = |error| CommandError::invalid(&name, format!("cannot be read as a Parquet file: {error}"));
    let file = input.into_file()?;
    let meta = ArrowReaderMetadata::load(&file, ArrowReaderOptions::new()).map_err(broken)?;
    let about = meta.metadata();
    check_codecs(&name, about)?;
    let all = u64::try_from(about.file_metadata().num_rows()).unwrap_or_default();
    let packing = OutputOptions::from_metadata(about);
    let schema = Arc::clone(meta.schema());
    let guard = PageGuard::new(file, about);
    let builder = ParquetRecordBatchReaderBuilder::new_with_metadata(guard, meta);
    let reader = builder.with_batch_size(BATCH_ROWS).build().map_err(broken)?;
    Ok(Box::new(ParquetSource { name, reader, schema, packing, row_count: all, rows_before: 0, rows: 0 }))
}

/// Refuses unsupported compression, and names it.
fn check_codecs(name: &str, about: &ParquetMetaData) -> Result<(), CommandError> {
    let columns = about.row_groups().iter().flat_map(|group| group.columns());
    for column in columns {
        let codec = match column.compression() {
            Compression::BROTLI(_) => "Brotli",
            Compression::LZO => "LZO",
            _ => continue,
        };
        let what = format!(
            "column {}: compressed with {codec}, which is not supported; use Zstandard, Snappy, gzip or LZ4",
            column.column_path()
        );
        return Err(CommandError::invalid(name, what));
    }
    Ok(())
}

impl Source for ParquetSource {
    fn schema(&self) -> Option<SchemaRef> {
        Some(Arc::clone(&self.schema))
    }

    fn next(&mut self) -> Option<Result<RecordBatch, CommandError>> {
        let batch = self.reader.next()?;
        self.rows_before += self.rows;
        self.rows = batch.as_ref().map_or(0, RecordBatch::num_rows);
        // The batches of the library do not contain the metadata of the file.
        let batch = batch.and_then(|batch| batch.with_schema(Arc::clone(&self.schema)));
        Some(batch.map_err(|error| {
            let place = self.row_name(0);
            CommandError::invalid(
                &self.name,
                format!("{place} or soon after: cannot be read as a Parquet file: {error}"),
            )
        }))
    }

    fn row_name(&self, row: usize) -> String {
        format!("row {}", self.rows_before + row + 1)
    }

    fn rows(&self) -> Option<u64> {
        Some(self.row_count)
    }

    fn output_options(&self) -> OutputOptions {
        self.packing.clone()
    }
}

pub(super) fn create<'a>(
    output: Output<'a>,
    schema: &Schema,
    packing: OutputOptions,
) -> Result<Box<dyn Sink + 'a>, CommandError> {
    // Codecs without a writer (LZO, Brotli) are replaced by Zstandard, and deprecated LZ4 by its raw form.
    let codec = match packing.codec {
        None | Some(Compression::LZO | Compression::BROTLI(_)) => Compression::ZSTD(ZstdLevel::default()),
        Some(Compression::LZ4) => Compression::LZ4_RAW,
        Some(codec) => codec,
    };
    let about = schema.metadata().iter().filter(|(key, _)| *key != ARROW_SCHEMA_META_KEY);
    let about = about.map(|(key, value)| KeyValue::new(key.clone(), value.clone())).collect();
    let mut properties = WriterProperties::builder()
        .set_compression(codec)
        .set_max_row_group_row_count(Some(GROUP_ROWS))
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_key_value_metadata(Some(about));
    // Dictionaries are useless for doubles, which rarely repeat.
    let doubles = schema.fields().iter().filter(|field| field.data_type() == &DataType::Float64);
    let doubles = doubles.map(|field| ColumnPath::from(field.name().as_str()));
    for path in doubles.chain(packing.plain) {
        properties = properties.set_column_dictionary_enabled(path, false);
    }
    let schema = Arc::new(schema.clone());
    Ok(Box::new(ArrowWriter::try_new(output, schema, Some(properties.build()))?))
}

impl Sink for ArrowWriter<Output<'_>> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), CommandError> {
        Ok(Self::write(self, batch)?)
    }

    fn finish(self: Box<Self>) -> Result<(), CommandError> {
        use std::io::Write as _;
        Ok(self.into_inner()?.flush()?)
    }
}
