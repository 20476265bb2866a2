//! A file or pipe that a table is read from.

use std::cell::Cell;
use std::fs::File;
use std::io::{Cursor, Read, Seek as _, SeekFrom};
use std::rc::Rc;

use super::Format;
use crate::stop::Stop;

/// First bytes that tell a format.
const HEAD: u64 = 8;

/// A file or pipe that a table is read from.
pub(crate) struct Input {
    /// For messages.
    pub(crate) name: String,
    from: From,
    /// Bytes read so far.
    read: Rc<Cell<u64>>,
    /// Bytes in all, of a file.
    pub(crate) bytes: Option<u64>,
}

enum From {
    File(File),
    Pipe(Box<dyn Read>),
}

impl Input {
    /// Opens a file; `-` is stdin.
    pub(crate) fn open(path: &str) -> Result<Self, Stop> {
        let read = Rc::default();
        if path == "-" {
            let from = From::Pipe(Box::new(std::io::stdin().lock()));
            return Ok(Self { name: "stdin".into(), from, read, bytes: None });
        }
        let refused = |error| Stop::invalid(path, error);
        let file = File::open(path).map_err(refused)?;
        let about = file.metadata().map_err(refused)?;
        if about.is_dir() {
            return Err(Stop::invalid(path, "is a folder, expected a file"));
        }
        // A named pipe cannot be gone back in.
        let (from, bytes) = match about.is_file() {
            true => (From::File(file), Some(about.len())),
            false => (From::Pipe(Box::new(file)), None),
        };
        Ok(Self { name: path.into(), from, read, bytes })
    }

    /// The format that the first bytes tell.
    pub(crate) fn format(&mut self) -> Result<&'static Format, Stop> {
        let mut head = Vec::new();
        let refused = |error| Stop::invalid(&self.name, error);
        match &mut self.from {
            From::File(file) => {
                file.take(HEAD).read_to_end(&mut head).map_err(refused)?;
                file.seek(SeekFrom::Start(0)).map_err(refused)?;
            }
            From::Pipe(pipe) => {
                pipe.take(HEAD).read_to_end(&mut head).map_err(refused)?;
                let rest = std::mem::replace(pipe, Box::new(std::io::empty()));
                *pipe = Box::new(Cursor::new(head.clone()).chain(rest));
            }
        }
        Ok(Format::of_bytes(&head))
    }

    /// How many bytes have been read, whoever reads them.
    pub(crate) fn counter(&self) -> Rc<Cell<u64>> {
        Rc::clone(&self.read)
    }

    /// To be read from front to back.
    pub(crate) fn into_read(self) -> Box<dyn Read> {
        let from: Box<dyn Read> = match self.from {
            From::File(file) => Box::new(file),
            From::Pipe(pipe) => pipe,
        };
        Box::new(Counted { from, read: self.read })
    }

    /// To be read anywhere; a pipe is kept in a temporary file that nobody sees.
    pub(crate) fn into_file(self) -> Result<File, Stop> {
        match self.from {
            From::File(file) => Ok(file),
            From::Pipe(mut pipe) => {
                let mut kept = tempfile::tempfile()?;
                std::io::copy(&mut pipe, &mut kept)?;
                kept.seek(SeekFrom::Start(0))?;
                Ok(kept)
            }
        }
    }
}

struct Counted {
    from: Box<dyn Read>,
    read: Rc<Cell<u64>>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.from.read(buffer)?;
        self.read.set(self.read.get() + count as u64);
        Ok(count)
    }
}
