//! Arrow IPC, as a stream and as a file.

use std::io::Read;

use ::arrow::array::RecordBatch;
use ::arrow::buffer::Buffer;
use ::arrow::datatypes::{Schema, SchemaRef};
use ::arrow::error::ArrowError;
use ::arrow::ipc::reader::StreamDecoder;
use ::arrow::ipc::writer::{FileWriter, StreamWriter};

use super::{Format, Input, Output, Packing, Sink, Source};
use crate::stop::Stop;

/// An IPC file begins and ends with this; between is a stream, after some zeros, and the list of its parts.
const MAGIC: &[u8] = b"ARROW1";

/// Bytes read at once.
const CHUNK: usize = 1 << 20;

struct Stream {
    name: String,
    from: Box<dyn Read>,
    is_file: bool,
    /// Takes memory for what has come, not for what a length promises.
    decoder: StreamDecoder,
    chunk: Buffer,
    /// A batch that came along with the schema.
    first: Option<RecordBatch>,
    /// Rows before the last batch, and in it.
    before: usize,
    rows: usize,
}

pub(super) fn open(mut input: Input, _to: &'static Format) -> Result<Box<dyn Source>, Stop> {
    let name = input.name.clone();
    let is_file = input.format()?.name == "arrow-file";
    let (decoder, chunk) = (StreamDecoder::new(), Buffer::from(Vec::<u8>::new()));
    let from = input.into_read();
    let mut stream = Stream { name, from, is_file, decoder, chunk, first: None, before: 0, rows: 0 };
    if is_file {
        stream.skip_to_stream()?;
    }
    stream.first = stream.decode()?;
    if stream.decoder.schema().is_none() {
        return Err(stream.broken("no schema"));
    }
    Ok(Box::new(stream))
}

impl Stream {
    fn broken(&self, error: impl std::fmt::Display) -> Stop {
        Stop::invalid(&self.name, format!("not a whole Arrow IPC stream or file: {error}"))
    }

    /// Reads on, if all that was read is decoded; whether there is anything left.
    fn fill(&mut self) -> Result<bool, Stop> {
        if self.chunk.is_empty() {
            let mut bytes = Vec::with_capacity(CHUNK);
            let read = self.from.by_ref().take(CHUNK as u64).read_to_end(&mut bytes);
            read.map_err(|error| self.broken(error))?;
            self.chunk = Buffer::from(bytes);
        }
        Ok(!self.chunk.is_empty())
    }

    /// The zeros after the magic are up to 64 bytes long, and a stream begins with other bytes.
    fn skip_to_stream(&mut self) -> Result<(), Stop> {
        if self.fill()? {
            self.chunk.advance(MAGIC.len().min(self.chunk.len()));
            let zeros = self.chunk.iter().take_while(|&&byte| byte == 0).count();
            self.chunk.advance(zeros);
        }
        Ok(())
    }

    /// The next batch.
    fn decode(&mut self) -> Result<Option<RecordBatch>, Stop> {
        while self.fill()? {
            match self.decoder.decode(&mut self.chunk) {
                Ok(None) => {}
                Ok(batch) => return Ok(batch),
                // The stream has ended, and the list of its parts follows.
                Err(_) if self.is_file && self.decoder.finish().is_ok() => {
                    return self.check_end().map(|()| None);
                }
                Err(error) => return Err(self.broken(error)),
            }
        }
        let ended = self.decoder.finish();
        ended.map_err(|error: ArrowError| self.broken(error))?;
        if self.is_file { Err(self.broken("its end is missing")) } else { Ok(None) }
    }

    /// A file that was cut has not the end of one.
    fn check_end(&mut self) -> Result<(), Stop> {
        let mut end = Vec::new();
        while self.fill()? {
            end.extend_from_slice(&self.chunk);
            end.drain(..end.len().saturating_sub(MAGIC.len()));
            self.chunk.advance(self.chunk.len());
        }
        if end == MAGIC { Ok(()) } else { Err(self.broken("its end is missing")) }
    }
}

impl Source for Stream {
    fn schema(&self) -> Option<SchemaRef> {
        self.decoder.schema()
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        self.before += self.rows;
        self.rows = 0;
        let batch = match self.first.take() {
            Some(batch) => Ok(Some(batch)),
            None => self.decode(),
        };
        self.rows = batch.as_ref().ok().and_then(Option::as_ref).map_or(0, RecordBatch::num_rows);
        batch.transpose()
    }

    fn place(&self, row: usize) -> String {
        format!("row {}", self.before + row + 1)
    }
}

impl Sink for StreamWriter<Output<'_>> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), Stop> {
        Ok(Self::write(self, batch)?)
    }

    fn finish(mut self: Box<Self>) -> Result<(), Stop> {
        Self::finish(&mut self)?;
        Ok(self.get_mut().flush()?)
    }
}

impl Sink for FileWriter<Output<'_>> {
    fn write(&mut self, batch: &RecordBatch) -> Result<(), Stop> {
        Ok(Self::write(self, batch)?)
    }

    fn finish(mut self: Box<Self>) -> Result<(), Stop> {
        Self::finish(&mut self)?;
        Ok(self.get_mut().flush()?)
    }
}

pub(super) fn create_stream<'a>(
    output: Output<'a>,
    schema: &Schema,
    _packing: Packing,
) -> Result<Box<dyn Sink + 'a>, Stop> {
    Ok(Box::new(StreamWriter::try_new(output, schema)?))
}

pub(super) fn create_file<'a>(
    output: Output<'a>,
    schema: &Schema,
    _packing: Packing,
) -> Result<Box<dyn Sink + 'a>, Stop> {
    Ok(Box::new(FileWriter::try_new(output, schema)?))
}
