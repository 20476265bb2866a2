//! Arrow IPC, as a stream and as a file.

use std::io::{BufReader, Read};

use ::arrow::array::RecordBatch;
use ::arrow::datatypes::{Schema, SchemaRef};
use ::arrow::error::ArrowError;
use ::arrow::ipc::reader::StreamReader;
use ::arrow::ipc::writer::{FileWriter, StreamWriter};

use super::{Format, Input, Output, Packing, Sink, Source};
use crate::stop::Stop;

/// An IPC file is this and a stream, before the list of its parts.
const MAGIC: &[u8] = b"ARROW1\0\0";

struct Stream {
    name: String,
    reader: StreamReader<BufReader<Box<dyn Read>>>,
    /// Rows before the last batch, and in it.
    before: usize,
    rows: usize,
}

pub(super) fn open(mut input: Input, _to: &'static Format) -> Result<Box<dyn Source>, Stop> {
    let name = input.name.clone();
    let is_file = input.format()?.name == "arrow-file";
    let mut from = BufReader::with_capacity(1 << 20, input.into_read());
    if is_file {
        from.read_exact(&mut [0; MAGIC.len()]).map_err(|error| Stop::invalid(&name, error))?;
    }
    let reader = StreamReader::try_new(from, None).map_err(|error| broken(&name, &error))?;
    Ok(Box::new(Stream { name, reader, before: 0, rows: 0 }))
}

fn broken(name: &str, error: &ArrowError) -> Stop {
    Stop::invalid(name, format!("not a whole Arrow IPC stream or file: {error}"))
}

impl Source for Stream {
    fn schema(&self) -> Option<SchemaRef> {
        Some(self.reader.schema())
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        let batch = self.reader.next()?;
        self.before += self.rows;
        self.rows = batch.as_ref().map_or(0, RecordBatch::num_rows);
        Some(batch.map_err(|error| broken(&self.name, &error)))
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
