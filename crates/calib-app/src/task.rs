//! Work off the frame's path: a thread natively, in the browser the next frame that asks.

/// Work that is under way, and then its result.
#[derive(Debug)]
pub struct Task<T> {
    #[cfg(not(target_arch = "wasm32"))]
    result: std::sync::mpsc::Receiver<T>,
    #[cfg(target_arch = "wasm32")]
    result: std::cell::Cell<Option<T>>,
}

#[cfg(not(target_arch = "wasm32"))]
impl<T: Send + 'static> Task<T> {
    /// Starts the work; `ctx` is asked for a frame when it is done.
    #[must_use]
    pub fn spawn(ctx: &egui::Context, work: impl FnOnce() -> T + Send + 'static) -> Self {
        let (sender, result) = std::sync::mpsc::channel();
        let ctx = ctx.clone();
        std::thread::spawn(move || {
            let done = work();
            // Nobody waits any more when the receiver is gone.
            if sender.send(done).is_ok() {
                ctx.request_repaint();
            }
        });
        Self { result }
    }

    /// The result, once.
    #[must_use]
    pub fn poll(&self) -> Option<T> {
        self.result.try_recv().ok()
    }
}

#[cfg(target_arch = "wasm32")]
impl<T: 'static> Task<T> {
    /// Does the work; there is one thread.
    #[must_use]
    pub fn spawn(ctx: &egui::Context, work: impl FnOnce() -> T + 'static) -> Self {
        ctx.request_repaint();
        Self { result: std::cell::Cell::new(Some(work())) }
    }

    /// The result, once.
    #[must_use]
    pub fn poll(&self) -> Option<T> {
        self.result.take()
    }
}
