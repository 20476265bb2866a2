//! Work off the frame's path: a thread natively, in the browser what it does by itself.

/// Work that is under way, and then its result.
#[derive(Debug)]
pub struct Task<T> {
    #[cfg(not(target_arch = "wasm32"))]
    result: std::sync::mpsc::Receiver<T>,
    #[cfg(target_arch = "wasm32")]
    result: std::rc::Rc<std::cell::RefCell<Option<T>>>,
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

impl<T> Task<T> {
    /// Work that is done already.
    #[must_use]
    pub fn done(result: T) -> Self {
        #[cfg(not(target_arch = "wasm32"))]
        {
            let (sender, receiver) = std::sync::mpsc::channel();
            // The receiver is there.
            let _ = sender.send(result);
            Self { result: receiver }
        }
        #[cfg(target_arch = "wasm32")]
        Self { result: std::rc::Rc::new(std::cell::RefCell::new(Some(result))) }
    }
}

#[cfg(target_arch = "wasm32")]
impl<T: 'static> Task<T> {
    /// Waits for what the browser does; `ctx` is asked for a frame when it is done.
    #[must_use]
    pub fn wait(ctx: &egui::Context, work: impl Future<Output = T> + 'static) -> Self {
        let (result, ctx) = (std::rc::Rc::new(std::cell::RefCell::new(None)), ctx.clone());
        let out = std::rc::Rc::clone(&result);
        wasm_bindgen_futures::spawn_local(async move {
            let done = work.await;
            out.replace(Some(done));
            ctx.request_repaint();
        });
        Self { result }
    }

    /// The result, once.
    #[must_use]
    pub fn poll(&self) -> Option<T> {
        self.result.take()
    }
}
