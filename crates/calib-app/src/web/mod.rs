//! The app in the browser: one canvas, the page about it, and what the browser has in place of files.

mod mirror;
mod page;
mod runner;
mod shelf;
pub(crate) mod worker;

use std::path::Path;

use js_sys::{Reflect, Uint8Array};
use wasm_bindgen::{JsCast as _, JsValue};
use wasm_bindgen_futures::JsFuture;

use crate::dialog::Chosen;

/// Starts as the page's app, or as its worker.
pub fn start() {
    if web_sys::window().is_some() {
        runner::start();
    } else {
        worker::start();
    }
}

/// Hands a file over as a download.
pub(crate) fn download(path: &Path, bytes: &[u8]) {
    let name = path.file_name().map_or_else(|| "site.json".into(), |name| name.to_string_lossy());
    let mime = match path.extension().and_then(|extension| extension.to_str()) {
        Some("json" | "geojson") => "application/json",
        Some("png") => "image/png",
        Some("svg") => "image/svg+xml",
        Some("html") => "text/html",
        _ => "application/octet-stream",
    };
    page::download(&name, mime, &Uint8Array::from(bytes));
}

/// Asks for files of these endings, and reads them.
pub(crate) async fn pick(endings: &[&str], multiple: bool) -> Vec<Chosen> {
    let accept: Vec<String> = endings.iter().map(|ending| format!(".{ending}")).collect();
    let Ok(files) = JsFuture::from(page::pick(&accept.join(","), multiple)).await else { return Vec::new() };
    read_all(&js_sys::Array::from(&files)).await
}

/// Whether the operator asked their system for less motion.
pub(crate) fn wants_stillness() -> bool {
    page::PAGE.with(page::Page::still)
}

/// Reads files of the browser.
pub(crate) async fn read_all(files: &js_sys::Array) -> Vec<Chosen> {
    let mut chosen = Vec::new();
    for file in files.iter().filter_map(|file| file.dyn_into::<web_sys::File>().ok()) {
        let bytes = match JsFuture::from(file.array_buffer()).await {
            Ok(buffer) => Some(Uint8Array::new(&buffer).to_vec()),
            // A folder, or a file that went away: whoever takes it says so.
            Err(_) => None,
        };
        chosen.push(Chosen { name: file.name(), path: None, bytes });
    }
    chosen
}

/// Draws an SVG on white, as PNG.
pub(crate) async fn draw(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let drawn = JsFuture::from(page::draw(&Uint8Array::from(bytes), crate::drawing::SIDE)).await;
    drawn.map(|png| Uint8Array::new(&png).to_vec()).map_err(|error| said(&error))
}

/// What an error of JavaScript says.
fn said(error: &JsValue) -> String {
    let message = Reflect::get(error, &"message".into()).ok().and_then(|message| message.as_string());
    message.or_else(|| error.as_string()).unwrap_or_else(|| format!("{error:?}"))
}

/// Waits until the browser had the time to do something else.
pub(crate) async fn breath() {
    let wait = js_sys::Promise::new(&mut |resolve, _| {
        if let Some(window) = web_sys::window() {
            // Without a timer the work is done at once.
            if window.set_timeout_with_callback_and_timeout_and_arguments_0(&resolve, 16).is_err() {
                let _ = resolve.call0(&resolve);
            }
        }
    });
    // It is never rejected.
    let _ = JsFuture::from(wait).await;
}
