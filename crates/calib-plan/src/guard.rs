//! Limits for the work of libraries on hostile files: time, stack and panics.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use crate::error::PlanError;

/// Longest time for a drawing, in seconds.
const MAX_SECONDS: u64 = 60;
/// Stack of the thread, in bytes.
const STACK_BYTES: usize = 64 << 20;

/// Does work in a separate thread, because a hostile file can take hours or use the whole stack. A panic of a
/// library is an error of the file. After the time limit, the thread continues until its end.
pub(crate) fn guarded<T: Send + 'static>(
    kind: &'static str,
    work: impl FnOnce() -> Result<T, PlanError> + Send + 'static,
) -> Result<T, PlanError> {
    let damaged = move || PlanError::Damaged { kind, reason: "it cannot be drawn".into() };
    let limit = move |reason: String| PlanError::Limit { kind, reason };
    let (sender, receiver) = channel();
    let started = std::thread::Builder::new().stack_size(STACK_BYTES).spawn(move || {
        let result = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(damaged()));
        // The receiver may be gone after the time limit.
        let _ = sender.send(result);
    });
    started.map_err(|error| limit(error.to_string()))?;
    receiver.recv_timeout(Duration::from_secs(MAX_SECONDS)).unwrap_or_else(|error| {
        Err(match error {
            RecvTimeoutError::Timeout => {
                limit(format!("it takes more than {MAX_SECONDS} s to draw; export it as PNG"))
            }
            RecvTimeoutError::Disconnected => damaged(),
        })
    })
}
