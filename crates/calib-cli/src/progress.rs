//! Progress of long work: a bar on a terminal, otherwise messages at intervals.

use std::cell::Cell;
use std::io::IsTerminal as _;
use std::rc::Rc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::files::print_message;

/// Time before a bar is shown; most work takes less.
const BAR_DELAY: Duration = Duration::from_secs(1);

/// Progress of reading a table.
pub(crate) struct Progress {
    start: Instant,
    /// Number of bytes read so far, if progress is measured in bytes.
    bytes: Option<Rc<Cell<u64>>>,
    total: Option<u64>,
    rows: u64,
    bar: Option<ProgressBar>,
    /// Time of the last message; absent on a terminal.
    last_message: Option<Instant>,
}

impl Progress {
    /// Creates a progress bar over `rows` if their number is known, otherwise over `bytes`.
    pub(crate) fn new(rows: Option<u64>, bytes: Option<u64>, read: Rc<Cell<u64>>) -> Self {
        let by_bytes = rows.is_none();
        let bytes_read = by_bytes.then_some(read);
        let total = rows.or(bytes);
        let start = Instant::now();
        let last_message = (!std::io::stderr().is_terminal()).then_some(start);
        Self { start, bytes: bytes_read, total, rows: 0, bar: None, last_message }
    }

    /// Adds a number of rows to the progress, and updates the bar or prints a message.
    pub(crate) fn step(&mut self, rows: usize) {
        self.rows += rows as u64;
        if let Some(line) = &mut self.last_message {
            if line.elapsed() >= MESSAGE_INTERVAL {
                *line = Instant::now();
                print_message(format_args!("calib: {}", self.text()));
            }
            return;
        }
        if self.bar.is_none() && self.start.elapsed() > BAR_DELAY {
            self.bar = Some(self.bar());
        }
        if let Some(bar) = &self.bar {
            bar.set_position(self.done());
            bar.set_message(format!("{} rows", self.rows));
        }
    }

    /// Returns the progress in the unit of `total`: rows or bytes.
    fn done(&self) -> u64 {
        self.bytes.as_ref().map_or(self.rows, |bytes| bytes.get())
    }

    /// Formats the progress as a message.
    fn text(&self) -> String {
        let share = self.total.filter(|&all| all > 0).map(|all| 100.0 * self.done() as f64 / all as f64);
        let share = share.map_or_else(String::new, |share| format!(", {share:.0} %"));
        format!("{} rows{share}, {} s", self.rows, self.start.elapsed().as_secs())
    }

    fn bar(&self) -> ProgressBar {
        let (bar, template) = match self.total {
            Some(all) => (ProgressBar::new(all), "{bar:30} {percent} %, {msg}, {eta} left"),
            None => (ProgressBar::new_spinner(), "{spinner} {msg}"),
        };
        match ProgressStyle::with_template(template) {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Time between two messages in a log.
pub(crate) const MESSAGE_INTERVAL: Duration = Duration::from_secs(10);

/// Message at intervals during work of unknown length, until it is dropped.
pub(crate) struct Pulse {
    /// Channel that ends the message thread when it is dropped.
    _end: Sender<()>,
}

impl Pulse {
    /// Starts the messages for `work`.
    pub(crate) fn new(work: &'static str) -> Self {
        let (end, ends) = channel::<()>();
        let start = Instant::now();
        std::thread::spawn(move || {
            while ends.recv_timeout(MESSAGE_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                print_message(format_args!("calib: {work}, {} s", start.elapsed().as_secs()));
            }
        });
        Self { _end: end }
    }

    /// Starts periodic messages as [`Self::new`] does. Returns `None` if stderr is a terminal, which shows a progress bar.
    pub(crate) fn unless_terminal(work: &'static str) -> Option<Self> {
        (!std::io::stderr().is_terminal()).then(|| Self::new(work))
    }
}
