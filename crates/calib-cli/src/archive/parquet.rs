//! Apache Parquet: row groups are read and written page by page.

use std::sync::Arc;

use ::arrow::array::RecordBatch;
use ::arrow::datatypes::{DataType, Schema, SchemaRef};
use ::parquet::arrow::arrow_reader::{ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder};
use ::parquet::arrow::{ARROW_SCHEMA_META_KEY, ArrowWriter};
use ::parquet::basic::{Compression, ZstdLevel};
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::{EnabledStatistics, WriterProperties};
use ::parquet::schema::types::ColumnPath;

use super::{BATCH_ROWS, Format, Input, Output, Sink, Source};
use crate::stop::Stop;

/// Rows of a group that is written: it is in memory, encoded, until it is whole.
const GROUP_ROWS: usize = 1 << 18;

struct Pages {
    name: String,
    reader: ParquetRecordBatchReader,
    schema: SchemaRef,
    codec: Option<Compression>,
    all: u64,
    /// Rows before the last batch, and in it.
    before: usize,
    rows: usize,
}

pub(super) fn open(input: Input, _to: &'static Format) -> Result<Box<dyn Source>, Stop> {
    let name = input.name.clone();
    let broken = |error| Stop::invalid(&name, format!("not a whole Parquet file: {error}"));
    let file = input.into_file()?;
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(broken)?;
    let about = builder.metadata();
    let all = u64::try_from(about.file_metadata().num_rows()).unwrap_or_default();
    let first = about.row_groups().first().and_then(|group| group.columns().first());
    let codec = first.map(|column| column.compression());
    let schema = Arc::clone(builder.schema());
    let reader = builder.with_batch_size(BATCH_ROWS).build().map_err(broken)?;
    Ok(Box::new(Pages { name, reader, schema, codec, all, before: 0, rows: 0 }))
}

impl Source for Pages {
    fn schema(&self) -> Option<SchemaRef> {
        Some(Arc::clone(&self.schema))
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        let batch = self.reader.next()?;
        self.before += self.rows;
        self.rows = batch.as_ref().map_or(0, RecordBatch::num_rows);
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

    fn codec(&self) -> Option<Compression> {
        self.codec
    }
}

pub(super) fn create<'a>(
    output: Output<'a>,
    schema: &Schema,
    codec: Option<Compression>,
) -> Result<Box<dyn Sink + 'a>, Stop> {
    // What the input has and cannot be written (LZO) is written as what is read everywhere.
    let codec = match codec {
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
    for field in schema.fields() {
        // Doubles hardly repeat: a dictionary of them is built in vain.
        if field.data_type() == &DataType::Float64 {
            let path = ColumnPath::from(field.name().as_str());
            properties = properties.set_column_dictionary_enabled(path, false);
        }
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
