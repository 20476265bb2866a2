//! Readers of libraries that may panic over broken input: that, too, is an input that is invalid.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};

use arrow_array::RecordBatch;
use arrow_schema::SchemaRef;

use super::{Format, Input, Packing, Purpose, Source};
use crate::stop::Stop;

struct Guarded {
    name: String,
    source: Box<dyn Source>,
}

/// Opens a table.
pub(super) fn open(format: &Format, input: Input, purpose: Purpose<'_>) -> Result<Box<dyn Source>, Stop> {
    let name = input.name.clone();
    let source = guarded(&name, || (format.open)(input, purpose))?;
    Ok(Box::new(Guarded { name, source }))
}

/// Does `work` without a word on stderr if it panics.
fn guarded<T>(name: &str, work: impl FnOnce() -> Result<T, Stop>) -> Result<T, Stop> {
    let hook = take_hook();
    set_hook(Box::new(|_| {}));
    // What panicked is not used again.
    let done = catch_unwind(AssertUnwindSafe(work));
    set_hook(hook);
    done.unwrap_or_else(|_| Err(Stop::invalid(name, "not a whole table: it contradicts itself")))
}

impl Source for Guarded {
    fn schema(&self) -> Option<SchemaRef> {
        self.source.schema()
    }

    fn next(&mut self) -> Option<Result<RecordBatch, Stop>> {
        let Self { name, source } = self;
        guarded(name, || source.next().transpose()).transpose()
    }

    fn place(&self, row: usize) -> String {
        self.source.place(row)
    }

    fn is_broken(&self, row: usize) -> bool {
        self.source.is_broken(row)
    }

    fn rows(&self) -> Option<u64> {
        self.source.rows()
    }

    fn packing(&self) -> Packing {
        self.source.packing()
    }
}
