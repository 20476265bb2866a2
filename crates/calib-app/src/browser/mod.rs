//! The app in the browser: one canvas, what the page asks of it, the sites that the browser keeps, and the
//! worker beside it.

mod mirror;
mod shelf;
mod worker;
mod runner;

/// Starts as the page's app, or as its worker.
pub fn start() {
    if web_sys::window().is_some() {
        runner::start();
    } else {
        worker::start();
    }
}
