//! Work off the frame's path: what the browser does by itself, or between two frames.

use std::cell::RefCell;
use std::rc::Rc;

use crate::platform::Lost;

/// Work that is under way, and then its result.
#[derive(Debug)]
pub struct Task<T> {
    result: Rc<RefCell<Option<T>>>,
}

impl<T> Task<T> {
    /// Work that is done already.
    #[must_use]
    pub fn done(result: T) -> Self {
        Self { result: Rc::new(RefCell::new(Some(result))) }
    }
}

impl<T: 'static> Task<T> {
    /// Does the work between two frames: a page has no threads. For what takes no longer than a blink.
    #[must_use]
    pub fn spawn(ctx: &egui::Context, work: impl FnOnce() -> T + 'static) -> Self {
        Self::wait(ctx, async move {
            crate::platform::web::breath().await;
            work()
        })
    }

    /// Waits for what the browser does; `ctx` is asked for a frame when it is done.
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

    /// The result, once; work that was lost has none.
    #[must_use]
    pub fn poll(&self) -> Option<T> {
        self.outcome()?.ok()
    }

    /// How the work ended, once.
    #[must_use]
    pub fn outcome(&self) -> Option<Result<T, Lost>> {
        self.result.take().map(Ok)
    }
}
