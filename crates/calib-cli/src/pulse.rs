//! A line now and then while work goes on that says nothing by itself.

use std::io::IsTerminal as _;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use crate::files::say;

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
