//! The app in the browser: its canvas, the requests of the page, the stored sites, and the workers.

mod mirror;
mod shelf;
mod worker;
mod runner;

/// Starts the app of the page, or a worker.
pub fn start() {
    if web_sys::window().is_some() {
        runner::start();
    } else {
        worker::start();
    }
}
