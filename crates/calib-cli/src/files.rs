//! Output files that are written completely or not at all, messages on stderr, and parallel work on many
//! files.

use std::fs::File;
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};

use anyhow::Context as _;
use calib_input::{PartialFile, PathError, resolve_target};

use crate::stop::{CommandError, escape_control_characters};

/// Writes a complete file or nothing; `-` is stdout. Overwriting a file requires `force`.
pub(crate) fn write(path: &str, bytes: &[u8], force: bool) -> Result<(), CommandError> {
    if path == "-" {
        return print_bytes(bytes);
    }
    write_through(Path::new(path), force, |mut file| Ok(file.write_all(bytes)?))
}

/// Refuses an existing output file before any work is done, unless `force` is set.
pub(crate) fn check_free(path: &str, force: bool) -> Result<(), CommandError> {
    let is_free = path == "-" || is_stream(Path::new(path));
    if is_free { Ok(()) } else { resolve_output(Path::new(path), force).map(drop) }
}

/// Creates a folder and its parents. An existing folder is kept.
pub(crate) fn create_folder(folder: &Path) -> Result<(), CommandError> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    Ok(())
}

/// Whether a path is a pipe or a device, which is not replaced.
fn is_stream(path: &Path) -> bool {
    path.metadata().is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// Returns the path that output is written to, with links resolved.
fn resolve_output(path: &Path, force: bool) -> Result<PathBuf, CommandError> {
    resolve_target(path, force).map_err(|refused| match refused {
        PathError::Exists(path) => exists_error(&path),
        PathError::BrokenLink(_) => CommandError::Failed(refused.into()),
    })
}

fn exists_error(path: &Path) -> CommandError {
    CommandError::Failed(anyhow::anyhow!("{} already exists; add --force to overwrite it", path.display()))
}

/// Writes to a temporary file, which then replaces the target. A killed run leaves either the old or the new
/// file.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), CommandError> {
    write_through(path, true, |mut file| Ok(file.write_all(bytes)?))
}

/// Writes a complete file or nothing; `fill` writes the content. A pipe or a device is written directly. Without
/// `force` the file is created in one step: if several runs write the same file, only one succeeds.
pub(crate) fn write_through(
    path: &Path,
    force: bool,
    fill: impl FnOnce(&File) -> Result<(), CommandError>,
) -> Result<(), CommandError> {
    let writing = || format!("cannot write {}", path.display());
    if is_stream(path) {
        let stream = File::options().write(true).open(path).with_context(writing)?;
        return fill(&stream).map_err(|error| error.add_context(writing));
    }
    let target = resolve_output(path, force)?;
    let part = PartialFile::new_for(&target).with_context(writing)?;
    // An error, such as a full disk, is reported with the path of the output file.
    fill(part.file()).map_err(|error| error.add_context(writing))?;
    part.persist(&target, force).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists if !force => exists_error(path),
        _ => CommandError::from(anyhow::Error::from(error).context(writing())),
    })
}

/// Standard output that records a closed pipe. It is for writers that wrap the error of a closed pipe in
/// their own error.
#[derive(Clone, Default)]
pub(crate) struct Stdout(Arc<AtomicBool>);

impl Stdout {
    /// Returns the result of the work; a closed pipe counts as [`CommandError::ReaderGone`].
    pub(crate) fn finish(&self, work: Result<(), CommandError>) -> Result<(), CommandError> {
        if self.0.load(Ordering::Relaxed) { Err(CommandError::ReaderGone) } else { work }
    }

    fn record_broken_pipe<T>(&self, done: std::io::Result<T>) -> std::io::Result<T> {
        done.inspect_err(|error| {
            self.0.fetch_or(error.kind() == std::io::ErrorKind::BrokenPipe, Ordering::Relaxed);
        })
    }
}

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.record_broken_pipe(std::io::stdout().write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.record_broken_pipe(std::io::stdout().flush())
    }
}

/// Prints text to stdout.
pub(crate) fn print(text: &str) -> Result<(), CommandError> {
    print_bytes(text.as_bytes())
}

fn print_bytes(data: &[u8]) -> Result<(), CommandError> {
    let written = std::io::stdout().lock().write_all(data);
    written.map_err(|error| CommandError::from(error).add_context(|| "cannot write to stdout".to_owned()))
}

/// Prints a message to stderr.
pub(crate) fn print_message(text: impl std::fmt::Display) {
    // stderr may be closed; the message is lost then.
    let _ = writeln!(std::io::stderr(), "{}", escape_control_characters(&text.to_string()));
}

/// Argument for the number of parallel threads.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct ThreadsArgs {
    /// Number of images to process in parallel; more images need more memory
    #[arg(long, value_name = "N", default_value = "1")]
    threads: NonZeroUsize,
}

impl ThreadsArgs {
    /// Processes all items and returns their results in order; `done` is called after each item. The first
    /// error ends the run: items in progress are finished, and no others are started.
    pub(crate) fn run<T: Send, R: Send, E: Send>(
        self,
        items: Vec<T>,
        work: impl Fn(T) -> Result<R, E> + Sync,
        mut done: impl FnMut(&R),
    ) -> Result<Vec<R>, E> {
        let mut results: Vec<Option<R>> = items.iter().map(|_| None).collect();
        let threads = self.threads.get().min(items.len());
        let items = Mutex::new(items.into_iter().enumerate());
        let next = || items.lock().map_or(None, |mut items| items.next());
        let (send, receive) = mpsc::channel();
        std::thread::scope(|scope| {
            for _ in 0..threads {
                let (send, next, work) = (send.clone(), &next, &work);
                scope.spawn(move || {
                    while let Some((index, item)) = next() {
                        if send.send((index, work(item))).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(send);
            // After an error, the results of other threads are discarded.
            for (index, result) in receive {
                let result = result?;
                done(&result);
                results[index] = Some(result);
            }
            Ok(())
        })?;
        Ok(results.into_iter().flatten().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_the_items() {
        for threads in [1, 3, 40] {
            let threads = ThreadsArgs { threads: NonZeroUsize::new(threads).unwrap() };
            let mut done = 0;
            let twice = threads.run((0..20).collect(), |item| Ok::<_, ()>(2 * item), |_| done += 1);
            assert_eq!((twice.unwrap(), done), ((0..20).map(|item| 2 * item).collect::<Vec<_>>(), 20));
            let fails = |item| if item == 7 { Err(item) } else { Ok(item) };
            assert_eq!(threads.run((0..20).collect(), fails, |_| ()), Err(7));
            assert_eq!(threads.run(Vec::new(), fails, |_| ()), Ok(Vec::new()));
        }
    }
}
