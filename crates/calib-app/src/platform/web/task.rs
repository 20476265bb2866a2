//! Background work in the browser: promises, or short work between two frames.

use std::cell::RefCell;
use std::rc::Rc;

use crate::platform::Lost;

/// Task in the background and its result.
#[derive(Debug)]
pub struct Task<T> {
    result: Rc<RefCell<Option<T>>>,
}

impl<T> Task<T> {
    /// Creates a task that has ended with this result.
    #[must_use]
    pub fn done(result: T) -> Self {
        Self { result: Rc::new(RefCell::new(Some(result))) }
    }
}

impl<T: 'static> Task<T> {
    /// Starts a short task, which runs between two frames because a page has no threads.
    #[must_use]
    pub fn spawn(ctx: &egui::Context, work: impl FnOnce() -> T + 'static) -> Self {
        Self::wait(ctx, async move {
            crate::platform::web::breath().await;
            work()
        })
    }

    /// Starts a task that waits for a future of the browser; requests a frame when the future has ended.
    #[must_use]
    pub fn wait(ctx: &egui::Context, work: impl Future<Output = T> + 'static) -> Self {
        let (result, ctx) = (Rc::new(RefCell::new(None)), ctx.clone());
        let out = Rc::clone(&result);
        wasm_bindgen_futures::spawn_local(async move {
            let done = work.await;
            out.replace(Some(done));
            ctx.request_repaint();
        });
        Self { result }
    }

    /// Returns the result when the task has ended, only once.
    #[must_use]
    pub fn poll(&self) -> Option<T> {
        self.outcome()?.ok()
    }

    /// Returns the result when the task has ended, only once; it is never [`Lost`].
    #[must_use]
    pub fn outcome(&self) -> Option<Result<T, Lost>> {
        self.result.take().map(Ok)
    }
}
