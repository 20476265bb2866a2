//! Arrow IPC streams and files, and the conversion of zoned times to UTC for text formats.

use std::io::{BufRead as _, BufReader, Read};
use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType,
};
use arrow_array::{
    Array as _, ArrayRef, FixedSizeListArray, LargeListArray, ListArray, RecordBatch, RecordBatchOptions,
    StructArray,
};
use arrow_buffer::Buffer;
use arrow_ipc::reader::StreamDecoder;
use arrow_ipc::root_as_message;
use arrow_ipc::writer::{FileWriter, StreamWriter};
use arrow_schema::{ArrowError, DataType, Field, FieldRef, Schema, SchemaRef, TimeUnit};

use super::{Input, Output, OutputOptions, ReadOptions, Sink, Source};
use crate::stop::CommandError;

/// First and last bytes of an IPC file. Between them are padding zeros, a stream, and a footer.
const MAGIC: &[u8] = b"ARROW1";

/// Maximum number of bytes that are read at once.
const CHUNK: usize = 1 << 20;

/// Marker before the length of a message; older streams do not have it.
const CONTINUATION: [u8; 4] = [0xFF; 4];

/// Decompressed size of a batch, in bytes, up to which any compression ratio is accepted. Arrow allocates the
/// stated size before it decompresses.
const MAX_BATCH_BYTES: u64 = 256 << 20;
/// Limit for the compression ratio of batches that are larger than [`MAX_BATCH_BYTES`].
const MAX_COMPRESSION_RATIO: u64 = 64;

struct Stream {
    name: String,
    from: BufReader<Box<dyn Read>>,
    is_file: bool,
    /// Whether the last message was read.
    is_finished: bool,
    /// Decoder of messages; it allocates memory for received bytes only, not for the stated length of a message.
    decoder: StreamDecoder,
    chunk: Buffer,
    /// First batch, which was decoded together with the schema.
    first: Option<RecordBatch>,
    /// Number of rows before the last batch, for messages; `rows` is the number in that batch.
    rows_before: usize,
    rows: usize,
}

pub(super) fn open(mut input: Input, _purpose: ReadOptions<'_>) -> Result<Box<dyn Source>, CommandError> {
    let name = input.name.clone();
    let is_file = input.format()?.name == "arrow-file";
    let (decoder, chunk) = (StreamDecoder::new(), Buffer::from(Vec::<u8>::new()));
    let from = BufReader::with_capacity(CHUNK, input.into_read());
    let (first, before, rows) = (None, 0, 0);
    let mut stream =
        Stream { name, from, is_file, is_finished: false, decoder, chunk, first, rows_before: before, rows };
    if is_file {
        stream.skip_to_stream()?;
    }
    stream.first = stream.decode()?;
    if stream.decoder.schema().is_none() {
        return Err(stream.invalid("the schema is missing"));
    }
    Ok(Box::new(stream))
}

impl Stream {
    fn invalid(&self, error: impl std::fmt::Display) -> CommandError {
        CommandError::invalid(&self.name, format!("cannot be read as an Arrow IPC stream or file: {error}"))
    }

    /// Reads up to `count` bytes of the input and appends them to `bytes`.
    fn read(&mut self, bytes: &mut Vec<u8>, count: u64) -> Result<(), CommandError> {
        let read = self.from.by_ref().take(count).read_to_end(bytes);
        read.map(drop).map_err(|error| self.invalid(error))
    }

    /// Reads the next message if all previous bytes are decoded; after the last message, reads the remaining
    /// bytes. Returns whether any bytes are left.
    fn fill(&mut self) -> Result<bool, CommandError> {
        if self.chunk.is_empty() {
            let mut bytes = Vec::new();
            if self.is_finished {
                self.read(&mut bytes, CHUNK as u64)?;
            } else {
                self.is_finished = !self.read_message(&mut bytes)?;
            }
            self.chunk = Buffer::from(bytes);
        }
        Ok(!self.chunk.is_empty())
    }

    /// Reads a message, and returns whether more messages can follow. No message follows an end marker or an invalid
    /// message; the decoder reports an invalid message.
    fn read_message(&mut self, bytes: &mut Vec<u8>) -> Result<bool, CommandError> {
        self.read(bytes, 4)?;
        if *bytes == CONTINUATION {
            self.read(bytes, 4)?;
        }
        let length = bytes.last_chunk().map_or(0, |length| i32::from_le_bytes(*length));
        let Ok(length @ 1..) = u64::try_from(length) else { return Ok(false) };
        let head = bytes.len();
        self.read(bytes, length)?;
        let Ok(message) = root_as_message(&bytes[head..]) else { return Ok(false) };
        let Ok(body) = u64::try_from(message.bodyLength()) else { return Ok(false) };
        let dictionary = message.header_as_dictionary_batch().and_then(|dictionary| dictionary.data());
        let batch = message.header_as_record_batch().or(dictionary);
        let packed = batch.filter(|batch| batch.compression().is_some()).and_then(|batch| batch.buffers());
        let offsets: Vec<i64> =
            packed.iter().flatten().filter(|part| part.length() >= 8).map(|part| part.offset()).collect();
        let start = bytes.len();
        self.read(bytes, body)?;
        let promised = |offset: i64| {
            let at = usize::try_from(offset).ok().and_then(|offset| start.checked_add(offset))?;
            bytes.get(at..)?.first_chunk().map(|bytes| i64::from_le_bytes(*bytes))
        };
        self.check_stated_size(offsets.into_iter().filter_map(promised), (bytes.len() - start) as u64)?;
        Ok(true)
    }

    /// Refuses a batch whose stated decompressed size exceeds the limits for its `packed` compressed bytes,
    /// before memory is allocated.
    fn check_stated_size(
        &self,
        promised: impl Iterator<Item = i64>,
        packed: u64,
    ) -> Result<(), CommandError> {
        // A negative length marks an uncompressed column, or is refused by the library.
        let sum = promised.filter_map(|length| u64::try_from(length).ok()).fold(0, u64::saturating_add);
        let most = MAX_BATCH_BYTES.max(packed.saturating_mul(MAX_COMPRESSION_RATIO));
        if sum > most {
            let what = format!(
                "a batch of {packed} bytes decompresses to {sum} bytes, more than the limit of {most} bytes; \
                 write the file with smaller batches"
            );
            return Err(self.invalid(what));
        }
        calib_input::check_memory(sum).map_err(|error| self.invalid(format!("a batch {error}")))
    }

    /// Skips the magic bytes and the zeros that pad them to 8 or 64 bytes.
    fn skip_to_stream(&mut self) -> Result<(), CommandError> {
        let mut bytes = Vec::new();
        self.read(&mut bytes, MAGIC.len() as u64 + 2)?;
        while let Ok(ahead) = self.from.fill_buf() {
            let zeros = ahead.iter().take_while(|&&byte| byte == 0).count();
            if zeros == 0 {
                break;
            }
            self.from.consume(zeros);
        }
        Ok(())
    }

    /// Decodes the next batch.
    fn decode(&mut self) -> Result<Option<RecordBatch>, CommandError> {
        while self.fill()? {
            match self.decoder.decode(&mut self.chunk) {
                Ok(None) => {}
                Ok(batch) => return Ok(batch),
                // The stream has ended; the footer follows.
                Err(_) if self.is_file && self.decoder.finish().is_ok() => {
                    return self.check_end().map(|()| None);
                }
                Err(error) => return Err(self.invalid(error)),
            }
        }
        let ended = self.decoder.finish();
        ended.map_err(|error: ArrowError| self.invalid(error))?;
        if self.is_file { Err(self.invalid("the file is incomplete; copy it again")) } else { Ok(None) }
    }

    /// Checks the last bytes of the file, which are missing if it was truncated.
    fn check_end(&mut self) -> Result<(), CommandError> {
        let mut end = Vec::new();
        while self.fill()? {
            end.extend_from_slice(&self.chunk);
            end.drain(..end.len().saturating_sub(MAGIC.len()));
            self.chunk.advance(self.chunk.len());
        }
        if end == MAGIC { Ok(()) } else { Err(self.invalid("the file is incomplete; copy it again")) }
    }
}

impl Source for Stream {
    fn schema(&self) -> Option<SchemaRef> {
        self.decoder.schema()
    }

    fn next(&mut self) -> Option<Result<RecordBatch, CommandError>> {
        self.rows_before += self.rows;
        self.rows = 0;
        let batch = match self.first.take() {
            Some(batch) => Ok(Some(batch)),
            None => self.decode(),
        };
        self.rows = batch.as_ref().ok().and_then(Option::as_ref).map_or(0, RecordBatch::num_rows);
        batch.transpose()
    }

    fn row_name(&self, row: usize) -> String {
        format!("row {}", self.rows_before + row + 1)
    }
}

impl Sink for StreamWriter<Output<'_>> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), CommandError> {
        Ok(Self::write(self, batch)?)
    }

    fn finish(mut self: Box<Self>) -> Result<(), CommandError> {
        Self::finish(&mut self)?;
        Ok(self.get_mut().flush()?)
    }
}

impl Sink for FileWriter<Output<'_>> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), CommandError> {
        Ok(Self::write(self, batch)?)
    }

    fn finish(mut self: Box<Self>) -> Result<(), CommandError> {
        Self::finish(&mut self)?;
        Ok(self.get_mut().flush()?)
    }
}

pub(super) fn create_stream<'a>(
    output: Output<'a>,
    schema: &Schema,
    _options: OutputOptions,
) -> Result<Box<dyn Sink + 'a>, CommandError> {
    Ok(Box::new(StreamWriter::try_new(output, schema)?))
}

pub(super) fn create_file<'a>(
    output: Output<'a>,
    schema: &Schema,
    _options: OutputOptions,
) -> Result<Box<dyn Sink + 'a>, CommandError> {
    Ok(Box::new(FileWriter::try_new(output, schema)?))
}

/// Time zone of UTC, as an offset.
const UTC: &str = "+00:00";

/// Converts zoned times to the same instants in UTC, because text has offsets but no zone names.
pub(super) fn to_utc(batch: &RecordBatch) -> Result<RecordBatch, CommandError> {
    let schema = batch.schema();
    let columns = batch.columns().iter().map(column_to_utc).collect::<Result<Vec<_>, _>>()?;
    let fields: Vec<FieldRef> =
        schema.fields().iter().zip(&columns).map(|(field, column)| field_with_type(field, column)).collect();
    let options = RecordBatchOptions::new().with_row_count(Some(batch.num_rows()));
    let schema = Arc::new(Schema::new(fields).with_metadata(schema.metadata().clone()));
    Ok(RecordBatch::try_new_with_options(schema, columns, &options)?)
}

/// Converts the zoned times of a column, also inside lists and records, to UTC. Arrow stores zoned times in
/// UTC, so only the zone in the data type changes.
fn column_to_utc(column: &ArrayRef) -> Result<ArrayRef, ArrowError> {
    Ok(match column.data_type() {
        DataType::Timestamp(unit, Some(_)) => match unit {
            TimeUnit::Second => {
                Arc::new(column.as_primitive::<TimestampSecondType>().clone().with_timezone(UTC))
            }
            TimeUnit::Millisecond => {
                Arc::new(column.as_primitive::<TimestampMillisecondType>().clone().with_timezone(UTC))
            }
            TimeUnit::Microsecond => {
                Arc::new(column.as_primitive::<TimestampMicrosecondType>().clone().with_timezone(UTC))
            }
            TimeUnit::Nanosecond => {
                Arc::new(column.as_primitive::<TimestampNanosecondType>().clone().with_timezone(UTC))
            }
        },
        DataType::List(_) => {
            let (item, ends, values, nulls) = column.as_list::<i32>().clone().into_parts();
            let values = column_to_utc(&values)?;
            Arc::new(ListArray::try_new(field_with_type(&item, &values), ends, values, nulls)?)
        }
        DataType::LargeList(_) => {
            let (item, ends, values, nulls) = column.as_list::<i64>().clone().into_parts();
            let values = column_to_utc(&values)?;
            Arc::new(LargeListArray::try_new(field_with_type(&item, &values), ends, values, nulls)?)
        }
        DataType::FixedSizeList(..) => {
            let (item, size, values, nulls) = column.as_fixed_size_list().clone().into_parts();
            let values = column_to_utc(&values)?;
            let item = field_with_type(&item, &values);
            Arc::new(FixedSizeListArray::try_new_with_length(item, size, values, nulls, column.len())?)
        }
        DataType::Struct(_) => {
            let (fields, columns, nulls) = column.as_struct().clone().into_parts();
            let columns = columns.iter().map(column_to_utc).collect::<Result<Vec<_>, _>>()?;
            let fields =
                fields.iter().zip(&columns).map(|(field, column)| field_with_type(field, column)).collect();
            Arc::new(StructArray::try_new_with_length(fields, columns, nulls, column.len())?)
        }
        _ => Arc::clone(column),
    })
}

/// Returns the field with the data type of its converted column.
fn field_with_type(field: &FieldRef, column: &ArrayRef) -> FieldRef {
    Arc::new(Field::clone(field).with_data_type(column.data_type().clone()))
}

#[cfg(test)]
mod tests {
    use arrow_array::types::Int32Type;
    use arrow_array::{DictionaryArray, TimestampMillisecondArray};
    use arrow_buffer::OffsetBuffer;

    use super::*;

    fn times(zone: &str) -> ArrayRef {
        Arc::new(TimestampMillisecondArray::from(vec![Some(0), None, Some(-5)]).with_timezone(zone))
    }

    #[test]
    fn nested_zoned_times_become_the_same_instants_in_utc() {
        let nested = |zone: &str| -> ArrayRef {
            let item = Arc::new(Field::new("item", times(zone).data_type().clone(), true));
            let ends = OffsetBuffer::from_lengths([2, 0, 1]);
            let lists: ArrayRef = Arc::new(ListArray::new(item, ends, times(zone), None));
            let item = Arc::new(Field::new("item", times(zone).data_type().clone(), true));
            let none = FixedSizeListArray::try_new_with_length(item, 0, times(zone).slice(0, 0), None, 3);
            let none: ArrayRef = Arc::new(none.expect("three empty lists"));
            let named = |name: &str, of: &ArrayRef| Arc::new(Field::new(name, of.data_type().clone(), true));
            Arc::new(StructArray::from(vec![
                (named("at", &times(zone)), times(zone)),
                (named("all", &lists), lists),
                (named("none", &none), none),
            ]))
        };
        let kept: ArrayRef = Arc::new(["a", "b", "a"].into_iter().collect::<DictionaryArray<Int32Type>>());
        let batch = |zone| RecordBatch::try_from_iter([("seen", nested(zone)), ("door", Arc::clone(&kept))]);
        let found = to_utc(&batch("Asia/Kathmandu").expect("a batch")).ok();
        assert_eq!(found, batch(UTC).ok());
    }
}
