//! Apache Parquet: row groups are read and written page by page.

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
use super::{BATCH_ROWS, Input, Output, Purpose, Sink, Source};
use crate::stop::Stop;

/// Rows of a group that is written: it is in memory, encoded, until it is whole.
const GROUP_ROWS: usize = 1 << 18;

/// How a table is written: a Parquet file as the one that is read is packed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Packing {
    /// Whether cells of text stay as they are, even what a spreadsheet would run.
    pub(crate) is_verbatim: bool,
    codec: Option<Compression>,
    /// Columns without a dictionary: they have shown that it is built in vain.
    plain: Vec<ColumnPath>,
}

impl Packing {
    /// As the first row group is.
    fn of(about: &ParquetMetaData) -> Self {
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

struct Pages {
    name: String,
    reader: ParquetRecordBatchReader,
    schema: SchemaRef,
    packing: Packing,
    all: u64,
    /// Rows before the last batch, and in it.
    before: usize,
    rows: usize,
}

pub(super) fn open(input: Input, _purpose: Purpose<'_>) -> Result<Box<dyn Source>, Stop> {
    let name = input.name.clone();
    let broken = |error| Stop::invalid(&name, format!("not a whole Parquet file: {error}"));
    let file = input.into_file()?;
    let meta = ArrowReaderMetadata::load(&file, ArrowReaderOptions::new()).map_err(broken)?;
    let about = meta.metadata();
    check_codecs(&name, about)?;
    let all = u64::try_from(about.file_metadata().num_rows()).unwrap_or_default();
    let packing = Packing::of(about);
    let schema = Arc::clone(meta.schema());
    let guard = PageGuard::new(file, about);
    let builder = ParquetRecordBatchReaderBuilder::new_with_metadata(guard, meta);
    let reader = builder.with_batch_size(BATCH_ROWS).build().map_err(broken)?;
    Ok(Box::new(Pages { name, reader, schema, packing, all, before: 0, rows: 0 }))
}

/// Refuses what is packed in a way that is not read, by its name.
fn check_codecs(name: &str, about: &ParquetMetaData) -> Result<(), Stop> {
    let columns = about.row_groups().iter().flat_map(|group| group.columns());
    for column in columns {
        let codec = match column.compression() {
            Compression::BROTLI(_) => "Brotli",
            Compression::LZO => "LZO",
            _ => continue,
        };
        let what = format!(
            "column {}: packed with {codec}, which is not read; write the file with Zstandard, Snappy, gzip or LZ4",
            column.column_path()
        );
        return Err(Stop::invalid(name, what));
    }
    Ok(())
}

impl Source for Pages {
    fn schema(&self) -> Option<SchemaRef> {
        Some(Arc::clone(&self.schema))
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        let batch = self.reader.next()?;
        self.before += self.rows;
        self.rows = batch.as_ref().map_or(0, RecordBatch::num_rows);
        // The library's batches say nothing of what the file says of itself.
        let batch = batch.and_then(|batch| batch.with_schema(Arc::clone(&self.schema)));
        Some(batch.map_err(|error| {
            let place = self.place(0);
            Stop::invalid(&self.name, format!("{place} or soon after: not a whole Parquet file: {error}"))
        }))
    }

    fn place(&self, row: usize) -> String {
        format!("row {}", self.before + row + 1)
    }

    fn rows(&self) -> Option<u64> {
        Some(self.all)
    }

    fn packing(&self) -> Packing {
        self.packing.clone()
    }
}

pub(super) fn create<'a>(
    output: Output<'a>,
    schema: &Schema,
    packing: Packing,
) -> Result<Box<dyn Sink + 'a>, Stop> {
    // What the input has and cannot be written (LZO) is written as what is read everywhere.
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
    // Doubles hardly repeat.
    let doubles = schema.fields().iter().filter(|field| field.data_type() == &DataType::Float64);
    let doubles = doubles.map(|field| ColumnPath::from(field.name().as_str()));
    for path in doubles.chain(packing.plain) {
        properties = properties.set_column_dictionary_enabled(path, false);
    }
    let schema = Arc::new(schema.clone());
    Ok(Box::new(ArrowWriter::try_new(output, schema, Some(properties.build()))?))
}

impl Sink for ArrowWriter<Output<'_>> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), Stop> {
        Ok(Self::write(self, batch)?)
    }

    fn finish(self: Box<Self>) -> Result<(), Stop> {
        use std::io::Write as _;
        Ok(self.into_inner()?.flush()?)
    }
}
