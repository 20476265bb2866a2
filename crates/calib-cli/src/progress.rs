//! A bar for work over a second on a terminal, a line now and then elsewhere.
//!
//! A line now and then while work goes on that says nothing by itself.

use std::cell::Cell;
use std::io::IsTerminal as _;
use std::rc::Rc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::files::say;

/// How long nothing is shown: most work is done by then.
const QUIET: Duration = Duration::from_secs(1);

/// How far a table is read.
pub(crate) struct Progress {
    start: Instant,
    /// What counts: bytes read, or else rows.
    bytes: Option<Rc<Cell<u64>>>,
    all: Option<u64>,
    rows: u64,
    bar: Option<ProgressBar>,
    /// When a line was written last, where there is no terminal.
    line: Option<Instant>,
}

impl Progress {
    /// Of a table of so many rows, if that is known, or else of so many bytes.
    pub(crate) fn new(rows: Option<u64>, bytes: Option<u64>, read: Rc<Cell<u64>>) -> Self {
        let by_bytes = rows.is_none();
        let bytes_read = by_bytes.then_some(read);
        let all = rows.or(bytes);
        let start = Instant::now();
        let line = (!std::io::stderr().is_terminal()).then_some(start);
        Self { start, bytes: bytes_read, all, rows: 0, bar: None, line }
    }

    /// So many rows more are done.
    pub(crate) fn step(&mut self, rows: usize) {
        self.rows += rows as u64;
        if let Some(line) = &mut self.line {
            if line.elapsed() >= LINES {
                *line = Instant::now();
                say(format_args!("calib: {}", self.text()));
            }
            return;
        }
        if self.bar.is_none() && self.start.elapsed() > QUIET {
            self.bar = Some(self.bar());
        }
        if let Some(bar) = &self.bar {
            bar.set_position(self.done());
            bar.set_message(format!("{} rows", self.rows));
        }
    }

    /// As much as `all`, when all is done.
    fn done(&self) -> u64 {
        self.bytes.as_ref().map_or(self.rows, |bytes| bytes.get())
    }

    /// How far it is, in a line.
    fn text(&self) -> String {
        let share = self.all.filter(|&all| all > 0).map(|all| 100.0 * self.done() as f64 / all as f64);
        let share = share.map_or_else(String::new, |share| format!(", {share:.0} %"));
        format!("{} rows{share}, {} s", self.rows, self.start.elapsed().as_secs())
    }

    fn bar(&self) -> ProgressBar {
        let (bar, template) = match self.all {
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

/// Between two lines of a log.
pub(crate) const LINES: Duration = Duration::from_secs(10);

/// Says every ten seconds that work goes on of which nobody knows how much is left, until it is dropped.
pub(crate) struct Pulse {
    /// Dropped with the pulse, which ends the thread that listens.
    _end: Sender<()>,
}

impl Pulse {
    /// Of this work.
    pub(crate) fn new(work: &'static str) -> Self {
        let (end, ends) = channel::<()>();
        let start = Instant::now();
        std::thread::spawn(move || {
            while ends.recv_timeout(LINES) == Err(RecvTimeoutError::Timeout) {
                say(format_args!("calib: {work}, {} s", start.elapsed().as_secs()));
            }
        });
        Self { _end: end }
    }

    /// As [`Self::new`], where no bar on a terminal says it.
    pub(crate) fn beside_a_bar(work: &'static str) -> Option<Self> {
        (!std::io::stderr().is_terminal()).then(|| Self::new(work))
    }
}
