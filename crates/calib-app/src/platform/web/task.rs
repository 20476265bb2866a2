//! Background work in the browser: promises, or short work between two frames.

use std::cell::RefCell;
use std::rc::Rc;

use crate::platform::Lost;

/// Background work and its result.
#[derive(Debug)]
pub struct Task<T> {
    result: Rc<RefCell<Option<T>>>,
}

impl<T> Task<T> {
    /// Creates finished work.
    #[must_use]
    pub fn done(result: T) -> Self {
        Self { result: Rc::new(RefCell::new(Some(result))) }
    }
}

impl<T: 'static> Task<T> {
    /// Runs work between two frames, because a page has no threads. For short work only.
    #[must_use]
    pub fn spawn(ctx: &egui::Context, work: impl FnOnce() -> T + 'static) -> Self {
        Self::wait(ctx, async move {
            crate::platform::web::breath().await;
            work()
        })
    }

    /// Waits for a future of the browser; a frame is requested when it is done.
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

    /// Returns the result once; work that panicked has none.
    #[must_use]
    pub fn poll(&self) -> Option<T> {
        self.outcome()?.ok()
    }

    /// Returns the outcome once.
    #[must_use]
    pub fn outcome(&self) -> Option<Result<T, Lost>> {
        self.result.take().map(Ok)
    }
}
