//! Writing files whole or not at all, and what is said to the operator.
//!
//! Work on many files at once, by as many threads as are asked for.

use std::fs::File;
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};

use anyhow::Context as _;
use calib_input::{NoPlace, Part, place};

use crate::stop::{Stop, visible};

/// Writes a file whole or not at all; `-` is stdout. A file that is there needs `force`.
pub(crate) fn write(path: &str, bytes: &[u8], force: bool) -> Result<(), Stop> {
    if path == "-" {
        return print_bytes(bytes);
    }
    write_through(Path::new(path), force, |mut file| Ok(file.write_all(bytes)?))
}

/// Refuses a path that is taken, before any work is done for it.
pub(crate) fn check_free(path: &str, force: bool) -> Result<(), Stop> {
    let is_free = path == "-" || is_stream(Path::new(path));
    if is_free { Ok(()) } else { target(Path::new(path), force).map(drop) }
}

/// Whether a path leads to a pipe or a device: nothing to replace.
fn is_stream(path: &Path) -> bool {
    path.metadata().is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// Where what is written to a path ends up.
fn target(path: &Path, force: bool) -> Result<PathBuf, Stop> {
    place(path, force).map_err(|refused| match refused {
        NoPlace::Taken(path) => taken(&path),
        NoPlace::DeadLink(_) => Stop::Failed(refused.into()),
    })
}

fn taken(path: &Path) -> Stop {
    Stop::Failed(anyhow::anyhow!("{} exists; --force overwrites it", path.display()))
}

/// Writes out of sight, then puts the file in its place over what may be there: a killed run leaves the old one
/// or the new one.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Stop> {
    write_through(path, true, |mut file| Ok(file.write_all(bytes)?))
}

/// As [`write()`], what is written handed out piece by piece. Without `force` the place is taken in one step:
/// of several runs that write one file, one does.
pub(crate) fn write_through(
    path: &Path,
    force: bool,
    fill: impl FnOnce(&File) -> Result<(), Stop>,
) -> Result<(), Stop> {
    let writing = || format!("writing {}", path.display());
    if is_stream(path) {
        let stream = File::options().write(true).open(path).with_context(writing)?;
        return fill(&stream).map_err(|stop| stop.while_doing(writing));
    }
    let target = target(path, force)?;
    let part = Part::beside(&target).with_context(writing)?;
    // A full disk is that of this file.
    fill(part.file()).map_err(|stop| stop.while_doing(writing))?;
    part.persist(&target, force).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists if !force => taken(path),
        _ => Stop::from(anyhow::Error::from(error).context(writing())),
    })
}

/// stdout, for writers that wrap its errors in their own: it remembers that its reader has gone.
#[derive(Clone, Default)]
pub(crate) struct Stdout(Arc<AtomicBool>);

impl Stdout {
    /// How work on it ended: the reader's going is no failure.
    pub(crate) fn ended(&self, work: Result<(), Stop>) -> Result<(), Stop> {
        if self.0.load(Ordering::Relaxed) { Err(Stop::ReaderGone) } else { work }
    }

    fn watched<T>(&self, done: std::io::Result<T>) -> std::io::Result<T> {
        done.inspect_err(|error| {
            self.0.fetch_or(error.kind() == std::io::ErrorKind::BrokenPipe, Ordering::Relaxed);
        })
    }
}

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.watched(std::io::stdout().write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.watched(std::io::stdout().flush())
    }
}

/// Prints text to stdout.
pub(crate) fn print(text: &str) -> Result<(), Stop> {
    print_bytes(text.as_bytes())
}

fn print_bytes(data: &[u8]) -> Result<(), Stop> {
    let written = std::io::stdout().lock().write_all(data);
    written.map_err(|error| Stop::from(error).while_doing(|| "writing to stdout".to_owned()))
}

/// Tells the operator something that is not data.
pub(crate) fn say(text: impl std::fmt::Display) {
    // A closed stderr leaves nobody to tell.
    let _ = writeln!(std::io::stderr(), "{}", visible(&text.to_string()));
}

/// How many files are worked on at once.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct ThreadsArgs {
    /// Work on so many stills at once; each takes the memory of its image
    #[arg(long, value_name = "N", default_value = "1")]
    threads: NonZeroUsize,
}

impl ThreadsArgs {
    /// The results of all items, in their order; `done` is told of each as it ends. The first failure that is met ends
    /// the work: what was begun is finished, nothing more is.
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
            // Whoever still works sends in vain once this loop is left.
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
    fn results_come_in_the_order_of_what_they_are_of() {
        for threads in [1, 3, 40] {
            let threads = ThreadsArgs { threads: NonZeroUsize::new(threads).unwrap() };
            let mut told = 0;
            let twice = threads.run((0..20).collect(), |item| Ok::<_, ()>(2 * item), |_| told += 1);
            assert_eq!((twice.unwrap(), told), ((0..20).map(|item| 2 * item).collect::<Vec<_>>(), 20));
            let fails = |item| if item == 7 { Err(item) } else { Ok(item) };
            assert_eq!(threads.run((0..20).collect(), fails, |_| ()), Err(7));
            assert_eq!(threads.run(Vec::new(), fails, |_| ()), Ok(Vec::new()));
        }
    }
}
